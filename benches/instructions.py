"""Count the instructions of one step of the closed loop, which do not depend on how busy the machine is.

    python benches/instructions.py             fails if a step costs 5 % more than the baseline
    python benches/instructions.py --update    writes the baseline, benches/instructions.json, anew
    python benches/instructions.py --profile   writes where the instructions go into docs/speed.md
    python benches/instructions.py --observer  fails if an observer adds more than 15 % to a step

Two runs of different length under callgrind; their difference leaves only steps. Needs valgrind.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

import vffnull as vff
from report import rows, write_section
from scene import DT, panda, scene

ROOT = Path(__file__).resolve().parents[1]
BASELINE = ROOT / "benches" / "instructions.json"
SHORT, LONG = 200, 1200  # steps of the two runs
SCENES = {
    "n = 6": scene(6, LONG * DT),
    "n = 100": scene(100, LONG * DT),
    "Panda, pose": panda(LONG * DT),
    "Panda, position": panda(LONG * DT, "position"),
}
ALLOWED = 0.05  # relative growth
OBSERVED = 0.15  # what an observer that rejects may add
OBSERVER = {"observer": {}, "touch": {"task": "reject", "null_space": "reject"}}
REACTION = {"observer": {"detection": {}}, "touch": {"reaction": {"stop": 30.0}}}
SHOWN = 0.01  # the profile names what takes a larger share than this

# glibc chooses its memcpy and sine by the processor; without these features every x86-64 takes the same.
PLAIN = "glibc.cpu.hwcaps=" + ",".join(
    f"-{feature}"
    for feature in ("AVX", "AVX2", "AVX512F", "AVX512VL", "FMA", "ERMS", "FSRM", "AVX_Fast_Unaligned_Load")
)


def build() -> Path:
    """The program `steps`, compiled as releases are, from the core of the Python module if that is there."""
    cargo = ["cargo", "build", "--quiet", "--release", "--locked", "--workspace", "--bin", "steps"]
    told = subprocess.run([*cargo, "--message-format=json"], cwd=ROOT, check=True, stdout=subprocess.PIPE)
    artefacts = (json.loads(line) for line in told.stdout.splitlines())
    (program,) = (a["executable"] for a in artefacts if a.get("target", {}).get("name") == "steps")
    return Path(program)


def callgrind(program: Path, document: dict[str, Any], steps: int) -> Counter[str]:
    """Instructions of every function in a run of so many steps, inlined ones within their callers."""
    with tempfile.TemporaryDirectory() as directory:
        scenario, profile = Path(directory) / "scene.toml", Path(directory) / "profile"
        # As long a record in both runs, so that they allocate the same.
        vff.Scenario.from_dict(document).save(scenario)
        command = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={profile}", "--dump-line=no"]
        command += ["--compress-strings=no", "--compress-pos=no", str(program), str(scenario), str(steps)]
        done = subprocess.run(
            command, env=os.environ | {"GLIBC_TUNABLES": PLAIN}, capture_output=True, text=True, check=False
        )
        if done.returncode:
            sys.exit(f"{' '.join(command)} failed:\n{done.stderr}")
        return self_costs(profile.read_text(encoding="utf-8"))


def self_costs(profile: str) -> Counter[str]:
    """What callgrind's file says of each function, without what it calls."""
    costs: Counter[str] = Counter()
    function, called, total = "", False, 0
    for line in profile.splitlines():
        if line.startswith("fn="):
            function = line[3:]
        elif line.startswith("calls="):
            called = True  # the next line is the cost of the callee
        elif line[:1].isdigit():
            if not called:
                costs[function] += int(line.split()[1])
            called = False
        elif line.startswith("summary:"):
            total = int(line.split()[1])
    if costs.total() != total:
        sys.exit(f"the profile's lines add up to {costs.total()}, its summary says {total}")
    return costs


def per_step(program: Path, document: dict[str, Any]) -> dict[str, float]:
    """Instructions of one step by function, the most expensive first."""
    costs = callgrind(program, document, LONG)
    costs.subtract(callgrind(program, document, SHORT))
    return {function: cost / (LONG - SHORT) for function, cost in costs.most_common() if cost}


def compare(counts: dict[str, float]) -> bool:
    """Print the counts beside the baseline; whether none has grown by more than is allowed."""
    baseline = json.loads(BASELINE.read_text(encoding="utf-8"))
    fine = True
    for n, count in counts.items():
        before = baseline["instructions"][n]
        growth = round(count / before - 1, 4) + 0.0  # never -0.0
        fine &= growth <= ALLOWED
        print(f"{n:>15}: {count:8.0f} instructions a step, baseline {before:8.0f}, {growth:+.1%}")
        if growth < -ALLOWED:
            print("         cheaper than the baseline: keep that with --update")
    if not fine:
        print(
            f"A step may cost {ALLOWED:.0%} more than the baseline. If it has to, say why in the commit that"
        )
        print("changes the baseline: python benches/instructions.py --update")
        if compiler() != baseline["compiler"]:
            print(f"The baseline was made by {baseline['compiler']}, this is {compiler()}.")
    return fine


