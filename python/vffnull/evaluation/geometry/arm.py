"""Where the links of an arm in space are, over many postures at once: the kinematics of the second geometry.

It shares no code with the core's, which it judges.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from vffnull.model.document import Document, plain

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    Array = NDArray[np.float64]

__all__ = ["SpatialArm", "cos_sin", "frame", "product", "quaternion", "rotation"]


class SpatialArm:
    """A serial arm in space, as its explicit description says. It cannot be changed.

    Parameters
    ----------
    document : Mapping
        The explicit description: the ``[arm]`` of a scenario with all its joints.
    """

    dimension = 3

    def __init__(self, document: Mapping[str, Any]) -> None:
        import numpy as np

        self._document: Document = plain(document)
        joints = self._document["joints"]
        self._fixed = np.stack([frame(joint) for joint in joints])
        self._axes = np.array([joint["axis"] for joint in joints], dtype=float)
        self._slides = np.array([joint["kind"] == "prismatic" for joint in joints])
        self._mount = frame(self._document.get("mount", {}))
        self._tool = frame(self._document.get("tool", {}))

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self._fixed)

    @property
    def joint_names(self) -> list[str]:
        """Names of the joints, from the base."""
        return [joint["name"] for joint in self._document["joints"]]

    @property
    def link_names(self) -> list[str]:
        """Names of the links that move, each after its joint."""
        return [joint["link"] for joint in self._document["joints"]]

    @property
    def base(self) -> str:
        """Name of the link that does not move."""
        return str(self._document["base"])

    @property
    def tip(self) -> str:
        """Name of the end effector's frame."""
        return str(self._document["tip"])

    @property
    def tool(self) -> Array:
        """Where the end effector's frame is in the last link, homogeneous (4, 4)."""
        return self._tool.copy()

    @property
    def masses(self) -> Array:
        """Masses of the links (n,) [kg]."""
        import numpy as np

        return np.array([joint["mass"] for joint in self._document["joints"]], dtype=float)

    @property
    def gravity(self) -> Array:
        """Acceleration of free fall (3,) [m/s²]."""
        import numpy as np

        return np.array(self._document["gravity"], dtype=float)

    @property
    def mount(self) -> Array:
        """Where the base stands in the world, homogeneous (4, 4)."""
        return self._mount.copy()

    @property
    def collision(self) -> list[tuple[str, dict[str, Any]]]:
        """What is measured against obstacles: names of links, and shapes in their frames [m]."""
        shapes = self._document.get("collision", [])
        return [(each["link"], copy.deepcopy(each["shape"])) for each in shapes]

    def link_poses(self, q: ArrayLike) -> Array:
        """Where the frames of the links are.

        Parameters
        ----------
        q : (…, n) array_like
            Joint positions [rad or m].

        Returns
        -------
        (…, n, 4, 4) ndarray
            Homogeneous, in the world.
        """
        import numpy as np

        angles = np.asarray(q, dtype=float)
        found = []
        place = np.broadcast_to(self._mount, (*angles.shape[:-1], 4, 4))
        for i, (fixed, axis) in enumerate(zip(self._fixed, self._axes, strict=True)):
            move = np.zeros((*angles.shape[:-1], 4, 4))
            move[..., 3, 3] = 1.0
            value = angles[..., i]
            if self._slides[i]:
                move[..., :3, :3] = np.eye(3)
                move[..., :3, 3] = value[..., None] * axis
            else:
                move[..., :3, :3] = _turns(axis, value)
            place = product(product(place, fixed), move)
            found.append(place)
        return np.stack(found, axis=-3)

    def tool_poses(self, q: ArrayLike) -> Array:
        """Where the end effector's frame is, homogeneous (…, 4, 4), at joint positions (…, n)."""
        return product(self.link_poses(q)[..., -1, :, :], self._tool)

    def forward_kinematics(self, q: ArrayLike) -> Array:
        """Origins of the joints; the last row is the tip.

        Parameters
        ----------
        q : (…, n) array_like
            Joint positions [rad or m].

        Returns
        -------
        (…, n+1, 3) ndarray
            In the world [m].
        """
        import numpy as np

        poses = self.link_poses(q)
        tip = product(poses[..., -1:, :, :], self._tool)
        origins: Array = np.concatenate([poses, tip], axis=-3)[..., :3, 3]
        return origins

    def pose(self, q: ArrayLike) -> tuple[Array, Array]:
        """Position (3,) [m] and orientation of the tip, a unit quaternion (4,) [w, x, y, z] with w ≥ 0."""
        place = self.tool_poses(q)
        return place[..., :3, 3], quaternion(place[..., :3, :3])

    def to_dict(self) -> Document:
        """The explicit description, as a copy of its own."""
        return copy.deepcopy(self._document)

    def __repr__(self) -> str:
        name = self._document.get("name") or "an arm"
        return f"<Arm {name}: {self.n} joints in space, from {self.base} to {self.tip}>"


