"""What is drawn of a scenario on the page, and what is dragged of it: `shared`, and what differs in the
`plane` and in `space`.
"""

from __future__ import annotations

from vffnull.scenario import Scenario
from vffnull.viewer.scene.plane import PlaneScene, view
from vffnull.viewer.scene.shared import TRAIL, Camera, Dress, Scene
from vffnull.viewer.scene.space import SpaceScene

__all__ = ["TRAIL", "Camera", "Dress", "Scene", "kind_of", "view"]


def kind_of(scenario: Scenario) -> type[Scene]:
    """The class that draws a scenario."""
    return SpaceScene if scenario.arm.dimension == 3 else PlaneScene
