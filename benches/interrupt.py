"""How the public functions answer Ctrl-C: `python benches/interrupt.py`.

Every call that can take longer than 0.2 s is interrupted at random moments, in a process of its own. A try
ends in one of these ways: `raised` KeyboardInterrupt; `kept`, a result that says it was interrupted; `over`,
the call had ended before; `lost`, the call ended as if nothing had been; `other` exceptions; `crash` of the
process. The last three are faults. The times are from the signal to the end of the call; other programs
make them longer.
"""

from __future__ import annotations

import argparse
import json
import signal
import subprocess
import sys
import tempfile
import textwrap
from collections import Counter
from pathlib import Path

LIMIT = 0.2  # s, to answer within, beside one control step
LONGEST = 600.0  # s: a process that has not come to its end by then never will

PREPARE = """
import json, math, os, random, signal, sys, tempfile, threading, time, warnings
from pathlib import Path
import numpy as np
import vffnull as vff
from vffnull import _core
from vffnull._support import errors
warnings.simplefilter("ignore")
os.chdir(tempfile.mkdtemp(dir=sys.argv[4]))

def arm_of(n): return vff.Arm.uniform(n, length=1.0 / n)
def bent(n): return np.full(n, 1.0 / n)
def rows(k, n): return np.tile(bent(n), (k, 1))
def disc(x, y): return {"shape": {"kind": "circle", "radius": 0.01}, "position": [x, y]}
def discs(count):
    return [disc(2.0 + 3.0 * math.cos(k), 3.0 * math.sin(k) * (1 + k / count)) for k in range(count)]
def scene(n=6, **more):
    q0 = [0.3] + [1.0 / n] * (n - 1)
    return {"duration": 1e5, "q0": q0, "arm": {"lengths": [1.0] * n, "masses": 1.0},
            "reference": {"kind": "setpoint", "point": [0.5 * n, 0.3]},
            "simulation": {"record_every": 10**6}, **more}
def cloud(count):
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (count, 3))
    return vff.Obstacle.points(points, 0.01, position=[1.4, 0.0, 0.5])
def panda(**more):
    long = {"simulation.record_every": 10**6, "duration": 1e5}
    return vff.Scenario.load("panda-sweep").replace(**long, **more)
"""

