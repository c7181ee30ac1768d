"""Contacts that nobody foresaw are told from everything else, and yielded to in order (docs/theory.md, T166
to T169); what the controller does not see is felt alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.errors import InputError, ScenarioError

Array = np.ndarray[Any, np.dtype[np.float64]]

EVERY = {"simulation.record_every": 1}
DETECTED: dict[str, Any] = {"controller.observer": {"detection": {}}}
REACTING: dict[str, Any] = {"controller.touch.reaction": {}}
BUMP = vff.Scenario.load("panda-bump").replace(**EVERY)
LEAN = vff.Scenario.load("panda-lean").replace(
    wrenches=None,
    obstacles=[],
    **EVERY,
    **{"controller.observer": {"bandwidth": 100.0, "detection": {}}, "controller.touch": {}},
)
ELBOW, HAND = "panda_link4", "tip"


def push(link: str, force: list[float], start: float = 1.0, duration: float = 1.0) -> dict[str, Any]:
    return {"wrenches": [{"link": link, "force": force, "start": start, "duration": duration}]}


def felt(result: vff.Result) -> Array:
    """Whether a contact is felt (T,)."""
    assert result.touched_link is not None
    return np.isfinite(result.touched_link)


def heavier(scenario: vff.Scenario, random: np.random.Generator, by: float) -> dict[str, Any]:
    """Masses of all links that are off by up to that share, each by its own."""
    masses = scenario.arm.masses
    return {"plant.masses": (masses * (1.0 + by * random.uniform(-1.0, 1.0, masses.size))).tolist()}


@pytest.mark.parametrize("link", [ELBOW, "panda_link6", HAND])
def test_five_newtons_are_felt_within_five_milliseconds(link: str) -> None:
    """In whatever direction, unless it is one in which no joint feels more than 0.7 N·m of it."""
    random, seen = np.random.default_rng(1), 0
    for _ in range(12):
        force = random.normal(size=3)
        force *= 5.0 / np.linalg.norm(force)
        result = vff.simulate(LEAN, push(link, force.tolist()) | {"duration": 1.1})
        assert result.tau_ext is not None
        if np.abs(result.tau_ext[1000]).max() < 0.7:
            continue
        seen += 1
        first = result.t[np.argmax(felt(result))]
        assert 1.0 < first < 1.0051, (first, force)
    assert seen >= 6


def test_the_link_is_the_last_that_feels_it() -> None:
    """Of a lasting push on several links; on the last one the line of action follows."""
    last = {}
    for link in ("panda_link3", ELBOW, "panda_link6", HAND):
        changes = push(link, [4.0, 9.0, -3.0]) | {"duration": 1.6, "controller.touch.reaction": None}
        result = vff.simulate(LEAN, changes)
        assert result.touched_link is not None
        last[link] = int(result.touched_link[-1])
    assert last["panda_link3"] <= 2 and last[ELBOW] <= 3 <= last["panda_link6"] <= 5 <= last[HAND], last
    wrench = result.wrench_estimate
    assert wrench is not None
    force, torque = wrench[-1, :3] - wrench[900, :3], wrench[-1, 3:] - wrench[900, 3:]
    np.testing.assert_allclose(force, [4.0, 9.0, -3.0], atol=0.05)
    assert np.linalg.norm(np.cross(force, torque)) / (force @ force) < 2e-3  # m, from the tip


@pytest.mark.parametrize("name", ["panda-sweep", "gen3-circle", "iiwa-line", "ur5e-sweep", "panda-shelf"])
def test_five_per_cent_of_the_model_are_no_contact(name: str) -> None:
    """Links that are up to 5 % heavier or lighter, each for itself, and noise of encoders, in motion."""
    scenario, random = vff.Scenario.load(name), np.random.default_rng(2)
    noise = {"measurement": {"position_noise": 1e-5, "velocity_noise": 1e-3}}
    for more in ({}, noise, {}):
        run = DETECTED | heavier(scenario, random, 0.05) | {"simulation.control": "hold"} | more | EVERY
        result = vff.simulate(scenario, run)
        assert result.tau_ext_estimate is not None
        assert not felt(result).any(), (result.t[np.argmax(felt(result))], result.touched_link)


def test_with_the_model_off_a_push_is_felt_still() -> None:
    random = np.random.default_rng(3)
    for _ in range(5):
        changes = push(ELBOW, [0.0, 8.0, 0.0]) | heavier(LEAN, random, 0.05) | {"duration": 2.5}
        result = vff.simulate(LEAN, changes)
        assert not felt(result)[result.t < 1.0].any()
        assert felt(result)[(result.t > 1.01) & (result.t < 2.0)].all()
        assert not felt(result)[result.t > 2.3].any()


def test_friction_that_is_told_is_no_contact() -> None:
    """A joint that turns round changes its friction by twice that."""
    rough = {"plant.coulomb_friction": 0.3, "duration": 4.0}
    told = DETECTED | {"controller.observer.threshold": 0.3}
    assert not felt(vff.simulate("gen3-circle", rough | told | EVERY)).any()


def test_first_the_null_space_yields() -> None:
    """A light push on the elbow moves that alone, further than it would have, and the hand goes on."""
    light = push(ELBOW, [0.0, 12.0, 0.0], duration=2.0) | {"duration": 8.0}
    yields, springs = (vff.simulate(LEAN, light | more) for more in (REACTING, {}))
    assert yields.yielded is not None and yields.yielded.max() == 0.0

    def elbow(result: vff.Result) -> Array:
        places: Array = result.scenario.arm.link_poses(result.q)[:, 3, 1, 3]
        return places - places[0]

    assert elbow(yields).max() > 1.3 * elbow(springs).max() > 0.02
    assert abs(elbow(yields)[-1]) < 0.01
    np.testing.assert_allclose(yields.error[:, :3], springs.error[:, :3], atol=2e-3)
    assert yields.metrics["end_error"] < 1e-4


def test_then_the_task_gives_way_along_the_push() -> None:
    """It holds against it with little more than `force`, and comes back afterwards, without a jump."""
    direction = np.array([0.8, 0.6, 0.0])
    hard = push(HAND, (20.0 * direction).tolist(), duration=0.5) | {"duration": 8.0}
    result = vff.simulate(LEAN, hard | {"controller.touch.reaction": {"force": 8.0}})
    assert result.yielded is not None
    held = vff.simulate(LEAN, hard)
    off = result.error[:, :3] @ direction
    assert off.max() > 3.0 * (held.error[:, :3] @ direction).max()
    across = result.error[:, :3] - np.outer(off, direction)
    assert np.linalg.norm(across, axis=1).max() < 0.25 * off.max()
    assert result.metrics["end_error"] < 2e-3
    assert np.abs(np.diff(result.tau, axis=0)).max() < 0.5  # N·m in a millisecond; a Franka accepts 1


CIRCLE = {
    "reference": {
        "kind": "circle",
        "center": [0.08, 0.0, 0.0],
        "radius": 0.08,
        "angular_velocity": 1.0,
        "phase": np.pi,
        "relative": True,
    }
}


def test_then_the_task_stops_and_goes_on_afterwards() -> None:
    """A push across the way of the hand: with `stop` it stands until that is over, moved by the push alone;
    without, it goes on with its circle meanwhile.
    """
    hard = push(HAND, [0.0, 0.0, 20.0]) | CIRCLE | {"duration": 8.0}
    reacts = {"controller.touch.reaction": {"force": 8.0}}
    stops = vff.simulate(LEAN, hard | reacts | {"controller.touch.reaction": {"force": 8.0, "stop": 10.0}})
    goes_on = vff.simulate(LEAN, hard | reacts)
    during = (stops.t > 1.5) & (stops.t < 2.0)
    along = [np.linalg.norm(result.dx[during, :2], axis=1) for result in (stops, goes_on)]
    assert along[0].max() < 2e-3 and along[1].min() > 0.06
    np.testing.assert_allclose(stops.error[during, 3:], goes_on.error[during, 3:], atol=0.02)
    assert stops.metrics["stopped_time"] == pytest.approx(1.1, abs=0.1)
    assert goes_on.metrics["stopped_time"] is None
    assert "the task stopped for 1" in str(stops.headline)
    assert stops.metrics["end_error"] < 2e-3
    jumps = [np.abs(np.diff(result.tau, axis=0)).max() for result in (stops, goes_on)]
    assert jumps[0] < 1.01 * jumps[1] < 1.0  # N·m in a millisecond, which a Franka accepts
    gentle = vff.simulate(
        LEAN, push(HAND, [0.0, 0.0, 6.0]) | CIRCLE | {"controller.touch.reaction.stop": 15.0}
    )
    assert gentle.metrics["stopped_time"] == 0.0


def test_a_turning_task_keeps_its_place_while_it_is_stopped() -> None:
    """However far the reference has turned on; it catches up afterwards."""
    turning = vff.Scenario.load("iiwa-line")
    settings = {
        "controller.observer": {"bandwidth": 100.0, "detection": {}},
        "controller.touch": {"reaction": {"force": 10.0, "stop": 10.0}},
        "simulation.control": "hold",
        "obstacles": [],
        "duration": turning.duration + 8.0,
    }
    result = vff.simulate(turning, push(HAND, [0.0, 0.0, 25.0], start=1.0) | settings | EVERY)
    during = (result.t > 1.5) & (result.t < 2.0)
    turned = 2.0 * np.arccos(
        np.clip(np.abs(result.orientation[during] @ result.orientation[during][0]), 0.0, 1.0)
    )
    reference = 2.0 * np.arccos(
        np.clip(abs(result.orientation_ref[2000] @ result.orientation_ref[1500]), 0.0, 1.0)
    )
    assert turned.max() < 0.2 * reference, (turned.max(), reference)
    assert result.metrics["end_error"] < 2e-3 and result.metrics["end_orientation_error"] < 2e-3


def test_a_load_is_held_while_a_push_is_yielded_to() -> None:
    """What is rejected is what has been there: with `reject` alone the hand would stand like a post."""
    loaded = {"plant.payload": {"mass": 0.5}, "controller.touch": {"task": "reject", "null_space": "reject"}}
    hard = push(HAND, [0.0, 40.0, 0.0], start=2.0) | loaded | {"duration": 10.0}
    stands = vff.simulate(LEAN, hard)
    yields = vff.simulate(LEAN, hard | REACTING)
    before, during = (stands.t > 1.5) & (stands.t < 2.0), (stands.t > 2.5) & (stands.t < 3.0)
    for result in (stands, yields):
        assert np.abs(result.error[before, :3]).max() < 2e-4
        assert result.metrics["end_error"] < 2e-3
    assert np.abs(stands.error[during, 1]).max() < 2e-3
    assert np.abs(yields.error[during, 1]).max() > 1e-2


def test_an_impact_is_answered_in_time() -> None:
    """A body of 75 N/mm comes at a forearm at 0.3 m/s, unseen: it is felt long before there are 150 N."""
    body = (
        vff.Obstacle.sphere([0.03, 0.3, 0.66], 0.1, vff.Motion.linear([0.0, -0.3, 0.0]))
        .with_contact(stiffness=7.5e4, damping=0.0, friction=0.0, seen=False)
        .to_dict()
    )
    result = vff.simulate(LEAN, REACTING | {"obstacles": [body], "duration": 1.5})
    assert result.contact_force is not None
    force = np.linalg.norm(result.contact_force[:, 0], axis=1)
    first, answered = int(np.argmax(force > 0.0)), int(np.argmax(felt(result)))
    assert first > 300 and 0 < answered - first <= 5, (first, answered)
    assert force[: answered + 1].max() < 100.0


def test_panda_bump() -> None:
    """It bumps into the box, the elbow yields, the hand goes on, and all comes back."""
    result = vff.simulate(BUMP)
    assert result.contact_force is not None and result.yielded is not None
    force = np.linalg.norm(result.contact_force[:, 0], axis=1)
    first, answered = int(np.argmax(force > 0.0)), int(np.argmax(felt(result)))
    assert result.status == "collided"
    assert first > 500 and 0 <= answered - first <= 10
    assert force.max() < 150.0
    elbow, hand = (result.t > 1.0) & (result.t < 4.0), (result.t > 5.4) & (result.t < 7.5)
    off = np.linalg.norm(result.error[:, :3], axis=1)
    assert off[elbow].max() < 1e-3 and result.yielded[elbow].max() == 0.0
    assert 0.1 < off[hand].max() < 0.25 and force[hand].max() < 35.0
    assert result.metrics["stopped_time"] == pytest.approx(0.84, abs=0.2)  # at the hand alone
    assert result.metrics["end_error"] < 2e-3 and not felt(result)[result.t > 7.0].any()
    assert result.headline.verdict == "collided"
    assert "a contact was felt on panda_link" in str(result.headline)
    holds = vff.simulate(BUMP, {"controller.touch.reaction": None})
    assert holds.contact_force is not None
    assert np.linalg.norm(holds.contact_force[hand, 0], axis=1).max() > 3.0 * force[hand].max()
    told = vff.simulate(BUMP, {"obstacles.0.contact.seen": True})
    assert told.contact_force is not None and not told.contact_force[elbow].any()  # it is avoided there


def test_panda_bump_in_mujoco() -> None:
    """With its dynamics and contacts: both bumps are felt as soon, and as hard within a fifth."""
    pytest.importorskip("mujoco")
    ours, theirs = (vff.simulate(BUMP, plant=plant) for plant in ("core", "mujoco"))
    forces = []
    for result in (ours, theirs):
        assert result.contact_force is not None and result.yielded is not None
        force = np.linalg.norm(result.contact_force[:, 0], axis=1)
        first, answered = int(np.argmax(force > 0.0)), int(np.argmax(felt(result)))
        assert first > 500 and 0 <= answered - first <= 10
        elbow, hand = (result.t > 1.0) & (result.t < 4.0), (result.t > 5.4) & (result.t < 7.5)
        forces.append((force[elbow].max(), force[hand].max(), result.yielded.max()))
        assert result.metrics["end_error"] < 2e-3
    np.testing.assert_allclose(forces[1], forces[0], rtol=0.2)


def test_with_links_that_are_off_it_bumps_once() -> None:
    """5 % heavier or lighter: nothing is felt before the box is there."""
    result = vff.simulate(BUMP, heavier(BUMP, np.random.default_rng(4), 0.05))
    assert result.contact_force is not None
    first = int(np.argmax(result.contact_force.any(axis=(1, 2))))
    assert 0 <= int(np.argmax(felt(result))) - first <= 20


@pytest.mark.parametrize("more", [{}, {"controller.avoidance": "cbf"}, {"simulation.control": "predictor"}])
def test_what_is_not_seen_changes_nothing_until_it_is_felt(more: dict[str, Any]) -> None:
    """Bit for bit the run in which it is far away."""
    there = vff.simulate(BUMP, more | {"duration": 3.0})
    elsewhere = {"obstacles.0.position": [9.0, 9.0, 9.0], "obstacles.0.motion": {"kind": "static"}}
    gone = vff.simulate(BUMP, more | elsewhere | {"duration": 3.0})
    assert there.contact_force is not None
    first = int(np.argmax(there.contact_force.any(axis=(1, 2))))
    assert first > 500
    np.testing.assert_array_equal(there.tau[:first], gone.tau[:first])
    np.testing.assert_array_equal(there.q[:first], gone.q[:first])
    assert (there.clearance[:first] <= gone.clearance[:first]).all()  # it is measured all the same


def test_nobody_is_told_of_what_is_not_seen() -> None:
    """Not the planner, not the rays of a sensor, not the controller of somebody else's loop."""
    box = BUMP.to_dict()["obstacles"][0] | {"motion": {"kind": "static"}, "position": [0.1, 0.3, 0.65]}
    sensed = {"perception": {"kind": "range", "range": 1.0}, "duration": 0.1}
    unseen = vff.simulate(BUMP, sensed | {"obstacles": [box]})
    seen = vff.simulate(BUMP, sensed | {"obstacles": [box | {"contact": {}}]})
    assert unseen.sensed is not None and not np.isfinite(unseen.sensed).any()
    assert seen.sensed is not None and np.isfinite(seen.sensed).any()

    shelf = vff.Scenario.load("panda-shelf")
    hand = shelf.arm.forward_kinematics(shelf["q0"])[-1].tolist()
    ball = {"shape": {"kind": "sphere", "radius": 0.2}, "position": hand}
    for contact, status in (({}, "start blocked"), ({"seen": False}, "found")):
        there = [*shelf.to_dict()["obstacles"], ball | {"contact": contact}]
        assert vff.plan(shelf.replace(obstacles=there), horizon=0.0).status == status


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"controller.touch.reaction": {}, "controller.observer": {}}, "controller.touch.reaction: needs"),
        ({"controller.observer": None}, "controller.touch: needs"),
        (
            {"controller.touch.force": {"direction": [0.0, 0.0, -1.0]}},
            "controller.touch.reaction: is not for a tip that presses",
        ),
        ({"controller.touch.reaction": {"force": 0.0}}, "controller.touch.reaction.force: must be"),
        (
            {"controller.touch.reaction": {"stop": 14.0}},
            "controller.touch.reaction.stop: must be at least `force`",
        ),
        ({"controller.touch.reaction": {"rate": -1.0}}, "controller.touch.reaction.rate: must be"),
        ({"controller.observer.detection.least": [0.1, 0.2]}, "controller.observer.detection.least"),
        ({"controller.observer.detection.memory": 0.0}, "controller.observer.detection.memory: must be"),
        ({"obstacles.0.contact.seen": "no"}, r"obstacles[0].contact"),
    ],
)
def test_what_does_not_fit_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        vff.simulate(BUMP, changes)
    assert message in str(caught.value)


def test_who_is_given_an_obstacle_sees_it() -> None:
    law = vff.Controller(BUMP.arm, {"task": "pose"})
    box = vff.Obstacle.box([0.1, 0.5, 0.6], [0.1, 0.1, 0.1]).with_contact(seen=False)
    assert box.to_dict()["contact"] == {"seen": False}
    with pytest.raises((ScenarioError, InputError), match="whoever is given one knows of it"):
        law.torque(BUMP["q0"], np.zeros(7), BUMP.arm.pose(BUMP["q0"]), obstacles=[box])
    seen = vff.Obstacle.box([0.1, 0.5, 0.6], [0.1, 0.1, 0.1])
    measured, same = (vff.distances(BUMP.arm, BUMP["q0"], np.zeros(7), [each]) for each in (box, seen))
    np.testing.assert_array_equal(measured.distance, same.distance)  # who measures does not have to see
