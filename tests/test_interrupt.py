"""Ctrl-C and other signals: every long call answers, none loses what a handler raises, nothing panics."""

from __future__ import annotations

import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

from waiting import HANG

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")

PREPARE = """
import os, random, signal, sys, threading, time, traceback
import numpy as np
import vffnull as vff
from vffnull import _core

def arm_of(n): return vff.Arm.uniform(n, length=1.0 / n)
def disc(x, y): return {"shape": {"kind": "circle", "radius": 0.01}, "position": [x, y]}
def discs(count):
    return [disc(2.0 + 3.0 * np.cos(k), 3.0 * np.sin(k) * (1 + k / count)) for k in range(count)]
def scene(n=6, **more):
    q0 = [0.3] + [1.0 / n] * (n - 1)
    return {"duration": 1e5, "q0": q0, "arm": {"lengths": [1.0] * n, "masses": 1.0},
            "reference": {"kind": "setpoint", "point": [0.5 * n, 0.3]},
            "simulation": {"record_every": 10**6}, **more}
def bent(n): return np.full(n, 1.0 / n)
"""

# Each of these takes minutes if it is left alone.
LONG = {
    "simulate": ("", "_core.run(scene())"),
    "simulate of heavy steps": (
        "",
        "_core.run(scene(60, obstacles=discs(3000), "
        "controller={'avoidance': 'cbf', 'yielding': {'activation': 9.0}}))",
    ),
    "simulate_many": ("", "_core.run_many([scene()] * 3)"),
    "real_time": ("", "_core.real_time(scene(), 1000.0, 1e5)"),
    "real_time of heavy steps": (
        "s = scene(3000, controller={'self_collision': 'avoid'})",
        "_core.real_time(s, 1000.0, 1e5)",
    ),
    "feasibility": ("", "_core.feasibility(scene(40, obstacles=discs(40)) | {'duration': 1e3})"),
    "Simulation.step": (
        "simulation = vff.Simulation(scene(simulation={'control_every': 10**8}))",
        "simulation.step()",
    ),
    "mass_matrix": ("arm, q = arm_of(6000), bent(6000)", "arm.mass_matrix(q)"),
    "coriolis_matrix": ("arm, q = arm_of(6000), bent(6000)", "arm.coriolis_matrix(q, q)"),
    "extended_jacobian": ("arm, q = arm_of(3000), bent(3000)", "arm.extended_jacobian(q, q)"),
    "distances": (
        "arm = arm_of(50); q = np.tile(bent(50), (1000, 1)); world = discs(20)",
        "any(_core.distances(arm, q, q, world) is None for _ in range(10**6))",
    ),
    "torque": (
        "c = vff.Controller(arm_of(3000), {'avoidance': 'cbf'}); q = bent(3000)",
        "c.torque(q, 50 * q, [0.3, 0.3], obstacles=[disc(0.2, 0.2)])",
    ),
    "Episodes": (
        "e = _core.Episodes(scene() | {'duration': 1e4}, {'period': 1e3}, 8, 2, 0)",
        "e.step(np.zeros((8, 6)))",
    ),
    "Episodes on one thread": (
        "e = _core.Episodes(scene() | {'duration': 1e4}, {'period': 1e3}, 8, 1, 0)",
        "e.step(np.zeros((8, 6)))",
    ),
    "many new Episodes": ("", "_core.Episodes(scene(), {}, 100000, 2, 0)"),
    "a list without end": ("", "_core.check('arm', {'lengths': [[0.0] * 10**6] * 10**4})"),
}


def interrupted(setup: str, call: str) -> subprocess.CompletedProcess[str]:
    """Run a call in a process of its own and interrupt it, at a random moment once it is under way."""
    script = (
        PREPARE
        + textwrap.dedent(setup)
        + textwrap.dedent(f"""
        signal.signal(signal.SIGALRM, signal.default_int_handler)
        try:
            signal.setitimer(signal.ITIMER_REAL, 0.1 + 0.4 * random.random())
            {call}
            print("not heard")
        except KeyboardInterrupt:
            pass
        print("done")
        """)
    )
    command = [sys.executable, "-c", script]
    return subprocess.run(command, capture_output=True, text=True, timeout=HANG, check=False)


