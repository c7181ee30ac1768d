"""Where promises meet: every bundled scene, every way of giving way, every option.

`python tests/matrix.py 2 --seed 7` runs random sets of two options for every scene and way, and prints what
does not hold.
"""

from __future__ import annotations

import argparse
import random
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

import vffnull as vff
from vffnull.errors import ScenarioError
from vffnull.evaluation.geometry.arm import rotation

Changes = dict[str, Any]

WAYS: dict[str, Changes] = {
    "null_space": {"controller.avoidance": "null_space"},
    "relaxed": {"controller.avoidance": "relaxed"},
    "priority": {"controller.avoidance": "priority"},
    "cbf": {"controller.avoidance": "cbf", "controller.yielding.preview": None},
    "look-ahead": {"controller.avoidance": "cbf", "controller.yielding.preview": {}},
    "self-motion": {"controller.avoidance": "cbf", "controller.yielding.preview": {"self_motion": {}}},
}
_ONE_FREEDOM = (
    "gen3-circle",
    "head-on",
    "iiwa-line",
    "iiwa-swivel",
    "panda-bump",
    "panda-lean",
    "panda-shelf",
    "panda-sweep",
    "panda-watched",
    "planner-bench-reach-3",
)
NOT_TOGETHER = {
    (name, "self-motion"): "leaves one degree of freedom"
    for name in vff.scenarios()
    if name not in _ONE_FREEDOM
} | {("panda-wipe", way): "has no look-ahead" for way in ("look-ahead", "self-motion")}
"""Scenes with a way of giving way that they refuse, and a part of the sentence."""
RATE = 1000.0  # N·m/s


@dataclass(frozen=True)
class Option:
    """Something that a scene can have beside what it has.

    `refused` has a part of each sentence with which scenes are refused that cannot have it. `exact` says
    whether the controller still knows the arm and its surroundings as they are: only then can it keep speeds
    and distances. `yields_less` is an option whose purpose it is to keep something else before a distance.
    """

    changes: Callable[[vff.Scenario], Changes]
    refused: tuple[str, ...] = ()
    exact: bool = True
    yields_less: bool = False


def _of_dimension(scene: vff.Scenario, plane: Any, space: Any) -> Any:
    return plane if scene.arm.dimension == 2 else space


def _of_each(scene: vff.Scenario, said: Changes) -> Changes:
    """All obstacles, of which this is said."""
    return {"obstacles": [each | said for each in scene.to_dict().get("obstacles", [])]}


def last_link(scene: vff.Scenario) -> str:
    joints = scene.arm.to_dict().get("joints")
    return str(joints[-1]["link"]) if joints else f"link_{scene.arm.n}"


def _ignored(scene: vff.Scenario) -> Changes:
    """The last link, and what it carries, may touch everything."""
    return _of_each(scene, {"ignore": [last_link(scene), "load"]})


def _margins(scene: vff.Scenario) -> Changes:
    """The last link comes near to everything, and others keep away."""
    return _of_each(scene, {"margin": 0.05, "margins": {last_link(scene): 0.005}})


def _futures(scene: vff.Scenario) -> Changes:
    """What is there may also come to where the arm is at first, in a second, or go away."""
    given = scene.to_dict().get("obstacles", [])
    if not given:
        return {}
    first, size = given[0], scene.arm.dimension
    begin = np.asarray(first.get("position", [0.0] * size), dtype=float)
    end = scene.arm.forward_kinematics(scene["q0"])[-1][:size]
    kept = {key: each for key, each in first.items() if key not in ("motion", "contact")}
    made = []
    for likelihood, towards in ((0.4, 1.0), (0.05, -1.0)):
        there = (begin + towards * (end - begin)).tolist()
        motion = {"kind": "waypoints", "times": [0.0, 1.0], "points": [begin.tolist(), there]}
        made.append(kept | {"motion": motion, "likelihood": likelihood})
    return {"obstacles": [*given, *made]}


