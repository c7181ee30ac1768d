"""The commands ``arms``: bundled robot arms, and what a URDF or MJCF holds."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

import vffnull._core as _core
from vffnull._support.errors import InputError
from vffnull.cli.common import FINE, say
from vffnull.model.scenario import shown

if TYPE_CHECKING:
    from vffnull.arms import Report

__all__ = ["arms"]


@click.group(invoke_without_command=True)
@click.pass_context
def arms(context: click.Context) -> int | None:
    """Bundled robot arms, and what a URDF or MJCF holds.

    \b
    vffnull arms                                list the bundled arms
    vffnull arms show panda                     joints, limits, masses, and where the numbers come from
    vffnull arms check robot.urdf --tip tool0   what was read, what is odd, how tight the shapes are
    vffnull arms new robot.urdf > mine.toml     a scenario to start from
    """
    if context.invoked_subcommand is None:
        return int(context.invoke(list_arms))
    return None


@arms.command("list")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON list.")
def list_arms(as_json: bool = False) -> int:
    """List the bundled arms: joints, reach, payload, limits."""
    found = [(name, _core.arm_model(name)) for name in _core.ARMS]
    if as_json:
        rows = [
            {"name": name, "joints": len(arm["joints"]), "tip": arm["tip"]}
            | {key: arm[key] for key in ("reach", "payload")}
            | {key: _finite(arm[key]) for key in ("joint_limits", "velocity_limits", "torque_limits")}
            for name, arm in found
        ]
        click.echo(json.dumps(rows))
        return FINE
    click.echo("name    joints  reach    payload  moving mass  fastest    strongest  capsules  tip")
    for name, arm in found:
        mass = sum(joint["mass"] for joint in arm["joints"])
        speed, torque = max(arm["velocity_limits"]), max(arm["torque_limits"])
        click.echo(
            f"{name:7} {len(arm['joints']):<7} {arm['reach']:<5.3g} m  {arm['payload']:<4.3g} kg  "
            f"{mass:<8.3g} kg  {speed:<4.3g} rad/s {torque:<5.4g} N·m  "
            f"{len(arm['collision']):<9} {arm['tip']}"
        )
    return FINE


def _complete(_context: click.Context, _param: click.Parameter, begun: str) -> list[CompletionItem]:
    return [CompletionItem(name) for name in _core.ARMS if name.startswith(begun)]


@arms.command()
@click.argument("name", shell_complete=_complete)
@click.option("--toml", "as_toml", is_flag=True, help="Print the whole document, for a scenario of your own.")
@click.option("--json", "as_json", is_flag=True, help="Print the whole document as JSON.")
def show(name: str, as_toml: bool, as_json: bool) -> int:
    """Show a bundled arm: joints, limits, masses, and where the numbers come from."""
    from vffnull.arms import describe

    text = _core.arm_text(shown(name))
    if as_toml:
        click.echo(text.rstrip())
    elif as_json:
        click.echo(json.dumps(_finite(_core.arm_model(name)), ensure_ascii=False))
    else:
        head = [line[1:].strip() for line in text.splitlines() if line.startswith("#")]
        click.echo("\n".join(head))
        click.echo("")
        click.echo(describe(_core.arm_model(name)))
    return FINE


@dataclass(frozen=True)
class _Model:
    """A file with an arm, and what is asked of whoever reads it."""

    file: Path
    tip: str | None
    base: str | None
    locked: tuple[str, ...]
    collision: str
    srdf: Path | None
    packages: tuple[Path, ...]
    fix_inertia: bool
    pieces: tuple[str, ...]

    def read(self) -> Report:
        """What the file holds."""
        from vffnull import arms as models

        if not self.file.is_file():
            what = "is a directory" if self.file.is_dir() else "there is no such file"
            raise InputError(f"{self.file}: {what}")
        given = {**self._named, "srdf": self.srdf, "collision": self.collision, "pieces": self._most}
        if not self._is_mjcf:
            packages = list(self.packages) or None
            return models.read_urdf(self.file, packages=packages, fix_inertia=self.fix_inertia, **given)
        if self.packages:
            raise InputError(f"{self.file}: an MJCF says where its meshes are; --package is for a URDF")
        return models.read_mjcf(self.file, fix_inertia=self.fix_inertia, **given)

    def table(self) -> dict[str, Any]:
        """The ``[arm]`` of a scenario that reads the same."""
        table: dict[str, Any] = {"mjcf" if self._is_mjcf else "urdf": str(self.file)}
        table |= {key: value for key, value in self._named.items() if value}
        table |= {"srdf": str(self.srdf)} if self.srdf else {}
        table |= {"collision": self.collision} if self.collision != "fit" else {}
        table |= {"pieces": self._most} if self.pieces else {}
        table |= {"packages": [str(each) for each in self.packages]} if self.packages else {}
        return table | ({"fix_inertia": True} if self.fix_inertia else {})

    @property
    def _named(self) -> dict[str, Any]:
        locked = dict(_assignment("--lock", text, "finger=0.02") for text in self.locked)
        return {"tip": self.tip, "base": self.base, "locked": locked}

    @property
    def _most(self) -> int | dict[str, int]:
        """Hulls of a mesh: of each, or of those of some links."""
        if len(self.pieces) == 1 and self.pieces[0].isdecimal():
            return int(self.pieces[0])
        named = (_assignment("--pieces", text, "forearm_link=4") for text in self.pieces)
        return {link: _whole("--pieces", count) for link, count in named} or 1

    @property
    def _is_mjcf(self) -> bool:
        with self.file.open("rb") as opened:
            return b"<mujoco" in opened.read(4096)


def _reading(command: Callable[..., int]) -> Callable[..., int]:
    """The arguments of commands that read a model, which get it as `model`."""

    @wraps(command)
    def with_model(**given: Any) -> int:
        own = {each.name: given.pop(each.name) for each in fields(_Model)}
        return command(_Model(**own), **given)

    told: Callable[..., int] = with_model
    for option in reversed(_READING):
        told = option(told)
    return told


_READING = (
    click.argument("file", type=click.Path(path_type=Path)),
    click.option(
        "--tip", metavar="LINK", help="Where the arm ends; the only link without children by default."
    ),
    click.option("--base", metavar="LINK", help="Where it begins; the root by default."),
    click.option(
        "--lock",
        "locked",
        multiple=True,
        metavar="JOINT=VALUE",
        help="A joint that does not move; repeatable.",
    ),
    click.option(
        "--collision",
        type=click.Choice(["fit", "file", "none"]),
        default="fit",
        show_default=True,
        help="Few capsules around the links; boxes and hulls as in the file; or none.",
    ),
    click.option(
        "--srdf",
        type=click.Path(path_type=Path),
        metavar="FILE",
        help="Pairs of links that are not measured.",
    ),
    click.option(
        "--package",
        "packages",
        multiple=True,
        type=click.Path(path_type=Path),
        metavar="DIR",
        help="A folder in which meshes are searched; repeatable.",
    ),
    click.option("--fix-inertia", is_flag=True, help="Repair impossible inertia tensors."),
    click.option(
        "--pieces",
        multiple=True,
        metavar="[LINK=]COUNT",
        help="Hulls into which meshes may be cut, as in the file; repeatable.",
    ),
)


@arms.command()
@_reading
def new(model: _Model) -> int:
    """Print a scenario to start from: an arm of your own holds its tip while a ball passes its elbow.

    \b
    vffnull arms new robot.urdf --tip tool0 > mine.toml
    vffnull arms new robot.xml > mine.toml

    The arm starts bent and touching nothing, gains and ball follow its size; the file says what each is.
    """
    from vffnull.arms._new import scenario_text

    report = model.read()
    for message in report.warnings:
        say(f"warning: {message}", "yellow")
    click.echo(scenario_text(report, model.table()))
    return FINE


@arms.command()
@_reading
@click.option("--toml", "as_toml", is_flag=True, help="Print the explicit description for a scenario.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object: everything that was read.")
def check(model: _Model, as_toml: bool, as_json: bool) -> int:
    """Say what a URDF or MJCF (.xml) holds: what was read, what is odd, how tight the shapes are.

    \b
    vffnull arms check robot.urdf --tip tool0
    vffnull arms check robot.urdf --tip tool0 --collision file
    vffnull arms check robot.urdf --tip tool0 --lock finger=0.02 --package ~/ros/src
    """
    report = model.read()
    if as_json:
        click.echo(json.dumps(_finite(report.to_dict()), ensure_ascii=False))
    elif as_toml:
        for message in report.warnings:
            say(f"warning: {message}", "yellow")
        click.echo(_core.format_toml({"arm": report.document}).rstrip())
    else:
        click.echo(str(report))
    return FINE


def _assignment(option: str, text: str, example: str) -> tuple[str, float]:
    name, equals, value = text.rpartition("=")
    try:
        if name and equals:
            return name, float(value)
    except ValueError:
        pass
    raise click.UsageError(f"{option} {text}: expected NAME=NUMBER, as in {option} {example}")


def _whole(option: str, value: float) -> int:
    if not value.is_integer():
        raise click.UsageError(f"{option}: expected whole numbers, got {value:g}")
    return int(value)


def _finite(value: Any) -> Any:
    """JSON has no infinity: null."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _finite(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(each) for each in value]
    return value
