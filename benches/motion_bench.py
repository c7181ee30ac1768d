"""Plans for the problems of MotionBenchMaker, judged on the true shapes.

    python benches/motion_bench.py                       10 problems of every family, Panda and UR5
    python benches/motion_bench.py --problems 100        all of them
    python benches/motion_bench.py --first 11            ten others than those that planning was tuned on
    python benches/motion_bench.py --robots panda --collision file
    python benches/motion_bench.py --goals pose          the goal is where its configuration has the tool

The problems (Chamzas et al., 2022) come with URDF, SRDF and meshes in the source distribution of
vamp-planner, which pip fetches; nothing of it is kept here. The judge is Pinocchio with Coal: the original
meshes against the problem's boxes and cylinders, and against each other where the SRDF does not except them,
at every millisecond of a plan. It shares no code with the planner. Times are those of one thread. Needs
`pip install ".[meshes]" pin pyyaml scikit-build-core`.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tarfile
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import yaml

import vffnull as vff

SOURCE = "vamp-planner==0.6.4"
TIPS = {"panda": "panda_grasptarget", "ur5": "tool0"}
SIDES = 32  # of the prism around a cylinder
STATES = ("start blocked", "goal blocked", "goal out of reach", "not found", "too heavy")
STEP = 1e-3  # from one configuration that is judged to the next [s]


@dataclass(frozen=True)
class Problem:
    """A start, a goal, and what stands around."""

    family: str
    number: int
    start: list[float]
    goal: list[float]
    bodies: list[dict[str, Any]]


@dataclass
class Row:
    """How a problem went."""

    problem: Problem
    status: str
    message: str
    taken: float
    """Seconds of the processor."""
    duration: float = 0.0
    margin: float = 0.0
    touches: list[str] = field(default_factory=list)


def fetched(folder: Path) -> Path:
    """The folder of robots and problems, unpacked from the source distribution."""
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--no-build-isolation"]
    subprocess.run([*command, "--no-binary", "vamp-planner", "--dest", str(folder), SOURCE], check=True)
    (archive,) = folder.glob("*.tar.gz")
    with tarfile.open(archive) as tar:
        tar.extractall(folder, filter="data")
    (resources,) = folder.glob("*/resources")
    return resources


def problems(robot: Path, joints: list[str], first: int, last: int) -> Iterator[Problem]:
    """The problems of a robot with numbers from the first to the last, family by family."""
    pairs: dict[tuple[str, int], dict[str, Any]] = {}
    with tarfile.open(robot / "problems.tar.bz2") as tar:
        for member in tar:
            if member.isfile() and (file := tar.extractfile(member)) is not None:
                _, family, name = member.name.split("/")
                kind, number = name[:-9], int(name[-9:-5])
                if first <= number <= last:
                    pairs.setdefault((family.removesuffix(f"_{robot.name}"), number), {})[kind] = file.read()
    for (family, number), texts in sorted(pairs.items()):
        scene, request = (yaml.load(texts[kind], yaml.CSafeLoader) for kind in ("scene", "request"))
        state = request["start_state"]["joint_state"]
        start = dict(zip(state["name"], state["position"], strict=True))
        wanted = request["goal_constraints"][0]["joint_constraints"]
        goal = {each["joint_name"]: each["position"] for each in wanted}
        bodies = [
            {"id": each["id"], **shape, **pose}
            for each in scene["world"]["collision_objects"]
            for shape, pose in zip(each["primitives"], each["primitive_poses"], strict=True)
        ]
        yield Problem(family, number, [start[j] for j in joints], [goal[j] for j in joints], bodies)


def placed(body: dict[str, Any]) -> pin.SE3:
    """Where a body is."""
    x, y, z, w = body["orientation"]
    return pin.SE3(pin.Quaternion(w, x, y, z).normalized(), np.array(body["position"]))


def obstacle(body: dict[str, Any]) -> vff.Obstacle:
    """What the planner is told of a body: a cylinder is a prism around it."""
    x, y, z, w = body["orientation"]
    place, turned, size = body["position"], [w, x, y, z], body["dimensions"]
    if body["type"] == "box":
        return vff.Obstacle.box(place, size, orientation=turned)
    assert body["type"] == "cylinder", body["type"]
    height, radius = size
    angle = 2 * np.pi * np.arange(SIDES) / SIDES
    ring = radius / np.cos(np.pi / SIDES) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    corners = [[*point, side * height / 2] for side in (-1, 1) for point in ring]
    return vff.Obstacle.convex(np.array(corners) @ placed(body).rotation.T + place)


def scene(arm: vff.Arm, problem: Problem) -> vff.Scenario:
    """What the planner is told of a problem."""
    return vff.Scenario(
        arm=arm,
        q0=problem.start,
        duration=1.0,
        reference={"kind": "setpoint"},
        controller={"self_collision": "avoid"},
        obstacles=[obstacle(body) for body in problem.bodies],
    )


def read_arm(robot: Path, collision: str, pieces: dict[str, int]) -> vff.Arm:
    """The arm in the folder of a robot."""
    return vff.Arm.from_urdf(
        robot / f"{robot.name}.urdf",
        tip=TIPS[robot.name],
        srdf=robot / f"{robot.name}.srdf",
        packages={"meshes": robot / "meshes"},
        collision=collision,
        pieces=pieces,
    )


class Judge:
    """A robot's meshes and the bodies of a problem, as Coal has them."""

    def __init__(self, robot: Path) -> None:
        urdf, packages = str(robot / f"{robot.name}.urdf"), [str(robot)]
        self.model = pin.buildModelFromUrdf(urdf)
        self.links = pin.buildGeomFromUrdf(
            self.model, urdf, pin.GeometryType.COLLISION, package_dirs=packages
        )
        self.links.addAllCollisionPairs()
        pin.removeCollisionPairs(self.model, self.links, str(robot / f"{robot.name}.srdf"))
        self.data = self.model.createData()

    def among(self, problem: Problem) -> pin.GeometryModel:
        """The links and the bodies of a problem, with the pairs that must not touch."""
        geometry = self.links.copy()
        own = len(geometry.geometryObjects)
        for body in problem.bodies:
            size = body["dimensions"]
            shape = coal.Box(*size) if body["type"] == "box" else coal.Cylinder(size[1], size[0])
            there = geometry.addGeometryObject(pin.GeometryObject(body["id"], 0, placed(body), shape))
            for link in range(own):
                if geometry.geometryObjects[link].parentJoint:
                    geometry.addCollisionPair(pin.CollisionPair(link, there))
        return geometry

    def touches(self, problem: Problem, motion: np.ndarray) -> list[str]:
        """The pairs that overlap in one of some configurations (k, n)."""
        geometry = self.among(problem)
        found = geometry.createData()
        touched: set[str] = set()
        for q in motion:
            if pin.computeCollisions(self.model, self.data, geometry, found, q, True):
                pin.computeCollisions(self.model, self.data, geometry, found, q, False)
                for pair, result in zip(geometry.collisionPairs, found.collisionResults, strict=True):
                    if result.isCollision():
                        names = [geometry.geometryObjects[i].name for i in (pair.first, pair.second)]
                        touched.add(" and ".join(names))
        return sorted(touched)


