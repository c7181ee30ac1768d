"""Scenarios as Gymnasium environments, needs the extra ``vffnull[gym]``.

>>> import gymnasium
>>> env = gymnasium.make("vffnull.engines.gym:vffnull/Reach-v0", scenario="sweep-through")
>>> observation, info = env.reset(seed=1)
>>> observation, reward, terminated, truncated, info = env.step(env.action_space.sample())

`ReachEnv` is one episode after the other, `ReachVectorEnv` many side by side that are stepped by the core
on all cores, to the same bits.

**Action**: n numbers from −1 to 1. With ``action="null_space"`` they are a joint torque that is projected
into the null space and added to the law's, so that the task goes on while the agent learns to avoid: as much
of it as torque limits and a torque rate leave room for, the same share at all joints where that can be. With
``action="torque"`` they are the joint torque itself, instead of the law's.

**Observation**: what the controller knows, as one row of numbers that `layout` takes apart: ``cos_q``,
``sin_q``, ``dq`` [rad/s], ``tip``, ``reference``, ``reference_velocity``, ``error`` and, where there are
obstacles, ``clearance`` of every link, ``nearest`` (the way from its axis, or from the surface of a box or
hull, to the nearest obstacle), ``obstacles`` and ``obstacle_velocities``, in m and m/s, possible futures
among them. What lies beyond the bounds of the space is shown at the bound. Of an arm in space, points have
three coordinates, and ``error`` has three numbers for a position, five for pointing and six for a pose. For
these two tasks there are also ``tip_axes`` and ``reference_axes``, the x and y axis of hand and reference
(their z axis, for pointing), and ``reference_angular_velocity`` [rad/s]. Joints that slide have no cosine and
sine but their position in ``slide`` [m]. With an observer there is ``tau_ext_estimate``, the torque that its
model does not know [N·m], up to the largest torque of an action. Of obstacles that the controller does not
see, nothing is told.

**Reward** per step, with weights w:

    w_alive − w_tracking ‖error‖ − w_clearance s² − w_effort mean(action²)

with s = 1 − clearance/margin between 0 and 1, and −w_collision when the episode is terminated. In ‖error‖ an
angle counts as the arc that it is at the arm's characteristic length; ``info["tracking_error"]`` is that. The
clearance is the smallest within the step; ``info`` has every part. Error and clearance here are the true
ones, also where a scenario has sensors.

An episode is **terminated** when a link touches an obstacle, but for the last one where its tip is to press
on something (``[controller.touch.force]``), or a joint turns faster than 100 rad/s, and
**truncated** at the end of the scenario.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

import vffnull._core as _core
from vffnull._support.arguments import MAX_THREADS, whole
from vffnull._support.errors import InputError, InputTypeError
from vffnull.model.scenario import prepare

try:
    import gymnasium
    from gymnasium.spaces import Box
    from gymnasium.vector import AutoresetMode, VectorEnv
    from gymnasium.vector.utils import batch_space
except ImportError as error:
    raise ImportError("vffnull.engines.gym needs gymnasium 1 or later: pip install 'vffnull[gym]'") from error

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from vffnull.model.scenario import Scenario, ScenarioLike

    Array = NDArray[np.float64]
    Flags = NDArray[np.bool_]

__all__ = ["ReachEnv", "ReachVectorEnv"]

_MODES = {
    AutoresetMode.NEXT_STEP: "next_step",
    AutoresetMode.SAME_STEP: "same_step",
    AutoresetMode.DISABLED: "disabled",
}
_FLAGS = ("diverged",)
_POSTURES, _ACCELERATION = 64, 4.0
_MAX_ENVIRONMENTS = 65_536
_LARGEST_SEED = 2**63 - 1


class _Episodes:
    """The episodes of the core with the spaces that describe them."""

    def __init__(
        self,
        scenario: ScenarioLike,
        overrides: Mapping[str, Any] | None,
        settings: Mapping[str, Any],
        count: int = 1,
        threads: int = 1,
        autoreset: AutoresetMode = AutoresetMode.DISABLED,
    ) -> None:
        self.scenario: Scenario = prepare(scenario, overrides)
        self.lock = threading.RLock()  # threads that share an environment take turns
        given = {name: value for name, value in settings.items() if value is not None}
        if self.scenario.arm.dimension == 3:
            given.setdefault("torque", _typical_torque(self.scenario).tolist())
        try:
            mode = _MODES[AutoresetMode(autoreset)]
        except ValueError:
            names = ", ".join(f"AutoresetMode.{each.name}" for each in AutoresetMode)
            raise InputError(f"autoreset_mode: expected one of {names}, not {autoreset!r}") from None
        self.core = _core.Episodes(self.scenario, given, count, threads, 0, mode)
        self.layout: dict[str, slice] = {}
        bounds: list[float] = []
        for name, rows, columns, bound in self.core.layout:
            self.layout[name] = slice(len(bounds), len(bounds) + rows * columns)
            bounds += [bound] * (rows * columns)
        high = np.array(bounds)
        self.observation_space = Box(-high, high, dtype=np.float64)
        self.action_space = Box(-1.0, 1.0, shape=self.core.torque.shape, dtype=np.float64)

    @staticmethod
    def info(row: Array) -> dict[str, Any]:
        """What the core tells beside the observation, of one episode."""
        found = zip(_core.Episodes.INFO, row.tolist(), strict=True)
        return {name: bool(value) if name in _FLAGS else value for name, value in found}

    @staticmethod
    def infos(rows: Array, told: Flags) -> dict[str, Any]:
        """The same of many, as a vector environment tells it: of those in the mask."""
        infos: dict[str, Any] = {}
        for name, column in zip(_core.Episodes.INFO, np.where(told[:, None], rows, 0.0).T, strict=True):
            infos[name] = column.astype(bool) if name in _FLAGS else column.copy()
            infos[f"_{name}"] = told.copy()
        return infos


class ReachEnv(gymnasium.Env["Array", "Array"]):
    """A scenario as a Gymnasium environment, registered as ``vffnull/Reach-v0``.

    Action, observation, reward and the end of an episode are described in `vffnull.engines.gym`.

    Parameters
    ----------
    scenario : str, path, Mapping or Scenario, optional
        What `vffnull.simulate` accepts.
    overrides : Mapping, optional
        Other values for some keys, by dotted name: ``{"controller.field.gain": 0}`` leaves all avoidance to
        the agent.
    action : {"null_space", "torque"}, optional
        What an action is.
    period : float, optional
        How long an action lasts [s], a multiple of the control period; by default that nearest to 10 ms. The
        law goes on at its own rate in between.
    torque : float or (n,) array_like, optional
        The torque of an action of 1 [N·m, N for a joint that slides]. By default of an arm in space what
        carries every joint against gravity and accelerates it by 4 rad/s², or m/s², within its torque limit:
        the limits of many wrists are a thousand times that. Of an arm in the plane the torque limits or,
        without any, what does so for the stretched arm. With ``action="torque"`` at most the torque limits,
        unless the scenario has them not enforced.
    start_noise : float, optional
        Every joint starts within this of its q0 [rad], evenly spread.
    obstacle_noise : float, optional
        Every obstacle starts within this of its position along each axis [m], evenly spread. Starts in
        contact are drawn anew.
    margin : float, optional
        Below this clearance [m] the reward falls.
    weights : Mapping, optional
        Of the reward, by default ``alive`` 1, ``tracking`` 10 [1/m], ``clearance`` 1, ``effort`` 0.1 and
        ``collision`` 100.

    Attributes
    ----------
    layout : dict of str to slice
        Where each part of the observation stands.
    scenario : Scenario
        The scenario without noise.
    torque : (n,) ndarray
        The torque of an action of 1 [N·m].
    period : float
        How long an action lasts [s].

    Raises
    ------
    vffnull.errors.ScenarioError
        If the scenario or a setting cannot be used.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012, as Gymnasium declares it

    def __init__(
        self,
        scenario: ScenarioLike = "sweep-through",
        overrides: Mapping[str, Any] | None = None,
        *,
        action: Literal["null_space", "torque"] = "null_space",
        period: float | None = None,
        torque: float | Sequence[float] | Array | None = None,
        start_noise: float = 0.05,
        obstacle_noise: float = 0.1,
        margin: float = 0.2,
        weights: Mapping[str, float] | None = None,
    ) -> None:
        settings = {
            "action": action,
            "period": period,
            "torque": torque,
            "start_noise": start_noise,
            "obstacle_noise": obstacle_noise,
            "margin": margin,
            "weights": weights,
        }
        self._episodes = _Episodes(scenario, overrides, settings)
        self._seeded = False
        self.scenario, self.layout = self._episodes.scenario, self._episodes.layout
        self.torque, self.period = self._episodes.core.torque, self._episodes.core.period
        self.observation_space = self._episodes.observation_space
        self.action_space = self._episodes.action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begin another episode; the same seed begins the same sequence of them. There are no options."""
        _known(options, ())
        seed = _seed("seed", seed)
        super().reset(seed=seed)
        with self._episodes.lock:
            if seed is None and not self._seeded:
                seed = int(self.np_random.integers(2**32))
            observations, infos = self._episodes.core.reset([seed])
            self._seeded = True
        return observations[0], self._episodes.info(infos[0])

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Act for one period."""
        if not self._seeded:
            raise gymnasium.error.ResetNeeded("reset() has to come before step()")
        try:
            numbers = np.asarray(action, dtype=np.float64)
        except (TypeError, ValueError):
            raise InputTypeError(f"action: expected numbers, not a {type(action).__name__}") from None
        if numbers.shape != self.action_space.shape:
            raise InputError(f"action: expected shape {self.action_space.shape}, got {numbers.shape}")
        with self._episodes.lock:
            observations, rewards, terminated, truncated, infos = self._episodes.core.step(numbers[None])
        info = self._episodes.info(infos[0])
        return observations[0], float(rewards[0]), bool(terminated[0]), bool(truncated[0]), info


