//! From pictures of depth cameras to a cloud of points.

use crate::cloud::{Cloud, open, send, vectors};
use crate::ffi_guard::{free, guarded, numbers, object, place, room, text};
use crate::robot::{Robot, hand_out};
use crate::status::{Fault, Status};
use std::ffi::c_char;
use std::mem::size_of;
use std::ptr;
use std::sync::{Mutex, TryLockError};
use vff_core::perception::{Counts, Depth, Perceiver as Core, PerceptionError};
use vff_core::runtime::points::PointUpdate;
use vff_core::runtime::read_perceiver;
use vff_core::scenario::parse_toml;

/// Makes a cloud of moving points of what depth cameras see around an arm. One thread at a time may use it, beside the loop; a call
/// that finds another one in progress comes to `VFF_STATUS_BUSY`. All of its calls allocate.
#[derive(Debug)]
pub struct Perceiver {
    inner: Mutex<Core>,
    joints: usize,
}

/// What became of the points of a picture.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PictureCounts {
    /// Pixels that were looked at and had a depth.
    pub measured: usize,
    /// Of these those that were cut away as the arm.
    pub own: usize,
    /// Of these those that there was no room for.
    pub left_out: usize,
    /// Cells that are remembered, and not seen in this picture.
    pub remembered: usize,
}

/// Does something with a perceiver that no other thread uses.
///
/// # Safety
/// The pointer is NULL or that of a perceiver that lives as long as the call.
unsafe fn with(
    perceiver: *const Perceiver,
    work: impl FnOnce(&mut Core, usize) -> Result<(), Fault>,
) -> Status {
    guarded(|| {
        // SAFETY: as the caller promises.
        let Perceiver { inner, joints } = unsafe { object("perceiver", perceiver) }?;
        match inner.try_lock() {
            Ok(mut core) => work(&mut core, *joints),
            Err(TryLockError::WouldBlock) => Err(Fault::Busy("perceiver")),
            Err(TryLockError::Poisoned(_)) => Err(Fault::Broken("perceiver")),
        }
    })
}

/// A perceiver around a robot in space, from TOML: tables `cameras` with `columns`, `rows`, `focal`, `centre`, `distortion` (k₁, k₂, p₁,
/// p₂, k₃), `position` [m] and `orientation` (w, x, y, z) of a frame whose z looks forward and y down; a table `settings`, those of
/// `vffnull.Perceiver`; and tables `known`, obstacles that the cloud does not repeat. Free it with `vff_perceiver_free`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_perceiver_new(
    robot: *const Robot,
    toml: *const c_char,
    perceiver: *mut *mut Perceiver,
) -> Status {
    // SAFETY: pointers as C has them.
    guarded(|| unsafe {
        let (arm, to) = (&object("robot", robot)?.arm, place("perceiver", perceiver)?);
        let made = read_perceiver(arm, &parse_toml(text("toml", toml)?)?);
        let wrapped = made.map(|core| Perceiver { inner: Mutex::new(core), joints: arm.dof() });
        hand_out(wrapped.map_err(Fault::from), to)
    })
}

/// Takes in a state of the arm at time `t` [s], later than the last. A picture needs one near its time.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_perceiver_observe(
    perceiver: *const Perceiver,
    t: f64,
    q: *const f64,
    dq: *const f64,
    joints: usize,
) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(perceiver, |core, expected| {
            let q = numbers("q", q, joints, expected)?;
            let dq = numbers("dq", dq, joints, expected)?;
            Ok(core.observe(t, q, dq)?)
        })
    }
}

/// Takes in a picture that a camera took at time `t` [s], in whole millimetres; 0 was not measured. Rows begin `row_bytes` bytes after each
/// other: `2 * columns`, or what a driver calls step or stride. `counts` may be NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_perceiver_see_millimetres(
    perceiver: *const Perceiver,
    camera: usize,
    t: f64,
    depth: *const u16,
    rows: usize,
    columns: usize,
    row_bytes: usize,
    counts: *mut PictureCounts,
) -> Status {
    let look = |core: &mut Core, depths: &[u16]| core.see(camera, t, Depth::Millimetres(depths));
    // SAFETY: pointers as C has them.
    unsafe { see(perceiver, camera, (depth, [rows, columns, row_bytes]), counts, look) }
}

/// The same in metres; what is no positive number was not measured.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_perceiver_see_metres(
    perceiver: *const Perceiver,
    camera: usize,
    t: f64,
    depth: *const f32,
    rows: usize,
    columns: usize,
    row_bytes: usize,
    counts: *mut PictureCounts,
) -> Status {
    let look = |core: &mut Core, depths: &[f32]| core.see(camera, t, Depth::Metres(depths));
    // SAFETY: pointers as C has them.
    unsafe { see(perceiver, camera, (depth, [rows, columns, row_bytes]), counts, look) }
}

