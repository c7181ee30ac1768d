//! `Arm`: an arm and its matrices.

mod attributes;
mod reading;
mod states;

use crate::convert::{array1, array2, matrix, table_to_dict, vector};
use crate::extended_jacobian::ExtendedJacobian;
use attributes::{Shapes, exported, limits, planar, shapes, summary};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
pub use reading::plant;
use reading::{given_values, read_by, uniform, with_load, with_tool};
use toml::Table;
use vff_core::control::extended_jacobian::MATRICES;
use vff_core::runtime::{AnyArm, AnyState};

type Array1<'py> = Bound<'py, PyArray1<f64>>;
type Array2<'py> = Bound<'py, PyArray2<f64>>;
type Any<'a, 'py> = &'a Bound<'py, PyAny>;

/// An arm of n links in a chain, in the plane or in space. It cannot be changed.
///
/// The constructor makes an arm in the plane: its joints turn, joint angles are relative, joint 1 sits at
/// the origin, and link 1 lies along +x at q = 0. `named`, `from_urdf` and `from_mjcf` make arms in space,
/// whose joints turn [rad] or slide [m]; orientations are unit quaternions [w, x, y, z] with w ≥ 0.
///
/// Parameters
/// ----------
/// lengths : (n,) array_like
///     Lengths of the links [m], positive.
/// masses : float or (n,) array_like
///     Masses [kg], positive.
/// com : (n,) or (n, 2) array_like, optional
///     Centre of mass of each link in its frame [m], x along the link; the middle of the link by default.
/// inertias : float or (n,) array_like, optional
///     Moments of inertia about the centre of mass [kg·m²]; a uniform rod's by default.
/// radius : float or (n,) array_like, optional
///     Radius of the links [m] when the distance to obstacles is measured; 0 by default.
/// gravity : float or (2,) array_like, optional
///     Gravity [m/s²]; a single number g acts along −y, as (0, −g). 0, a horizontal plane, by default.
/// joint_limits : (n, 2) array_like, optional
///     Lowest and highest joint angles [rad].
/// torque_limits : float or (n,) array_like, optional
///     Largest joint torques [N·m].
/// velocity_limits : float or (n,) array_like, optional
///     Largest joint speeds [rad/s].
///
/// Raises
/// ------
/// vffnull.errors.InputError
///     If a parameter has the wrong length, is not finite, or makes no physical sense.
/// vffnull.errors.InputTypeError
///     If a parameter is not a number or an array of numbers.
///
/// Examples
/// --------
/// >>> arm = Arm.uniform(6)
/// >>> arm.forward_kinematics([0.0] * 6)[-1]
/// array([6., 0.])
#[pyclass(frozen, module = "vffnull")]
pub struct Arm {
    pub arm: AnyArm,
    document: Table,
}

#[pymethods]
impl Arm {
    #[new]
    #[pyo3(signature = (lengths, masses, com=None, inertias=None, radius=None, gravity=None, joint_limits=None, torque_limits=None, velocity_limits=None))]
    #[expect(clippy::too_many_arguments, reason = "the parameters of an arm")]
    fn new(
        lengths: &Bound<'_, PyAny>,
        masses: &Bound<'_, PyAny>,
        com: Option<&Bound<'_, PyAny>>,
        inertias: Option<&Bound<'_, PyAny>>,
        radius: Option<&Bound<'_, PyAny>>,
        gravity: Option<&Bound<'_, PyAny>>,
        joint_limits: Option<&Bound<'_, PyAny>>,
        torque_limits: Option<&Bound<'_, PyAny>>,
        velocity_limits: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let given = [
            ("lengths", Some(lengths)),
            ("masses", Some(masses)),
            ("com", com),
            ("inertias", inertias),
            ("radius", radius),
            ("gravity", gravity),
            ("joint_limits", joint_limits),
            ("torque_limits", torque_limits),
            ("velocity_limits", velocity_limits),
        ];
        Self::read(lengths.py(), given_values(given)?)
    }