def frame(placed: Mapping[str, Any]) -> Array:
    """A homogeneous matrix (4, 4) of a ``position`` [m] and an ``orientation`` [w, x, y, z]."""
    import numpy as np

    made = np.eye(4)
    made[:3, :3] = rotation(placed.get("orientation", (1.0, 0.0, 0.0, 0.0)))
    made[:3, 3] = placed.get("position", (0.0, 0.0, 0.0))
    return made


def rotation(orientation: ArrayLike) -> Array:
    """The matrices (…, 3, 3) of unit quaternions (…, 4) [w, x, y, z]."""
    import numpy as np

    given = np.asarray(orientation, dtype=float)
    w, x, y, z = np.moveaxis(given / np.linalg.norm(given, axis=-1, keepdims=True), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    matrices: Array = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    return matrices


def quaternion(matrix: Array) -> Array:
    """The unit quaternion (…, 4) [w, x, y, z], w ≥ 0, of rotation matrices (…, 3, 3)."""
    import numpy as np

    r = np.asarray(matrix, dtype=float)
    xx, yy, zz = r[..., 0, 0], r[..., 1, 1], r[..., 2, 2]
    # Every row is the quaternion times four times one of its entries; the longest one is exact.
    zy, xz, yx = r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]
    xy, xz_, yz = r[..., 0, 1] + r[..., 1, 0], r[..., 0, 2] + r[..., 2, 0], r[..., 1, 2] + r[..., 2, 1]
    rows = np.stack(
        [
            np.stack([1 + xx + yy + zz, zy, xz, yx], axis=-1),
            np.stack([zy, 1 + xx - yy - zz, xy, xz_], axis=-1),
            np.stack([xz, xy, 1 - xx + yy - zz, yz], axis=-1),
            np.stack([yx, xz_, yz, 1 - xx - yy + zz], axis=-1),
        ],
        axis=-2,
    )
    lengths = np.linalg.norm(rows, axis=-1)
    best = np.take_along_axis(rows, lengths.argmax(axis=-1)[..., None, None], axis=-2)[..., 0, :]
    best = best / np.linalg.norm(best, axis=-1, keepdims=True)
    found: Array = np.where(best[..., :1] < 0.0, -best, best)
    return found


def product(a: Array, b: Array) -> Array:
    """The products (…, m, n) of matrices (…, m, k) and (…, k, n), the same bits on every processor.

    Random scenes are made with it: BLAS, behind ``@``, has other sums for every kind of processor.
    """
    found: Array = a[..., :, :1] * b[..., :1, :]
    for k in range(1, a.shape[-1]):
        found = found + a[..., :, k, None] * b[..., k, None, :]
    return found


def cos_sin(angles: ArrayLike) -> tuple[Array, Array]:
    """Cosines and sines (…) of angles (…) [rad] by the C library: NumPy's depend on the processor."""
    import numpy as np

    return (
        np.asarray(np.frompyfunc(math.cos, 1, 1)(angles), dtype=float),
        np.asarray(np.frompyfunc(math.sin, 1, 1)(angles), dtype=float),
    )


def _turns(axis: Array, angles: Array) -> Array:
    """Rotation matrices (…, 3, 3) about a unit axis by angles (…) [rad]: Rodrigues' formula."""
    import numpy as np

    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    c, s = (part[..., None, None] for part in cos_sin(angles))
    matrices: Array = np.eye(3) + s * cross + (1.0 - c) * product(cross, cross)
    return matrices
