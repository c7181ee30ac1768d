"""Sliders of the joints: where they are within their limits, and where the arm is to begin."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from vffnull.model.scenario import Scenario

PATIENCE = 0.4
"""How long a slider rests [s] before the arm begins where it has been moved to."""
SEEN = 0.005
"""What moves by less [rad, m] is not sent."""


class Joints:
    """A slider per joint, from its lower to its upper limit, in the present container of the page.

    Parameters
    ----------
    gui : viser.GuiApi
        The page's controls.
    begin_at : Callable
        Called with joint positions (n,) from which the arm is to begin.
    """

    def __init__(self, gui: viser.GuiApi, begin_at: Callable[[list[float]], None]) -> None:
        self._gui, self._begin_at = gui, begin_at
        self._folder = gui.add_folder(None)
        self._sliders: list[Any] = []  # viser's types take their values for read-only
        self._shown: list[Any] = []
        self._moved: float | None = None
        self._set: set[int] = set()

    def show(self, scenario: Scenario) -> None:
        """Sliders for the joints of a scenario's arm; those of before, if it is the same one."""
        self._moved = None
        self._set.clear()
        arm = scenario.arm
        names = tuple(arm.joint_names) if arm.dimension == 3 else tuple(f"q{i + 1}" for i in range(arm.n))
        slides = [each["kind"] == "prismatic" for each in arm.to_dict().get("joints", [])] or [False] * arm.n
        units = ["m" if is_slide else "rad" for is_slide in slides]
        shown = list(zip(names, limits(scenario), units, strict=True))
        if shown == self._shown:
            return
        self._shown = shown
        for slider in self._sliders:
            slider.remove()
        self._sliders.clear()
        with self._folder:
            for i, (name, (low, high), unit) in enumerate(shown):
                self._sliders.append(self._add(i, name, low, high, unit))

    def _add(self, i: int, name: str, low: float, high: float, unit: str) -> viser.GuiSliderHandle[float]:
        slider = self._gui.add_slider(
            name.removesuffix("_joint"),
            low,
            high,
            1e-3,
            min(max(0.0, low), high),
            hint=f"{name} [{unit}], from {low:.2f} to {high:.2f}; moved, the arm begins anew from there",
        )

        @slider.on_update
        async def _(event: viser.GuiEvent[viser.GuiSliderHandle[float]]) -> None:
            if event.client is not None:
                self._moved = time.monotonic()
                self._set.add(i)

        return slider

    def read(self, q: NDArray[np.float64]) -> None:
        """Show joint positions (n,), or begin anew with those that somebody has set and the others."""
        if self._moved is None:
            for slider, value in zip(self._sliders, q.tolist(), strict=True):
                within = min(max(value, slider.min), slider.max)
                if not abs(slider.value - within) <= SEEN:
                    slider.value = within
        elif time.monotonic() - self._moved > PATIENCE:
            given = {i: float(self._sliders[i].value) for i in tuple(self._set)}
            self._moved = None
            self._set.clear()
            if all(np.isfinite(list(given.values()))):
                self._begin_at([given.get(i, float(value)) for i, value in enumerate(q)])


def limits(scenario: Scenario) -> list[tuple[float, float]]:
    """Between which positions each joint can be; a turn where there is no limit."""
    arm = scenario.arm
    given = arm.joint_limits
    rows = [(-np.pi, np.pi)] * arm.n if given is None else [tuple(row) for row in given]
    q0 = scenario.to_dict()["q0"]
    return [
        (
            float(low) if np.isfinite(low) else min(-np.pi, start - np.pi),
            float(high) if np.isfinite(high) else max(np.pi, start + np.pi),
        )
        for (low, high), start in zip(rows, q0, strict=True)
    ]
