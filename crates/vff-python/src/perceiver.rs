//! `Perceiver`: from pictures of depth cameras to a cloud of points that move.

use crate::arm::Arm;
use crate::call::{finite_time, read_obstacles_of, sequence};
use crate::convert::{
    any_array, any_vector, array2, count, float_array, misshapen, number, points, read_matrix,
    read_vector, wrong_type,
};
use crate::errors::{InputError, InputTypeError};
use crate::exclusive::Exclusive;
use crate::loading::load_numpy;
use crate::watch::{attended, interruptible};
use numpy::{PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::Arc;
use vff_core::perception::{
    Counts, Depth, DepthCamera, Perceiver as Core, PerceiverSettings, PerceptionError,
};
use vff_core::robot::SpatialArm;
use vff_core::runtime::{AnyArm, AnyObstacles};
use vff_core::settings::Table;

type Array2<'py> = Bound<'py, PyArray2<f64>>;
type Cloud<'py> = (Array2<'py>, Array2<'py>, Option<f64>);

fn fault(error: &PerceptionError) -> PyErr {
    InputError::new_err(error.to_string())
}

/// From pictures of depth cameras to a cloud of points that move: what is there that nobody has said.
///
/// One call for each picture, beside the control cycle, in a thread of its own. What a picture shows of the
/// arm is cut away, what is left is remembered in cells of a grid until it is seen through or its time is
/// up, and cells that hang together are followed, so that each point has a velocity
/// (docs/theory-spatial.md, T181 to T184, T197).
///
/// Parameters
/// ----------
/// arm : Arm
///     An arm in space, with its tool and what it carries among its ``collision`` shapes.
/// cameras : sequence of dict
///     ``columns``, ``rows``, ``focal`` and ``centre`` (2,) [pixels], ``distortion`` k1, k2, p1, p2, k3 in
///     the order of OpenCV, none by default, ``position`` (3,) [m] and ``orientation`` (4,): a quaternion
///     [w, x, y, z] of its frame in the world, z forward, x to the right of the picture, y down.
/// settings : dict, optional
///     ``room``: opposite corners of what is looked at, in the world (2, 3) [m], from (-1, -1, -0.2) to (1,
///     1, 1.4); ``voxel``: the side of a cell, 0.02 m; ``most_voxels``: 25000 of them are remembered at most;
///     ``stride``: every 2nd row and column is looked at; ``range``: up to 3 m deep; ``least_points``: 2 in a
///     cell or more count, or half of the pixels that look at one that is far away; ``memory``: for 2 s what
///     is hidden is remembered; ``margin``: 0.02 m around the arm are cut away, and as much more as it moves
///     in ``time_error``, 0.02 s; ``time_offset``: 0 s are added to times of pictures; ``latest_state``: one
///     of the arm is known within 0.05 s; ``depth_error``: 0.005 m at 1 m; ``hidden``, 0 m: bodies up to this
///     wide are taken for as deep as they are wide, and have points on the side that is not seen, round ones
///     all around;
///     ``known_margin``: 0.02 m around what is known are left out; ``settling``: what is in its place for 1 s
///     counts as standing; ``acceleration``, 3 m/s^2, ``speed``, 1 m/s, and ``track_error``, 0.002 m:
///     standard deviations of bodies that are followed. The numbers are the defaults.
/// known : sequence of Obstacle or dict, optional
///     What stands around and the controller knows of: it is not seen again. What moves is refused.
///
/// Raises
/// ------
/// vffnull.errors.InputError
///     If a camera or a setting is of no use, the arm is in the plane or does not reach into the room, or
///     something that is known moves.
///
/// Examples
/// --------
/// >>> import numpy as np
/// >>> camera = {"columns": 80, "rows": 60, "focal": [75, 75], "centre": [39.5, 29.5],
/// ...           "position": [0.6, 0.0, 1.5], "orientation": [0, 1, 0, 0]}
/// >>> perceiver = Perceiver(Arm.named("panda"), [camera], {"stride": 1})
/// >>> perceiver.observe(0.0, [0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8], [0.0] * 7)
/// >>> counts = perceiver.see(np.full((60, 80), 1000, dtype=np.uint16), t=0.0)  # a board at 0.5 m
/// >>> counts["measured"], counts["own"] > 0, float(perceiver.points[:, 2].min())
/// (4800, True, 0.5)
#[pyclass(frozen, module = "vffnull")]
pub struct Perceiver {
    n: usize,
    inner: Exclusive<Core>,
}

impl Perceiver {
    /// Does something with it, with the GIL released.
    fn with<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut Core) -> Result<T, PerceptionError> + Send,
    ) -> PyResult<T> {
        let mut inner = self.inner.take(py)?;
        let core = &mut *inner;
        py.detach(|| work(core)).map_err(|error| fault(&error))
    }

    /// Does something with a picture and it, with the GIL released.
    fn with_depths<T: Send>(
        &self,
        py: Python<'_>,
        camera: usize,
        depth: &Bound<'_, PyAny>,
        work: impl FnOnce(&mut Core, Depth<'_>) -> Result<T, PerceptionError> + Send,
    ) -> PyResult<T> {
        let shape = self.inner.take(py)?.size(camera);
        let check = |given: &[usize]| match shape {
            Some([rows, columns]) if given != [rows, columns] => {
                Err(misshapen("depth", given, &format!("({rows}, {columns})")))
            }
            _ => Ok(()),
        };
        let (mut given, mut kind) = any_array("depth", depth)?;
        if kind == "O" {
            // As what NumPy makes of its numbers: whole ones are no metres here either.
            (given, kind) = any_array("depth", &given.call_method0("tolist")?)?;
        }
        if "iub".contains(&kind) {
            let dtype: String = given.getattr("dtype")?.getattr("name")?.extract()?;
            if dtype != "uint16" {
                let sentence = format!(
                    "depth: expected uint16, which are millimetres, or floats, which are metres, got {dtype}"
                );
                return Err(InputTypeError::new_err(sentence));
            }
            // A copy in rows, aligned and in the byte order of this machine.
            let rows =
                given.call_method1("astype", ("=u2", "C"))?.cast_into::<PyArrayDyn<u16>>()?;
            check(rows.shape())?;
            let rows = rows.readonly();
            let depths = rows.as_slice()?;
            return self.with(py, |core| work(core, Depth::Millimetres(depths)));
        }
        let given = float_array("depth", &given)?;
        check(given.shape())?;
        let rows = given.readonly();
        let numbers = rows.as_slice()?;
        self.with(py, |core| {
            #[expect(clippy::cast_possible_truncation, reason = "a depth")]
            let depths: Vec<f32> = numbers.iter().map(|depth| *depth as f32).collect();
            work(core, Depth::Metres(&depths))
        })
    }

    /// The points of the cloud and their velocities, (k, 3) each, and the time of it.
    fn moving<'py>(&self, py: Python<'py>) -> PyResult<Cloud<'py>> {
        let inner = self.inner.take(py)?;
        let (points, velocities): (Vec<_>, Vec<_>) = inner
            .points()
            .map(|(point, velocity)| (<[f64; 3]>::from(point), <[f64; 3]>::from(velocity)))
            .unzip();
        let t = inner.last();
        drop(inner);
        let shape = [points.len(), 3];
        let points = array2(py, points.into_flattened(), shape)?;
        Ok((points, array2(py, velocities.into_flattened(), shape)?, t))
    }
}

