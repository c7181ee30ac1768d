"""The tables of docs/peers.md."""

from __future__ import annotations

import os
import platform
from collections.abc import Mapping
from importlib.metadata import version
from typing import Any

import numpy as np

import vffnull as vff
from peers.spatial.task import Array
from peers.spatial.tune import TASKS
from peers.spatial.way import Way
from report import readable, rows
from vffnull.evaluation.planner import VERDICTS

SLOWER = 1.001  # of a speed limit: beyond rounding
BEYOND = 1e-3  # rad


def tables(
    everybody: list[Way],
    outcome: vff.Evaluation,
    taken: Mapping[str, Array],
    found: Mapping[str, Any],
    packages: tuple[str, ...],
) -> str:
    """All of them, with what was run; nothing of times where none were `taken`."""
    versions = ", ".join(f"{package} {version(package)}" for package in packages)
    machine = f"Python {platform.python_version()}; {os.cpu_count()} cores, {platform.machine()}"
    works = "".join(f"- **{way.name}**: {way.work}.\n" for way in everybody)
    return f"""\
{count(outcome)}

{rates(outcome)}
{by_arm(outcome)}{medians(outcome)}
{costs(everybody, outcome, taken)}{reasons(outcome)}
{works}
{searched(everybody, found)}
{versions}, vffnull {vff.__version__}; {machine}.
"""


def count(outcome: vff.Evaluation) -> str:
    """How many scenes there are of what kind."""
    one = outcome.where(controller=outcome.controllers[0])
    verdicts = ", ".join(f"{len(one.where(feasibility=verdict))} {verdict}" for verdict in VERDICTS)
    families = ", ".join(f"{len(one.where(family=family))} {family}" for family in outcome.families)
    found = arms(outcome)
    each = "".join(f" {len(one.where(arm=arm))} {arm}," for arm in found)[:-1] + ";" if found[1:] else ""
    return f"{len(one)} scenes of the evaluation seeds:{each} {families}; escape: {verdicts}."


def arms(outcome: vff.Evaluation) -> list[str]:
    """Those whose scenes were driven."""
    return list(dict.fromkeys(map(str, outcome.columns["arm"])))


def rates(outcome: vff.Evaluation) -> str:
    """Collisions by family and in all, and what becomes of the hand."""
    body = []
    for name in outcome.controllers:
        of = outcome.where(controller=name)
        cells = []
        for family in outcome.families:
            hit = of.where(family=family).feasible.rate("collided")
            cells.append(f"{hit.count} of {hit.total}")
        every = of.rates()
        cells += [str(every[key]) for key in ("collisions_feasible", "success_feasible_with_tip")]
        cells += [str(every["returned_feasible"]), str(of.columns["diverged"].sum())]
        body.append([name, *cells])
    head = [
        "where an escape exists",
        *(f"collisions, {family}" for family in outcome.families),
        "collisions, all [%]",
        "hand held throughout, where it can be [%]",
        "hand back at the end [%]",
        "diverged",
    ]
    return rows(head, body)


def by_arm(outcome: vff.Evaluation) -> str:
    """Collisions, and how often the hand is held, by arm and task; nothing for one arm alone."""
    found, body = arms(outcome), []
    if len(found) == 1:
        return ""
    kinds = [(arm, task) for arm in found for task in TASKS]
    for name in outcome.controllers:
        every = [outcome.where(controller=name, arm=arm, task=task).feasible for arm, task in kinds]
        hit = [each.rate("collided") for each in every]
        held = [each.with_tip.rate("success") for each in every]
        body.append([name, *(f"{each.count} of {each.total}" for each in hit + held)])
    head = [
        "where an escape exists",
        *(f"collisions, {arm}, {task}" for arm, task in kinds),
        *(f"held, {arm}, {task}" for arm, task in kinds),
    ]
    return rows(head, body) + "\n"


