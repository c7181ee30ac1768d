"""The tables that say where each equation lives: every file, function and public name in them exists."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

import vffnull as vff

ROOT = Path(__file__).resolve().parents[1]
CORE = ROOT / "crates" / "vff-core" / "src"
NUMBER = re.compile(r"\(T(\d+)\)")
RANGE = re.compile(r"\(T(\d+)\)–\(T(\d+)\)")
CODE = re.compile(r"`([^`]+)`")


def rows(page: str, heading: str) -> list[dict[str, str]]:
    """The table below a heading, every row by the names of its columns."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    below = text[text.index(heading) :].split("\n## ")[0]
    lines = [line for line in below.splitlines() if line.startswith("| ")]
    head, *cells = ([cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in lines)
    return [dict(zip(head, each, strict=True)) for each in cells]


PLANE = rows("theory.md", "## 12. Where each equation lives")
PAPER = rows("theory.md", "## 13. Where the paper's equations live")
SPACE = rows("theory-spatial.md", "## Where each equation lives")


def numbers(cell: str) -> set[int]:
    """All equations that a cell names, those between two as well."""
    found = {int(each) for each in NUMBER.findall(cell)}
    for first, last in RANGE.findall(cell):
        found |= set(range(int(first), int(last) + 1))
    return found


def sources(text: str) -> str:
    """The source of all files that are named; one that is not below the core's is beside the one before."""
    found, folder = "", CORE
    for name in (each for each in CODE.findall(text) if "/" in each or ".rs" in each):
        path = CORE / name if (CORE / name).exists() else folder / name
        assert path.exists(), name
        folder = path if path.is_dir() else path.parent
        files = path.rglob("*.rs") if path.is_dir() else [path]
        found += "".join(each.read_text(encoding="utf-8") for each in files)
    return found


@pytest.mark.parametrize(
    "row", [*PLANE, *SPACE, *PAPER], ids=lambda row: f"{row.get('equation', row.get('paper'))} {row['file']}"
)
def test_files_and_functions_exist(row: dict[str, str]) -> None:
    source = sources(f"{row['file']} {row['function']}")
    said = re.sub(r"the metric `\w+`", "", row["function"])
    for name in re.findall(r"`([\w:]+)`", said):
        defined = rf"\b(fn|struct|enum|trait|macro_rules!) {name.split('::')[-1]}\b"
        assert re.search(defined, source), f"{name} is not defined in {row['file']}"


@pytest.mark.parametrize("row", SPACE, ids=lambda row: row["equation"])
def test_public_names_exist(row: dict[str, str]) -> None:
    for name in CODE.findall(row["in Python"]):
        place: Any = vff
        *owners, last = name.split(".")
        for each in owners:
            place = getattr(place, each)
        assert hasattr(place, last) or last in getattr(place, "__dataclass_fields__", {}), name


def test_every_equation_is_in_its_table() -> None:
    """But for statements about the closed loop, (T14), (T15), and for a rule of thumb, (T29)."""
    for page, table in (("theory.md", PLANE), ("theory-spatial.md", SPACE)):
        text = (ROOT / "docs" / page).read_text(encoding="utf-8")
        defined = {int(each) for each in re.findall(r"\\tag\{T(\d+)\}", text)}
        assert defined - set().union(*(numbers(row["equation"]) for row in table)) <= {14, 15, 29}, page


def test_every_equation_of_the_paper_has_its_line() -> None:
    """From (1) to (23) but for (21), which it leaves out; what is here for each is an equation of ours."""
    found: set[int] = set()
    for row in PAPER:
        plain = re.sub(r"\((\d+)\)", r"(T\1)", row["paper"])
        found |= numbers(plain)
        assert numbers(row["here"]), row["paper"]
    assert found == set(range(1, 24)) - {21}
