"""The command ``vffnull``."""

from __future__ import annotations

import difflib
import io
import os
import shlex
import signal
import sys
import threading
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NoReturn

import click

import vffnull._core as _core
from vffnull._support.errors import ScenarioError, VffNullError
from vffnull._support.figures import is_file
from vffnull._support.files import apart, writable
from vffnull.cli import results
from vffnull.cli.arms import arms
from vffnull.cli.common import (
    COLOURS,
    ENDED_BY,
    FINE,
    INTERRUPTED,
    WRONG_INPUT,
    complete_scenario,
    echo_json,
    exit_code,
    format_option,
    has_folder,
    place_of_figures,
    prepared,
    run_with_bar,
    say,
    set_option,
    warned,
)
from vffnull.cli.evaluate import evaluate
from vffnull.cli.live import live
from vffnull.cli.perceive import perceive
from vffnull.cli.plan import plan
from vffnull.cli.realtime import realtime
from vffnull.cli.study import study
from vffnull.logs import READABLE, check_path
from vffnull.model.arm_files import explicit
from vffnull.model.document import Document
from vffnull.model.outcome import seconds
from vffnull.model.scenario import read, scenarios, shown, source_of
from vffnull.model.toml_text import parsed
from vffnull.model.validation import faults
from vffnull.run.result import Result
from vffnull.run.simulate import PLANTS

__all__ = ["main"]


def main() -> NoReturn:
    """Run the command line and exit: 0 success, 2 wrong input, 3 failed, 130 interrupted, 143 terminated.

    129 says that the terminal was closed.
    """
    _set_up()
    came, output = _heard_as_ctrl_c(), sys.stdout
    try:
        code = _commands.main(prog_name="vffnull", standalone_mode=False)
        sys.stdout.flush()
    except click.ClickException as error:
        error.show()
        code = WRONG_INPUT
    except (click.Abort, KeyboardInterrupt):
        code = INTERRUPTED
    except BrokenPipeError:  # the reader of the output has closed it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = FINE
    except SystemExit:
        if sys.stdout is output:  # click wraps one that its reader has closed
            raise
        code = FINE
    except OSError as error:
        place = f"{shown(error.filename)}: " if error.filename else ""
        say(f"error: {place}{error.strerror or error}", "red")
        code = WRONG_INPUT
    except (VffNullError, ImportError) as error:
        say(f"error: {error}", "red")
        code = WRONG_INPUT
    if code == INTERRUPTED and came:
        code = ENDED_BY + came[0]
    is_ended = code is not None and code > ENDED_BY
    if is_ended and threading.active_count() > 1:  # nobody needs what they compute
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code or FINE)


def _heard_as_ctrl_c() -> list[int]:
    """Let signals end the command as Ctrl-C does, with nothing left half done; the list gets what came."""
    came: list[int] = []

    def handler(number: int, _frame: object) -> None:
        came.append(number)
        if not callable(signal.getsignal(signal.SIGINT)):  # a shell's job in the background does not hear it
            raise KeyboardInterrupt
        signal.raise_signal(signal.SIGINT)

    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, handler)
        # Closing the terminal; somebody may want the command to outlive that.
        closed = getattr(signal, "SIGHUP", None)
        if closed is not None and signal.getsignal(closed) == signal.SIG_DFL:
            signal.signal(closed, handler)
    return came


