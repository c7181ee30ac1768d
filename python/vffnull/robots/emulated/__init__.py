"""Robots that are not there: makers' interfaces with their rules, before simulated arms.

`franka` and `ur` have the methods of the makers' Python libraries that vffnull's adapters use, so that the
very same program runs against them:

>>> from vffnull.robots import emulated
>>> from vffnull.robots.franka import FrankaRobot
>>> robot = FrankaRobot(emulated.franka.Robot("panda-sweep"))

Behind them are friction, noise, delays, lost packets and loads that nobody knows of (`Disturbances`). A
rule that is broken ends the motion, as the robot would, and is a value, `Reflex`: which rule, which joint,
how much, and when. `margins` of an emulator says how near each limit came. `vffnull.run.emulate` runs a
scenario so, which is what ``vffnull realtime SCENARIO --robot emulated-franka`` shows.

An emulator knows what its maker has published. It is no proof that a robot would do the same.
"""

from __future__ import annotations

from vffnull.robots.emulated import franka, ur
from vffnull.robots.emulated.body import ROBOTS, Body, Disturbances, usual
from vffnull.robots.emulated.reflex import Margin, Reflex, Rule

__all__ = [
    "ROBOTS",
    "Body",
    "Disturbances",
    "Margin",
    "Reflex",
    "Rule",
    "franka",
    "ur",
    "usual",
]
