"""MJCF to the explicit description of an arm, by way of MuJoCo's own compiler."""

from __future__ import annotations

import importlib
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

import vffnull._core as _core
from vffnull._support.errors import InputError, InputTypeError
from vffnull.arms._frames import frame, matrix, six
from vffnull.arms._read import Collision, Pieces, finish, options, tell
from vffnull.arms._report import Report
from vffnull.arms._urdf import text_of
from vffnull.model.arm import listed

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from vffnull.arms._capsules import Solid

__all__ = ["from_mjcf", "read_mjcf"]

Array = NDArray[np.float64]

_FAR = 1e9  # rad or m; where `to_mjcf` puts the end that a joint does not have


def from_mjcf(
    mjcf: Any,
    tip: str | None = None,
    base: str | None = None,
    locked: Mapping[str, float] | None = None,
    tool: object = None,
    mount: object = None,
    gravity: ArrayLike | None = None,
    collision: Collision = "fit",
    srdf: str | os.PathLike[str] | None = None,
    armature: ArrayLike | None = None,
    fix_inertia: bool = False,
    pieces: Pieces = 1,
) -> dict[str, Any]:
    """The explicit description of a serial arm in an MJCF.

    Armature, joint damping and dry friction are taken over. Bodies become links, hinges revolute (or
    continuous, where they have no range) and slides prismatic joints; a tip may be a body or a site.

    Parameters
    ----------
    mjcf : str, path or mujoco.MjModel
        A file, the text itself, or a model.
    tip, base, locked, tool, mount, collision, srdf, armature, fix_inertia, pieces
        As in `from_urdf`; links are bodies, the root is ``world``.
    gravity : (3,) array_like, optional
        In the world [m/s²]; the model's by default.

    Returns
    -------
    dict
        The ``[arm]`` of a scenario, complete: no other file is needed.

    Raises
    ------
    vffnull.errors.InputError
        If MuJoCo cannot compile the model, or what is asked for is no arm.
    ImportError
        If MuJoCo is not installed.

    Warns
    -----
    vffnull.errors.ScenarioWarning
        Of what is odd but allowed.

    See Also
    --------
    from_urdf : the same for URDF, with all parameters explained.
    """
    asked = (tip, base, locked, tool, mount, gravity, collision, srdf, armature, fix_inertia, pieces)
    return tell(read_mjcf(mjcf, *asked))


def read_mjcf(
    mjcf: Any,
    tip: str | None = None,
    base: str | None = None,
    locked: Mapping[str, float] | None = None,
    tool: object = None,
    mount: object = None,
    gravity: ArrayLike | None = None,
    collision: Collision = "fit",
    srdf: str | os.PathLike[str] | None = None,
    armature: ArrayLike | None = None,
    fix_inertia: bool = False,
    pieces: Pieces = 1,
) -> Report:
    """The same as `from_mjcf`, with everything that there is to say about it, and no warnings.

    Parameters
    ----------
    mjcf, tip, base, locked, tool, mount, gravity, collision, srdf, armature, fix_inertia, pieces
        As in `from_mjcf`.

    Returns
    -------
    Report
        The document, what is odd, and how tight the shapes of the links are.
    """
    mujoco = _import()
    model, source = _compiled(mujoco, mjcf)
    reader = _Reader(mujoco, model)
    pairs = reader.excluded() if srdf is None else text_of("srdf", srdf)[0]
    asked = options(
        tip,
        base,
        locked,
        tool,
        mount,
        _gravity(mujoco, model) if gravity is None else gravity,
        armature,
        fix_inertia,
        pairs,
    )
    reading = _core.reduce_tree(reader.tree(), asked)
    return finish(reading, collision, pieces, reader.mesh, source, srdf is not None)


def _gravity(mujoco: Any, model: Any) -> Any:
    """What acts on the bodies of a model [m/s²]."""
    is_off = model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    return np.zeros(3) if is_off else model.opt.gravity


def _import() -> Any:
    try:
        return importlib.import_module("mujoco")
    except ImportError as error:
        raise ImportError('mujoco is missing: pip install "vffnull[mujoco]"') from error


