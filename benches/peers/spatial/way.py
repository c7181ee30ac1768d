"""A way to avoid: what makes its controller for a task, from settings that can be searched."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from peers.spatial.spheres import Spheres
from peers.spatial.task import Array, Task
from vffnull.evaluation import scenes

Settings = Mapping[str, Any]


class Controller(ABC):
    """A controller for one scene, made anew for each.

    Attributes
    ----------
    spheres : Spheres or None
        What it takes for the shape of the arm, if not the capsules.
    unsolved : int
        Steps in which its QP had no solution.
    """

    spheres: Spheres | None = None
    unsolved = 0

    def __init__(self, task: Task) -> None:
        self.task = task

    @abstractmethod
    def torque(self, k: int, q: Array, dq: Array) -> Array:
        """Joint torque for step `k` [N·m]; what is beyond the arm's limits is cut off."""

    def reset(self) -> None:  # noqa: B027 (who remembers nothing has nothing to forget)
        """Forget what was done, for a run from the start."""


@dataclass(frozen=True)
class Range:
    """Where a setting is searched: between two numbers, evenly or evenly in its logarithm."""

    low: float
    high: float
    log: bool = False


@dataclass(frozen=True)
class Way:
    """A way to avoid.

    Attributes
    ----------
    name, work : str
        What tables call it, and what it does.
    settings : mapping
        Where nothing else is said.
    like : str, optional
        The way whose settings were found and hold for this one, but for `settings`.
    space : mapping of str to Range
        What of them is searched; nothing for what is judged as it stands.
    prepare : callable, optional
        Makes a controller of a task and settings.
    changes : callable, optional
        Instead of it for what the core runs itself: what settings change of a scene.
    arms : tuple of str
        The arms that it can drive.
    hasty : mapping, optional
        What of the settings is cheaper while others are searched.
    every : int
        Steps from one plan to the next; what a step takes differs between them.
    """

    name: str
    work: str
    settings: Settings = field(default_factory=dict)
    space: Mapping[str, Range] = field(default_factory=dict)
    prepare: Callable[[Task, Settings], Controller] | None = None
    changes: Callable[[Settings], Settings] | None = None
    like: str = ""
    arms: tuple[str, ...] = scenes.EVALUATED
    hasty: Settings = field(default_factory=dict)
    every: int = 1
