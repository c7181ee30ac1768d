"""The command ``plan``."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import vffnull._core as _core
from vffnull.cli.common import (
    FAILED,
    FINE,
    complete_scenario,
    echo_json,
    has_folder,
    prepared,
    set_option,
)
from vffnull.model.outcome import aligned, readable

if TYPE_CHECKING:
    from vffnull.planning import Plan

__all__ = ["plan"]


def _lists(
    _context: click.Context, param: click.Parameter, texts: tuple[str, ...]
) -> tuple[list[float], ...]:
    """Numbers between commas, as often as they are given."""
    found = []
    for text in texts:
        try:
            found.append([float(each) for each in text.strip("[] ").split(",")])
        except ValueError:
            raise click.BadParameter(f"expected numbers between commas, not {text!r}", param=param) from None
    return tuple(found)


def _each(_context: click.Context, param: click.Parameter, text: str | None) -> float | list[float] | None:
    """A number, or several between commas."""
    if text is None:
        return None
    numbers = _lists(_context, param, (text,))[0]
    return numbers if len(numbers) > 1 else numbers[0]


def _numbers(name: str, metavar: str, text: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """An option that is a number, or several between commas."""
    return click.option(name, callback=_each, metavar=metavar, help=text)


def _seconds(_context: click.Context, param: click.Parameter, text: str) -> float | None:
    """A time [s], or none."""
    if text == "none":
        return None
    try:
        return float(text)
    except ValueError:
        raise click.BadParameter(f"expected seconds or none, not {text!r}", param=param) from None


@click.command()
@click.argument("scenario", shell_complete=complete_scenario)
@click.option(
    "--goal",
    callback=_lists,
    multiple=True,
    metavar="A,B,…",
    help="A configuration, or a position [m]; by default where the reference ends. More than one: one after "
    "the other.",
)
@click.option(
    "--orientation",
    callback=_lists,
    multiple=True,
    metavar="W,X,Y,Z",
    help="With a position: the quaternion there; in the plane an angle [rad]. As many as goals, or none.",
)
@click.option(
    "--pause", type=float, default=0.5, show_default=True, help="Rest at every goal but the last [s]."
)
@click.option("--margin", type=float, default=0.02, show_default=True, help="Kept from obstacles [m].")
@click.option("--speed", type=float, default=0.5, show_default=True, help="Share of the joints' limits.")
@click.option(
    "--horizon",
    callback=_seconds,
    default="1.0",
    show_default=True,
    metavar="SECONDS",
    help="Keep places free that are passed so soon [s]; 0: nothing moves; none: leave out what does then.",
)
@click.option(
    "--tilt",
    type=float,
    metavar="ANGLE",
    help="How far the end effector may lean [rad]; by default that does not matter.",
)
@_numbers(
    "--view", "X,Y[,Z]", "A point that the end effector keeps in view [m]; by default it looks anywhere."
)
@click.option(
    "--view-angle",
    default=0.35,
    show_default=True,
    metavar="ANGLE",
    help="How far off its axis that point may be [rad].",
)
@_numbers(
    "--approach",
    "LENGTH|X,Y,Z",
    "Come straight to each goal, so far along the tool's axis, or along a vector [m].",
)
@_numbers(
    "--retreat", "LENGTH|X,Y,Z", "Leave straight, so far back along the tool's axis, or along a vector [m]."
)
@_numbers(
    "--acceleration",
    "A[,B,…]",
    "The limit of all joints, or of each [rad/s²]; by default 30 in the plane, 10 in space.",
)
@_numbers("--jerk", "A[,B,…]", "The limit of all joints, or of each [rad/s³]; by default none.")
@click.option("--samples", type=int, default=100_000, show_default=True, help="When to give up.")
@click.option("--paths", type=int, default=4, show_default=True, help="Of so many the shortest is taken.")
@click.option("--seed", type=int, default=0, show_default=True, help="Of the random numbers.")
@set_option
@click.option("--out", type=click.Path(path_type=Path), metavar="FILE", help="Write the plan, as .npz.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of a table.")
def plan(
    scenario: str,
    goal: tuple[list[float], ...],
    orientation: tuple[list[float], ...],
    pause: float,
    margin: float,
    speed: float,
    horizon: float | None,
    tilt: float | None,
    view: float | list[float] | None,
    view_angle: float,
    approach: float | list[float] | None,
    retreat: float | list[float] | None,
    acceleration: float | list[float] | None,
    jerk: float | list[float] | None,
    samples: int,
    paths: int,
    seed: int,
    assignments: tuple[str, ...],
    out: Path | None,
    as_json: bool,
) -> int:
    """Plan a motion of all joints to a goal, around what is in the way.

    \b
    vffnull plan narrow-gap
    vffnull plan panda-shelf --horizon 0 --margin 0.03
    vffnull plan panda-shelf --goal 0.5,0.2,0.4 --out plan.npz
    vffnull plan panda-shelf --goal 0.5,0.2,0.4 --goal 0.4,-0.2,0.4 --pause 1

    Exit codes: 0 found, 2 wrong input, 3 nothing found, 130 interrupted.
    """
    from vffnull.planning import plan as find
    from vffnull.planning.motion import checked_path

    if orientation and len(orientation) != len(goal):
        raise click.UsageError("--orientation belongs to a position: as many as there are of --goal X,Y,Z")
    if out is not None:
        checked_path(out)
        has_folder(out, scenario)
    ready = prepared(scenario, assignments)
    goals: list[Any] = list(goal)
    if orientation:
        goals = [{"position": p, "orientation": q} for p, q in zip(goal, orientation, strict=True)]
    given = goals if len(goals) > 1 else next(iter(goals), None)
    found = find(
        ready,
        given,
        pause=pause,
        margin=margin,
        horizon=horizon,
        tilt=tilt,
        view=view,
        view_angle=view_angle,
        approach=approach,
        retreat=retreat,
        acceleration=acceleration,
        jerk=jerk,
        speed=speed,
        samples=samples,
        paths=paths,
        seed=seed,
    )
    if out is not None:
        found.save(out)
    if as_json:
        echo_json(_summary(found) | {"version": _core.__version__})
    else:
        click.echo(click.style(ready.name or "scenario", bold=True), nl=False)
        click.echo(f": {found.status}\n{found.message}\n")
        click.echo(_table(found))
        if out is not None:
            click.echo(f"\nwrote {out}")
    return FINE if found.status == "found" else FAILED


_MEANINGS = {
    "duration": ("s", "how long the motion takes"),
    "clearance": ("m", "smallest distance from obstacles"),
    "margin": ("m", "what the path keeps where it keeps least, four fifths of it for certain"),
    "tilt": ("rad", "how far the end effector leans at most"),
    "view": ("rad", "how far off its axis it has the point in view at most"),
    "begins": ("s", "when it has to begin, if what moves is let pass"),
    "gap": ("rad", "what was left to the goal"),
    "samples": ("", "random configurations that were tried"),
    "nodes": ("", "how many of them the search kept"),
    "wall_time": ("s", "how long planning took"),
}
"""Unit and meaning of what is told of a plan."""


def _table(found: Plan) -> str:
    """What is told of a plan, with units."""
    units = {"gap": "m"} if found.status == "goal out of reach" else {}
    summary = _summary(found)
    rows = [
        (name, readable(summary[name]), units.get(name, unit), meaning)  # type: ignore[arg-type]
        for name, (unit, meaning) in _MEANINGS.items()
    ]
    return "\n".join(aligned(rows))


def _summary(found: Plan) -> dict[str, str | float | int | None]:
    def finite(value: float | None, digits: int) -> float | None:
        return round(value, digits) if value is not None and math.isfinite(value) else None

    return {
        "status": str(found.status),
        "message": found.message,
        "duration": finite(found.duration, 3),
        "clearance": finite(found.clearance, 4),
        "margin": finite(found.margin, 4),
        "tilt": finite(found.tilt, 4),
        "view": finite(found.view, 4),
        "begins": finite(found.begins, 4),
        "gap": finite(found.gap, 4),
        "samples": found.samples,
        "nodes": found.nodes,
        "wall_time": finite(found.wall_time, 4),
    }