fn number_of(camera: Option<&Bound<'_, PyAny>>) -> PyResult<usize> {
    let camera = camera.map_or(Ok(0), |camera| count("camera", camera))?;
    Ok(usize::try_from(camera).unwrap_or(usize::MAX))
}

/// A camera as it is described.
fn eye(number: usize, given: &Bound<'_, PyAny>) -> PyResult<DepthCamera> {
    const KEYS: [&str; 7] =
        ["columns", "rows", "focal", "centre", "distortion", "position", "orientation"];
    let of = |key: &str| format!("cameras[{number}].{key}");
    let given = given
        .cast::<PyDict>()
        .map_err(|_| wrong_type(&format!("cameras[{number}]: expected a dict"), given))?;
    for key in given.keys() {
        let key: String = key.extract()?;
        if !KEYS.contains(&key.as_str()) {
            let sentence = format!("{}: unknown, expected {}", of(&key), KEYS.join(", "));
            return Err(InputError::new_err(sentence));
        }
    }
    let required = |key: &str| {
        given.get_item(key)?.ok_or_else(|| InputError::new_err(format!("{}: missing", of(key))))
    };
    let pixels = |key: &str| {
        Ok::<_, PyErr>(usize::try_from(count(&of(key), &required(key)?)?).unwrap_or(usize::MAX))
    };
    let mut camera = DepthCamera {
        columns: pixels("columns")?,
        rows: pixels("rows")?,
        focal: [0.0; 2],
        centre: [0.0; 2],
        distortion: [0.0; 5],
        position: [0.0; 3],
        orientation: [1.0, 0.0, 0.0, 0.0],
    };
    read_vector(&of("focal"), &required("focal")?, &mut camera.focal)?;
    read_vector(&of("centre"), &required("centre")?, &mut camera.centre)?;
    let optional = [
        ("distortion", &mut camera.distortion[..]),
        ("position", &mut camera.position[..]),
        ("orientation", &mut camera.orientation[..]),
    ];
    for (key, out) in optional {
        if let Some(value) = given.get_item(key)? {
            read_vector(&of(key), &value, out)?;
        }
    }
    Ok(camera)
}