class ReachVectorEnv(VectorEnv["Array", "Array", "NDArray[Any]"]):
    """Many episodes of a scenario, stepped together by the core on all cores, the GIL released.

    Environment i does what `ReachEnv` does with the same actions and the seed ``seed + i``, to the last bit,
    whatever the number of threads.
    ``gymnasium.make_vec("vffnull.engines.gym:vffnull/Reach-v0", num_envs=64)`` makes one.

    Parameters
    ----------
    num_envs : int
        How many.
    scenario, overrides, **settings
        As for `ReachEnv`.
    autoreset_mode : gymnasium.vector.AutoresetMode, optional
        When an episode that has ended begins anew; with ``SAME_STEP`` the end is in ``info["final_obs"]`` and
        ``info["final_info"]``; with ``DISABLED`` call ``reset(options={"reset_mask": mask})``.
    threads : int, optional
        How many threads compute; as many as there are cores by default.

    Raises
    ------
    vffnull.errors.ScenarioError
        If the scenario or a setting cannot be used.
    vffnull.errors.InputError
        If `num_envs` or `threads` is out of range, or if there is no such `autoreset_mode`.
    """

    def __init__(
        self,
        num_envs: int = 1,
        scenario: ScenarioLike = "sweep-through",
        overrides: Mapping[str, Any] | None = None,
        *,
        autoreset_mode: AutoresetMode = AutoresetMode.NEXT_STEP,
        threads: int | None = None,
        **settings: Any,
    ) -> None:
        num_envs = whole("num_envs", num_envs, 1, _MAX_ENVIRONMENTS)
        count = os.cpu_count() or 1 if threads is None else whole("threads", threads, 1, MAX_THREADS)
        self._episodes = _Episodes(scenario, overrides, settings, num_envs, count, autoreset_mode)
        self.num_envs = num_envs
        self.metadata = {"render_modes": [], "autoreset_mode": AutoresetMode(autoreset_mode)}
        self.scenario, self.layout = self._episodes.scenario, self._episodes.layout
        self.torque, self.period = self._episodes.core.torque, self._episodes.core.period
        self.single_observation_space = self._episodes.observation_space
        self.single_action_space = self._episodes.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._seeded = False
        self._over = np.zeros(num_envs, dtype=bool)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Array, dict[str, Any]]:
        """Begin new episodes, of all or of those in ``options["reset_mask"]``.

        A whole number seeds environment i with ``seed + i``, a list each with its own.
        """
        _known(options, ("reset_mask",))
        mask = self._mask((options or {}).get("reset_mask"))
        with self._episodes.lock:
            seeds = self._seeds(seed)
            observations, infos = self._episodes.core.reset(seeds, mask.tolist())
            self._seeded = True
            self._over &= ~mask
        return observations, self._episodes.infos(infos, mask)

    def step(self, actions: Array) -> tuple[Array, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Act in all of them for one period."""
        with self._episodes.lock:
            return self._step(actions)

    def _step(self, actions: Array) -> tuple[Array, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        if not self._seeded:
            raise gymnasium.error.ResetNeeded("reset() has to come before step()")
        mode = self.metadata["autoreset_mode"]
        if mode == AutoresetMode.DISABLED and self._over.any():
            those = np.flatnonzero(self._over).tolist()
            raise gymnasium.error.ResetNeeded(f"environments {those} have ended: reset them first")
        observations, rewards, terminated, truncated, rows = self._episodes.core.step(actions)
        self._over = terminated | truncated
        infos = self._episodes.infos(rows, np.ones(self.num_envs, dtype=bool))
        if mode == AutoresetMode.SAME_STEP and self._over.any():
            ended, last, last_rows = self._episodes.core.ended()
            infos["final_obs"] = np.full(self.num_envs, None, dtype=object)
            for i in np.flatnonzero(ended):
                infos["final_obs"][i] = last[i].copy()
            infos["final_info"] = self._episodes.infos(last_rows, ended)
            infos["_final_obs"], infos["_final_info"] = ended.copy(), ended.copy()
        return observations, rewards, terminated, truncated, infos

    def _seeds(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        """One seed each; None goes on with the random numbers that there are."""
        if isinstance(seed, Sequence | np.ndarray) and not isinstance(seed, str | bytes):
            super().reset(seed=None)
            if len(seed) != self.num_envs:
                raise InputError(f"seed: expected {self.num_envs} values, got {len(seed)}")
            return [_seed(f"seed[{i}]", each) for i, each in enumerate(seed)]
        first = _seed("seed", seed)
        super().reset(seed=first)
        if first is not None:
            _seed(f"seed + {self.num_envs - 1}", first + self.num_envs - 1)
            return [first + i for i in range(self.num_envs)]
        if self._seeded:
            return [None] * self.num_envs
        return [int(number) for number in self.np_random.integers(2**32, size=self.num_envs)]

    def _mask(self, mask: Any) -> Flags:
        if mask is None:
            return np.ones(self.num_envs, dtype=bool)
        flags = np.asarray(mask)
        if flags.dtype != bool or flags.shape != (self.num_envs,) or not flags.any():
            raise InputError(
                f"options['reset_mask']: expected {self.num_envs} booleans, not all False, got {mask!r}"
            )
        return flags


def _typical_torque(scenario: Scenario) -> Array:
    """What carries each joint of an arm in space in some postures between its limits, and accelerates it at
    4 rad/s², or m/s², there, but no more than its limit (n,).
    """
    arm = scenario.arm
    count = len(scenario["q0"])
    ends = np.full((count, 2), [-np.pi, np.pi]) if arm.joint_limits is None else np.asarray(arm.joint_limits)
    low, high = np.clip(np.where(np.isfinite(ends), ends, [-np.pi, np.pi]), -np.pi, np.pi).T
    postures = np.random.default_rng(0).uniform(low, high, (_POSTURES, count))
    postures[0] = scenario["q0"]
    weight = np.max([np.abs(arm.gravity_torque(q)) for q in postures], axis=0)
    inertia = np.max([np.diag(arm.mass_matrix(q)) for q in postures], axis=0)
    limits = np.inf if arm.torque_limits is None else np.asarray(arm.torque_limits)
    return np.asarray(np.minimum(weight + _ACCELERATION * inertia, limits))


def _known(options: Mapping[str, Any] | None, known: Sequence[str]) -> None:
    """Refuse options that would be passed over."""
    if strange := [name for name in options or {} if name not in known]:
        there = f"there is {', '.join(known)}" if known else "there are none"
        raise InputError(f"options: no {strange[0]!r}; {there}")


def _seed(name: str, value: Any) -> int | None:
    """A seed, or None to go on with the random numbers that there are."""
    return None if value is None else whole(name, value, 0, _LARGEST_SEED)


gymnasium.register(
    "vffnull/Reach-v0",
    entry_point="vffnull.engines.gym:ReachEnv",
    vector_entry_point="vffnull.engines.gym:ReachVectorEnv",
)
