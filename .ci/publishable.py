"""Gives the package the addresses that it has only where it is published from.

    python .ci/publishable.py https://HOST/OWNER/NAME TAG

The repository does not know where it is kept: the links and pictures of its README are relative, and its
metadata names no address. A package index shows the README elsewhere. The release workflow therefore calls
this script before it builds: links and pictures become absolute, as of the tag; `[project.urls]` is added.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# What must stay as it is comes first: fenced blocks and inline code.
LINK = re.compile(
    r"^```.*?^```|`[^`\n]+`|(?P<picture>!?)\[(?P<text>[^\]]*)\]\((?P<target>[^)\s]+)\)", re.M | re.S
)


def absolute(readme: str, repository: str, tag: str) -> str:
    """The README with every link into the repository as an address of it."""

    def link(found: re.Match[str]) -> str:
        target = found["target"]
        if target is None or "://" in target or target.startswith(("#", "mailto:")):
            return found[0]
        kind = "raw" if found["picture"] else "blob"
        return f"{found['picture']}[{found['text']}]({repository}/{kind}/{tag}/{target})"

    return LINK.sub(link, readme)


def addressed(pyproject: str, repository: str, tag: str) -> str:
    """pyproject.toml with the addresses of the project."""
    urls = {
        "Source": repository,
        "Documentation": f"{repository}/tree/{tag}/docs",
        "Changelog": f"{repository}/blob/{tag}/CHANGELOG.md",
        "Issues": f"{repository}/issues",
    }
    table = "".join(f'{name} = "{url}"\n' for name, url in urls.items())
    return pyproject.replace("[project.scripts]\n", f"[project.urls]\n{table}\n[project.scripts]\n")


def main(repository: str, tag: str) -> None:
    """Rewrite both files in place."""
    for name, change in {"README.md": absolute, "pyproject.toml": addressed}.items():
        file = ROOT / name
        file.write_text(
            change(file.read_text(encoding="utf-8"), repository.rstrip("/"), tag), encoding="utf-8"
        )


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
