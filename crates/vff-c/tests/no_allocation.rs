//! What is for the loop neither allocates nor frees: a counting allocator watches the thread of the loop, while another one
//! sends clouds.

mod limits;

use limits::set_point_limits;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::ffi::{CStr, CString};
use std::ptr::{null, null_mut};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread;
use vffnull::*;

struct Counting;

thread_local! {
    static COUNT: Cell<usize> = const { Cell::new(0) };
}

// SAFETY: every call is passed on to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.with(|count| count.set(count.get() + 1));
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        COUNT.with(|count| count.set(count.get() + 1));
        unsafe { System.dealloc(pointer, layout) }
    }
    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        COUNT.with(|count| count.set(count.get() + 1));
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// How often memory is asked for or given back.
fn touches(of: impl FnOnce()) -> usize {
    let before = COUNT.with(Cell::get);
    of();
    COUNT.with(Cell::get) - before
}

/// Ends the other thread, also when this one fails.
struct Over<'a>(&'a AtomicBool);

impl Drop for Over<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

const READY: [f64; 7] = [0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8];
const SPHERE: &str = "shape = { kind = 'sphere', radius = 0.08 }\nposition = [-0.05, -0.3, 0.62]";
const CLOUD: &str =
    "shape = { kind = 'points', points = [], radius = 0.01 }\nposition = [0.5, 0.25, 0.6]";
const MOST: usize = 300;

/// A Panda with these settings, a sphere and an empty cloud; its ids are 0 and 1.
fn panda(settings: &str) -> (*mut Controller, *mut Cloud) {
    let (mut robot, mut controller, mut cloud) = (null_mut(), null_mut(), null_mut());
    let [settings, sphere, points] =
        [settings, SPHERE, CLOUD].map(|text| CString::new(text).unwrap());
    let mut id = 7;
    // SAFETY: all pointers are to what lives, and arrays have the lengths that are given.
    unsafe {
        assert_eq!(vff_robot_named(c"panda".as_ptr(), &raw mut robot), Status::Ok);
        let made = vff_controller_new(robot, settings.as_ptr(), &raw mut controller);
        assert_eq!(made, Status::Ok, "{:?}", CStr::from_ptr(vff_last_message()));
        vff_robot_free(robot);
        assert_eq!(
            vff_controller_add_obstacle(controller, sphere.as_ptr(), &raw mut id),
            Status::Ok
        );
        assert_eq!(id, 0);
        assert_eq!(
            vff_controller_add_obstacle(controller, points.as_ptr(), null_mut()),
            Status::Ok
        );
        assert_eq!(vff_controller_cloud(controller, 1, MOST, &raw mut cloud), Status::Ok);
    }
    (controller, cloud)
}

