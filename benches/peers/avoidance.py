"""Other libraries' ways to avoid on our random scenes, through `vffnull.Simulation.step`.

Each is a `Filter`: it sees the state, the obstacles and the reference, and returns a joint torque.
`docs/evaluate.py` runs them; ``python benches/peers/avoidance.py 2`` runs two training scenes of each kind.
"""

from __future__ import annotations

import sys
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import vffnull as vff
from vffnull.evaluation import scenes
from vffnull.run import evaluate as evaluating

MODULES = ("mink_limit", "cbfpy_filter")
WITHOUT = {"controller.field.gain": 0.0, "simulation.record_every": 1}
Array = np.ndarray


@dataclass(frozen=True)
class Reference:
    """Where the tip has to be at every step, how fast, and how it accelerates."""

    x: Array  # (steps + 1, 2) [m]
    dx: Array
    ddx: Array
    dt: float


class Filter(ABC):
    """A controller for one scene, made anew for each."""

    def __init__(self, scene: vff.Scenario, reference: Reference) -> None:
        self.scene, self.arm, self.reference = scene, scene.arm, reference

    @abstractmethod
    def torque(self, k: int, state: Any) -> Array:
        """Joint torque for step `k` [N·m]."""


@dataclass(frozen=True)
class Way:
    """A library's way with one set of parameters."""

    name: str
    work: str
    prepare: Callable[[vff.Scenario, Reference], Filter]


def ways() -> list[Way]:
    """All of them; each module has a tuple ``WAYS``."""
    return [way for name in MODULES for way in import_module(f"peers.{name}").WAYS]


def run(way: Way, scene: vff.Scenario, free: vff.Result, verdict: str) -> dict[str, Any]:
    """The row of one scene, as `vffnull.evaluate` has it."""
    dt = scene["simulation.dt"]
    dx = np.gradient(free.x_ref, dt, axis=0)
    reference = Reference(free.x_ref, dx, np.gradient(dx, dt, axis=0), dt)
    simulation, law = vff.Simulation(scene), way.prepare(scene, reference)
    state, k, effort, jerk = simulation.state, 0, 0.0, 0.0
    t, error, clearance = [], [], [float(state.clearance.min())]
    speeds = [state.dq]
    while not simulation.done:
        tau = law.torque(k, state)
        if not np.all(np.isfinite(tau)):
            break
        state, k = simulation.step(tau), k + 1
        effort += float(tau @ tau) * dt
        clearance.append(float(state.clearance.min()))
        t.append(state.t)
        error.append(float(np.linalg.norm(state.x - state.x_ref)))
        speeds.append(state.dq)
    through = k == round(scene.duration / dt) and bool(np.isfinite(error).all())
    if len(speeds) > 3:
        jerk = float(np.sqrt(np.mean((np.diff(speeds, 2, axis=0) / dt**2) ** 2)))
    row = evaluating.scores(
        status="completed" if through else "diverged",
        t=np.array(t),
        error=np.array(error),
        span=evaluating.encounter(free),
        min_clearance=min(clearance),
        max_error=max(error, default=np.nan),
        effort=effort,
        rms_jerk=jerk,
        end_time=float(state.t),
    )
    return {**evaluating.identity(scene, verdict, way.name), **row}


def evaluate(
    chosen: list[Way], family: str, n: int, seeds: range, verdicts: dict[str, str]
) -> vff.Evaluation:
    """All ways on the scenes of a family."""
    rows = []
    for seed in seeds:
        scene = scenes.random(family, n, seed)
        verdict = verdicts.get(scene.name) or vff.feasibility(scene)
        free = vff.simulate(scene, WITHOUT)
        rows += [run(way, scene, free, verdict) for way in chosen]
    return vff.Evaluation.of(rows, tuple(way.name for way in chosen))


def report(kept: Path, count: int, sizes: tuple[int, ...], verdicts: Callable[..., dict[str, str]]) -> str:
    """Tables of the peers and of ours on the same scenes; parts are kept."""
    parts, chosen, seed = [], ways(), scenes.EVALUATION.start
    ours = ("null-space field", "cbf")
    for family in scenes.FAMILIES:
        for n in sizes:
            file = kept / f"peers-{family}-{n}-{count}.npz"
            if not file.exists():
                own = evaluating.evaluate(ours, family, n, count, seed, verdicts=verdicts())
                verdicts(own.verdicts)
                theirs = evaluate(chosen, family, n, range(seed, seed + count), verdicts())
                outcome = evaluating.join([own, theirs])
                np.savez(file, controllers=np.array(outcome.controllers), **outcome.columns)
                print(f"{file.stem}: done", file=sys.stderr, flush=True)
            with np.load(file) as read:
                columns = {key: read[key] for key in read.files if key != "controllers"}
                parts.append(vff.Evaluation(columns, tuple(map(str, read["controllers"]))))
    works = "\n".join(f"- **{way.name}**: {way.work}." for way in chosen)
    return f"""## Other libraries

The first {count} evaluation seeds of every family and number of joints, under two libraries from PyPI. Both
act through `Simulation.step`, which `benches/peers/avoidance.py` wraps; the tables have our rows on the same
scenes.

{works}

{evaluating.join(parts).table()}
"""


if __name__ == "__main__":
    many = int(sys.argv[1]) if len(sys.argv) > 1 else 2
    for each in scenes.FAMILIES:
        print(evaluate(ways(), each, 6, range(many), {}).table(), flush=True)
