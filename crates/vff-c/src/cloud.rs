//! Clouds of points from another thread.

use crate::controller::{Controller, with};
use crate::ffi_guard::{free, guarded, object, place};
use crate::mailbox::Mailbox;
use crate::status::{Fault, Status};
use std::slice;
use std::sync::Arc;
use vff_core::runtime::points::{PointUpdate, make};
use vff_core::world::space::Points;

/// Where the points of a cloud come from. Any thread may use it, also while another is in a call with the controller.
#[derive(Debug)]
pub struct Cloud {
    mailbox: Arc<Mailbox<Points>>,
    /// The orientation of the obstacle.
    orientation: [f64; 4],
    most: usize,
}

/// A handle by which other threads replace the points of obstacle `id`, `shape = { kind = "points", … }` in its TOML, by at most
/// `most` others (50 000). Allocates room for them, so that no later torque does; observe the state again before the next
/// torque. Free it with `vff_cloud_free`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_controller_cloud(
    controller: *mut Controller,
    id: u32,
    most: usize,
    cloud: *mut *mut Cloud,
) -> Status {
    // SAFETY: pointers as C has them.
    unsafe {
        with(controller, |inner| {
            let cloud = place("cloud", cloud)?;
            let j = inner.place_of(id)?;
            let orientation = inner.controller.orientation_of_points(j)?;
            inner.controller.make_room(j, most)?;
            inner.observed = false;
            let known = inner.clouds.iter().find(|(of, _)| *of == id).map(|(_, m)| Arc::clone(m));
            let mailbox = known.unwrap_or_else(|| {
                let new = Arc::new(Mailbox::new());
                inner.clouds.push((id, Arc::clone(&new)));
                new
            });
            cloud.write(Box::into_raw(Box::new(Cloud { mailbox, orientation, most })));
            Ok(())
        })
    }
}

/// Replaces the points of the cloud by these, `count` times (x, y, z) [m], relative to the obstacle's position. They take effect
/// together in the next `vff_controller_observe`, unless others are sent before. Prepares them here, in the calling thread, and
/// neither waits for the loop nor lets it wait. Allocates, and frees the points of before.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_cloud_update(
    cloud: *const Cloud,
    points: *const f64,
    count: usize,
) -> Status {
    // SAFETY: pointers as C has them.
    guarded(|| unsafe {
        let cloud = open(cloud, count)?;
        send(cloud, PointUpdate::from(vectors("points", points, count)?))
    })
}

/// The same of points that were there at time `t` [s], on the clock of `vff_controller_observe`, and go on from there at
/// `velocities`, `count` times (x, y, z) [m/s], until others take their place.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_cloud_update_moving(
    cloud: *const Cloud,
    points: *const f64,
    velocities: *const f64,
    count: usize,
    t: f64,
) -> Status {
    // SAFETY: pointers as C has them.
    guarded(|| unsafe {
        let cloud = open(cloud, count)?;
        let points = vectors("points", points, count)?;
        let velocities = vectors("velocities", velocities, count)?;
        if !t.is_finite() {
            return Err(Fault::NotFinite { name: "t", index: 0, value: t });
        }
        send(cloud, PointUpdate { points, velocities, time: Some(t) })
    })
}

/// The cloud, where there is room in it for so many points.
///
/// # Safety
/// The pointer is NULL or that of a cloud that lives as long as the call.
pub(crate) unsafe fn open<'a>(cloud: *const Cloud, count: usize) -> Result<&'a Cloud, Fault> {
    // SAFETY: as the caller promises.
    let cloud = unsafe { object("cloud", cloud) }?;
    if cloud.mailbox.is_closed() {
        return Err(Fault::Gone);
    }
    match count > cloud.most {
        true => Err(Fault::Room { most: cloud.most, given: count }),
        false => Ok(cloud),
    }
}

/// So many vectors, all of them finite.
///
/// # Safety
/// The pointer is NULL or that of three numbers each.
pub(crate) unsafe fn vectors(
    name: &'static str,
    given: *const f64,
    count: usize,
) -> Result<Vec<[f64; 3]>, Fault> {
    let given: &[[f64; 3]] = match (given.is_null(), count) {
        (_, 0) => &[],
        (true, _) => return Err(Fault::Null(name)),
        // SAFETY: as the caller promises.
        (false, _) => unsafe { slice::from_raw_parts(given.cast(), count) },
    };
    match given.as_flattened().iter().position(|x| !x.is_finite()) {
        Some(index) => Err(Fault::NotFinite { name, index, value: given.as_flattened()[index] }),
        None => Ok(given.to_vec()),
    }
}

pub(crate) fn send(
    Cloud { mailbox, orientation, .. }: &Cloud,
    update: PointUpdate,
) -> Result<(), Fault> {
    mailbox.send(make(update, *orientation)?);
    Ok(())
}

/// Frees the handle, not the cloud. NULL is nothing.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vff_cloud_free(cloud: *mut Cloud) {
    // SAFETY: pointers as C has them.
    unsafe { free(cloud) }
}
