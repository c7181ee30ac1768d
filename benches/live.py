"""How soon the live page is there, and how it keeps up: `python benches/live.py`.

`vffnull live` is started in a process of its own and opened in a headless Chromium, which is running
already and draws without a graphics card (SwiftShader), 1200 × 700. "Listens": from the start of the
command to the line with the address; "opens": to the first picture with the arm and its readouts; "work":
what the processors have done for command and browser until then, which depends less on what else the machine
does. Then the loop runs beside the browser: pictures are those that the browser draws in a second, messages
those that the page sends to it. Needs `pip install ".[viewer]"`, playwright and Debian's chromium.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

from playwright.sync_api import Browser, Page, sync_playwright

import vffnull as vff

DRAWN = """() => new Promise(done => {
    let count = 0; const start = performance.now();
    const each = now => { count += 1;
        now - start < %d ? requestAnimationFrame(each) : done(1000 * count / (now - start)); };
    requestAnimationFrame(each);
})"""
SETTLED = 5.0
"""After so long [s] a browser that has just been started works no more on its own."""
BEGUN = 60.0
"""So long after its first picture [s] a page that has not begun is given up."""
LONGEST = 3600.0
"""So long [s] is a run that shall not come to its end, where it would pause, while it is measured."""
WITHOUT_GPU = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")


def opened(browser: Browser, url: str) -> tuple[Page, list[object]]:
    """A tab in which the page has drawn, and what it hears from the server."""
    tab = browser.new_page(viewport={"width": 1200, "height": 700})
    heard: list[object] = []
    tab.on("websocket", lambda server: server.on("framereceived", lambda message: heard.append(message)))
    tab.goto(url)
    tab.wait_for_selector("#vff-tip")
    tab.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    return tab, heard


def computed() -> float:
    """Seconds that the processors have worked for the processes that this one has started, and for theirs."""
    started: dict[int, tuple[int, int]] = {}
    for each in Path("/proc").glob("[0-9]*/stat"):
        try:
            what = each.read_text().rpartition(")")[2].split()
        except OSError:  # it has ended meanwhile
            continue
        started[int(each.parent.name)] = int(what[1]), int(what[11]) + int(what[12])
    mine = {os.getpid()}
    while more := {pid for pid, (parent, _) in started.items() if parent in mine} - mine:
        mine |= more
    return sum(started[pid][1] for pid in mine - {os.getpid()}) / os.sysconf("SC_CLK_TCK")


def opening(browser: Browser, name: str) -> tuple[float, float, float]:
    """Seconds from the command to its answer, to the picture, and of work until then."""
    start, before = time.perf_counter(), computed()
    command = [sys.executable, "-m", "vffnull", "live", name, "--no-browser"]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert server.stdout is not None
        url = next(word for line in server.stdout for word in line.split() if word.startswith("http"))
        listens = time.perf_counter() - start
        tab, _ = opened(browser, url.rstrip(";"))
        opens, work = time.perf_counter() - start, computed() - before
        tab.close()
        return listens, opens, work
    finally:
        server.send_signal(signal.SIGINT)
        server.communicate()


def look(browser: Browser, name: str, seconds: float) -> str:
    listens, opens, work = opening(browser, name)
    scenario = vff.Scenario.load(name).replace(duration=LONGEST)
    page = vff.live(scenario, open_browser=False, block=False)
    try:
        tab, heard = opened(browser, page.url)
        due = time.perf_counter() + BEGUN
        while not page._seen or page._held_until is not None:  # time waits for the first picture
            if time.perf_counter() > due:
                raise SystemExit(f"{name}: time has not begun after {BEGUN:g} s")
            tab.wait_for_timeout(100)
        tab.wait_for_timeout(3000)
        before, sent = page.snapshot(), len(heard)
        pictures = tab.evaluate(DRAWN % (1000 * seconds))
        after, messages = page.snapshot(), (len(heard) - sent) / seconds
        tab.close()
    finally:
        page.stop()
    periods = after["periods"] - before["periods"]
    if not periods:
        raise SystemExit(f"{name}: the loop has stopped: {after['status']}")
    missed = 100 * (after["missed"] - before["missed"]) / periods
    loop = f"{after['rate']:.0f} | {missed:.2f} | {1e6 * after['worst']:.0f}"
    return f"| {name} | {listens:.1f} | {opens:.1f} | {work:.1f} | {loop} | {pictures:.0f} | {messages:.0f} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("scenarios", nargs="*", default=["sweep-through", "panda-sweep", "panda-cup"])
    parser.add_argument("--seconds", type=float, default=10.0)
    given = parser.parse_args()
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=[*WITHOUT_GPU])
        tab = browser.new_page()
        tab.goto("about:blank")
        tab.wait_for_timeout(1000 * SETTLED)
        tab.close()
        print("| scenario | listens [s] | opens [s] | work [s] | loop [Hz] | missed [%] ", end="")
        print("| longest step [µs] | pictures/s | messages/s |")
        print("|---|--:|--:|--:|--:|--:|--:|--:|--:|")
        for name in given.scenarios:
            print(look(browser, name, given.seconds), flush=True)
        browser.close()


if __name__ == "__main__":
    main()
