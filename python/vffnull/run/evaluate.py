"""Controllers against each other on random scenes: rates with intervals, errors, effort and time."""

from __future__ import annotations

import csv
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import vffnull._core as _core
from vffnull._support import progress as _progress
from vffnull._support.arguments import MAX_THREADS, whole
from vffnull._support.errors import InputError
from vffnull._support.extras import extra
from vffnull._support.figures import ending
from vffnull._support.files import replacing
from vffnull._support.progress import Counter, counted
from vffnull.evaluation import scenes
from vffnull.evaluation.controllers import CONTROLLERS, chosen
from vffnull.evaluation.planner import ANGLE, TIP, feasibility
from vffnull.evaluation.table import Column, Table
from vffnull.model.scenario import Scenario
from vffnull.run.many import simulate_many
from vffnull.run.result import Result, Status

__all__ = ["Evaluation", "check_path", "encounter", "evaluate", "identity", "join", "scores", "loop_times"]

TOUCH = 1e-3  # m, overlap that counts as a collision
NEAR = 0.1  # m: without avoidance, an obstacle this near to a link is an encounter
EVERY = 10  # steps per recorded row
_BLOCK = 48  # scenes at a time, so that their records fit into memory


class Evaluation(Table):
    """Outcomes of controllers on random scenes, one row for each pair; made by `evaluate`.

    Parameters
    ----------
    columns : dict of str to ndarray
        The rows, as columns; see below.
    controllers : tuple of str
        Their names, in the order of tables and figures.

    Notes
    -----
    Columns: ``scene``, ``category``, ``family``, ``n`` or, in space, ``arm`` and ``task``, ``seed``,
    ``feasibility``, ``controller``, ``status``; ``collided``, an overlap of more than 1 mm; ``diverged``;
    ``success``, no collision and the tip held throughout; ``returned``, no collision and the tip held at the
    end of the run; ``min_clearance`` [m]; ``max_error``, the largest distance of the tip from its reference
    [m]; ``max_angle``, the same of its orientation [rad], NaN without one; ``rms_error_during`` and
    ``rms_error_after`` the encounter [m]; ``recovery_time`` from the end of the encounter until the tip stays
    held [s]; ``effort``, the integral of the squared torque, that against gravity included [N²·m²·s];
    ``rms_jerk`` of the joint angles [rad/s³]; ``end_time`` [s].

    The tip is held if it is within 1 cm of its reference and, for the tasks pointing and pose in space,
    turned from it by 0.05 rad at most.
    """

    def save(self, path: str | Path) -> Path:
        """Write the rows to a file.

        Parameters
        ----------
        path : str or path
            A path that ends in ``.csv`` or, with the extra ``vffnull[io]``, ``.parquet``.

        Raises
        ------
        vffnull.errors.InputError
            If the path ends otherwise.
        ImportError
            Without the extra.
        """
        path = check_path(path)
        if path.suffix == ".parquet":
            table = extra("pyarrow", "io").table(
                {name: column.tolist() for name, column in self.columns.items()},
                metadata={"vffnull": _core.__version__},
            )
            with replacing(path) as draft:
                extra("pyarrow.parquet", "io").write_table(table, str(draft), compression="zstd")
            return path
        with replacing(path) as draft, draft.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(self.columns)
            writer.writerows(zip(*(column.tolist() for column in self.columns.values()), strict=True))
        return path

    def plot(self, directory: str | Path, format: str = "png") -> list[Path]:
        """Write the figures ``rates``, ``clearance`` and ``error`` into a directory.

        Parameters
        ----------
        directory : str or path
            Where to write them; made if it does not exist.
        format : {"png", "pdf", "svg"}, optional
            What kind of files to write.

        Raises
        ------
        ImportError
            Without the extra ``vffnull[evaluate]``.
        """
        from vffnull.evaluation import figures

        return figures.save(self, Path(directory), ending(format))

    def __repr__(self) -> str:
        return f"<Evaluation: {len(self)} runs of {len(self.controllers)} controllers>"


