"""Arms that are searched and judged together: settings of their own, and a section of docs/peers.md."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Group:
    """Arms that share settings.

    Attributes
    ----------
    arms : tuple of str
        All of them, in the order in which their scenes are driven.
    section : str
        What the marks on the page call it.
    found : Path
        Settings that were found on the training scenes of these arms.
    seeds : int
        Evaluation seeds of every arm, family and task.
    timed : bool
        Whether steps are timed.
    modules, packages : tuple of str
        Where their ways are, and the distributions whose versions matter.
    ways : tuple of str
        Who of them is judged here; nothing for all.
    figure : str
        What is drawn, if anything.
    """

    arms: tuple[str, ...]
    section: str
    found: Path
    seeds: int
    timed: bool = False
    modules: tuple[str, ...] = ("ours", "with_mink", "oscbf")
    packages: tuple[str, ...] = ("cbfpy", "daqp", "elastiqp", "jax", "mink", "mujoco", "numpy")
    ways: tuple[str, ...] = ()
    figure: str = ""


HERE = Path(__file__).parent
GROUPS = (
    Group(("panda",), "space", HERE / "tuned.toml", seeds=4, timed=True, figure="peers-space.png"),
    Group(("iiwa14", "ur5e"), "two arms", HERE / "tuned_two_arms.toml", seeds=2),
    Group(
        ("panda",),
        "sampling",
        HERE / "tuned.toml",
        seeds=4,
        timed=True,
        modules=("ours", "with_mppi"),
        packages=("numba", "numpy", "scipy"),
        ways=(
            "cbf",
            "cbf + preview",
            "MPPI, usual settings",
            "MPPI, tuned",
            "MPPI around the hand's law",
            "MPPI around the hand's law, 6 plans",
        ),
    ),
)
