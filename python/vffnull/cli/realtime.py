"""The command ``realtime``."""

from __future__ import annotations

from pathlib import Path

import click

from vffnull import _core
from vffnull._figures import FIGURE_ENDINGS
from vffnull._realtime import RealTimeReport, measure
from vffnull.cli.common import (
    FAILED,
    FINE,
    INTERRUPTED,
    complete_scenario,
    echo_json,
    interactive,
    prepared,
    say,
    set_option,
)
from vffnull.errors import InputError
from vffnull.result import Status

__all__ = ["realtime"]


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
    ready = prepared(scenario, assignments)
    if plot_to is not None and plot_to.suffix not in FIGURE_ENDINGS:  # find out before the run, not after it
        raise InputError(f"--plot {plot_to}: a figure is written as {', '.join(FIGURE_ENDINGS)}")
    bar = interactive() and not as_json
    report = measure(ready, rate, seconds, priority, core, progress=bar)
    for note in report.notes:
        say(f"warning: {note}", "yellow")
    if plot_to is not None:
        plot_to.parent.mkdir(parents=True, exist_ok=True)
        report.plot(plot_to)
    if as_json:
        echo_json(report.to_dict() | {"version": _core.__version__})
    else:
        _print_timing(report, plot_to)
    if report.status is Status.INTERRUPTED:
        return INTERRUPTED
    failed = report.status is Status.DIVERGED or (strict and not report.held)
    return FAILED if failed else FINE


def _print_timing(report: RealTimeReport, plot: Path | None) -> None:
    click.echo(click.style(report.scenario.name or "scenario", bold=True), nl=False)
    click.echo(f": {report.periods} periods at {report.rate:g} Hz, {report.status}\n")
    click.echo(report)
    if plot is not None:
        click.echo(f"\nwrote {plot}")
