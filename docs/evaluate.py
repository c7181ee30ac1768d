"""Write docs/evaluation.md and its figures: `python docs/evaluate.py`, with vffnull[evaluate,peers].

`python docs/evaluate.py --space` writes docs/evaluation-spatial.md instead.

Finished parts are kept in target/evaluation, so that an interrupted run resumes where it was. Remove the
parts of a controller after changing it (`verdicts.json` may stay: it does not depend on controllers).
`python docs/evaluate.py 34` takes 34 instead of 334 scenes for each category and number of joints, in space
instead of 60 for each family, arm and task.
"""

from __future__ import annotations

import json
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np

import vffnull as vff
from vffnull import evaluation
from vffnull.evaluation import scenes
from vffnull.evaluation.planner import ANGLE, TIP, VERDICTS
from vffnull.run import evaluate as evaluating

DOCS = Path(__file__).resolve().parent
KEPT = DOCS.parent / "target" / "evaluation"
COUNT, CHUNK = 334, 48  # scenes for each category and number of joints, in all and at a time
FIRST = scenes.EVALUATION.start
SIZES = (4, 6, 9)
PEERS = 5  # scenes for each family and number of joints under other libraries

# Feasible scenes of another study, with 1200 scenes of its own: collisions and, in brackets, success [%].
ELSEWHERE = {
    "null-space field": {"links-swept": "1", "path-crossed": "100", "clutter": "37", "crowd": "70"},
    "cbf": {"links-swept": "0 (98)", "path-crossed": "1 to 3", "clutter": "0 (89)", "crowd": "22 to 25"},
    "cbf + preview": {"crowd": "7 to 11"},
}

HEAD = """# Controllers against each other

{total} random scenes under {controllers} controllers, made by `python docs/evaluate.py{count}`, vffnull
{version}, in a quarter of an hour on two cores. `vffnull.evaluation.scenes` generates the scenes from a seed;
seeds from 1 000 000 on are used here, and no parameter has been tuned on them.

**Feasibility.** A planner that knows the future searches for a collision-free motion of the arm, without
any controller. The motion keeps 1 mm or more from everything, at joint speeds up to 3 rad/s and
accelerations up to 30 rad/s²: first with the tip within 1 cm of its reference ("with tip"), then without
this condition ("without tip"). The rule was fixed before any controller was run; the module
`planning/feasibility` states it in full. "None found" does not prove that no such motion exists.

**Collision**: an overlap of more than 1 mm. **Success**: no collision, and the tip within 1 cm of its
reference at all times. Rates are in per cent, with 95 % confidence intervals (Wilson score). "Feasible"
scenes are those in which a collision-free motion exists; "feasible with tip" are those in which it also
holds the tip. The encounter lasts as long as the arm without avoidance has an obstacle within 0.1 m.
Numbers that are not rates are medians of the runs that completed. Every controller has the settings of
the scene (K = 100/s², D = 20/s, null damping 6/s, Khatib's field with 0.3 N·m³ from 0.6 m on) and
otherwise the defaults; the unprojected field is that of Khatib (1986).

![Random scenes of the four families, at the start and later.](figures/random-scenes.png)

![Collision and success rates of all controllers in the four families.](figures/evaluation/rates.png)
"""

TAIL = """
The lines are empirical cumulative distributions: the share of the runs that came nearer, or had a
smaller error.

![Distributions of the smallest clearance.](figures/evaluation/clearance.png)

![Distributions of the tip's error during the encounter and after it.](figures/evaluation/error.png)
"""


BUNDLED = """## Bundled scenes

These scenes are not random: `vffnull list` names them.

![Six bundled scenes: on-path, on-path-moving, crowd, narrow-gap, pincer, chase.](figures/scenes.png)
"""


