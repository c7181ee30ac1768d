"""Checks the crates of Cargo.lock against deny.toml: licences, duplicates, sources, and yanked versions.

And that tests and the Python module build what the core needs with the same features: otherwise it is
compiled twice.

cargo-deny does the same and knows security advisories too, but compiling it takes longer than all other
checks together, and its advisories come from a server that not every machine reaches. So it runs in the
release workflow, where it is ready-made, and this script runs in every check. Both read deny.toml.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path
from typing import Any

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parents[1]
REGISTRY = "registry+https://github.com/rust-lang/crates.io-index"
TERM = re.compile(r"\(|\)|[\w.+-]+")


def permitted(expression: str, allowed: set[str]) -> bool:
    """Whether an SPDX expression leaves a choice among the allowed licences. AND binds closer than OR."""
    words = TERM.findall(expression.replace("/", " OR "))  # the old way of writing OR

    def term() -> bool:
        word = words.pop(0)
        if word == "(":
            value = either()
            words.pop(0)  # the closing one
            return value
        if words[:1] == ["WITH"]:
            word = f"{word} WITH {words[1]}"
            del words[:2]
        return word in allowed

    def both() -> bool:
        value = term()
        while words[:1] == ["AND"]:
            words.pop(0)
            value &= term()
        return value

    def either() -> bool:
        value = both()
        while words[:1] == ["OR"]:
            words.pop(0)
            value |= both()
        return value

    return either()


def faults(packages: list[dict[str, Any]], rules: dict[str, Any]) -> list[str]:
    """One line for every crate that breaks a rule, and for every exception that is not needed."""
    found, versions = [], defaultdict(list)
    allowed, skipped = set(rules["licenses"]["allow"]), {each["crate"] for each in rules["bans"]["skip"]}
    exceptions = {each["crate"]: set(each["allow"]) for each in rules["licenses"].get("exceptions", ())}
    for package in packages:
        name = f"{package['name']} {package['version']}"
        versions[package["name"]].append(package["version"])
        licence = package["license"]
        if not licence:
            found.append(f"{name} names no licence")
        elif not permitted(licence, allowed | exceptions.get(package["name"], set())):
            found.append(f"{name} is under {licence}, which deny.toml does not allow")
        elif package["name"] in exceptions and permitted(licence, allowed):
            found.append(f"deny.toml makes an exception for {package['name']}, which needs none")
        if package["source"] not in (None, REGISTRY):
            found.append(f"{name} comes from {package['source']}")
    for name in sorted(exceptions.keys() - versions.keys()):
        found.append(f"deny.toml makes an exception for {name}, which is not there")
    several = {name: each for name, each in versions.items() if len(each) > 1}
    for name in sorted(several.keys() - skipped):
        found.append(f"{name} is there {len(several[name])} times: {', '.join(sorted(several[name]))}")
    for name in sorted(skipped - several.keys()):
        found.append(f"deny.toml skips {name}, which is there once at most")
    return found


def yanked(packages: list[dict[str, Any]], lock: Path) -> list[str] | None:
    """Versions that their authors have withdrawn, as cargo says; None where the registry is out of reach.

    cargo tells it of a package's lock file when it packs the package: here of one that depends on them all.
    """
    with tempfile.TemporaryDirectory() as directory:
        folder = Path(directory)
        (folder / "src").mkdir()
        (folder / "src" / "lib.rs").touch()
        shutil.copyfile(lock, folder / "Cargo.lock")
        wanted = [package for package in packages if package["source"] == REGISTRY]
        lines = [
            f'd{i} = {{ package = "{each["name"]}", version = "={each["version"].split("+")[0]}" }}'
            for i, each in enumerate(wanted)
        ]
        manifest = (
            '[package]\nname = "all"\nversion = "0.0.0"\nedition = "2024"\n[workspace]\n[dependencies]\n'
        )
        (folder / "Cargo.toml").write_text(manifest + "\n".join(lines) + "\n", encoding="utf-8")
        command = ["cargo", "package", "--allow-dirty", "--no-verify", "--target-dir", str(folder / "target")]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode and re.search("failed to (download|fetch|query)|network|resolve host", done.stderr):
        return None
    if done.returncode:
        return [f"cargo could not be asked for yanked versions:\n{done.stderr}"]
    return re.findall(r"package `([^`]+)` in Cargo.lock is yanked", done.stderr)


def features(*selection: str) -> dict[str, str]:
    """The features of every crate that is built for a selection of `cargo tree`."""
    command = ["cargo", "tree", "--locked", "--prefix=none", "--no-dedupe", "--format={p}\t{f}", *selection]
    told = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    lines = (line.removesuffix(" (*)").split("\t") for line in told.splitlines() if line)
    return {crate.removesuffix(" (proc-macro)"): given for crate, given in lines}


def compiled_twice() -> list[str]:
    """One line for every crate below the core with other features in tests than in the Python module."""
    core = features("-p", "vff-core", "-e", "normal,build")
    module = features("-p", "vff-python", "-e", "normal,build")
    tests = features("--workspace", "-e", "normal,build,dev")
    return [
        f"{crate} has the features {tests[crate]} in tests, {module[crate]} in the Python module"
        for crate in sorted(core)
        if module[crate] != tests[crate]
    ]


def main() -> int:
    """Print what is wrong; 1 if anything is."""
    command = ["cargo", "metadata", "--locked", "--format-version=1"]
    told = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    packages = json.loads(told)["packages"]
    found = faults(packages, tomllib.loads((ROOT / "deny.toml").read_text(encoding="utf-8")))
    withdrawn = yanked(packages, ROOT / "Cargo.lock")
    found += [f"{each} has been yanked" for each in withdrawn or ()]
    found += compiled_twice()
    print(*found, sep="\n", end="\n" if found else "")
    without = " Yanked versions: not checked, crates.io cannot be reached." if withdrawn is None else ""
    print(f"{len(packages)} crates, {len(found)} faults.{without}")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
