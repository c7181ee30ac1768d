"""The command ``perceive``: recordings of depth cameras."""

from __future__ import annotations

import difflib
import math
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

import vffnull._core as _core
from vffnull._support.errors import InputError
from vffnull._support.progress import bar
from vffnull.cli.common import FAILED, FINE, assigned, can_write, echo_json, interactive, say, telling

if TYPE_CHECKING:
    from vffnull.run.calibrate import CameraCalibration
    from vffnull.run.perceive import PerceptionReport

__all__ = ["perceive"]


def _complete(_context: click.Context, _param: click.Parameter, begun: str) -> list[CompletionItem]:
    names = [CompletionItem(name) for name in _core.ARMS if name.startswith(begun)]
    return [*names, CompletionItem(begun, type="file")]


def _names(_context: click.Context, _param: click.Parameter, text: str | None) -> list[str]:
    return [each.strip() for each in text.split(",")] if text else []


@click.command()
@click.argument("recording", type=click.Path(path_type=Path))
@click.option(
    "--arm",
    "arm_name",
    required=True,
    metavar="NAME|FILE",
    shell_complete=_complete,
    help="A bundled arm, a URDF or MJCF, or a scenario that has it.",
)
@click.option("--tip", metavar="LINK", help="Where the arm of a URDF or MJCF ends.")
@click.option("--calibrate", is_flag=True, help="Tell by how much each camera and its clock are off.")
@click.option(
    "--cameras",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help='TOML: a table ["TOPIC"] of what the recording does not say of a camera.',
)
@click.option(
    "--topic", "topics", multiple=True, metavar="TOPIC", help="Pictures of this camera alone; repeatable."
)
@click.option(
    "--base", metavar="FRAME", help="The frame at the base of the arm, if it is not called as in the model."
)
@click.option(
    "--joints", callback=_names, metavar="A,B,…", help="What the recording calls the joints, from the base."
)
@click.option("--known", metavar="SCENARIO", help="The obstacles of this scenario are not to be seen again.")
@click.option(
    "--set",
    "assignments",
    multiple=True,
    metavar="KEY=VALUE",
    help="A setting of the perceiver, such as voxel=0.03; repeatable.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Write points and tracks, as .mcap or .rrd; with --calibrate the corrected cameras, as .toml.",
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of a table.")
def perceive(
    recording: Path,
    arm_name: str,
    tip: str | None,
    calibrate: bool,
    cameras: Path | None,
    topics: tuple[str, ...],
    base: str | None,
    joints: list[str],
    known: str | None,
    assignments: tuple[str, ...],
    out: Path | None,
    as_json: bool,
) -> int:
    """Replay a recording of depth cameras and joints: what is seen of the arm, what is left, what moves.

    RECORDING is an MCAP file of ROS 2, with depths or clouds, CameraInfo, JointState and transforms.

    \b
    vffnull perceive cell.mcap --arm panda
    vffnull perceive cell.mcap --arm robot.urdf --set margin=0.03 --out seen.rrd
    vffnull perceive cell.mcap --arm panda --calibrate --out cameras.toml
    vffnull perceive cell.mcap --arm panda --cameras cameras.toml

    Exit codes: 0 success, 2 wrong input, 3 pictures were refused or a camera has moved, 130 interrupted.
    """
    from vffnull.run import calibrate as calibration
    from vffnull.run import perceive as replay
    from vffnull.run.recording import read_cameras

    if out is not None:
        can_write(out, recording, arm_name, *(each for each in (cameras, known) if each is not None))
    with telling():
        arm, around = _arm(arm_name, tip), _obstacles(known)
    given = None if cameras is None else read_cameras(cameras)
    where: dict[str, Any] = {"cameras": given, "topics": topics, "base": base, "joints": joints}
    if calibrate:
        if assignments or known is not None:
            raise click.UsageError("--set and --known belong to a replay, not to --calibrate")
        if out is not None and out.suffix != ".toml":
            raise click.UsageError(f"--out {out}: corrected cameras are written as .toml")
        found = calibration.calibrate(recording, arm, **where)
        if out is not None:
            out.write_text(_cameras_file(found), encoding="utf-8")
        if as_json:
            echo_json({"cameras": [each.to_dict() for each in found], "version": _core.__version__})
        else:
            click.echo("\n\n".join(map(_calibrated, found)) + (f"\n\nwrote {out}" if out else ""))
        return FINE
    given_settings = assigned(assignments)
    with bar(1.0, delay=1.0, counts=".0% replayed") if interactive() else nullcontext() as shown:
        report = replay.perceive(
            recording, arm, settings=given_settings, known=around, out=out, progress=shown, **where
        )
    if as_json:
        echo_json(report.to_dict() | {"version": _core.__version__})
    else:
        _tell(report)
    others = sum(each.measured - each.own for each in report.cameras)
    if others and not report.points[1] and known is None:
        say(
            f"warning: {others} pixels are not the arm's, and no point is left of them: they are out of the "
            "room, or farther apart than cells are wide (room, voxel, stride, least_points)",
            "yellow",
        )
    for each in report.cameras:
        if each.pictures and not each.measured:
            say(
                f"warning: {each.topic}: no picture has a depth within the range: floats are metres, uint16 "
                "millimetres, and what has another unit is too far away (range); or nothing was measured",
                "yellow",
            )
    moved = [each for each in report.cameras if each.moved or each.turned]
    for each in moved:
        say(
            f"warning: {each.topic}: the camera moves in the recording, a perceiver takes it to stand still",
            "yellow",
        )
    return FAILED if report.refused or moved else FINE


def _arm(name: str, tip: str | None) -> _core.Arm:
    if name not in _core.ARMS and Path(name).suffix == ".urdf":
        return _core.Arm.from_urdf(name, tip=tip)
    if name not in _core.ARMS and Path(name).suffix in (".xml", ".mjcf"):
        return _core.Arm.from_mjcf(name, tip=tip)
    if tip is not None:
        raise click.UsageError(f"--tip belongs to the file of an arm; {name} says where its arm ends")
    if name in _core.ARMS:
        return _core.Arm.named(name)
    from vffnull.model.scenario import prepare, scenarios

    if name not in scenarios() and not Path(name).suffix:
        near = difflib.get_close_matches(name, _core.ARMS, n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"there are {', '.join(_core.ARMS)}"
        raise InputError(f"--arm: no bundled arm or scenario {name!r}, {hint}")
    return prepare(name).arm


def _obstacles(scenario: str | None) -> list[dict[str, Any]]:
    if scenario is None:
        return []
    from vffnull.model.scenario import prepare

    found: list[dict[str, Any]] = prepare(scenario).to_dict().get("obstacles", [])
    return found


def _tell(report: PerceptionReport) -> None:
    late = f", {report.late_states} late and left out" if report.late_states else ""
    click.echo(f"{report.duration:.1f} s, {report.states} states of the arm{late}")
    for reason, count in report.unusable_states.items():
        click.echo(click.style(f"left out: {count} of {reason}", fg="yellow"))
    click.echo(f"{report.points[0]} points left, {report.points[1]} at most\n")
    for each in report.cameras:
        click.echo(click.style(each.topic, bold=True))
        rate = f"{1.0 / each.period:.3g} per second" if each.period else "one alone"
        click.echo(f"  pictures     {each.pictures}, {rate}, {_gaps(each.gaps, each.longest)}")
        for reason, count in each.refused.items():
            click.echo(click.style(f"  refused      {count}: {reason}", fg="yellow"))
        share = f", {100 * each.own / each.measured:.1f} % the arm's" if each.measured else ""
        click.echo(f"  pixels       {each.measured} with a depth{share}")
        links = ", ".join(f"{name} {100 * part:.0f} %" for name, part in each.own_by_link.items())
        if links:
            click.echo(f"  of the arm   {links}")
        if each.left_out:
            click.echo(
                click.style(
                    f"  no room for  {each.left_out} pixels: raise most_voxels or say what is known",
                    fg="yellow",
                )
            )
        click.echo(f"  arrived      {_milliseconds(each.delay)} after it was taken")
        click.echo(f"  cost         {_milliseconds(each.cost)} a picture")
    moving = sorted(report.tracks, key=lambda track: track.since)
    if moving:
        click.echo("\nwhat moved    from     to      at most    last at")
        for track in moving:
            place = ", ".join(f"{x:.2f}" for x in track.position)
            click.echo(
                f"  {track.number:<10}  {track.since:5.1f} s  {track.until:5.1f} s  "
                f"{track.fastest:5.2f} m/s  ({place}) m"
            )
    for file in report.files:
        click.echo(f"\nwrote {file}")


def _gaps(count: int, longest: float) -> str:
    return f"{count} gaps, {1000 * longest:.0f} ms at most" if count else "no gap"


def _milliseconds(pair: tuple[float, float]) -> str:
    return f"{1000 * pair[0]:.3g} ms (p99 {1000 * pair[1]:.3g} ms)"


def _calibrated(found: CameraCalibration) -> str:
    move = math.hypot(*found.translation)
    turn = math.degrees(math.hypot(*found.rotation))
    axes = ", ".join(f"{1000 * x:+.1f}" for x in found.translation)
    angles = ", ".join(f"{math.degrees(x):+.2f}" for x in found.rotation)
    lines = [
        click.style(found.topic, bold=True),
        f"  translation  {1000 * move:.1f} ± {1000 * found.translation_deviation:.2f} mm   ({axes})",
        f"  rotation     {turn:.2f} ± {math.degrees(found.rotation_deviation):.3f}°   ({angles})",
    ]
    if found.time_offset is None or found.time_deviation is None:
        lines.append("  clock        the arm hardly moves, so that it does not tell")
    else:
        lines.append(
            f"  clock        {1000 * found.time_offset:+.1f} ± {1000 * found.time_deviation:.2f} ms "
            "to be added to the times of its pictures"
        )
    lines.append(
        f"  surface      {1000 * found.before:.1f} mm off before, {1000 * found.after:.1f} mm after, "
        f"{1000 * found.bias:+.1f} mm on average"
    )
    lines.append(f"  from         {found.points} points in {found.pictures} pictures")
    return "\n".join(lines)


def _cameras_file(found: list[CameraCalibration]) -> str:
    tables = {
        each.topic: each.camera | ({"time_offset": each.time_offset} if each.time_offset is not None else {})
        for each in found
    }
    return _core.format_toml(tables)
