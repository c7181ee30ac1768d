"""Where the controls and the plots are, and what makes room in a narrow window."""

from __future__ import annotations

import viser

from vffnull.live.plots import Plots
from vffnull.live.scene.camera import UPRIGHT

CONTROLS, PLOTS = 340, 330
"""How wide they are [pixels]."""


def docked(server: viser.ViserServer) -> tuple[Plots, viser.PanelHandle]:
    """The controls on the right, to be filled, and on the left the plots with their panel."""
    gui = server.gui
    gui.set_panel_label("vffnull live")
    gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(0, 84, 140))
    gui.main_panel.dock_right()
    gui.main_panel.set_width(CONTROLS)
    panel = gui.add_panel()
    with panel.add_tab("Live plots"):
        plots = Plots(server)
    panel.dock_left()
    panel.set_width(PLOTS)
    return plots, panel


def makes_room(client: viser.ClientHandle, panel: viser.PanelHandle, aspect: float) -> bool:
    """Fold a panel away for somebody where it leaves a picture of this aspect that stands upright: the window
    is narrow. On a phone, where panels lie below the picture, it is folded anyway.
    """
    if aspect >= UPRIGHT:
        return False
    # What is placed by somebody's own panel is placed in that window alone: viser has no other way.
    place = getattr(panel, "_placement_uuid", None)
    if place is not None:
        own = client.gui.main_panel
        own._placement_uuid = place
        own.minimize()
    return True
