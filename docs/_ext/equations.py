"""Makes GitHub's formulas Sphinx's, and gives every numbered equation an address.

A block ```` ```math ```` becomes an equation, with the target `eq-t12` if it has the tag T12. In every page
(T12) becomes a link to it. MathJax, one file of it, becomes a part of the site: reading fetches nothing.
"""

from __future__ import annotations

import re
import shutil
from importlib.util import find_spec
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.errors import ExtensionError

BLOCK = re.compile(r"^```math\n(.*?)^```$", re.M | re.S)
TAG = re.compile(r"\\tag\{T(\d+)\}")
# What must stay as it is comes first: fenced blocks, code, formulas, links.
MENTION = re.compile(r"^(`{3,}|:{3,}).*?^\1|`[^`\n]+`|\$[^$\n]+\$|\]\([^)]*\)|\(T(\d+)\)", re.M | re.S)


def known(source: Path) -> set[str]:
    """Numbers of the equations in the theory, of the plane and of space."""
    pages = source.glob("theory*.md")
    return {number for page in pages for number in TAG.findall(page.read_text(encoding="utf-8"))}


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


def on_builder_inited(app: Sphinx) -> None:
    """Copy MathJax from a package whose name is no identifier."""
    package = find_spec("sphinx-mathjax-offline")
    if package is None or package.origin is None:
        raise ExtensionError("the documentation needs `pip install vffnull[docs]`")
    script = str(app.config.mathjax_path)
    target = Path(app.outdir) / "_static"
    target.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(Path(package.origin).parent / "static" / "mathjax" / script, target / script)


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("builder-inited", on_builder_inited)
    app.connect("source-read", on_source_read)
    return {"parallel_read_safe": True}