# A name: what is prepared, and the call. Files are as large as those of long runs.
CALLS = {
    "simulate": ("", "vff.simulate(scene())"),
    "simulate, an explicit form of 60 links": (
        "s = scene(60, controller={'formulation': 'extended_jacobian'})",
        "vff.simulate(s)",
    ),
    "simulate, cbf and 3000 discs": (
        "c = {'avoidance': 'cbf', 'yielding': {'activation': 9.0}}\n"
        "s = scene(60, obstacles=discs(3000), controller=c)",
        "vff.simulate(s)",
    ),
    "simulate, look-ahead": (
        "s = vff.Scenario.load('crowd').replace(**{'controller.avoidance': 'cbf', "
        "'controller.yielding': {'preview': {'horizon': 2.0, 'candidates': 64}}, 'duration': 1e4})",
        "vff.simulate(s)",
    ),
    "simulate, a Panda and a cloud": (
        "s = panda(**{'obstacles': [cloud(50000)], 'controller.avoidance': 'cbf'})",
        "vff.simulate(s)",
    ),
    "simulate, a Panda that senses": (
        "s = panda(**{'perception.kind': 'range'})",
        "vff.simulate(s)",
    ),
    "simulate, MuJoCo's plant": (
        "s = scene(simulation={'record_every': 1000})",
        "vff.simulate(s, plant='mujoco')",
    ),
    "simulate_many": ("", "vff.simulate_many([scene()] * 3)"),
    "simulate_many, short runs": (
        "s = vff.Scenario.load('sweep-through').replace(duration=0.5)",
        "vff.simulate_many([s] * 400, record=False)",
    ),
    "realtime": ("", "vff.realtime(scene(), rate=1000.0, seconds=1e4)"),
    "drive": (
        "from vffnull.robots.simulated import SimulatedRobot\ns = panda(obstacles=[])\n"
        "c = vff.Controller(s.arm, s['controller'])",
        "d = vff.drive(SimulatedRobot(s), c); d.wait(); d.report",
    ),
    "feasibility": (
        "s = vff.Scenario.from_dict(scene(40, obstacles=discs(40)) | {'duration': 1e3})",
        "vff.feasibility(s)",
    ),
    "evaluate": ("", "vff.evaluate(['null-space field'], category='crowd', n=6, count=4)"),
    "evaluate, in space": (
        "",
        "vff.evaluate(['null-space field'], category='crowd', count=4, space=True, arm='panda')",
    ),
    "evaluate.loop_times": (
        "from vffnull.run.evaluate import loop_times",
        "loop_times(['null-space field'], n=6, count=100)",
    ),
    "Simulation": ("d = scene(obstacles=discs(50000)) | {'duration': 0.1}", "vff.Simulation(d)"),
    "Simulation.step": ("m = vff.Simulation(scene(simulation={'control_every': 10**8}))", "m.step()"),
    "Controller.torque": (
        "c = vff.Controller(arm_of(3000), {'avoidance': 'cbf'}); q = bent(3000)",
        "c.torque(q, 50 * q, [0.3, 0.3], obstacles=[disc(0.2, 0.2)])",
    ),
    "Controller.terms": (
        "c = vff.Controller(arm_of(2000), {'formulation': 'extended_jacobian'}); q = bent(2000)",
        "c.terms(q, 50 * q, [0.3, 0.3])",
    ),
    "Arm.forward_kinematics": ("a, q = arm_of(1000), rows(20000, 1000)", "a.forward_kinematics(q)"),
    "Arm.jacobian": ("a, q = arm_of(10**5), bent(10**5)", "[a.jacobian(q) for _ in range(1000)]"),
    "Arm.mass_matrix": ("a, q = arm_of(6000), bent(6000)", "a.mass_matrix(q)"),
    "Arm.coriolis_matrix": ("a, q = arm_of(6000), bent(6000)", "a.coriolis_matrix(q, q)"),
    "Arm.extended_jacobian": ("a, q = arm_of(3000), bent(3000)", "a.extended_jacobian(q, q)"),
    "Arm.inverse_dynamics": (
        "a, q = arm_of(10**5), bent(10**5)",
        "[a.inverse_dynamics(q, q, q) for _ in range(1000)]",
    ),
    "Arm.forward_dynamics": (
        "a, q = arm_of(10**5), bent(10**5)",
        "[a.forward_dynamics(q, q, q) for _ in range(1000)]",
    ),
    "distances": ("a, q, w = arm_of(50), rows(4000, 50), discs(20)", "vff.distances(a, q, q, w)"),
    "distances, in space": (
        "a, w = vff.Arm.named('panda'), [cloud(50000)]; q = np.zeros((100000, 7))",
        "vff.distances(a, q, q, w)",
    ),
    "Arm.from_urdf": (
        "Path('long.urdf').write_text(arm_of(2000).to_urdf())",
        "vff.Arm.from_urdf('long.urdf')",
    ),
    "gymnasium reset and step": (
        "import gymnasium\ne = gymnasium.make_vec('vffnull.engines.gym:vffnull/Reach-v0', num_envs=2000, "
        "scenario='sweep-through')\na = e.action_space.sample()",
        "e.reset(seed=1); [e.step(a) for _ in range(1000)]",
    ),
    "Scenario.load": (
        "vff.Scenario.load('paper-1').replace(duration=0.1, obstacles=discs(50000)).save('large.toml')",
        "vff.Scenario.load('large.toml')",
    ),
    "Scenario.from_dict": (
        "d = scene(obstacles=discs(200000)) | {'duration': 0.1}",
        "vff.Scenario.from_dict(d)",
    ),
    "Scenario.from_dict, a cloud": (
        "d = panda().to_dict() | {'obstacles': [cloud(50000).to_dict()] * 4}",
        "vff.Scenario.from_dict(d)",
    ),
    "Scenario.replace": (
        "s = vff.Scenario.load('paper-1')",
        "s.replace(duration=0.1, obstacles=discs(100000))",
    ),
    "Scenario.save": (
        "s = vff.Scenario.load('paper-1').replace(duration=0.1, obstacles=discs(50000))",
        "s.save('large.toml')",
    ),
    **{
        f"Result.save, {kind}": (
            "r = vff.simulate('sweep-through', {'duration': 60.0})",
            f"r.save('run.{kind}')",
        )
        for kind in ("npz", "csv", "parquet", "arrow", "mcap")
    },
    **{
        f"Result.load, {kind}": (
            f"vff.simulate('sweep-through', {{'duration': 60.0}}).save('run.{kind}')",
            f"vff.Result.load('run.{kind}')",
        )
        for kind in ("npz", "csv", "parquet", "arrow")
    },
    "Result.to_pandas": ("r = vff.simulate('sweep-through', {'duration': 600.0})", "r.to_pandas()"),
    "Result.plot": ("r = vff.simulate('sweep-through')", "r.plot('figures')"),
    "Result.animate": ("r = vff.simulate('sweep-through')", "r.animate('run.gif')"),
    "Result.animate, MP4": ("r = vff.simulate('sweep-through')", "r.animate('run.mp4')"),
    "Result.report": ("r = vff.simulate('sweep-through')", "r.report('run.html')"),
    "compare": (
        "r = {f'{g}': vff.simulate('sweep-through', {'controller.field.gain': g}) for g in (0.1, 0.5)}",
        "vff.compare(r, 'runs.html')",
    ),
    "metrics_table": (
        "r = vff.simulate_many('sweep-through', [{'duration': 0.01}] * 20000, record=False)",
        "vff.metrics_table(r)",
    ),
}