def _ahead_of(scene: vff.Scenario) -> list[float]:
    """What the end effector looks at where it begins, half of the arm's length away."""
    place, turned = scene.arm.pose(scene["q0"])
    if scene.arm.dimension == 2:
        front = np.array([np.cos(turned), np.sin(turned)])
    else:
        front = rotation(np.array(turned))[:, 2]
    ahead: list[float] = (place + 0.5 * np.linalg.norm(place) * front).tolist()
    return ahead


def _solid(scene: vff.Scenario, **contact: Any) -> Changes:
    """Obstacles that are felt."""
    return _of_each(scene, {"contact": contact})


def _order(scene: vff.Scenario) -> Changes:
    """All parts of the task that there are, one after the other."""
    turns = {
        "position": [],
        "pointing": ["orientation"],
        "pose": _of_dimension(scene, ["orientation"], ["turn", "orientation"]),
    }
    task = scene.to_dict()["controller"].get("task", "position")
    return {"controller.yielding.order": [*turns[task], "approach", "position"]}


def _cloud(scene: vff.Scenario) -> Changes:
    """Balls as clouds of points on a spiral, a few centimetres apart."""
    obstacles = [dict(each) for each in scene.to_dict().get("obstacles", [])]
    for each in obstacles:
        if each["shape"]["kind"] == "sphere":
            inner = each["shape"]["radius"] - 0.01
            count = max(12, round(4 * np.pi * inner**2 / 0.03**2))
            height = 1 - (2 * np.arange(count) + 1) / count
            angle = 2.399963 * np.arange(count)
            ring = np.sqrt(1 - height**2)
            points = inner * np.stack([ring * np.cos(angle), ring * np.sin(angle), height], axis=1)
            each["shape"] = {"kind": "points", "points": points.tolist(), "radius": 0.01}
    return {"obstacles": obstacles}


def _smooth(scene: vff.Scenario, foreseen: bool = False) -> Changes:
    """What moves does so along smooth way points, ten a second; balls turn back and forth meanwhile."""
    document = scene.to_dict()
    obstacles = [dict(each) for each in document.get("obstacles", [])]
    times = np.linspace(0.0, document["duration"], max(2, round(10 * document["duration"])))
    for each in obstacles:
        motion = each.get("motion", {"kind": "static"})
        if motion["kind"] == "linear":
            way = times[:, None] * np.array(motion["velocity"])
        elif motion["kind"] == "sinusoid":
            angle = motion["angular_frequency"] * times + motion.get("phase", 0.0)
            way = np.sin(angle)[:, None] * np.array(motion["amplitude"])
        else:
            continue
        points = np.array(each.get("position", [0.0] * scene.arm.dimension)) + way
        made = {
            "kind": "waypoints",
            "interpolation": "smooth",
            "foreseen": foreseen,
            "times": times.tolist(),
            "points": points.tolist(),
        }
        if each["shape"]["kind"] in ("circle", "sphere") and "angular_velocity" not in each:
            swing = 0.2 * np.sin(times)
            if scene.arm.dimension == 2:
                made["angles"] = swing.tolist()
            else:
                made["orientations"] = [[float(np.cos(a)), 0.0, float(np.sin(a)), 0.0] for a in swing]
        each.update(position=points[0].tolist(), motion=made)
    return {"obstacles": obstacles}


def _boxes(scene: vff.Scenario) -> Changes:
    """Links as boxes within their capsules."""
    bodies = []
    for body in scene.arm.to_dict()["collision"]:
        shape = body["shape"]
        if shape["kind"] == "capsule":
            a, b = np.array(shape["a"]), np.array(shape["b"])
            axis, long = b - a, float(np.linalg.norm(b - a))
            turn = np.cross([0.0, 0.0, 1.0], axis / long) if long > 0 else np.zeros(3)
            half = 0.5 * np.arctan2(np.linalg.norm(turn), axis[2] / long if long > 0 else 1.0)
            about = turn / np.linalg.norm(turn) if np.linalg.norm(turn) > 1e-9 else np.array([1.0, 0.0, 0.0])
            thick = 1.3 * shape["radius"]
            shape = {
                "kind": "box",
                "center": ((a + b) / 2).tolist(),
                "size": [thick, thick, long + thick],
                "orientation": [float(np.cos(half)), *(np.sin(half) * about).tolist()],
            }
        bodies.append(body | {"shape": shape})
    return {"arm.collision": bodies}


