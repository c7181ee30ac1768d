"""Lets autodoc see the compiled classes as their stub describes them: with signatures and docstrings.

`_core.pyi` is Python. It is executed as a module, and while pages are read its classes and functions stand where the
package has the compiled ones. The gallery has run by then, with the real ones.
"""

from __future__ import annotations

import inspect
from importlib.resources import files

from sphinx.application import Sphinx

import vffnull

# A stub may name a class before it is there.
FORWARD = annotations.compiler_flag


def described() -> dict[str, object]:
    """What the package has from the core, as the stub describes it, by name."""
    text = (files("vffnull") / "_core.pyi").read_text(encoding="utf-8")
    namespace: dict[str, object] = {"__name__": "vffnull"}
    exec(compile(text, "_core.pyi", "exec", flags=FORWARD, dont_inherit=True), namespace)
    return {
        name: value
        for name, value in namespace.items()
        if name in vffnull.__all__ and (inspect.isclass(value) or inspect.isfunction(value))
    }


def on_before_read(app: Sphinx, env: object, docnames: list[str]) -> None:
    """Put the described classes in."""
    for name, value in described().items():
        setattr(vffnull, name, value)


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("env-before-read-docs", on_before_read)
    return {"parallel_read_safe": True}