#[test]
fn no_cycle_touches_the_heap() {
    let field = "field = { kind = 'bounded', gain = 20.0, influence = 0.25 }";
    let command = "command = { gravity = 'robot', torque_rate = 1000.0, coulomb_friction = 0.2, tip_speed = 0.3 }";
    let all = [
        format!("task = 'pose'\n{field}\n{command}"),
        format!("task = 'position'\ntank = {{ capacity = 1.0 }}\n{field}"),
        format!("task = 'pointing'\navoidance = 'relaxed'\n{field}"),
        format!("task = 'position'\navoidance = 'priority'\n{field}"),
        format!("task = 'pose'\navoidance = 'cbf'\n{field}"),
        format!(
            "task = 'pose'\navoidance = 'cbf'\nself_collision = 'avoid'\nyielding = {{ preview = {{ trigger = 1.2 }} }}\n{field}"
        ),
    ];
    for (settings, sets_points) in
        all.iter().flat_map(|settings| [(settings, false), (settings, true)])
    {
        let (controller, cloud) = panda(settings);
        let (over, sent) = (AtomicBool::new(false), AtomicUsize::new(0));
        let (shared, mut pushed) = (cloud as usize, 0.0);
        let limits = set_point_limits();
        // SAFETY: arrays have the lengths that are given.
        unsafe {
            let begun = match sets_points {
                false => vff_controller_begin(controller, 0.001, null(), 0),
                true => vff_controller_begin_set_points(
                    controller,
                    0.001,
                    &raw const limits,
                    READY.as_ptr(),
                    7,
                ),
            };
            assert_eq!(begun, Status::Ok);
        }
        thread::scope(|scope| {
            scope.spawn(|| {
                let cloud = shared as *mut Cloud;
                while !over.load(Ordering::Relaxed) {
                    let k = sent.fetch_add(1, Ordering::Relaxed);
                    let points: Vec<f64> =
                        (0..3 * (k % (MOST + 1))).map(|i| 0.002 * ((i + k) % 50) as f64).collect();
                    let count = points.len() / 3;
                    let velocities = vec![0.1; points.len()];
                    // At rest, and moving. SAFETY: so many points are there, and the handle lives.
                    let done = unsafe {
                        match k % 2 {
                            0 => vff_cloud_update(cloud, points.as_ptr(), count),
                            _ => vff_cloud_update_moving(
                                cloud,
                                points.as_ptr(),
                                velocities.as_ptr(),
                                count,
                                0.0,
                            ),
                        }
                    };
                    assert_eq!(done, Status::Ok);
                }
            });
            let _over = Over(&over);
            let (mut tau, mut pose, mut k) = ([0.0; 7], [0.0; 7], 0);
            let mut sizes = std::mem::MaybeUninit::uninit();
            let mut terms = std::mem::MaybeUninit::uninit();
            // Until clouds have come and gone many times.
            while k < 400 || sent.load(Ordering::Relaxed) < 100 {
                let count = touches(|| {
                    let t = 0.001 * f64::from(k);
                    let q = READY.map(|q| q + 0.1 * (0.5 * t).sin());
                    let place = [-0.05, -0.3 + 0.3 * t, 0.62];
                    // SAFETY: all pointers are to what lives, and arrays have the lengths that are given.
                    unsafe {
                        let c = controller;
                        let moved = vff_controller_move_obstacle(
                            c,
                            0,
                            t,
                            place.as_ptr(),
                            [0.0, 0.3, 0.0].as_ptr(),
                            3,
                        );
                        assert_eq!(moved, Status::Ok);
                        assert_eq!(
                            vff_controller_observe(c, t, q.as_ptr(), [0.1; 7].as_ptr(), 7),
                            Status::Ok
                        );
                        assert_eq!(vff_controller_sizes(c, sizes.as_mut_ptr()), Status::Ok);
                        let sizes = sizes.assume_init_ref();
                        if k % 7 == 0 {
                            assert_eq!(
                                vff_controller_pose(c, pose.as_mut_ptr(), sizes.pose),
                                Status::Ok
                            );
                            let rate = [0.01; 6];
                            let given = vff_controller_set_reference(
                                c,
                                pose.as_ptr(),
                                sizes.pose,
                                rate.as_ptr(),
                                sizes.rate,
                                null(),
                                0,
                            );
                            assert_eq!(given, Status::Ok);
                        }
                        assert_eq!(vff_controller_torque(c, tau.as_mut_ptr(), 7), Status::Ok);
                        assert_eq!(vff_controller_terms(c, terms.as_mut_ptr()), Status::Ok);
                        let terms: &Terms = terms.assume_init_ref();
                        pushed += std::slice::from_raw_parts(terms.force, 7).iter().sum::<f64>();
                        if k == 300 {
                            assert_eq!(vff_controller_reset(c), Status::Ok);
                        }
                        // A loop that is watched over, or of set points, whose state is missing at times.
                        let given = |x: &[f64; 7]| if k % 16 < 8 { x.as_ptr() } else { null() };
                        let mut phase = vff_phase::Lost;
                        let (at, moving) = (given(&q), given(&[0.1; 7]));
                        let sent = vff_controller_cycle(
                            c,
                            t,
                            at,
                            moving,
                            tau.as_mut_ptr(),
                            7,
                            &raw mut phase,
                        );
                        let [torques, points] = match sets_points {
                            false => [Status::Ok, Status::NotBegun],
                            true => [Status::NotBegun, Status::Ok],
                        };
                        assert_eq!(sent, torques);
                        let (mut set, mut course) = ([[0.0; 7]; 3], vff_course::Finished);
                        let [x, dx, ddx] = set.each_mut().map(|each| each.as_mut_ptr());
                        let moved = vff_controller_set_point(
                            c,
                            t,
                            at,
                            moving,
                            x,
                            dx,
                            ddx,
                            7,
                            &raw mut course,
                        );
                        assert_eq!(moved, points);
                        if k == 350 {
                            assert_eq!(vff_controller_stop(c), Status::Ok);
                        }
                        // Faults in the loop are told without the heap, too.
                        let nan = [f64::NAN; 7];
                        assert_eq!(
                            vff_controller_observe(c, t, nan.as_ptr(), q.as_ptr(), 7),
                            Status::NotFinite
                        );
                        assert_eq!(
                            vff_controller_torque(c, tau.as_mut_ptr(), 7),
                            Status::NotObserved
                        );
                        assert_eq!(vff_controller_torque(c, null_mut(), 7), Status::Null);
                        assert_eq!(vff_controller_pose(c, pose.as_mut_ptr(), 8), Status::Length);
                        assert_eq!(
                            vff_controller_move_obstacle(c, 9, t, place.as_ptr(), null(), 3),
                            Status::NoObstacle
                        );
                        assert_eq!(vff_controller_follow_scenario(c), Status::NoReference);
                    }
                });
                assert_eq!(count, 0, "{settings}, cycle {k}");
                k += 1;
            }
        });
        assert!(pushed > 1.0, "nothing came near: {settings}");
        // SAFETY: they are not used again.
        unsafe {
            vff_cloud_free(cloud);
            vff_controller_free(controller);
        }
    }
}

