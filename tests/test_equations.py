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


def rows(page: str, heading: str) -> list[list[str]]:
    """The cells of the table below a heading."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    below = text[text.index(heading) :].split("\n## ")[0]
    lines = [line for line in below.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in lines[1:]]


PLANE = rows("theory.md", "## 12. Where each equation lives")
SPACE = rows("theory-spatial.md", "## Where each equation of space lives")


def numbers(cell: str) -> set[int]:
    """All equations that a cell names, those between two as well."""
    found = {int(each) for each in NUMBER.findall(cell)}
    for first, last in RANGE.findall(cell):
        found |= set(range(int(first), int(last) + 1))
    return found


@pytest.mark.parametrize("row", [*PLANE, *SPACE], ids=lambda row: f"{row[0]} {row[-2]}")
def test_files_and_functions_exist(row: list[str]) -> None:
    text = ""
    for name in (each for each in CODE.findall(f"{row[-2]} {row[-1]}") if "/" in each or ".rs" in each):
        path = CORE / name
        assert path.exists(), name
        files = path.rglob("*.rs") if path.is_dir() else [path]
        text += "".join(each.read_text(encoding="utf-8") for each in files)
    said = re.sub(r"the metric `\w+`", "", row[-1])
    for name in re.findall(r"`([\w:]+)`", said):
        defined = rf"\b(fn|struct|enum|trait|macro_rules!) {name.split('::')[-1]}\b"
        assert re.search(defined, text), f"{name} is not defined in {row[-2]}"


@pytest.mark.parametrize("row", SPACE, ids=lambda row: f"{row[0]} {row[1]}")
def test_public_names_exist(row: list[str]) -> None:
    for name in CODE.findall(row[1]):
        place: Any = vff
        *owners, last = name.split(".")
        for each in owners:
            place = getattr(place, each)
        fields = getattr(place, "__dataclass_fields__", {})
        assert hasattr(place, last) or last in fields, name


def test_every_equation_of_space_is_in_the_table() -> None:
    text = (ROOT / "docs" / "theory-spatial.md").read_text(encoding="utf-8")
    defined = {int(each) for each in re.findall(r"\\tag\{T(\d+)\}", text)}
    listed = set().union(*(numbers(row[0]) for row in SPACE))
    assert defined - listed == set()