/// Writes what became of a picture, where somebody wants to know.
///
/// # Safety
/// The place is NULL or that of counts.
unsafe fn tell(found: Counts, counts: *mut PictureCounts) {
    let Counts { measured, own, left_out, remembered } = found;
    // SAFETY: as the caller promises.
    if let Ok(counts) = unsafe { place("counts", counts) } {
        counts.write(PictureCounts { measured, own, left_out, remembered });
    }
}

/// Takes in a picture of rows and columns, whose rows begin so many bytes after each other.
///
/// # Safety
/// As of `with`; the picture is NULL or as large as is said, and `counts` NULL or a place.
unsafe fn see<T: Copy + Default>(
    perceiver: *const Perceiver,
    camera: usize,
    (depth, [rows, columns, row_bytes]): (*const T, [usize; 3]),
    counts: *mut PictureCounts,
    look: impl FnOnce(&mut Core, &[T]) -> Result<Counts, PerceptionError>,
) -> Status {
    // SAFETY: as the caller promises.
    unsafe {
        with(perceiver, |core, _| {
            if depth.is_null() {
                return Err(Fault::Null("depth"));
            }
            if let Some(expected) = core.size(camera).filter(|size| *size != [rows, columns]) {
                return Err(Fault::Picture { expected, given: [rows, columns] });
            }
            let width = columns.saturating_mul(size_of::<T>());
            if row_bytes < width {
                return Err(Fault::RowBytes { expected: width, given: row_bytes });
            }
            // Of a camera that is not there no pixel is read.
            let known = core.size(camera).map_or(0, |_| rows);
            let mut depths = vec![T::default(); known * columns];
            for (row, to) in depths.chunks_exact_mut(columns.max(1)).enumerate() {
                let from = depth.cast::<u8>().add(row * row_bytes);
                // Rows may begin where no number of this size does.
                ptr::copy_nonoverlapping(from, to.as_mut_ptr().cast::<u8>(), width);
            }
            tell(look(core, &depths)?, counts);
            Ok(())
        })
    }
}

/// Takes in `count` points (x, y, z) [m] that a camera saw at time `t` [s], in its frame, as far as they are in its picture. `counts` may
/// be NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_perceiver_see_points(
    perceiver: *const Perceiver,
    camera: usize,
    t: f64,
    points: *const f64,
    count: usize,
    counts: *mut PictureCounts,
) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(perceiver, |core, _| {
            let points = vectors("points", points, count)?;
            tell(core.see_points(camera, t, &points)?, counts);
            Ok(())
        })
    }
}

/// The points, and their velocities.
fn moving(core: &Core) -> (Vec<[f64; 3]>, Vec<[f64; 3]>) {
    core.points().map(|(point, rate)| (<[f64; 3]>::from(point), <[f64; 3]>::from(rate))).unzip()
}

/// How many points there are, the time of the last picture [s], NaN before the first, and the radius at which balls at the points cover
/// what was seen [m]. Each may be NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_perceiver_size(
    perceiver: *const Perceiver,
    count: *mut usize,
    t: *mut f64,
    radius: *mut f64,
) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(perceiver, |core, _| {
            if let Ok(count) = place("count", count) {
                count.write(core.points().count());
            }
            if let Ok(t) = place("t", t) {
                t.write(core.last().unwrap_or(f64::NAN));
            }
            if let Ok(radius) = place("radius", radius) {
                radius.write(core.radius());
            }
            Ok(())
        })
    }
}

/// Writes the points at the time of the last picture [m], and with which velocities they go on [m/s]: x, y, z of each, `count` of them as
/// `vff_perceiver_size` says. `velocities` may be NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_perceiver_points(
    perceiver: *const Perceiver,
    points: *mut f64,
    velocities: *mut f64,
    count: usize,
) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(perceiver, |core, _| {
            let (places, rates) = moving(core);
            let expected = 3 * places.len();
            let out = room("points", points, count.saturating_mul(3), expected)?;
            let rates_out = match velocities.is_null() {
                true => None,
                false => Some(room("velocities", velocities, expected, expected)?),
            };
            out.fill(places.as_flattened());
            if let Some(rates_out) = rates_out {
                rates_out.fill(rates.as_flattened());
            }
            Ok(())
        })
    }
}

/// Replaces the points of a cloud by those of the last picture, with their velocities. The obstacle stands at the origin, and the
/// controller's times are those of the states.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_perceiver_send(
    perceiver: *const Perceiver,
    cloud: *const Cloud,
) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(perceiver, |core, _| {
            let (points, velocities) = moving(core);
            let cloud = open(cloud, points.len())?;
            send(cloud, PointUpdate { points, velocities, time: core.last() })
        })
    }
}

/// NULL is nothing.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_perceiver_free(perceiver: *mut Perceiver) {
    // SAFETY: pointers as C has them.
    unsafe { free(perceiver) }
}