def _set_up() -> None:
    """Adapt to the shell: streams that are closed or cannot show every character, a backend for windows."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed by the shell
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))
        elif isinstance(stream, io.TextIOWrapper):  # a character that it cannot show is escaped
            stream.reconfigure(errors="backslashreplace")
    os.environ["MPLBACKEND"] = "agg"  # figures go into files


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
    """Torque-level obstacle avoidance for redundant arms.

    \b
    vffnull run sweep-through --plot figs  run a bundled scenario, draw the figures
    vffnull list                           what is bundled
    vffnull show paper-1 > mine.toml       a scenario to start from
    vffnull run mine.toml --json           run it, print the metrics for a script
    vffnull live                           play with it in the browser
    vffnull realtime paper-1               run it against the clock
    vffnull plan narrow-gap --out plan.npz plan a motion to where the reference ends
    vffnull perceive cell.mcap --arm NAME  replay what depth cameras have recorded
    vffnull evaluate --count 20            controllers side by side on random scenes
    vffnull study run NAME --out results   thousands of runs, resumable, on a cluster too
    vffnull animate paper-1 paper-1.gif    film it
    vffnull report paper-1 paper-1.html    everything about it on one page

    Names of commands, options and scenarios complete by the Tab key once your shell's start file has this
    line (zsh_source for zsh; for fish, fish_source and "| source"):

    \b
    eval "$(_VFFNULL_COMPLETE=bash_source vffnull)"
    """


for _command in (
    arms,
    live,
    plan,
    perceive,
    realtime,
    evaluate,
    study,
    results.animate,
    results.report,
    results.compare,
):
    _commands.add_command(_command)


@_commands.command()
@click.argument("scenario", shell_complete=complete_scenario)
@set_option
@click.option(
    "--plant",
    type=click.Choice(PLANTS),
    default=PLANTS[0],
    help="What moves the arm: the core, or MuJoCo, where obstacles push it.",
)
@click.option(
    "--plot",
    "plot_to",
    type=click.Path(),
    callback=place_of_figures,
    metavar="DIR|FILE",
    help="Write the figures; or one picture, FILE.png.",
)
@format_option
@click.option(
    "--save", "save_to", type=click.Path(path_type=Path), metavar="FILE", help="Write the result; see below."
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of a table.")
@click.option("--strict", is_flag=True, help="Exit with 3 unless all is well; see below.")
@click.option("--quiet", "-q", is_flag=True, help="Print nothing but warnings and errors.")
def run(
    scenario: str,
    assignments: tuple[str, ...],
    plant: str,
    plot_to: Path | None,
    figure_format: str,
    save_to: Path | None,
    as_json: bool,
    strict: bool,
    quiet: bool,
) -> int:
    """Run a scenario: a bundled name or the path of a TOML file.

    \b
    vffnull run sweep-through --plot figures/ --save run.npz
    vffnull run paper-1 --plot figures/ --format pdf
    vffnull run sweep-through --set controller.field.gain=0
    vffnull run sweep-through --set controller.projection=none --json
    vffnull run panda-sweep --plant mujoco --set controller.field.gain=0
    vffnull run paper-1 --set "obstacles.0.position=[1.5, 1.8]" --set duration=5

    --save writes .npz or .csv; with extras also .parquet, .arrow, .mcap or .rrd, by the ending of FILE.

    Exit codes: 0 success, 2 wrong input, 3 the run diverged, 130 interrupted. Under --strict also 3 after
    contact with obstacles or among the arm's own links, a joint at its stop, a limit of torque or speed
    exceeded, a barrier broken, or a reference that is not held at the end: whatever the headline tells of.
    """
    ready = prepared(scenario, assignments)
    if save_to is not None:  # find out before the run, not after it
        check_path(save_to)
        has_folder(save_to, scenario)
    if plot_to is not None:
        apart(plot_to, scenario)
        writable(plot_to.parent if is_file(plot_to) else plot_to)
    result = run_with_bar(ready, quiet, plant)
    files: list[Path] = []
    try:
        if save_to is not None:
            files.append(result.save(save_to))
        if plot_to is not None:
            files.extend(Path(path) for path in result.plot(plot_to, figure_format))
    finally:  # a disk that is full takes nothing of what was computed
        if as_json:
            echo_json(_report(result, files))
        elif not quiet:
            _print(result, files)
    if not (as_json or quiet):
        click.echo(f"\n{_next(scenario, assignments, save_to)}")
    return exit_code(result, strict)


@_commands.command("list")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON array.")
def list_(as_json: bool) -> None:
    """List the bundled scenarios.

    \b
    vffnull list
    vffnull list --json
    """
    found = {name: _core.parse_toml(read(name), name).get("description", "") for name in scenarios()}
    if as_json:
        rows = [{"name": name, "description": text} for name, text in found.items()]
        echo_json(rows)
        return
    wide = max(map(len, found))
    for name, text in found.items():
        click.echo(f"{name:<{wide}}  {text}")


@_commands.command()
@click.argument("scenario", shell_complete=complete_scenario)
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of TOML.")
def show(scenario: str, as_json: bool) -> None:
    """Print a scenario as TOML, comments included.

    \b
    vffnull show paper-1 > mine.toml
    vffnull show paper-1 --json
    """
    text = read(scenario)
    if as_json:
        echo_json(parsed(text, shown(scenario)))
        return
    click.echo(text, nl=False)


@_commands.command()
@click.argument("files", nargs=-1, required=True, metavar="FILE...")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON array.")
def validate(files: tuple[str, ...], as_json: bool) -> int:
    """Check scenario files without running them; every fault is listed.

    \b
    vffnull validate mine.toml
    vffnull validate scenes/*.toml --json
    """
    found = [_validated(file) for file in files]
    if as_json:
        echo_json(found)
    else:
        _print_faults(found)
    return WRONG_INPUT if any(each["errors"] for each in found) else FINE


@_commands.command()
@click.option("--json", "as_json", is_flag=True, help="Print a JSON Schema, for editors.")
def schema(as_json: bool) -> None:
    """Print every key: unit, default, meaning.

    \b
    vffnull schema
    vffnull schema --json > vffnull.schema.json

    A scenario beside that file whose first line is `#:schema ./vffnull.schema.json` is completed and checked
    by editors that know Taplo, such as VS Code with Even Better TOML.
    """
    click.echo(_core.schema_json() if as_json else _core.schema().rstrip())


def _report(result: Result, files: Iterable[Path]) -> dict[str, Any]:
    return {
        "scenario": result.scenario.name,
        "status": result.status.value,
        "verdict": result.headline.verdict,
        "message": "; ".join(result.headline.lines),
        "end_time": result.end_time,
        "version": result.version,
        "metrics": dict(result.metrics),
        "files": [str(path) for path in files],
    }


def _next(scenario: str, assignments: tuple[str, ...], saved: Path | None) -> str:
    """What may be done next, as commands to copy."""
    changes = "".join(f" --set {shlex.quote(each)}" for each in assignments)
    name = shlex.quote(shown(scenario))
    page = shlex.quote(f"{Path(shown(scenario)).stem}.html")
    again = f"{name} {page}{changes}"
    if saved is not None and saved.suffix in READABLE:
        again = f"{shlex.quote(shown(saved))} {page}"
    return f"next: vffnull live {name}{changes}\n      vffnull report {again}"


def _print(result: Result, files: list[Path]) -> None:
    scenario = result.scenario
    title = click.style(scenario.name or "scenario", bold=True)
    click.echo(f"{title}: {scenario.description}" if scenario.description else title)
    headline = result.headline
    click.echo(f"{click.style(headline.verdict, fg=COLOURS[headline.severity])}: {headline.lines[0]}")
    for line in headline.lines[1:]:
        click.echo(f"  {line}")
    click.echo(f"computed in {seconds(result.wall_time)}\n")
    click.echo(result.metrics)
    if files:
        click.echo("")
    for path in files:
        click.echo(f"wrote {path}")


def _validated(file: str) -> dict[str, Any]:
    """What is wrong with a file, and what is odd about it."""
    name = shown(file)
    document: Document = {}
    try:
        document = source_of(file)
        with warned() as odd:
            document = explicit(document)
        errors = [f"{name}: {fault}" for fault in faults(document)]
        found = [*odd, *([] if errors else _core.check("scenario", document, recorded=True))]
    except ScenarioError as error:
        errors, found = [str(error) if name in str(error) else f"{name}: {error}"], []
        if document:  # its arm is in a file that cannot be read: what is wrong beside it
            errors += [f"{name}: {each}" for each in faults(document) if not each.startswith("arm")]
    return {"file": name, "error": errors[0] if errors else None, "errors": errors, "warnings": found}


def _print_faults(found: list[dict[str, Any]]) -> None:
    for each in found:
        for fault in each["errors"]:
            say(fault, "red")
        for message in each["warnings"]:
            say(f"{each['file']}: warning: {message}", "yellow")
        if not each["errors"]:
            click.echo(f"{each['file']}: valid")
