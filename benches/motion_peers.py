"""The problems of MotionBenchMaker for other planners, under the judge of `motion_bench.py`.

    python benches/motion_peers.py                                          RoboPlan, OMPL and vffnull
    python benches/motion_peers.py --first 11 --problems 3                  others than those tuned on
    python benches/motion_peers.py --planners roboplan --resolution 0.005 --no-shorten

RoboPlan plans with its RRT-Connect and its own collision checks of URDF and SRDF; OMPL with its RRT-Connect,
asking Pinocchio with Coal from Python about every configuration. Both test motions at configurations that are
no farther apart than a resolution, and shorten what they find. vffnull gets the shapes of the links from
their meshes, and searches one path. A plan of vffnull is judged at every millisecond, a path at every 0.002
rad. A touch is deep if it is still there with bodies that are 0.1 mm smaller on every side; one between links
counts as deep. Times are those of the processor for planning and shortening, with the problem already loaded
by RoboPlan and OMPL. The limit ends a search, which shortening may overrun; vffnull knows none, and what it
finds later does not count. Needs
`pip install ".[meshes]" pin pyyaml roboplan==0.7.0 ompl==2.0.1`, and scikit-build-core without `--resources`.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import combinations, pairwise
from pathlib import Path
from typing import Protocol

os.environ["OMP_NUM_THREADS"] = "1"

import numpy as np
import pinocchio as pin
from ompl import base, geometric, util
from roboplan import core, rrt

import vffnull as vff
from motion_bench import STEP, TIPS, Judge, Problem, fetched, placed, problems, read_arm, scene

PIECES: dict[str, dict[str, int]] = {"panda": {}, "ur5": {"forearm_link": 4}}
DEEP = 1e-4  # what a touch may be without being deep [m]
ANGLE = 0.002  # from one configuration of a path that is judged to the next [rad]
NODES = 100_000  # for RoboPlan: the limit is one of time


class BlockedError(Exception):
    """The start or goal is not free."""


class Planner(Protocol):
    """Something that plans."""

    def load(self, problem: Problem) -> None:
        """Take a problem."""

    def plan(self) -> np.ndarray | None:
        """Corners of a path, or None; this is what takes time."""

    def motion(self, found: np.ndarray) -> np.ndarray:
        """What is judged of it."""


@dataclass
class Row:
    """How a problem went."""

    status: str
    taken: float = 0.0
    """Seconds of the processor."""
    length: float = 0.0
    touches: list[str] = field(default_factory=list)
    deep: bool = False


def dense(corners: np.ndarray) -> np.ndarray:
    """Configurations along a path."""
    parts = [corners[:1]]
    for one, other in pairwise(corners):
        count = max(1, int(np.ceil(np.linalg.norm(other - one) / ANGLE)))
        parts.append(one + (other - one) * np.arange(1, count + 1)[:, None] / count)
    return np.concatenate(parts)


def smaller(problem: Problem) -> Problem:
    """The same with bodies that lack a layer."""
    bodies = []
    for body in problem.bodies:
        less = [2 * DEEP] * 3 if body["type"] == "box" else [2 * DEEP, DEEP]
        size = [max(each - lack, 1e-9) for each, lack in zip(body["dimensions"], less, strict=True)]
        bodies.append(body | {"dimensions": size})
    return replace(problem, bodies=bodies)


class RoboPlan:
    """RRT-Connect of RoboPlan."""

    def __init__(self, robot: Path, judge: Judge, given: argparse.Namespace, resolution: float) -> None:
        description = core.loadUrdfSceneDescription(str(robot / f"{robot.name}.urdf"), [str(robot)])
        self.scene = core.Scene(robot.name, description)
        self.scene.importSrdf((robot / f"{robot.name}.srdf").read_text(encoding="utf-8"))
        self.names = [each for each in judge.model.names if each != "universe"]
        assert self.scene.getJointNames() == self.names
        own = judge.links.geometryObjects
        self.fixed = [judge.model.frames[each.parentFrame].name for each in own if not each.parentJoint]
        self.options = rrt.RRTOptions(
            max_nodes=NODES,
            collision_check_step_size=resolution,
            max_planning_time=given.limit,
            rrt_connect=True,
        )
        self.shortening = core.PathShortcuttingOptions(max_step_size=resolution, seed=given.seed)
        self.shorten, self.seed = given.shorten, given.seed
        self.bodies: list[str] = []

    def load(self, problem: Problem) -> None:
        for name in self.bodies:
            self.scene.removeGeometry(name)
        self.bodies = [f"{number} {body['id']}" for number, body in enumerate(problem.bodies)]
        grey = np.full(4, 0.5)
        for name, body in zip(self.bodies, problem.bodies, strict=True):
            place, size = placed(body).homogeneous, body["dimensions"]
            if body["type"] == "box":
                self.scene.addBoxGeometry(name, "universe", core.Box(*size), place, grey)
            else:
                cylinder = core.Cylinder(size[1], size[0])
                self.scene.addCylinderGeometry(name, "universe", cylinder, place, grey)
        fixed = combinations([*self.fixed, *self.bodies], 2)
        self.scene.setCollisions([pair for pair in fixed if pair[1] in self.bodies], False)
        self.ends = np.array([problem.start, problem.goal])
        for q in self.ends:
            if self.scene.hasCollisions(q) or not self.scene.isValidConfiguration(q):
                raise BlockedError

    def plan(self) -> np.ndarray | None:
        start, goal = (core.JointConfiguration(self.names, q) for q in self.ends)
        planner = rrt.RRT(self.scene, self.options)
        planner.setRngSeed(self.seed)
        try:
            path = planner.plan(start, goal)
        except RuntimeError:
            return None
        if self.shorten:
            path = core.PathShortcutter(self.scene, self.shortening).shortcut(path)
        return np.array(path.positions)

    def motion(self, found: np.ndarray) -> np.ndarray:
        return dense(found)


class Ompl:
    """RRT-Connect of OMPL."""

    def __init__(self, robot: Path, judge: Judge, given: argparse.Namespace, resolution: float) -> None:
        self.judge, self.given = judge, given
        self.bounds = base.RealVectorBounds(judge.model.nq)
        for joint, (low, high) in enumerate(
            zip(judge.model.lowerPositionLimit, judge.model.upperPositionLimit, strict=True)
        ):
            self.bounds.setLow(joint, low)
            self.bounds.setHigh(joint, high)
        self.resolution = resolution

    def checker(self, problem: Problem) -> Callable[[base.State], bool]:
        """Whether a configuration is free, with the pairs of the judge."""
        model, data, geometry = self.judge.model, self.judge.data, self.judge.among(problem)
        found, count = geometry.createData(), model.nq
        tree = pin.BroadPhaseManager_DynamicAABBTreeCollisionManager(model, geometry, found)
        self.kept = geometry, found  # the tree does not keep them alive
        return lambda state: not pin.computeCollisions(model, data, tree, np.array(state[0:count]), True)

    def load(self, problem: Problem) -> None:
        space = base.RealVectorStateSpace(self.judge.model.nq)
        space.setBounds(self.bounds)
        self.setup = geometric.SimpleSetup(space)
        self.setup.setStateValidityChecker(self.checker(problem))
        information = self.setup.getSpaceInformation()
        information.setStateValidityCheckingResolution(self.resolution / space.getMaximumExtent())
        information.setup()
        ends = [space.allocState() for _ in range(2)]
        for state, q in zip(ends, (problem.start, problem.goal), strict=True):
            state[0 : len(q)] = q
            if not (information.satisfiesBounds(state) and information.isValid(state)):
                raise BlockedError
        self.setup.setStartAndGoalStates(*ends)
        self.setup.setPlanner(geometric.RRTConnect(information))

    def plan(self) -> np.ndarray | None:
        end = time.process_time() + self.given.limit
        late = base.PlannerTerminationCondition(lambda: time.process_time() > end)
        self.setup.solve(late)
        if not self.setup.haveExactSolutionPath():
            return None
        if self.given.shorten:
            self.setup.simplifySolution(late)
        count = self.judge.model.nq
        return np.array([state[0:count] for state in self.setup.getSolutionPath().getStates()])

    def motion(self, found: np.ndarray) -> np.ndarray:
        return dense(found)


class Ours:
    """vffnull."""

    def __init__(self, robot: Path, judge: Judge, given: argparse.Namespace) -> None:
        self.seed = given.seed
        self.arm = read_arm(robot, "file", PIECES[robot.name])

    def load(self, problem: Problem) -> None:
        self.goal = problem.goal
        self.scene = scene(self.arm, problem)

    def plan(self) -> np.ndarray | None:
        self.found = vff.plan(self.scene, self.goal, seed=self.seed, paths=1)
        if self.found.status in ("start blocked", "goal blocked"):
            raise BlockedError
        return self.found.q if self.found.status == "found" else None

    def motion(self, found: np.ndarray) -> np.ndarray:
        duration = self.found.duration
        return self.found.at(np.append(np.arange(0.0, duration, STEP), duration))[0]


def solve(planner: Planner, problem: Problem, judge: Judge, limit: float | None) -> Row:
    """Plan, and let the plan be judged; with a limit, what comes later is not found."""
    try:
        planner.load(problem)
        before = time.process_time()
        found = planner.plan()
        taken = time.process_time() - before
    except BlockedError:
        return Row("blocked")
    if found is None or (limit is not None and taken > limit):
        return Row("not found", taken)
    motion = planner.motion(found)
    length = float(np.linalg.norm(np.diff(motion, axis=0), axis=1).sum())
    touches = judge.touches(problem, motion)
    return Row("found", taken, length, touches, bool(touches and judge.touches(smaller(problem), motion)))


def line(name: str, rows: list[Row]) -> str:
    """What a planner did, as a row of Markdown."""
    found = [row for row in rows if row.status == "found"]
    taken = 1e3 * np.array([row.taken for row in found] or [np.nan])
    cells = [
        name,
        f"{len(found)} of {len(rows)}",
        f"{np.median(taken):.0f} / {np.quantile(taken, 0.95):.0f}",
        f"{sum(bool(row.touches) for row in found)} ({sum(row.deep for row in found)})",
        f"{np.median([row.length for row in found] or [np.nan]):.2f}",
        *(str(sum(row.status == status for row in rows)) for status in ("blocked", "not found")),
    ]
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    names = ["roboplan", "ompl", "vffnull"]
    parser.add_argument("--robots", nargs="+", choices=TIPS, default=list(TIPS))
    parser.add_argument("--planners", nargs="+", choices=names, default=names)
    parser.add_argument("--first", type=int, default=1, help="number of the first of each family")
    parser.add_argument("--problems", type=int, default=10, help="of each family from there on, up to 100")
    parser.add_argument("--families", nargs="+", help="all by default")
    parser.add_argument("--resolution", type=float, nargs="+", default=[0.05, 0.005],
                        help="of RoboPlan and OMPL [rad]")  # fmt: skip
    parser.add_argument("--limit", type=float, default=20.0, help="for one problem [s]")
    parser.add_argument("--shorten", action=argparse.BooleanOptionalAction, default=True,
                        help="what RoboPlan and OMPL find")  # fmt: skip
    parser.add_argument("--seed", type=int, default=1, help="above 0")
    parser.add_argument("--resources", type=Path, help="unpacked already")
    given = parser.parse_args()
    warnings.simplefilter("ignore", vff.errors.ScenarioWarning)
    util.setLogLevel(util.LOG_NONE)
    util.RNG.setSeed(given.seed)
    with tempfile.TemporaryDirectory() as folder:
        resources = given.resources or fetched(Path(folder))
        for name in given.robots:
            robot = resources / name
            judge = Judge(robot)
            joints = [each for each in judge.model.names if each != "universe"]
            last = given.first + given.problems - 1
            some = [problem for problem in problems(robot, joints, given.first, last)
                    if not given.families or problem.family in given.families]  # fmt: skip
            planners: dict[str, Planner] = {}
            for kind in given.planners:
                if kind == "vffnull":
                    planners[kind] = Ours(robot, judge, given)
                    continue
                for resolution in given.resolution:
                    made = RoboPlan if kind == "roboplan" else Ompl
                    planners[f"{kind}, {resolution:g} rad"] = made(robot, judge, given, resolution)
            heads = [name, "found", "median / 95 % of found [ms]", "touch (deep)", "median length [rad]"]
            heads += ["blocked", "not found"]
            print("| " + " | ".join(heads) + " |", "|---" + "|--:" * (len(heads) - 1) + "|", sep="\n")
            for label, planner in planners.items():
                rows = []
                for problem in some:
                    row = solve(planner, problem, judge, given.limit if label == "vffnull" else None)
                    rows.append(row)
                    what = f"{row.status}, {row.taken:.2f} s. {'; '.join(row.touches)}"
                    print(f"{label}: {name} {problem.family} {problem.number}: {what}", file=sys.stderr)
                print(line(label, rows), flush=True)
            print()


if __name__ == "__main__":
    main()
