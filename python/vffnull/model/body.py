"""People, and whatever else is jointed, as obstacles: capsules between joints that move over time."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vffnull._support.arguments import array, number, positive
from vffnull._support.errors import InputError, ScenarioWarning
from vffnull.model.motion import Motion
from vffnull.model.obstacle import Obstacle

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    Array = NDArray[np.float64]

__all__ = ["ACCELERATION", "Body"]

ACCELERATION = 50.0
"""What the joints of people's arms are taken to stay below [m/s²], more than those of trunk and legs: the
tool SaRA, which predicts where people can be within a time (Schepp et al., ICRA 2022), reckons with it."""
MAX_POINTS = 50_000
"""The most way points of all bones together."""
FARTHEST = -0.87
"""The cosine of how far a bone may turn from instant to instant: at half a turn both ways are short."""
UNEVEN = 0.1
"""By which share of the longest a bone may be shorter without a word."""


class Body:
    """A skeleton whose joints move: `obstacles` lists its bones for `simulate`, `Scenario` and `drive`.

    Every bone is a capsule, or a ball where it begins and ends at the same joint. Between the instants it
    moves smoothly (docs/theory.md, T177): velocity and acceleration do not jump, and the controller knows
    both. Before the first instant and after the last everything stands still.

    Parameters
    ----------
    times : (T,) array_like
        Increasing instants [s].
    joints : (T, J, 3) array_like
        Where each joint is then [m].
    bones : (B, 2) array_like of int
        The two joints of each bone, numbered from 0.
    radii : float or (B,) array_like
        Radius of each bone [m].
    names : sequence of str, optional
        What the joints are called.
    ease : float, optional
        Within how many seconds what moves at the first instant gets up to its pace, and comes to rest at the
        last: it takes half of that longer. 0 by default, for what begins and ends at rest.
    acceleration : float, optional
        What no joint should need more than [m/s²].

    Attributes
    ----------
    times : (T,) ndarray
    joints : (T, J, 3) ndarray
    bones : tuple of (int, int, float)
        With the radius.
    names : tuple of str

    Warns
    -----
    vffnull.errors.ScenarioWarning
        Of a joint that needs more acceleration than `acceleration`, and of a bone that gets shorter by more
        than a tenth: its capsule is as long as the bone ever is.

    Raises
    ------
    vffnull.errors.InputError
        If arrays do not fit together, a bone has no such joint, or there are more than 50 000 way points.

    Examples
    --------
    >>> import vffnull as vff
    >>> shoulder, low, high = [0.8, 0.4, 0.6], [0.8, 0.4, 0.1], [0.5, 0.0, 0.6]
    >>> arm = vff.Body([0.0, 1.0, 2.0], [[shoulder, hand] for hand in (low, high, low)], [(0, 1)], 0.05)
    >>> arm
    <Body of 1 bone: 2 joints from 0 to 2 s>
    >>> run = vff.Scenario.load("panda-sweep").replace(duration=2.0, obstacles=arm.obstacles())
    >>> vff.simulate(run).status
    <Status.COMPLETED: 'completed'>
    """

    def __init__(
        self,
        times: ArrayLike,
        joints: ArrayLike,
        bones: Sequence[tuple[int, int]] | ArrayLike,
        radii: ArrayLike,
        *,
        names: Sequence[str] | None = None,
        ease: float = 0.0,
        acceleration: float = ACCELERATION,
    ) -> None:
        import numpy as np

        self.times = eased(array("times", times, (None,)), number("ease", ease))
        self.joints = array("joints", joints, (len(self.times), None, 3))
        count = self.joints.shape[1]
        self.names = tuple(names) if names is not None else tuple(f"joints[{j}]" for j in range(count))
        if len(self.names) != count:
            raise InputError(f"names: expected {count}, one per joint, got {len(self.names)}")
        pairs = np.asarray(bones)
        if pairs.ndim != 2 or pairs.shape[1] != 2 or not np.issubdtype(pairs.dtype, np.integer):
            raise InputError("bones: expected pairs of whole numbers, the joints of each bone")
        for i, pair in enumerate(pairs.tolist()):
            if not all(0 <= j < count for j in pair):
                raise InputError(f"bones[{i}]: {tuple(pair)} are not two of the joints 0 to {count - 1}")
        if len(pairs) * len(self.times) > MAX_POINTS:
            raise InputError(
                f"times: {len(pairs)} bones at {len(self.times)} instants are more than {MAX_POINTS} way "
                "points: take fewer instants"
            )
        each = np.broadcast_to(radii, len(pairs)) if np.ndim(radii) == 0 else radii
        thick = [positive(f"radii[{i}]", r) for i, r in enumerate(array("radii", each, (len(pairs),)))]
        self.bones = tuple((int(a), int(b), r) for (a, b), r in zip(pairs, thick, strict=True))
        self._say(positive("acceleration", acceleration))

    @classmethod
    def from_bvh(
        cls,
        path: str | Path,
        radii: float | Mapping[str, float] = 0.06,
        *,
        scale: float = 0.01,
        up: str = "y",
        rate: float = 30.0,
        span: tuple[float, float] | None = None,
        ease: float = 0.5,
        acceleration: float = ACCELERATION,
    ) -> Body:
        """The skeleton of a BVH motion-capture file.

        Parameters
        ----------
        path : str or pathlib.Path
            The file.
        radii : float or mapping of str to float, optional
            Radius of every bone [m], or that of the bones that begin at the joints of these names; others are
            left out.
        scale : float, optional
            Metres per unit of the file; centimetres by default.
        up : {"y", "z"}, optional
            Which axis of the file points up; y becomes z, z becomes x.
        rate : float, optional
            About how many instants are taken per second, if the file has more.
        span : (float, float), optional
            From when to when of the file [s]; all of it by default. The body's time begins at 0.
        ease, acceleration : float, optional
            As in `Body`.

        Raises
        ------
        vffnull.errors.InputError
            If the file is no BVH; the message names the line.

        Examples
        --------
        >>> body = vff.Body.from_bvh("walk.bvh", {"RightArm": 0.05, "RightForeArm": 0.04})  # doctest: +SKIP
        """
        from vffnull.model.bvh import read

        names, parents, times, places = read(Path(path))
        begin, end = (times[0], times[-1]) if span is None else array("span", span, (2,))
        kept = (times >= begin - 1e-9) & (times <= end + 1e-9)
        if not kept.any():
            raise InputError(
                f"span: from {begin} to {end} s there is nothing: the file ends at {times[-1]:.3f} s"
            )
        step = max(1, round(1.0 / (positive("rate", rate) * (times[1] - times[0])))) if len(times) > 1 else 1
        times, places = times[kept][::step], places[kept][::step] * positive("scale", scale)
        if up not in ("y", "z"):
            raise InputError(f"up: expected 'y' or 'z', not {up!r}")
        if up == "y":
            places = places[..., [2, 0, 1]]
        bones = [(parent, j) for j, parent in enumerate(parents) if parent >= 0]
        if isinstance(radii, Mapping):
            unknown = sorted(set(radii) - set(names))
            if unknown:
                raise InputError(f"radii: the file has no joint {unknown[0]!r}; it has {', '.join(names)}")
            bones = [bone for bone in bones if names[bone[0]] in radii]
            thick: ArrayLike = [radii[names[first]] for first, _ in bones]
        else:
            thick = radii
        return cls(times - times[0], places, bones, thick, names=names, ease=ease, acceleration=acceleration)

    def placed(self, position: ArrayLike, turn: float = 0.0) -> Body:
        """The same body elsewhere.

        Parameters
        ----------
        position : (3,) array_like
            Where its origin is [m].
        turn : float, optional
            By which angle it is turned about z before [rad].

        Examples
        --------
        >>> person = Body.walking().placed([2.0, 0.0, 0.0], turn=3.14)
        """
        import numpy as np

        cos, sin = np.cos(number("turn", turn)), np.sin(turn)
        rotation = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        made = object.__new__(type(self))
        made.times, made.bones, made.names = self.times, self.bones, self.names
        made.joints = self.joints @ rotation.T + array("position", position, (3,))
        return made

    def obstacles(self, *, foreseen: bool = False) -> list[Obstacle]:
        """A capsule for each bone, or a ball, that moves as its two joints do.

        A capsule's middle is that of the joints and its axis along them, turned the shortest way from instant
        to instant; at the instants it holds both.

        Parameters
        ----------
        foreseen : bool, optional
            Whether look-ahead knows how it will move, as of a robot whose plan is known. People surprise:
            it then takes each bone for one that goes on as it does at the moment.

        Raises
        ------
        vffnull.errors.InputError
            If a bone turns by more than 150° from one instant to the next, or has no length at one.

        Examples
        --------
        >>> [each.kind for each in Body.reaching([0, 0, 0.5], [0.5, 0, 0.5]).obstacles()]
        ['capsule', 'capsule', 'capsule']
        """
        import numpy as np

        made = []
        for first, second, radius in self.bones:
            a, b = self.joints[:, first], self.joints[:, second]
            length = np.linalg.norm(b - a, axis=1)
            if length.max() < 1e-6:
                made.append(Obstacle.sphere(a[0], radius, self._motion(a, foreseen)))
                continue
            if length.min() < 1e-6:
                raise InputError(
                    f"bones: {self._called(first, second)} has no length at times[{length.argmin()}]"
                )
            along = (b - a) / length[:, None]
            half = 0.5 * length.max() * along[0]
            middle = 0.5 * (a + b)
            turned = (along[1:] * along[:-1]).sum(axis=1)
            if len(turned) and turned.min() < FARTHEST:
                k = int(turned.argmin())
                angle = np.degrees(np.arccos(max(turned[k], -1.0)))
                raise InputError(
                    f"times: {self._called(first, second)} turns by {angle:.0f}° from times[{k}] to "
                    f"times[{k + 1}]: which way? Give instants between"
                )
            motion = self._motion(middle, foreseen, least_turns(along))
            shape = (("a", tuple((-half).tolist())), ("b", tuple(half.tolist())), ("radius", radius))
            still = (1.0, 0.0, 0.0, 0.0)
            made.append(
                Obstacle("capsule", shape, tuple(middle[0].tolist()), motion=motion, orientation=still)
            )
        return made

    def _motion(self, points: Array, foreseen: bool = False, orientations: Array | None = None) -> Motion:
        return Motion.waypoints(
            self.times, points, interpolation="smooth", orientations=orientations, foreseen=foreseen
        )

    def _called(self, first: int, second: int) -> str:
        return f"the bone from {self.names[first]} to {self.names[second]}"

    def _say(self, acceleration: float) -> None:
        """Warns of what people's limbs do not do."""
        import numpy as np

        used = sorted({j for first, second, _ in self.bones for j in (first, second)})
        most = {j: self._motion(self.joints[:, j]).top_acceleration for j in used}
        if most and (top := max(most.values())) > acceleration:
            name = self.names[max(most, key=most.__getitem__)]
            message = (
                f"joints: {name} needs up to {top:.3g} m/s², more than {acceleration:.3g} m/s²: are times "
                "in seconds and places in metres? What moves at the first or last instant wants `ease`"
            )
            warnings.warn(message, ScenarioWarning, stacklevel=3)
        for first, second, _ in self.bones:
            length = np.linalg.norm(self.joints[:, second] - self.joints[:, first], axis=1)
            if length.min() < (1.0 - UNEVEN) * length.max():
                message = (
                    f"joints: {self._called(first, second)} is from {length.min():.3g} to "
                    f"{length.max():.3g} m long: its capsule has the longest"
                )
                warnings.warn(message, ScenarioWarning, stacklevel=3)

    def __repr__(self) -> str:
        bones = f"{len(self.bones)} bone{'s' if len(self.bones) != 1 else ''}"
        span = f"from {self.times[0]:.4g} to {self.times[-1]:.4g} s"
        return f"<Body of {bones}: {self.joints.shape[1]} joints {span}>"

    @staticmethod
    def reaching(
        shoulder: ArrayLike,
        target: ArrayLike,
        *,
        speed: float = 1.0,
        hold: float = 0.5,
        begin: float = 0.0,
        height: float | None = None,
        seed: int = 0,
    ) -> Body:
        """An arm that reaches out for a place, stays, and goes back.

        The hand goes along an arc at the pace of least jerk (Flash and Hogan, 1985), the elbow hangs.

        Parameters
        ----------
        shoulder, target : (3,) array_like
            Where the shoulder stays and where the tip of the hand goes [m].
        speed : float, optional
            The hand's largest speed [m/s].
        hold, begin : float, optional
            How long it stays there and when it begins [s].
        height : float, optional
            Of the person [m]; drawn by default.
        seed : int, optional
            What is drawn: the height, where the hand rests, how high the arc is.

        Raises
        ------
        vffnull.errors.InputError
            If an arm of a person of this height does not reach that far.

        Examples
        --------
        >>> Body.reaching([0.9, 0.6, 0.6], [0.5, 0.2, 0.5], seed=3)
        <Body of 3 bones: 4 joints from 0 to 2.32 s>
        """
        from vffnull.model.people import reaching

        return _made(reaching(shoulder, target, speed, hold, begin, height, seed))

    @staticmethod
    def swinging(
        shoulder: ArrayLike,
        *,
        direction: float = 0.0,
        angle: float = 0.5,
        frequency: float = 0.8,
        duration: float = 5.0,
        height: float | None = None,
        seed: int = 0,
    ) -> Body:
        """An arm that swings to and fro below its shoulder, from rest to rest.

        Parameters
        ----------
        shoulder : (3,) array_like
            Where the shoulder stays [m].
        direction : float, optional
            Towards which angle about z it swings [rad].
        angle, frequency, duration : float, optional
            How far [rad], how often [1/s] and how long [s].
        height, seed : float and int, optional
            As in `reaching`; drawn are the height, the elbow's bend and where the swing begins.

        Examples
        --------
        >>> Body.swinging([0.5, 0.5, 1.0], duration=3.0)
        <Body of 3 bones: 4 joints from 0 to 3 s>
        """
        from vffnull.model.people import swinging

        return _made(swinging(shoulder, direction, angle, frequency, duration, height, seed))

    @staticmethod
    def walking(
        start: ArrayLike = (0.0, 0.0, 0.0),
        *,
        direction: float = 0.0,
        speed: float = 1.2,
        duration: float = 5.0,
        height: float | None = None,
        seed: int = 0,
    ) -> Body:
        """A person who walks straight on, from rest to rest.

        Parameters
        ----------
        start : (3,) array_like, optional
            Where the feet are at first, on the floor [m].
        direction : float, optional
            Towards which angle about z [rad].
        speed : float, optional
            At which speed once it has begun [m/s].
        duration : float, optional
            How long [s], 1 s for beginning and ending included.
        height, seed : float and int, optional
            As in `reaching`; drawn are the height, with which foot it begins and how arms swing.

        Examples
        --------
        >>> Body.walking(speed=1.4)
        <Body of 18 bones: 19 joints from 0 to 5 s>
        """
        from vffnull.model.people import walking

        return _made(walking(start, direction, speed, duration, height, seed))