def evaluate(
    controllers: Iterable[str] | Mapping[str, Mapping[str, Any]] | None = None,
    category: int | str | Iterable[int | str] = (1, 2),
    n: int | Iterable[int] = (4, 6, 9),
    count: int = 100,
    seed: int = scenes.EVALUATION.start,
    threads: int | None = None,
    progress: bool | Counter | None = None,
    verdicts: Mapping[str, str] | None = None,
    *,
    space: bool = False,
    arm: str | Iterable[str] = scenes.EVALUATED,
    task: str | Iterable[str] = ("position", "pose"),
) -> Evaluation:
    """Run controllers on random scenes, in the plane or in space.

    Parameters
    ----------
    controllers : iterable of str, or Mapping, optional
        Names out of `CONTROLLERS`, all by default; or other controllers: a name, and what it changes of a
        scene, by dotted keys.
    category : int, str, or iterable of them, optional
        1 or 2, or families of `vffnull.evaluation.scenes`; both categories by default.
    n : int or iterable of int, optional
        Numbers of joints, in the plane.
    count : int, optional
        Scenes for each category and each number of joints; in space for each family, arm and task.
    seed : int, optional
        Seed of the first scene; the others follow. Evaluation seeds by default: tune to others.
    threads : int, optional
        How many threads compute; as many as there are cores by default.
    progress : bool or callable, optional
        True shows a progress bar; a callable gets the number of finished runs and the number of all.
    verdicts : Mapping of str to str, optional
        What `vffnull.feasibility` says of scenes, by their names, where it is known already, for instance
        `Evaluation.verdicts` of an earlier call; the planner is asked about the others, which takes most of
        the time.
    space : bool, optional
        Whether the scenes are those of `vffnull.evaluation.scenes.in_space`.
    arm, task : str or iterable of str, optional
        Of scenes in space: some of `vffnull.evaluation.scenes.ARMS`, by default those of
        docs/evaluation-spatial.md, and of `vffnull.evaluation.scenes.TASKS`.

    Returns
    -------
    Evaluation
        One row for every scene and controller.

    Raises
    ------
    vffnull.errors.InputError
        If there is no such controller, category, seed or number of joints.
    vffnull.errors.ScenarioError
        If a controller's changes make no scenario.
    vffnull.errors.InputTypeError
        If an argument is of a type that cannot be used.
    KeyboardInterrupt
        After Ctrl-C: what was done until then is dropped.

    Notes
    -----
    `vffnull.feasibility` says what is feasible, without any controller. An *encounter* lasts
    from the first to the last instant at which the run without avoidance has a link within 0.1 m of an
    obstacle, so it is the same for all controllers. Errors during and after it are taken every 10 ms.

    Examples
    --------
    >>> outcome = evaluate(["no avoidance", "null-space field"], category=1, n=6, count=2)
    >>> len(outcome)
    4
    """
    _progress.check(progress)
    compared = chosen(controllers)
    count = whole("count", count, 1, len(scenes.EVALUATION))
    seed = whole("seed", seed, 0, scenes.EVALUATION.stop - count)
    if threads is not None:
        threads = whole("threads", threads, 1, MAX_THREADS)
    if space:
        wanted = _in_space(category, _listed(arm), _listed(task))
    else:
        wanted = _in_the_plane(category, n)
    drawn = [partial(make, each) for make in wanted for each in range(seed, seed + count)]
    if not drawn:
        kinds = "no family, no arm or no task" if space else "no category or no number of joints"
        raise InputError(f"evaluate: {kinds} is given")

    total = len(drawn) * len(compared)
    rows: list[dict[str, Any]] = []
    seen: set[str] = set()
    with counted(progress, total) as report:
        for first in range(0, len(drawn), _BLOCK):
            makers = drawn[first : first + _BLOCK]
            made = {scene.name: scene for scene in (make() for make in makers)}
            block = [scene for name, scene in made.items() if name not in seen]  # one may be of two kinds
            seen |= made.keys()
            total -= (len(makers) - len(block)) * len(compared)
            rows += _block(block, compared, threads, verdicts or {})
            if report is not None:
                report(len(rows), total)
    return Evaluation.of(rows, tuple(compared))


def _listed(given: Any) -> list[Any]:
    """One or several, as a list."""
    return list(given) if isinstance(given, Iterable) and not isinstance(given, str) else [given]


def _in_space(category: Any, arms: list[Any], tasks: list[Any]) -> list[partial[Scenario]]:
    """What makes scenes in space of a seed: all families of the categories, one by one, each once."""
    families: list[Any] = []
    for each in _listed(category):
        known = isinstance(each, int) and not isinstance(each, bool) and each in scenes.CATEGORIES
        families += scenes.CATEGORIES[each] if known else [each]
    kinds = dict.fromkeys((f, a, t) for f in families for a in arms for t in tasks)
    return [partial(scenes.in_space, *kind) for kind in kinds]


