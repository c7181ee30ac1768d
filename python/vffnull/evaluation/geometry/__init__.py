"""The geometry of scenes with NumPy alone: a second implementation that shares nothing with the core's.

The generators of scenes use it, and tests check with it what the core's planner has found. Products and
angles are those of `vffnull.model.arm`, the same bits on every processor.
"""
