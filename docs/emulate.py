"""Every bundled scene in space before emulated robots, many times; writes emulated.md.

    python docs/emulate.py FOLDER [CYCLES] [--jobs N]

Runs go into FOLDER, one line each, and are not repeated: whatever has ended the program, the same command
goes on. CYCLES of the robots in all, 10 million by default, are shared by the ways to give way; other laws
get a tenth, the last of them only where cbfpy is installed (`pip install ".[peers]"`).
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import warnings
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import replace
from functools import cache
from importlib.util import find_spec
from itertools import count
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

DOCS = Path(__file__).resolve().parent
sys.path.insert(0, str(DOCS.parent / "benches"))

import vffnull as vff  # noqa: E402
from vffnull import evaluation  # noqa: E402
from vffnull.robots import emulated  # noqa: E402
from vffnull.robots.franka import FrankaRobot  # noqa: E402
from vffnull.run import emulate as emulation  # noqa: E402

FR3 = {"arm": {"model": "fr3"}}
# What its rotors add to a joint [kg·m²]: armature in universal_robots_ur5e/ur5e.xml of MuJoCo Menagerie.
UR5E = {"arm": {"model": "ur5e", "armature": 0.1}}
CASES: dict[str, tuple[str, str, dict[str, Any]]] = {
    "panda-sweep": ("panda-sweep", "emulated-franka", {}),
    "panda-cup": ("panda-cup", "emulated-franka", {}),
    "panda-pointing": ("panda-pointing", "emulated-franka", {}),
    "panda-shelf": ("panda-shelf", "emulated-franka", {}),
    "panda-sweep, fr3": ("panda-sweep", "emulated-franka", FR3),
    "panda-cup, fr3": ("panda-cup", "emulated-franka", FR3),
    "panda-pointing, fr3": ("panda-pointing", "emulated-franka", FR3),
    "ur5e-sweep": ("ur5e-sweep", "emulated-ur", UR5E),
    "ur5e-crossed": ("ur5e-crossed", "emulated-ur", UR5E),
}
WAYS = ("null-space field", "relaxed", "priority", "cbf", "cbf + preview")
OSCBF = "OSCBF, tuned"
PEERS = ("Khatib's field", "no avoidance", OSCBF)
WITH_OSCBF = ("panda-sweep", "panda-cup")  # arms, references and tasks that it is written for
# Kilograms that nobody knows of, and whether they are observed and rejected.
LOADS = {"none": (0.0, False), "1 kg": (1.0, False), "1 kg, observed": (1.0, True)}
COLLISION = 40.0  # N·m of a joint, N at the hand
FEW = 4  # runs of each case without the kilogram, and with it where nothing is done about it

PAGE = """# Before emulated robots

{cycles:.1f} million cycles of emulated robots (`vffnull.robots.emulated`), made by
`python docs/emulate.py FOLDER`, vffnull {version}; each takes {taken:.0f} µs of a processor: adapter,
drive, law,
robot and plant. The bundled scenes whose arm has an emulated interface run from their start to the end of
their stop, again and again with other random numbers: noise of 10 µrad and 0.01 rad/s, states that are
one cycle old, one in a hundred states and commands lost, friction of a hundredth of each joint's largest
torque that the robot compensates in part; and a kilogram at the tool, off by up to 5 cm, that neither
robot nor controller knows of, or none. `command = "of the robot"` lets the limits of a Franka count with
it (T141); *observed*: `[controller.observer]` estimates it with the dry friction of each joint as its
threshold, and the task and the null space reject it, so that the hand does not sag. The joints of the UR5e
have the inertia of rotors that MuJoCo Menagerie's model of it has, 0.1 kg·m², which the controller knows
(`[arm] armature`): without it, the kilogram would be ten times the inertia of the last joint.

**{observed}** runs of {observeds} where the kilogram is observed and rejected were ended by the robot;
**{clean}** of {cleans} without it; **{loaded}** of {loadeds} with it where nothing rejects it, of which
{late} after the scene's end. A stop damps the arm and holds it where it comes to rest, whatever it carries
(T160).

A **reflex** is a run that the robot ends by itself, with the rule that most of them broke; *stop*: so
many of them in the stop. **Faults** are runs that the drive ends although the robot does not.
**Released**: cycles in which an arm in motion is left to gravity alone, of all runs. **Hit**: runs in
which the arm overlaps an obstacle. **Speed**: the nearest that a joint came to the limit of its speed, in
all runs, where 1 trips. Thresholds of collision are 40 N·m and 40 N. On what robots do beyond what their
makers publish, this says nothing.

{ways}

## What stops a robot

{reasons}