def _pausing(scene: vff.Scenario) -> Changes:
    """A plan that rests in its middle."""
    reference = scene.to_dict()["reference"]
    if reference["kind"] != "plan":
        return {}
    k = len(reference["times"]) // 2
    twice = {
        f"reference.{key}": [*reference[key][: k + 1], *reference[key][k:]]
        for key in ("points", "margins", "shares")
        if key in reference
    }
    later = [time + 0.5 for time in reference["times"][k:]]
    return {"reference.times": [*reference["times"][: k + 1], *later], **twice}


_CAMERAS = [
    {"position": [1.5, 0.0, 1.5], "orientation": [0.27, -0.65, -0.65, 0.27]},
    {"position": [-1.0, -1.5, 1.5], "orientation": [0.65, -0.75, 0.1, -0.1]},
]
_CARRIED = {"kind": "box", "size": [0.1, 0.1, 0.1], "orientation": [0.92, 0.3, 0.2, 0.15]}
_UNKNOWN = "what the interface of "
_PICTURES = 'it needs kind = "depth"'
_NO_STOPS = "needs `arm.joint_limits`"

OPTIONS: dict[str, Option] = {
    "torque rate": Option(lambda _: {"controller.command.torque_rate": RATE}, yields_less=True),
    "of the robot": Option(lambda _: {"controller.command": "of the robot"}, _UNKNOWN, yields_less=True),
    "gravity by the robot": Option(lambda _: {"controller.command.gravity": "robot"}),
    "tip speed": Option(lambda _: {"controller.command.tip_speed": 0.5}, yields_less=True),
    "friction": Option(lambda _: {"plant.coulomb_friction": 0.5, "plant.viscous_friction": 0.5}, exact=False),
    "friction, compensated": Option(
        lambda _: {"plant.coulomb_friction": 0.5, "controller.command.coulomb_friction": 0.4}, exact=False
    ),
    "noise": Option(
        lambda _: {"measurement.position_noise": 1e-5, "measurement.velocity_noise": 2e-3}, exact=False
    ),
    "delay": Option(lambda _: {"measurement.delay": 0.002}, exact=False),
    "lag": Option(lambda _: {"actuator.time_constant": 0.002}, exact=False),
    "range sensors": Option(
        lambda _: {"perception.kind": "range", "perception.rate": 100, "perception.latency": 0.01},
        (_PICTURES,),
        exact=False,
    ),
    "cameras": Option(
        lambda _: {"perception.kind": "camera", "perception.rate": 30, "perception.cameras": _CAMERAS},
        ("depth cameras belong to arms in space", _PICTURES),
        exact=False,
    ),
    "pictures": Option(
        lambda _: {
            "perception.kind": "depth",
            "perception.rate": 30,
            "perception.range": 3.0,
            "perception.latency": 0.03,
            "perception.clock_error": 0.01,
            "perception.noise": 0.002,
            "perception.grazing": 0.1,
            "perception.position_error": 0.005,
            "perception.cameras": _CAMERAS,
            "perception.perceiver": {"voxel": 0.05, "stride": 1, "least_points": 1, "most_voxels": 1500},
        },
        ("depth cameras belong to arms in space",),
        exact=False,
    ),
    "smooth motion": Option(_smooth),
    "foreseen": Option(lambda scene: _smooth(scene, foreseen=True)),
    "governor": Option(lambda _: {"controller.governor": {}}),
    "replanning": Option(
        lambda _: {"replan": {}},
        ("needs a reference that comes to rest", "needs obstacles that are known", "slides without an end"),
    ),
    "replanning upright": Option(
        lambda _: {"replan": {"tilt": 0.5, "acceleration": 2.0, "jerk": 50.0}},
        (
            "needs a reference that comes to rest",
            "needs obstacles that are known",
            "slides without an end",
            "as the end effector leans by",
        ),
    ),
    "replanning in view": Option(
        lambda scene: {"replan": {"view": _ahead_of(scene), "view_angle": 1.0}},
        (
            "needs a reference that comes to rest",
            "needs obstacles that are known",
            "slides without an end",
            "has the point out of its axis by",
        ),
    ),
    "rest on the way": Option(_pausing, ("needs a plan without rests on the way",)),
    "order": Option(_order),
    "self-collision": Option(lambda _: {"controller.self_collision": "avoid"}, yields_less=True),
    "observer": Option(
        lambda _: {"controller.observer": {"detection": {}}, "controller.touch": {"task": "reject"}}
    ),
    "reaction": Option(
        lambda _: {"controller.observer": {"detection": {}}, "controller.touch": {"reaction": {}}},
        ("is not for a tip that presses",),
    ),
    "stop": Option(
        lambda _: {
            "controller.observer": {"detection": {}},
            "controller.touch": {"reaction": {"force": 5.0, "stop": 5.0}},
        },
        ("is not for a tip that presses",),
    ),
    "payload, observed": Option(
        lambda scene: {
            "plant.payload": _of_dimension(scene, 0.3, {"mass": 0.5}),
            "controller.observer": {"detection": {}},
            "controller.touch": {"task": "reject"},
        },
        exact=False,
    ),
    "wrench": Option(
        lambda scene: {
            "wrenches": [{"link": "tip", "force": [5.0] * scene.arm.dimension, "start": 0.2, "duration": 0.5}]
        },
        exact=False,
    ),
    "tank": Option(lambda _: {"controller.tank": {"capacity": 2.0}}, yields_less=True),
    "no projection": Option(lambda _: {"controller.projection": "none"}, yields_less=True),
    "extended Jacobian": Option(lambda _: {"controller.formulation": "extended_jacobian"}),
    "predictor": Option(lambda _: {"simulation.control": "predictor"}),
    "long period": Option(lambda _: {"simulation.dt": 0.004}, yields_less=True),
    "two steps a period": Option(lambda _: {"simulation.dt": 0.0005, "simulation.control_every": 2}),
    "deadline": Option(lambda _: {"controller.deadline": 1.0}, yields_less=True),  # nothing is foreseen
    "deadline, generous": Option(lambda _: {"controller.deadline": 200.0}, yields_less=True),
    "stops repel": Option(
        lambda _: {"controller.joint_limit_field": {"kind": "bounded", "gain": 10.0, "influence": 0.3}},
        _NO_STOPS,
    ),
    "felt": Option(_solid, exact=False),
    "ignored": Option(_ignored, ("needs obstacles that are known",)),
    "margins": Option(_margins, ("needs obstacles that are known",)),
    "futures": Option(_futures, ("look-ahead alone sees", "needs obstacles that are known")),
    "unseen": Option(lambda scene: _solid(scene, seen=False), exact=False),
    "clouds": Option(_cloud),
    "load": Option(
        lambda scene: _of_dimension(scene, {}, {"arm.load": {"mass": 0.5, "shapes": [_CARRIED]}}),
        yields_less=True,  # what comes near the hand meets it
    ),
    "boxes on links": Option(lambda scene: _boxes(scene) if scene.arm.dimension == 3 else {}),
    "Runge-Kutta": Option(lambda _: {"simulation.integrator": "rk4"}),
    "Euler": Option(lambda _: {"simulation.integrator": "semi_implicit_euler"}),
    "force": Option(
        lambda scene: {
            "controller.observer": {"detection": {}},
            "controller.touch.force": {
                "direction": _of_dimension(scene, [0.0, -1.0], [0.0, 0.0, -1.0]),
                "target": 5.0,
            },
            "controller.touch.reaction": None,  # would give way to what it presses on
        },
        ("has no look-ahead", "is not for a tip that presses"),
        exact=False,
    ),
}


