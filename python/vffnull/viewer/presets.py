"""What the live page can show: scenarios of the plane so far."""

from __future__ import annotations

from vffnull import _core
from vffnull._arm import in_the_plane, is_spatial
from vffnull.scenario import Scenario, read, scenarios

__all__ = ["check", "presets"]


def presets() -> tuple[str, ...]:
    """The bundled scenarios that can be chosen on the page."""
    return tuple(name for name in scenarios() if not is_spatial(_core.parse_toml(read(name), name)["arm"]))


def check(scenario: Scenario) -> None:
    """Refuse what the page cannot show.

    Raises
    ------
    vffnull.errors.ScenarioError
        If the scenario is in space.
    """
    in_the_plane(
        scenario.to_dict(),
        "the live page shows the plane so far; `vffnull animate` and `vffnull report` show it",
    )
