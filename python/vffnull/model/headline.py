"""What happened in a run, the worst first: one verdict, and a sentence for each thing, wherever it is told.

The core measures the facts; here they get their words.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from vffnull.model.arm import listed

if TYPE_CHECKING:
    from vffnull._core import Arm

__all__ = ["LOST", "OVER", "Finding", "Headline", "findings", "headline", "passing"]

Number = float | int | None
Severity = Literal["good", "odd", "bad"]

LOST = 1e-2
"""How far the end effector may be from its reference at the end [m]."""
_TURNED = 5e-2
"""The same of its orientation [rad]."""
_LEFT = 0.05
"""For how long a reference may still move at the end [s]."""
OVER = 1e-3
"""By which share a limit is exceeded before it counts: barriers hold a speed to parts in ten thousand."""


@dataclass(frozen=True)
class Finding:
    """One thing that should not happen, and did.

    Attributes
    ----------
    verdict : str
        A word or two, such as ``"collided"``.
    severity : {"odd", "bad"}
        Contact is bad, all else odd.
    text : str
        With which link or joint, when, and how much.
    """

    verdict: str
    severity: Severity
    text: str


@dataclass(frozen=True)
class Headline:
    """What is to be known first of a run.

    Attributes
    ----------
    verdict : str
        The worst that happened in a word or two; ``"completed"`` if nothing did.
    severity : {"good", "odd", "bad"}
        Good only if nothing is to be said against the run.
    lines : tuple of str
        Sentences, the worst first, and how it ended.
    """

    verdict: str
    severity: Severity
    lines: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.verdict}: {'; '.join(self.lines)}"


def headline(
    status: str,
    message: str,
    facts: Mapping[str, Number],
    arm: Arm,
    slides: frozenset[int] = frozenset(),
    ignoring: Sequence[str] = (),
) -> Headline:
    """The headline of a run.

    Parameters
    ----------
    status, message : str
        How it ended.
    facts : Mapping
        Metrics by name. Of what a file of an older version has not measured nothing is said.
    arm : Arm
        Whose links and joints are named.
    slides : frozenset of int, optional
        Which joints slide.
    ignoring : sequence of str, optional
        Links that may pass through an obstacle, of whose contact with it nothing is known.
    """
    is_over = status in ("completed", "collided")
    if not is_over:  # what it has not come to is no news
        facts = {name: value for name, value in facts.items() if name != "end_time_left"}
    found = list(findings(facts, arm, slides))
    lines = tuple(each.text for each in found)
    is_hit = any(each.severity == "bad" for each in found)
    if status == "interrupted" and not is_hit:  # the verdict says that it was
        return Headline(status, "odd", (message.replace(f"{status} at", "stopped at"), *lines))
    if not is_over and status != "interrupted":
        return Headline(status, "bad", (message, *lines))
    left, is_longer = _left(facts)
    more = (left,) if left and not is_longer else ()
    more = (*more, *_farthest(facts))
    if found:
        return Headline(found[0].verdict, found[0].severity, (*lines, message, *more))
    return Headline(status, "good", (f"{message}{_untouched(facts, ignoring)}", *more))


def passing(document: Mapping[str, Any]) -> tuple[str, ...]:
    """Links that may pass through an obstacle of this scenario."""
    return tuple(
        dict.fromkeys(link for each in document.get("obstacles", ()) for link in each.get("ignore", ()))
    )


def findings(
    facts: Mapping[str, Number], arm: Arm, slides: frozenset[int] = frozenset()
) -> Iterator[Finding]:
    """What should not have happened, the worst first.

    Parameters
    ----------
    facts : Mapping
        Metrics by name; those of a run that goes on say nothing of its end.
    arm : Arm
        Whose links and joints are named.
    slides : frozenset of int, optional
        Which joints slide.
    """
    yield from _contacts(facts, arm)
    yield from _touched(facts, arm)
    beyond = list(_limits(facts, arm, slides))
    yield from beyond
    if beyond and (cut := facts.get("programs_cut")):
        text = f"{cut} programs had no room for all constraints, or no time"
        yield Finding("over limits", "odd", text)
    if released := facts.get("released_time"):
        yield Finding("let go", "odd", f"the look-ahead let go parts of the task for {released:.3g} s")
    off, turned = facts.get("end_error") or 0.0, facts.get("end_orientation_error") or 0.0
    missed = [f"{_length(off)} off"] if off > LOST else []
    missed += [f"turned {math.degrees(turned):.1f}° from"] if turned > _TURNED else []
    if missed:
        text = f"the end effector is {' and '.join(missed)} its reference at the end"
        yield Finding("off reference", "odd", text)
    to_go, is_longer = _left(facts)
    if is_longer:
        yield Finding("not at its end", "odd", to_go)
    if cut := facts.get("cut_cycles"):
        left, late = facts.get("rollouts_left_out") or 0, facts.get("late_cycles") or 0
        text = f"the look-ahead was out of time in {cut} cycles and left out {left} roll-outs"
        yield Finding("out of time", "odd", text + (f"; {late} cycles were late" if late else ""))
    if broken := facts.get("slack_steps"):
        text = f"barriers were broken in {broken} of {facts.get('steps', '?')} steps"
        yield Finding("barrier broken", "odd", f"{text}, by up to {facts['max_slack']:.3g} m/s²")


def _contacts(facts: Mapping[str, Number], arm: Arm) -> Iterator[Finding]:
    """With obstacles, and among the arm's own links."""
    first, depth = facts.get("collision_time"), facts.get("intrusion_depth")
    if first is not None and depth is not None:
        link = facts.get("intrusion_link", facts.get("min_clearance_link"))  # as files of before had it
        text = f"{_link(arm, link)} was up to {_length(depth)} inside an obstacle"
        yield Finding("collided", "bad", text + _when(first, facts["intrusion_time"]))
    first, least = facts.get("self_collision_time"), facts.get("min_self_clearance")
    if first is not None and least is not None:
        one, other = (_link(arm, facts.get(f"min_self_clearance_{which}")) for which in ("link", "other"))
        text = f"{one} and {other} were up to {_length(-least)} inside each other"
        yield Finding("hit itself", "bad", text + _when(first, facts.get("self_intrusion_time")))


