"""Settings that hold for every test."""
# ruff: noqa: E402

from __future__ import annotations

import os
import signal
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Any

# A job in the background is started with Ctrl-C ignored, and what it starts inherits that.
signal.signal(signal.SIGINT, signal.default_int_handler)
# Matrices of ten rows and columns: threads would only get in each other's way. Before NumPy is imported.
for library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")
os.environ["MPLBACKEND"] = "Agg"

import pytest
from hypothesis import HealthCheck, settings

import vffnull as vff

# Random on purpose: a failure prints the blob that repeats it. No deadlines: the machine is shared.
settings.register_profile(
    "vffnull",
    deadline=None,
    print_blob=True,
    max_examples=100,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
settings.register_profile("soak", settings.get_profile("vffnull"), max_examples=1000)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "vffnull"))


@pytest.hookimpl(wrapper=True, optionalhook=True)
def pytest_xdist_auto_num_workers() -> Generator[None, int, int]:
    """Of `-n auto`: one more than there are processors, as tests of what runs in real time mostly wait."""
    return (yield) + 1


@pytest.fixture
def page(tmp_path: Path) -> Iterator[Any]:
    """The live page of an arm in space, without a browser."""
    pytest.importorskip("viser")
    page = vff.live("panda-sweep", open_browser=False, block=False, record_to=tmp_path)
    yield page
    page.stop()


@pytest.fixture(scope="session")
def paper_1() -> vff.Result:
    """The project's main scenario, run once."""
    return vff.simulate("paper-1")


@pytest.fixture(scope="session")
def short() -> vff.Result:
    """A short run with an obstacle, for everything that is done with results."""
    return vff.simulate("sweep-through", overrides={"duration": 0.5, "simulation.record_every": 10})
