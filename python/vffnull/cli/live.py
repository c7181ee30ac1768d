"""The command ``live``."""

from __future__ import annotations

from pathlib import Path

import click

from vffnull.cli.common import INTERRUPTED, complete_scenario, prepared, set_option
from vffnull.live import live as open_page
from vffnull.live.ports import free

__all__ = ["live"]


@click.command()
@click.argument("scenario", default="swing", shell_complete=complete_scenario)
@click.option(
    "--port", type=int, help="Where the page is on 127.0.0.1; default: the first free one from 8080 on."
)
@click.option("--no-browser", is_flag=True, help="Print the address instead of opening it.")
@click.option(
    "--record-to",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path(),
    metavar="DIR",
    help="Folder for recordings; default: here.",
)
@click.option(
    "--allow-origin",
    "origins",
    multiple=True,
    metavar="ORIGIN",
    help="Another origin that may use the page, such as http://localhost:9000; may be repeated.",
)
@click.option(
    "--meshes",
    type=click.Path(path_type=Path, dir_okay=False, exists=True),
    metavar="URDF",
    help="Draw the arm with the visual geometry of its URDF.",
)
@click.option(
    "--package",
    "packages",
    type=click.Path(path_type=Path, file_okay=False, exists=True),
    multiple=True,
    metavar="DIR",
    help="Where the meshes are searched; may be repeated.",
)
@set_option
def live(
    scenario: str,
    port: int | None,
    no_browser: bool,
    record_to: Path,
    origins: tuple[str, ...],
    meshes: Path | None,
    packages: tuple[Path, ...],
    assignments: tuple[str, ...],
) -> int:
    """Run a scenario in real time on a page: drag obstacles and target, turn the knobs.

    \b
    vffnull live
    vffnull live panda-sweep
    vffnull live crowd --port 9000 --no-browser
    vffnull live mine.toml --set controller.projection=none

    The page is on this machine alone (127.0.0.1). Ctrl-C ends it. Needs pip install "vffnull[viewer]".
    """
    ready = prepared(scenario, assignments)
    port = free(port, "--port")
    page = open_page(
        ready,
        port=port,
        open_browser=not no_browser,
        block=False,
        record_to=record_to,
        allow_origins=origins,
        meshes=meshes,
        packages=packages or None,
    )
    click.echo(f"{ready.name or 'scenario'} is running at {page.url}; Ctrl-C ends it")
    try:
        page.wait()
    except KeyboardInterrupt:
        return INTERRUPTED
    finally:
        page.stop()
    return 0