/// Nor does the first cycle of a controller without obstacles, or of a scenario's, whose obstacle is moved.
#[test]
fn no_first_cycle_touches_the_heap() {
    let settings =
        "task = 'pose'\navoidance = 'cbf'\nself_collision = 'avoid'\nyielding = { preview = {} }";
    let scenario = format!(
        "duration = 1.0\nq0 = {READY:?}\narm = {{ model = 'panda' }}\nreference = {{ kind = 'setpoint' }}\n\
         obstacles = [{{ {} }}]\n[controller]\n{settings}",
        SPHERE.replace('\n', ", ")
    );
    let [settings, scenario] = [settings, &scenario].map(|text| CString::new(text).unwrap());
    let (mut robot, mut alone, mut whole) = (null_mut(), null_mut(), null_mut());
    // SAFETY: all pointers are to what lives, and arrays have the lengths that are given.
    unsafe {
        assert_eq!(vff_robot_named(c"panda".as_ptr(), &raw mut robot), Status::Ok);
        assert_eq!(vff_controller_new(robot, settings.as_ptr(), &raw mut alone), Status::Ok);
        assert_eq!(vff_controller_from_scenario(scenario.as_ptr(), &raw mut whole), Status::Ok);
        for (controller, moved) in [(alone, Status::NoObstacle), (whole, Status::Ok)] {
            let count = touches(|| {
                let (mut tau, mut pose) = ([0.0; 7], [0.0; 7]);
                let place = [-0.05, -0.2, 0.62];
                assert_eq!(
                    vff_controller_move_obstacle(controller, 0, 0.0, place.as_ptr(), null(), 3),
                    moved
                );
                assert_eq!(
                    vff_controller_observe(controller, 0.0, READY.as_ptr(), [0.0; 7].as_ptr(), 7),
                    Status::Ok
                );
                assert_eq!(vff_controller_pose(controller, pose.as_mut_ptr(), 7), Status::Ok);
                let given = vff_controller_set_reference(
                    controller,
                    pose.as_ptr(),
                    7,
                    null(),
                    0,
                    null(),
                    0,
                );
                assert_eq!(given, Status::Ok);
                assert_eq!(vff_controller_torque(controller, tau.as_mut_ptr(), 7), Status::Ok);
            });
            assert_eq!(count, 0);
            vff_controller_free(controller);
        }
        vff_robot_free(robot);
    }
}