def _touched(facts: Mapping[str, Number], arm: Arm) -> Iterator[Finding]:
    """What was felt without having been seen, and what gave way."""
    first, yielded = facts.get("touched_time"), facts.get("max_yielded") or 0.0
    if first is not None:
        far = f"; the end effector gave way by up to {_length(yielded)}" if yielded > 0.0 else ""
        if stopped := facts.get("stopped_time"):
            far += f"; the task stopped for {stopped:.3g} s"
        where = f"on {_link(arm, facts['touched_link'])} or beyond it"
        yield Finding("touched", "odd", f"a contact was felt {where}, first at t = {first:.4g} s{far}")


def _limits(facts: Mapping[str, Number], arm: Arm, slides: frozenset[int]) -> Iterator[Finding]:
    """Of the arm: what its motors cannot do, and where its joints end."""
    for name in ("torque", "velocity"):
        ratio, joint = facts.get(f"{name}_limit_ratio"), facts.get(f"{name}_limit_joint")
        if ratio is not None and ratio > 1 + OVER:
            share = f"{100 * ratio:.4g} %"
            if name == "velocity":
                text = f"the speed of {_joint(arm, joint)} came to {share} of its limit"
            else:  # what is sent of it may be less
                quantity = "force" if joint in slides else "torque"
                text = f"the law asked {_joint(arm, joint)} for {share} of its {quantity} limit"
            yield Finding("over limits", "odd", text)
    for name, what in (("tip_speed", "the speed"), ("tip_angular_speed", "the angular speed")):
        ratio = facts.get(f"{name}_ratio")
        if ratio is not None and ratio > 1 + OVER:
            text = f"{what} of the end effector came to {100 * ratio:.4g} % of its limit"
            yield Finding("over limits", "odd", text)
    first, joint = facts.get("joint_limit_time"), facts.get("joint_limit_joint")
    if first is not None:
        beyond = facts.get("joint_limit_violation") or 0.0
        far = _length(beyond) if joint in slides else f"{math.degrees(beyond):.3g}°"
        reached = f"was up to {far} beyond its limits" if beyond > 0 else "came to its stop"
        when = "from the start" if first == 0 else f"first at t = {first:.4g} s"
        yield Finding("at a stop", "odd", f"{_joint(arm, joint)} {reached}, {when}")


def _left(facts: Mapping[str, Number]) -> tuple[str, bool]:
    """What is left of the reference at the end, if anything is, and whether other plans or a governor are the
    reason: it may as well be longer than the run.
    """
    left, late = facts.get("end_time_left") or 0.0, facts.get("end_delay") or 0.0
    if left <= _LEFT:
        return "", False
    to_go = f"had {left:.3g} s to go"
    if facts.get("replans"):
        return f"the new plan {to_go} at the end", True
    if late > left - _LEFT:
        return f"the reference, which waited for {late:.3g} s, {to_go} at the end", True
    return f"the reference {to_go}", False


def _farthest(facts: Mapping[str, Number]) -> Iterator[str]:
    """How far the end effector was off a reference that it had reached, if farther than at the end."""
    most = facts.get("max_error_lost") or 0.0
    if most > max(LOST, facts.get("end_error") or 0.0):
        yield f"the end effector was up to {_length(most)} off its reference"


def _untouched(facts: Mapping[str, Number], ignoring: Sequence[str]) -> str:
    """What was kept apart, of what was measured."""
    obstacles, links = (facts.get(f"min_{name}") is not None for name in ("clearance", "self_clearance"))
    what = {(True, True): "", (True, False): " with an obstacle", (False, True): " of its own links"}
    if (facts.get("min_clearance") or 0.0) < 0.0:  # and no collision
        more = f", and for what {listed(ignoring)} may touch" if ignoring else ""
        return f" without contact but for what the tip presses on{more}"
    more = f", but for what {listed(ignoring)} may touch" if ignoring else ""
    return f" without contact{what[obstacles, links]}{more}" if obstacles or links else ""


def _when(first: float, total: Number) -> str:
    begun = "from the start" if first == 0 else f"first at t = {first:.4g} s"
    return f", {begun}" + (f", for {total:.3g} s in all" if total else "")


def _link(arm: Arm, link: Number) -> str:
    if link is None:
        return "the base"
    return arm.link_names[int(link)]


def _joint(arm: Arm, joint: Number) -> str:
    if joint is None:
        return "a joint"
    return arm.joint_names[int(joint)] if arm.dimension == 3 else f"joint {joint}"


def _length(metres: float) -> str:
    return f"{metres:.3g} m" if metres >= 1 else f"{1e3 * metres:.3g} mm"
