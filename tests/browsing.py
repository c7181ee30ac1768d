"""A browser for tests of pages."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import pytest

from waiting import HANG

NUDGE = 15.0  # s, after which somebody pulls at the window
WEBGL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")  # without a GPU


def playwright() -> Any:
    """The library that drives browsers; without it the test is skipped."""
    return pytest.importorskip("playwright.sync_api")


@contextmanager
def chromium(*arguments: str) -> Iterator[Any]:
    """Debian's chromium; without one the test is skipped, but in CI only if `.ci/check` leaves it out."""
    library = playwright()
    executable = shutil.which("chromium")
    if executable is None:
        if os.environ.get("CI") and "chromium" not in os.environ.get("VFFNULL_LEFT_OUT", "").split():
            pytest.fail("there is no chromium; install Debian's package of that name")
        pytest.skip("there is no chromium")
    with library.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=executable, args=["--no-sandbox", *arguments])
        yield browser
        browser.close()


@dataclass
class Visit:
    """A page in a tab: what it has asked for, and what went wrong in it."""

    tab: Any
    requests: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)

    def hosts(self) -> set[str]:
        """Of whom it has asked something."""
        return {url.split("/")[2] for url in self.requests if url.startswith("http")}


def visit(
    browser: Any, url: str, settled: Callable[[Any], bool], size: tuple[int, int], script: str = ""
) -> Visit:
    """Open a page, in which a script runs first, and wait until its picture has settled.

    Without a GPU a tab sometimes stands still before its first picture; a visitor opens another.
    """
    for patience in (60.0, 240.0, HANG):
        width, height = size
        tab = browser.new_page(viewport={"width": width, "height": height}, device_scale_factor=0.5)
        tab.add_init_script(script)
        seen = Visit(tab)
        tab.set_default_timeout(1000 * patience)
        tab.on("request", lambda request, seen=seen: seen.requests.append(request.url))
        tab.on("pageerror", lambda error, seen=seen: seen.errors.append(str(error)))
        try:
            tab.goto(url)
            tab.wait_for_selector("#vff-tip")
            start = time.monotonic()
            nudged = 0
            while not settled(tab):
                passed = time.monotonic() - start
                assert passed < patience, "the picture did not come to rest"
                tab.wait_for_timeout(100)
                if passed > NUDGE * (nudged + 1):  # a window of another size is drawn anew
                    nudged += 1
                    tab.set_viewport_size({"width": width, "height": height - nudged % 2})
            tab.set_default_timeout(1000 * HANG)
            return seen
        except (AssertionError, playwright().TimeoutError) as stuck:
            if patience == HANG:
                raise
            print(f"a tab stood still: {stuck}")
            tab.close()
    raise AssertionError("unreachable")
