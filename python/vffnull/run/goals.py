"""Planning and reacting against each other, on scenes with a goal: who gets there, how soon, and what
planning takes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from vffnull._support.arguments import whole
from vffnull._support.errors import InputError
from vffnull.evaluation import scenes
from vffnull.evaluation.scenes.goals import GOAL_ARMS, GOAL_FAMILIES, to_a_goal
from vffnull.evaluation.table import Column, wilson
from vffnull.model.outcome import Outcome, Status
from vffnull.model.scenario import Scenario
from vffnull.planning import Plan, plan
from vffnull.run.evaluate import TOUCH
from vffnull.run.many import simulate_many

__all__ = ["WAYS", "Goals", "evaluate_goals", "planned"]

NEAR = 0.01  # m, how near the tip has to be to its goal at the end
EVERY = 10  # steps per recorded row
_SPEEDS = (0.5, 0.9)  # shares of the joints' limits of speed and acceleration
_REST = 1.0  # s that are left at the end

_CBF = {"controller.avoidance": "cbf"}
_AHEAD = {**_CBF, "controller.yielding.preview": {}}

WAYS: dict[str, tuple[bool, dict[str, Any]]] = {
    "cbf": (False, _CBF),
    "cbf + preview": (False, _AHEAD),
    "plan alone": (True, {"controller.field.gain": 0.0}),
    "plan and react": (True, {**_AHEAD, "controller.governor": {}}),
    "replan and react": (True, {**_AHEAD, "controller.governor": {}, "replan": {}}),
}
"""What is compared: whether a plan is followed, made once before the run, and what is changed of a scene."""

_POSTURE = {  # N·m/rad, of the posture of a plan
    "plane": [200.0, 200.0, 150.0, 100.0, 50.0, 25.0],
    "panda": [60.0, 60.0, 40.0, 40.0, 10.0, 10.0, 4.0],
}


def planned(scene: Scenario, tries: int = 3) -> Plan:
    """A plan for a scene: around what moves, or, if there is none, without that; with so many seeds. One
    that takes longer than the scene lasts is made once more, for faster joints.

    Its ``wall_time`` is that of all that was tried.
    """
    taken = 0.0
    for horizon in (1.0, None):
        for seed in range(tries):
            for speed in _SPEEDS:
                found = plan(scene, horizon=horizon, seed=seed, speed=speed)
                taken += found.wall_time
                if found.status != "found" or found.duration <= scene.duration - _REST:
                    break
            if found.status == "found":
                return replace(found, wall_time=taken)
    return replace(found, wall_time=taken)


class Goals:
    """Outcomes on scenes with a goal, one row for each scene and way; made by `evaluate_goals`.

    Parameters
    ----------
    columns : dict of str to ndarray
        The rows, as columns: ``arm``, ``family``, ``seed``, ``way``; ``collided``, an overlap of more than
        1 mm;
        ``reached``, no collision and the tip within 1 cm of its goal at the end; ``time`` until it is there
        for good
        [s], NaN otherwise; ``min_clearance`` [m]; ``status`` of the run; ``plan``, the status of the plan,
        or nothing;
        ``latency`` of planning [s].
    """

    def __init__(self, columns: dict[str, Column]) -> None:
        self.columns = columns

    def __len__(self) -> int:
        return len(self.columns["way"])

    @classmethod
    def join(cls, parts: Sequence[Goals]) -> Goals:
        """All rows of several evaluations."""
        names = parts[0].columns
        return cls({name: np.concatenate([part.columns[name] for part in parts]) for name in names})

    def where(self, **wanted: Any) -> Goals:
        """The rows with certain values."""
        kept = np.ones(len(self), dtype=bool)
        for name, value in wanted.items():
            kept &= self.columns[name] == value
        return Goals({name: column[kept] for name, column in self.columns.items()})

    def table(self) -> str:
        """Rates with their 95 % intervals, and medians, as Markdown."""
        lines = [
            "| arm | family | controller | reached [%] | collisions [%] | time to goal [s] | no plan |",
            "|---|---|---|--:|--:|--:|--:|",
        ]
        for arm in dict.fromkeys(self.columns["arm"]):
            for family in dict.fromkeys(self.columns["family"]):
                for way in dict.fromkeys(self.columns["way"]):
                    rows = self.where(arm=arm, family=family, way=way)
                    if not len(rows):
                        continue
                    reached, hit = (
                        wilson(int(rows.columns[name].sum()), len(rows)) for name in ("reached", "collided")
                    )
                    times = rows.columns["time"][rows.columns["reached"]]
                    time = f"{np.median(times):.2f}" if len(times) else "–"
                    missing = int(((rows.columns["plan"] != "") & (rows.columns["plan"] != "found")).sum())
                    lacking = str(missing) if WAYS[str(way)][0] else "–"
                    lines.append(f"| {arm} | {family} | {way} | {reached} | {hit} | {time} | {lacking} |")
        return "\n".join(lines)

    def latencies(self) -> str:
        """How long planning took, as Markdown."""
        lines = [
            "| arm | family | plans | median [ms] | 95 % [ms] | worst [ms] |",
            "|---|---|--:|--:|--:|--:|",
        ]
        once = self.where(way="plan and react")
        for arm in dict.fromkeys(once.columns["arm"]):
            for family in dict.fromkeys(once.columns["family"]):
                taken = 1e3 * once.where(arm=arm, family=family).columns["latency"]
                if len(taken):
                    median, most, worst = np.percentile(taken, (50, 95, 100))
                    lines.append(
                        f"| {arm} | {family} | {len(taken)} | {median:.1f} | {most:.1f} | {worst:.1f} |"
                    )
        return "\n".join(lines)

    def __repr__(self) -> str:
        return f"<Goals: {len(self)} runs>"


def evaluate_goals(
    families: Iterable[str] = GOAL_FAMILIES,
    arms: Iterable[str] = GOAL_ARMS,
    count: int = 20,
    seed: int = scenes.EVALUATION.start,
    threads: int | None = None,
    ways: Mapping[str, tuple[bool, Mapping[str, Any]]] | None = None,
) -> Goals:
    """Run what plans and what reacts on random scenes with a goal.

    Parameters
    ----------
    families, arms : iterable of str, optional
        Of `GOAL_FAMILIES` and `GOAL_ARMS`; all by default.
    count : int, optional
        Scenes for each family and arm.
    seed : int, optional
        Seed of the first scene; the others follow. Evaluation seeds by default: tune to others.
    threads : int, optional
        How many threads simulate. Plans are made one after the other, so that they can be timed.
    ways : Mapping, optional
        What is compared, as in `WAYS`, which is the default.

    Returns
    -------
    Goals
        One row for every scene and way.

    Raises
    ------
    vffnull.errors.InputError
        If there is no such family, arm or seed.
    KeyboardInterrupt
        After Ctrl-C.
    """
    compared = WAYS if ways is None else ways
    count = whole("count", count, 1, len(scenes.EVALUATION))
    rows: list[dict[str, Any]] = []
    for arm in arms:
        for family in families:
            made = [to_a_goal(family, arm, each) for each in range(seed, seed + count)]
            plans = [planned(scene) for scene in made]
            for name, (follows, changes) in compared.items():
                runs = [
                    _following(scene, found, arm) if follows else scene
                    for scene, found in zip(made, plans, strict=True)
                ]
                there = [scene for scene in runs if scene is not None]
                results = iter(_run(there, changes, threads))
                for scene, found, run in zip(made, plans, runs, strict=True):
                    outcome = next(results) if run is not None else None
                    rows.append(
                        {
                            "arm": arm,
                            "family": family,
                            "seed": int(scene.name.rpartition("-")[2]),
                            "way": name,
                            "plan": str(found.status) if follows else "",
                            "latency": found.wall_time if follows else np.nan,
                            **_scores(scene, outcome),
                        }
                    )
    if not rows:
        raise InputError("evaluate_goals: no family or no arm is given")
    return Goals({name: np.array([row[name] for row in rows]) for name in rows[0]})


def _following(scene: Scenario, found: Plan, arm: str) -> Scenario | None:
    """The scene with the plan as its reference; none without a plan."""
    if found.status != "found":
        return None
    changes = {"reference": found.reference, "controller.posture_stiffness": _POSTURE[arm]}
    return scene.replace(**changes)


def _run(runs: Sequence[Scenario], changes: Mapping[str, Any], threads: int | None) -> Sequence[Outcome]:
    if not runs:
        return []
    results = simulate_many(runs, {**changes, "simulation.record_every": EVERY}, threads)
    if any(result.status is Status.INTERRUPTED for result in results):
        raise KeyboardInterrupt
    return results


def _scores(scene: Scenario, result: Outcome | None) -> dict[str, Any]:
    """How a run went; without a plan nothing moves, and nothing is reached."""
    if result is None:
        return {"status": "", "collided": False, "reached": False, "time": np.nan, "min_clearance": np.nan}
    clearance = result.metrics["min_clearance"]
    least = np.inf if clearance is None else float(clearance)
    goal = np.asarray(scene["reference.end"], dtype=float)
    if scene["reference"].get("relative", False):
        goal = goal + result.x[0]
    off = np.linalg.norm(result.x - goal, axis=1)
    whole_run = result.status in (Status.COMPLETED, Status.COLLIDED)
    reached = bool(whole_run and least >= -TOUCH and off[-1] <= NEAR)
    late = np.flatnonzero(off > NEAR)
    since = float(result.t[late[-1] + 1]) if reached and len(late) else 0.0
    return {
        "status": str(result.status),
        "collided": least < -TOUCH,
        "reached": reached,
        "time": since if reached else np.nan,
        "min_clearance": least,
    }