`relaxed` gives up the hand's orientation between the boards of panda-shelf, and its way leads past a
singularity, where a robot says nothing of the force at its hand (libfranka, `robot_state.h`): 0.5 N·m of
friction in its joints would be 50 N there. That hand is free to turn. 10 N, 5 cm beside the axis of its
last joint, are 75 rad/s² for a model that does not know of them, and let a limit of its speed be exceeded
by that over the pole of the barrier, 1.9 rad/s of 2.5, where limits do not count with them: without an
observer, with a table in the place of "of the robot", 7 of 8 such runs are ended by the robot.

## Other laws

The same scenes and robots, and laws that send what they compute: cut off at the torque limits, and on a
Franka's by the adapter at the rate against the torque that was used last (`limitRate`). *Khatib's field*:
the push on the links as a torque, added to that of the task without a projection. *No avoidance*: the
operational-space law alone. *OSCBF*: the filter of Morton and Pavone by cbfpy, with the settings of
[peers.md](peers.md), where it has an arm, a reference and shapes for it. None of them has a safe start, a
watchdog or a damped stop: a run ends with its scene, so that what stops ours in the stop cannot stop
them.

{peers}
"""


def main() -> None:
    """Run what is missing, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("cycles", type=float, nargs="?", default=1e7)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--page", type=Path, default=DOCS / "emulated.md")
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    kept = given.folder / "runs.jsonl"
    rows = [json.loads(line) for line in kept.read_text().splitlines()] if kept.exists() else []
    for ways, share in ((WAYS, 1.0), (PEERS, 0.1)):
        rows += collect(ways, int(share * given.cycles), rows, kept, given.jobs)
    given.page.write_text(page(rows), encoding="utf-8")
    print(given.page)


def collect(
    ways: tuple[str, ...], cycles: int, known: list[dict[str, Any]], kept: Path, jobs: int
) -> list[dict[str, Any]]:
    """Run until there are so many cycles, of `known` rows and of new ones."""
    done = {(row["case"], row["way"], row["load"], row["seed"]) for row in known}
    total = sum(row["cycles"] for row in known if row["way"] in ways)
    found: list[dict[str, Any]] = []
    todo = (each for each in tasks(ways) if each not in done)
    running: set[Future[dict[str, Any]]] = set()
    with ProcessPoolExecutor(jobs) as pool, kept.open("a", encoding="utf-8") as out:
        while total < cycles:
            while len(running) < 2 * jobs:
                running.add(pool.submit(run, *next(todo)))
            over, running = wait(running, return_when=FIRST_COMPLETED)
            for each in over:
                row = each.result()
                out.write(json.dumps(row) + "\n")
                out.flush()
                found.append(row)
                total += row["cycles"]
            print(f"{total:.3g} of {cycles:.3g} cycles", flush=True)
        for each in running:
            each.cancel()
    return found


def tasks(ways: tuple[str, ...]) -> Iterator[tuple[str, str, str, int]]:
    """Every case, way and load, seed after seed; most with a load that is observed."""
    for seed in count():
        for case in CASES:
            for way in ways:
                if way == OSCBF and (case not in WITH_OSCBF or find_spec("cbfpy") is None):
                    continue
                for load, (_, observed) in LOADS.items():
                    if (observed or seed < FEW) if way in WAYS else not observed:
                        yield case, way, load, seed


def disturbed(robot: str, load: float, seed: int) -> emulated.Disturbances:
    """What is not as the model says."""
    off = np.random.default_rng(seed).uniform(-0.05, 0.05, 3)
    payload = {"mass": load, "com": off.tolist()} if load > 0.0 else {}
    return replace(emulated.usual(robot, seed), load=payload)


def run(case: str, way: str, load: str, seed: int) -> dict[str, Any]:
    """One run, as a row."""
    name, robot, changes = CASES[case]
    began = process_time()
    kilograms, observed = LOADS[load]
    disturbances = disturbed(robot, kilograms, seed)
    scene = vff.Scenario.load(name).replace(**changes)
    if way in WAYS:
        own = as_way(scene, way)
        row = driven(observing(own, disturbances) if observed else own, robot, disturbances)
    else:
        row = sent(scene, way, robot, disturbances)
    return {"case": case, "way": way, "load": load, "seed": seed, "taken": process_time() - began} | row


