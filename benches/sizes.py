"""How long large documents take to be read and judged: `python benches/sizes.py`.

Numbers per second of processor time, which other programs do not change much. The time must grow in
proportion to the size: the last column is the ratio to the time of a tenth of it.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from typing import Any

import vffnull as vff
from vffnull import _core


def scene(**more: Any) -> dict[str, Any]:
    return {
        "duration": 0.01,
        "q0": [0.3, 0.4, 0.5],
        "arm": {"lengths": [1.0] * 3, "masses": 1.0},
        "reference": {"kind": "setpoint", "point": [1.5, 0.3]},
        **more,
    }


def polygon(corners: int) -> dict[str, Any]:
    around = (2 * math.pi * k / corners for k in range(corners))
    vertices = [[math.cos(angle), math.sin(angle)] for angle in around]
    return scene(obstacles=[{"shape": {"kind": "polygon", "vertices": vertices}, "position": [9.0, 9.0]}])


def table(rows: int) -> dict[str, Any]:
    points = [[1.5 + 0.1 * math.cos(0.01 * k), 0.3] for k in range(rows)]
    times = [1e-2 * k for k in range(rows)]
    return scene(reference={"kind": "table", "times": times, "points": points})


def obstacles(count: int) -> dict[str, Any]:
    disc = {"kind": "circle", "radius": 0.01}
    return scene(obstacles=[{"shape": disc, "position": [5.0 + 0.01 * k, 3.0]} for k in range(count)])


def numbers(count: int) -> dict[str, Any]:
    return scene(q0=[0.1] * count)


def text(count: int) -> str:
    return f"q0 = [{', '.join(['0.125'] * count)}]\n"


SIZES: dict[str, tuple[Callable[[int], Any], int, int]] = {
    "a polygon of corners": (polygon, 10**5, 2),
    "a table of rows": (table, 10**6, 3),
    "discs": (obstacles, 10**6, 3),
    "a list of numbers that does not belong there": (numbers, 10**7, 1),
    "a list of numbers in a TOML text": (text, 10**7, 1),
}


def read(given: Any) -> float:
    """Seconds of this thread's processor time until it is read, or refused."""
    start = time.thread_time()
    try:
        if isinstance(given, str):
            _core.parse_toml(given, "text")
        else:
            _core.check("scenario", given)
    except vff.VffNullError as error:
        assert len(str(error)) < 1000, "the message quotes all of it"
    return time.thread_time() - start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--share", type=float, default=1.0, help="of the sizes, for a quick look")
    share = parser.parse_args().share
    print("| what | size | s | numbers per second | time against a tenth of it |\n|---|--:|--:|--:|--:|")
    for name, (make, size, each) in SIZES.items():
        size = int(size * share)
        small, large = read(make(size // 10)), read(make(size))
        print(
            f"| {name} | {size} | {large:.2f} | {size * each / large:.2g} | {large / small:.0f} |", flush=True
        )


if __name__ == "__main__":
    main()