@cache
def base(name: str) -> vff.Scenario:
    """A bundled scene, sampled, with limits, until just after the obstacles would have come nearest."""
    scene = vff.Scenario.load(name)
    document = scene.to_dict()
    changes: Changes = {"simulation.record_every": 1}
    if document["simulation"]["control"] == "continuous":
        changes["simulation.control"] = "hold"
    pushed = {"controller.avoidance": "null_space"}
    free = vff.simulate(scene.replace(**changes), pushed | {"controller.field.gain": 0.0})
    nearest = free.t[np.argmin(np.nanmin(free.clearance, axis=1))] if free.clearance.size else 0.0
    changes["duration"] = float(np.clip(nearest + 0.3, 1.0, min(2.5, document["duration"])))
    if scene.arm.torque_limits is None:  # twice of what it takes
        usual = vff.simulate(scene.replace(**changes), pushed)
        changes["arm.torque_limits"] = (2 * np.abs(usual.tau).max(axis=0) + 1).tolist()
        changes["arm.velocity_limits"] = (2 * np.abs(usual.dq).max(axis=0) + 0.5).tolist()
    return scene.replace(**changes)


def merged(parts: Sequence[Changes]) -> Changes | None:
    """All of them; None where two say something of the same."""
    out: Changes = {}
    for part in parts:
        for key, value in part.items():
            if any(key == k or key.startswith(f"{k}.") or k.startswith(f"{key}.") for k in out):
                return None
            out[key] = value
    return out