@pytest.mark.parametrize("name", LONG)
def test_long_calls_answer(name: str) -> None:
    """A call that takes minutes ends with what Ctrl-C raises."""
    setup, call = LONG[name]
    done = interrupted(setup, call)
    # A run that is interrupted is a result; its status says so.
    kept = "simulate" in name or "real_time" in name
    assert done.stdout.split("\n")[-2] == "done" and not done.stderr, done.stdout + done.stderr
    assert kept or "not heard" not in done.stdout, done.stdout


def test_interrupted_runs_say_so() -> None:
    """What there is of a run, of a batch and of a measurement, with the status."""
    setup = "statuses = []"
    for call in (
        "statuses.append(_core.run(scene())['status'])",
        "statuses.extend(r['status'] for r in _core.run_many([scene()] * 3))",
        "statuses.append(_core.real_time(scene(), 1000.0, 1e5)['status'])",
    ):
        done = interrupted(setup, call + "; print(set(statuses))")
        assert done.stdout == "{'interrupted'}\nnot heard\ndone\n", done.stdout + done.stderr


SHORT = {
    "run": "_core.run(scene() | {'duration': 0.005})",
    "run_many": "_core.run_many([scene() | {'duration': 0.005}] * 4)",
    "check": "_core.check('scenario', scene(obstacles=discs(40)) | {'duration': 1.0})",
    "controller": "vff.Controller(arm_of(6)).torque(bent(6), bent(6), [0.3, 0.3], obstacles=discs(4))",
    "kinematics": "arm_of(6).forward_kinematics(np.tile(bent(6), (2000, 1)))",
    "distances": "_core.distances(arm_of(6), bent(6), bent(6), discs(30))",
    "simulation": "vff.Simulation(scene()).step()",
    "real_time": "_core.real_time(scene(), 1000.0, 0.005)",
    "toml": "_core.parse_toml(_core.format_toml(scene(obstacles=discs(40))), 'x')",
}


@pytest.mark.parametrize("name", SHORT)
def test_no_signal_is_lost(name: str) -> None:
    """A loop of short calls ends each time with the exception of the handler, wherever it comes."""
    script = PREPARE + textwrap.dedent(f"""
    class Mine(BaseException): pass
    def handler(*_):
        global sent
        sent += 1
        raise Mine
    signal.signal(signal.SIGUSR1, handler)
    sent = heard = other = 0
    stop = threading.Event()
    def send():
        while not stop.is_set():
            time.sleep(0.02 * random.random())
            ready.wait()
            ready.clear()
            os.kill(os.getpid(), signal.SIGUSR1)
    ready = threading.Event()
    sender = threading.Thread(target=send, daemon=True)
    sender.start()
    while heard + other < 60:
        try:
            ready.set()
            while True:
                {SHORT[name]}
        except Mine:
            heard += 1
        except BaseException as error:
            other += 1
            print(type(error), error)
    stop.set()
    print(sent == heard, other)
    os._exit(0) if sys.stdout.flush() is None else None
    """)
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, timeout=HANG, check=False)
    assert done.stdout == "True 0\n" and not done.stderr, done.stdout + done.stderr


@pytest.mark.parametrize(
    "call", ["run(scene() | {'duration': 0.01})", "distances(arm_of(3), bent(3), bent(3), [])"]
)
def test_the_first_load_of_numpy(call: str) -> None:
    """Ctrl-C while NumPy is loaded for the first array: the user's, never lost, and the next call goes on.

    NumPy itself makes an ImportError of it at some moments and drops it at others, where it comes while it is
    being imported: it must be loaded where no signal handler runs.
    """
    script = PREPARE.replace("import numpy as np\n", "").replace("np.", "math.") + textwrap.dedent(f"""
    import math
    def bent(n): return [1.0 / n] * n
    def call(then):
        try:
            found = _core.{call}
            if isinstance(found, dict) and found["status"] == "interrupted":
                return "Ctrl-C" # in the run itself, of which the first part is the result
            then()
            return "nothing"
        except KeyboardInterrupt:
            return "Ctrl-C"
    signal.signal(signal.SIGALRM, signal.default_int_handler)
    assert "numpy" not in sys.modules
    signal.setitimer(signal.ITIMER_REAL, float(sys.argv[1]))
    print(call(lambda: time.sleep({HANG})), call(lambda: None))
    """)
    for k in range(24):
        # The last ones come when NumPy is there.
        command = [sys.executable, "-c", script, str(0.001 + 0.01 * k)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=HANG, check=False)
        assert done.stdout == "Ctrl-C nothing\n" and not done.stderr, done.stdout + done.stderr


