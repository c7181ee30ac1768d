"""A run at a glance: the picture, and beside it error, clearance and repulsion."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from vffnull.draw import replans, style
from vffnull.draw.figures import joints, links, strobe, tracking
from vffnull.draw.scene import Scene

if TYPE_CHECKING:
    from vffnull.model.outcome import Outcome


def overview(result: Outcome) -> Figure:
    """The strobe picture on the left; error, clearance and repulsion over time on the right.

    Without obstacles there is neither clearance nor repulsion, and the joint angles stand there.
    """
    scene = Scene.of_result(result)
    if scene.dimension == 3:
        fig = style.figure(4.2, 1.15 * style.PAGE)
        picture, plots = fig.subfigures(1, 2, squeeze=False, wspace=0.03, width_ratios=(1.15, 1.0))[0]
        strobe.in_depth(picture, scene, (0.0, 0.0, 1.0, 1.0))
    else:
        height = float(np.clip(strobe.natural_height(scene, style.PAGE / 2), 3.4, 4.2))
        fig = style.figure(height, style.PAGE)
        picture, plots = fig.subfigures(1, 2, squeeze=False, wspace=0.03)[0]
        strobe.passing(picture.subplots(), result, height=height)

    more = []
    if result.obstacles.shape[1]:
        axes = style.stacked(plots, 3)
        links.distances(axes[1], result)
        joints.repulsion(axes[2], result)
        torques = result.layout.units("tau_vff", result.tau_vff.shape[1:])
        labels, what = ["clearance\n[m]", f"repulsion\n[{torques}]"], "joint and link"
    else:
        axes = style.stacked(plots, 2)
        more = joints.angles(axes[1], result)
        labels, what = [axes[1].get_ylabel().replace(" [", "\n[")], "joint"
    tracking.error_magnitude(axes[0], result)
    error = axes[0].get_ylabel().replace(" [", "\n[")
    for ax, label in zip(axes, (error, *labels), strict=True):
        ax.set_ylabel(label)
    more += replans.mark(axes, result)
    style.joint_key(plots, axes[1:], result.q.shape[1], what, more)
    plots.align_ylabels(axes)
    return fig
