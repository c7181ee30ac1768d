"""What several commands share: arguments, runs with a progress bar, exit codes, messages."""

from __future__ import annotations

import errno
import json
import os
import re
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource
from click.shell_completion import CompletionItem

import vffnull._core as _core
from vffnull._support import progress as _progress
from vffnull._support.errors import ScenarioError, ScenarioWarning, VffNullError
from vffnull._support.figures import FIGURE_FORMATS, is_file
from vffnull._support.files import apart, writable
from vffnull.logs import READABLE
from vffnull.model.scenario import Scenario, prepare, scenarios, shown, source_of
from vffnull.run.result import Result, Status
from vffnull.run.simulate import PLANTS
from vffnull.run.simulate import run as run_scenario

FINE, WRONG_INPUT, FAILED, INTERRUPTED = 0, 2, 3, 130
ENDED_BY = 128  # and the signal's number
COLOURS = {"good": "green", "odd": "yellow", "bad": "red"}


def can_write(file: Path, *read: str | Path) -> None:
    """Refuse a file that cannot be written, or that is one to `read`, before anything is computed."""
    apart(file, *read)
    writable(file.parent)
    if file.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(file))


def has_folder(file: Path, *read: str | Path) -> None:
    """The same where its folder has to be there."""
    if not file.parent.is_dir():
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(file))
    can_write(file, *read)


def complete_scenario(_context: click.Context, _param: click.Parameter, begun: str) -> list[CompletionItem]:
    """Bundled names, and files."""
    names = [CompletionItem(name) for name in scenarios() if name.startswith(begun)]
    return [*names, CompletionItem(begun, type="file")]


def complete_key(context: click.Context, _param: click.Parameter, begun: str) -> list[CompletionItem]:
    """Keys of scenarios, those of the scenario at hand first."""
    from vffnull.model.keys import known, written

    if "=" in begun:
        return []
    there: list[str] = []
    given = [*context.params.values(), *context.args]
    for word in (each for each in given if isinstance(each, str)):
        with suppress(VffNullError, OSError):
            there = list(written(source_of(word)))
            break
    names = dict.fromkeys([*there, *known()])
    return [CompletionItem(f"{name}=") for name in names if name.startswith(begun)]


def place_of_figures(context: click.Context, _param: click.Parameter, text: str | None) -> Path | None:
    """Where ``--plot`` writes: a folder, or one file that says by its ending how it is written."""
    if text is None:
        return None
    if is_file(text) and context.get_parameter_source("figure_format") is ParameterSource.COMMANDLINE:
        wanted = context.params["figure_format"]
        if Path(text).suffix.lower() != f".{wanted}":
            raise click.UsageError(f"--format {wanted}: {text} is written as its ending says")
    return Path(text)


def format_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """The option ``--format`` of figures."""
    return click.option(
        "--format",
        "figure_format",
        type=click.Choice(FIGURE_FORMATS),
        default=FIGURE_FORMATS[0],
        show_default=True,
        is_eager=True,  # --plot asks for it
        help="Kind of file of --plot.",
    )(command)


def set_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """The option ``--set``."""
    return click.option(
        "--set",
        "assignments",
        multiple=True,
        metavar="KEY=VALUE",
        help="Change a key, by its dotted name; repeatable.",
        shell_complete=complete_key,
    )(command)


def assigned(assignments: tuple[str, ...]) -> dict[str, Any]:
    """The overrides that ``--set`` names."""
    return dict(_assignment(text) for text in assignments)


def _assignment(text: str) -> tuple[str, Any]:
    """Split KEY=VALUE; the value is TOML, and a bare word is a string."""
    if text != shown(text):
        raise click.UsageError(f"--set {shown(text)}: not text in the encoding of this terminal")
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


def prepared(source: str, assignments: tuple[str, ...]) -> Scenario:
    """The scenario with what ``--set`` changes; what is odd about a file of its arm goes to stderr.

    All of it is told once, by ``arms check``, ``arms new`` and ``validate``; here, where it would stand
    above the result of every run, no more than that there is something, where it is more than one thing.
    """
    with warned() as odd:
        ready = prepare(source, assigned(assignments))
    if len(odd) > 1:
        odd = [f"{len(odd)} things are odd about the arm: `vffnull validate {source}` lists them"]
    for message in odd:
        say(f"warning: {message}", "yellow")
    return ready


@contextmanager
def warned() -> Iterator[list[str]]:
    """What Python would print as warnings of its own, as sentences."""
    messages: list[str] = []
    with warnings.catch_warnings(record=True) as odd:
        warnings.simplefilter("always", ScenarioWarning)
        try:
            yield messages
        finally:
            messages += [str(each.message) for each in odd]


@contextmanager
def telling() -> Iterator[None]:
    """The same, each of them told once, on stderr."""
    with warned() as odd:
        yield
    for message in dict.fromkeys(odd):
        say(f"warning: {message}", "yellow")


def run_with_bar(ready: Scenario, quiet: bool, plant: str = PLANTS[0]) -> Result:
    """Run, with a progress bar on a terminal once it takes longer than a second; warnings go to stderr."""
    if quiet or not interactive():
        result = run_scenario(ready, plant=plant)
    else:
        with _progress.bar(ready.duration, delay=1.0) as report:
            result = run_scenario(ready, report, plant)
    for message in result.warnings:
        say(f"warning: {message}", "yellow")
    return result


def run_or_load(source: str, assignments: tuple[str, ...], quiet: bool) -> Result:
    """The result in a file, or the result of running a scenario, to be shown.

    Raises
    ------
    KeyboardInterrupt
        If the run was interrupted: nobody waits for a page of half a run, nor gives an earlier one for it.
    """
    if Path(source).suffix not in READABLE:
        result = run_with_bar(prepared(source, assignments), quiet)
        if result.status is Status.INTERRUPTED:
            raise KeyboardInterrupt
        return result
    if assignments:
        raise click.UsageError(f"--set changes a scenario before it runs; {source} is the result of a run")
    return Result.load(source)


def exit_code(result: Result, strict: bool = False) -> int:
    """What the shell is told about a run."""
    if result.status is Status.INTERRUPTED:
        return INTERRUPTED
    failed = result.status in (Status.DIVERGED, Status.FAILED)
    return FAILED if failed or (strict and result.headline.severity != "good") else FINE


def interactive() -> bool:
    """Whether somebody sees what goes to stderr."""
    return sys.stderr.isatty()


def echo_json(value: object) -> None:
    """Print JSON; characters are escaped where the output cannot hold all of them."""
    encoding = (sys.stdout.encoding or "ascii").lower().replace("_", "-")
    click.echo(json.dumps(value, ensure_ascii=encoding not in ("utf-8", "utf8")))


def say(text: str, colour: str) -> None:
    """Write to stderr, the first word in colour on a terminal."""
    head, separator, rest = text.partition(": ")
    click.echo(f"{click.style(head, fg=colour)}{separator}{rest}", err=True)
