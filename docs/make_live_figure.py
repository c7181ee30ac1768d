"""The films of the live page, in chromium: needs the extras viewer and test.

`live.gif` shows a disc that is dragged through an arm in the plane and back, `live-space.gif` a ball through
the elbow of a Panda, `live-pull.gif` the elbow itself, pulled to and fro by the mouse; each as a loop.
Between two pictures the page is paused, so that a slow renderer changes nothing in what is seen.
`python docs/make_live_figure.py live-space` makes one of them.
"""

from __future__ import annotations

import shutil
import sys
import time
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw
from playwright.sync_api import sync_playwright

import vffnull as vff
from vffnull.evaluation.geometry.arm import rotation
from vffnull.live.stories import STORIES

FIGURES = Path(__file__).parent / "figures"
WEBGL = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
HAND = np.array([[0, 0], [0, 17], [4, 13], [7, 20], [10, 19], [7, 12], [12, 12]])


@dataclass(frozen=True)
class Film:
    """An obstacle, or a link, that is dragged from one place [m] to another and back."""

    scenario: str
    """A bundled one, or a story of the page."""
    start: tuple[float, ...]
    end: tuple[float, ...]
    size: tuple[int, int] = (1400, 860)
    """Of the page, pixels."""
    width: int = 760
    """Of the film, pixels."""
    steps: int = 36
    pause: float = 0.15
    """Seconds of the loop from one picture to the next."""
    colours: int = 160
    link: int | None = None
    """The link that is pulled, with the mouse; its places are relative to where it is at the start."""

    def place(self, step: int) -> Any:
        """Where the obstacle is dragged to."""
        share = 0.5 - 0.5 * np.cos(2 * np.pi * max(step, 0) / self.steps)
        return np.array(self.start) + share * (np.array(self.end) - self.start)


FILMS = {
    "live": Film("swing", (2.6, 3.0), (2.75, 0.75)),
    "live-space": Film(
        "panda-sweep", (-0.05, -0.5, 0.62), (-0.05, 0.12, 0.62), size=(1500, 760), width=900, colours=255
    ),
    "live-pull": Film(
        "Touch", (0.1, 0.28, 0.0), (-0.1, -0.28, 0.0), size=(1500, 760), width=900, colours=255, link=3
    ),
}


def main(names: list[str]) -> None:
    for name in names or FILMS:
        pictures = shoot(FILMS[name])
        save(pictures, FILMS[name], FIGURES / f"{name}.gif")


def shoot(film: Film) -> list[Image.Image]:
    """The pictures, after a third of a turn that brings the arm to where it is at the end of one."""
    if film.link is None:
        still = {"obstacles.0.motion": None, "obstacles.0.position": list(film.start)}
        scenario = vff.Scenario.load(film.scenario).replace(**still)
    else:
        scenario = STORIES[film.scenario].open()
    page = vff.live(scenario, open_browser=False, block=False)
    try:
        page.pause(True)  # while the browser builds the page
        with sync_playwright() as driver:
            browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=WEBGL)
            tab = browser.new_page(viewport={"width": film.size[0], "height": film.size[1]})
            tab.set_default_timeout(600_000)
            tab.goto(page.url)
            tab.wait_for_selector("#vff-tip")
            for close in tab.locator(".mantine-Notification-closeButton").all():
                close.evaluate("button => button.click()")
            if film.link is not None:
                tab.wait_for_timeout(3000)  # the camera comes to rest
                tab.mouse.move(*pixel(page, tab, link_of(film, page)))
                tab.mouse.down()
            begin = link_of(film, page)
            first = film.steps // 3
            pictures = [picture(film, page, tab, k, begin) for k in range(-first, film.steps)][first + 1 :]
            browser.close()
    finally:
        page.stop()
    return pictures


def link_of(film: Film, page: Any) -> Any:
    """Where the link is that is pulled [m]."""
    poses = page.scenario.arm.link_poses(page.snapshot()["q"])
    return poses[film.link or 0, :3, 3]


def picture(film: Film, page: Any, tab: Any, step: int, begin: Any) -> Image.Image:
    """Drag on, let the loop run for a moment, and take a picture of it with the hand."""
    if film.link is None:
        page._carry(0, film.place(step))
    else:
        tab.mouse.move(*pixel(page, tab, begin + film.place(step)))
        tab.wait_for_timeout(200)
    until = page.snapshot()["t"] + film.pause
    page.pause(False)
    while page.snapshot()["t"] < until:
        time.sleep(0.001)
    page.pause(True)
    drawn = page.drawn
    while page.drawn < drawn + 3:
        time.sleep(0.005)
    if step < -1:
        return Image.new("RGB", (1, 1))  # nobody sees it
    tab.wait_for_timeout(350)  # a software renderer needs it
    shown = Image.open(BytesIO(tab.screenshot())).convert("RGB")
    where = page._scene._obstacles[0].position if film.link is None else begin + film.place(step)
    corners = [tuple(corner) for corner in HAND * 1.3 + pixel(page, tab, where)]
    ImageDraw.Draw(shown).polygon(corners, fill="white", outline="black", width=2)
    return shown


def pixel(page: Any, tab: Any, place: Any) -> tuple[float, float]:
    """Where a place [m] is seen in the page."""
    (client,) = page._server.get_clients().values()
    camera, box = client.camera, tab.locator("canvas").first.bounding_box()
    right, below, ahead = rotation(camera.wxyz).T @ (place - camera.position)
    scale = box["height"] / 2 / np.tan(camera.fov / 2) / ahead
    return box["x"] + box["width"] / 2 + scale * right, box["y"] + box["height"] / 2 + scale * below


def save(pictures: list[Image.Image], film: Film, path: Path) -> None:
    """The film, with one palette for all pictures: of the colours that there are, however rare."""
    size = (film.width, film.width * film.size[1] // film.size[0])
    small = [each.resize(size, Image.Resampling.LANCZOS) for each in pictures]
    seen = np.concatenate([np.asarray(each).reshape(-1, 3) for each in small[:: len(small) // 6]])
    shades, counts = np.unique(seen, axis=0, return_counts=True)
    shades = np.repeat(shades, np.ceil(counts**0.6).astype(int), axis=0)
    sheet = Image.fromarray(shades[None])
    palette = sheet.quantize(colors=film.colours, method=Image.Quantize.MEDIANCUT)
    frames = [each.quantize(palette=palette, dither=Image.Dither.NONE) for each in small]
    frames[0].save(
        path,
        save_all=True,
        append_images=frames[1:],
        duration=round(1000 * film.pause),
        loop=0,
        optimize=True,
    )


if __name__ == "__main__":
    main(sys.argv[1:])