def in_the_plane(count: int) -> None:
    """Run what is not there yet, and write the document."""
    ours = evaluating.join(
        kept(
            f"{name.replace(' ', '-')}-{category}-{n}-{first}-{size}",
            first,
            size,
            {name: changes},
            category=category,
            n=n,
        )
        for name, changes in evaluation.CONTROLLERS.items()
        for category in scenes.CATEGORIES
        for n in SIZES
        for first, size in chunks(count)
    )
    ours.plot(DOCS / "figures" / "evaluation")
    given = "" if count == COUNT else f" {count}"
    total = len(ours) // len(ours.controllers)
    parts = [
        HEAD.format(total=total, controllers=len(ours.controllers), count=given, version=vff.__version__),
        ours.table(),
        TAIL,
        sizes(ours),
        elsewhere(ours),
        peers(),
        causes(ours),
        parameters(),
        BUNDLED,
        "## Time of a step\n\nControl law and plant, in crowds, called from Python on one thread. The "
        "maximum is caused by other programs on the machine.\n",
        evaluating.loop_times(n=SIZES),
    ]
    (DOCS / "evaluation.md").write_text("\n".join(parts) + "\n", encoding="utf-8")


def chunks(count: int) -> list[tuple[int, int]]:
    """First seeds and sizes of parts."""
    starts = range(0, count, CHUNK)
    return [(FIRST + start, min(CHUNK, count - start)) for start in starts]


SPACE = 60  # scenes for each family, arm and task
TASKS = ("position", "pose")

HEAD_IN_SPACE = """# Controllers against each other in space

{total} random scenes of three arms under {controllers} controllers, made by
`python docs/evaluate.py --space`{count}, vffnull {version}. `vffnull.evaluation.scenes.in_space` generates
the scenes from a seed; seeds from 1 000 000 on are used here, and no parameter has been tuned on them. The
arms are a Panda, an iiwa 14 and a UR5e with their makers' limits of angle, speed and torque; the tasks
are a position and a pose, which leaves the seven-joint arms one degree of freedom and the UR5e none.
Scenes last 4 s.

**links-swept**: one or two bodies of 4 to 12 cm push against links between shoulder and wrist, or go
through their place, at 0.2 to 0.6 m/s; the hand has room. **path-crossed**: a body lies on the hand's
line, or crosses it when the hand is there. **clutter**: bodies at rest about the links and the hand's
free path, half of the scenes with a shelf of boards. **crowd**: three to six spheres move through the
arm's place; the hand has room.

**Feasibility.** A planner that knows the future searches for a collision-free motion of the arm, without
any controller. The motion keeps 1 mm or more from everything, within the arm's limits of joint angles
and speeds, at accelerations up to 10 rad/s²: first with the tip held ("with tip"), then without this
condition ("without tip"). The rule was fixed before any controller was run; the module
`planning/feasibility` states it in full. "None found" does not prove that no such motion exists.

**Collision**: an overlap of more than 1 mm. The tip is **held** if it is within 1 cm of its reference
and, where the task has an orientation, turned from it by 0.05 rad at most. **Success**: no collision,
and the tip held at all times. **Returned**: no collision, and the tip held at the end. Rates are in per
cent, with 95 % confidence intervals (Wilson score). "Feasible" scenes are those in which a
collision-free motion exists; "feasible with tip" are those in which it also holds the tip. The encounter
lasts as long as the arm without avoidance has an obstacle within 0.1 m. Numbers that are not rates are
medians of the runs that completed; the effort contains the torque against gravity. Every controller has
the settings of the scene (K = 900/s², D = 60/s, null damping 6/s, a bounded field of 100 N from 0.3 m
on, one of 10 N·m from 0.3 rad before joint limits) and otherwise the defaults; the unprojected field is
that of Khatib (1986).

![Collision and success rates of all controllers in the four families.](figures/evaluation-spatial/rates.png)
"""


