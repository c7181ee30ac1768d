"""What `help()` and `?` show: every public name of the compiled module, in the module as in its stub."""

from __future__ import annotations

import importlib.util
import inspect
from pathlib import Path
from types import ModuleType

import pytest

import vffnull as vff
from vffnull import _core

SCRIPT = Path(__file__).parents[1] / "crates" / "vff-python" / "stub.py"


def _public() -> list[str]:
    """Dotted names of all classes and functions of the module, and of all methods and properties."""
    found = []
    for name, thing in vars(_core).items():
        if name.startswith("_") or not callable(thing):
            continue
        found.append(name)
        if inspect.isclass(thing):
            found.extend(f"{name}.{part}" for part in vars(thing) if not part.startswith("_"))
    return sorted(name for name in found if name != "Episodes.INFO")


@pytest.mark.parametrize("name", _public())
def test_every_public_name_has_help(name: str) -> None:
    """A docstring that begins with a sentence, and a signature wherever there is something to give."""
    thing: object = _core
    for part in name.split("."):
        thing = inspect.getattr_static(thing, part) if isinstance(thing, type) else getattr(thing, part)
    thing = thing.__func__ if isinstance(thing, staticmethod) else thing
    doc = inspect.getdoc(thing)
    assert doc and doc.split("\n\n")[0].rstrip().endswith((".", ";")), doc
    if inspect.isroutine(thing):
        assert inspect.signature(thing) is not None


def test_public_names_are_those_of_the_stub() -> None:
    """Nothing is missing here, and the walk above has seen the classes that users know."""
    seen = set(_public())
    for name in (
        "Arm.jacobian",
        "Controller.torque",
        "Simulation.step",
        "Terms.N",
        "State.q",
        "Distances.rate",
    ):
        assert name in seen
        assert name.split(".")[0] in vff.__all__


@pytest.fixture
def script() -> ModuleType:
    """The script that writes the stub, where there is a source tree."""
    if not SCRIPT.is_file():
        pytest.skip("no source tree")
    spec = importlib.util.spec_from_file_location("stub", SCRIPT)
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_stub_says_the_same(script: ModuleType) -> None:
    """Docstrings of the stub are those of the module (crates/vff-python/stub.py writes them)."""
    stub = Path(_core.__file__).with_name("_core.pyi").read_text(encoding="utf-8")
    assert script.with_docs_of(_core, stub) == stub


def test_the_script_notices(script: ModuleType) -> None:
    """A docstring that differs is replaced, at its indentation, and nothing else."""
    stub = 'class Arm:\n    def jacobian(self, q):\n        """Old."""\n\n    n: int\n'
    new = script.with_docs_of(_core, stub)
    assert "Jacobian J of the tip" in new and "Old" not in new
    assert new.startswith("class Arm:") and new.endswith("\n    n: int\n")