def test_numpy_is_loaded_while_the_interpreter_ends() -> None:
    """What starts no threads any more gets its arrays; what cannot be loaded is the importer's error."""
    script = PREPARE.replace("import numpy as np\n", "") + textwrap.dedent("""
    import atexit
    atexit.register(lambda: print(arm_of(3).mass_matrix([0.1] * 3).shape))
    sys.modules["numpy"] = None
    for _ in range(2):
        try:
            arm_of(3).mass_matrix([0.1] * 3)
        except ModuleNotFoundError as error:
            print(error)
    del sys.modules["numpy"]
    """)
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=HANG, check=False
    )
    refused = "import of numpy halted; None in sys.modules\n"
    assert done.stdout == 2 * refused + "(3, 3)\n" and not done.stderr, done.stdout + done.stderr


def test_a_simulation_goes_on_after_an_interruption() -> None:
    """Interrupted between two plant steps, it finishes its control period next time: nothing is lost."""
    script = PREPARE + textwrap.dedent("""
    signal.signal(signal.SIGALRM, signal.default_int_handler)
    whole, parts = (vff.Simulation(scene(simulation={"control_every": 200000})) for _ in range(2))
    expected = whole.step()
    interruptions = 0
    while parts.state.t < expected.t:
        try:
            signal.setitimer(signal.ITIMER_REAL, 0.15)
            parts.step()
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        except KeyboardInterrupt:
            interruptions += 1
    print(parts.state.t == expected.t, (parts.state.q == expected.q).all(), interruptions > 0)
    """)
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, timeout=HANG, check=False)
    assert done.stdout == "True True True\n", done.stdout + done.stderr


def test_a_handler_cannot_lock_itself_out() -> None:
    """A signal handler that uses the simulation it has interrupted gets an error."""
    script = PREPARE + textwrap.dedent("""
    from vffnull.errors import InputError
    simulation = vff.Simulation(scene(simulation={"control_every": 300000}))
    told = []
    def handler(*_):
        try:
            simulation.step()
        except InputError as error:
            told.append(str(error))
    signal.signal(signal.SIGALRM, handler)
    signal.setitimer(signal.ITIMER_REAL, 0.1)
    while not told:
        simulation.step()
    print(told[0], simulation.state.t > 0)
    """)
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, capture_output=True, text=True, timeout=HANG, check=False)
    assert done.stdout.startswith("simulation: in use") and done.stdout.endswith("True\n"), done.stderr


DROPPED = """
import signal, weakref
class Thing: pass
def interrupt(*_): signal.raise_signal(signal.SIGINT)
def call():
    thing = Thing()
    kept = weakref.ref(thing, interrupt)
    del thing
    return "a result"
"""