def in_space(count: int) -> None:
    """The same in space."""
    ours = evaluating.join(
        kept(
            f"{name.replace(' ', '-')}-{family}-{arm}-{task}-{FIRST}-{count}",
            FIRST,
            count,
            {name: changes},
            category=family,
            space=True,
            arm=arm,
            task=task,
        )
        for name, changes in evaluation.CONTROLLERS.items()
        for family in scenes.FAMILIES
        for arm in scenes.EVALUATED
        for task in TASKS
    )
    ours.plot(DOCS / "figures" / "evaluation-spatial")
    given = "" if count == SPACE else f" with the argument {count}"
    total = len(ours) // len(ours.controllers)
    parts = [
        HEAD_IN_SPACE.format(
            total=total, controllers=len(ours.controllers), count=given, version=vff.__version__
        ),
        aims(ours),
        ours.table(),
        TAIL.replace("figures/evaluation/", "figures/evaluation-spatial/"),
        arms_and_tasks(ours),
        causes(ours, KINDS_IN_SPACE),
        losses(ours),
        tried(),
        "## Time of a step\n\nControl law and plant, in crowds, called from Python on one thread. The "
        "maximum is caused by other programs on the machine.\n",
        evaluating.loop_times(space=True, task=TASKS),
    ]
    (DOCS / "evaluation-spatial.md").write_text("\n".join(parts) + "\n", encoding="utf-8")


# What was aimed at before anything was measured, with one set of defaults for all of it: a family, a rate, in
# what runs, and what cbf without and with look-ahead is to reach [%].
COLLISIONS, HELD, BACK = "collisions_feasible", "success_feasible_with_tip", "returned_feasible"
AIMS = (
    ("links-swept", "collisions", COLLISIONS, {}, ("0", "0")),
    ("links-swept", "hand held, position", HELD, {"task": "position"}, ("≥ 95", "≥ 95")),
    ("links-swept", "hand held, pose", HELD, {"task": "pose"}, ("≥ 85", "≥ 85")),
    ("path-crossed", "collisions", COLLISIONS, {}, ("≤ 2", "≤ 2")),
    ("path-crossed", "back on the path", BACK, {}, ("≥ 93", "≥ 93")),
    ("clutter", "collisions", COLLISIONS, {}, ("0", "0")),
    ("clutter", "at the goal", BACK, {}, ("≥ 90", "≥ 90")),
    ("crowd", "collisions", COLLISIONS, {}, ("≤ 20", "≤ 3")),
)


def aims(outcome: vff.Evaluation) -> str:
    """What was aimed at, beside what became of it."""
    lines = [
        "## Aims\n",
        "Set before anything was measured, for one set of defaults. Collisions and returns are those of "
        "feasible scenes; a hand is held throughout in scenes that are feasible with tip.\n",
        "| family | rate [%] | " + " | ".join(f"aim | {name}" for name in CBF) + " |",
        "|---|---|" + "--:|--:|" * len(CBF),
    ]
    for family, words, key, which, wanted in AIMS:
        rows = outcome.where(family=family, **which)
        found = [rows.where(controller=name).rates()[key] for name in CBF]
        cells = " | ".join(f"{aim} | {rate}" for aim, rate in zip(wanted, found, strict=True))
        lines.append(f"| {family} | {words} | {cells} |")
    return "\n".join(lines) + "\n"


