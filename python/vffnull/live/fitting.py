"""The whole picture before somebody who comes, and again whenever the room for it changes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import viser

from vffnull.live.layout import makes_room
from vffnull.live.quiet import uncover
from vffnull.live.scene.camera import Camera, aspect_of


class Fitting:
    """Moves the camera of somebody until they move it by hand.

    Parameters
    ----------
    client : viser.ClientHandle
        Who has come.
    panel : viser.PanelHandle
        What is folded away where the window is narrow.
    before : viser.InitialCameraConfig
        Where their camera begins.
    wanted : Callable
        Where it is to be in a picture of this aspect, and how near to that is there [m].
    seen : Callable
        What is called when they have a picture.
    """

    def __init__(
        self,
        client: viser.ClientHandle,
        panel: viser.PanelHandle,
        before: viser.InitialCameraConfig,
        wanted: Callable[[float], tuple[Camera, float]],
        seen: Callable[[], None],
    ) -> None:
        self._client, self._panel, self._before = client, panel, before
        self._wanted, self._seen = wanted, seen
        self._fitted, self._settled, self._roomy = 0.0, False, False

    def update(self, camera: viser.CameraHandle) -> None:
        """Take in where their camera is."""
        if (aspect := aspect_of(camera)) is None:
            return
        # Once: somebody may want the panel back.
        self._roomy = self._roomy or makes_room(self._client, self._panel, aspect)
        late = np.allclose(camera.position, self._before.position, atol=1e-3)
        if self._settled and not late and abs(aspect - self._fitted) < 0.02:
            return  # moved by hand
        wanted, near = self._wanted(aspect)
        self._settled = abs(aspect - self._fitted) < 0.02 and bool(
            np.allclose(camera.position, wanted.position, atol=near)
        )
        if self._settled:  # it has taken the camera: there is a picture
            self._seen()
            uncover(self._client)
        else:  # or has taken the one to begin with, maybe after this one
            self._fitted = aspect
            wanted.move(self._client)
