"""The film of the live page, in chromium: needs the extras viewer and test.

`live.gif` shows a disc that is dragged through the arm and back, as a loop. Between two pictures it is
paused, so that a slow renderer changes nothing in what is seen.
"""

from __future__ import annotations

import shutil
import time
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw
from playwright.sync_api import sync_playwright

import vffnull as vff

FIGURES = Path(__file__).parent / "figures"
WEBGL = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
SIZE = (1400, 860)
TOP, BOTTOM = np.array([2.6, 3.0]), np.array([2.75, 0.75])  # m, ends of the drag
STEPS, PAUSE = 36, 0.15  # pictures, and seconds of the loop from one to the next
WIDTH = 760  # of the film, pixels
HAND = np.array([[0, 0], [0, 17], [4, 13], [7, 20], [10, 19], [7, 12], [12, 12]])


def main() -> None:
    scenario = vff.Scenario.load("swing")
    still = {"obstacles.0.motion": None, "obstacles.0.position": TOP.tolist()}
    page = vff.live(scenario.replace(**still), open_browser=False, block=False)
    try:
        page.pause(True)  # while the browser builds the page
        with sync_playwright() as driver:
            browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=WEBGL)
            tab = browser.new_page(viewport={"width": SIZE[0], "height": SIZE[1]})
            tab.set_default_timeout(300_000)
            tab.goto(page.url)
            tab.wait_for_selector("#vff-tip")
            for close in tab.locator(".mantine-Notification-closeButton").all():
                close.evaluate("button => button.click()")
            pictures = [picture(page, tab, k) for k in range(-STEPS // 3, STEPS)][STEPS // 3 + 1 :]
            browser.close()
    finally:
        page.stop()
    small = [each.resize((WIDTH, WIDTH * SIZE[1] // SIZE[0]), Image.Resampling.LANCZOS) for each in pictures]
    sheet = Image.new("RGB", (WIDTH, 6 * small[0].height))
    for k in range(6):
        sheet.paste(small[k * len(small) // 6], (0, k * small[0].height))
    palette = sheet.quantize(colors=160, method=Image.Quantize.MEDIANCUT)
    film = [each.quantize(palette=palette, dither=Image.Dither.NONE) for each in small]
    film[0].save(
        FIGURES / "live.gif", save_all=True, append_images=film[1:], duration=round(1000 * PAUSE), loop=0,
        optimize=True,
    )  # fmt: skip


def picture(page: Any, tab: Any, step: int) -> Image.Image:
    """Drag the disc on, let the loop run for a moment, and take a picture of it with the hand."""
    share = 0.5 - 0.5 * np.cos(2 * np.pi * max(step, 0) / STEPS)
    place = TOP + share * (BOTTOM - TOP)
    page._carry(0, place)
    until = page.snapshot()["t"] + PAUSE
    page.pause(False)
    while page.snapshot()["t"] < until:
        time.sleep(0.001)
    page.pause(True)
    drawn = page.drawn
    while page.drawn < drawn + 3:
        time.sleep(0.005)
    tab.wait_for_timeout(350)  # a software renderer needs it
    shown = Image.open(BytesIO(tab.screenshot())).convert("RGB")
    (client,) = page._server.get_clients().values()
    box = tab.locator("canvas").first.bounding_box()
    x, y, height = client.camera.position
    scale = box["height"] / 2 / (height * np.tan(client.camera.fov / 2))
    at = page.snapshot()["obstacles"][0]
    pixel = (
        box["x"] + box["width"] / 2 + scale * (at[0] - x),
        box["y"] + box["height"] / 2 - scale * (at[1] - y),
    )
    corners = [tuple(corner) for corner in HAND * 1.3 + pixel]
    ImageDraw.Draw(shown).polygon(corners, fill="white", outline="black", width=2)
    return shown


if __name__ == "__main__":
    main()