def _made(parts: tuple[Any, ...]) -> Body:
    *arrays, names = parts
    return Body(*arrays, names=names)


def eased(times: Array, ease: float) -> Array:
    """Instants at which a motion that begins and ends within `ease` [s] is where it is at `times` [s].

    The pace grows as 3u² − 2u³, so that half of `ease` of the motion takes the whole of it.
    """
    import numpy as np

    if ease < 0.0:
        raise InputError(f"ease: must be 0 or more, got {ease}")
    if ease == 0.0 or len(times) < 2:
        return times
    span = times[-1] - times[0]
    ease = min(ease, span)
    u = np.linspace(0.0, 1.0, 2001)
    gone = ease * (u**3 - 0.5 * u**4)

    def late(since: Array) -> Array:
        return np.where(since < 0.5 * ease, ease * np.interp(since, gone, u), since + 0.5 * ease) - since

    since, left = times - times[0], times[-1] - times
    made: Array = times + late(since) + (0.5 * ease - late(left))
    return made


def least_turns(along: Array) -> Array:
    """Quaternions (T, 4) that turn the first of unit vectors (T, 3) to the others, each the shortest way."""
    import numpy as np

    turns = np.zeros((len(along), 4))
    turns[0, 0] = 1.0
    for k, (before, now) in enumerate(pairwise(along)):
        # The half-way vector: exact to rounding for small turns.
        middle = (before + now) / np.linalg.norm(before + now)
        turns[k + 1] = [before @ middle, *np.cross(before, middle)]
        w, v, (w0, v0) = turns[k + 1, 0], turns[k + 1, 1:], (turns[k, 0], turns[k, 1:])
        turns[k + 1] = [w * w0 - v @ v0, *(w * v0 + w0 * v + np.cross(v, v0))]
        turns[k + 1] /= np.linalg.norm(turns[k + 1])
    return turns
