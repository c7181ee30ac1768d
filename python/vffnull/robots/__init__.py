"""Robots that `vffnull.drive` can drive, and what makes any other object one.

A robot is an object with two methods: `read`, which returns its time and state, and `write`, which takes a
command. `Robot` says what else it may have. The modules are adapters for robots that people have:

- `vffnull.robots.simulated`: the plant of a scenario, without Python in its loop;
- `vffnull.robots.mujoco`: an arm in MuJoCo (``pip install "vffnull[mujoco]"``);
- `vffnull.robots.franka`: Franka's arms, by pylibfranka (``pip install "vffnull[franka]"``);
- `vffnull.robots.ur`: Universal Robots' arms, by ur_rtde (``pip install "vffnull[ur]"``);
- `vffnull.robots.emulated`: the interfaces of the last two with their makers' rules, and no robot behind;
- `vffnull.robots.checks`: the model of an arm against the robot, before the first motion.

`franka` and `ur` have not been run on hardware; each says what to check first.
"""

from __future__ import annotations

from vffnull.model.robot import CommandKind, Robot, State

__all__ = ["CommandKind", "Robot", "State"]
