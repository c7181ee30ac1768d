"""What is drawn of a scenario on the page, and what is dragged of it: `shared`, and what differs in the
`plane` and in `space`.
"""

from __future__ import annotations

from vffnull.live.scene.camera import Camera, around
from vffnull.live.scene.looks import TRAIL, Dress
from vffnull.live.scene.plane import PlaneScene, view
from vffnull.live.scene.shared import Scene
from vffnull.live.scene.space import SpaceScene
from vffnull.model.scenario import Scenario

__all__ = ["TRAIL", "Camera", "Dress", "Scene", "around", "kind_of", "view"]


def kind_of(scenario: Scenario) -> type[Scene]:
    """The class that draws a scenario."""
    return SpaceScene if scenario.arm.dimension == 3 else PlaneScene
