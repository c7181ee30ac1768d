"""The command ``evaluate``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

from vffnull._support.files import writable
from vffnull.cli.common import FINE, echo_json, format_option, has_folder, interactive

if TYPE_CHECKING:
    from vffnull.evaluation.table import Rate
    from vffnull.run.evaluate import Evaluation

__all__ = ["evaluate"]


def _complete_controller(
    _context: click.Context, _param: click.Parameter, begun: str
) -> list[CompletionItem]:
    from vffnull.evaluation.controllers import CONTROLLERS

    return [CompletionItem(name) for name in CONTROLLERS if name.startswith(begun)]


def _complete_category(_: click.Context, _param: click.Parameter, begun: str) -> list[CompletionItem]:
    from vffnull.evaluation.scenes import CATEGORIES, FAMILIES

    names = [*map(str, CATEGORIES), *FAMILIES]
    return [CompletionItem(name) for name in names if name.startswith(begun)]


def _complete_arm(_: click.Context, _param: click.Parameter, begun: str) -> list[CompletionItem]:
    from vffnull.evaluation.scenes import ARMS

    return [CompletionItem(name) for name in ARMS if name.startswith(begun)]


def _complete_task(_: click.Context, _param: click.Parameter, begun: str) -> list[CompletionItem]:
    from vffnull.evaluation.scenes import TASKS

    return [CompletionItem(name) for name in TASKS if name.startswith(begun)]


@click.command()
@click.option(
    "--controller",
    "controllers",
    multiple=True,
    metavar="NAME",
    help="A controller, as in the table; repeatable. All by default.",
    shell_complete=_complete_controller,
)
@click.option(
    "--category",
    "categories",
    multiple=True,
    metavar="C",
    help="1, 2 or a family; repeatable. Both categories by default.",
    shell_complete=_complete_category,
)
@click.option(
    "-n",
    "--joints",
    "joints",
    multiple=True,
    type=int,
    metavar="N",
    help="Number of joints in the plane; repeatable. 4, 6 and 9 by default.",
)
@click.option("--space", is_flag=True, help="Scenes in space instead of the plane.")
@click.option(
    "--arm",
    "arms",
    multiple=True,
    metavar="NAME",
    help="An arm in space; repeatable. panda, iiwa14 and ur5e by default.",
    shell_complete=_complete_arm,
)
@click.option(
    "--task",
    "tasks",
    multiple=True,
    metavar="TASK",
    help="position, pointing or pose in space; repeatable. position and pose by default.",
    shell_complete=_complete_task,
)
@click.option(
    "--count",
    type=int,
    default=100,
    show_default=True,
    help="Scenes for each category and number of joints; in space for each family, arm and task.",
)
@click.option("--seed", type=int, default=1_000_000, show_default=True, help="Seed of the first scene.")
@click.option("--threads", type=int, metavar="K", help="As many as there are cores by default.")
@click.option(
    "--save",
    "save_to",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Write the rows, .csv or .parquet.",
)
@click.option("--plot", "plot_to", type=click.Path(path_type=Path), metavar="DIR", help="Write the figures.")
@format_option
@click.option("--times", is_flag=True, help="Time their steps, too; in crowds without --category.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object: counts and rates.")
def evaluate(
    controllers: tuple[str, ...],
    categories: tuple[str, ...],
    joints: tuple[int, ...],
    space: bool,
    arms: tuple[str, ...],
    tasks: tuple[str, ...],
    count: int,
    seed: int,
    threads: int | None,
    save_to: Path | None,
    plot_to: Path | None,
    figure_format: str,
    times: bool,
    as_json: bool,
) -> int:
    """Run controllers on random scenes, and print rates and errors as Markdown.

    \b
    vffnull evaluate --count 20
    vffnull evaluate --category crowd -n 6 --count 200 --save crowd.csv --plot figures/
    vffnull evaluate --controller cbf --controller "null-space field" --category 1
    vffnull evaluate --space --arm panda --task pose --count 20

    Seeds below 1000000 are for tuning, the others for evaluation. Needs the extra vffnull[evaluate].

    Exit codes: 0 success, 2 wrong input, 130 interrupted.
    """
    from vffnull import evaluation
    from vffnull.evaluation import scenes
    from vffnull.run import evaluate as evaluating

    if not space and (arms or tasks):
        raise click.UsageError("--arm and --task are of scenes in space: add --space")
    if space and joints:
        raise click.UsageError("--joints is of scenes in the plane: --space takes --arm")
    of_arms, of_tasks = arms or scenes.EVALUATED, tasks or ("position", "pose")
    if save_to is not None:  # find out before the runs, not after them
        evaluating.check_path(save_to)
        has_folder(save_to)
    if plot_to is not None:
        writable(plot_to)
    evaluation.wilson(0, 1)
    kinds = [int(each) if each.isdigit() else each for each in categories]
    outcome = evaluating.evaluate(
        controllers or None,
        kinds or (1, 2),
        joints or (4, 6, 9),
        count,
        seed,
        threads,
        progress=interactive(),
        space=space,
        arm=of_arms,
        task=of_tasks,
    )
    if as_json:
        echo_json(_rates(outcome))
    else:
        click.echo(outcome.table())
    if times:
        table = evaluating.loop_times(
            controllers or None,
            kinds or "crowd",
            n=joints or (4, 6, 9),
            seed=seed,
            space=space,
            arm=of_arms,
            task=of_tasks,
        )
        click.echo("\n" + table, err=as_json)
    files = [outcome.save(save_to)] if save_to is not None else []
    files += outcome.plot(plot_to, figure_format) if plot_to is not None else []
    for file in files:
        click.echo(f"wrote {file}", err=True)
    return FINE


def _rates(outcome: Evaluation) -> dict[str, Any]:
    """Counts of every family and controller, with the interval of the rate; null where there is no scene."""

    def told(rate: Rate) -> dict[str, Any]:
        interval = [rate.low, rate.high] if rate.total else None
        return {"count": rate.count, "total": rate.total, "interval": interval}

    def rates(family: str, name: str) -> dict[str, Any]:
        rows = outcome.where(family=family, controller=name)
        return {what: told(rate) for what, rate in rows.rates().items()}

    return {
        family: {name: rates(family, name) for name in outcome.controllers} for family in outcome.families
    }
