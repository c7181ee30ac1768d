"""The live page is there soon: what is left out until its first picture."""

from __future__ import annotations

import zipfile
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import pytest

import vffnull as vff
from browsing import WEBGL, chromium, visit

pytest.importorskip("viser")

WATCH = """
  window.shaders = [];
  const given = WebGL2RenderingContext.prototype.shaderSource;
  WebGL2RenderingContext.prototype.shaderSource = function (shader, text) {
    window.shaders.push(text);
    return given.call(this, shader, text);
  };
"""


def test_the_script_comes_first_and_unpacked(page: Any) -> None:
    """Before viser's own; browsers look for the encoding in the first 1024 bytes alone."""
    talk = HTTPConnection("127.0.0.1", int(page.url.rpartition(":")[2]))
    talk.request("GET", "/", headers={"Accept-Encoding": "gzip"})
    answer = talk.getresponse()
    body = answer.read()
    talk.close()
    assert answer.headers["Content-Encoding"] == "identity"
    assert int(answer.headers["Content-Length"]) == len(body)
    first, *others = body.split(b"<script")[1:]
    assert b"antialias" in first and b"data-p=" in others[0] and b"antialias" not in others[0][:2000]
    assert 0 <= body.find(b'charset="utf-8"') < 1000


def test_what_is_no_page_is_left_as_it_is(page: Any) -> None:
    talk = HTTPConnection("127.0.0.1", int(page.url.rpartition(":")[2]))
    talk.request("GET", "/nothing.html")
    assert talk.getresponse().status == 404
    talk.close()


def test_the_archive_of_icons_is_read_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """It has thousands; reading its list took longer than all else of the page together."""
    import viser._icons

    opened = []
    read = zipfile.ZipFile.__init__

    def noted(self: zipfile.ZipFile, *arguments: Any, **how: Any) -> None:
        opened.append(str(arguments[0]))
        read(self, *arguments, **how)

    viser._icons.svg_from_icon.cache_clear()
    monkeypatch.setattr(zipfile.ZipFile, "__init__", noted)
    page = vff.live("swing", open_browser=False, block=False, record_to=tmp_path)
    try:
        assert sum(name.endswith("tabler-icons.zip") for name in opened) == 1, opened
        assert page._panel._pause._icon_html.startswith("<svg")
        assert viser._icons.zipfile is zipfile
    finally:
        page.stop()


def test_the_first_picture_needs_no_photograph_and_no_smooth_edges_without_a_card(tmp_path: Path) -> None:
    """viser would make light of a photograph that it brings along, and smooth every edge four times."""
    page = vff.live("panda-sweep", open_browser=False, block=False, record_to=tmp_path)
    try:
        with chromium(*WEBGL) as browser:
            seen = visit(browser, page.url, lambda _: True, (900, 600), WATCH)
            seen.tab.wait_for_function("() => window.shaders.some(text => text.includes('MeshStandard'))")
            assert not seen.tab.evaluate("() => window.shaders.some(text => text.includes('GainMap'))")
            smooth = seen.tab.evaluate(
                "() => [...document.querySelectorAll('canvas')].filter(each => each.width)"
                ".map(each => each.getContext('webgl2')?.getContextAttributes().antialias)"
            )
            assert False in smooth and True not in smooth
            assert seen.errors == []
    finally:
        page.stop()
