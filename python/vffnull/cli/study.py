"""The commands ``study run``, ``study show`` and ``study tune``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

import vffnull._core as _core
from vffnull._support.errors import InputError
from vffnull.cli.common import FINE, INTERRUPTED, echo_json, interactive, say, telling
from vffnull.model.scenario import shown

if TYPE_CHECKING:
    from vffnull.studies import Tuned

__all__ = ["study"]


def _complete_study(_context: click.Context, _param: click.Parameter, begun: str) -> list[CompletionItem]:
    from vffnull.studies import studies

    names = [CompletionItem(name) for name in studies() if name.startswith(begun)]
    return [*names, CompletionItem(begun, type="file")]


def _where_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Options that say where the runs go, and who computes them."""
    for option in (
        click.option("--quiet", "-q", is_flag=True, help="Print nothing but warnings and errors."),
        click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead."),
        click.option(
            "--scheduler",
            metavar="ADDRESS",
            help="Let a Dask cluster compute: tcp://host:8786, for instance.",
        ),
        click.option("--workers", type=int, metavar="N", help="Start N worker processes on this machine."),
        click.option("--threads", type=int, metavar="K", help="As many as there are cores by default."),
        click.option("--resume", is_flag=True, help="Go on with what is there, and verify it."),
        click.option(
            "--out",
            metavar="DIR",
            help="A directory, or an address such as s3://bucket/study. Needed to run.",
        ),
        click.argument("document", metavar="STUDY", shell_complete=_complete_study),
    ):
        command = option(command)
    return command


@click.group()
def study() -> None:
    """Many runs as one document: designs, clusters, resuming, tuning.

    \b
    vffnull study list                                    what is bundled
    vffnull study show disturbances > mine.toml           a study to start from
    vffnull study run disturbances --dry-run              how many runs, how long, how large
    vffnull study run disturbances --out results          run it; --resume goes on
    vffnull study show results --page results.html        effects, indices, failures
    vffnull study tune gains --out tuned                  look for good values instead

    Needs the extra vffnull[study].
    """


@study.command("list")
def list_studies() -> None:
    """Name the bundled studies."""
    from vffnull.studies import Study, studies

    names = studies()
    width = max(map(len, names))
    for name in names:
        click.echo(f"{name:<{width}}  {Study.load(name).description}")


@study.command()
@_where_options
@click.option("--runs", type=int, metavar="N", help="At most so many: fewer points of the same design.")
@click.option("--dry-run", is_flag=True, help="Say what it takes, and run nothing.")
def run(
    document: str,
    out: str | None,
    resume: bool,
    threads: int | None,
    workers: int | None,
    scheduler: str | None,
    as_json: bool,
    quiet: bool,
    runs: int | None,
    dry_run: bool,
) -> int:
    """Run a study: a bundled name or the path of a TOML file.

    \b
    vffnull study run disturbances --out results
    vffnull study run disturbances --out few --runs 200
    vffnull study run disturbances --out results --resume
    vffnull study run mine.toml --out results --workers 4
    vffnull study run mine.toml --out s3://bucket/results --scheduler tcp://host:8786

    Whatever ends it, --resume goes on: what is whole is kept, what is damaged is made again.

    Exit codes: 0 success, 2 wrong input or a full disk, 130 interrupted.
    """
    from vffnull.studies import Study

    with telling():
        wanted = Study.load(document, runs)
    told = (lambda _: None) if quiet or as_json else click.echo
    if dry_run or not (quiet or as_json):
        estimate = wanted.estimate()
        if dry_run and as_json:
            echo_json({"study": wanted.name, **asdict(estimate)})
            return FINE
        click.echo(f"{click.style(wanted.name or document, bold=True)}: {wanted.description}".rstrip(": "))
        click.echo(str(estimate))
    if dry_run:
        return FINE
    target = _needed(out)
    try:
        dataset, _ = wanted._carried_out(
            target, resume, threads, workers, scheduler, interactive() and not quiet, told
        )
    except KeyboardInterrupt:
        _interrupted(target)
        return INTERRUPTED
    if as_json:
        echo_json(
            {"study": wanted.name, "place": dataset.place, "runs": wanted.runs, "status": dataset.counts()}
        )
    elif not quiet:
        counts = ", ".join(f"{count} {status}" for status, count in dataset.counts().items())
        click.echo(f"{wanted.runs} runs: {counts}")
        click.echo(f"next: vffnull study show {target} --page {Path(target).name}.html")
    return FINE


