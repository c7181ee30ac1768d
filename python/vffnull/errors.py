"""What can go wrong with the input. What can go wrong in a run is a `vffnull.Status`, not an exception."""

from __future__ import annotations

from vffnull._support.errors import InputError, InputTypeError, ScenarioError, ScenarioWarning, VffNullError

__all__ = ["InputError", "InputTypeError", "ScenarioError", "ScenarioWarning", "VffNullError"]

for _each in (InputError, InputTypeError, ScenarioError, ScenarioWarning, VffNullError):
    _each.__module__ = __name__  # as tracebacks and pickles name them
