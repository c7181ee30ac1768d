"""What an object has to have so that it can be driven."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, Protocol, runtime_checkable

if TYPE_CHECKING:
    from typing import TypeAlias

    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    State: TypeAlias = tuple[float, ArrayLike, ArrayLike]
else:
    State = tuple

__all__ = ["CommandKind", "Robot", "State"]

CommandKind = Literal["torque", "position", "velocity"]
"""What a robot takes: joint torques [N·m], positions [rad], or velocities [rad/s]; in N and m where a joint
slides.
"""


@runtime_checkable
class Robot(Protocol):
    """A robot as `vffnull.drive` sees it. All methods are called from one thread, that of the loop.

    These two are needed; the rest is optional:

    =====================  ==================================================================================
    ``command``            ``"torque"`` (the default), ``"position"`` or ``"velocity"``: what `write` takes
    ``paces``              whether `read` waits for the robot's next state, so that the robot's clock is that
                           of the loop; False by default
    ``gravity``            ``"robot"`` if it adds the torque against gravity itself, as Franka's and Universal
                           Robots' arms do; a controller that adds it, too, is refused
    ``torque_rate``        how fast torques may change [N·m/s]; a controller without such a limit is refused
    ``begin()``            called once, before the first `read`
    ``torque()``           the torque that acts now, (n,) [N·m], to blend in from; called once, after the
                           first `read`, with gravity included as in `write`
    ``external_torque()``  the torque from outside that it measures, (n,) [N·m], at the state read last;
                           called once at the beginning, too, where what holds a load is blended in from;
                           then once a period for a controller whose observer follows it
    ``end()``              called once, after the last `write`, whatever has happened
    =====================  ==================================================================================

    What any of them raises ends the drive; its report says what it was.
    """

    def read(self) -> State:
        """The robot's time [s], joint positions (n,) [rad] and velocities (n,) [rad/s].

        The time goes on from state to state: a state whose time has not gone on counts as missing. It must
        not wait longer than a period, unless the robot `paces` the loop.
        """
        ...

    def write(self, command: NDArray[np.float64], /) -> Any:
        """Take a command (n,), of the kind that `command` says, to hold until the next."""
        ...
