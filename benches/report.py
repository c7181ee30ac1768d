"""What the programs that write docs/speed.md have in common."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path


def rows(head: Sequence[str], body: Iterable[Sequence[str]]) -> str:
    """A Markdown table: names to the left, numbers to the right."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *body]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def readable(seconds: float) -> str:
    """A time to three digits with a fitting unit."""
    unit, size = next(u for u in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6), ("ns", 1e-9)) if seconds >= u[1])
    value = seconds / size
    return f"{value:.{max(0, 2 - len(str(int(value))) + 1)}f} {unit}"


def write_section(page: Path, name: str, text: str) -> None:
    """Replace what stands between the two marks of a section on a page."""
    begin, end = f"<!-- {name}: generated -->\n", f"<!-- {name}: end -->"
    before = page.read_text(encoding="utf-8")
    after, count = re.subn(
        re.escape(begin) + ".*?" + re.escape(end), lambda _: begin + text + end, before, flags=re.DOTALL
    )
    if count != 1:
        raise SystemExit(f"{page.name} has no section {name!r}")
    page.write_text(after, encoding="utf-8")
    print(f"{page.name}: {name}")
