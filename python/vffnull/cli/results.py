"""Commands that show results: ``animate``, ``report`` and ``compare``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from vffnull.cli.common import (
    can_write,
    complete_scenario,
    echo_json,
    exit_code,
    has_folder,
    interactive,
    run_or_load,
    set_option,
)
from vffnull.run.result import Result

__all__ = ["animate", "compare", "report"]


def _common(command: Callable[..., Any]) -> Callable[..., Any]:
    """The options of every command here."""
    as_json = click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
    quiet = click.option("--quiet", "-q", is_flag=True, help="Print nothing but warnings and errors.")
    return as_json(quiet(command))


def _view(
    _context: click.Context, _param: click.Parameter, text: str | None
) -> str | tuple[float, float] | None:
    """A name, or two angles."""
    numbers = (text or "").split(",")
    if len(numbers) != 2:
        return text
    try:
        return float(numbers[0]), float(numbers[1])
    except ValueError:
        return text


@click.command()
@click.argument("source", shell_complete=complete_scenario)
@click.argument("file", type=click.Path(path_type=Path))
@set_option
@click.option(
    "--fps", type=float, default=25.0, show_default=True, help="Frames per second, at most 50 in a GIF."
)
@click.option("--speed", type=float, default=1.0, show_default=True, help="Simulated seconds per second.")
@click.option(
    "--size", type=int, metavar="DOTS", help="How wide the film is; 648 in the plane, 600 in space."
)
@click.option(
    "--view",
    callback=_view,
    metavar="NAME|AZ,EL",
    help="In space: front, back, left, right, top, or two angles [degrees].",
)
@_common
def animate(
    source: str,
    file: Path,
    assignments: tuple[str, ...],
    fps: float,
    speed: float,
    size: int | None,
    view: str | tuple[float, float] | None,
    as_json: bool,
    quiet: bool,
) -> int:
    """Film a run: SOURCE is a scenario or a saved result, FILE ends in .gif or .mp4.

    \b
    vffnull animate sweep-through sweep.gif
    vffnull animate run.npz run.mp4 --speed 2
    vffnull animate panda-sweep side.gif --view left --size 400 --fps 10
    vffnull animate paper-1 none.gif --set controller.projection=none
    """
    from vffnull.draw.figures.animation import check

    check(file, fps, speed, size, view)  # before the run, not after it
    can_write(file, source)
    result = run_or_load(source, assignments, quiet)
    bar = interactive() and not quiet
    path = result.animate(file, fps=fps, speed=speed, size=size, view=view, progress=bar)
    return _end([result], path, as_json, quiet)


@click.command()
@click.argument("source", shell_complete=complete_scenario)
@click.argument("file", type=click.Path(path_type=Path))
@set_option
@_common
def report(source: str, file: Path, assignments: tuple[str, ...], as_json: bool, quiet: bool) -> int:
    """Write a run as one HTML page that needs no network: SOURCE is a scenario or a saved result.

    \b
    vffnull report sweep-through sweep.html
    vffnull report run.npz run.html
    """
    from vffnull.draw.report import check_path

    check_path(file)
    has_folder(file, source)
    result = run_or_load(source, assignments, quiet)
    return _end([result], result.report(file), as_json, quiet)


@click.command()
@click.argument("sources", nargs=-1, required=True, metavar="SOURCE...", shell_complete=complete_scenario)
@click.argument("file", type=click.Path(path_type=Path))
@_common
def compare(sources: tuple[str, ...], file: Path, as_json: bool, quiet: bool) -> int:
    """Write several runs as one HTML page; each SOURCE is a scenario or a saved result.

    \b
    vffnull compare paper-1 paper-1-ramp both.html
    vffnull compare weak.npz strong.npz gains.html
    """
    from vffnull.draw.report import check_path
    from vffnull.draw.report import compare as write

    check_path(file)
    has_folder(file, *sources)
    results = {Path(source).stem: run_or_load(source, (), quiet) for source in sources}
    if len(results) < len(sources):  # two files of one name
        results = {source: run_or_load(source, (), quiet) for source in sources}
    return _end(list(results.values()), write(results, file), as_json, quiet)


def _end(results: list[Result], path: Path, as_json: bool, quiet: bool) -> int:
    """Say what was written; the exit code is that of the run that went worst."""
    if as_json:
        about = [
            {"scenario": run.scenario.name, "status": run.status.value, "verdict": run.headline.verdict}
            for run in results
        ]
        echo_json({"runs": about, "files": [str(path)]})
    elif not quiet:
        click.echo(f"wrote {path} ({path.stat().st_size / 1e6:.2g} MB)")
    return max(map(exit_code, results))