def _compiled(mujoco: Any, given: Any) -> tuple[Any, str]:
    if isinstance(given, mujoco.MjModel):
        return given, "MjModel"
    if not isinstance(given, (str, os.PathLike)):
        raise InputTypeError(f"mjcf: expected a path, text or MjModel, got {type(given).__name__}")
    text, path = text_of("mjcf", given)
    try:
        if path is None:
            return mujoco.MjModel.from_xml_string(text), "MJCF"
        return mujoco.MjModel.from_xml_path(str(Path(path))), str(path)
    except (ValueError, mujoco.FatalError) as error:
        raise InputError(f"{path or 'mjcf'}: MuJoCo cannot compile it: {error}") from None


class _Reader:
    """Links and joints of a compiled model."""

    def __init__(self, mujoco: Any, model: Any) -> None:
        self._mujoco = mujoco
        self._model = model
        self._warnings: list[str] = []
        self._followed = self._couplings()

    def excluded(self) -> str | None:
        """The pairs of bodies that the model takes out of its contacts, as an SRDF; None if it takes none."""
        signatures = [int(each) for each in self._model.exclude_signature]
        pairs = [(self._body(each >> 16), self._body(each & 0xFFFF)) for each in signatures]
        told = [f"<disable_collisions link1={quoteattr(a)} link2={quoteattr(b)}/>" for a, b in pairs]
        return f"<robot name='excluded'>{''.join(told)}</robot>" if told else None

    def _couplings(self) -> dict[int, dict[str, Any]]:
        """The joints that an equality lets follow another one in proportion, and how."""
        model, kind = self._model, int(self._mujoco.mjtEq.mjEQ_JOINT)
        found: dict[int, dict[str, Any]] = {}
        if model.opt.disableflags & int(self._mujoco.mjtDisableBit.mjDSBL_EQUALITY):
            return found
        for i in np.flatnonzero((model.eq_type == kind) & (model.eq_active0 != 0)):
            follower, driver = int(model.eq_obj1id[i]), int(model.eq_obj2id[i])
            constant, slope, *rest = (float(x) for x in model.eq_data[i, :5])
            if driver < 0 or any(rest):
                continue
            at, of = (float(model.qpos0[int(model.jnt_qposadr[joint])]) for joint in (follower, driver))
            found[follower] = {
                "joint": self._joint_name(driver),
                "multiplier": slope,
                "offset": at + constant - slope * of,
            }
        return found

    def tree(self) -> dict[str, Any]:
        """What the core reduces to a chain."""
        model = self._model
        # Where a link's frame lies in that of its body: at the anchor of its joint.
        anchors = np.zeros((model.nbody, 3))
        links: list[dict[str, Any]] = [{"name": self._body(0), "geometry": self._geometry(0, anchors[0])}]
        joints: list[dict[str, Any]] = []
        for body in range(1, model.nbody):
            joints += self._joints_above(body, anchors, links)
            links.append(self._link(body, anchors[body]))
        for site in range(model.nsite):
            name = self._name("SITE", site)
            if any(link["name"] == name for link in links):
                own = f"{name} (site)"
                self._warnings.append(
                    f"`{name}` is a body and a site: the body is meant; the site is `{own}`"
                )
                name = own
            if name:
                links.append({"name": name})
                body = int(model.site_bodyid[site])
                place = frame(model.site_pos[site] - anchors[body], model.site_quat[site])
                joints.append(_fixed(f"site {name}", self._body(body), name, place))
        self._odd()
        names = [joint["name"] for joint in joints]
        for joint in joints:
            if names.count(joint["name"]) > 1:
                joint["name"] += f" of {joint['child']}"
        name = self._model.names[: self._model.names.find(b"\0")].decode()
        return {"name": name, "links": links, "joints": joints, "warnings": self._warnings}

    def mesh(self, form: Mapping[str, Any], name: str) -> Solid:
        """The vertices of a compiled mesh, in the frame of its geom."""
        from vffnull.arms._capsules import Solid

        model, mesh = self._model, int(form["file"].partition(":")[0])
        first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        start, faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
        points = np.array(model.mesh_vert[first : first + count], float)
        return Solid.mesh(name, points, np.array(model.mesh_face[start : start + faces], np.int64))

    def _name(self, kind: str, index: int) -> str:
        name = self._mujoco.mj_id2name(self._model, getattr(self._mujoco.mjtObj, f"mjOBJ_{kind}"), index)
        return name or ""

    def _body(self, body: int) -> str:
        return self._name("BODY", body) or f"body {body}"

    def _joint_name(self, joint: int) -> str:
        return self._name("JOINT", joint) or f"joint {joint}"

    def _link(self, body: int, anchor: Array) -> dict[str, Any]:
        model = self._model
        rotation = matrix(model.body_iquat[body])
        inertia = rotation @ np.diag(model.body_inertia[body]) @ rotation.T
        return {
            "name": self._body(body),
            "mass": float(model.body_mass[body]),
            "com": (model.body_ipos[body] - anchor).tolist(),
            "inertia": six(inertia),
            "geometry": self._geometry(body, anchor),
        }

    def _joints_above(self, body: int, anchors: Array, links: list[dict[str, Any]]) -> list[dict[str, Any]]:
        """The joints between a body and its parent; several make massless links between them."""
        model = self._model
        parent = int(model.body_parentid[body])
        name, position, rotation = self._body(body), model.body_pos[body], matrix(model.body_quat[body])
        place = position - anchors[parent]
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        if count == 0:
            quaternion = model.body_quat[body]
            return [_fixed(f"fixed {name}", self._body(parent), name, frame(place, quaternion))]
        found, above, quaternion = [], self._body(parent), model.body_quat[body]
        for i in range(first, first + count):
            anchor = model.jnt_pos[i]
            last = i == first + count - 1
            child = name if last else f"{name} after {self._name('JOINT', i) or i}"
            if not last:
                links.append({"name": child})
            if i == first:
                origin = place + rotation @ anchor
            else:
                origin, quaternion = anchor - model.jnt_pos[i - 1], np.array([1.0, 0.0, 0.0, 0.0])
            found.append(self._joint(i, above, child, origin, quaternion))
            above = child
        anchors[body] = model.jnt_pos[first + count - 1]
        return found

    def _joint(self, i: int, parent: str, child: str, origin: Array, quaternion: Array) -> dict[str, Any]:
        model, kinds = self._model, self._mujoco.mjtJoint
        kind, axis = int(model.jnt_type[i]), model.jnt_axis[i]
        address = int(model.jnt_dofadr[i])
        joint: dict[str, Any] = {
            "name": self._joint_name(i),
            "parent": parent,
            "child": child,
        }
        if kind in (int(kinds.mjJNT_FREE), int(kinds.mjJNT_BALL)):
            free = kind == int(kinds.mjJNT_FREE)
            return {**joint, "kind": "floating" if free else "ball", "frame": frame(origin, quaternion)}
        motors = [(motor, float(model.actuator_gear[motor, 0]) ** 2) for motor in self._motors_of(i)]
        armature, damping = float(model.dof_armature[address]), 0.0
        if not self._is_off("DAMPER"):
            damping = float(np.ravel(model.dof_damping[address])[0])
            damping += sum(square * float(_of(model, "actuator_damping")[motor]) for motor, square in motors)
        armature += sum(square * float(_of(model, "actuator_armature")[motor]) for motor, square in motors)
        # A body's place in the file is that at qpos0, which need not be 0.
        reference = float(model.qpos0[int(model.jnt_qposadr[i])])
        limited = bool(model.jnt_limited[i])
        if kind == int(kinds.mjJNT_SLIDE):
            name = "prismatic"
            origin = origin - matrix(quaternion) @ axis * reference
        else:
            name = "revolute" if limited else "continuous"
            half = -reference / 2
            quaternion = _product(quaternion, [np.cos(half), *(np.sin(half) * axis)])
        return {
            **joint,
            "kind": name,
            "frame": frame(origin, quaternion),
            "axis": [float(x) for x in axis],
            "limits": [_end(x) for x in model.jnt_range[i]] if limited else None,
            "torque": self._torque(i),
            "armature": armature,
            "damping": damping,
            "friction": 0.0 if self._is_off("FRICTIONLOSS") else float(model.dof_frictionloss[address]),
            "mimic": self._followed.get(i),
        }

    def _is_off(self, flag: str) -> bool:
        """Whether the options of the model switch something off."""
        bits = self._mujoco.mjtDisableBit
        if flag in ("DAMPER", "SPRING") and not hasattr(bits, f"mjDSBL_{flag}"):
            flag = "PASSIVE"  # both, as versions before had it
        return bool(self._model.opt.disableflags & int(getattr(bits, f"mjDSBL_{flag}")))

    def _on_joints(self) -> NDArray[np.bool_]:
        """Which actuators act on a joint itself."""
        kinds = self._mujoco.mjtTrn
        of_joints = [int(kinds.mjTRN_JOINT), int(kinds.mjTRN_JOINTINPARENT)]
        return np.isin(self._model.actuator_trntype, of_joints)

    def _motors_of(self, joint: int) -> list[int]:
        """The actuators of a joint."""
        moves = self._on_joints() & (self._model.actuator_trnid[:, 0] == joint)
        return [int(motor) for motor in np.flatnonzero(moves)]

    def _torque(self, joint: int) -> float:
        """The torque that its actuators have in both directions, 0 for no limit."""
        model = self._model
        given = [self._of_motor(motor) for motor in self._motors_of(joint)]
        low, high = np.sum(given, axis=0) if given else (-math.inf, math.inf)
        if model.jnt_actfrclimited[joint]:
            low, high = np.clip([low, high], *model.jnt_actfrcrange[joint])
        one_way = min(-low, high) <= 0.0
        torque = float(max(-low, high) if one_way else min(-low, high))
        if not math.isclose(-low, high, rel_tol=1e-9):
            what = (
                "they push one way alone, and the law reckons with both" if one_way else "the less is taken"
            )
            self._warnings.append(
                f"the actuators of `{self._joint_name(joint)}` give {low:g} to {high:g}: {what}"
            )
        return torque if math.isfinite(torque) else 0.0

    def _of_motor(self, motor: int) -> tuple[float, float]:
        """The least and the most that an actuator gives to its joint; infinite where nothing is said."""
        model, mujoco = self._model, self._mujoco
        gear = float(model.actuator_gear[motor, 0])
        low, high = -math.inf, math.inf
        follows = [int(getattr(mujoco.mjtDyn, f"mjDYN_{kind}")) for kind in ("NONE", "FILTER", "FILTEREXACT")]
        if (
            int(model.actuator_gaintype[motor]) == int(mujoco.mjtGain.mjGAIN_FIXED)
            and int(model.actuator_biastype[motor]) == int(mujoco.mjtBias.mjBIAS_NONE)
            and int(model.actuator_dyntype[motor]) in follows
            and model.actuator_ctrllimited[motor]
        ):
            gain = float(model.actuator_gainprm[motor, 0])
            low, high = sorted(gain * float(end) for end in model.actuator_ctrlrange[motor])
        if model.actuator_forcelimited[motor]:
            low, high = np.clip([low, high], *model.actuator_forcerange[motor])
        ends = sorted(gear * end for end in (low, high)) if gear != 0.0 else (0.0, 0.0)
        return float(ends[0]), float(ends[1])

    def _geometry(self, body: int, anchor: Array) -> list[dict[str, Any]]:
        model, kinds = self._model, self._mujoco.mjtGeom
        found = []
        for geom in map(int, np.flatnonzero(model.geom_bodyid == body)):
            if not (model.geom_contype[geom] or model.geom_conaffinity[geom]):
                continue
            kind, size = int(model.geom_type[geom]), [float(x) for x in model.geom_size[geom]]
            form: dict[str, Any]
            if kind == int(kinds.mjGEOM_SPHERE):
                form = {"kind": "sphere", "radius": size[0]}
            elif kind == int(kinds.mjGEOM_CAPSULE):
                form = {"kind": "capsule", "radius": size[0], "length": 2 * size[1]}
            elif kind == int(kinds.mjGEOM_CYLINDER):
                form = {"kind": "cylinder", "radius": size[0], "length": 2 * size[1]}
            elif kind in (int(kinds.mjGEOM_BOX), int(kinds.mjGEOM_ELLIPSOID)):
                form = {"kind": "box", "size": [2 * x for x in size]}
                if kind == int(kinds.mjGEOM_ELLIPSOID):
                    label = self._name("GEOM", geom) or f"geom {geom}"
                    self._warnings.append(
                        f"{label} of {self._body(body)} is an ellipsoid: the box around it is taken"
                    )
            elif kind == int(kinds.mjGEOM_MESH):
                mesh = int(model.geom_dataid[geom])
                label = f"{mesh}:{self._name('MESH', mesh)}"
                form = {"kind": "mesh", "file": label, "scale": [1.0, 1.0, 1.0]}
            else:
                if body != 0:
                    label = self._name("GEOM", geom) or f"geom {geom}"
                    self._warnings.append(
                        f"{label} of {self._body(body)} is a plane, height field or distance field: left out"
                    )
                continue
            place = frame(model.geom_pos[geom] - anchor, model.geom_quat[geom])
            found.append({"link": self._body(body), "frame": place, "form": form})
        return found

    def _odd(self) -> None:
        """What a chain of rigid links cannot say."""
        model = self._model
        touches = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
        shown = sorted(set(model.geom_bodyid[~touches]) - set(model.geom_bodyid[touches]) - {0})
        if shown:
            names = listed([f"`{self._body(int(body))}`" for body in shown])
            self._warnings.append(
                f"all shapes of {names} touch nothing (their contype and conaffinity are 0): left out"
            )
        if model.neq > len(self._followed):
            left = model.neq - len(self._followed)
            self._warnings.append(f"{left} equality constraints are left out: what they couple moves apart")
        if model.ntendon:
            self._warnings.append(f"{model.ntendon} tendons are left out")
        springs = ("jnt_stiffness", "jnt_stiffnesspoly")
        if not self._is_off("SPRING") and any(np.any(_of(model, name)) for name in springs):
            self._warnings.append("springs of joints are left out")
        steeper = ("dof_dampingpoly", "actuator_dampingpoly")
        if not self._is_off("DAMPER") and any(np.any(_of(model, name)) for name in steeper):
            self._warnings.append("damping that grows faster than the speed is left out")
        if np.any(_of(model, "tendon_armature")):
            self._warnings.append("the armature of tendons is left out")
        others = ~self._on_joints()
        if any(np.any(_of(model, f"actuator_{what}")[others]) for what in ("armature", "damping")):
            self._warnings.append("armature and damping of actuators that act on no joint are left out")
        if model.opt.density > 0.0 or model.opt.viscosity > 0.0:
            self._warnings.append("the air or water around (density, viscosity) is left out")
        if np.any(model.body_gravcomp):
            self._warnings.append("gravity compensation (gravcomp) is left out: gravity acts on all bodies")


def _fixed(name: str, parent: str, child: str, place: dict[str, list[float]]) -> dict[str, Any]:
    return {"name": name, "kind": "fixed", "parent": parent, "child": child, "frame": place}


def _end(value: float) -> float:
    """An end of a joint's range; one so far away stands for none."""
    return float(value) if abs(value) < _FAR else math.copysign(math.inf, value)


def _of(model: Any, name: str) -> Array:
    """An array of the model; zeros where its version of MuJoCo does not know it."""
    return np.asarray(getattr(model, name, np.zeros(model.nu)), float)


def _product(p: Any, q: Any) -> Array:
    """Product of quaternions."""
    (a, b, c, d), (w, x, y, z) = p, q
    return np.array(
        [
            a * w - b * x - c * y - d * z,
            a * x + b * w + c * z - d * y,
            a * y - b * z + c * w + d * x,
            a * z + b * y - c * x + d * w,
        ]
    )
