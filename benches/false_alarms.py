"""How often a contact is felt that is none: `python benches/false_alarms.py --cycles 1000000`.

Bundled scenes in space, in which nothing touches the arm, with links that are up to 5 % heavier or lighter
than the controller believes, each for itself, with noise of encoders in every second run. `--push` lets
somebody push at a link at a random instant instead, and tells how long it takes until that is felt.
"""

from __future__ import annotations

import argparse
import warnings
from typing import Any

import numpy as np

import vffnull as vff

SCENES = (
    "panda-sweep",
    "gen3-circle",
    "iiwa-line",
    "ur5e-sweep",
    "panda-shelf",
    "panda-cup",
    "panda-pointing",
)
NOISE = {"measurement": {"position_noise": 1e-5, "velocity_noise": 1e-3}}


def runs(random: np.random.Generator, error: float, push: float, observer: dict[str, Any]) -> Any:
    """Scenes one after the other, each with another arm: the run, and the instant of a push."""
    for k in range(10**9):
        scene = vff.Scenario.load(SCENES[k % len(SCENES)])
        masses = scene.arm.masses * (1.0 + error * random.uniform(-1.0, 1.0, scene.arm.n))
        changes: dict[str, Any] = {"plant.masses": masses.tolist(), "seed": k}
        changes |= {"controller.observer": observer, "simulation.control": "hold"}
        changes |= {"simulation.record_every": 1} | (NOISE if k % 2 else {})
        start = float(random.uniform(0.5, scene.duration - 0.1))
        if push:
            force = random.normal(size=3)
            force *= push / np.linalg.norm(force)
            link = scene.arm.link_names[int(random.integers(3, scene.arm.n))]
            changes["wrenches"] = [{"link": link, "force": force.tolist(), "start": start}]
        yield vff.simulate(scene, changes), start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cycles", type=int, default=1_000_000)
    parser.add_argument("--error", type=float, default=0.05, help="by which share links are off")
    parser.add_argument("--push", type=float, default=0.0, help="with how many newtons somebody pushes")
    parser.add_argument("--bandwidth", type=float, default=80.0, help="of the observer [1/s]")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    cycles = alarms = 0
    waits: list[float] = []
    observer = {"bandwidth": given.bandwidth, "detection": {}}
    for result, start in runs(np.random.default_rng(given.seed), given.error, given.push, observer):
        felt = np.isfinite(result.touched_link)
        before = felt[result.t <= start] if given.push else felt
        cycles += before.size
        alarms += int(np.count_nonzero(np.diff(before.astype(int)) == 1))
        if given.push:
            after = np.flatnonzero(felt[result.t > start])
            waits.append(1e3 * (result.t[1] - result.t[0]) * (after[0] + 1) if after.size else np.inf)
        if cycles >= given.cycles:
            break
    print(f"{alarms} false alarms in {cycles} cycles")
    if waits:
        shares = ", ".join(f"{np.quantile(waits, q):.0f} ms ({q:.0%})" for q in (0.5, 0.9))
        print(f"{given.push:g} N are felt after {shares}, of {len(waits)}")


if __name__ == "__main__":
    main()