def is_refusal(sentence: str, options: Sequence[str]) -> bool:
    """Whether it says what scenes are refused with that cannot have one of these options."""
    return any(part in sentence for each in options for part in OPTIONS[each].refused)


def combined(name: str, way: str, options: Sequence[str]) -> vff.Scenario | str | None:
    """The scene with them; a sentence where it is refused, None where two of them are about the same."""
    scene = base(name)
    changes = merged([WAYS[way], *(OPTIONS[each].changes(scene) for each in options)])
    if changes is None:
        return None
    if scene.to_dict()["controller"].get("yielding", {}).get("preview") is None:
        changes = {key: value for key, value in changes.items() if value is not None}
    try:
        return scene.replace(**changes)
    except ScenarioError as error:
        return str(error)


OTHER_DRAWS = range(1, 6)
"""Seeds for a look-ahead that has found no way out: it draws candidates, and another draw may find one."""


def gets_out(scene: vff.Scenario) -> bool:
    """Whether look-ahead finds a way out of a trap with one of the other draws."""
    if scene.to_dict()["controller"].get("yielding", {}).get("preview") is None:
        return False
    draws = (vff.simulate(scene.replace(seed=seed)) for seed in OTHER_DRAWS)
    return any(np.nanmin(kept_apart(each)) >= 0 for each in draws)


MAY_BE_INFINITE = {"clearance", "self_clearance", "sensed", "contact_threshold", "touched_link"}


def kept_apart(result: vff.Result) -> NDArray[np.float64]:
    """The clearances of the links that are to touch nothing: a hand that presses is to touch."""
    presses = result.scenario.to_dict()["controller"].get("touch", {}).get("force") is not None
    return result.clearance[:, :-1] if presses else result.clearance


