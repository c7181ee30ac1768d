"""How people move who reach, swing an arm or walk: joints over time, drawn by a seed.

Lengths are shares of the height (Drillis and Contini, 1966, as in Winter's Biomechanics), radii are adults'.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from vffnull._support.arguments import array, number, positive, whole
from vffnull._support.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    Array = NDArray[np.float64]

__all__ = ["reaching", "swinging", "walking"]

UPPER_ARM, FOREARM, HAND = 0.186, 0.146, 0.108
THIGH, SHANK, FOOT, ANKLE = 0.245, 0.246, 0.152, 0.039
TRUNK, NECK, SHOULDERS, HIPS = 0.288, 0.052, 0.259, 0.191
ARM_RADII = (0.05, 0.04, 0.045)
LONGEST = 3600.0
"""The longest motion [s]."""
RATE = 25.0
"""Instants per second."""


def reaching(
    shoulder: ArrayLike,
    target: ArrayLike,
    speed: float,
    hold: float,
    begin: float,
    height: float | None,
    seed: int,
) -> tuple[Any, ...]:
    """Times, joints, bones and radii of an arm that reaches for a place and goes back."""
    import numpy as np

    draw, height = _drawn(height, seed)
    shoulder, target = array("shoulder", shoulder, (3,)), array("target", target, (3,))
    to = target - shoulder
    longest = 0.99 * (UPPER_ARM + FOREARM + HAND) * height
    if not 0.05 * height < np.linalg.norm(to) < longest:
        raise InputError(
            f"target: {np.linalg.norm(to):.3g} m from the shoulder; the arm of a person of {height:.3g} m "
            f"reaches from {0.05 * height:.2g} to {longest:.3g} m"
        )
    level = to * [1.0, 1.0, 0.0]
    ahead = level / np.linalg.norm(level) if np.linalg.norm(level) > 1e-6 else np.array([1.0, 0.0, 0.0])
    rest = shoulder + height * (draw.uniform(0.1, 0.16) * ahead - [0.0, 0.0, draw.uniform(0.16, 0.24)])
    arc = draw.uniform(0.0, 0.1)
    way = float(np.linalg.norm(target - rest))
    # 10s³ − 15s⁴ + 6s⁵ is fastest in the middle: 15/8 of the mean, plus what the arc adds.
    trip = max(1.875 * way * np.hypot(1.0, np.pi * arc) / positive("speed", speed), 0.2)
    hold, begin = _span("hold", hold), _span("begin", begin)
    times = _instants(begin + 2.0 * trip + hold, begin)
    share = _least_jerk((times - begin) / trip) - _least_jerk((times - begin - trip - hold) / trip)
    hand = rest + share[:, None] * (target - rest)
    hand[:, 2] += arc * way * np.sin(np.pi * share)
    return (
        times,
        _arm(shoulder, hand, ahead, height),
        [(0, 1), (1, 2), (2, 3)],
        ARM_RADII,
        ("shoulder", "elbow", "wrist", "hand"),
    )


def swinging(
    shoulder: ArrayLike,
    direction: float,
    angle: float,
    frequency: float,
    duration: float,
    height: float | None,
    seed: int,
) -> tuple[Any, ...]:
    """The same of an arm that swings below its shoulder."""
    import numpy as np

    draw, height = _drawn(height, seed)
    shoulder = array("shoulder", shoulder, (3,))
    times = _instants(_span("duration", duration))
    phase, bend = draw.uniform(-np.pi, np.pi), draw.uniform(0.15, 0.6)
    swing = (
        number("angle", angle)
        * _from_rest(times)
        * np.sin(2.0 * np.pi * number("frequency", frequency) * times + phase)
    )
    ahead = _level(number("direction", direction))
    upper = _down(swing, ahead)
    lower = _down(swing + bend, ahead)
    elbow = shoulder + UPPER_ARM * height * upper
    wrist = elbow + FOREARM * height * lower
    joints = np.stack(
        [np.broadcast_to(shoulder, elbow.shape), elbow, wrist, wrist + HAND * height * lower], axis=1
    )
    return times, joints, [(0, 1), (1, 2), (2, 3)], ARM_RADII, ("shoulder", "elbow", "wrist", "hand")


def walking(
    start: ArrayLike, direction: float, speed: float, duration: float, height: float | None, seed: int
) -> tuple[Any, ...]:
    """The same of a person who walks straight on."""
    import numpy as np

    draw, height = _drawn(height, seed)
    start, ahead = array("start", start, (3,)), _level(number("direction", direction))
    aside = np.array([-ahead[1], ahead[0], 0.0])
    times = _instants(_span("duration", duration))
    speed = positive("speed", speed)
    pace = _from_rest(times)
    gone = speed * np.concatenate([[0.0], np.cumsum(0.5 * (pace[1:] + pace[:-1]) * np.diff(times))])
    # Strides get longer with the root of the speed (Grieve and Gear, 1966): about 1.4 m at 1.3 m/s.
    stride = 0.8 * height * np.sqrt(speed / 1.3)
    phase = draw.uniform(-np.pi, np.pi) + 2.0 * np.pi * gone / stride
    leg = (THIGH + SHANK) * height
    open_hips = float(np.arcsin(min(0.9, 0.25 * stride / leg)))
    arms = draw.uniform(0.6, 1.2) * open_hips
    pelvis = start + gone[:, None] * ahead + [0.0, 0.0, 0.985 * leg + ANKLE * height]
    # Lowest where the legs are most open, twice a stride.
    pelvis[:, 2] -= pace * 0.5 * leg * (1.0 - np.cos(open_hips)) * (1.0 - np.cos(2.0 * phase))
    up = np.array([0.0, 0.0, height])
    neck = pelvis + TRUNK * up
    joints, names, bones, radii = (
        [pelvis, neck, neck + (NECK + 0.07) * up],
        ["pelvis", "neck", "head"],
        [(0, 1), (2, 2)],
        [0.14, 0.11],
    )

    def limb(first: Array, steps: list[Array], called: list[str], thick: list[float], trunk: int) -> None:
        for step, name in zip([np.zeros(3), *steps], called, strict=True):
            first = first + step
            joints.append(first)
            names.append(name)
        begin = len(joints) - len(called)
        bones.extend([(trunk, begin), *((k, k + 1) for k in range(begin, len(joints) - 1))])
        radii.extend(thick)

    for side, sign in (("left", 1.0), ("right", -1.0)):
        own = phase if sign > 0.0 else phase + np.pi
        thigh = pace * open_hips * np.sin(own)
        knee = 0.05 + pace * 0.45 * (1.0 + np.cos(own - 0.3))  # bent most while the leg swings forward
        steps = [THIGH * height * _down(thigh, ahead), SHANK * height * _down(thigh - knee, ahead)]
        toes = FOOT * height * _down(0.5 * np.pi + thigh - 0.5 * knee, ahead)
        limb(
            pelvis + sign * 0.5 * HIPS * height * aside,
            [*steps, toes],
            [f"{side} {each}" for each in ("hip", "knee", "ankle", "toes")],
            [0.1, 0.08, 0.055, 0.04],
            0,
        )
        swing = -pace * arms * np.sin(own)
        steps = [UPPER_ARM * height * _down(swing, ahead), FOREARM * height * _down(swing + 0.4, ahead)]
        limb(
            neck + 0.5 * sign * SHOULDERS * height * aside,
            [*steps, HAND * height * _down(swing + 0.4, ahead)],
            [f"{side} {each}" for each in ("shoulder", "elbow", "wrist", "hand")],
            [0.08, *ARM_RADII],
            1,
        )
    return times, np.stack(joints, axis=1), bones, radii, names


def _drawn(height: float | None, seed: int) -> tuple[Any, float]:
    """What draws, and the height of the person [m]."""
    import numpy as np

    draw = np.random.default_rng(whole("seed", seed, 0, 2**63 - 1))
    drawn = float(np.clip(draw.normal(1.72, 0.09), 1.5, 1.95))
    return draw, drawn if height is None else positive("height", height)


def _span(name: str, value: float) -> float:
    value = number(name, value)
    if not 0.0 <= value <= LONGEST:
        raise InputError(f"{name}: must be from 0 to {LONGEST:g} s, got {value}")
    return value


def _instants(duration: float, begin: float = 0.0) -> Array:
    """From 0 on, dense from `begin` [s] on."""
    import numpy as np

    if not 0.1 <= duration - begin <= LONGEST:
        raise InputError(f"duration: must be from 0.1 to {LONGEST:g} s, got {duration - begin:.3g}")
    count = 1 + max(2, round((duration - begin) * RATE))
    moving = np.linspace(begin, duration, count)
    made: Array = moving if begin == 0.0 else np.concatenate([[0.0], moving])
    return made


def _least_jerk(share: Array) -> Array:
    import numpy as np

    s = np.clip(share, 0.0, 1.0)
    made: Array = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    return made


def _from_rest(times: Array) -> Array:
    """A factor that is 0 at both ends and 1 from the first second to the last, sooner in short motions."""
    within = min(1.0, 0.4 * times[-1])
    made: Array = _least_jerk(times / within) * _least_jerk((times[-1] - times) / within)
    return made


def _level(direction: float) -> Array:
    import numpy as np

    return np.array([np.cos(direction), np.sin(direction), 0.0])


def _down(angle: Array, ahead: Array) -> Array:
    """Unit vectors (T, 3) that hang down, swung ahead by an angle each."""
    import numpy as np

    made: Array = np.sin(angle)[:, None] * ahead - np.cos(angle)[:, None] * [0.0, 0.0, 1.0]
    return made


def _arm(shoulder: Array, hand: Array, ahead: Array, height: float) -> Array:
    """Shoulder, elbow, wrist and hand (T, 4, 3) of an arm whose hand goes on along its forearm."""
    import numpy as np

    upper, lower = UPPER_ARM * height, (FOREARM + HAND) * height
    to = hand - shoulder
    far = np.linalg.norm(to, axis=1, keepdims=True)
    along = to / far
    # The elbow hangs, a little to the right.
    hangs = np.array([0.3 * ahead[1], -0.3 * ahead[0], -1.0])
    across = hangs - (along @ hangs)[:, None] * along
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    near = (far**2 + upper**2 - lower**2) / (2.0 * far)
    elbow = shoulder + near * along + np.sqrt(np.maximum(upper**2 - near**2, 0.0)) * across
    wrist = elbow + (hand - elbow) * (FOREARM / (FOREARM + HAND))
    return np.stack([np.broadcast_to(shoulder, elbow.shape), elbow, wrist, hand], axis=1)