def _in_the_plane(category: Any, n: Any) -> list[partial[Scenario]]:
    """What makes scenes in the plane of a seed, each once."""
    kinds = dict.fromkeys((c, k) for c in _listed(category) for k in _listed(n))
    return [partial(scenes.random, *kind) for kind in kinds]


def join(parts: Iterable[Evaluation]) -> Evaluation:
    """All rows of several evaluations.

    Parameters
    ----------
    parts : iterable of Evaluation
        At least one.

    Raises
    ------
    vffnull.errors.InputError
        If there is none, or one is of the plane and another one of space.
    """
    parts = list(parts)
    if not parts or any(part.columns.keys() != parts[0].columns.keys() for part in parts):
        raise InputError("join: expected evaluations that are all of the plane, or all of space")
    names = dict.fromkeys(name for part in parts for name in part.controllers)
    columns = {name: np.concatenate([part.columns[name] for part in parts]) for name in parts[0].columns}
    return Evaluation(columns, tuple(names))


def _block(
    block: Sequence[Scenario],
    compared: Mapping[str, Mapping[str, Any]],
    threads: int | None,
    known: Mapping[str, str],
) -> Iterator[dict[str, Any]]:
    """The rows of a few scenes under all controllers."""
    pool = ThreadPoolExecutor(threads)  # the search runs outside the GIL
    try:
        verdicts = list(pool.map(lambda scene: known.get(scene.name) or feasibility(scene), block))
    finally:  # Ctrl-C does not wait for searches that have not begun
        pool.shutdown(wait=False, cancel_futures=True)

    def run(changes: Mapping[str, Any]) -> list[Result]:
        results = simulate_many(block, {**changes, "simulation.record_every": EVERY}, threads)
        if any(result.status is Status.INTERRUPTED for result in results):
            raise KeyboardInterrupt  # half of a run says nothing about a controller
        return results

    free = run(CONTROLLERS["no avoidance"])
    spans = [encounter(result) for result in free]
    for name, changes in compared.items():
        results = free if changes == CONTROLLERS["no avoidance"] else run(changes)
        for scene, verdict, span, result in zip(block, verdicts, spans, results, strict=True):
            yield {**identity(scene, verdict, name), **scores_of(result, span)}


def identity(scene: Scenario, verdict: str, controller: str) -> dict[str, Any]:
    """The columns that say which run a row is of; a random scene says the rest by its name."""
    family = next(each for each in scenes.FAMILIES if scene.name.startswith(f"{each}-"))
    *kind, seed = scene.name.removeprefix(f"{family}-").split("-")
    return {
        "scene": scene.name,
        "category": next(c for c, families in scenes.CATEGORIES.items() if family in families),
        "family": family,
        **({"n": int(kind[0])} if len(kind) == 1 else dict(zip(("arm", "task"), kind, strict=True))),
        "seed": int(seed),
        "feasibility": verdict,
        "controller": controller,
    }


def encounter(free: Result) -> tuple[float, float] | None:
    """From when to when the run without avoidance is near an obstacle."""
    near = np.flatnonzero(free.clearance.min(axis=1) < NEAR)
    return (float(free.t[near[0]]), float(free.t[near[-1]])) if len(near) else None


def scores_of(result: Result, span: tuple[float, float] | None) -> dict[str, Any]:
    """The columns that say how a run went."""
    metrics = result.metrics
    worst = [metrics[f"max_error_{part}"] for part in ("transient", "tail")]
    clearance, effort, jerk = (metrics[name] for name in ("min_clearance", "effort", "rms_jerk"))
    position, rotation = np.split(result.error, [result.scenario.arm.dimension], axis=1)
    return scores(
        status=str(result.status),
        t=result.t,
        error=np.linalg.norm(position, axis=1),
        angle=np.linalg.norm(rotation, axis=1) if rotation.size else None,
        span=span,
        min_clearance=np.inf if clearance is None else clearance,
        max_error=max((each for each in worst if each is not None), default=np.nan),
        effort=np.nan if effort is None else effort,
        rms_jerk=np.nan if jerk is None else jerk,
        end_time=result.end_time,
    )