/// Nor does a cycle along a plan, nor one in which another law begins to take over, or has done so.
#[test]
fn no_cycle_along_a_plan_touches_the_heap() {
    let shelf = include_str!("../../../python/vffnull/scenarios/panda-shelf.toml");
    let document: toml::Table = shelf.parse().unwrap();
    let numbers = |value: &toml::Value| -> Vec<f64> {
        value.as_array().unwrap().iter().map(|x| x.as_float().unwrap()).collect()
    };
    let start = numbers(&document["q0"]);
    let settings = CString::new(document["controller"].to_string()).unwrap();
    let settings = CString::new(format!("controller = {}", settings.to_str().unwrap())).unwrap();
    let shelf = CString::new(shelf).unwrap();
    let (mut robot, mut running, mut next) = (null_mut(), null_mut(), null_mut());
    // SAFETY: all pointers are to what lives, and arrays have the lengths that are given.
    unsafe {
        assert_eq!(vff_robot_named(c"panda".as_ptr(), &raw mut robot), Status::Ok);
        assert_eq!(vff_controller_from_scenario(shelf.as_ptr(), &raw mut running), Status::Ok);
        assert_eq!(vff_controller_begin(running, 1e-3, null(), 0), Status::Ok);
        let mut posture = settings.to_str().unwrap().to_owned();
        posture = posture.replacen('{', &format!("{{ posture = {start:?},"), 1);
        let posture = CString::new(posture).unwrap();
        let made = vff_controller_successor(running, robot, posture.as_ptr(), &raw mut next);
        assert_eq!(made, Status::Ok);
        let (mut tau, mut phase) = ([0.0; 7], vff_phase::Lost);
        let (mut q, mut time) = ([0.0; 7], 0.0);
        let mut distance = [0.0; 7];
        let turned = [0.0, 0.0, 0.0, 1.0];
        for k in 0..1600 {
            let t = 1e-3 * f64::from(k);
            let count = touches(|| {
                let arrays = (start.as_ptr(), [0.0; 7]);
                let cycled = vff_controller_cycle(
                    running,
                    t,
                    arrays.0,
                    arrays.1.as_ptr(),
                    tau.as_mut_ptr(),
                    7,
                    &raw mut phase,
                );
                assert_eq!(cycled, Status::Ok);
                if k == 800 {
                    assert_eq!(vff_controller_succeed(running, next, 0.5), Status::Ok);
                }
                let planned = vff_controller_planned(running, q.as_mut_ptr(), 7, &raw mut time);
                assert_eq!(planned, Status::Ok);
                let told =
                    vff_controller_distances(running, 4, distance.as_mut_ptr(), 7, null_mut());
                assert_eq!(told, Status::Ok);
            });
            assert_eq!(count, 0, "cycle {k}");
            let count = touches(|| {
                let turned =
                    vff_controller_turn_obstacle(running, 0, t, turned.as_ptr(), 4, null());
                assert_eq!(turned, Status::Ok);
            });
            assert!(count == 0 || k == 0, "{count} in cycle {k}");
        }
        assert!(time > 0.3, "{time}");
        [running, next].into_iter().for_each(|one| vff_controller_free(one));
        vff_robot_free(robot);
    }
}

/// The test can fail: what is not for the loop does allocate, and clouds beyond their room would.
#[test]
fn the_counter_counts() {
    let (controller, cloud) = panda("");
    let sphere = CString::new(SPHERE).unwrap();
    // SAFETY: as above.
    let count = touches(|| unsafe {
        assert_eq!(
            vff_controller_add_obstacle(controller, sphere.as_ptr(), null_mut()),
            Status::Ok
        );
    });
    assert!(count > 0);
    // SAFETY: they are not used again.
    unsafe {
        vff_cloud_free(cloud);
        vff_controller_free(controller);
    }
}
