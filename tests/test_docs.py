"""What the documentation has beside its text, without building it: examples in space, tutorials, search."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import vffnull as vff

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"


def in_space(example: Path) -> bool:
    """Whether an example names a bundled scenario in space."""
    named = set(re.findall(r'"([a-z0-9-]+)"', example.read_text(encoding="utf-8"))) & set(vff.scenarios())
    return any(vff.Scenario.load(name).arm.dimension == 3 for name in named)


def test_half_of_the_examples_are_in_space() -> None:
    examples = sorted((ROOT / "examples").glob("*.py"))
    assert 2 * sum(map(in_space, examples)) >= len(examples) > 10


def test_every_tutorial_is_listed_with_a_sentence_and_a_picture() -> None:
    pages = {page.stem for page in (DOCS / "tutorials").glob("*.md")} - {"index"}
    index = (DOCS / "tutorials" / "index.md").read_text(encoding="utf-8")
    cards = re.findall(r"^:::\{grid-item-card\} (.+?)\n(.*?)^:::$", index, re.M | re.S)
    listed = {}
    for title, body in cards:
        (page,) = re.findall(r"^:link: (\S+)$", body, re.M)
        (picture,) = re.findall(r"^:img-top: (\S+)$", body, re.M)
        assert f"# {title}\n" in (DOCS / "tutorials" / f"{page}.md").read_text(encoding="utf-8")
        assert body.strip().splitlines()[-1].endswith(".")
        listed[page] = picture
    assert set(listed) == pages
    assert set(index.partition(":hidden:")[2].replace("```", "").split()) == pages
    drawn = re.findall(r'^    "([a-z-]+)": \(', (DOCS / "_ext" / "pages.py").read_text("utf-8"), re.M)
    for page, picture in listed.items():
        assert picture == f"../generated/figures/tutorial-{page}.png" and page in drawn


def test_the_first_page_begins_with_an_arm_in_space_and_the_command() -> None:
    first, *_ = (DOCS / "index.md").read_text(encoding="utf-8").partition("grid-item-card")
    assert re.search(r"!\[[^]]*Panda[^]]*\]\(generated/figures/panda-sweep\.gif\)", first)
    assert "```sh\npip install .\n" in first


def test_the_header_names_pages_in_a_word_or_two() -> None:
    """As many and as long as one row of 1440 pixels takes, and of 1024."""
    (titles,) = re.findall(r":hidden:\n\n(.*?)```", (DOCS / "index.md").read_text(encoding="utf-8"), re.S)
    names = re.findall(r"^(.+) <\S+>$", titles, re.M)
    assert len(names) == len(titles.split("\n")) - 1 <= 8
    assert max(map(len, names)) <= 10 and len("".join(names)) <= 64


def test_search_finds_the_text_of_pages_where_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sections keep their names, which results lead to; scripts and hidden words are no text."""
    core = pytest.importorskip("docutils.core")
    monkeypatch.syspath_prepend(str(DOCS / "_ext"))
    import snippets

    page = core.publish_doctree(
        "Field\n=====\n\nA force <F> & *more*.\n\n.. raw:: html\n\n   <script>hidden</script>\n\n"
        "Reach\n-----\n\nThe projector.\n",
        settings_overrides={"doctitle_xform": False},
    )
    found = snippets.text(page)
    assert found.startswith('<section id="field">Field\nA force &lt;F&gt; &amp; more.\n')
    assert '<section id="reach">Reach\nThe projector.\n</section>' in found
    assert "hidden" not in found
