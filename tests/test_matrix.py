"""Where promises meet: bundled scenes, ways of giving way and options, alone and in pairs."""

from __future__ import annotations

import random

import numpy as np
import pytest

import vffnull as vff
from matrix import NOT_TOGETHER, OPTIONS, WAYS, combined, faults, is_refusal

pytestmark = pytest.mark.filterwarnings("ignore::vffnull.errors.ScenarioWarning")
SCENES = list(vff.scenarios())
PAIRS = 3


def sets_of_options(name: str, way: str) -> list[tuple[str, ...]]:
    """Every scene meets every option, and so does every way; the pairs are the same ones for ever."""
    first = SCENES.index(name) + list(WAYS).index(way)
    alone = [(option,) for k, option in enumerate(OPTIONS) if (k + first) % len(WAYS) == 0]
    draw = random.Random(f"{name}, {way}")
    return alone + [tuple(draw.sample(list(OPTIONS), 2)) for _ in range(PAIRS)]


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", SCENES)
def test_it_holds_or_is_refused(name: str, way: str) -> None:
    """Finite, within limits, no contact that an option alone has brought, told as it was."""
    alone = combined(name, way, ())
    if sentence := NOT_TOGETHER.get((name, way)):
        assert isinstance(alone, str) and sentence in alone
        return
    assert isinstance(alone, vff.Scenario)
    without, found = vff.simulate(alone), []
    for options in sets_of_options(name, way):
        scene = combined(name, way, options)
        if isinstance(scene, str):
            assert is_refusal(scene, options), scene
        elif scene is not None:
            found += [(options, fault) for fault in faults(vff.simulate(scene), options, without)]
    assert found == []


IN_SPACE = [name for name in SCENES if vff.Scenario.load(name).arm.dimension == 3]
PERIOD = 1e-3  # s
MISSING = {0, 1, 2, *range(300, 304)}  # cycles: the first ones, and as many in a row as are held


@pytest.mark.parametrize("rate", [None, 1000.0], ids=["", "rate"])
@pytest.mark.parametrize(
    ("name", "way"), [(name, way) for name in IN_SPACE for way in WAYS if (name, way) not in NOT_TOGETHER]
)
def test_loops_hold_whatever_comes(name: str, way: str, rate: float | None) -> None:
    """What is sent, in every cycle: states are lost, the clock is set back, a reading is wild, and somebody
    asks what would be elsewhere.
    """
    scene = combined(name, way, ())
    assert isinstance(scene, vff.Scenario)
    arm, document = scene.arm, scene.to_dict()
    settings = {key: value for key, value in document["controller"].items() if key != "governor"}
    if "posture" not in settings:
        settings.pop("posture_stiffness", None)
    settings["command"] = {"blend_time": 0.2} | ({} if rate is None else {"torque_rate": rate})
    controller = vff.Controller(arm, settings)
    plant = vff.Simulation(
        {key: document[key] for key in ("arm", "q0", "duration", "reference", "simulation")}
        | {"controller": {"task": settings["task"]}}
    )
    led = vff.simulate(scene, {"controller.avoidance": "null_space", "obstacles": []})
    turned = [] if led.orientation_ref is None else [led.orientation_ref]
    reference = np.hstack([led.x_ref, *turned])
    state = plant.state
    seen = [each for each in document.get("obstacles", []) if each.get("contact", {}).get("seen", True)]
    draw = random.Random(name)
    controller.begin(PERIOD, arm.gravity_torque(state.q))
    sent, clock, phases = arm.gravity_torque(state.q), 0.0, set()
    for cycle in range(min(900, len(reference) - 1)):
        if cycle == 500:
            clock = -2.0
        if cycle % 50 == 25:  # what if the arm were there?
            controller.torque(np.array(state.q) + 0.1, 5.0 * np.ones(arm.n), x_ref=reference[0])
        if cycle in MISSING or draw.random() < 0.01:
            tau, phase = controller.cycle()
        else:
            q = np.array(state.q) + (2.0 if cycle == 700 else 0.0)
            tau, phase = controller.cycle(
                cycle * PERIOD + clock, q, state.dq, x_ref=reference[cycle], obstacles=seen
            )
        phases.add(phase)
        assert np.isfinite(tau).all(), (cycle, phase)
        assert (np.abs(tau) <= arm.torque_limits * (1 + 1e-9)).all(), (cycle, phase)
        if rate is not None:
            assert (np.abs(tau - sent) <= rate * PERIOD * (1 + 1e-9)).all(), (cycle, phase)
        sent, state = tau, plant.step(tau)
        assert (np.abs(state.dq) <= 1.02 * arm.velocity_limits).all(), (cycle, phase)
    assert "running" in phases and not phases & {"lost", "released"}
