"""A tip that presses on a surface and moves along it (docs/theory.md, T158, T159): closed forms, the bundled
scene, contact that is lost and found again.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

import vffnull as vff
from vffnull.errors import ScenarioError

Array = np.ndarray[Any, np.dtype[np.float64]]

EVERY = {"simulation.record_every": 1}
WIPE = vff.Scenario.load("panda-wipe").replace(**EVERY)
TARGET = 10.0  # N


def pressed(result: vff.Result) -> Array:
    """What the table answers upwards, of the plant [N], (T,)."""
    assert result.contact_force is not None
    force: Array = result.contact_force[:, 0, 2]
    return force


def felt(state: Any) -> float:
    """The same of one instant [N]."""
    return float(state.contact_force[0, 2])


def off(result: vff.Result, since: float) -> float:
    """By how much it is not what is wanted, at most, after a time [N]."""
    return float(np.abs(pressed(result) - TARGET)[result.t > since].max())


def table(*knots: tuple[float, float], **contact: float) -> dict[str, Any]:
    """The table of the scene, at these heights at these times."""
    document = WIPE.to_dict()["obstacles"]
    times, points = zip(*((t, [0.42, 0.0, 0.447 + z]) for t, z in knots), strict=True)
    document[0] |= {"motion": {"kind": "waypoints", "times": list(times), "points": list(points)}}
    document[0]["contact"] |= contact
    return {"obstacles": document}


def spectral_radius(stiffness: float, inertia: float, gains: tuple[float, ...], period: float) -> float:
    """Of a tip that presses on a spring through a torque that is held, with the observer of (T141)."""
    damping, bandwidth, gain, integral = gains
    spring = np.array([[0.0, 1.0, 0.0], [-stiffness / inertia, 0.0, 1.0], [0.0, 0.0, 0.0]])
    flow = expm(spring * period)[:2]
    force = np.array([0.0, -damping * inertia, -gain, 1.0])  # of depth, speed, estimate, integral
    step = np.zeros((4, 4))
    step[:2, :2] = flow[:, :2]
    step[:2] += np.outer(flow[:, 2], force / inertia)
    share = 1.0 - np.exp(-bandwidth * period)
    change = step[1] - [0.0, 1.0, 0.0, 0.0]
    step[2] = [0.0, 0.0, 1.0 - share, 0.0] + share * (force - inertia * change / period)
    step[3] = [0.0, 0.0, -integral * period, 1.0]
    return float(np.abs(np.linalg.eigvals(step)).max())


def test_gains_that_are_accepted_are_stable_on_every_surface() -> None:
    """Up to a stiffness of Λ/T², for any damping, bandwidth, period and inertia; others need not be."""
    random = np.random.default_rng(1)
    for _ in range(300):
        period = 10 ** random.uniform(-4.0, -2.3)
        bandwidth, damping = random.uniform(5.0, 0.5 / period, 2)
        gain = random.uniform() * 0.8 * damping / bandwidth
        integral = random.uniform() * 0.5 * (1.0 + gain) / (1.0 / damping + 1.0 / bandwidth)
        inertia = 10 ** random.uniform(-1.0, 1.5)
        stiffness = inertia / period**2 * 10 ** random.uniform(-6.0, 0.0)
        gains = (damping, bandwidth, gain, integral)
        assert spectral_radius(stiffness, inertia, gains, period) < 1.0, (gains, stiffness, inertia, period)
    assert spectral_radius(1e5, 4.0, (100.0, 80.0, 4.0, 10.0), 1e-3) > 1.0
    assert spectral_radius(1e3, 4.0, (100.0, 80.0, 0.5, 200.0), 1e-3) > 1.0


def test_panda_wipe() -> None:
    """10 ± 0.5 N on 10⁵ N/m along the circle, while the elbow makes way for the ball."""
    result = vff.simulate(WIPE)
    assert result.status == "completed" and result.headline.severity == "good"
    assert "but for what the tip presses on" in str(result.headline)
    assert result.warnings == ()
    first = result.t[np.argmax(pressed(result) > 0.0)]
    assert 0.15 < first < 0.35
    assert off(result, first + 0.5) < 0.5
    sideways = np.linalg.norm(result.error[:, :2], axis=1)
    assert sideways[result.t > first + 0.5].max() < 1e-3
    ball = np.linalg.norm(result.obstacles[:, 1], axis=1)
    assert ball.size and result.force.max() > 5.0
    assert np.ptp(result.q[result.t > first + 0.5, 2]) > 0.1  # the elbow swings
    blind = vff.simulate(WIPE, {"controller.field.gain": 0.0})
    links = slice(0, 6)  # without the one that presses
    assert np.nanmin(blind.clearance[:, links]) < np.nanmin(result.clearance[:, links]) - 0.02


def test_mujoco_is_wiped_as_well() -> None:
    """The same scene with its dynamics and contacts: 10 ± 0.5 N, and the forces differ by less than 0.1 N."""
    pytest.importorskip("mujoco")
    ours, theirs = (vff.simulate(WIPE, plant=plant) for plant in ("core", "mujoco"))
    assert theirs.status == "completed"
    first = theirs.t[np.argmax(pressed(theirs) > 0.0)]
    assert abs(first - ours.t[np.argmax(pressed(ours) > 0.0)]) < 5e-3
    assert off(theirs, first + 0.5) < 0.5
    late = ours.t > first + 0.5
    assert np.abs(pressed(theirs)[late] - pressed(ours)[late]).max() < 0.1
    assert np.abs(theirs.x[late] - ours.x[late])[:, :3].max() < 1e-4
    assert pressed(theirs).max() == pytest.approx(pressed(ours).max(), rel=0.1)  # where they meet


@pytest.mark.parametrize("stiffness", [1e3, 1e4, 1e6])
def test_whatever_the_surface_is(stiffness: float) -> None:
    changes = table((0.0, 0.0), (1.0, 0.0), stiffness=stiffness)
    assert off(vff.simulate(WIPE, changes), 2.0) < 0.5


def test_force_and_motion_do_not_disturb_each_other() -> None:
    """Four times the force on a smooth table leaves the motion along it as it is within 0.1 mm, and the
    motion the force: without the selection, 30 N are 8 mm of the impedance.
    """
    smooth = table((0.0, 0.0), (1.0, 0.0), friction=0.0)
    once, more = (vff.simulate(WIPE, smooth | {"controller.touch.force.target": f}) for f in (10.0, 40.0))
    late = once.t > 1.5
    np.testing.assert_allclose(more.x[late, :2], once.x[late, :2], rtol=0, atol=1e-4)
    resting = vff.simulate(WIPE, smooth | {"reference": {"kind": "setpoint"}})
    np.testing.assert_allclose(pressed(once)[late], pressed(resting)[late], atol=0.1)


def test_it_approaches_no_faster_than_it_may() -> None:
    """From wherever it is, at any force that is wanted; nothing is felt on the way."""
    for target in (10.0, 40.0):
        result = vff.simulate(WIPE, {"controller.touch.force.target": target, "duration": 2.0})
        before = pressed(result).cumsum() == 0.0
        speed = -result.dx[before, 2]
        assert 0.015 < speed.max() < 0.0202
        assert speed.min() > -1e-4


def test_without_a_surface_it_goes_as_far_as_it_may() -> None:
    changes = {"obstacles": [], "controller.touch.force.reach": 0.02, "duration": 4.0}
    result = vff.simulate(WIPE, changes)
    end = -result.error[-1, 2]
    assert 0.02 < end < 0.026
    assert abs(result.dx[-1, 2]) < 1e-4


def test_contact_is_lost_and_found_again_without_a_jump() -> None:
    """The table falls away by 15 mm and comes back: the torque changes by less than 1000 N·m/s, which a
    Franka accepts; the speed exceeds `approach` by what the force does until its loss is known.
    """
    changes = table((0.0, 0.0), (2.0, 0.0), (2.02, -0.015), (3.2, -0.015), (4.0, -0.005))
    result = vff.simulate(WIPE, changes)
    force, height = pressed(result), result.x[:, 2]
    lost = (force == 0.0) & (result.t > 1.5)
    assert lost.sum() > 300
    assert off(result, 5.0) < 0.5
    falling = -np.diff(height)[lost[1:]] / 1e-3
    assert falling.max() < 0.02 + TARGET / (np.e * 3.0 * 80.0)  # of 3 kg at least, at 80 1/s
    jump = np.abs(np.diff(result.tau, axis=0)).max(axis=1)
    assert jump.max() < 1.0


def test_a_reference_takes_it_off_and_back() -> None:
    """Where that lifts by more than `reach`, the tip leaves the table; it comes back with it."""
    start, _ = WIPE.arm.pose(WIPE["q0"])
    up = [0.0, 0.0, 0.06]
    reference = {
        "kind": "waypoints",
        "times": [0.0, 1.5, 2.5, 3.5, 4.5],
        "points": [
            start.tolist(),
            start.tolist(),
            (start + up).tolist(),
            (start + up).tolist(),
            start.tolist(),
        ],
    }
    result = vff.simulate(WIPE, {"reference": reference})
    force = pressed(result)
    assert (np.abs(force[(result.t > 1.2) & (result.t < 1.5)] - TARGET) < 0.5).all()
    assert (force[(result.t > 2.8) & (result.t < 3.4)] == 0.0).all()
    assert off(result, 6.0) < 0.5
    assert np.abs(np.diff(result.tau[1500:], axis=0)).max() < 0.5


def test_how_deep_a_surface_is_holds_nobody_up() -> None:
    """Along the way in which it presses the tip follows no reference: no clock waits, no plan is made."""
    reference = {"kind": "line", "end": [0.1, 0.0, -0.05], "duration": 2.0, "relative": True}
    changes = {"reference": reference, "duration": 4.0, "controller.governor": {}, "replan": {}}
    result = vff.simulate(WIPE, changes)
    assert abs(result.error[-1, 2]) > 0.04 and np.linalg.norm(result.error[-1, :2]) < 1e-3
    assert off(result, 3.0) < 0.5 and result.replans == ()
    assert result.path_time is not None and (result.t - result.path_time).max() < 1e-9


@pytest.mark.parametrize("way", ["null_space", "relaxed", "priority", "cbf"])
def test_with_every_way_of_giving_way(way: str) -> None:
    """The surface itself is given way to by none; with `cbf` all barriers are kept. `relaxed` lets go of the
    table where the wrist is near to it, unless that is later.
    """
    near = {"controller.yielding.inner": 0.04, "controller.yielding.outer": 0.12}
    later = near | {"controller.field.influence": 0.12} if way == "relaxed" else {}
    result = vff.simulate(WIPE, {"controller.avoidance": way} | later)
    assert result.status == "completed"
    assert off(result, 1.5) < 0.5
    if way == "cbf":
        assert result.metrics["slack_steps"] == 0
    for limit in ("torque_limit_ratio", "velocity_limit_ratio"):
        assert (result.metrics[limit] or 0.0) < 1.0


@pytest.mark.parametrize("way", ["null_space", "cbf"])
def test_behind_a_limit_of_the_torque_rate(way: str) -> None:
    """What is sent changes by no more than a Franka accepts, and the force is held."""
    result = vff.simulate(WIPE, {"controller.avoidance": way, "controller.command.torque_rate": 1000.0})
    assert result.tau_applied is not None
    assert np.abs(np.diff(result.tau_applied, axis=0)).max() <= 1.0 + 1e-9
    assert off(result, 1.5) < 0.5


def test_directions_of_the_tool_turn_with_it() -> None:
    """The hand looks down: its z axis is the way in which it presses."""
    world = vff.simulate(WIPE, {"duration": 3.0})
    tool = {"controller.touch.force.frame": "tool", "controller.touch.force.direction": [0.0, 0.0, 2.0]}
    turned = vff.simulate(WIPE, tool | {"duration": 3.0})
    late = world.t > 1.0
    np.testing.assert_allclose(pressed(turned)[late], pressed(world)[late], atol=0.05)


def test_a_measured_torque_takes_the_place_of_the_estimate() -> None:
    """With friction in the joints that the model does not know, the force is that of the surface still."""
    rough = {"plant.coulomb_friction": 0.3, "plant.viscous_friction": 0.3}
    measured = vff.simulate(WIPE, rough | {"controller.observer.source": "measured"})
    estimated = vff.simulate(WIPE, rough)
    late = measured.t > 1.5
    assert abs(pressed(measured)[late].mean() - TARGET) < 0.2
    assert off(measured, 1.5) < off(estimated, 1.5)


def test_a_loop_of_ones_own() -> None:
    """Cycle by cycle, with what is sent blended in and the plant somewhere else."""
    scene = WIPE.replace(duration=4.0)
    law = vff.Controller(scene.arm, scene["controller"])
    plant = vff.Simulation(scene)
    start = scene.arm.pose(scene["q0"])
    law.begin(1e-3)
    ball = scene.to_dict()["obstacles"]
    force = []
    for _ in range(3000):
        state = plant.state
        tau, phase = law.cycle(state.t, state.q, state.dq, start, obstacles=ball)
        force.append(felt(plant.step(tau)))
    assert phase == "running"
    assert np.abs(np.array(force[2000:]) - TARGET).max() < 0.5
    law.stop()
    while phase != "finished":
        state = plant.state
        tau, phase = law.cycle(state.t, state.q, state.dq, start, obstacles=ball)
        plant.step(tau)
    assert felt(plant.state) < 1.0  # an arm that is stopped presses no more


def test_a_loop_that_is_too_slow_does_not_begin() -> None:
    """The period of somebody else's loop is held against the same bounds as that of a scenario (T159)."""
    law = vff.Controller(WIPE.arm, WIPE["controller"])
    law.begin(5e-3)
    with pytest.raises(vff.errors.InputError, match=r"touch\.force\.damping: must be at most half"):
        law.begin(6e-3)
    quick = vff.Controller(WIPE.arm, WIPE["controller"] | {"observer": {"bandwidth": 150.0}})
    with pytest.raises(vff.errors.InputError, match=r"observer\.bandwidth: must be at most half"):
        quick.begin(4e-3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"controller.touch.force.direction": None}, "controller.touch.force.direction: "),
        ({"controller.touch.force.direction": [0.0, -1.0]}, "controller.touch.force.direction: "),
        ({"controller.touch.force.direction": [0.0, 0.0, 0.0]}, "controller.touch.force.direction: must be"),
        ({"controller.touch.force.target": 0.0}, "controller.touch.force.target: must be"),
        ({"controller.touch.force.gain": 1.1}, "controller.touch.force.gain: must be at most 0.8"),
        ({"controller.touch.force.integral": 40.0}, "controller.touch.force.integral: must be at most 0.5"),
        ({"controller.touch.force.damping": 600.0}, "controller.touch.force.damping: must be at most half"),
        (
            {"controller.observer.bandwidth": 600.0, "controller.touch.force.gain": 0.1},
            "controller.observer.bandwidth: ",
        ),
        (
            {"controller.avoidance": "cbf", "controller.yielding.preview": {}},
            "controller.touch.force: has no look-ahead",
        ),
        ({"controller.observer": None, "controller.touch.task": "comply"}, "controller.touch: needs"),
    ],
)
def test_what_does_not_fit_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ScenarioError, match=message.replace(".", r"\.")):
        vff.simulate(WIPE, changes)


