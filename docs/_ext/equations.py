"""Makes GitHub's formulas Sphinx's, and gives every numbered equation an address.

A block ```` ```math ```` becomes an equation, with the target `eq-t12` if it has the tag T12. In every page
(T12) becomes a link to it.
"""

from __future__ import annotations

import re
from pathlib import Path

from sphinx.application import Sphinx

BLOCK = re.compile(r"^```math\n(.*?)^```$", re.M | re.S)
TAG = re.compile(r"\\tag\{T(\d+)\}")
# What must stay as it is comes first: fenced blocks, code, formulas, links.
MENTION = re.compile(r"^(`{3,}|:{3,}).*?^\1|`[^`\n]+`|\$[^$\n]+\$|\]\([^)]*\)|\(T(\d+)\)", re.M | re.S)


def known(source: Path) -> set[str]:
    """Numbers of the equations in the theory."""
    return set(TAG.findall((source / "theory.md").read_text(encoding="utf-8")))


def equation(block: re.Match[str]) -> str:
    """A formula as Sphinx has it: without another environment round it, so that the tag is legal."""
    tag = TAG.search(block[1])
    target = f"(eq-t{tag[1]})=\n" if tag else ""
    body = f"\\begin{{equation}}\n{block[1]}\\end{{equation}}"
    return f"{target}```{{math}}\n:no-wrap:\n\n{body}\n```"


def on_source_read(app: Sphinx, docname: str, source: list[str]) -> None:
    """Rewrite Markdown before it is parsed."""
    if Path(app.env.doc2path(docname)).suffix != ".md":
        return
    numbers = known(Path(app.srcdir))

    def link(found: re.Match[str]) -> str:
        number = found[2]
        return f"[(T{number})](#eq-t{number})" if number in numbers else found[0]

    source[0] = BLOCK.sub(equation, MENTION.sub(link, source[0]))


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("source-read", on_source_read)
    return {"parallel_read_safe": True}