def arms_and_tasks(outcome: vff.Evaluation) -> str:
    """What becomes of every family, arm and task."""
    names = ("null-space field", *CBF)
    lines = [
        "## Arms and tasks\n\nFor every controller: collisions in feasible scenes / success in scenes that "
        "are feasible with tip / returned in feasible scenes [%].\n",
        "| family | arm | task | scenes: with tip, without, none | " + " | ".join(names) + " |",
        "|---|---|---|--:" + "|--:" * len(names) + "|",
    ]
    for family in outcome.families:
        for arm in scenes.EVALUATED:
            for task in TASKS:
                rows = outcome.where(family=family, arm=arm, task=task)
                found = list(rows.where(controller=names[0]).columns["feasibility"])
                cells = [", ".join(str(found.count(verdict)) for verdict in VERDICTS)]
                for name in names:
                    rates = rows.where(controller=name).rates()
                    three = ("collisions_feasible", "success_feasible_with_tip", "returned_feasible")
                    shares = (rates[key] for key in three)
                    cells.append(" / ".join(f"{100 * r.value:.0f}" if r.total else "–" for r in shares))
                lines.append(f"| {family} | {arm} | {task} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def kept(
    name: str,
    first: int,
    size: int,
    controllers: dict[str, dict[str, object]] | None = None,
    **which: object,
) -> vff.Evaluation:
    """A part of the evaluation, run unless there is a file of it."""
    file = KEPT / f"{name}.npz"
    if not file.exists():
        outcome = evaluating.evaluate(controllers, count=size, seed=first, verdicts=verdicts(), **which)
        verdicts(outcome.verdicts)
        np.savez(file, controllers=np.array(outcome.controllers), **outcome.columns)
        print(f"{name}: done", file=sys.stderr, flush=True)
    with np.load(file) as read:
        columns = {key: read[key] for key in read.files if key != "controllers"}
        return vff.Evaluation(columns, tuple(map(str, read["controllers"])))


def verdicts(more: dict[str, str] | None = None) -> dict[str, str]:
    """What is known of scenes; keeps more of it."""
    KEPT.mkdir(parents=True, exist_ok=True)
    file = KEPT / "verdicts.json"
    known: dict[str, str] = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    if more:
        known |= more
        file.write_text(json.dumps(known), encoding="utf-8")
    return known


CBF = ("cbf", "cbf + preview")


def sizes(outcome: vff.Evaluation) -> str:
    """Collisions of cbf by the number of joints."""
    lines = [
        "## cbf by the number of joints\n\nCollisions in feasible scenes, and success in scenes that are "
        "feasible with tip [%].\n",
        "| family | controller | " + " | ".join(f"collisions, n = {n}" for n in SIZES),
    ]
    lines[-1] += " | " + " | ".join(f"success, n = {n}" for n in SIZES) + " |"
    lines.append("|---|---" + "|--:" * 2 * len(SIZES) + "|")
    for family in outcome.families:
        for name in CBF:
            rows = outcome.where(family=family, controller=name)
            rates = [str(rows.feasible.where(n=n).rate("collided")) for n in SIZES]
            rates += [str(rows.with_tip.where(n=n).rate("success")) for n in SIZES]
            lines.append(f"| {family} | {name} | {' | '.join(rates)} |")
    return "\n".join(lines) + "\n"


