"""What the search page shows of the pages that it finds, also where the site is read from files.

Sphinx fetches every page that is found, which browsers forbid to pages opened from files. Here the text of
all pages comes along with the search page.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from html import escape
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx

FILE = "snippets.js"
SCRIPT = """// What would be fetched of a page that is found: its text.
const texts = %s;
const fetched = window.fetch;
window.fetch = (url, ...more) => {
  const root = document.documentElement.dataset.content_root;
  const name = String(url).slice(root.length).replace(/\\.html$/, "");
  return name in texts ? Promise.resolve(new Response(texts[name])) : fetched(url, ...more);
};
"""


def text(node: nodes.Node) -> str:
    """What is read of a node, as HTML that has sections and nothing else."""
    match node:
        case nodes.raw() | nodes.comment() | nodes.math_block():
            return ""
        case nodes.Element() if "sd-hide-link-text" in node.get("classes", ()):
            return ""
        case nodes.Text():
            return escape(node.astext())
        case nodes.section():
            return f'<section id="{node["ids"][0]}">{_joined(node)}</section>'
        case nodes.TextElement():
            return _joined(node) + ("" if isinstance(node, nodes.Inline) else "\n")
        case _:
            return _joined(node)


def _joined(node: nodes.Node) -> str:
    return "".join(map(text, node.children))


def write(app: Sphinx) -> Iterable[Any]:
    """Write the texts of all pages beside what the site loads."""
    texts = {
        name: f'<div role="main">{text(app.env.get_doctree(name))}</div>'
        for name in sorted(app.env.found_docs)
    }
    target = Path(app.outdir) / "_static" / FILE
    target.write_text(SCRIPT % json.dumps(texts, ensure_ascii=False), encoding="utf-8")
    return ()


def load(app: Sphinx, page: str, *_: Any) -> None:
    """Let the search page, and no other, load them."""
    if page == "search":
        app.add_js_file(FILE)


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("html-collect-pages", write)  # before the search page is made
    app.connect("html-page-context", load)
    return {"parallel_read_safe": True}
