"""What pushes an arm from outside: forces and torques on its links, over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import vffnull._core as _core
from vffnull._support.arguments import suggesting
from vffnull.model.document import Document, frozen, plain

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

__all__ = ["Wrench"]


@suggesting
@dataclass(frozen=True)
class Wrench:
    """A force and a torque on a link of an arm, at a point that the link carries.

    In the plane points and forces have two coordinates and a torque is one number, in space each has three.

    Parameters
    ----------
    link : str
        The name of the link, of an arm in the plane ``"link_1"`` to ``"link_n"``, or ``"tip"``: the end
        effector.
    force : (D,) array_like, optional
        The force [N].
    torque : float or (3,) array_like, optional
        The torque beside that of the force [N·m].
    point : (D,) array_like, optional
        Where the force acts, in the link's frame [m]; its origin by default.
    frame : {"world", "link"}, optional
        Along whose axes force and torque are given.
    start : float, optional
        When it begins [s]; for `Simulation.push` from the present instant on.
    duration : float, optional
        How long it lasts [s]; to the end by default.
    profile : Mapping, optional
        What share of it acts when: ``{"kind": "constant"}``, ``{"kind": "ramp", "rise": 0.5, "fall": 0.5}``,
        ``{"kind": "sinusoid", "angular_frequency": 6.28}`` or ``{"kind": "table", "times": …, "factors": …}``
        with seconds since the start.

    Raises
    ------
    vffnull.errors.ScenarioError
        If a number makes no sense. Whether the arm has such a link is known to a scenario alone.

    Examples
    --------
    >>> lean = Wrench("panda_link4", force=[0.0, 20.0, 0.0], start=1.0, duration=2.0)
    >>> scenario = Scenario.load("panda-sweep").replace(wrenches=[lean], **{"obstacles": None})
    >>> simulate(scenario).tau_ext.shape
    (601, 7)
    """

    link: str
    force: ArrayLike | None = None
    torque: ArrayLike | None = None
    point: ArrayLike | None = None
    frame: Literal["world", "link"] | None = None
    start: float | None = None
    duration: float | None = None
    profile: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        for name, given in self.to_dict().items():
            object.__setattr__(self, name, frozen(given))
        _core.check("wrench", self.to_dict())

    def to_dict(self) -> Document:
        """The wrench as a part of a scenario document."""
        given = {name: getattr(self, name) for name in self.__dataclass_fields__}
        found: Document = plain(given)
        return found
