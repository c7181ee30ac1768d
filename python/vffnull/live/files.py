"""Scenarios that visitors open and save as files."""

from __future__ import annotations

from vffnull._support.errors import InputError
from vffnull.model.scenario import Scenario
from vffnull.model.toml_text import naming, parsed

LARGEST = 10_000_000
"""Bytes of a file that is opened."""
ELSEWHERE = ("urdf", "mjcf", "srdf", "packages")
"""Keys of an arm that name other files."""


def scenario_of(name: str, content: bytes) -> Scenario:
    """The scenario in a TOML file that somebody has sent.

    Raises
    ------
    vffnull.errors.InputError
        If it is no text, too large, or names other files: those do not come along, and a visitor must not
        choose files of the machine that runs the page.
    vffnull.errors.ScenarioError
        If it is no scenario that can be run.
    """
    if len(content) > LARGEST:
        raise InputError(f"{name}: is larger than {LARGEST // 1_000_000} MB")
    try:
        text = content.decode()
    except UnicodeDecodeError as error:
        raise InputError(f"{name}: is no text in UTF-8") from error
    document = parsed(text, name)
    arm = document.get("arm")
    for key in ELSEWHERE:
        if isinstance(arm, dict) and key in arm:
            raise InputError(
                f"{name}: arm.{key} names files that do not come along; `vffnull live {name}` opens it"
            )
    with naming(name):
        return Scenario.from_dict(document)


def file_name(scenario: str, suffix: str) -> str:
    """A name for a file about a scenario, without what file systems dislike."""
    return ("".join(each if each.isalnum() or each in "-_" else "-" for each in scenario) or "live") + suffix