    /// The same arm with something at its tip, as part of the last link.
    ///
    /// Parameters
    /// ----------
    /// mass : float
    ///     Its mass [kg], 0 or more.
    /// com : (3,) array_like, optional
    ///     Its centre of mass in the frame of the tool [m]; at the tip by default, and always in the plane.
    /// inertia : (6,) array_like, optional
    ///     Its moments of inertia xx, yy, zz, xy, xz, yz about that [kg·m²]; a point's by default.
    /// shapes : sequence of dict, optional
    ///     What of it can touch something, each a ``shape`` as in ``[[arm.collision]]`` but in the frame of
    ///     the tool. They say `com` and `inertia` by default, as of one material. In space alone.
    ///
    /// Raises
    /// ------
    /// vffnull.errors.InputError
    ///     If it is no body.
    ///
    /// Examples
    /// --------
    /// >>> carries = Arm.named("panda").with_load(1.5, shapes=[{"kind": "sphere", "radius": 0.05}])
    /// >>> carries.collision[-1][0]
    /// 'panda_link7'
    #[pyo3(signature = (mass, com=None, inertia=None, shapes=None))]
    fn with_load(
        &self,
        mass: &Bound<'_, PyAny>,
        com: Option<&Bound<'_, PyAny>>,
        inertia: Option<&Bound<'_, PyAny>>,
        shapes: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        with_load(self, mass, com, inertia, shapes)
    }

    /// The same arm in space with its tip elsewhere. What a tool weighs is a load (`with_load`).
    ///
    /// Parameters
    /// ----------
    /// position : (3,) array_like
    ///     Of the tip in the frame of the last link [m].
    /// orientation : (4,) array_like, optional
    ///     A unit quaternion (w, x, y, z); none by default.
    ///
    /// Raises
    /// ------
    /// vffnull.errors.InputError
    ///     If it is no frame, or the arm moves in the plane.
    #[pyo3(signature = (position, orientation=None))]
    fn with_tool(&self, position: Any<'_, '_>, orientation: Option<Any<'_, '_>>) -> PyResult<Self> {
        with_tool(self, position, orientation)
    }

    /// An arm in space that is bundled.
    ///
    /// Parameters
    /// ----------
    /// name : str
    ///     ``"panda"``, ``"fr3"``, ``"ur5e"``, ``"ur10e"``, ``"iiwa14"``, ``"gen3"``, or ``"xarm7"``.
    ///
    /// Raises
    /// ------
    /// vffnull.errors.InputError
    ///     If there is no such arm; the message lists those that there are.
    ///
    /// Examples
    /// --------
    /// >>> Arm.named("panda").n
    /// 7
    #[staticmethod]
    fn named(name: &Bound<'_, PyAny>) -> PyResult<Self> {
        read_by("named", name, &PyTuple::empty(name.py()), None)
    }