@pytest.mark.filterwarnings("ignore:obstacles. link . is:vffnull.errors.ScenarioWarning")
def test_what_the_tip_does_not_press_on_is_a_collision() -> None:
    """A ball from the side through the hand that presses on a table: nothing resists it. Headline and metrics
    name the link that is in what it is not to touch, and how deep.
    """
    wipe = vff.Scenario.load("panda-wipe")
    obstacles = wipe.to_dict()["obstacles"]
    free = vff.simulate(wipe, {"simulation.record_every": 1, "duration": 3.5})
    at = int(np.argmin(abs(free.t - 3.0)))
    speed = np.array([0.0, 0.3, 0.0])

    def with_ball(position: Any, radius: float, velocity: Any) -> Any:
        ball = vff.Obstacle.sphere(position, radius, vff.Motion.linear(velocity)).to_dict()
        changed = wipe.replace(obstacles=[*obstacles, ball])
        result = vff.simulate(changed, {"simulation.record_every": 1, "duration": 3.5})
        found = vff.distances(wipe.arm, result.q, np.zeros_like(result.q), [ball], result.t)
        return result, np.array([found.distance[:, found.link == link].min() for link in range(7)])

    hand = wipe.arm.forward_kinematics(free.q[at])[-1]
    result, least = with_ball(hand + np.array([0.0, 0.0, 0.08]) - 3.0 * speed, 0.04, speed)
    assert result.status == "collided" and result.headline.severity == "bad"
    assert least.min() < -0.05 and result.metrics.intrusion_link == least.argmin() == 6
    assert result.metrics.intrusion_depth == pytest.approx(-least.min(), abs=1e-9)

    elbow = wipe.arm.forward_kinematics(free.q[0])[4]
    result, least = with_ball(elbow + np.array([0.0, 0.06, 0.06]), 0.03, np.zeros(3))
    assert least.min() < 0.0 and result.metrics.intrusion_link == least.argmin() < 6
    assert result.metrics.intrusion_depth == pytest.approx(-least.min(), abs=1e-9)
    assert f"panda_link{least.argmin() + 1} was" in str(result.headline)