def faults(result: vff.Result, options: Sequence[str], alone: vff.Result) -> Iterator[str]:
    """What does not hold in a run with some options; `alone` is the one without them."""
    document, arm, metrics = result.scenario.to_dict(), result.scenario.arm, result.metrics
    exact = all(OPTIONS[each].exact for each in options)
    # -- whatever is on
    for quantity, values in result.recorded().items():
        if quantity == "q_plan" and document["reference"]["kind"] != "plan":
            taken = [search.taken for search in result.replans if search.taken is not None]
            if (np.isfinite(values).all(axis=1) != (result.t > min(taken, default=np.inf))).any():
                yield "q_plan is not there from the first plan on"
        elif quantity not in MAY_BE_INFINITE and not np.isfinite(values).all():
            yield f"{quantity} is not finite"
    if result.status not in ("completed", "collided"):
        yield f"{result.status}: {result.message}"
    sent = result.tau if result.tau_applied is None else result.tau_applied
    command = document["controller"].get("command", {})
    torque = np.abs(result.tau) / arm.torque_limits
    if torque.max() > 1 + 1e-9:
        yield f"{torque.max():.4g} of a torque limit"
    if command and "lag" not in options and "friction, compensated" not in options:
        own_weight = "robot" if document["arm"].get("model") != "gen3" else "controller"
        by_robot = (own_weight if command == "of the robot" else command.get("gravity")) == "robot"
        own = sent - np.array([arm.gravity_torque(q) for q in result.q]) if by_robot else sent
        if (np.abs(own) / arm.torque_limits).max() > 1 + 1e-9:
            yield f"{(np.abs(own) / arm.torque_limits).max():.4g} of a torque limit is sent"
        period = document["simulation"].get("control_every", 1) * (result.t[1] - result.t[0])
        rate = np.abs(np.diff(own, axis=0)).max() / period
        if "torque rate" in options and rate > RATE * (1 + 1e-6):
            yield f"{rate:.6g} N·m/s are sent"
    # -- honest
    speed = np.abs(result.dq) / arm.velocity_limits
    if abs(metrics["velocity_limit_ratio"] - speed.max()) > 0.02 * speed.max() + 1e-3:
        yield f"speed {speed.max():.4g} of its limit, told as {metrics['velocity_limit_ratio']:.4g}"
    if speed.max() > 1.01 and result.headline.severity == "good":
        yield "a limit of speed is exceeded, and the headline is good"
    clearance = kept_apart(result)
    if metrics["intrusion_link"] == arm.n - 1:
        clearance = result.clearance  # a hand that presses is in something else
    least = np.nanmin(clearance) if clearance.size else np.inf
    if (least < -1e-9) != (result.status == "collided") and abs(least) > 1e-9:
        yield f"{result.status} with a least clearance of {1e3 * least:.3g} mm"
    # -- as far as the controller knows what is, the motors can brake, and no stop strikes a joint
    if exact and metrics["joint_limit_time"] is not None:
        yield f"a joint comes to its stop after {metrics['joint_limit_time']:.4g} s"
    free = torque.max() < 0.999 and metrics["joint_limit_time"] is None
    if exact and free and speed.max() > 1.01:
        yield f"{speed.max():.4g} of a speed limit"
    may_touch = any(OPTIONS[each].yields_less for each in options)
    before = alone.metrics["min_clearance"]
    is_hit = before is not None and before > 0.005 and least < 0
    if exact and not may_touch and is_hit and not gets_out(result.scenario):
        yield f"{1e3 * least:.3g} mm into an obstacle, {1e3 * before:.3g} mm without the options"


def main() -> int:
    """Random sets of options for every scene and way."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("options", type=int, help="how many options at a time; 1 runs every one of them")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--sets", type=int, default=8, help="how many sets for each scene and way")
    parser.add_argument("--scenes", nargs="*", default=list(vff.scenarios()))
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    draw, found, runs = random.Random(given.seed), 0, 0
    for name in given.scenes:
        for way in WAYS:
            alone = combined(name, way, ())
            if (name, way) in NOT_TOGETHER:
                continue
            assert isinstance(alone, vff.Scenario), alone
            without = vff.simulate(alone)
            names = list(OPTIONS)
            sets = (
                [(each,) for each in names]
                if given.options == 1
                else [tuple(draw.sample(names, given.options)) for _ in range(given.sets)]
            )
            for options in [(), *sets]:
                scene = combined(name, way, options)
                if isinstance(scene, str):
                    told = [] if is_refusal(scene, options) else [f"refused: {scene}"]
                elif scene is None:
                    continue
                else:
                    told = list(faults(vff.simulate(scene), options, without))
                    runs += 1
                for fault in told:
                    found += 1
                    print(f"{name}, {way}, {' + '.join(options) or 'alone'}: {fault}", flush=True)
    print(f"{found} faults in {runs} runs")
    return min(found, 1)


if __name__ == "__main__":
    sys.exit(main())