    /// An arm in space from a URDF.
    ///
    /// Parameters
    /// ----------
    /// path_or_text : str or path
    ///     A file, or the text itself.
    /// tip : str, optional
    ///     The link where the chain ends; the only link without children by default.
    /// base : str, optional
    ///     The link where it begins; the root by default.
    /// locked : dict, optional
    ///     Joints that do not move and where they stand [rad or m]. Joints off the chain are locked
    ///     anyway, at 0 unless they are named here.
    /// tool : (3,) array_like, (position, quaternion), or dict, optional
    ///     A frame in that of the link `tip`, where the end effector is [m]; quaternions are [w, x, y, z].
    /// mount : the same, optional
    ///     Where the base stands in the world.
    /// gravity : (3,) array_like, optional
    ///     In the world [m/s²].
    /// collision : {"fit", "file", "none"}, optional
    ///     Capsules around the links, which are measured fastest; boxes, balls and hulls as in the file; or
    ///     nothing.
    /// srdf : str or path, optional
    ///     A file, or the text: pairs of links that it switches off are not measured against each other, and
    ///     no others. Without it, those whose shapes overlap nearly always are not, with a warning.
    /// packages : path, list of paths, or dict, optional
    ///     Folders in which meshes are searched, or the folder of each package by its name.
    /// armature : float or (n,) array_like, optional
    ///     Inertia of the rotors as seen by the joints [kg·m²]; URDF has none.
    /// fix_inertia : bool, optional
    ///     Replace impossible inertia tensors by the nearest possible ones, with a warning.
    /// pieces : int or dict, optional
    ///     With ``collision="file"``: the most hulls that a mesh may become, of each link or of those named.
    ///
    /// Raises
    /// ------
    /// vffnull.errors.InputError
    ///     If the text is no URDF, or what is asked for is no arm; the message says which link or joint.
    /// ImportError
    ///     If meshes have to be read and the extra ``meshes`` is not installed.
    ///
    /// See Also
    /// --------
    /// vffnull.arms.read_urdf : the same, and what is odd, how tight the shapes are.
    #[staticmethod]
    #[pyo3(
        signature = (path_or_text, *arguments, **options),
        text_signature = "(path_or_text, tip=None, base=None, locked=None, tool=None, mount=None, gravity=(0.0, 0.0, -9.81), collision='fit', srdf=None, packages=None, armature=None, fix_inertia=False, pieces=1)"
    )]
    fn from_urdf<'py>(
        path_or_text: &Bound<'py, PyAny>,
        arguments: &Bound<'py, PyTuple>,
        options: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Self> {
        read_by("from_urdf", path_or_text, arguments, options)
    }

    /// An arm in space from an MJCF or a ``mujoco.MjModel``.
    ///
    /// Armature, joint damping and dry friction are taken over. Bodies become links, hinges revolute (or
    /// continuous, where they have no range) and slides prismatic joints.
    ///
    /// Parameters
    /// ----------
    /// path_or_model : str, path or mujoco.MjModel
    ///     A file, the text itself, or a model.
    /// tip : str, optional
    ///     The body or site where the chain ends; the only body without children by default.
    /// base : str, optional
    ///     The body where it begins; ``world`` by default.
    /// locked : dict, optional
    ///     Joints that do not move and where they stand [rad or m]. Joints off the chain are locked
    ///     anyway, at 0 unless they are named here.
    /// tool : (3,) array_like, (position, quaternion), or dict, optional
    ///     A frame in that of `tip`, where the end effector is [m]; quaternions are [w, x, y, z].
    /// mount : the same, optional
    ///     Where the base stands in the world.
    /// gravity : (3,) array_like, optional
    ///     In the world [m/s²]; the model's by default.
    /// collision : {"fit", "file", "none"}, optional
    ///     As in `from_urdf`.
    /// srdf : str or path, optional
    ///     As in `from_urdf`.
    /// armature : float or (n,) array_like, optional
    ///     Inertia of the rotors as seen by the joints [kg·m²]; the model's by default.
    /// fix_inertia : bool, optional
    ///     Replace impossible inertia tensors by the nearest possible ones, with a warning.
    /// pieces : int or dict, optional
    ///     As in `from_urdf`.
    ///
    /// Raises
    /// ------
    /// vffnull.errors.InputError
    ///     If MuJoCo cannot compile the model, or what is asked for is no arm.
    /// ImportError
    ///     If MuJoCo is not installed.
    ///
    /// See Also
    /// --------
    /// vffnull.arms.read_mjcf : the same, and what is odd, how tight the shapes are.
    #[staticmethod]
    #[pyo3(
        signature = (path_or_model, *arguments, **options),
        text_signature = "(path_or_model, tip=None, base=None, locked=None, tool=None, mount=None, gravity=None, collision='fit', srdf=None, armature=None, fix_inertia=False, pieces=1)"
    )]
    fn from_mjcf<'py>(
        path_or_model: &Bound<'py, PyAny>,
        arguments: &Bound<'py, PyTuple>,
        options: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Self> {
        read_by("from_mjcf", path_or_model, arguments, options)
    }

    /// An arm of n equal uniform rods.
    ///
    /// Parameters
    /// ----------
    /// n : int
    ///     Number of links, at least 1.
    /// length : float, optional
    ///     Length of each link [m].
    /// mass : float, optional
    ///     Mass of each link [kg].
    /// radius : float, optional
    ///     Radius of each link [m].
    /// gravity : float, optional
    ///     Gravity along −y [m/s²].
    #[staticmethod]
    #[pyo3(
        signature = (n, length=None, mass=None, radius=None, gravity=None),
        text_signature = "(n, length=1.0, mass=1.0, radius=0.0, gravity=0.0)"
    )]
    fn uniform(
        n: &Bound<'_, PyAny>,
        length: Option<&Bound<'_, PyAny>>,
        mass: Option<&Bound<'_, PyAny>>,
        radius: Option<&Bound<'_, PyAny>>,
        gravity: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        Self::read(n.py(), uniform(n, [length, mass, radius, gravity])?)
    }

    /// Number of joints.
    #[getter(n)]
    fn py_n(&self) -> usize {
        self.n()
    }

    /// Lengths of the links, (n,) [m]; of an arm in the plane alone.
    #[getter]
    fn lengths<'py>(&self, py: Python<'py>) -> PyResult<Array1<'py>> {
        planar(py, "lengths", self.arm.lengths())
    }

    /// Masses of the links, (n,) [kg].
    #[getter]
    fn masses<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.arm.masses())
    }

    /// Centres of mass in the links' frames, (n, 2) or (n, 3) [m].
    #[getter]
    fn com<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py>> {
        array2(py, self.arm.centres_of_mass(), [self.n(), self.arm.dimension()])
    }

    /// Inertia about the centres of mass, (n,), or in space (n, 3, 3) in the links' axes [kg·m²].
    #[getter]
    fn inertias<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let inertias = PyArray1::from_vec(py, self.arm.inertias());
        match self.arm.dimension() {
            2 => Ok(inertias.into_any()),
            _ => Ok(inertias.reshape([self.n(), 3, 3])?.into_any()),
        }
    }

    /// Radii of the links, (n,) [m]; of an arm in the plane alone.
    #[getter]
    fn radius<'py>(&self, py: Python<'py>) -> PyResult<Array1<'py>> {
        planar(py, "radius", self.arm.radii())
    }

    /// Acceleration of free fall in the world, (2,) or (3,) [m/s²].
    #[getter]
    fn gravity<'py>(&self, py: Python<'py>) -> Array1<'py> {
        array1(py, &self.arm.gravity())
    }

    /// Number of dimensions of the space that the arm moves in, 2 or 3.
    #[getter]
    fn dimension(&self) -> usize {
        self.arm.dimension()
    }

    /// Names of the joints, from the base.
    #[getter]
    fn joint_names(&self) -> Vec<String> {
        self.arm.joint_names()
    }

    /// Names of the links that the joints move, from the base.
    #[getter]
    fn link_names(&self) -> Vec<String> {
        self.arm.link_names()
    }

    /// Lowest and highest joint positions, (n, 2) [rad or m]; None without limits.
    #[getter]
    fn joint_limits<'py>(&self, py: Python<'py>) -> PyResult<Option<Array2<'py>>> {
        let ranges = &self.arm.limits().joint;
        let array = || array2(py, ranges.as_flattened().to_vec(), [ranges.len(), 2]);
        (!ranges.is_empty()).then(array).transpose()
    }

    /// Largest joint speeds, (n,) [rad/s or m/s]; None without limits.
    #[getter]
    fn velocity_limits<'py>(&self, py: Python<'py>) -> Option<Array1<'py>> {
        limits(py, &self.arm.limits().velocity)
    }

    /// Largest joint torques or forces, (n,) [N·m or N]; None without limits.
    #[getter]
    fn torque_limits<'py>(&self, py: Python<'py>) -> Option<Array1<'py>> {
        limits(py, &self.arm.limits().torque)
    }

    /// What is measured against obstacles and other links: names of links and shapes in their frames.
    #[getter]
    fn collision<'py>(&self, py: Python<'py>) -> PyResult<Shapes<'py>> {
        shapes(py, self.arm.collision())
    }

    /// Position and orientation of the tip.
    ///
    /// Parameters
    /// ----------
    /// q : (n,) array_like
    ///     Joint positions [rad or m].
    ///
    /// Returns
    /// -------
    /// position : (2,) or (3,) ndarray
    ///     In the world [m].
    /// orientation : (4,) or () ndarray
    ///     A unit quaternion [w, x, y, z] with w ≥ 0; in the plane the angle to the x axis [rad].
    fn pose<'py>(&self, q: &Bound<'py, PyAny>) -> PyResult<(Array1<'py>, Bound<'py, PyAny>)> {
        let (position, orientation) = self.at(q)?.pose();
        let shape = if orientation.len() == 1 { vec![] } else { vec![orientation.len()] };
        let orientation = PyArray1::from_vec(q.py(), orientation).reshape(shape)?.into_any();
        Ok((array1(q.py(), &position), orientation))
    }

    /// Frames of the links in the world, homogeneous, (n, 4, 4); in the plane (n, 3, 3).
    ///
    /// Parameters
    /// ----------
    /// q : (n,) or (T, n) array_like
    ///     Joint positions [rad or m]; of T configurations the frames are (T, n, 4, 4) or (T, n, 3, 3).
    fn link_poses<'py>(&self, q: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let d = self.arm.dimension() + 1;
        self.at_each(q, &[self.n(), d, d], |state, out| out.extend(state.link_poses()))
    }

    /// Frame of the tip in the world, homogeneous, (4, 4); in the plane (3, 3).
    ///
    /// Parameters
    /// ----------
    /// q : (n,) or (T, n) array_like
    ///     Joint positions [rad or m]; of T configurations the frames are (T, 4, 4) or (T, 3, 3).
    fn tip_poses<'py>(&self, q: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let d = self.arm.dimension() + 1;
        self.at_each(q, &[d, d], |state, out| out.extend(state.tip_pose()))
    }

    /// Positions of the joints; the last row is the tip.
    ///
    /// Parameters
    /// ----------
    /// q : (n,) or (T, n) array_like
    ///     Joint positions [rad or m].
    ///
    /// Returns
    /// -------
    /// (n+1, 2) or (n+1, 3) ndarray, (T, n+1, 2) or (T, n+1, 3) for T configurations
    ///     Positions [m].
    fn forward_kinematics<'py>(&self, q: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let shape = [self.n() + 1, self.arm.dimension()];
        self.at_each(q, &shape, AnyState::append_joint_positions)
    }

    /// Jacobian J of the tip, (2, n): ẋ = J q̇ (eq. 2 of the paper).
    ///
    /// In space it is (6, n): the velocity of the tip, then its angular velocity, both in world axes.
    fn jacobian<'py>(&self, q: &Bound<'py, PyAny>) -> PyResult<Array2<'py>> {
        matrix(q.py(), &self.at(q)?.jacobian())
    }

    /// Time derivative of the Jacobian, (2, n) or (6, n).
    fn jacobian_dot<'py>(&self, q: Any<'_, 'py>, dq: Any<'_, 'py>) -> PyResult<Array2<'py>> {
        matrix(q.py(), &self.moving(q, dq)?.jacobian_dot())
    }

    /// Mass matrix M, (n, n) [kg·m²], with the armature of the joints; symmetric and positive definite.
    fn mass_matrix<'py>(&self, q: &Bound<'py, PyAny>) -> PyResult<Array2<'py>> {
        let state = self.at(q)?;
        matrix(q.py(), &self.dense(q.py(), 4, || state.mass_matrix())?)
    }

    /// Coriolis matrix C by Christoffel symbols, (n, n) [N·m·s]: Ṁ = C + Cᵀ.
    fn coriolis_matrix<'py>(&self, q: Any<'_, 'py>, dq: Any<'_, 'py>) -> PyResult<Array2<'py>> {
        let state = self.moving(q, dq)?;
        matrix(q.py(), &self.dense(q.py(), 4, || state.coriolis_matrix())?)
    }

    /// Torque g that holds the arm against gravity, (n,) [N·m].
    fn gravity_torque<'py>(&self, q: &Bound<'py, PyAny>) -> PyResult<Array1<'py>> {
        Ok(array1(q.py(), &self.at(q)?.gravity_torque()))
    }

    /// Torque of a motion, M q̈ + C q̇ + g, (n,) [N·m].
    ///
    /// Parameters
    /// ----------
    /// q, dq, ddq : (n,) array_like
    ///     Joint positions [rad or m], velocities, accelerations.
    fn inverse_dynamics<'py>(
        &self,
        q: &Bound<'py, PyAny>,
        dq: &Bound<'py, PyAny>,
        ddq: &Bound<'py, PyAny>,
    ) -> PyResult<Array1<'py>> {
        let state = self.moving(q, dq)?;
        let ddq = vector("ddq", ddq, self.n())?;
        Ok(array1(q.py(), &state.inverse_dynamics(&ddq)))
    }

    /// Acceleration under a torque, M⁻¹(τ − C q̇ − g), (n,) [rad/s²], in O(n).
    ///
    /// Parameters
    /// ----------
    /// q, dq, tau : (n,) array_like
    ///     Joint positions [rad or m], velocities, torques [N·m] or forces [N].
    fn forward_dynamics<'py>(
        &self,
        q: &Bound<'py, PyAny>,
        dq: &Bound<'py, PyAny>,
        tau: &Bound<'py, PyAny>,
    ) -> PyResult<Array1<'py>> {
        let state = self.moving(q, dq)?;
        let tau = vector("tau", tau, self.n())?;
        Ok(array1(q.py(), &state.forward_dynamics(&tau)))
    }

    /// Kinetic energy ½ q̇ᵀM q̇ [J].
    fn kinetic_energy(&self, q: &Bound<'_, PyAny>, dq: &Bound<'_, PyAny>) -> PyResult<f64> {
        Ok(self.moving(q, dq)?.kinetic_energy())
    }

    /// Potential energy in gravity [J]; 0 with every centre of mass at the height of the origin.
    fn potential_energy(&self, q: &Bound<'_, PyAny>) -> PyResult<f64> {
        Ok(self.at(q)?.potential_energy())
    }

    /// The split into task and null space at a state, with every matrix (eq. 6–15, corrected).
    ///
    /// The task is that of `jacobian`: the position of the tip in the plane, its pose in space.
    ///
    /// Parameters
    /// ----------
    /// q, dq : (n,) array_like
    ///     Joint positions [rad or m] and velocities.
    fn extended_jacobian(&self, q: Any<'_, '_>, dq: Any<'_, '_>) -> PyResult<ExtendedJacobian> {
        let state = self.moving(q, dq)?;
        let made = self.dense(q.py(), MATRICES, || state.extended_jacobian())?;
        ExtendedJacobian::of(made)
    }

    /// The arm as MJCF, for MuJoCo; see `vffnull.engines.export.to_mjcf`.
    #[pyo3(signature = (name=None))]
    fn to_mjcf(slf: &Bound<'_, Self>, name: Option<&str>) -> PyResult<String> {
        exported(slf, "to_mjcf", name)
    }

    /// The arm as URDF; see `vffnull.engines.export.to_urdf`.
    #[pyo3(signature = (name=None))]
    fn to_urdf(slf: &Bound<'_, Self>, name: Option<&str>) -> PyResult<String> {
        exported(slf, "to_urdf", name)
    }

    fn _repr_html_(slf: &Bound<'_, Self>) -> PyResult<Option<String>> {
        let representation = slf.py().import("vffnull._support.representation")?;
        representation.call_method1("html", (slf,))?.extract()
    }

    /// The arm as a part of a scenario document; no other file is needed to make it again.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        table_to_dict(py, &self.document)
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.document == other.document
    }

    fn __hash__(&self) -> u64 {
        use std::hash::{DefaultHasher, Hash, Hasher};
        let mut hasher = DefaultHasher::new();
        self.document.to_string().hash(&mut hasher);
        hasher.finish()
    }

    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyDict>,))> {
        let rebuild = py.get_type::<Self>().getattr("_from_dict")?;
        Ok((rebuild, (self.to_dict(py)?,)))
    }

    #[staticmethod]
    fn _from_dict(document: &Bound<'_, PyAny>) -> PyResult<Self> {
        Self::read(document.py(), crate::convert::document(document)?)
    }

    fn __repr__(&self) -> String {
        summary(&self.arm)
    }
}