TRIES = """
import ctypes
from ctypes import c_byte, c_int, c_void_p
class Event(ctypes.Structure):  # Linux's sigevent: a timer that sends SIGINT to one thread
    _fields_ = [
        ("value", c_void_p), ("signal", c_int), ("kind", c_int), ("thread", c_int), ("rest", c_byte * 44)
    ]
class Times(ctypes.Structure):
    _fields_ = [("interval", ctypes.c_long * 2), ("value", ctypes.c_long * 2)]
libc, timer = ctypes.CDLL(None), c_void_p()
# To the main thread, as Ctrl-C in a terminal; a timer of the process would prefer the thread that computes.
event = Event(None, signal.SIGINT, 4, threading.get_native_id())
assert libc.timer_create(1, ctypes.byref(event), ctypes.byref(timer)) == 0
def alarm(delay):
    seconds = int(delay)
    times = Times((0, 0), (seconds, int(1e9 * (delay - seconds))))
    assert libc.timer_settime(timer, 0, ctypes.byref(times), None) == 0
def handler(*_):
    global fired
    fired = True
    raise KeyboardInterrupt

def interrupted(result):
    several = result if isinstance(result, list) else [result]
    return any(getattr(each, "status", None) == "interrupted" for each in several)

signal.signal(signal.SIGINT, handler)
name, tries, seed = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
random.seed(seed)
within = 1.0  # s, of the random moment; shortened to what the call takes
print("ready", flush=True)
for _ in range(tries):
    fired, delay = False, within * random.random() + 1e-4
    due = time.perf_counter() + delay
    begun = time.perf_counter()
    how = result = None
    try:
        alarm(delay)
        result = call()
        end = time.perf_counter()
        alarm(0.0)
        if not fired:
            how, within = "over", min(within, 1.1 * (end - begun))
        else:
            how = "kept" if interrupted(result) else "lost"
    except KeyboardInterrupt:
        end = time.perf_counter()
        how = "raised"
    except BaseException as error:
        end = time.perf_counter()
        how = f"other: {type(error).__name__}: {error}"[:300]
    alarm(0.0)
    if not fired and how == "raised":
        how = "other: an interrupt that nobody has sent"
    del result
    print(json.dumps([how, end - due if fired else None]), flush=True)
# An interrupt within code that Python executes from a string, as a namedtuple's, counts as one that
# nobody has caught until it executes another: without this the process would end by a signal.
exec("")
"""


def tried(name: str, tries: int, seed: int, folder: Path) -> list[tuple[str, float | None]]:
    """The ends of so many tries; a process that has crashed is followed by another."""
    setup, call = CALLS[name]
    script = PREPARE + setup + "\ndef call():\n" + textwrap.indent(returned(call), "    ") + TRIES
    found: list[tuple[str, float | None]] = []
    while len(found) < tries:
        command = [
            sys.executable,
            "-c",
            script,
            name,
            str(tries - len(found)),
            str(seed + len(found)),
            folder,
        ]
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            timeout=LONGEST,
            check=False,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        )
        first, *lines = done.stdout.splitlines() or [""]
        if first != "ready":
            raise SystemExit(f"{name} could not be prepared:\n{done.stderr}")
        found += [(how, late) for how, late in map(json.loads, lines)]
        if done.returncode:
            found.append((f"crash: {done.returncode} {done.stderr[-300:]}", None))
        elif done.stderr:
            # Of an exception in a finaliser Python tells and goes on: no fault, but to be seen.
            how = "told" if done.stderr.startswith("Exception ignored in") else "other"
            found[-1] = (f"{how}: {done.stderr[-300:]}", None)
    return found


def returned(call: str) -> str:
    """The call as the end of a function."""
    *before, last = call.split("; ")
    return "\n".join([*before, f"return {last}"])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("words", nargs="*", help="only calls whose names contain one of these")
    parser.add_argument("--tries", type=int, default=2000, help="of all calls together")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    names = [name for name in CALLS if not given.words or any(word in name for word in given.words)]
    each = -(-given.tries // len(names))
    ends: Counter[str] = Counter()
    faults, late = [], 0
    print("| call | raised | kept | over | median [ms] | 95 % [ms] | longest [ms] |")
    print("|---|--:|--:|--:|--:|--:|--:|")
    with tempfile.TemporaryDirectory() as folder:
        for name in names:
            found = tried(name, each, given.seed, Path(folder))
            count = Counter(how.split(":")[0] for how, _ in found)
            ends += count
            faults += [
                f"{name}: {how}" for how, _ in found if how.split(":")[0] not in ("raised", "kept", "over")
            ]
            times = sorted(1e3 * time for _, time in found if time is not None)
            late += sum(time > 1e3 * LIMIT for time in times)
            shown = [times[int(p * (len(times) - 1))] for p in (0.5, 0.95, 1.0)] if times else []
            cells = [*(count[how] for how in ("raised", "kept", "over")), *(f"{time:.0f}" for time in shown)]
            print(f"| {name} | {' | '.join(map(str, cells))} |", flush=True)
    for fault in sorted(set(faults)):
        print(fault)
    total = ", ".join(f"{how} {number}" for how, number in sorted(ends.items()))
    print(f"{sum(ends.values())} tries of {len(names)} calls: {total}")
    print(f"{late} answered after more than {LIMIT} s")
    return any(": told: " not in fault for fault in faults)


if __name__ == "__main__":
    sys.exit(main())
