"""Runs every command and every Python block of README.md and docs/, each with what its page says to install.

    python .ci/documented.py            all of them
    python .ci/documented.py WORD...    those whose place or text contains a word, such as README or tutorials
    python .ci/documented.py --share 6  a sixth of the pages, other ones for every state of the files

What has to be installed is read where a reader reads it. A shell line `pip install ".[extra]" && …` names it
itself. For everything else it is what the page has said: `pip install …` above a block, in README since the
last heading, and in the same paragraph for a command between backticks. The cells of a tutorial are one
program. Each set of packages gets a virtual environment of its own, with the wheel that is built once, and
nothing else. Shell commands run in a copy of the repository, Python in an empty folder. What would run until
somebody ends it is ended when it is ready.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from urllib.request import urlopen

ROOT = Path(__file__).resolve().parents[1]
LIMIT = 1500.0  # s: only for what hangs
FENCE = re.compile(r"^(?P<fence>```+)(?P<language>[^\n]*)\n(?P<code>.*?)^(?P=fence)[ \t]*$", re.M | re.S)
INLINE = re.compile(r"`((?:vffnull|python|cargo|sphinx-build|pip install) [^`\n]+)`")
PARAGRAPH = re.compile(r"\n\n|\n- |\n\| ")
INSTALL = re.compile(r"pip install ((?:\"[^\"]+\"|[\w.-]+)(?: (?:\"[^\"]+\"|[\w-]+))*)")
PYTHON, SHELL = ("python", "{code-cell} ipython3"), ("sh",)
# What is there to be read.
SHOWN = ("", "toml", "text", "json", "cmake", "c", "cpp", "rust", "math")
SHOWN += ("{toctree}", "{button-ref}", "{rst-class}", "{literalinclude}", "{warning}")

# What begins like this ends when somebody ends it; and what it prints when it is ready.
UNTIL_STOPPED = {"vffnull live": r"is running at (?P<url>http://\S+);"}
# Needs another machine; and what .ci/check runs: every benchmark in short, the core's documentation and its
# examples.
ELSEWHERE = ("ssh ", "cargo bench --bench ", "cargo doc ", "cargo test --doc ")
# What takes long, and the same in short: the documentation without what .ci/check executes in it; of the
# whole workspace what is compiled so already.
SHORTER = {
    "sphinx-build -b html docs docs/_build/html": "sphinx-build -W -q -b html -D nb_execution_mode=off"
    " -D plot_gallery=0 docs docs/_build/html",
    "cargo bench && python benches/table.py": "cargo bench --workspace --locked --bench closed_loop"
    " --bench operators -- --quick && python benches/table.py",
    "cargo build -p vff-c --release": "cargo build --workspace --release --locked",
    "python benches/drive.py": "python benches/drive.py --quick",
    "python benches/friction.py": "python benches/friction.py --quick",
    "python benches/futures.py": "python benches/futures.py 2",
    "python benches/gym.py": "python benches/gym.py 8 20",
    "python benches/gym.py 64 500 panda-sweep": "python benches/gym.py 8 50 panda-sweep",
    "python benches/interrupt.py": "python benches/interrupt.py --tries 21",
    "python benches/live.py": "python benches/live.py panda-cup --seconds 3",
    "python benches/many.py": "python benches/many.py --scenarios 4 --duration 1 --repeat 1",
    "python benches/order.py": "python benches/order.py 2",
    "python benches/peers/run.py": "python benches/peers/run.py --quick",
    "python benches/sizes.py": "python benches/sizes.py --share 0.3",
    "python benches/studies.py": "python benches/studies.py --quick",
    "python benches/studies.py --long 1000000": "python benches/studies.py --long 10000",
    "vffnull realtime panda-sweep --rate 1000 --seconds 600 --priority 80 --core 3": (
        "vffnull realtime panda-sweep --rate 1000 --seconds 2 --priority 80 --core 0"
    ),
    "python benches/peers/space.py": "python benches/peers/space.py --quick",
    "python benches/peers/space.py --arms iiwa14 ur5e": (
        "python benches/peers/space.py --arms iiwa14 ur5e --quick"
    ),
    "python benches/peers/space.py --sampling": "python benches/peers/space.py --sampling --quick",
    "vffnull evaluate": "vffnull evaluate --count 1",
}
# What is not run, and why.
LEFT_OUT = {
    ".ci/check": "runs this script's neighbours, and ran before it",
    "python benches/instructions.py": "is a step of .ci/check",
    "python benches/instructions.py --update": "is for those who mean to change the baseline",
    "python benches/instructions.py --observer": "is a step of .ci/check",
    "python benches/instructions.py --profile": "as the step of .ci/check, with a table",
    "python docs/evaluate.py": "runs for a quarter of an hour; `vffnull evaluate` does the same in short",
    "python docs/evaluate.py --space": "as the one of the plane",
    "python docs/evaluate_goals.py": "runs for half an hour; the tests evaluate in short",
    "python docs/emulate.py FOLDER": "runs for half an hour; the tests do so in short",
    "python docs/evaluate_perception.py": "runs for half an hour; the tests see the bundled scene",
    "python docs/evaluate_rate.py 20": "runs for minutes; the tests do so on bundled scenes",
    "python docs/evaluate_self_motion.py": "runs for minutes; the tests do so on a bundled scene",
    "python docs/evaluate_held_up.py": "runs for minutes; the tests do so with a wall and with a board",
    "python benches/peers/space.py --tune": "runs for half an hour; the tests tune in short",
    "python benches/calls.py": "needs the programs that the commands of docs/c.md build",
    "python tests/test_engines.py": "is a file of tests, which pytest runs",
    "vffnull realtime": "names the command; it needs a scenario",
    "vffnull study": "names the command; it needs a study",
    "vffnull run": "names the command; it needs a scenario",
    "vffnull plan": "names the command; it needs a scenario",
    "vffnull perceive": "names the command; it needs a recording",
    "vffnull perceive --calibrate": "names the command; it needs a recording",
    "python -m timeit": "names the command; the next line of its table is run",
}


# What runs now, and whether that was ended from outside.
begun: set[int] = set()  # process groups
ending, ended = threading.Lock(), threading.Event()


@dataclass(frozen=True)
class Task:
    """A command or a program, where it stands, and what it needs."""

    place: str
    code: str
    shell: bool
    needs: frozenset[str]
    inline: bool = False  # between backticks in a sentence


def packages(text: str) -> frozenset[str]:
    """What a text tells to install: extras of ours as `.[extra]`, others by name."""
    found: set[str] = set()
    for words in INSTALL.findall(text):
        for word in shlex.split(words):
            inside = re.fullmatch(r"\.\[([\w,]+)\]", word)
            if inside:
                found |= {f".[{each}]" for each in inside[1].split(",")}
            elif word != "." and not word.startswith("-"):
                found.add(word)
    return frozenset(found)


def tasks(page: Path) -> Iterator[Task]:
    """Everything on a page that is to be run."""
    text = page.read_text(encoding="utf-8")
    name = str(page.relative_to(ROOT))
    cells: list[tuple[int, str]] = []
    prose = FENCE.sub(lambda block: re.sub(r"[^\n]", " ", block[0]), text)  # of the same length
    for block in FENCE.finditer(text):
        line = text.count("\n", 0, block.start("code")) + 1
        language = block["language"].strip()
        heading = max(text.rfind("\n## ", 0, block.start()), 0) if page.name == "README.md" else 0
        above = packages(text[heading : block.start()])
        if language in SHELL:
            for i, command in enumerate(block["code"].splitlines()):
                if command.strip() and not command.startswith("#"):
                    yield from line_of_shell(f"{name}:{line + i}", command, above)
                    above |= packages(command)
        elif language == "python":
            yield Task(f"{name}:{line}", block["code"], False, above)
        elif language in PYTHON:
            code = "".join(row for row in block["code"].splitlines(True) if not row.startswith(":tags:"))
            cells.append((line, code))
        elif not any(language == each or (each and language.startswith(each)) for each in SHOWN):
            raise SystemExit(
                f"{name}:{line}: what is a block of `{language}`? Commands are ```sh, programs ```python"
            )
    for mention in INLINE.finditer(prose):
        if mention[1].startswith("pip install") and "&&" not in mention[1]:
            continue  # it tells what others need
        place = f"{name}:{text.count(chr(10), 0, mention.start()) + 1}"
        begin = max((each.start() for each in PARAGRAPH.finditer(text, 0, mention.start())), default=0)
        end = PARAGRAPH.search(text, mention.end())
        around = packages(text[begin : end.start() if end else None])
        yield from line_of_shell(place, mention[1], around, inline=True)
    if cells:
        last = text.rfind("```{code-cell}")
        script, line = "", 1
        for start, code in cells:
            script += "\n" * (start - line) + code  # so that a traceback has the page's line numbers
            line = start + code.count("\n")
        yield Task(name, script, False, packages(text[:last]))


def line_of_shell(place: str, command: str, above: frozenset[str], inline: bool = False) -> Iterator[Task]:
    """A line as a task: what it installs becomes a need of it."""
    command = command.split("  #")[0].strip()
    parts = [part.strip() for part in command.split("&&")]
    installs = [part for part in parts if part.startswith("pip install")]
    rest = " && ".join(part for part in parts if part not in installs)
    needs = packages(" && ".join(installs)) if installs else above
    yield Task(place, rest or "vffnull --version", True, needs, inline)


def environment(folder: Path, wheel: Path, needs: frozenset[str]) -> dict[str, str]:
    """A new virtual environment with the wheel and what is needed, as the variables that make it active."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder], check=True)
    extras = ",".join(sorted(each[2:-1] for each in needs if each.startswith(".[")))
    others = sorted(each for each in needs if not each.startswith(".["))
    ours = f"{wheel}[{extras}]" if extras else str(wheel)
    pip = [sys.executable, "-m", "pip", "--python", str(folder / "bin" / "python"), "install"]
    options = ["--quiet", "--disable-pip-version-check", "--no-compile"]
    done = subprocess.run([*pip, *options, ours, *others], capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"pip install {ours} {' '.join(others)}\n{done.stdout}{done.stderr}")
    return os.environ | {
        "PATH": f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}",
        "VIRTUAL_ENV": str(folder),
        "CARGO_TARGET_DIR": str(ROOT / "target"),  # compiled already
        "VFFNULL_CARGO": "build --workspace --release --locked",  # as that was, with all features
        "MPLBACKEND": "Agg",
    }