def driven(scene: vff.Scenario, robot: str, disturbances: emulated.Disturbances) -> dict[str, Any]:
    """A run as `vffnull.drive` makes it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", vff.errors.ScenarioWarning)
        outcome = emulation.emulate(scene, robot, disturbances, collision_force=COLLISION)
    end = scene.duration + 0.5
    return summary(outcome.reflex, outcome.margins, outcome.clearance, end) | {
        "cycles": outcome.cycles,
        "released": outcome.released,
        "fault": "" if outcome.reflex or outcome.report.status != "fault" else outcome.report.reason,
    }


def as_way(scene: vff.Scenario, way: str) -> vff.Scenario:
    """The scene under a way to give way, whatever its own is."""
    changes = {"controller.avoidance": "null_space", "controller.yielding": None, "controller.governor": None}
    return scene.replace(**changes).replace(**evaluation.CONTROLLERS[way])


def observing(scene: vff.Scenario, disturbances: emulated.Disturbances) -> vff.Scenario:
    """The scene with an observer that takes as much for friction as there is, and answers the rest."""
    threshold = np.asarray(disturbances.coulomb_friction).tolist()
    reject = {"task": "reject", "null_space": "reject"}
    return scene.replace(**{"controller.observer": {"threshold": threshold}, "controller.touch": reject})


def summary(
    reflex: emulated.Reflex | None, margins: tuple[emulated.Margin, ...], clearance: float | None, end: float
) -> dict[str, Any]:
    """What a row says of a robot."""
    return {
        "reflex": None if reflex is None else reflex.rule.name,
        "what": None if reflex is None else reflex.rule.what,
        "in_stop": reflex is not None and reflex.t > end,
        "hit": clearance is not None and clearance < 0.0,
        "speed": next(each.share for each in margins if each.rule.what == "the speed"),
    }


def sent(scene: vff.Scenario, way: str, robot: str, disturbances: emulated.Disturbances) -> dict[str, Any]:
    """A run of a law that sends what it computes."""
    law = laws(scene, way, robot)
    franka = robot == "emulated-franka"
    there: Any = (emulated.franka if franka else emulated.ur).Robot(scene, disturbances)
    limits = np.asarray(scene.arm.torque_limits)
    clearance = there.body.clearance
    adapter = FrankaRobot(there) if franka else None
    if adapter is not None:
        adapter.set_collision_behavior(COLLISION, COLLISION)
        adapter.begin()
    while there.body.t < scene.duration and there.reflex is None:
        try:
            t, q, dq = adapter.read() if adapter else (there.body.t, *there.body.measure())
            tau = np.clip(law(there.body.cycle, t, np.asarray(q), np.asarray(dq)), -limits, limits)
            if adapter is not None:
                adapter.write(tau)
            else:
                there.directTorque(tau.tolist())
        except emulated.franka.ControlException:
            break
        clearance = min(clearance, there.body.clearance)
    cycles = there.reflex.cycle if there.reflex is not None else there.body.cycle
    row = summary(there.reflex, there.margins(), clearance, np.inf)
    return row | {"cycles": cycles, "released": 0, "fault": ""}


class Reference:
    """The reference of a scenario in every cycle, with velocity and acceleration."""

    def __init__(self, scenario: vff.Scenario, rate: float) -> None:
        period = 1.0 / rate
        steps = max(1, round(period / 1e-3))
        numerics = {"dt": period / steps, "control_every": steps, "record_every": steps}
        plain: dict[str, Any] = {
            "obstacles": [],
            "controller": {"task": scenario["controller"].get("task", "position")},
            "simulation": {**numerics, "integrator": "semi_implicit_euler"},
            **dict.fromkeys(("perception", "measurement", "actuator", "plant", "replan")),
        }
        if scenario["reference"]["kind"] == "setpoint":
            plain["duration"] = 2.0 * period
        seen = vff.simulate(scenario.replace(**plain), progress=False)
        place, turn = np.array(seen.x_ref), seen.orientation_ref
        self.place = place if turn is None else np.concatenate([place, turn], axis=1)
        velocity = np.gradient(place, period, axis=0)
        if turn is not None:
            velocity = np.concatenate([velocity, angular(np.array(turn), period)], axis=1)
        self.velocity = velocity
        self.acceleration = np.gradient(velocity, period, axis=0)

    def at(self, cycle: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Pose, velocity and acceleration in a cycle; at rest after the last."""
        k = min(cycle, len(self.place) - 1)
        if k != cycle:
            rest = np.zeros_like(self.velocity[k])
            return self.place[k], rest, rest
        return self.place[k], self.velocity[k], self.acceleration[k]


def angular(turn: np.ndarray, period: float) -> np.ndarray:
    """Angular velocities (T, 3) [rad/s] of unit quaternions (T, 4), by central differences."""
    turns = vff._core.matrices(turn)
    between = vff._core.quaternions(np.einsum("kij,klj->kil", turns[2:], turns[:-2]))
    sine = np.linalg.norm(between[:, 1:], axis=1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, between[:, :1])
    inner = between[:, 1:] * np.where(sine > 1e-15, angle / np.maximum(sine, 1e-15), 2.0) / (2.0 * period)
    return np.concatenate([inner[:1], inner, inner[-1:]])