@pytest.mark.parametrize("heard", [False, True])
def test_what_python_drops_is_raised_in_the_end(heard: bool) -> None:
    """Python itself drops what a callback of a weak reference raises; `heard` does not."""
    code = (
        DROPPED
        + ("from vffnull._support.interrupts import heard\ncall = heard()(call)\n" if heard else "")
        + "try:\n    print(call())\nexcept KeyboardInterrupt:\n    print('raised')\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ("raised" if heard else "a result")


@pytest.mark.parametrize("late", [0.0, 3.0])
def test_what_python_drops_is_raised_again_while_the_work_goes_on(late: float) -> None:
    """Long work is not waited for; but tidying up after an interrupt is not interrupted again, and nothing
    comes when all is over, however long a busy machine takes to raise it."""
    code = (
        DROPPED
        + f"""
import time, _thread
from vffnull._support.interrupts import AGAIN, heard
raise_now = _thread.interrupt_main
def interrupt_main():
    time.sleep({late} * AGAIN)
    raise_now()
_thread.interrupt_main = interrupt_main
def work(until):
    call()
    while time.monotonic() < until:
        time.sleep(0.01)
    return "a result"
def tidy(until):
    try:
        signal.raise_signal(signal.SIGINT)
    finally:
        time.sleep(3 * AGAIN)
        print("tidied up")
for each in (work, tidy):
    try:
        print(heard()(each)(time.monotonic() + {HANG}))
    except KeyboardInterrupt:
        print("raised")
time.sleep(5 * AGAIN)  # nothing comes later
"""
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=HANG
    )
    assert done.stdout.split("\n") == ["raised", "tidied up", "raised", ""]


@pytest.mark.parametrize("heard", [False, True])
def test_an_interrupted_import_begins_anew(heard: bool, tmp_path: Path) -> None:
    """Of a package that was interrupted parts remain, which do not fit the new one; `heard` forgets them."""
    package = tmp_path / "whole"
    package.mkdir()
    (package / "__init__.py").write_text("registry = []\nimport whole.part\nimport whole.late\n")
    (package / "part.py").write_text("import whole\nwhole.registry.append('part')\n")
    (package / "late.py").write_text(
        "import signal, os\nif os.environ.pop('FIRST', ''): signal.raise_signal(2)\n"
    )
    code = f"""
import os, sys
sys.path.insert(0, {str(tmp_path)!r})
from vffnull._support.interrupts import heard
def call():
    import whole
    return whole.registry
{"call = heard()(call)" if heard else ""}
os.environ["FIRST"] = "yes"
try:
    call()
except KeyboardInterrupt:
    print(call())
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ("['part']" if heard else "[]")


def test_other_handlers_and_threads_stay_as_they_are() -> None:
    """A handler that raises nothing is asked and comes back; in another thread nothing is changed."""
    code = """
import signal, threading
from vffnull._support.interrupts import heard
seen = []
def mine(*_): seen.append("asked")
signal.signal(signal.SIGINT, mine)
@heard()
def call():
    signal.raise_signal(signal.SIGINT)
    return signal.getsignal(signal.SIGINT) is mine
assert call() is False and seen == ["asked"] and signal.getsignal(signal.SIGINT) is mine
found = []
thread = threading.Thread(target=lambda: found.append(heard()(lambda: signal.getsignal(signal.SIGINT))()))
thread.start(); thread.join()
assert found == [mine]
signal.signal(signal.SIGINT, signal.SIG_IGN)
assert heard()(lambda: 1)() == 1
"""
    subprocess.run([sys.executable, "-c", code], check=True)


# What an installer writes, after the line by which it reaches the command; the test then knows when that is.
SCRIPT = """
import sys
from vffnull_command import main
print("here", file=sys.stderr, flush=True)
sys.exit(main())
"""


@pytest.mark.parametrize("delay", [0, 5, 10, 20, 30, 50, 75, 100, 150, 200, 300, 500, 800])
@pytest.mark.parametrize("words", [["--version"], ["run", "panda-sweep"]], ids=lambda words: words[0])
def test_a_command_hears_ctrl_c_from_its_first_moment_on(words: list[str], delay: int) -> None:
    """While it is imported, at work, or on its way out: it ends by the signal, or says 130, or is done."""
    process = subprocess.Popen(
        [sys.executable, "-c", SCRIPT, *words],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    with process:
        assert process.stderr is not None and process.stderr.readline() == "here\n"
        time.sleep(delay / 1000)  # whatever it does then
        process.send_signal(signal.SIGINT)
        _, complaint = process.communicate(timeout=HANG)
    assert "Traceback" not in complaint and "KeyboardInterrupt" not in complaint
    assert process.returncode in (130, -signal.SIGINT, 0)


def test_nothing_is_imported_before_a_command_hears_ctrl_c() -> None:
    """An import cannot be interrupted silently: neither NumPy nor the package itself comes before."""
    script = "import sys, vffnull_command; print(*sys.modules, flush=True); input()"
    pipe = subprocess.PIPE
    with subprocess.Popen([sys.executable, "-c", script], stdin=pipe, stdout=pipe, stderr=pipe) as process:
        assert process.stdout is not None
        assert {b"vffnull", b"numpy", b"click", b"typing"} & set(process.stdout.readline().split()) == set()
        process.send_signal(signal.SIGINT)
        _, complaint = process.communicate(timeout=HANG)
    assert (process.returncode, complaint) == (-signal.SIGINT, b"")


def test_a_command_in_the_background_does_not_hear_ctrl_c() -> None:
    """A shell's job that it started with SIGINT ignored goes on ignoring it."""
    process = subprocess.Popen(
        ["sh", "-c", 'trap "" INT; exec "$0" "$@"', sys.executable, "-c", SCRIPT, "--version"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    with process:
        assert process.stderr is not None and process.stderr.readline() == "here\n"
        process.send_signal(signal.SIGINT)
        said, _ = process.communicate(timeout=HANG)
    assert process.returncode == 0 and "vffnull" in said
