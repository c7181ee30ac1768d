"""What imports what inside the package, read from the source: no circle, lazy imports included."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1] / "python" / "vffnull"


def modules(package: Path) -> dict[str, Path]:
    """Every module of a package by its full name, the compiled ones by their stubs; a folder is called after
    itself.
    """
    found = {}
    for path in sorted([*package.rglob("*.py"), *package.rglob("*.pyi")]):
        parts = (package.name, *path.relative_to(package).with_suffix("").parts)
        found[".".join(parts).removesuffix(".__init__")] = path
    return found


def imports(name: str, path: Path, known: set[str]) -> set[str]:
    """The modules of `known` that a module imports: at its top, inside its functions, by a name in a string.

    An import under ``if TYPE_CHECKING`` serves annotations alone and is left out, except where the module
    hands its names out itself when it is asked for them (``__getattr__``): there the string counts.
    """
    if path.suffix == ".pyi":  # types alone
        return set()
    tree = ast.parse(path.read_text(encoding="utf-8"), str(path))
    parent = name if path.name == "__init__.py" else name.rpartition(".")[0]
    found: set[str] = set()
    for node in runtime(tree):
        match node:
            case ast.Import(names=names):
                found |= {known_part(alias.name, known) for alias in names}
            case ast.ImportFrom(module=module, names=names, level=level):
                base = module or ""
                if level:
                    above = parent.split(".")[: len(parent.split(".")) - level + 1]
                    base = ".".join([*above, *([module] if module else [])])
                for alias in names:
                    found.add(known_part(f"{base}.{alias.name}", known))
            case ast.Constant(value=str(text)) if text in known and "." in text:
                found.add(text)
            case ast.JoinedStr(values=[ast.Constant(value=str(text)), *_]) if text.endswith("."):
                found |= {each for each in known if each.startswith(text)}
    return found & known - {name}


def known_part(name: str, known: set[str]) -> str:
    """The longest beginning of a dotted name that is a module: what follows are names in it."""
    while name and name not in known:
        name = name.rpartition(".")[0]
    return name


def runtime(node: ast.AST) -> Iterator[ast.AST]:
    """Everything below a node but what only type checkers see, and text that explains."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test):
            for other in child.orelse:
                yield from runtime(other)
        elif isinstance(child, ast.Expr) and isinstance(child.value, ast.Constant):
            continue
        else:
            yield child
            yield from runtime(child)


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """The groups of modules that all depend on one another (Tarjan's strongly connected components)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found = []

    def visit(name: str) -> None:
        index[name] = low[name] = len(index)
        stack.append(name)
        for other in sorted(graph[name]):
            if other not in index:
                visit(other)
                low[name] = min(low[name], low[other])
            elif other in stack:
                low[name] = min(low[name], index[other])
        if low[name] == index[name]:
            at = stack.index(name)
            group = stack[at:]
            del stack[at:]
            if len(group) > 1:
                found.append(sorted(group))

    for name in sorted(graph):
        if name not in index:
            visit(name)
    return sorted(found)


def graph_of(package: Path) -> dict[str, set[str]]:
    """Which module imports which."""
    known = modules(package)
    return {name: imports(name, path, set(known)) for name, path in known.items()}


def described(graph: dict[str, set[str]]) -> str:
    """Every circle with the imports that close it."""
    lines = []
    for group in circles(graph):
        lines.append(f"circle of {len(group)}:")
        lines += [f"  {name} imports {', '.join(sorted(graph[name] & set(group)))}" for name in group]
    return "\n".join(lines)


def test_no_module_depends_on_itself_by_way_of_others() -> None:
    graph = graph_of(PACKAGE)
    assert not circles(graph), described(graph)


def test_drawing_depends_on_data_and_never_the_other_way_round() -> None:
    """What is made of a result may know what a result consists of; nothing there knows what is made of it."""
    graph = graph_of(PACKAGE)
    drawing = ("vffnull.plotting", "vffnull.report", "vffnull.viewer", "vffnull.notebook")
    facades = {"vffnull.result", "vffnull._realtime", "vffnull.evaluation", "vffnull.evaluation.run"}
    wrong = {
        f"{name} imports {other}"
        for name, others in graph.items()
        if name.startswith(drawing)
        for other in others & facades
    }
    assert not wrong, "\n".join(sorted(wrong))


def test_the_reader_of_imports_sees_what_it_has_to(tmp_path: Path) -> None:
    """Lazy, relative and dynamic imports count, annotations do not; a circle through a third is found."""
    package = tmp_path / "house"
    (package / "rooms").mkdir(parents=True)
    files = {
        "__init__.py": '_LATER = {"b": "house.b"}\n',
        "a.py": "def f():\n    from house import b\n",
        "b.py": "from .rooms.c import thing\n",
        "rooms/__init__.py": 'import importlib as i\ndef f(n): return i.import_module(f"house.rooms.{n}")\n',
        "rooms/c.py": "from ..a import f\n",
        "d.py": "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from house.e import E\n",
        "e.py": "import house.d\nfrom house import _core\n'''house.a'''\n",
        "_core.pyi": "from house.e import E\n",
    }
    for name, text in files.items():
        (package / name).write_text(text, encoding="utf-8")
    graph = graph_of(package)
    assert graph["house"] == {"house.b"} and graph["house.rooms"] == {"house.rooms.c"}
    assert graph["house.d"] == set() and graph["house.e"] == {"house.d", "house._core"}
    assert circles(graph) == [["house.a", "house.b", "house.rooms.c"]]
    assert "house.rooms.c imports house.a" in described(graph)
    assert sys.getrecursionlimit() > len(modules(PACKAGE))