def elsewhere(outcome: vff.Evaluation) -> str:
    """Beside the reference points."""
    lines = [
        "## Beside another study\n\nAnother study used 1200 scenes of its own, with another "
        "implementation of a "
        "CBF law. Both its scenes and its definition of feasibility differ from those here; the "
        "results of the "
        "null-space field alone show how difficult the scenes are.\n",
        "| family | controller | collisions, feasible [%] | the same, feasible with tip [%] "
        "| success, feasible [%] | success, feasible with tip [%] | there: collisions (success) [%] |",
        "|---|---|--:|--:|--:|--:|--:|",
    ]
    for family in outcome.families:
        for name, there in ELSEWHERE.items():
            rows = outcome.where(family=family, controller=name).feasible
            cells = [
                str(rows.rate("collided")),
                str(rows.with_tip.rate("collided")),
                str(rows.rate("success")),
                str(rows.with_tip.rate("success")),
                there.get(family, "–"),
            ]
            lines.append(f"| {family} | {name} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


VARIANTS = {
    "defaults": {},
    "rate = 20": {"yielding.rate": 20.0},
    "rate = 80": {"yielding.rate": 80.0},
    "margin = 0.01": {"yielding.margin": 0.01},
    "margin = 0.03": {"yielding.margin": 0.03},
    "task_weight = 5": {"yielding.task_weight": 5.0},
    "task_weight = 100": {"yielding.task_weight": 100.0},
    "activation = 0.6": {"yielding.activation": 0.6},
    "speed = 4": {"yielding.speed": 4.0},
    "slack_weight = 1e4": {"yielding.slack_weight": 1e4},
    "field.gain = 1": {"field.gain": 1.0},
}


def parameters() -> str:
    """What parameters of cbf change, on training seeds."""
    cbf = evaluation.CONTROLLERS["cbf"]
    controllers = {
        name: cbf | {f"controller.{key}": value for key, value in changes.items()}
        for name, changes in VARIANTS.items()
    }
    found = evaluating.join(
        kept(f"training-{family}-{n}", scenes.TRAINING.start, CHUNK, controllers, category=family, n=n)
        for family in scenes.FAMILIES
        for n in SIZES
    )
    lines = [
        "## Which parameters of cbf matter\n",
        f"{CHUNK} training scenes of every family and number of joints: collisions in feasible scenes "
        "and, after the slash, success in scenes that are feasible with tip. A variant that differs from the "
        "defaults by a few scenes only is no reason to change them; `examples/tune.py` searches further.\n",
        "| cbf with | " + " | ".join(scenes.FAMILIES) + " |",
        "|---" + "|--:" * len(scenes.FAMILIES) + "|",
    ]
    for name in VARIANTS:
        cells = []
        for family in scenes.FAMILIES:
            rows = found.where(controller=name, family=family)
            hit, held = rows.feasible.rate("collided"), rows.with_tip.rate("success")
            cells.append(f"{hit.count} of {hit.total} / {held.count} of {held.total}")
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def peers() -> str:
    """Other libraries on the first scenes of every family, beside ours on the same."""
    sys.path.insert(0, str(DOCS.parent / "benches"))
    from peers import avoidance

    return avoidance.report(KEPT, PEERS, SIZES, verdicts)


CAUSES = {
    "flat side": "a link lies along a flat side, and the nearest point jumps from corner to corner: a sample "
    "has a barrier for one of them only, and the slack stays far below the 32 m/s² that hold a contact",
    "pinched": "two or more obstacles within 0.1 m require opposite accelerations: the rows of the "
    "QP contradict "
    "each other, and a slack is recorded",
    "out of reach": "one obstacle, and hardly any joint can move the link out of its way: contact "
    "next to the "
    "base, or the arm stretched along the normal (effective mass above 20 kg)",
    "speed limit": "a joint is at the barrier of its speed, 6 rad/s, and the distance yields",
    "tip first": "one obstacle, and the null space has an authority ρₙ below 0.1: only the task "
    "could have given way",
    "cornered": "one obstacle, with authority left, and the distance yields to other barriers all the same",
    "no slack": "the QP violated nothing: the distance was lost between two samples",
}


KINDS_IN_SPACE = {
    "speed limit": "a joint is at 95 % of its maker's speed limit, and the distance yields",
    "torque limit": "a joint is at its maker's torque limit",
    "joint limit": "a joint is within 0.05 rad of the end of its range",
}


def causes(outcome: vff.Evaluation, others: dict[str, str] | None = None) -> str:
    """Why cbf collides in feasible scenes, run by run; `others` replace the words on limits."""
    words = CAUSES | (others or {})
    rows = outcome.where(controller=CBF, collided=True).feasible.columns
    found: dict[tuple[str, str], dict[str, list[tuple[float, float, float]]]] = {
        (family, name): defaultdict(list) for family in outcome.families for name in CBF
    }
    keys = ("arm", "task") if "arm" in rows else ("n",)
    every = zip(*(rows[key] for key in ("family", "controller", "seed", *keys)), strict=True)
    for family, name, seed, *kind in every:
        if len(kind) == 2:
            scene = scenes.in_space(str(family), str(kind[0]), str(kind[1]), int(seed))
        else:
            scene = scenes.random(str(family), int(kind[0]), int(seed))
        why, *numbers = cause(vff.simulate(scene, evaluation.CONTROLLERS[str(name)]))
        found[str(family), str(name)][why].append((numbers[0], numbers[1], numbers[2]))
    kinds = [kind for kind in words if any(kind in counts for counts in found.values())]
    lines = [
        "## Where cbf collides although a collision-free motion exists\n",
        "Every such run is classified by what happens in the 0.2 s before the first contact; the "
        "first cause that "
        "applies counts." + ("\n" if others else " The default barrier of the joint speed is 6 rad/s.\n"),
        *(f"- **{kind}**: {words[kind]}." for kind in kinds),
        "",
        "| family | controller | runs | " + " | ".join(kinds) + " |",
        "|---|---|--:" + "|--:" * len(kinds) + "|",
    ]
    for (family, name), counts in found.items():
        total = sum(map(len, counts.values()))
        lines.append(
            f"| {family} | {name} | {total} | " + " | ".join(str(len(counts[k])) for k in kinds) + " |"
        )
    lines += [
        "",
        "| cause | runs | slack, median [m/s²] | ρₙ of the touched pair, median "
        "| fastest joint, median [rad/s] |",
        "|---|--:|--:|--:|--:|",
    ]
    for kind in kinds:
        numbers = np.array([each for counts in found.values() for each in counts[kind]])
        slack, authority, speed = np.median(numbers, axis=0)
        lines.append(f"| {kind} | {len(numbers)} | {slack:.3g} | {authority:.2f} | {speed:.2f} |")
    return "\n".join(lines) + "\n"


def cause(result: vff.Result) -> tuple[str, float, float, float]:
    """What held the arm when it was first touched; slack, authority, and speed of the fastest joint."""
    hit = int(np.argmax(result.clearance.min(axis=1) < 0.0))
    before = slice(max(hit - 200, 0), hit + 1)
    q, dq = result.q[hit], result.dq[hit]
    arm, obstacles = result.scenario.arm, result.scenario["obstacles"]
    pairs = vff.distances(arm, q, dq, obstacles, float(result.t[hit]))
    touched = pairs.gradient[np.argmin(pairs.distance)]
    M_inv, J = np.linalg.inv(arm.mass_matrix(q)), arm.jacobian(q)[: result.error.shape[1]]
    N = np.eye(arm.n) - M_inv @ J.T @ np.linalg.solve(J @ M_inv @ J.T, J)
    mobility = float(touched @ M_inv @ touched)
    authority = float(touched @ N @ M_inv @ touched) / mobility
    slack, speed = float(result.slack[before].max()), float(np.abs(result.dq[before]).max())
    jumps = jumping(result, hit, int(np.argmin(pairs.distance)))
    near = pairs.distance < 0.1
    opposed = (pairs.gradient[near] @ M_inv @ touched).min() < 0.0
    if slack <= 1e-6:
        why = "no slack"
    elif slack < 5.0 and jumps:
        why = "flat side"
    elif opposed and len(set(pairs.obstacle[near])) > 1:
        why = "pinched"
    elif mobility < 1.0 / 20.0:
        why = "out of reach"
    else:
        why = at_a_limit(result, before) or ("tip first" if authority < 0.1 else "cornered")
    return why, slack, authority, speed


def at_a_limit(result: vff.Result, rows: slice) -> str | None:
    """Which limit of the joints is reached in some rows."""
    arm = result.scenario.arm
    speed, torque = np.abs(result.dq[rows]), np.abs(result.tau[rows])
    if (speed > (5.7 if arm.velocity_limits is None else 0.95 * arm.velocity_limits)).any():
        return "speed limit"
    if arm.torque_limits is not None and (torque > 0.999 * arm.torque_limits).any():
        return "torque limit"
    if arm.joint_limits is not None:
        middle, half = arm.joint_limits.mean(axis=1), 0.5 * np.ptp(arm.joint_limits, axis=1)
        if (np.abs(result.q[rows] - middle) > half - 0.05).any():
            return "joint limit"
    return None


LOSSES = {
    "no room": "an obstacle is within 5 cm of a link, and the null space hardly moves that link away from "
    "it, ρₙ below 0.1: either the hand gives way or the distance does",
    "opposed": "two or more obstacles within 0.1 m require opposite accelerations",
    "speed limit": KINDS_IN_SPACE["speed limit"].partition(",")[0],
    "torque limit": KINDS_IN_SPACE["torque limit"],
    "joint limit": KINDS_IN_SPACE["joint limit"],
    "in the way": "an obstacle is within 5 cm of a link, with authority left",
    "elsewhere": "nothing is near and no limit is reached",
}
LOST = (
    ("lost", "lost, where a motion holds it throughout", {"success": False, "feasibility": VERDICTS[0]}),
    ("away", "away at the end, where a motion avoids all", {"returned": False, "feasibility": VERDICTS[:2]}),
)


def losses(outcome: vff.Evaluation) -> str:
    """Why the hand is not held under cbf, or not back, without a collision, run by run."""
    lines = []
    met: set[str] = set()
    for which, words, wanted in LOST:
        for family in outcome.families:
            for name in CBF:
                runs = outcome.where(controller=name, family=family, collided=False, **wanted).columns
                found = [
                    loss(
                        vff.simulate(scenes.in_space(*map(str, of), int(seed)), evaluation.CONTROLLERS[name]),
                        which,
                    )
                    for *of, seed in zip(
                        *(runs[key] for key in ("family", "arm", "task", "seed")), strict=True
                    )
                ]
                met |= set(found)
                lines.append((family, name, words, found))
    kinds = [kind for kind in LOSSES if kind in met]
    return "\n".join(
        [
            "## Where the hand is lost, or not back at the end\n",
            "Without a collision. What holds when the hand is first more than 1 cm or 0.05 rad away, or at "
            "the end of the run; the first cause that applies counts.\n",
            *(f"- **{kind}**: {LOSSES[kind]}." for kind in kinds),
            "",
            "| family | controller | the hand is | runs | " + " | ".join(kinds) + " |",
            "|---|---|---|--:" + "|--:" * len(kinds) + "|",
            *(
                f"| {family} | {name} | {words} | {len(found)} | "
                + " | ".join(str(found.count(kind)) for kind in kinds)
                + " |"
                for family, name, words, found in lines
                if found
            ),
            "",
        ]
    )


# What may limit cbf, changed on training scenes: family, arm, task, what it is called, and the change.
TRIED_FIRST = scenes.TRAINING.start + 5000
TRIED = (
    ("links-swept", "iiwa14", "pose", "the maker's limits of speed", {}),
    ("links-swept", "iiwa14", "pose", "1.5 times these limits", {"speed": 1.5}),
    ("clutter", "ur5e", "pose", "a margin of 20 mm", {}),
    ("clutter", "ur5e", "pose", "a margin of 5 mm", {"controller.yielding.margin": 0.005}),
)


def tried() -> str:
    """What becomes of cbf where a limit is another one."""
    lines = [
        f"On {SPACE} training scenes each, `cbf` with one thing changed:\n",
        "| family | arm | task | with | collisions, feasible [%] | success, feasible with tip [%] "
        "| returned, feasible [%] |",
        "|---|---|---|---|--:|--:|--:|",
    ]
    for family, arm, task, words, change in TRIED:
        changes = {**evaluation.CONTROLLERS["cbf"], **change}
        if faster := changes.pop("speed", None):
            limits = vff.Arm.named(arm).velocity_limits
            changes["arm.velocity_limits"] = [float(faster * limit) for limit in limits]
        rates = evaluating.evaluate(
            {"cbf": changes}, count=SPACE, seed=TRIED_FIRST, category=family, space=True, arm=arm, task=task
        ).rates()
        cells = " | ".join(str(rates[key]) for key in (COLLISIONS, HELD, BACK))
        lines.append(f"| {family} | {arm} | {task} | {words} | {cells} |")
    return "\n".join(lines) + "\n\n" + ANSWER


ANSWER = """\
**What is missed.** Links that are swept collide in 1 of 100 scenes with look-ahead, because two bodies
pinch them, or beside the base, where hardly any joint moves them. The hand of an iiwa 14 that holds a pose
is lost in a quarter of the scenes in which a motion holds it, with look-ahead in a third, because its
joints are slow, 1.3 to 2.4 rad/s: the planner starts before anything is near, and with half as much speed
again two of three of these are held. With the
[search of the self-motion](evaluation-self-motion.md) it holds 86 % of them, 67 without. At the goal in
clutter: a UR5e that holds a pose has no joint to spare, so that whatever
stands in its way holds it up, whatever the margin; that is a matter for
[plans](plans.md), which find a way around: with a table `replan`, [made when it is held
up](evaluation-held-up.md), 87 % are back within 8 s, and 47 without. Everything else is reached, by one set
of defaults for all arms, tasks and families. Tried on training scenes of the plane and not better: the
acceleration of obstacles in roll-outs, an alarm on a foreseen error of the hand, letting go only shortly
before contact, more candidates.
"""


def loss(result: vff.Result, which: str) -> str:
    """What keeps the hand away when it is first lost, or at the end of a run."""
    away = np.linalg.norm(result.error[:, :3], axis=1) > TIP
    if result.error.shape[1] > 3:
        away |= np.linalg.norm(result.error[:, 3:], axis=1) > ANGLE
    at = int(np.argmax(away)) if which == "lost" else len(result.t) - 1
    q, dq = result.q[at], result.dq[at]
    arm = result.scenario.arm
    pairs = vff.distances(arm, q, dq, result.scenario["obstacles"], float(result.t[at]))
    nearest = int(np.argmin(pairs.distance))
    touched = pairs.gradient[nearest]
    M_inv, J = np.linalg.inv(arm.mass_matrix(q)), arm.jacobian(q)[: result.error.shape[1]]
    y = J @ M_inv @ touched
    mobility = float(touched @ M_inv @ touched)
    in_null_space = mobility - float(y @ np.linalg.pinv(J @ M_inv @ J.T) @ y)
    close = pairs.distance < 0.1
    opposed = (pairs.gradient[close] @ M_inv @ touched).min(initial=0.0) < 0.0
    if pairs.distance[nearest] < 0.05 and in_null_space < 0.1 * mobility:
        return "no room"
    if opposed and len(set(pairs.obstacle[close])) > 1:
        return "opposed"
    limit = at_a_limit(result, slice(max(at - 200, 0), at + 1))
    return limit or ("in the way" if pairs.distance[nearest] < 0.05 else "elsewhere")


def jumping(result: vff.Result, hit: int, pair: int) -> bool:
    """Whether a pair's nearest point jumps by 0.1 m or more from one sample to the next, before the touch."""
    rows = range(max(hit - 200, 0), hit + 1)
    arm, obstacles = result.scenario.arm, result.scenario["obstacles"]
    found = vff.distances(arm, result.q[rows], result.dq[rows], obstacles, result.t[rows])
    steps = np.linalg.norm(np.diff(found.point[:, pair], axis=0), axis=1)
    return bool(steps.max() > 0.1)


def main(arguments: list[str]) -> None:
    """The document of the plane or, with --space, of space; a number is that of the scenes."""
    space = "--space" in arguments
    numbers = [int(each) for each in arguments if each != "--space"]
    count = numbers[0] if numbers else SPACE if space else COUNT
    (in_space if space else in_the_plane)(count)


if __name__ == "__main__":
    main(sys.argv[1:])
