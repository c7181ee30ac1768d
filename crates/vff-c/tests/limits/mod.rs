//! What the joints of a Panda may do behind set points, of about the size that its maker allows.

use std::ptr::null;
use vffnull::vff_set_point_limits;

static ACCELERATION: [f64; 7] = [7.5; 7];
static JERK: [f64; 7] = [4000.0; 7];

pub fn set_point_limits() -> vff_set_point_limits {
    vff_set_point_limits {
        speed: null(),
        acceleration: ACCELERATION.as_ptr(),
        jerk: JERK.as_ptr(),
        threshold: 0.1,
    }
}
