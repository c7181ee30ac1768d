"""The command ``vffnull``."""

from __future__ import annotations

import difflib
import json
import math
import re
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NoReturn

import click

from vffnull import _core
from vffnull._simulate import prepare, progress_bar
from vffnull._simulate import run as run_scenario
from vffnull.errors import InputError, ScenarioError, VffNullError
from vffnull.real_time import FIGURE_ENDINGS, RealTimeReport, measure
from vffnull.result import Result, Status, npz_path
from vffnull.scenario import Scenario, read, scenarios

__all__ = ["main"]

FINE, WRONG_INPUT, FAILED, INTERRUPTED = 0, 2, 3, 130


def main() -> NoReturn:
    """Run the command line and exit: 0 fine, 2 wrong input, 3 the run failed, 130 interrupted."""
    try:
        code = _commands.main(prog_name="vffnull", standalone_mode=False)
    except click.ClickException as error:
        error.show()
        code = WRONG_INPUT
    except (click.Abort, KeyboardInterrupt):
        code = INTERRUPTED
    except (VffNullError, OSError, ImportError) as error:
        _say(f"error: {error}", "red")
        code = WRONG_INPUT
    sys.exit(code or FINE)


class _Helpful(click.Group):
    """A group of commands that suggests the nearest one."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args and not args[0].startswith("-") and self.get_command(ctx, args[0]) is None:
            known = self.list_commands(ctx)
            near = difflib.get_close_matches(args[0], known, n=1)
            if not near and args[0] in scenarios():
                near = [f"run {args[0]}"]
            hint = f"did you mean {near[0]!r}?" if near else f"there are {', '.join(known)}."
            raise click.UsageError(f"no command {args[0]!r}; {hint}", ctx)
        return super().resolve_command(ctx, args)


@click.group(cls=_Helpful, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(_core.__version__, prog_name="vffnull", message="%(prog)s %(version)s")
def _commands() -> None:
    """Torque-level obstacle avoidance for redundant planar arms.

    \b
    vffnull run paper-1 --plot figures/    run a bundled scenario, draw the figures
    vffnull list                           what is bundled
    vffnull show paper-1 > mine.toml       a scenario to start from
    vffnull run mine.toml --json           run it, print the metrics for a script
    vffnull realtime paper-1               run it against the clock
    """


@_commands.command()
@click.argument("scenario")
@click.option(
    "--set",
    "assignments",
    multiple=True,
    metavar="KEY=VALUE",
    help="Change a key, by its dotted name; repeatable.",
)
@click.option(
    "--plot", "plot_to", type=click.Path(path_type=Path), metavar="DIR", help="Write the figures as PNG."
)
@click.option(
    "--save", "save_to", type=click.Path(path_type=Path), metavar="FILE", help="Write the result as .npz."
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of a table.")
@click.option("--strict", is_flag=True, help="Exit with 3 also if a link touched an obstacle.")
@click.option("--quiet", "-q", is_flag=True, help="Print nothing but warnings and errors.")
def run(
    scenario: str,
    assignments: tuple[str, ...],
    plot_to: Path | None,
    save_to: Path | None,
    as_json: bool,
    strict: bool,
    quiet: bool,
) -> int:
    """Run a scenario: a bundled name or the path of a TOML file.

    \b
    vffnull run paper-1 --plot figures/ --save paper-1.npz
    vffnull run sweep-through --set controller.field.gain=0
    vffnull run sweep-through --set controller.projection=none --json
    vffnull run paper-1 --set "obstacles.0.position=[1.5, 1.8]" --set duration=5

    Exit codes: 0 fine, 2 wrong input, 3 the run diverged (or collided, under --strict), 130 interrupted.
    """
    ready = prepare(scenario, dict(_assignment(text) for text in assignments))
    if save_to is not None:  # find out before the run, not after it
        npz_path(save_to)
    if plot_to is not None:
        plot_to.mkdir(parents=True, exist_ok=True)
    result = _run(ready, bar=sys.stderr.isatty() and not quiet)
    for message in result.warnings:
        _say(f"warning: {message}", "yellow")
    files: list[Path] = []
    if save_to is not None:
        files.append(result.save(save_to))
    if plot_to is not None:
        files.extend(Path(path) for path in result.plot(plot_to))
    if as_json:
        click.echo(json.dumps(_report(result, files), ensure_ascii=False))
    elif not quiet:
        _print(result, files)
    return _exit_code(result.status, strict)


@_commands.command()
@click.argument("scenario")
@click.option(
    "--rate", type=float, default=1000.0, show_default=True, help="Control periods per second [Hz]."
)
@click.option("--seconds", type=float, default=60.0, show_default=True, help="How long [s].")
@click.option("--priority", type=int, metavar="N", help="Run under SCHED_FIFO with this priority, 1 to 99.")
@click.option("--core", type=int, metavar="K", help="Stay on this core.")
@click.option(
    "--set",
    "assignments",
    multiple=True,
    metavar="KEY=VALUE",
    help="Change a key, by its dotted name; repeatable.",
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of a table.")
@click.option(
    "--plot", "plot_to", type=click.Path(path_type=Path), metavar="FILE", help="Write the histograms as PNG."
)
@click.option("--strict", is_flag=True, help="Exit with 3 also if a deadline was missed.")
def realtime(
    scenario: str,
    rate: float,
    seconds: float,
    priority: int | None,
    core: int | None,
    assignments: tuple[str, ...],
    as_json: bool,
    plot_to: Path | None,
    strict: bool,
) -> int:
    """Run the closed loop against the wall clock, and say what rate this machine can hold.

    \b
    vffnull realtime sweep-through --rate 1000 --seconds 60
    vffnull realtime paper-1 --rate 4000 --priority 80 --core 1 --plot timing.png

    Plant and law run together once per period, at absolute deadlines; a scenario that is over begins
    again. Systems grant --priority to few.

    Exit codes: 0 fine, 2 wrong input, 3 the run diverged (or missed a deadline, under --strict), 130
    interrupted.
    """
    ready = prepare(scenario, dict(_assignment(text) for text in assignments))
    if plot_to is not None and plot_to.suffix not in FIGURE_ENDINGS:  # find out before the run, not after it
        raise InputError(f"--plot {plot_to}: a figure is written as {', '.join(FIGURE_ENDINGS)}")
    bar = sys.stderr.isatty() and not as_json
    report = measure(ready, rate, seconds, priority, core, progress=bar)
    for note in report.notes:
        _say(f"warning: {note}", "yellow")
    if plot_to is not None:
        plot_to.parent.mkdir(parents=True, exist_ok=True)
        report.plot(plot_to)
    if as_json:
        click.echo(json.dumps(report.to_dict() | {"version": _core.__version__}, ensure_ascii=False))
    else:
        _print_timing(report, plot_to)
    if report.status is Status.INTERRUPTED:
        return INTERRUPTED
    failed = report.status is Status.DIVERGED or (strict and not report.held)
    return FAILED if failed else FINE


@_commands.command("list")
def list_() -> None:
    """List the bundled scenarios."""
    names = scenarios()
    wide = max(map(len, names))
    for name in names:
        click.echo(f"{name:<{wide}}  {_core.parse_toml(read(name), name).get('description', '')}")


@_commands.command()
@click.argument("scenario")
def show(scenario: str) -> None:
    """Print a scenario as TOML, comments included.

    \b
    vffnull show paper-1 > mine.toml
    """
    click.echo(read(scenario), nl=False)


@_commands.command()
@click.argument("files", nargs=-1, required=True, metavar="FILE...")
def validate(files: tuple[str, ...]) -> int:
    """Check scenario files without running them.

    \b
    vffnull validate mine.toml
    vffnull validate scenes/*.toml
    """
    code = FINE
    for file in files:
        try:
            warnings = _core.check("scenario", _core.parse_toml(read(file), file))
        except ScenarioError as error:
            _say(_with_name(file, error), "red")
            code = WRONG_INPUT
            continue
        for message in warnings:
            _say(f"{file}: warning: {message}", "yellow")
        click.echo(f"{file}: fine")
    return code


@_commands.command()
def schema() -> None:
    """Print every key: unit, default, meaning."""
    click.echo(_core.schema().rstrip())


def _assignment(text: str) -> tuple[str, Any]:
    """Split KEY=VALUE; the value is TOML, and a bare word is a string."""
    key, equals, value = (part.strip() for part in text.partition("="))
    if not (key and equals and value):
        raise click.UsageError(f"--set {text}: expected KEY=VALUE, as in --set controller.field.gain=2.0")
    try:
        parsed = _core.parse_toml(f"value = {value}", "--set")
    except ScenarioError:
        if re.fullmatch(r"[A-Za-z_][\w-]*", value):
            return key, value
        raise click.UsageError(
            f"--set {key}: {value!r} is not a TOML value; 2.0, [1, 2], true and 'text' are"
        ) from None
    if set(parsed) != {"value"}:
        raise click.UsageError(f"--set {key}: one value expected, not {value!r}")
    return key, parsed["value"]


def _run(ready: Scenario, bar: bool) -> Result:
    """Run, with a progress bar once it takes longer than a second."""
    if not bar:
        return run_scenario(ready)
    with progress_bar(ready.duration, delay=1.0) as report:
        return run_scenario(ready, report)


def _report(result: Result, files: Iterable[Path]) -> dict[str, Any]:
    return {
        "scenario": result.scenario.name,
        "status": result.status.value,
        "message": result.message,
        "end_time": result.end_time,
        "version": result.version,
        "metrics": {name: _finite(value) for name, value in result.metrics.items()},
        "files": [str(path) for path in files],
    }


def _finite(value: float | int | None) -> float | int | None:
    return value if value is not None and math.isfinite(value) else None


def _print(result: Result, files: list[Path]) -> None:
    scenario = result.scenario
    title = click.style(scenario.name or "scenario", bold=True)
    click.echo(f"{title}: {scenario.description}" if scenario.description else title)
    colour = {Status.COMPLETED: "green", Status.COLLIDED: "yellow"}.get(result.status, "red")
    click.echo(f"{click.style(str(result.status), fg=colour)}: {result.message}")
    click.echo(f"computed in {result.wall_time * 1e3:.3g} ms\n")
    click.echo(result.metrics)
    if files:
        click.echo("")
    for path in files:
        click.echo(f"wrote {path}")


def _print_timing(report: RealTimeReport, plot: Path | None) -> None:
    click.echo(click.style(report.scenario.name or "scenario", bold=True), nl=False)
    click.echo(f": {report.periods} periods at {report.rate:g} Hz, {report.status}\n")
    click.echo(report)
    if plot is not None:
        click.echo(f"\nwrote {plot}")


def _exit_code(status: Status, strict: bool) -> int:
    if status is Status.INTERRUPTED:
        return INTERRUPTED
    failed = status in (Status.DIVERGED, Status.FAILED) or (strict and status is Status.COLLIDED)
    return FAILED if failed else FINE


def _with_name(file: str, error: ScenarioError) -> str:
    return str(error) if file in str(error) else f"{file}: {error}"


def _say(text: str, colour: str) -> None:
    """Write to stderr, the first word in colour on a terminal."""
    head, separator, rest = text.partition(": ")
    click.echo(f"{click.style(head, fg=colour)}{separator}{rest}", err=True)
