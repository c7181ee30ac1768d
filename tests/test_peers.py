"""What other libraries are told in space, and the loop that all of them drive; none of them is needed."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

import vffnull as vff
from vffnull.evaluation import scenes
from vffnull.run import evaluate as evaluating

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benches"))

from peers.spatial import ours, tune
from peers.spatial.drive import drive, free
from peers.spatial.spheres import along_capsules, as_placed, uncovered
from peers.spatial.task import Array, Task
from peers.spatial.way import Controller, Range, Settings, Way

KINDS = [("path-crossed", "pose", 0), ("crowd", "position", 1)]


class Law(Controller):
    """Our law, called with what a task tells alone."""

    def __init__(self, task: Task, settings: Settings) -> None:
        super().__init__(task)
        self.law = vff.Controller(task.arm, dict(task.scene["controller"]))

    def torque(self, k: int, q: Array, dq: Array) -> Array:
        task = self.task
        place = task.place[k, : 7 if task.rows == 6 else 3]
        still = [
            {**solid, "position": at, "motion": {"kind": "linear", "velocity": speed}}
            for solid, at, speed in zip(
                task.solids, task.obstacles[k].tolist(), task.speeds[k].tolist(), strict=True
            )
        ]
        return self.law.torque(
            q, dq, place, task.twist[k, : task.rows], task.rise[k, : task.rows], obstacles=still
        )


LAW = Way("null-space field", "", prepare=Law)


@pytest.mark.parametrize(("family", "task", "seed"), KINDS)
def test_the_loop_makes_the_rows_of_evaluate(family: str, task: str, seed: int) -> None:
    """For what the core runs itself, and for the same law called from outside with what a task tells."""
    scene = scenes.in_space(family, "panda", task, seed)
    names = [way.name for way in ours.WAYS[:3]]
    expected = vff.evaluate(
        names,
        family,
        count=1,
        seed=seed,
        space=True,
        arm="panda",
        task=task,
        verdicts={scene.name: "with tip"},
    )
    span = evaluating.encounter(free(scene))
    for way in (*ours.WAYS[:3], LAW):
        row = drive(way, {}, scene, span, "with tip").row
        wanted = {key: column[0] for key, column in expected.where(controller=way.name).columns.items()}
        wanted["status"] = row["status"] if wanted["status"] == "collided" else wanted["status"]
        for key, value in wanted.items():
            if isinstance(value, float):
                # The last torque of a controller from outside is never asked for.
                exact = 1e-4 if way is LAW else 1e-9
                assert row[key] == pytest.approx(value, rel=exact, abs=1e-9, nan_ok=True), (way.name, key)
            else:
                assert row[key] == value, (way.name, key)


@pytest.mark.parametrize("family", scenes.FAMILIES)
def test_a_task_knows_where_obstacles_are_and_how_fast(family: str) -> None:
    for seed in range(1 if family == "clutter" else 4):  # all of that is at rest, and slow to draw
        task = Task(scenes.in_space(family, "panda", "pose", seed))
        result = vff.simulate(task.scene, {"simulation.record_every": 1})
        np.testing.assert_allclose(task.obstacles, result.obstacles, atol=1e-12)
        moved = np.diff(task.obstacles, axis=0) / task.dt
        along = 0.5 * (task.speeds[1:] + task.speeds[:-1])
        kinks = np.abs(np.diff(task.speeds, axis=0)) > 1e-2  # where a way point is passed
        np.testing.assert_allclose(moved[~kinks], along[~kinks], atol=1e-4)
        assert kinks.any(axis=2).sum(axis=0).max(initial=0) <= 4


def test_a_library_cannot_ask_for_more_than_the_arm_has() -> None:
    class Mad(Controller):
        def torque(self, k: int, q: Array, dq: Array) -> Array:
            return np.full(len(q), 1e3)

    scene = scenes.in_space("crowd", "panda", "pose", 0)
    row = drive(Way("mad", "", prepare=lambda task, _: Mad(task)), {}, scene, None, "with tip", most=50).row
    limits = scene.arm.torque_limits
    assert row["cut_off"] == 1.0 and row["end_time"] == pytest.approx(0.05)
    assert row["effort"] == pytest.approx(51 * 1e-3 * (limits**2).sum())


def test_spheres_on_links() -> None:
    """Those along the capsules hide them; those of OSCBF's authors leave centimetres of a Panda uncovered."""
    for name in ("panda", "iiwa14", "ur5e"):
        arm = vff.Arm.named(name)
        radii = max(shape["radius"] for _, shape in arm.collision)
        assert uncovered(arm, along_capsules(arm)).max() < 0.035 * radii
    panda = vff.Arm.named("panda")
    assert len(as_placed(panda).link) == 21
    assert 0.04 < uncovered(panda, as_placed(panda)).min() < uncovered(panda, as_placed(panda)).max() < 0.09
    with pytest.raises(ValueError, match="on a Panda alone"):
        as_placed(vff.Arm.named("ur5e"))