@study.command()
@_where_options
@click.option("--trials", type=int, metavar="N", help="Candidates in all; as the document says by default.")
def tune(
    document: str,
    out: str | None,
    resume: bool,
    threads: int | None,
    workers: int | None,
    scheduler: str | None,
    as_json: bool,
    quiet: bool,
    trials: int | None,
) -> int:
    """Look for good values of a study's factors by Optuna; the study needs a table [tune].

    \b
    vffnull study tune gains --out tuned --trials 40
    vffnull study tune gains --out tuned --trials 80 --resume

    The trials are runs like any others: `vffnull study show` shows them. Optuna's journal is tuning.log.

    Exit codes: 0 success, 2 wrong input or a full disk, 130 interrupted.
    """
    from vffnull.studies import Study

    target = _needed(out)
    with telling():
        wanted = Study.load(document)
    try:
        tuned = wanted.tune(
            target,
            trials=trials,
            resume=resume,
            threads=threads,
            workers=workers,
            scheduler=scheduler,
            progress=interactive() and not quiet,
        )
    except KeyboardInterrupt:
        _interrupted(target)
        return INTERRUPTED
    if as_json:
        echo_json(_tuned(tuned))
    elif not quiet:
        _print_tuned(tuned)
    return FINE


@study.command()
@click.argument("place", metavar="DIR|STUDY")
@click.option("--metric", "metrics", multiple=True, metavar="NAME", help="Only these; repeatable.")
@click.option("--page", type=click.Path(path_type=Path), metavar="FILE", help="Write everything as one page.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of tables.")
def show(place: str, metrics: tuple[str, ...], page: Path | None, as_json: bool) -> int:
    """Show what a study has left, also while it runs; or the document of a study.

    \b
    vffnull study show disturbances
    vffnull study show results
    vffnull study show results --metric min_clearance --page results.html

    Counts, and how much of the variance of each metric each factor explains; the page has pictures.
    """
    from vffnull.studies import Dataset, studies
    from vffnull.studies.study import text_of

    if not Path(place).is_dir() and (place in studies() or Path(place).suffix == ".toml"):
        text = text_of(place)
        if as_json:
            echo_json(_core.parse_toml(text, place))
        else:
            click.echo(text.rstrip())
        return FINE
    dataset = Dataset.open(place)
    found = dataset.findings(metrics or None)
    files = [dataset.report(page, metrics or None)] if page is not None else []
    if as_json:
        tuned = _tuned(dataset.tuned()) if dataset.manifest["tuned"] else {}
        echo_json({**found.to_dict(), **tuned, "files": [str(each) for each in files]})
        return FINE
    click.echo(str(found))
    if dataset.manifest["tuned"]:
        _print_tuned(dataset.tuned())
    for each in files:
        click.echo(f"wrote {each}")
    return FINE


def _needed(out: str | None) -> str:
    if not out:
        raise click.UsageError("--out: say where the runs go, as in --out results")
    if shown(out) != out:  # what reads them back knows text alone
        raise click.UsageError(f"--out: {shown(out)} is no text in UTF-8")
    return out


def _interrupted(target: str) -> None:
    say(f"interrupted: what is done is in {target}; the same command with --resume goes on", "yellow")


def _tuned(tuned: Tuned) -> dict[str, Any]:
    return {"trials": len(tuned.trials), "best": [asdict(trial) for trial in tuned.best]}


def _print_tuned(tuned: Tuned) -> None:
    goals = tuned.dataset.goals
    if not tuned.best:
        raise InputError(f"{tuned.dataset.place}: no trial has a value yet")
    click.echo(f"{len(tuned.trials)} trials; the best:")
    heads = ["trial", *goals, *tuned.dataset.factors]
    rows = [
        [
            str(trial.number),
            *(f"{value:.4g}" for value in trial.values or ()),
            *map(_short, trial.factors.values()),
        ]
        for trial in tuned.best
    ]
    widths = [max(len(row[i]) for row in [heads, *rows]) for i in range(len(heads))]
    for row in [heads, *rows]:
        click.echo("  ".join(f"{cell:>{width}}" for cell, width in zip(row, widths, strict=True)))


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
