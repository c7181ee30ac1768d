"""The same scenario gives the same bits, in one thread or many; a long run keeps its memory."""

from __future__ import annotations

import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import vffnull as vff
from waiting import HANG

SCENES = ["sweep-through", "paper-1", "crowd", "on-path"]
SHORT = {"duration": 0.5}


def bits(result: vff.Result) -> list[bytes]:
    arrays = [values.tobytes() for values in (result.t, *result.recorded().values())]
    return [*arrays, repr(dict(result.metrics)).encode(), result.message.encode()]


@pytest.fixture(scope="module")
def alone() -> list[list[bytes]]:
    """One after the other in the main thread."""
    return [bits(vff.simulate(scene, SHORT)) for scene in SCENES]


def test_again(alone: list[list[bytes]]) -> None:
    """Once more in this process."""
    assert [bits(vff.simulate(scene, SHORT)) for scene in SCENES] == alone


def test_threads_of_python(alone: list[list[bytes]]) -> None:
    """Four threads that call `simulate` at the same time, three times over."""
    with ThreadPoolExecutor(4) as pool:
        results = list(pool.map(lambda scene: bits(vff.simulate(scene, SHORT)), SCENES * 3))
    assert results == alone * 3


@pytest.mark.parametrize("threads", [1, 2, 4])
def test_threads_of_the_core(threads: int, alone: list[list[bytes]]) -> None:
    """`simulate_many` on any number of threads."""
    assert [bits(result) for result in vff.simulate_many(SCENES * 3, SHORT, threads=threads)] == alone * 3


def test_another_process(alone: list[list[bytes]]) -> None:
    """Addresses and hash seeds differ there."""
    code = (
        "import hashlib, vffnull as vff; r = vff.simulate('crowd', {'duration': 0.5}); "
        "print(hashlib.sha256(r.q.tobytes() + r.tau.tobytes()).hexdigest())"
    )
    import hashlib

    here = vff.simulate("crowd", SHORT)
    expected = hashlib.sha256(here.q.tobytes() + here.tau.tobytes()).hexdigest()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=HANG)
    assert done.stdout.strip() == expected, done.stderr


def test_threads_share_a_controller() -> None:
    """Threads that call one controller take turns, and each gets the torque of its own state."""
    arm, rng = vff.Arm.uniform(6), np.random.default_rng(7)
    settings = vff.ControlSettings(field=vff.Field.khatib(0.5, 0.6))
    discs = [vff.Obstacle.circle([1.5 + 0.1 * i, 2.3], radius=0.15) for i in range(4)]
    states = rng.uniform(-1.0, 1.0, (4, 6))
    expected = [
        vff.Controller(arm, settings).torque(q, 0.1 * q, [4.0, 1.0], obstacles=[disc])
        for q, disc in zip(states, discs, strict=True)
    ]
    shared, wrong, start = vff.Controller(arm, settings), [], threading.Barrier(4)

    def call(i: int) -> None:
        start.wait()
        for _ in range(2000):
            # Lists and arrays, whose conversion gives the GIL away.
            q = states[i] if _ % 2 else states[i].tolist()
            tau = shared.torque(q, 0.1 * states[i], [4.0, 1.0], obstacles=[discs[i]])
            if not np.array_equal(tau, expected[i]):
                wrong.append(i)

    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(4) as pool:
            list(pool.map(call, range(4)))
    finally:
        sys.setswitchinterval(interval)
    assert wrong == []


def test_an_obstacle_may_call_its_controller() -> None:
    """What is read in a call may be Python code, and that code may use the same controller."""
    controller = vff.Controller(vff.Arm.uniform(3), {})
    disc = vff.Obstacle.circle([1.0, 1.0], radius=0.1)

    class Curious:
        def to_dict(self) -> dict[str, object]:
            controller.torque([0.1, 0.2, 0.3], [0.0] * 3, [2.0, 1.0])
            return disc.to_dict()

    given = {"q": [0.3, 0.2, 0.1], "dq": [0.0] * 3, "x_ref": [2.0, 1.0]}
    assert np.array_equal(
        controller.torque(**given, obstacles=[Curious()]), controller.torque(**given, obstacles=[disc])
    )


TEN_MILLION = """
import resource
import numpy  # now: the arrays of the result would bring it in at the end
import vffnull as vff

scenario = vff.Scenario(
    arm=vff.Arm.uniform(2), q0=[0.4, 0.8], duration=1e4,
    controller={"field": vff.Field.khatib(0.1, 0.5)},
    reference={"kind": "circle", "center": [1.2, 0.8], "radius": 0.2, "angular_velocity": 1.0},
    obstacles=[vff.Obstacle.circle([0.6, -0.6], radius=0.1)],
    simulation={"dt": 1e-3, "integrator": "semi_implicit_euler", "record_every": 1000},
)
page, early = resource.getpagesize(), []

def resident():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * page

def watch(t, duration):
    if t > 0.1 * duration and not early:
        early.append(resident())

result = vff.simulate(scenario, progress=watch)
rows = sum(values.nbytes for values in (result.t, *result.recorded().values()))
print(result.status, len(result.t), rows, resident() - early[0])
"""


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_ten_million_steps_without_growth() -> None:
    """From a tenth of the run to its end the process grows by the rows that it records, and no more.

    A single number kept per step would be 72 MB. The 2 MB are for the interpreter's own arrays.
    """
    done = subprocess.run([sys.executable, "-c", TEN_MILLION], capture_output=True, text=True, timeout=HANG)
    status, rows, recorded, growth = done.stdout.split()
    assert (status, rows) == ("completed", "10001"), done.stderr
    assert int(growth) < int(recorded) + 2_000_000
