"""The command ``realtime``."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.core import ParameterSource

import vffnull._core as _core
from vffnull._support import progress as _progress
from vffnull._support.errors import InputError
from vffnull._support.figures import checked_file
from vffnull.cli.common import (
    FAILED,
    FINE,
    INTERRUPTED,
    can_write,
    complete_scenario,
    echo_json,
    interactive,
    prepared,
    say,
    set_option,
)
from vffnull.run.realtime import RealTimeReport, measure
from vffnull.run.result import Status

if TYPE_CHECKING:
    from vffnull.model.scenario import Scenario
    from vffnull.run.emulate import Emulation

__all__ = ["realtime"]

_ROBOTS = ("emulated-franka", "emulated-ur")  # of `vffnull.robots.emulated`, imported when it is used
_OF_THE_CLOCK = ("rate", "priority", "core", "plot_to", "strict")


@click.command()
@click.argument("scenario", shell_complete=complete_scenario)
@click.option(
    "--rate", type=float, default=1000.0, show_default=True, help="Control periods per second [Hz]."
)
@click.option("--seconds", type=float, default=60.0, show_default=True, help="How long [s].")
@click.option("--priority", type=int, metavar="N", help="Run under SCHED_FIFO with this priority, 1 to 99.")
@click.option("--core", type=int, metavar="K", help="Stay on this core.")
@set_option
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of a table.")
@click.option(
    "--plot",
    "plot_to",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Write the histograms, by the ending: .png, .pdf, .svg.",
)
@click.option("--strict", is_flag=True, help="Exit with 3 also if a deadline was missed.")
@click.option("--robot", type=click.Choice(_ROBOTS), help="Drive an emulated robot, on its own time.")
@click.option("--disturbed", is_flag=True, help="With noise, delay, losses, friction, an unknown kilogram.")
@click.pass_context
def realtime(
    context: click.Context,
    scenario: str,
    rate: float,
    seconds: float,
    priority: int | None,
    core: int | None,
    assignments: tuple[str, ...],
    as_json: bool,
    plot_to: Path | None,
    strict: bool,
    robot: str | None,
    disturbed: bool,
) -> int:
    """Run the closed loop against the wall clock, and say what rate this machine can hold.

    \b
    vffnull realtime sweep-through --rate 1000 --seconds 60
    vffnull realtime paper-1 --rate 4000 --priority 80 --core 1 --plot timing.png
    vffnull realtime panda-sweep --robot emulated-franka --disturbed

    Plant and law run together once per period, at absolute deadlines; a scenario that is over begins
    again. Systems grant --priority to few.

    With --robot the scenario is driven once, as on a robot whose interface has its maker's rules, and
    faster than real time: what would have stopped the robot, and how near each limit came.

    Exit codes: 0 success, 2 wrong input, 3 the run diverged (or missed a deadline, under --strict; or the
    robot has stopped by itself), 130 interrupted.
    """
    ready = prepared(scenario, assignments)
    if robot is not None:
        given = [name for name in _OF_THE_CLOCK if _is_given(context, name)]
        if given:
            name = next(p.opts[0] for p in context.command.params if p.name == given[0])
            raise InputError(f"{name}: is about the clock of this machine, --robot has its own time")
        return _emulated(ready, robot, disturbed, seconds if _is_given(context, "seconds") else None, as_json)
    if disturbed:
        raise InputError("--disturbed: needs --robot")
    if plot_to is not None:  # find out before the run, not after it
        checked_file(plot_to)
        can_write(plot_to, scenario)
    bar = interactive() and not as_json
    report = measure(ready, rate, seconds, priority, core, progress=bar)
    for note in report.notes:
        say(f"warning: {note}", "yellow")
    drawn = None
    try:
        if plot_to is not None:
            plot_to.parent.mkdir(parents=True, exist_ok=True)
            report.plot(plot_to)
            drawn = plot_to
    finally:  # a disk that is full takes nothing of what was measured
        if as_json:
            echo_json(report.to_dict() | {"version": _core.__version__})
        else:
            _print_timing(report, drawn)
    if report.status is Status.INTERRUPTED:
        return INTERRUPTED
    failed = report.status is Status.DIVERGED or (strict and not report.held)
    return FAILED if failed else FINE


def _is_given(context: click.Context, name: str) -> bool:
    return context.get_parameter_source(name) is ParameterSource.COMMANDLINE


def _emulated(ready: Scenario, robot: str, disturbed: bool, seconds: float | None, as_json: bool) -> int:
    """Drive an emulated robot, and say what would have stopped it."""
    from vffnull.robots.emulated import usual
    from vffnull.run.emulate import emulate

    disturbances = usual(robot) if disturbed else None
    shown = _progress.bar(ready.duration) if interactive() and not as_json else nullcontext()
    with shown as progress:
        outcome = emulate(ready, robot, disturbances, seconds=seconds, progress=progress)
    if as_json:
        echo_json(outcome.to_dict() | {"version": _core.__version__})
    else:
        _print_emulation(outcome)
    if outcome.report.status == "interrupted":
        return INTERRUPTED
    return FINE if outcome.fine else FAILED


def _print_emulation(outcome: Emulation) -> None:
    click.echo(click.style(outcome.scenario, bold=True), nl=False)
    click.echo(
        f" on {outcome.robot}: {outcome.cycles} cycles at {outcome.rate:g} Hz, in {outcome.seconds:.1f} s, "
        f"{outcome.report.status}"
    )
    if outcome.reflex is not None:
        click.echo(click.style(f"stopped by the robot: {outcome.reflex}", fg="red"))
    elif outcome.report.reason:
        click.echo(click.style(f"ended by the drive: {outcome.report.reason}", fg="red"))
    else:
        click.echo(click.style("nothing would have stopped the robot", fg="green"))
    click.echo(f"\n{outcome}\n")
    if outcome.clearance is not None:
        click.echo(f"nearest obstacle: {1e3 * outcome.clearance:.0f} mm")
    for note in outcome.report.notes:
        click.echo(f"note: {note.splitlines()[0]}")


def _print_timing(report: RealTimeReport, plot: Path | None) -> None:
    click.echo(click.style(report.scenario.name or "scenario", bold=True), nl=False)
    click.echo(f": {report.periods} periods at {report.rate:g} Hz, {report.status}\n")
    click.echo(report)
    if plot is not None:
        click.echo(f"\nwrote {plot}")
