"""Where promises meet: bundled scenes, ways of giving way and options, alone and in pairs."""

from __future__ import annotations

import random

import pytest

import vffnull as vff
from matrix import OPTIONS, WAYS, combined, faults

pytestmark = pytest.mark.filterwarnings("ignore::vffnull.errors.ScenarioWarning")
SCENES = list(vff.scenarios())
PAIRS = 3


def sets_of_options(name: str, way: str) -> list[tuple[str, ...]]:
    """Every scene meets every option, and so does every way; the pairs are the same ones for ever."""
    first = SCENES.index(name) + list(WAYS).index(way)
    alone = [(option,) for k, option in enumerate(OPTIONS) if (k + first) % len(WAYS) == 0]
    draw = random.Random(f"{name}, {way}")
    return alone + [tuple(draw.sample(list(OPTIONS), 2)) for _ in range(PAIRS)]


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", SCENES)
def test_it_holds_or_is_refused(name: str, way: str) -> None:
    """Finite, within limits, no contact that an option alone has brought, told as it was."""
    alone = combined(name, way, ())
    assert isinstance(alone, vff.Scenario)
    without, found = vff.simulate(alone), []
    for options in sets_of_options(name, way):
        scene = combined(name, way, options)
        if isinstance(scene, str):
            known = [OPTIONS[each].refused for each in options]
            assert any(part is not None and part in scene for part in known), scene
        elif scene is not None:
            found += [(options, fault) for fault in faults(vff.simulate(scene), options, without)]
    assert found == []