def compiler() -> str:
    return subprocess.run(["rustc", "--version"], check=True, capture_output=True, text=True).stdout.strip()


def update(counts: dict[str, float]) -> None:
    content = {"compiler": compiler(), "instructions": {n: round(count) for n, count in counts.items()}}
    BASELINE.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    print(f"{BASELINE.relative_to(ROOT)}: {content['instructions']}")


def observer(program: Path) -> bool:
    """Print what knowing of touch adds to a step; whether the observer alone adds as little as it may."""
    fine = True
    for name, plain in SCENES.items():
        controller = plain["controller"]
        before, observed, reacting = (
            sum(per_step(program, plain | {"controller": controller | touch}).values())
            for touch in ({}, OBSERVER, REACTION)
        )
        alone, both = observed / before - 1, reacting / before - 1
        fine &= alone <= OBSERVED
        print(f"{name:>15}: {before:8.0f} instructions a step, {alone:+.1%} with an observer that rejects,")
        print(f"{'':>15}  {both:+.1%} with one that detects contacts and a reaction to them")
    if not fine:
        print(f"An observer may add {OBSERVED:.0%} to a step.")
    return fine


def short(function: str) -> str:
    """A function without modules, traits and type parameters: `PlanarState::refresh`."""
    name = function.split("@")[0]
    trait = re.match(r"<(.+?) as .+>::(\w+)$", name)  # <Type as Trait>::function
    if trait:
        name = f"{trait[1]}::{trait[2]}"
    name = re.sub(r"<impl ([^<>]+)>", r"\1", name)
    while re.search("<[^<>]*>", name):
        name = re.sub(r"(::)?<[^<>]*>", "", name)
    *_, owner, last = "", *name.split("::")
    return f"{owner}::{last}" if owner[:1].isupper() else last


def profile(costs: dict[str, dict[str, float]]) -> str:
    """A table of the functions that take more than `SHOWN` of a step of any arm."""
    by_name: dict[str, dict[str, float]] = {n: defaultdict(float) for n in costs}
    for n, by_function in costs.items():
        for function, cost in by_function.items():
            by_name[n][short(function)] += cost
    totals = {n: sum(counts.values()) for n, counts in by_name.items()}
    every: dict[str, float] = defaultdict(float)
    for n, by_function in by_name.items():
        for function, cost in by_function.items():
            every[function] = max(every[function], cost / totals[n])
    named = sorted(every, key=lambda function: -every[function])
    named = [f for f in named if any(counts[f] > SHOWN * totals[n] for n, counts in by_name.items())]
    rest = {n: totals[n] - sum(counts[f] for f in named) for n, counts in by_name.items()}

    def row(name: str, counts: dict[str, float]) -> list[str]:
        return [name, *(c for n, k in counts.items() for c in (f"{k:.0f}", f"{k / totals[n]:.1%}"))]

    head = ["function", *(column for n in costs for column in (n, "share"))]
    body = [row(f"`{f}`", {n: counts[f] for n, counts in by_name.items()}) for f in named]
    table = rows(head, [*body, row("everything else", rest), row("one step", totals)])
    return (
        "Instructions of one step of the closed loop, record and metrics included, by the function that\n"
        "executes them. What the compiler has inlined counts for its caller.\n\n"
        f"{table}\n{compiler()}, callgrind.\n"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    does = parser.add_mutually_exclusive_group()
    does.add_argument("--update", action="store_true", help="write the baseline anew")
    does.add_argument("--observer", action="store_true", help="fail if an observer adds too much")
    does.add_argument("--profile", action="store_true", help="write the profile into docs/speed.md")
    arguments = parser.parse_args()
    if shutil.which("valgrind") is None:
        sys.exit("valgrind is not installed; on Debian and Ubuntu: sudo apt-get install valgrind")
    program = build()
    if arguments.observer:
        sys.exit(not observer(program))
    costs = {name: per_step(program, document) for name, document in SCENES.items()}
    counts = {n: sum(by_function.values()) for n, by_function in costs.items()}
    if arguments.update:
        update(counts)
    elif arguments.profile:
        write_section(ROOT / "docs" / "speed.md", "profile", profile(costs))
    elif not compare(counts):
        sys.exit(1)


if __name__ == "__main__":
    main()
