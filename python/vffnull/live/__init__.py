"""The live page: a scenario in real time in the browser, with obstacles and a target to be dragged."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from vffnull._support.errors import InputError, InputTypeError
from vffnull._support.extras import extra

if TYPE_CHECKING:
    from vffnull.arms._meshes import Packages
    from vffnull.live.page import LivePage
    from vffnull.model.scenario import ScenarioLike

__all__ = ["live"]


def live(
    scenario: ScenarioLike = "swing",
    *,
    port: int | None = None,
    open_browser: bool = True,
    block: bool = True,
    record_to: str | os.PathLike[str] = ".",
    allow_origins: Iterable[str] = (),
    meshes: str | os.PathLike[str] | None = None,
    packages: Packages | None = None,
) -> LivePage:
    """Run a scenario in real time on a page of this machine.

    A thread computes plant and law at 1 kHz against the wall clock; nothing of it is slowed down by the page.
    Obstacles and the target are dragged with the mouse, in the plane and in space. Between two messages of
    the browser they move smoothly, and the field gets their exact velocity. Time begins when whoever opens
    the page first sees the picture. Where something goes away for ever, an obstacle along a line or a
    reference that is a polynomial, the page pauses at the duration of the scenario, once, and goes on at the
    press of a button or a drag; everything else runs on.

    Parameters
    ----------
    scenario : str, path, Scenario or dict, optional
        What to start with; a bundled name, a TOML file or a scenario.
    port : int, optional
        Where the page is on 127.0.0.1; by default the first free one from 8080 on.
    open_browser : bool, optional
        Show the page in the browser of the system.
    block : bool, optional
        Stay until Ctrl-C. Otherwise return at once; the page lives until its `LivePage.stop`.
    record_to : path, optional
        The folder for recordings.
    allow_origins : iterable of str, optional
        Origins from which the page may be used besides its own address on this machine, such as
        ``"https://hub.example.org"`` behind a proxy or ``"http://localhost:9000"`` through a tunnel.
        Requests of all others are refused.
    meshes : str or path, optional
        A URDF of the arm, whose visual geometry is drawn in the place of the shapes that are measured
        against obstacles; a box of the page shows those. Needs the extra ``vffnull[meshes]``.
    packages : path, list of paths, or dict, optional
        Folders where the URDF's meshes are searched, as in `Arm.from_urdf`.

    Returns
    -------
    LivePage
        The page; stopped if it has blocked.

    Raises
    ------
    vffnull.errors.InputError
        If the port is out of range or taken, or if the folder, an origin or `meshes` cannot be used.
    vffnull.errors.ScenarioError
        If the scenario cannot be run.
    ImportError
        Without the extra ``vffnull[viewer]``, or ``vffnull[meshes]`` where there are meshes.

    Examples
    --------
    >>> page = vff.live("crowd", open_browser=False, block=False)  # doctest: +SKIP
    >>> page.url  # doctest: +SKIP
    'http://127.0.0.1:8080'
    >>> page.stop()  # doctest: +SKIP
    """
    if port is not None and (isinstance(port, bool) or not isinstance(port, int)):
        raise InputTypeError(f"port: expected a whole number, got {type(port).__name__}")
    from vffnull._support.files import writable
    from vffnull.live.ports import free

    port = free(port)
    folder = Path(record_to)
    if not folder.is_dir():
        raise InputError(f"record_to: there is no folder {folder}")
    writable(folder)
    extra("viser", "viewer")
    from vffnull.live.guard import origins
    from vffnull.live.page import LivePage
    from vffnull.run.simulate import prepare

    ready = prepare(scenario)
    dress = None
    if meshes is not None:
        from vffnull.arms._visual import surfaces

        if ready.arm.dimension == 2:
            raise InputError("meshes: an arm in the plane has none")
        dress = surfaces(ready.arm.to_dict(), meshes, packages)
    page = LivePage(ready, port, folder, origins(allow_origins), dress)
    if block:
        print(f"{page.url}; Ctrl-C ends it")
    try:
        if open_browser:
            import webbrowser

            webbrowser.open(page.url)
        if block:
            page.wait()
    except KeyboardInterrupt:
        pass
    finally:
        if block:
            page.stop()
    return page
