"""Scenarios as Gymnasium environments, needs the extra ``vffnull[gym]``.

>>> import gymnasium
>>> env = gymnasium.make("vffnull.gym:vffnull/Reach-v0", scenario="sweep-through")
>>> observation, info = env.reset(seed=1)
>>> observation, reward, terminated, truncated, info = env.step(env.action_space.sample())

`ReachEnv` is one episode after the other, `ReachVectorEnv` many side by side that are stepped by the core
on all cores, to the same bits.

**Action**: n numbers from −1 to 1. With ``action="null_space"`` they are a joint torque that is projected
into the null space and added to the law's, so that the task goes on while the agent learns to avoid; with
``action="torque"`` they are the joint torque itself, instead of the law's.

**Observation**: what the controller knows, as one row of numbers that `layout` takes apart: ``cos_q``,
``sin_q``, ``dq`` [rad/s], ``tip``, ``reference``, ``reference_velocity``, ``error`` and, where there are
obstacles, ``clearance`` of every link, ``nearest`` (the way from its axis, or from the surface of a box or
hull, to the nearest obstacle), ``obstacles`` and ``obstacle_velocities``, in m and m/s. What lies beyond the
bounds of the space is shown at the bound. Of an arm in space, points have three coordinates, and ``error``
has three numbers for a position, five for pointing and six for a pose. For these two tasks there are also
``tip_axes`` and ``reference_axes``, the x and y axis of hand and reference (their z axis, for pointing), and
``reference_angular_velocity`` [rad/s]. Joints that slide have no cosine and sine but their position in
``slide`` [m].

**Reward** per step, with weights w:

    w_alive − w_tracking ‖error‖ − w_clearance max(0, 1 − clearance/margin)² − w_effort mean(action²)

and −w_collision when the episode is terminated. The clearance is the smallest within the step; ``info`` has
every part. Error and clearance here are the true ones, also where a scenario has sensors.

An episode is **terminated** when a link touches an obstacle or a joint turns faster than 100 rad/s, and
**truncated** at the end of the scenario.
"""

from __future__ import annotations

from vffnull.engines.gym import ReachEnv, ReachVectorEnv

__all__ = ["ReachEnv", "ReachVectorEnv"]