def laws(scene: vff.Scenario, way: str, robot: str) -> Any:
    """What computes the torque without gravity in a cycle."""
    arm = scene.arm
    if way == OSCBF:
        filtering, task = oscbf(json.dumps(scene.to_dict(), default=float))
        last = task.steps
        return lambda k, t, q, dq: filtering.torque(min(k, last), q, dq) - arm.gravity_torque(q)
    rate = emulated.franka.RATE if robot == "emulated-franka" else emulated.ur.RATE
    reference = Reference(scene, rate)
    settings = dict(
        as_way(scene, "no avoidance" if way == "no avoidance" else "unprojected field")["controller"]
    )
    if "posture" not in settings:
        settings.pop("posture_stiffness", None)
    settings |= {"command": {"gravity": "robot"}, "enforce_limits": False}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", vff.errors.ScenarioWarning)
        controller = vff.Controller(arm, settings)
    obstacles = [] if way == "no avoidance" else scene["obstacles"]

    def law(k: int, t: float, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
        return controller.torque(q, dq, *reference.at(k), obstacles=obstacles, t=t)

    return law


@cache
def oscbf(document: str) -> tuple[Any, Any]:
    """The filter for a scene; compiling takes half a minute."""
    from peers.spatial import oscbf as module
    from peers.spatial.task import Task

    task = Task(vff.Scenario.from_dict(json.loads(document)))
    tuned = Path(module.__file__).with_name("tuned.toml").read_text(encoding="utf-8")
    found = vff._core.parse_toml(tuned, "tuned.toml")
    return module.OperationalSpace(task, found[OSCBF]["settings"], module.as_placed), task


def page(rows: list[dict[str, Any]]) -> str:
    """The page of these rows."""
    reasons: dict[tuple[str, str], int] = defaultdict(int)
    for row in rows:
        if row["way"] in WAYS and row["reflex"]:
            reasons[f"{row['what']} (`{row['reflex']}`)", row["load"]] += 1
    names = sorted(
        {name for name, _ in reasons}, key=lambda name: -sum(reasons[name, load] for load in LOADS)
    )
    told = ["| rule | " + " | ".join(LOADS) + " |", "|---|" + "--:|" * len(LOADS)]
    told += [f"| {name} | " + " | ".join(str(reasons[name, load]) for load in LOADS) + " |" for name in names]
    ours = [row for row in rows if row["way"] in WAYS]
    clean, loaded, observed = ([row for row in ours if row["load"] == load] for load in LOADS)
    return PAGE.format(
        cycles=1e-6 * sum(row["cycles"] for row in rows),
        clean=sum(bool(row["reflex"]) for row in clean),
        cleans=len(clean),
        loaded=sum(bool(row["reflex"]) for row in loaded),
        loadeds=len(loaded),
        late=sum(row["in_stop"] for row in loaded),
        observed=sum(bool(row["reflex"]) for row in observed),
        observeds=len(observed),
        version=vff.__version__,
        taken=1e6 * sum(row["taken"] for row in rows) / max(1, sum(row["cycles"] for row in rows)),
        ways=table(rows, WAYS),
        reasons="\n".join(told) if names else "Nothing did.",
        peers=table(rows, PEERS),
    )


def table(rows: list[dict[str, Any]], ways: tuple[str, ...]) -> str:
    """A row per scene, way and load."""
    head = "| scene | way | load | runs | cycles | reflexes | mostly | faults | released | hit | speed |"
    lines = [head, "|---|---|--:|--:|--:|--:|---|--:|--:|--:|--:|"]
    for case in CASES:
        for way in ways:
            for load in LOADS:
                own = [row for row in rows if (row["case"], row["way"], row["load"]) == (case, way, load)]
                if own:
                    lines.append(f"| {case} | {way} | {load} | {cells(own)} |")
    return "\n".join(lines)


def cells(own: list[dict[str, Any]]) -> str:
    """The numbers of a row of a table."""
    broken = [row for row in own if row["reflex"]]
    late = sum(row["in_stop"] for row in broken)
    what = [row["what"] for row in broken]
    mostly = max(set(what), key=what.count).removeprefix("the ") if what else ""
    counts = [
        str(len(own)),
        f"{sum(row['cycles'] for row in own):,}".replace(",", " "),
        f"{len(broken)}" + (f" ({late} stop)" if late else ""),
        mostly,
        str(sum(bool(row["fault"]) for row in own)),
        str(sum(row["released"] for row in own)),
        str(sum(row["hit"] for row in own)),
        f"{max(row['speed'] for row in own):.2f}",
    ]
    return " | ".join(counts)


if __name__ == "__main__":
    main()
