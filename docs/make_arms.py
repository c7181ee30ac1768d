"""Write the bundled arms, crates/vff-core/src/robot/models/*.toml: `python docs/make_arms.py DESCRIPTIONS`.

Needs vffnull[meshes,models]; the wheel example-robot-data holds Panda and xArm7. DESCRIPTIONS is a folder of
URDFs named as below, made from the makers' packages at the stated commits by xacro with the stated arguments;
their meshes are read where the URDF says, or in DESCRIPTIONS. Joint frames, masses, inertias and limits carry
over as facts; capsules are fitted to the meshes, which stay where they are. `--only NAME` makes one.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vffnull import arms

MODELS = Path(__file__).resolve().parents[1] / "crates/vff-core/src/robot/models"
WHEEL = "example-robot-data"
JOINT = (
    *("name", "link", "kind", "position", "orientation", "axis"),
    *("mass", "com", "inertia", "armature", "damping", "friction"),
)
GRID = 1e-4  # capsules are rounded to this [m], outwards


@dataclass(frozen=True)
class Source:
    """Where the numbers of one arm come from."""

    title: str
    file: str  # in the wheel, or in DESCRIPTIONS
    base: str
    tip: str
    payload: float
    reach: float
    said: tuple[str, ...]  # sources and licence
    srdf: str | None = None
    wheel: bool = False
    torque: tuple[float, ...] | None = None
    locked: Mapping[str, float] = field(default_factory=dict)


FRANKA = "https://github.com/frankarobotics/franka_description at 566ba44abc48be2fca16050c406562e22f85793b"
UR = (
    "https://github.com/UniversalRobots/Universal_Robots_ROS2_Description at "
    "2221ec0f720fb1af99339eb891639b499b62f1da"
)
KINOVA = "https://github.com/Kinovarobotics/ros2_kortex at 1fdbef345954b326627dc3792981e18e2221450b"
LBR = "https://github.com/lbr-stack/lbr_fri_ros2_stack at 218d723f817c61314988833611effddc5333ca6c"

SOURCES = {
    "panda": Source(
        "Franka Emika Panda with its hand, fingers closed",
        "panda_description/urdf/panda.urdf",
        "panda_link0",
        "panda_hand_tcp",
        3.0,
        0.855,
        (
            "Kinematics, masses, inertias, limits: franka_ros (Apache-2.0) as in the wheel",
            "example-robot-data 6.0.0; inertial parameters identified by C. Gaz et al., IEEE Robotics and",
            "Automation Letters 4(4), 2019.",
            "Payload, reach: as commonly quoted, not read in a data sheet.",
        ),
        srdf="panda_description/srdf/panda.srdf",
        wheel=True,
    ),
    "fr3": Source(
        "Franka Research 3 with its hand, fingers closed",
        "fr3.urdf",
        "fr3_link0",
        "fr3_hand_tcp",
        3.0,
        0.855,
        (
            f"Kinematics, masses, inertias, limits: {FRANKA}",
            "(Apache-2.0), robots/fr3/fr3.urdf.xacro hand:=true.",
            "Payload, reach: as commonly quoted, not read in a data sheet.",
        ),
    ),
    "ur5e": Source(
        "Universal Robots UR5e",
        "ur5e.urdf",
        "base_link",
        "tool0",
        5.0,
        0.85,
        (
            f"Kinematics, masses, inertias, limits: {UR}",
            "(BSD-3-Clause), urdf/ur.urdf.xacro ur_type:=ur5e name:=ur5e.",
            "Payload: UR5e hardware manual. Reach: as commonly quoted, not read in a data sheet.",
        ),
    ),
    "ur10e": Source(
        "Universal Robots UR10e",
        "ur10e.urdf",
        "base_link",
        "tool0",
        12.5,
        1.3,
        (
            f"Kinematics, masses, inertias, limits: {UR}",
            "(BSD-3-Clause), urdf/ur.urdf.xacro ur_type:=ur10e name:=ur10e.",
            "Payload (10 kg or 12.5 kg, see the label on the arm), reach: UR10e user manual.",
        ),
    ),
    "iiwa14": Source(
        "KUKA LBR iiwa 14 R820",
        "iiwa14.urdf",
        "lbr_link_0",
        "lbr_link_ee",
        14.0,
        0.82,
        (
            f"Kinematics, masses, inertias, limits of position and speed: {LBR}",
            "(Apache-2.0), lbr_description/urdf/iiwa14/iiwa14.xacro.",
            "Limits of torque (there 200 N·m for every joint): KUKA brochure on the LBR iiwa, as quoted",
            "by several public models. Payload, reach: in its name, 14 R820.",
        ),
        torque=(320.0, 320.0, 176.0, 176.0, 110.0, 40.0, 40.0),
    ),
    "gen3": Source(
        "Kinova Gen3 with 7 joints, without camera and gripper",
        "gen3.urdf",
        "base_link",
        "end_effector_link",
        4.0,
        0.902,
        (
            f"Kinematics, masses, inertias, limits: {KINOVA}",
            "(BSD-3-Clause), kortex_description/robots/gen3.xacro dof:=7 vision:=false gripper:=''.",
            "Payload (middle of the range, continuous): Kinova Gen3 user guide, normal use. Reach: as",
            "commonly quoted, not read in a data sheet.",
        ),
    ),
    "xarm7": Source(
        "UFACTORY xArm 7",
        "xarm_description/urdf/xarm7.urdf",
        "link_base",
        "link_eef",
        3.5,
        0.7,
        (
            "Kinematics, masses, inertias, limits: xarm_ros2 (BSD-3-Clause) as in the wheel",
            "example-robot-data 6.0.0.",
            "Reach: xArm user manual, Cartesian range. Payload: as commonly quoted, not read in a data",
            "sheet.",
        ),
        srdf="xarm_description/srdf/xarm7.srdf",
        wheel=True,
    ),
}

SAME = (
    "Damping and friction of the published descriptions are left out: nothing says that they were measured.",
    "Gravity, mount, tool and limits may be overwritten in a scenario.",
)


def wheel_folder() -> Path:
    """The folder `share` of the wheel."""
    from importlib.metadata import files

    for file in files(WHEEL) or ():
        if file.name == "panda.urdf":
            return Path(str(file.locate())).resolve().parents[4]
    raise SystemExit(f"pip install {WHEEL}")


def make(name: str, source: Source, descriptions: Path) -> str:
    """The document of one arm."""
    share = wheel_folder() if source.wheel else descriptions
    folder = share / WHEEL / "robots" if source.wheel else descriptions
    report = arms.read_urdf(
        folder / source.file,
        tip=source.tip,
        base=source.base,
        locked=source.locked,
        srdf=None if source.srdf is None else folder / source.srdf,
        packages=share,
    )
    arm = report.document
    arm |= {"name": name, "payload": source.payload, "reach": source.reach}
    if source.torque:
        arm["torque_limits"] = list(source.torque)
    for joint in arm["joints"]:
        joint["damping"] = joint["friction"] = 0.0
    for item in arm["collision"]:
        item["shape"] = rounded(item["shape"])
    total = sum(fit.volume for fit in report.fits) / sum(fit.hull_volume for fit in report.fits)
    tight = ", ".join(
        f"{link} {'+'.join(f'{fit.tightness:.2f}' for fit in report.fits if fit.link == link)}"
        for link in dict.fromkeys(fit.link for fit in report.fits)
    )
    said = [source.title + ".", "", *source.said, *SAME]
    said += [
        "Capsules: fitted by docs/make_arms.py, all vertices inside, ends and radii rounded outwards to",
        f"0.1 mm; together {total:.2f} times the volume of the convex hulls inside, one by one:",
    ]
    said += wrapped(tight)
    if report.touching:
        pairs = ", ".join(f"{a}–{b}" for a, b in report.touching)
        said += wrapped(f"Ignored because they overlap in the middle of the joints' ranges: {pairs}.")
    return document(arm, said)


def wrapped(text: str) -> list[str]:
    """Lines of at most 100 characters."""
    import textwrap

    return textwrap.wrap(text, 100, break_long_words=False)


def rounded(shape: Mapping[str, Any]) -> dict[str, Any]:
    """A capsule on the grid that contains the given one."""
    moved = {
        key: [round(round(x / GRID) * GRID, 4) + 0.0 for x in shape[key]]
        for key in ("a", "b", "center")
        if key in shape
    }
    away = max(math.dist(moved[key], shape[key]) for key in moved)
    # A hair less than the next step up keeps what is on the grid already where it is.
    radius = round(math.ceil((shape["radius"] + away) / GRID - 1e-9) * GRID, 4)
    return {"kind": shape["kind"], **moved, "radius": radius}


def document(arm: Mapping[str, Any], said: Sequence[str]) -> str:
    """TOML with the small tables in lines."""
    arm = {**arm, "mount": ordered(arm["mount"]), "tool": ordered(arm["tool"])}
    lines = [f"# {line}".rstrip() for line in said] + [""]
    first = ("name", "payload", "reach", "base", "tip", "gravity")
    lines += [f"{key} = {value(arm[key])}" for key in first]
    for key in ("mount", "tool"):
        lines.append(f"{key} = {value(arm[key])}")
    for key in ("joint_limits", "velocity_limits", "torque_limits"):
        lines.append(f"{key} = {value(arm[key])}")
    lines += listed("ignore", arm.get("ignore", []))
    lines += listed("collision", arm["collision"])
    for joint in arm["joints"]:
        lines += ["", "[[joints]]"]
        lines += [f"{key} = {value(joint[key])}" for key in JOINT if joint[key] != 0.0]
    return "\n".join(lines) + "\n"


def ordered(frame: Mapping[str, Any]) -> dict[str, Any]:
    """Position first."""
    return {key: frame[key] for key in ("position", "orientation")}


def listed(key: str, items: Sequence[Any]) -> list[str]:
    """A list with one item a line."""
    return [f"{key} = [", *(f"    {value(item)}," for item in items), "]"] if items else []


def value(given: Any) -> str:
    """One value as TOML."""
    if isinstance(given, str):
        return f'"{given}"'
    if isinstance(given, Mapping):
        return "{ " + ", ".join(f"{key} = {value(each)}" for key, each in given.items()) + " }"
    if isinstance(given, (list, tuple)):
        return "[" + ", ".join(value(each) for each in given) + "]"
    return repr(float(given))


def main() -> None:
    """Make them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("descriptions", type=Path)
    parser.add_argument("--only", choices=list(SOURCES))
    asked = parser.parse_args()
    for name, source in SOURCES.items():
        if asked.only in (None, name):
            (MODELS / f"{name}.toml").write_text(make(name, source, asked.descriptions), encoding="utf-8")
            print(name)


if __name__ == "__main__":
    main()
