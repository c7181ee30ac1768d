"""The figure of the live page, in chromium: needs the extras viewer and test."""

from __future__ import annotations

import shutil
import time
from pathlib import Path

import numpy as np
from playwright.sync_api import sync_playwright

import vffnull as vff

WEBGL = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


def main() -> None:
    page = vff.live("swing", open_browser=False, block=False)
    try:
        with sync_playwright() as driver:
            browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=WEBGL)
            tab = browser.new_page(viewport={"width": 1400, "height": 860})
            tab.goto(page.url)
            tab.wait_for_selector("#vff-tip")
            for close in tab.locator(".mantine-Notification-closeButton").all():
                close.click()
            while page.snapshot()["t"] < 26.0 or np.abs(page.snapshot()["forces"]).max() < 10.0:
                time.sleep(0.005)
            page.pause(True)
            tab.wait_for_timeout(3000)  # a software renderer needs it
            tab.screenshot(path=Path(__file__).parent / "figures" / "live.png")
            browser.close()
    finally:
        page.stop()


if __name__ == "__main__":
    main()
