"""What friction, loads that nobody knows, noise and delay do to every law, with an observer and without.

    python benches/friction.py            writes the table of docs/friction.md
    python benches/friction.py --seed 1   with other random numbers, prints it
    python benches/friction.py --quick    of one arm, prints it

Needs `pip install ".[mujoco]"`.

Three arms, four ways of giving way. The plant has dry friction of a hundredth of the largest torque of a
joint, and half as much viscous friction at 1 rad/s; the controller makes up for 70, 100 or 130 % of both. The
hand carries 0.5, 1 or 1.5 kg, off by 5 cm, which the controller does not know of. Velocities have noise of
0.01 rad/s, states are one cycle old. Where it is observed, `[controller.observer]` takes 0.3 of the dry
friction for what it may be wrong by, and rejects the rest. Beside them an operational-space law as
abr_control has it, for which the same friction is made up. Each number is that of the run beside the same
law without any of it.
"""

from __future__ import annotations

import argparse
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import vffnull as vff
from peers.spatial.osc import OperationalSpace
from peers.spatial.task import Task
from report import rows, write_section

SCENES = ("panda-sweep", "iiwa-line", "ur5e-sweep")
LAWS = ("null_space", "relaxed", "priority", "cbf")
PEER = "OSC as abr_control"
COMPENSATED = (0.7, 1.0, 1.3)
LOADS = (0.5, 1.0, 1.5)  # kg
DRY, VISCOUS = 0.01, 0.005  # of the largest torque, per rad/s
REJECT = {"task": "reject", "null_space": "reject"}

Array = np.ndarray[Any, np.dtype[np.float64]]


def disturbed(scene: vff.Scenario, share: float, load: float, observed: bool, seed: int) -> dict[str, Any]:
    """What is different from the ideal run."""
    most = np.asarray(scene.arm.torque_limits)
    dry, viscous = DRY * most, VISCOUS * most
    command = scene.to_dict()["controller"].get("command", {})
    changes = {
        "seed": seed,
        "plant.coulomb_friction": dry.tolist(),
        "plant.viscous_friction": viscous.tolist(),
        "plant.payload": {"mass": load, "com": [0.0, 0.03, 0.04]},
        "measurement": {"position_noise": 1e-5, "velocity_noise": 0.01, "delay": 0.001},
        "controller.command": command
        | {"coulomb_friction": (share * dry).tolist(), "viscous_friction": (share * viscous).tolist()},
    }
    if observed:
        changes["controller.observer"] = {"threshold": (0.3 * dry).tolist()}
        changes["controller.touch"] = REJECT
    return changes


def rough(torque: Array, period: float) -> float:
    """Root mean square of what of the torques is faster than 20 ms, of the worst joint [N·m]."""
    size = max(3, round(0.02 / period))
    kernel = np.ones(size) / size
    smooth = np.apply_along_axis(lambda row: np.convolve(row, kernel, "valid"), 0, torque)
    inside = torque[size // 2 : size // 2 + len(smooth)]
    return float(np.sqrt(np.mean((inside - smooth)[size:] ** 2, axis=0)).max())


@dataclass(frozen=True)
class Run:
    """What is judged of a run: the hand (T, 3) [m], torques (T, n) [N·m], the smallest distance [m]."""

    x: Array
    tau: Array
    clearance: float
    period: float
    diverged: bool

    @classmethod
    def of(cls, result: vff.Result) -> Run:
        least = float(result.metrics["min_clearance"] or 0.0)
        period = float(result.t[1] - result.t[0])
        return cls(result.x[:, :3], result.tau, least, period, result.status == "diverged")

    @classmethod
    def by_peer(cls, scene: vff.Scenario, changes: dict[str, Any]) -> Run:
        """The peer's law on this plant: it knows the arm without its load, and what sensors measure."""
        task = Task(scene)
        law, command = OperationalSpace(task), changes.get("controller.command", {})
        dry, viscous = (np.asarray(command.get(f"{kind}_friction", 0.0)) for kind in ("coulomb", "viscous"))
        speed, most = np.asarray(command.get("friction_speed", 0.1)), np.asarray(scene.arm.torque_limits)
        simulation = vff.Simulation(scene.replace(**changes))
        state, tip, torques, least = simulation.state, [], [], np.inf
        while not simulation.done:
            sensed = state.q_measured is not None
            q, dq = (state.q_measured, state.dq_measured) if sensed else (state.q, state.dq)
            tau = law.torque(len(tip), q, dq) + dry * np.tanh(dq / speed) + viscous * dq
            tip.append(state.x[:3])
            torques.append(np.clip(tau, -most, most))
            state = simulation.step(torques[-1])
            least = min(least, float(state.clearance.min()))
        return cls(np.array(tip), np.array(torques), least, task.dt, simulation.status == "diverged")


def judge(run: Run, ideal: Run) -> tuple[float, float, float, float]:
    """Clearance that is lost [mm], how far the hand is off at most and at the end [mm], roughness [N·m]."""
    length = min(len(run.x), len(ideal.x))
    off = 1e3 * np.linalg.norm(run.x[:length] - ideal.x[:length], axis=1)
    return 1e3 * (ideal.clearance - run.clearance), off.max(), off[-1], rough(run.tau, run.period)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int)
    parser.add_argument("--quick", action="store_true")
    given = parser.parse_args()
    seed = 1000 * (given.seed or 0)
    warnings.simplefilter("ignore")
    found: dict[tuple[str, str, bool], list[tuple[float, float, float, float]]] = {}
    failed = 0
    for name in SCENES[:1] if given.quick else SCENES:
        scene = vff.Scenario.load(name)
        for law in LAWS:
            base = {"controller.avoidance": law, "simulation.control": "hold", "simulation.record_every": 1}
            cases = [(s, m, o) for o in (False, True) for s in COMPENSATED for m in LOADS]
            changes = [base | disturbed(scene, *case, seed + i) for i, case in enumerate(cases)]
            ideal, *results = map(Run.of, vff.simulate_many(scene, [base, *changes]))
            for (_, _, observed), run in zip(cases, results, strict=True):
                failed += run.diverged
                found.setdefault((name, law, observed), []).append(judge(run, ideal))
        base = {"simulation.control": "hold"}
        ideal = Run.by_peer(scene, base)
        for i, (share, load) in enumerate((s, m) for s in COMPENSATED for m in LOADS):
            run = Run.by_peer(scene, base | disturbed(scene, share, load, False, seed + i))
            failed += run.diverged
            found.setdefault((name, PEER, False), []).append(judge(run, ideal))
    head = ["scene", "law", "", "clearance lost", "hand off at most", "at the end", "roughness"]
    body = []
    for (name, law, observed), runs in found.items():
        half, worst = np.median(runs, axis=0), np.max(runs, axis=0)
        cells = [f"{a:.1f} / {b:.1f} mm" for a, b in zip(half[:3], worst[:3], strict=True)]
        cells.append(f"{half[3]:.2f} / {worst[3]:.2f} N·m")
        body.append([name, law, "observed" if observed else "", *cells])
    count = len(COMPENSATED) * len(LOADS)
    text = f"{rows(head, body)}\nMedian / worst of {count} runs each; {failed} diverged.\n"
    if given.seed is None and not given.quick:
        write_section(Path(__file__).parents[1] / "docs" / "friction.md", "friction", text)
    else:
        print(text)


if __name__ == "__main__":
    main()