def medians(outcome: vff.Evaluation) -> str:
    """Errors, effort, jerk, and what limits met."""
    body = []
    for name in outcome.controllers:
        columns = outcome.where(controller=name).columns
        kept = ~columns["diverged"]

        def middle(key: str, factor: float = 1.0, columns: Any = columns, kept: Array = kept) -> str:
            values = columns[key][kept]
            values = values[np.isfinite(values)]
            return f"{factor * np.median(values):.3g}" if len(values) else "–"

        body.append(
            [
                name,
                f"{middle('rms_error_during', 1e3)}, {middle('rms_error_after', 1e3)}",
                middle("effort"),
                middle("rms_jerk"),
                f"{100 * np.mean(columns['cut_off']):.1f}",
                f"{(columns['beyond_joint_limit'] > BEYOND).sum()}",
                f"{(columns['speed_ratio'] > SLOWER).sum()}",
            ]
        )
    head = [
        "medians",
        "error during, after the encounter [mm]",
        "effort [N²·m²·s]",
        "jerk [rad/s³]",
        "torque cut off [% of the steps]",
        "runs beyond a joint limit",
        "runs beyond a speed limit",
    ]
    return rows(head, body)


def reasons(outcome: vff.Evaluation) -> str:
    """What precedes collisions of the libraries: a QP without a solution, or spheres that are too small."""
    lines = []
    for name in outcome.controllers:
        of = outcome.where(controller=name)
        hit = of.where(collided=True).columns
        runs = f"of the {len(hit['scene'])} runs that collide"
        if (of.columns["unsolved"] > 0.0).any():
            share = 100.0 * of.columns["unsolved"].mean()
            lines.append(
                f"- **{name}**: the QP had no solution in {share:.2g} % of all steps, and in a step of "
                f"{(hit['unsolved'] > 0.0).sum()} {runs}.\n"
            )
        if np.isfinite(of.columns["model_clearance"]).any():
            clear = (hit["model_clearance"] > 0.0).sum()
            lines.append(f"- **{name}**: in {clear} {runs}, no sphere touches anything.\n")
    return "".join(lines)


def costs(everybody: list[Way], outcome: vff.Evaluation, taken: Mapping[str, Array]) -> str:
    """What a step of control takes, and its ratio to cbf; where somebody plans, what a second takes, too."""
    if not taken:
        return ""
    base = np.percentile(taken["cbf"], (50.0, 99.9))
    every = {way.name: way.every for way in everybody}
    planned, body = max(every.values()) > 1, []
    for name in outcome.controllers:
        here = np.percentile(taken[name], (50.0, 99.9))
        times = [readable(1e-9 * each) for each in here]
        ratios = [f"{each:.3g}" for each in here / base]
        body.append([name, *times, *ratios])
        if planned:
            plans = readable(1e-9 * np.median(taken[name][:: every[name]])) if every[name] > 1 else "–"
            second = 1e3 * taken[name].mean()
            ratio = f"{taken[name].mean() / taken['cbf'].mean():.3g}"
            body[-1] += [plans, readable(1e-9 * second), ratio]
    head = ["one step of control", "median", "99.9 %", "multiple of cbf, median", "multiple of cbf, 99.9 %"]
    if planned:
        head += ["step with a plan, median", "a second of control", "multiple of cbf, a second"]
    return rows(head, body) + "\n"


def searched(everybody: list[Way], found: Mapping[str, Any]) -> str:
    """What was searched, and what was chosen."""
    body, efforts = [], []
    for way in everybody:
        if not way.space:
            continue
        known = found[way.name]
        efforts.append(f"{way.name} {known['trials']} trials, loss {known['loss']}")
        for key, each in way.space.items():
            scale = ", logarithmic" if each.log else ""
            chosen = known["settings"][key]
            body.append([f"{way.name}: `{key}`", f"{each.low:g} to {each.high:g}{scale}", f"{chosen:g}"])
    table = rows(["setting", "searched", "chosen"], body)
    scenes = {found[way.name]["scenes"] for way in everybody if way.space}
    return f"Tuned on {', '.join(map(str, scenes))} training scenes: {'; '.join(efforts)}.\n\n{table}"
