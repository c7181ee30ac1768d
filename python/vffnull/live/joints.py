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
        self._names: tuple[str, ...] = ()
        self._moved: float | None = None

    def show(self, scenario: Scenario) -> None:
        """Sliders for the joints of a scenario's arm; those of before, if it is the same one."""
        self._moved = None
        arm = scenario.arm
        names = tuple(arm.joint_names) if arm.dimension == 3 else tuple(f"q{i + 1}" for i in range(arm.n))
        if names == self._names:
            return
        self._names = names
        for slider in self._sliders:
            slider.remove()
        self._sliders.clear()
        slides = [each["kind"] == "prismatic" for each in arm.to_dict().get("joints", [])] or [False] * arm.n
        with self._folder:
            for name, (low, high), is_slide in zip(names, limits(scenario), slides, strict=True):
                self._sliders.append(self._add(name, low, high, "m" if is_slide else "rad"))

    def _add(self, name: str, low: float, high: float, unit: str) -> viser.GuiSliderHandle[float]:
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

        return slider

    def read(self, q: NDArray[np.float64]) -> None:
        """Show joint positions (n,), or begin anew from those that somebody has set."""
        if self._moved is None:
            for slider, value in zip(self._sliders, q.tolist(), strict=True):
                within = min(max(value, slider.min), slider.max)
                if abs(slider.value - within) > SEEN:
                    slider.value = within
        elif time.monotonic() - self._moved > PATIENCE:
            self._moved = None
            self._begin_at([float(slider.value) for slider in self._sliders])


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
