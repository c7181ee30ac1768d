"""What imports what inside the package, read from the source: no circle, late imports and those for
annotations included, and rooms that stand on one another; no file is long.
"""

from __future__ import annotations

import ast
import re
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
    """The modules of `known` that a module imports: at its top, inside its functions, for its annotations
    (``if TYPE_CHECKING``), by a name in a string.
    """
    if path.suffix == ".pyi":  # types alone
        return set()
    tree = ast.parse(path.read_text(encoding="utf-8"), str(path))
    parent = name if path.name == "__init__.py" else name.rpartition(".")[0]
    found: set[str] = set()
    for node in code(tree):
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


def code(node: ast.AST) -> Iterator[ast.AST]:
    """Everything below a node but text that explains."""
    for child in ast.iter_child_nodes(node):
        if not (isinstance(child, ast.Expr) and isinstance(child.value, ast.Constant)):
            yield child
            yield from code(child)


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


FROM_RUST = {
    "vffnull._support.representation",  # a notebook's card of an arm
    "vffnull.arms",  # `Arm.from_urdf`, `Arm.from_mjcf`
    "vffnull.model.obstacle",  # what does not change, so that a controller need not read it again
    "vffnull.engines.export",  # `Arm.to_urdf`, `Arm.to_mjcf`
    "vffnull.model.scenario",  # what is no document yet: a name, a path, a `Scenario`
}
"""What compiled classes and functions call back, which no import shows."""


def room_of(name: str) -> str:
    """The folder or file of the package where a module is; the package's own names are one, too."""
    return [*name.split("."), "__init__"][1]


def rooms_of(graph: dict[str, set[str]]) -> dict[str, set[str]]:
    """Which room needs which; the compiled module, under all of them, is none."""
    found: dict[str, set[str]] = {room_of(name): set() for name in graph if name != "vffnull._core"}
    for name, others in graph.items():
        if room_of(name) in found:
            found[room_of(name)] |= {room_of(other) for other in others} & set(found) - {room_of(name)}
    return found


def floor(room: str, rooms: dict[str, set[str]]) -> int:
    """A room stands above all that it needs."""
    return 1 + max((floor(other, rooms) for other in rooms[room]), default=0)


def test_rooms_are_few_and_arrows_between_them_run_down() -> None:
    graph = graph_of(PACKAGE)
    rooms = rooms_of(graph)
    between = circles(rooms)
    assert not between, "\n".join(
        f"{name} imports {other}"
        for name, others in sorted(graph.items())
        for other in sorted(others)
        if any({room_of(name), room_of(other)} <= set(group) for group in between)
        and room_of(name) != room_of(other)
    )
    assert len(rooms) <= 16 and max(floor(room, rooms) for room in rooms) <= 8, rooms
    assert not rooms["_support"] and rooms["model"] == {"_support"}


LONGEST = 600
"""Lines; a longer file answers more than one question."""


def test_no_file_is_long() -> None:
    lines = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in PACKAGE.rglob("*.py")}
    assert len(lines) > 150
    assert not {path.name: count for path, count in lines.items() if count > LONGEST}


def test_what_is_compiled_calls_back_where_it_has_to() -> None:
    """Python imports no more of what stands above the core than this, and errors, by name."""
    sources = (PACKAGE.parents[1] / "crates" / "vff-python" / "src").glob("**/*.rs")
    text = "\n".join(path.read_text(encoding="utf-8") for path in sources)
    assert set(re.findall(r'import\((?:\w+(?:\.\w+\(\))?, )?"(vffnull[\w.]*)"', text)) == FROM_RUST
    assert set(re.findall(r"import_exception!\((vffnull[\w.]*)", text)) == {"vffnull.errors"}


def test_the_reader_of_imports_sees_what_it_has_to(tmp_path: Path) -> None:
    """Late, relative and dynamic imports count, annotations too; a circle through a third is found."""
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
    assert graph["house.d"] == {"house.e"} and graph["house.e"] == {"house.d", "house._core"}
    assert circles(graph) == [["house.a", "house.b", "house.rooms.c"], ["house.d", "house.e"]]
    assert circles(rooms_of(graph)) == [["a", "b", "rooms"], ["d", "e"]]
    assert "house.rooms.c imports house.a" in described(graph)
    assert sys.getrecursionlimit() > len(modules(PACKAGE))