def test_loss_counts_what_the_tables_count() -> None:
    fine = {
        "collided": False,
        "diverged": False,
        "returned": True,
        "success": True,
        "feasibility": "with tip",
        "max_error": 0.0,
        "end_time": 4.0,
    }
    lost = fine | {"success": False, "max_error": 0.02}
    away = lost | {"returned": False}
    hit = away | {"collided": True, "end_time": 3.0}
    losses = [tune.loss(row) for row in (fine, lost, away, hit, hit | {"end_time": 1.0})]
    assert losses[0] == 0.0 and losses == sorted(losses) and len(set(losses)) == 5
    assert tune.loss(lost | {"feasibility": "without tip"}) < 0.1


def test_tuning_finds_a_better_setting_and_keeps_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Khatib's field without any push collides with what sweeps the links; TPE finds a push that does not."""
    pytest.importorskip("optuna")

    def changes(settings: Settings) -> Mapping[str, object]:
        return {"controller.field.gain": settings["gain"]}

    way = Way("field", "", {"gain": 0.0}, {"gain": Range(1.0, 200.0)}, changes=changes)
    monkeypatch.setattr(tune, "FOUND", tmp_path / "tuned.toml")
    with pytest.raises(SystemExit, match="run with --tune first"):
        tune.settings_of(way)
    chosen = [scenes.in_space("links-swept", "panda", "position", 0)]
    outcome = tune.tune(way, chosen, trials=4)
    assert outcome["loss"] < 0.1 and outcome["settings"]["gain"] > 1.0
    span = evaluating.encounter(free(chosen[0]))
    assert tune.loss(drive(way, {"gain": 1.0}, chosen[0], span, "with tip").row) > 1.0
    tune.keep(way.name, outcome)
    tune.keep("other", outcome)
    again = tune.tune(way, chosen, trials=1)
    assert again["trials"] == 5 and again["loss"] == outcome["loss"]  # what was found is tried first
    assert tune.settings_of(way) == outcome["settings"] and set(tune.found()) == {"field", "other"}


def test_mppi_knows_arms_and_obstacles() -> None:
    """As the core and the second geometry, in single precision; and its systems are solved."""
    mppi = pytest.importorskip("peers.spatial.with_mppi", reason="needs Numba")
    for name in ("panda", "iiwa14", "ur5e"):
        mppi.check(name)
    rng = np.random.default_rng(0)
    factor, right = rng.standard_normal((6, 9, 4)), rng.standard_normal((6, 4))
    matrix = np.einsum("ijn,kjn->ikn", factor, factor)
    found = mppi.solved(matrix.copy(), right.copy())
    np.testing.assert_allclose(np.einsum("ijn,jn->in", matrix, found), right, atol=1e-9)


def test_mppi_goes_where_its_rollouts_say() -> None:
    """Its plan as the loop follows it, and as one that is rolled out without noise; again after a reset."""
    mppi = pytest.importorskip("peers.spatial.with_mppi", reason="needs Numba")
    task = Task(scenes.in_space("path-crossed", "panda", "pose", 0))
    for kind in (mppi.InJoints, mppi.AroundHand):
        controller = kind(task, mppi.USUAL | mppi.HAND | {"samples": 20, "every": 10**6})
        first = controller.torque(0, task.q0, np.zeros(7))
        plan = controller.plan
        controller.reset()
        q, *_ = controller.roll(0, plan[..., None])[-2]
        for k in range(round(float(controller.grid[-1]) / task.dt)):
            controller.torque(k, controller.q, controller.dq)
        assert (controller.plan == plan).all() and np.abs(controller.q - task.q0).max() > 0.02
        np.testing.assert_allclose(controller.q, q[:, 0], atol=2e-3)
        controller.reset()
        assert (controller.torque(0, task.q0, np.zeros(7)) == first).all()


def test_mppi_avoids_with_few_plans() -> None:
    mppi = pytest.importorskip("peers.spatial.with_mppi", reason="needs Numba")
    scene = scenes.in_space("links-swept", "panda", "position", 0)
    settings = mppi.USUAL | mppi.HAND | {"samples": 40, "every": 40}
    assert free(scene).clearance.min() < 0.0
    way = Way("MPPI", "", prepare=mppi.AroundHand)
    row = drive(way, settings, scene, evaluating.encounter(free(scene)), "with tip").row
    assert not row["collided"] and row["returned"]
