"""Packages of the optional extras, imported when they are used."""

from __future__ import annotations

import importlib
from typing import Any

__all__ = ["extra"]


def extra(module: str, name: str) -> Any:
    """Import a package of one of the extras.

    Parameters
    ----------
    module : str
        The module to import.
    name : str
        The extra that brings it.

    Raises
    ------
    ImportError
        Without the package; the message names the extra.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        raise ImportError(f'{package} is missing: pip install "vffnull[{name}]"') from error
