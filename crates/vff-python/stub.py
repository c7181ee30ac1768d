"""Writes the docstrings of the compiled module into its stub; doc comments in Rust are their only source.

    python crates/vff-python/stub.py            # after a build
    python crates/vff-python/stub.py --check    # says what is out of date

Signatures and types stay what the stub says; mypy's stubtest compares them with the module.
"""

from __future__ import annotations

import ast
import inspect
import sys
from pathlib import Path
from types import ModuleType

STUB = Path(__file__).parents[2] / "python" / "vffnull" / "_core.pyi"

Described = ast.ClassDef | ast.FunctionDef


def described(tree: ast.Module) -> list[tuple[str, Described]]:
    """Dotted name and node of all that has a docstring in the stub, from its end to its start."""
    found: list[tuple[str, Described]] = []
    for node in tree.body:
        if not isinstance(node, Described):
            continue
        found.append((node.name, node))
        if isinstance(node, ast.ClassDef):
            inner = [part for part in node.body if isinstance(part, ast.FunctionDef)]
            found.extend((f"{node.name}.{part.name}", part) for part in inner)
    return [pair for pair in reversed(found) if ast.get_docstring(pair[1]) is not None]


def compiled_doc(core: ModuleType, name: str) -> str | None:
    """The docstring of the compiled module; None of what only the stub has."""
    thing: object = core
    for part in name.split("."):
        thing = vars(thing).get(part) if isinstance(thing, type) else getattr(thing, part, None)
        if isinstance(thing, staticmethod):
            thing = thing.__func__
    doc = getattr(thing, "__doc__", None)
    return inspect.cleandoc(doc) if isinstance(doc, str) else None


def literal(doc: str, indent: str) -> str:
    """A docstring as it is written at this indentation."""
    first, *rest = doc.splitlines()
    if not rest:
        return f'{indent}"""{first}"""\n'
    lines = "".join(f"{indent}{line}\n" if line else "\n" for line in rest)
    return f'{indent}"""{first}\n{lines}{indent}"""\n'


def with_docs_of(core: ModuleType, stub: str) -> str:
    """The stub with the docstrings of the compiled module."""
    lines = stub.splitlines(keepends=True)
    for name, node in described(ast.parse(stub)):
        doc = compiled_doc(core, name)
        first = node.body[0]
        if doc and first.end_lineno is not None:
            indent = " " * first.col_offset
            lines[first.lineno - 1 : first.end_lineno] = [literal(doc, indent)]
    return "".join(lines)


def main() -> int:
    """Write the stub, or check it."""
    from vffnull import _core

    stub = STUB.read_text(encoding="utf-8")
    new = with_docs_of(_core, stub)
    if "--check" in sys.argv:
        if new != stub:
            print(f"{STUB.name}: docstrings are out of date; run {Path(__file__).name}")
        return int(new != stub)
    STUB.write_text(new, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