def checkout(folder: Path) -> Path:
    """A copy of what git knows of here, with the dates, so that cargo compiles nothing again."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True, text=True)
    for name in filter(None, listed.stdout.split("\0")):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, folder / name)
    return folder


def run(task: Task, variables: dict[str, str], folder: Path) -> str | None:
    """Run a task; what went wrong, or None."""
    if task.shell:
        short = SHORTER.get(task.code, task.code)
        command = ["bash", "-euo", "pipefail", "-c", short]
    else:
        page = ROOT / task.place.partition(":")[0]
        for beside in page.parent.glob("*.toml") if page.parent != ROOT else ():
            shutil.copy(beside, folder)  # what the page shows, as where the site is built
        program = folder / "program.py"
        program.write_text(task.code, encoding="utf-8")
        command = ["python", str(program)]
    written = folder / ".output"
    with written.open("w", encoding="utf-8") as output, ending:
        if ended.is_set():
            return "not begun"
        process = subprocess.Popen(
            command,
            cwd=folder,
            env=variables,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        begun.add(process.pid)
        ready = (told for begin, told in UNTIL_STOPPED.items() if task.code.startswith(begin))
    problem = wait(process, written, next(ready, None))
    begun.discard(process.pid)
    return f"{problem}\n{written.read_text(encoding='utf-8')[-4000:]}" if problem else None


def end_all(*_: object) -> None:
    """Leave nothing behind where somebody ends this program."""
    ended.set()
    with ending:
        for group in begun:
            with suppress(ProcessLookupError):
                os.killpg(group, signal.SIGKILL)
    raise SystemExit(143)


def wait(process: subprocess.Popen[bytes], written: Path, ready: str | None) -> str | None:
    """Wait for the end; or until it is ready and answers, and end it by Ctrl-C."""
    if ready is None:
        try:
            code = process.wait(LIMIT)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            return f"hangs: nothing after {LIMIT:g} s"
        return f"exit code {code}" if code else None
    end = time.monotonic() + LIMIT
    while not (found := re.search(ready, written.read_text(encoding="utf-8"))):
        if process.poll() is not None or time.monotonic() > end:
            return f"ended before it was ready, exit code {process.poll()}"
        time.sleep(0.1)
    try:
        with urlopen(found["url"], timeout=LIMIT) as page:
            length = len(page.read())
    except OSError as error:
        return f"{found['url']} does not answer: {error}"
    finally:
        os.killpg(process.pid, signal.SIGINT)
        code = process.wait(LIMIT)
    return None if length and code in (0, 130) else f"a page of {length} bytes, and the exit code {code}"


def run_all(
    needs: frozenset[str], todo: list[Task], wheel: Path, base: Path
) -> list[tuple[Task, str | None, float]]:
    """Make an environment and run its tasks one after the other; each with its problem and its seconds."""
    folder = Path(tempfile.mkdtemp(dir=base))
    try:
        variables = environment(folder / "environment", wheel, needs)
    except RuntimeError as error:
        return [(task, str(error), 0.0) for task in todo]
    found, copy = [], None
    for i, task in enumerate(todo):
        if task.shell:
            copy = copy or checkout(folder / "repository")
        start = time.monotonic()
        where = copy if task.shell and copy else folder / str(i)
        where.mkdir(exist_ok=True)
        problem = run(task, variables, where)
        found.append((task, problem, time.monotonic() - start))
        print(f"{'FAILED' if problem else 'ok':6} {found[-1][2]:6.1f} s  {label(task)}", flush=True)
    return found


def label(task: Task) -> str:
    """Name a task by its place and text."""
    what = task.code if task.shell else "Python"
    return f"{task.place}: {what}" + (f"  [{', '.join(sorted(task.needs))}]" if task.needs else "")


def share(pages: list[Path], parts: int) -> list[Path]:
    """One of so many parts of the pages with about as many tasks each, by the state of the files."""
    command = ["git", "rev-parse", "HEAD^{tree}"]
    tree = subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True).stdout
    part = int(tree[:8] or "0", 16) % parts  # a source distribution has no history
    counts = {page: sum(not is_left_out(task) for task in tasks(page)) for page in pages}
    shares: list[list[Path]] = [[] for _ in range(parts)]
    for page in sorted(pages, key=lambda page: -counts[page]):
        min(shares, key=lambda each: sum(counts[page] for page in each)).append(page)
    return [page for page in pages if page in shares[part]]


def is_left_out(task: Task) -> bool:
    """Whether it is not for here, or needs something that `.ci/check` does without and tells of."""
    without = os.environ.get("VFFNULL_LEFT_OUT", "").split()
    lacks = "valgrind" in without and "benches/instructions.py" in task.code
    return task.code in LEFT_OUT or task.code.startswith(ELSEWHERE) or lacks


def main(words: list[str]) -> int:
    """Run what the words choose; 1 if anything failed."""
    parts = int(words[1]) if words[:1] == ["--share"] else 0
    words = [] if parts else words
    signal.signal(signal.SIGTERM, end_all)
    signal.signal(signal.SIGINT, end_all)  # also where it was started in the background
    pages = [
        ROOT / "README.md",
        *sorted((ROOT / "docs").glob("*.md")),
        *sorted((ROOT / "docs").glob("tutorials/*.md")),
    ]
    every = [task for page in pages for task in tasks(page)]
    stale = [each for each in (*SHORTER, *LEFT_OUT) if each not in {task.code for task in every}]
    # A mention of what has a block of its own, perhaps with a file of the reader's.
    written = tuple(task.code for task in every if task.shell and not task.inline)
    chosen: dict[tuple[str, frozenset[str]], Task] = {}
    shown = share(pages, parts) if parts else pages
    for task in (task for page in shown for task in tasks(page)):
        if is_left_out(task):
            continue
        if task.inline and task.code.startswith(written):
            continue
        if not words or any(word in label(task) for word in words):
            chosen.setdefault((task.code, task.needs), task)  # once, wherever else it is said
    groups: dict[frozenset[str], list[Task]] = defaultdict(list)
    for task in chosen.values():
        groups[task.needs].append(task)
    began = time.monotonic()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as directory:
        base = Path(directory)
        pip = [
            sys.executable,
            "-m",
            "pip",
            "wheel",
            "--quiet",
            "--no-deps",
            "--wheel-dir",
            str(base),
            str(ROOT),
        ]
        subprocess.run(pip, check=True)
        (wheel,) = base.glob("*.whl")
        print(f"{time.monotonic() - began:6.1f} s for the wheel; {len(groups)} environments", flush=True)
        largest = sorted(groups, key=lambda needs: -len(needs))
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            done = [
                each
                for part in pool.map(lambda n: run_all(n, groups[n], wheel, base), largest)
                for each in part
            ]
    failed = [(task, problem) for task, problem, _ in done if problem]
    for task, problem in failed:
        print(f"\n=== {label(task)}\n{problem}")
    for each in stale:
        print(f"\n{each}: named in .ci/documented.py, but on no page")
    print(f"\n{time.monotonic() - began:.0f} s in all")
    print(f"{len(done) - len(failed)} passed, {len(failed) + len(stale)} failed")
    return bool(failed or stale)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
