//! The perceiver through the C interface: it says what the core says, rows may have gaps, and what is wrong has a status.

use std::ffi::CString;
use std::ptr::{null, null_mut};
use std::thread;
use vff_core::perception::Depth;
use vff_core::runtime::{AnyArm, read_perceiver};
use vff_core::scenario::parse_toml;
use vffnull::*;

const ROWS: usize = 60;
const COLUMNS: usize = 80;
const CAMERAS: &str = "
    [[cameras]]
    columns = 80
    rows = 60
    focal = [75.0, 75.0]
    centre = [39.5, 29.5]
    position = [0.6, 0.0, 1.5]
    orientation = [0.0, 1.0, 0.0, 0.0]

    [settings]
    stride = 1

    [[known]]
    shape = { kind = 'half_space', normal = [0.0, 0.0, 1.0] }
";
const READY: [f64; 7] = [0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8];

/// A perceiver that is freed.
struct Owned(*mut Perceiver);

// SAFETY: it may be used by one thread at a time, and says so of another one.
unsafe impl Sync for Owned {}

impl Drop for Owned {
    fn drop(&mut self) {
        // SAFETY: it was handed out so.
        unsafe { vff_perceiver_free(self.0) }
    }
}

fn made(robot: &str, toml: &str) -> Result<Owned, Status> {
    let (mut arm, mut perceiver) = (null_mut(), null_mut());
    let [name, toml] = [robot, toml].map(|text| CString::new(text).unwrap());
    // SAFETY: pointers to what lives here.
    unsafe {
        assert_eq!(vff_robot_from_text(name.as_ptr(), &raw mut arm), Status::Ok);
        let status = vff_perceiver_new(arm, toml.as_ptr(), &raw mut perceiver);
        vff_robot_free(arm);
        match status {
            Status::Ok => Ok(Owned(perceiver)),
            fault => Err(fault),
        }
    }
}

fn panda() -> Owned {
    made("model = 'panda'", CAMERAS).unwrap()
}

impl Owned {
    fn observe(&self, t: f64) -> Status {
        // SAFETY: pointers to what lives here.
        unsafe { vff_perceiver_observe(self.0, t, READY.as_ptr(), [0.0; 7].as_ptr(), 7) }
    }

    fn see(&self, t: f64, depth: &[u16], row_bytes: usize) -> (Status, PictureCounts) {
        let mut counts = PictureCounts::default();
        // SAFETY: pointers to what lives here.
        let status = unsafe {
            let to = &raw mut counts;
            vff_perceiver_see_millimetres(
                self.0,
                0,
                t,
                depth.as_ptr(),
                ROWS,
                COLUMNS,
                row_bytes,
                to,
            )
        };
        (status, counts)
    }

    fn points(&self) -> (Vec<f64>, Vec<f64>, f64) {
        let (mut count, mut t, mut radius) = (0, 0.0, 0.0);
        // SAFETY: pointers to what lives here.
        unsafe {
            let size = vff_perceiver_size(self.0, &raw mut count, &raw mut t, &raw mut radius);
            assert_eq!(size, Status::Ok);
            assert!((radius - 0.01 * 3f64.sqrt()).abs() < 1e-12);
            let (mut points, mut velocities) = (vec![0.0; 3 * count], vec![0.0; 3 * count]);
            let wrong = vff_perceiver_points(self.0, points.as_mut_ptr(), null_mut(), count + 1);
            assert_eq!(wrong, Status::Length);
            let to = [points.as_mut_ptr(), velocities.as_mut_ptr()];
            assert_eq!(vff_perceiver_points(self.0, to[0], to[1], count), Status::Ok);
            (points, velocities, t)
        }
    }
}

/// A ball at a height, moving to the right of the picture, above a table that is 1.5 m away.
fn picture(step: usize) -> Vec<u16> {
    let inside = |row: usize, column: usize| {
        let [x, y] = [column as f64 - 20.0 - 2.0 * step as f64, row as f64 - 30.0];
        x * x + y * y < 36.0
    };
    let pixel = |k: usize| if inside(k / COLUMNS, k % COLUMNS) { 1000 } else { 1500 };
    (0..ROWS * COLUMNS).map(pixel).collect()
}

