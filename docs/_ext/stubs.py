"""Lets autodoc see the compiled classes as their stub describes them: with signatures and docstrings.

`_core.pyi` is Python. It is imported as a module, and while pages are read its classes and functions stand
where the package has the compiled ones. The gallery has run by then, with the real ones.
"""

from __future__ import annotations

import inspect
import sys
import typing
from importlib import import_module
from importlib.resources import files
from pathlib import Path

from sphinx.application import Sphinx

import vffnull

MODULE = "described_by_stub"


def on_before_read(app: Sphinx, env: object, docnames: list[str]) -> None:
    """Put the described classes and functions in. As a file, so that autodoc finds their order."""
    stub = (files("vffnull") / "_core.pyi").read_text(encoding="utf-8")
    if not hasattr(typing, "type_check_only"):  # in stubs only
        typing.type_check_only = lambda described: described  # type: ignore[attr-defined]
    folder = Path(app.srcdir) / "generated"
    stub = stub.replace(", type_check_only", "").replace("@type_check_only\n", "")  # checkers alone know it
    later = "from __future__ import annotations\n"  # a stub may name a class before it is there
    (folder / f"{MODULE}.py").write_text(later + stub, encoding="utf-8")
    sys.path.insert(0, str(folder))
    for name, value in vars(import_module(MODULE)).items():
        if name in vffnull.__all__ and (inspect.isclass(value) or inspect.isfunction(value)):
            setattr(vffnull, name, value)


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("env-before-read-docs", on_before_read)
    return {"parallel_read_safe": True}
