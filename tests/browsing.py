"""A browser for tests of pages."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

WEBGL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")  # without a GPU


def playwright() -> Any:
    """The library that drives browsers; without it the test is skipped."""
    return pytest.importorskip("playwright.sync_api")


@contextmanager
def chromium(*arguments: str) -> Iterator[Any]:
    """Debian's chromium; without one the test is skipped, but not in CI."""
    library = playwright()
    executable = shutil.which("chromium")
    if executable is None:
        if os.environ.get("CI"):
            pytest.fail("there is no chromium; install Debian's package of that name")
        pytest.skip("there is no chromium")
    with library.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=executable, args=["--no-sandbox", *arguments])
        yield browser
        browser.close()