def scores(
    *,
    status: str,
    t: Column,
    error: Column,
    span: tuple[float, float] | None,
    min_clearance: float,
    max_error: float,
    effort: float,
    rms_jerk: float,
    end_time: float,
    angle: Column | None = None,
) -> dict[str, Any]:
    """The columns that say how a run went, whoever made it.

    `error` [m] and, for tasks with an orientation, `angle` [rad] are taken at the instants `t` [s].
    """
    collided = min_clearance < -TOUCH
    through = status in (Status.COMPLETED, Status.COLLIDED)
    max_angle = np.nan if angle is None else angle.max(initial=0.0)
    off = error if angle is None else np.maximum(error, TIP / ANGLE * angle)  # held up to TIP
    during = after = recovery = np.nan
    if span is not None:
        inside = (t >= span[0]) & (t <= span[1])
        late = t > span[1]
        during, after = _rms(error[inside]), _rms(error[late])
        recovery = _recovery(t[late] - span[1], off[late]) if through else np.nan
    return {
        "status": status,
        "collided": collided,
        "diverged": not through,
        "success": through and not collided and max_error <= TIP and not max_angle > ANGLE,
        "returned": bool(through and not collided and off[-1] <= TIP),
        "min_clearance": min_clearance,
        "max_error": max_error,
        "max_angle": max_angle,
        "rms_error_during": during,
        "rms_error_after": after,
        "recovery_time": recovery,
        "effort": effort,
        "rms_jerk": rms_jerk,
        "end_time": end_time,
    }


def _rms(values: Column) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else np.nan


def _recovery(since: Column, distance: Column) -> float:
    """When the tip is back for good; NaN if it is not, or if nothing comes after the encounter."""
    if not len(since) or distance[-1] > TIP:
        return np.nan
    out = np.flatnonzero(distance > TIP)
    return float(since[out[-1] + 1]) if len(out) else 0.0


def check_path(path: str | Path) -> Path:
    """Refuse a path that rows cannot be written to."""
    path = Path(path)
    if path.suffix not in (".csv", ".parquet"):
        raise InputError(f"{path}: rows are written as .csv or .parquet")
    if path.suffix == ".parquet":
        extra("pyarrow.parquet", "io")
    return path


def loop_times(
    controllers: Iterable[str] | Mapping[str, Mapping[str, Any]] | None = None,
    category: int | str | Iterable[int | str] = "crowd",
    n: int | Iterable[int] = (4, 6, 9),
    count: int = 3,
    seed: int = scenes.EVALUATION.start,
    *,
    space: bool = False,
    arm: str | Iterable[str] = scenes.EVALUATED,
    task: str | Iterable[str] = ("position", "pose"),
) -> str:
    """How long one step of the closed loop takes, as Markdown: mean, median, percentiles and maximum.

    Every step of `count` scenes is timed alone, on one thread, called from Python: law, plant and, twice, the
    reading of the clock.

    Parameters
    ----------
    controllers, category, n, count, seed, space, arm, task : optional
        As in `evaluate`.
    """
    makers = _in_space(category, _listed(arm), _listed(task)) if space else _in_the_plane(category, n)
    made = {" | ".join(map(str, make.args)): make for make in makers}
    kinds = ["scenes", "arm", "task"] if space else ["scenes", "joints"]
    heads = ["controller", *kinds, "mean [µs]", "p50 [µs]", "p99 [µs]", "p99.9 [µs]", "max [µs]"]
    lines = [
        f"| {' | '.join(heads)} |",
        "|---" * (2 + 2 * space) + "|--:" * (len(heads) - 2 - 2 * space) + "|",
    ]
    for name, changes in chosen(controllers).items():
        for kind, make in made.items():
            taken: list[int] = []
            for each in range(seed, seed + count):
                taken += _timed(make(each).replace(**changes))
            p50, p99, p999, most = (1e-3 * x for x in np.percentile(taken, (50, 99, 99.9, 100)))
            mean = 1e-3 * np.mean(taken)
            lines.append(
                f"| {name} | {kind} | {mean:.2f} | {p50:.2f} | {p99:.2f} | {p999:.2f} | {most:.0f} |"
            )
    return "\n".join(lines)


def _timed(scene: Scenario) -> list[int]:
    """Times of all steps [ns]."""
    simulation = _core.Simulation(scene)
    clock, step, taken = time.perf_counter_ns, simulation.step, []
    for _ in range(round(scene.duration / scene["simulation.dt"])):
        start = clock()
        step()
        taken.append(clock() - start)
    return taken
