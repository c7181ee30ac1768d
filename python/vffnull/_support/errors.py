"""What can go wrong with the input. What can go wrong in a run is a `vffnull.Status`, not an exception."""

from __future__ import annotations

__all__ = ["InputError", "InputTypeError", "ScenarioError", "ScenarioWarning", "VffNullError"]


class VffNullError(Exception):
    """The root of every exception that this package raises on purpose."""


class ScenarioError(VffNullError, ValueError):
    """A scenario, or a part of one, that cannot be run.

    Parameters
    ----------
    message : str
        What was found and what is allowed, with the name of the key in front.
    path : str, optional
        Dotted path of the offending key, ``"controller.field.gain"`` for instance; empty if no single
        key is to blame.
    """

    path: str

    def __init__(self, message: str, path: str = "") -> None:
        super().__init__(message)
        self.path = path


class InputError(VffNullError, ValueError):
    """A value of the right type that makes no sense: a wrong shape, a NaN, a file of another format."""


class InputTypeError(VffNullError, TypeError):
    """A value of a type that cannot be used here."""


class ScenarioWarning(UserWarning):
    """A scenario that can be run but is probably not what was meant."""