def solve(arm: vff.Arm, problem: Problem, judge: Judge, goals: str, seed: int, paths: int) -> Row:
    """Plan, and let the plan be judged."""
    goal: Any = problem.goal if goals == "configuration" else arm.pose(problem.goal)
    ready = scene(arm, problem)
    before = time.process_time()
    plan = vff.plan(ready, goal, seed=seed, paths=paths)
    row = Row(problem, str(plan.status), plan.message, time.process_time() - before)
    if plan.status == "found":
        row.duration, row.margin = plan.duration, plan.margin
        times = np.append(np.arange(0.0, plan.duration, STEP), plan.duration)
        row.touches = judge.touches(problem, plan.at(times)[0])
    return row


def table(robot: str, rows: list[Row]) -> str:
    """Rates and times by family, in Markdown."""
    heads = [robot, "found", "median / 95 % of found [ms]", "touch", *STATES]
    lines = ["| " + " | ".join(heads) + " |", "|---" + "|--:" * (len(heads) - 1) + "|"]
    families = sorted({row.problem.family for row in rows})
    for family in [*families, "all"]:
        some = [row for row in rows if family in (row.problem.family, "all")]
        found = [row for row in some if row.status == "found"]
        taken = 1e3 * np.array([row.taken for row in found] or [np.nan])
        states = Counter(row.status for row in some)
        cells = [
            family.replace("_", " "),
            f"{len(found)} of {len(some)}",
            f"{np.median(taken):.0f} / {np.quantile(taken, 0.95):.0f}",
            str(sum(bool(row.touches) for row in found)),
            *(str(states[name]) for name in STATES),
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--robots", nargs="+", choices=TIPS, default=list(TIPS))
    parser.add_argument("--first", type=int, default=1, help="number of the first of each family")
    parser.add_argument("--problems", type=int, default=10, help="of each family from there on, up to 100")
    parser.add_argument("--families", nargs="+", help="all by default")
    parser.add_argument("--collision", choices=["fit", "file"], default="fit", help="shapes of the links")
    parser.add_argument("--pieces", nargs=2, action="append", default=[], metavar=("LINK", "COUNT"),
                        help="with `file`: hulls that the mesh of a link may become")  # fmt: skip
    parser.add_argument("--goals", choices=["configuration", "pose"], default="configuration")
    parser.add_argument("--paths", type=int, default=4, help="of which the shortest is taken")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--resources", type=Path, help="unpacked already")
    parser.add_argument("--json", type=Path, help="write every row there")
    given = parser.parse_args()
    warnings.simplefilter("ignore", vff.errors.ScenarioWarning)
    with tempfile.TemporaryDirectory() as folder:
        resources = given.resources or fetched(Path(folder))
        everything = []
        for name in given.robots:
            robot = resources / name
            arm = read_arm(robot, given.collision, {link: int(count) for link, count in given.pieces})
            judge = Judge(robot)
            joints = [each for each in judge.model.names if each != "universe"]
            rows = []
            for problem in problems(robot, joints, given.first, given.first + given.problems - 1):
                if given.families and problem.family not in given.families:
                    continue
                rows.append(solve(arm, problem, judge, given.goals, given.seed, given.paths))
                row = rows[-1]
                what = row.message if row.status != "found" else "; ".join(row.touches)
                print(f"{name} {problem.family} {problem.number}: {row.status}, {row.taken:.2f} s. {what}",
                      file=sys.stderr, flush=True)  # fmt: skip
            print(table(name, rows), end="\n\n", flush=True)
            everything += [{"robot": name, **vars(row), "problem": [row.problem.family, row.problem.number]}
                           for row in rows]  # fmt: skip
        if given.json:
            given.json.write_text(json.dumps(everything, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