/// Points, velocities and counts are the core's, bit for bit: of rows without and with gaps, of millimetres, metres and clouds.
#[test]
fn what_is_seen_is_what_the_core_sees() {
    let arm = AnyArm::read(&parse_toml("model = 'panda'").unwrap()).unwrap();
    let mut core = read_perceiver(&arm, &parse_toml(CAMERAS).unwrap()).unwrap();
    let (owned, gaps, metres) = (panda(), panda(), panda());
    for step in 0..5 {
        let t = step as f64 / 30.0;
        let depth = picture(step);
        core.observe(t, &READY, &[0.0; 7]).unwrap();
        let counts = core.see(0, t, Depth::Millimetres(&depth)).unwrap();
        assert_eq!(counts.measured, ROWS * COLUMNS);
        for each in [&owned, &gaps, &metres] {
            assert_eq!(each.observe(t), Status::Ok);
        }
        let (status, found) = owned.see(t, &depth, 2 * COLUMNS);
        assert_eq!((status, found.measured, found.own), (Status::Ok, counts.measured, counts.own));
        let apart: Vec<u16> =
            depth.chunks(COLUMNS).flat_map(|row| [row, &[7; 5]].concat()).collect();
        assert_eq!(gaps.see(t, &apart, 2 * (COLUMNS + 5)).0, Status::Ok);
        let depth: Vec<f32> = depth.iter().map(|depth| 1e-3 * f32::from(*depth)).collect();
        // SAFETY: pointers to what lives here.
        let status = unsafe {
            let (from, wide) = (depth.as_ptr(), 4 * COLUMNS);
            vff_perceiver_see_metres(metres.0, 0, t, from, ROWS, COLUMNS, wide, null_mut())
        };
        assert_eq!(status, Status::Ok);
    }
    let expected: Vec<f64> = core.points().flat_map(|(point, _)| <[f64; 3]>::from(point)).collect();
    let rates: Vec<f64> = core.points().flat_map(|(_, rate)| <[f64; 3]>::from(rate)).collect();
    assert!(expected.len() > 60 && rates.iter().any(|rate| rate.abs() > 0.1));
    assert_eq!(owned.points(), (expected.clone(), rates.clone(), core.last().unwrap()));
    assert_eq!(gaps.points(), (expected, rates, core.last().unwrap()));
    assert!(metres.points().0.len().abs_diff(owned.points().0.len()) < 30);

    let (owned, points) = (panda(), [[0.1, 0.0, 1.0], [0.102, 0.0, 1.0]]);
    assert_eq!(owned.observe(0.0), Status::Ok);
    assert!(owned.points().2.is_nan());
    // SAFETY: pointers to what lives here.
    let see = |count| unsafe {
        vff_perceiver_see_points(owned.0, 0, 0.0, points.as_ptr().cast(), count, null_mut())
    };
    assert_eq!(see(2), Status::Ok);
    assert_eq!(see(2), Status::NotLater);
}

/// Sent to a cloud, they are what a controller with these points has: the same torque.
#[test]
fn points_go_to_a_controller() {
    let owned = panda();
    for step in 0..4 {
        let t = step as f64 / 30.0;
        assert_eq!(owned.observe(t), Status::Ok);
        assert_eq!(owned.see(t, &picture(step), 2 * COLUMNS).0, Status::Ok);
    }
    let (points, velocities, since) = owned.points();
    let text = |text: &str| CString::new(text).unwrap();
    let (robot_text, settings) = (
        text("model = 'panda'"),
        text("field = { kind = 'bounded', gain = 60.0, influence = 0.6 }"),
    );
    let cloud_text = text("shape = { kind = 'points', points = [], radius = 0.02 }");
    let mut torques = [[0.0; 7]; 3];
    for (how, tau) in torques.iter_mut().enumerate() {
        let (mut robot, mut controller, mut cloud) = (null_mut(), null_mut(), null_mut());
        let (mut id, count) = (0, points.len() / 3);
        // SAFETY: pointers to what lives here.
        unsafe {
            let ok = |status| assert_eq!(status, Status::Ok);
            ok(vff_robot_from_text(robot_text.as_ptr(), &raw mut robot));
            ok(vff_controller_new(robot, settings.as_ptr(), &raw mut controller));
            ok(vff_controller_add_obstacle(controller, cloud_text.as_ptr(), &raw mut id));
            ok(vff_controller_cloud(controller, id, 5000, &raw mut cloud));
            match how {
                0 => ok(vff_perceiver_send(owned.0, cloud)),
                1 => ok(vff_cloud_update_moving(
                    cloud,
                    points.as_ptr(),
                    velocities.as_ptr(),
                    count,
                    since,
                )),
                _ => {}
            }
            let place = [0.3, 0.0, 0.5];
            ok(vff_controller_set_reference(controller, place.as_ptr(), 3, null(), 0, null(), 0));
            ok(vff_controller_observe(controller, 0.2, READY.as_ptr(), [0.0; 7].as_ptr(), 7));
            ok(vff_controller_torque(controller, tau.as_mut_ptr(), 7));
            assert_eq!(vff_perceiver_send(null(), cloud), Status::Null);
            assert_eq!(vff_perceiver_send(owned.0, null()), Status::Null);
            let mut small = null_mut();
            ok(vff_controller_cloud(controller, id, 3, &raw mut small));
            assert_eq!(vff_perceiver_send(owned.0, small), Status::TooMany);
            vff_controller_free(controller);
            assert_eq!(vff_perceiver_send(owned.0, cloud), Status::NotACloud);
            vff_cloud_free(small);
            vff_cloud_free(cloud);
            vff_robot_free(robot);
        }
    }
    assert_eq!(torques[0].map(f64::to_bits), torques[1].map(f64::to_bits));
    assert!((0..7).any(|i| (torques[0][i] - torques[2][i]).abs() > 0.1), "{torques:?}");
}