/// Settings, each by its name.
fn read_settings(given: &Bound<'_, PyAny>) -> PyResult<PerceiverSettings> {
    let given =
        given.cast::<PyDict>().map_err(|_| wrong_type("settings: expected a dict", given))?;
    let mut settings = PerceiverSettings::default();
    for (key, value) in given {
        let key: String = key.extract()?;
        let name = format!("settings.{key}");
        if key == "room" {
            let corners = read_matrix(&name, &value, [2, 3])?;
            let (corners, _) = corners.as_chunks::<3>();
            settings.room = [corners[0], corners[1]];
        } else if !PerceiverSettings::KEYS.iter().any(|known| known.name == key) {
            let known: Vec<_> = PerceiverSettings::KEYS.iter().map(|known| known.name).collect();
            let sentence = format!("{name}: unknown, expected {}", known.join(", "));
            return Err(InputError::new_err(sentence));
        } else {
            let number = number(&name, &value)?;
            if !settings.set(&key, number) {
                let sentence = format!("{name}: must be a whole number, got {number}");
                return Err(InputError::new_err(sentence));
            }
        }
    }
    Ok(settings)
}

/// The arm in space that somebody gives.
fn in_space(arm: &Bound<'_, PyAny>) -> PyResult<Arc<SpatialArm>> {
    let arm = arm.cast::<Arm>().map_err(|_| wrong_type("arm: expected an Arm", arm))?.get();
    let AnyArm::Space(arm) = &arm.arm else {
        let sentence = "arm: cameras look at arms in space, and this one is in the plane";
        return Err(InputError::new_err(sentence));
    };
    Ok(Arc::clone(arm))
}

