"""What the controls may ask of the page."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

from vffnull.model.scenario import Scenario


class Page(Protocol):
    """What the controls may ask of the page."""

    @property
    def scenario(self) -> Scenario:
        """What runs."""

    @property
    def notes(self) -> list[str]:
        """What is odd about what runs, in sentences."""

    @property
    def views(self) -> Mapping[str, str]:
        """How one may look at the scene, each with a sentence on how things are dragged then."""

    @property
    def view(self) -> str:
        """How one does."""

    def open(self, scenario: Scenario) -> None:
        """Run another scenario."""

    def configure(self, controller: Mapping[str, Any]) -> None:
        """Take over settings of the controller."""

    def pause(self, paused: bool) -> None:
        """Stand still, or go on."""

    def look_back(self, seconds: float) -> None:
        """Show what was drawn so many seconds ago; 0 is the present."""

    def replay(self) -> None:
        """Show again what was drawn."""

    def reset(self, as_filed: bool = False) -> None:
        """Go back to the start with the present settings, or with those of the scenario."""

    def begin_at(self, q: list[float]) -> None:
        """Begin anew from other joint positions (n,)."""

    def present(self) -> Scenario:
        """What runs, as a scenario: the present settings, and the obstacles where they have been put."""

    def show_ghost(self, on: bool) -> None:
        """Run the arm without projection beside."""

    def show_plan(self, on: bool) -> None:
        """Draw the arm where the plan has it."""

    def plan(self) -> None:
        """Plan a motion to where the target is, and follow it when it is found."""

    def add_obstacle(self) -> None:
        """Put a disc, or a ball, where there is room."""

    def remove_obstacle(self) -> None:
        """Take away the last obstacle."""

    def start_recording(self) -> Path:
        """Begin to record."""

    def stop_recording(self) -> tuple[Path, int] | None:
        """End a recording; its file and the number of its rows."""

    def look(self, view: str) -> None:
        """Look at the scene in another way."""

    def cast_shadows(self, on: bool) -> None:
        """Whether bodies in space cast shadows."""

    @property
    def has_meshes(self) -> bool:
        """Whether it is known how the arm looks."""

    def show_meshes(self, on: bool) -> None:
        """Draw the arm as it looks, or as the bodies that are measured."""
