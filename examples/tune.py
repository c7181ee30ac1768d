"""
Tune a controller
=================

How well the arm gets out of the way, and the tip keeps its path, depends on gains. Optuna looks for good ones
on random scenes; scenes that it has never seen judge what it has found. Needs ``vffnull[evaluate,tune]``.
"""

from __future__ import annotations

import numpy as np
import optuna

import vffnull as vff
from vffnull.draw import style
from vffnull.evaluation import scenes

FAMILIES, SCENES, TRIALS = ("links-swept", "clutter", "crowd"), 2, 6  # quick; 100 and 200 tell more
RANGES = {
    "yielding.rate": (10.0, 100.0),  # 1/s
    "yielding.margin": (0.01, 0.1),  # m
    "yielding.task_weight": (1.0, 100.0),  # kg
    "field.gain": (0.03, 3.0),  # N·m³
}
DEFAULTS = {"yielding.rate": 40.0, "yielding.margin": 0.02, "yielding.task_weight": 20.0, "field.gain": 0.3}

# Scenes with an escape, by seeds that are meant for tuning. No gain has a say in that.
drawn = [scenes.random(family, 4, seed) for family in FAMILIES for seed in scenes.TRAINING[:SCENES]]
chosen = [scene for scene in drawn if vff.feasibility(scene) != "none found"]


def changes(gains: dict[str, float]) -> dict[str, object]:
    return {"controller.avoidance": "cbf"} | {f"controller.{name}": value for name, value in gains.items()}


def cost(trial: optuna.Trial) -> float:
    """A collision is as bad as a tip that is off by a metre."""
    gains = {name: trial.suggest_float(name, *ends, log=True) for name, ends in RANGES.items()}
    runs = vff.simulate_many(chosen, changes(gains))
    off = [np.sqrt(np.mean(np.sum(run.error**2, axis=1))) for run in runs]
    return float(np.mean([run.metrics["min_clearance"] < -1e-3 for run in runs]) + np.mean(off))


optuna.logging.set_verbosity(optuna.logging.ERROR)
study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=0))
study.enqueue_trial(DEFAULTS)  # what is found is then no worse
study.optimize(cost, n_trials=TRIALS)
print(f"cost {study.trials[0].value:.3f} by default, {study.best_value:.3f} with {study.best_params}")
both = {"default": changes(DEFAULTS), "tuned": changes(study.best_params)}
print(vff.evaluate(both, category="clutter", n=4, count=3).table())  # seeds from 1 000 000 on

with style.look():
    ax = style.figure(2.6, 5.0).subplots()
    ax.plot([each.value for each in study.trials], "o-", clip_on=False)
    ax.set(xlabel="trial, the defaults first", ylabel="cost on training scenes")
    ax.figure.savefig("tune.png")