#[test]
fn what_is_of_no_use_has_a_status() {
    for (robot, toml, expected) in [
        ("model = 'panda'", "cameras = []", "cameras: expected one at least"),
        ("model = 'panda'", "", "missing key `cameras`"),
        ("model = 'panda'", "cameras = 3", "cameras"),
        ("model = 'panda'", &CAMERAS.replace("stride = 1", "stride = 0"), "settings.stride"),
        ("model = 'panda'", &CAMERAS.replace("stride = 1", "strid = 1"), "settings"),
        ("model = 'panda'", &CAMERAS.replace("[0.6, 0.0, 1.5]", "[nan, 0.0, 1.5]"), "position"),
        ("model = 'panda'", &CAMERAS.replace("'half_space'", "'half'"), "known[0].shape"),
        ("lengths = [1.0, 1.0]\nmasses = 1.0", CAMERAS, "this one is in the plane"),
    ] {
        assert_eq!(made(robot, toml).err(), Some(Status::Document), "{toml}");
        // SAFETY: it is a text.
        let said = unsafe { std::ffi::CStr::from_ptr(vff_last_message()) }.to_str().unwrap();
        assert!(said.contains(expected), "{said}");
    }
    let (owned, depth) = (panda(), picture(0));
    assert_eq!(owned.see(0.0, &depth, 2 * COLUMNS).0, Status::NotObserved);
    assert_eq!(owned.observe(0.0), Status::Ok);
    assert_eq!(owned.observe(0.0), Status::NotLater);
    assert_eq!(owned.observe(f64::NAN), Status::NotLater);
    assert_eq!(owned.see(0.0, &depth, 2 * COLUMNS - 1).0, Status::Length);
    assert_eq!(owned.see(9.0, &depth, 2 * COLUMNS).0, Status::NotObserved);
    // SAFETY: pointers to what lives here, and NULL.
    unsafe {
        let see = |camera, from: *const u16, rows| {
            let (wide, to) = (2 * COLUMNS, null_mut());
            vff_perceiver_see_millimetres(owned.0, camera, 0.0, from, rows, COLUMNS, wide, to)
        };
        assert_eq!(see(0, null(), ROWS), Status::Null);
        assert_eq!(see(0, depth.as_ptr(), ROWS - 1), Status::Length);
        assert_eq!(see(1, depth.as_ptr(), usize::MAX), Status::NoCamera);
        assert_eq!(see(0, depth.as_ptr(), ROWS), Status::Ok);
        let observe = |q: *const f64, joints| {
            vff_perceiver_observe(owned.0, 1.0, q, [0.0; 7].as_ptr(), joints)
        };
        assert_eq!(observe(null(), 7), Status::Null);
        assert_eq!(observe(READY.as_ptr(), 6), Status::Length);
        assert_eq!(observe([f64::NAN; 7].as_ptr(), 7), Status::NotFinite);
        assert_eq!(vff_perceiver_new(null(), null(), null_mut()), Status::Null);
        let bad = [f64::NAN; 3];
        let to = null_mut();
        assert_eq!(
            vff_perceiver_see_points(owned.0, 0, 1.0, bad.as_ptr(), 1, to),
            Status::NotFinite
        );
        assert_eq!(vff_perceiver_see_points(owned.0, 0, 1.0, null(), 1, to), Status::Null);
        vff_perceiver_free(null_mut());
    }
}

/// Two threads that use the same perceiver wait for nothing: whoever comes second is told, and nothing is lost of what the first does.
#[test]
fn another_thread_is_told() {
    let (owned, depth) = (panda(), picture(0));
    let seen: usize = thread::scope(|scope| {
        let states = scope.spawn(|| {
            let mut taken = 0;
            for k in 0..20_000 {
                // Who is told waits: all tries may fall into one picture.
                loop {
                    match owned.observe(1e-4 * f64::from(k)) {
                        Status::Ok => break taken += 1,
                        other => assert_eq!(other, Status::Busy),
                    }
                    thread::yield_now();
                }
            }
            taken
        });
        let mut seen = 0;
        for k in 1..200 {
            match owned.see(f64::from(k) * 1e-2, &depth, 2 * COLUMNS).0 {
                Status::Ok => seen += 1,
                other => assert!(matches!(other, Status::Busy | Status::NotObserved), "{other:?}"),
            }
        }
        let taken: usize = states.join().unwrap();
        assert!(taken > 100, "{taken}");
        seen
    });
    assert_eq!(seen > 0, !owned.points().0.is_empty());
}