fn told(py: Python<'_>, counts: Counts) -> PyResult<Bound<'_, PyDict>> {
    let Counts { measured, own, left_out, remembered } = counts;
    let found = PyDict::new(py);
    for (name, count) in
        [("measured", measured), ("own", own), ("left_out", left_out), ("remembered", remembered)]
    {
        found.set_item(name, count)?;
    }
    Ok(found)
}

#[pymethods]
impl Perceiver {
    #[new]
    #[pyo3(signature = (arm, cameras, settings=None, known=None), text_signature = "(arm, cameras, settings=None, known=())")]
    fn new(
        arm: &Bound<'_, PyAny>,
        cameras: &Bound<'_, PyAny>,
        settings: Option<&Bound<'_, PyAny>>,
        known: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let py = arm.py();
        load_numpy(py)?;
        let arm = &in_space(arm)?;
        let eyes = cameras
            .try_iter()?
            .enumerate()
            .map(|(number, camera)| eye(number, &camera?))
            .collect::<PyResult<_>>()?;
        let settings = settings.map_or_else(|| Ok(PerceiverSettings::default()), read_settings)?;
        let known = known.map(|known| sequence("known", known)).transpose()?.unwrap_or_default();
        let nothing = AnyObstacles::Space(vec![]);
        let AnyObstacles::Space(known) =
            read_obstacles_of("known", nothing, &known, AnyObstacles::read)?
        else {
            return Err(InputError::new_err("known: expected obstacles in space"));
        };
        let made = interruptible(py, || Core::new(arm, eyes, settings, known))?;
        let core = made.map_err(|error| fault(&error))?;
        Ok(Self { n: arm.dof(), inner: Exclusive::new("Perceiver", core) })
    }

    /// Take in a state of the arm. The last 512 are kept; a picture needs one near its time.
    ///
    /// Waits while a picture is taken in: call it in the thread of the pictures, with the states that a loop
    /// hands over.
    ///
    /// Parameters
    /// ----------
    /// t : float
    ///     When it was measured [s], later than the last. One more than a second later has leapt: up to
    ///     sixteen of them are dropped by one that goes on where they leapt from, within a second of it.
    /// q, dq : (n,) array_like
    ///     Joint angles [rad] and velocities [rad/s].
    ///
    /// Raises
    /// ------
    /// vffnull.errors.InputError
    ///     If the time is not later than the last, or an array has the wrong shape or is not finite.
    fn observe(
        &self,
        py: Python<'_>,
        t: &Bound<'_, PyAny>,
        q: &Bound<'_, PyAny>,
        dq: &Bound<'_, PyAny>,
    ) -> PyResult<()> {
        let t = number("t", t)?;
        let (q, dq) = (any_vector("q", q, self.n)?, any_vector("dq", dq, self.n)?);
        self.inner.take(py)?.observe(t, &q, &dq).map_err(|error| fault(&error))
    }

    /// Go on around another arm: the same one with the load that it has taken up, or with another tool.
    ///
    /// What is seen of it is cut away from the next picture on, and what was seen before where arm and load
    /// are now is forgotten. What else there is of states and cloud stays as it is.
    ///
    /// Parameters
    /// ----------
    /// arm : Arm
    ///     An arm in space with as many joints.
    ///
    /// Raises
    /// ------
    /// vffnull.errors.InputError
    ///     If it is in the plane, or has another number of joints.
    ///
    /// Examples
    /// --------
    /// >>> camera = {"columns": 80, "rows": 60, "focal": [75, 75], "centre": [39.5, 29.5],
    /// ...           "position": [0.6, 0.0, 1.5], "orientation": [0, 1, 0, 0]}
    /// >>> panda = Arm.named("panda")
    /// >>> perceiver = Perceiver(panda, [camera])
    /// >>> perceiver.set_arm(panda.with_load(0.7, com=[0.0, 0.0, 0.05]))
    fn set_arm(&self, arm: &Bound<'_, PyAny>) -> PyResult<()> {
        let (py, arm) = (arm.py(), in_space(arm)?);
        self.with(py, |core| core.set_arm(&arm))
    }

    /// Begin anew, without a state, a picture or a point, as where a clock begins anew.
    ///
    /// Examples
    /// --------
    /// >>> camera = {"columns": 80, "rows": 60, "focal": [75, 75], "centre": [39.5, 29.5],
    /// ...           "position": [0.6, 0.0, 1.5], "orientation": [0, 1, 0, 0]}
    /// >>> perceiver = Perceiver(Arm.named("panda"), [camera])
    /// >>> perceiver.observe(5.0, [0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8], [0.0] * 7)
    /// >>> perceiver.forget()
    /// >>> perceiver.observe(0.0, [0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8], [0.0] * 7)
    fn forget(&self, py: Python<'_>) -> PyResult<()> {
        self.inner.take(py)?.forget();
        Ok(())
    }

    /// Take in a picture, with the GIL released.
    ///
    /// Parameters
    /// ----------
    /// depth : (rows, columns) array_like
    ///     Depths along the optical axis: uint16 are millimetres, in either byte order, and floats metres.
    ///     What is 0 or no positive number was not measured.
    /// t : float
    ///     When it was taken [s]; with ``time_offset`` added, on the clock of the states.
    /// camera : int, optional
    ///     Which camera took it; the first by default.
    ///
    /// Returns
    /// -------
    /// dict
    ///     Counts of pixels that were looked at and have a depth, ``measured``; of those of the arm, ``own``;
    ///     of those that there was no room for, ``left_out``; and of cells that are ``remembered``, not seen.
    ///
    /// Raises
    /// ------
    /// vffnull.errors.InputError
    ///     If there is no such camera, the picture has another shape or is not later than its last one, or no
    ///     state of the arm is near its time. Nothing has changed then.
    /// vffnull.errors.InputTypeError
    ///     If it has whole numbers that are not uint16, whose unit nobody knows, or is masked.
    #[pyo3(signature = (depth, t, camera=None), text_signature = "($self, depth, t, camera=0)")]
    fn see<'py>(
        &self,
        py: Python<'py>,
        depth: &Bound<'py, PyAny>,
        t: &Bound<'py, PyAny>,
        camera: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let (camera, t) = (number_of(camera)?, finite_time(Some(t))?);
        let counts =
            self.with_depths(py, camera, depth, |core, depth| core.see(camera, t, depth))?;
        told(py, counts)
    }

    /// Take in a cloud of points that a camera saw, as far as they are in its picture.
    ///
    /// As dense as it was measured: of a cloud that was thinned, hardly a cell has ``least_points``.
    ///
    /// Parameters
    /// ----------
    /// cloud : (k, 3) array_like
    ///     Points in the frame of the camera [m]: z forward, x to the right, y down.
    /// t : float
    ///     When they were seen [s]; with ``time_offset`` added, on the clock of the states.
    /// camera : int, optional
    ///     Which camera saw them; the first by default.
    ///
    /// Returns
    /// -------
    /// dict
    ///     Counts, as of `see`.
    ///
    /// Raises
    /// ------
    /// vffnull.errors.InputError
    ///     As of `see`; if they are not points in space, or not finite.
    #[pyo3(signature = (cloud, t, camera=None), text_signature = "($self, cloud, t, camera=0)")]
    fn see_points<'py>(
        &self,
        py: Python<'py>,
        cloud: &Bound<'py, PyAny>,
        t: &Bound<'py, PyAny>,
        camera: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let (camera, t) = (number_of(camera)?, finite_time(Some(t))?);
        let given = points("cloud", cloud)?;
        told(py, self.with(py, |core| core.see_points(camera, t, &given))?)
    }

    /// The points of a picture in the frame of its camera, of the pixels that `see` looks at.
    ///
    /// Parameters
    /// ----------
    /// depth : (rows, columns) array_like
    ///     Depths, as of `see`.
    /// camera : int, optional
    ///     Which camera took it; the first by default.
    ///
    /// Returns
    /// -------
    /// (k, 3) ndarray
    ///     Points [m]: z forward, x to the right, y down.
    ///
    /// Raises
    /// ------
    /// vffnull.errors.InputError
    ///     If there is no such camera, or the picture has another shape.
    #[pyo3(signature = (depth, camera=None), text_signature = "($self, depth, camera=0)")]
    fn deproject<'py>(
        &self,
        py: Python<'py>,
        depth: &Bound<'py, PyAny>,
        camera: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Array2<'py>> {
        let camera = number_of(camera)?;
        let found =
            self.with_depths(py, camera, depth, |core, depth| core.deproject(camera, depth))?;
        let rows = found.len();
        array2(py, found.into_flattened(), [rows, 3])
    }

    /// What is there, (k, 3) [m], at time `t`: the cloud for `Controller.update_points`.
    #[getter]
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py>> {
        Ok(self.moving(py)?.0)
    }

    /// At which velocities the points go on, (k, 3) [m/s].
    #[getter]
    fn velocities<'py>(&self, py: Python<'py>) -> PyResult<Array2<'py>> {
        Ok(self.moving(py)?.1)
    }

    /// All of this at once for `Controller.update_points`: points (k, 3) [m], velocities (k, 3) [m/s] and
    /// the time [s] at which they were there, None before the first picture.
    ///
    /// Read one by one, `points`, `velocities` and `t` may be of different pictures where another thread
    /// takes them in.
    ///
    /// Examples
    /// --------
    /// >>> camera = {"columns": 80, "rows": 60, "focal": [75, 75], "centre": [39.5, 29.5],
    /// ...           "position": [0.6, 0.0, 1.5], "orientation": [0, 1, 0, 0]}
    /// >>> perceiver = Perceiver(Arm.named("panda"), [camera])
    /// >>> points, velocities, t = perceiver.cloud
    /// >>> points.shape, velocities.shape, t
    /// ((0, 3), (0, 3), None)
    #[getter]
    fn cloud<'py>(&self, py: Python<'py>) -> PyResult<Cloud<'py>> {
        self.moving(py)
    }

    /// When the last picture was taken [s], on the clock of the states; None before the first.
    #[getter]
    fn t(&self, py: Python<'_>) -> PyResult<Option<f64>> {
        Ok(self.inner.take(py)?.last())
    }

    /// A radius with which balls at the points cover what is seen [m], and to a tenth of it what is round:
    /// half a cell's diagonal.
    #[getter]
    fn radius(&self, py: Python<'_>) -> PyResult<f64> {
        Ok(self.inner.take(py)?.radius())
    }

    /// The bodies that are followed, each a dict: its ``number``, the ``camera`` that follows it,
    /// ``position`` [m] and ``velocity`` [m/s] at time ``t`` [s], ``covariance`` of place and velocity
    /// (2, 2), the same for each coordinate, ``angular_velocity`` [rad/s] of what is long and turns for
    /// certain, in how many pictures it was ``seen``, whether it ``moves`` for certain, and whether it goes
    /// on where the picture or the room ends, ``cut``: its velocity is then that of its sides.
    #[getter]
    fn tracks<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let tracks = self.inner.take(py)?.tracks();
        let told = |track: vff_core::perception::Track| {
            let found = PyDict::new(py);
            found.set_item("number", track.number)?;
            found.set_item("camera", track.camera)?;
            found.set_item("position", PyArray1::from_slice(py, track.position.as_slice()))?;
            found.set_item("velocity", PyArray1::from_slice(py, track.velocity.as_slice()))?;
            let turning = PyArray1::from_slice(py, track.angular_velocity.as_slice());
            found.set_item("angular_velocity", turning)?;
            let [place, both, speed] = track.covariance;
            found.set_item("covariance", array2(py, vec![place, both, both, speed], [2, 2])?)?;
            found.set_item("t", track.time)?;
            found.set_item("seen", track.seen)?;
            found.set_item("moves", track.is_moving())?;
            found.set_item("cut", track.is_cut)?;
            Ok(found)
        };
        attended(|| tracks.into_iter().map(told).collect())?
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let inner = self.inner.take(py)?;
        let (cameras, points) = (inner.cameras(), inner.points().count());
        Ok(format!("<Perceiver: {cameras} cameras, {points} points>"))
    }
}
