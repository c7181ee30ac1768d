//! The reference that was given last, between two that are given.

use crate::math::rotation::UnitQuaternion;
use crate::math::{Pose, SpatialPose, Vector};
use crate::runtime::controller::Target;
use crate::trajectory::Sample;

/// A reference in numbers of its own.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Reference {
    x: Vec<f64>,
    dx: Vec<f64>,
    ddx: Vec<f64>,
}

impl Reference {
    pub(super) fn new(target: &Target<'_>) -> Self {
        let [x, dx, ddx] = [target.x, target.dx, target.ddx].map(<[f64]>::to_vec);
        Self { x, dx, ddx }
    }

    /// Not yet a reference, of so many numbers.
    pub(super) fn room([x, dx, ddx]: [usize; 3]) -> Self {
        Self { x: vec![0.0; x], dx: vec![0.0; dx], ddx: vec![0.0; ddx] }
    }

    pub(super) fn target(&self) -> Target<'_> {
        Target { x: &self.x, dx: &self.dx, ddx: &self.ddx }
    }

    pub(super) fn pose(&self) -> &[f64] {
        &self.x
    }

    /// At rest at the pose that `write` writes.
    pub(super) fn rest_at(&mut self, write: impl FnOnce(&mut [f64])) {
        write(&mut self.x);
        self.dx.fill(0.0);
        self.ddx.fill(0.0);
    }

    /// Makes this the other one `since` \[s\] later; see [`Sample::coasting`]. Does not allocate.
    pub(super) fn coast_from(&mut self, given: &Self, since: f64, patience: f64) {
        match given.x.len() {
            2 => self.coast::<Vector<2>, 2>(Vector::from_column_slice, given, [since, patience]),
            3 => self.coast::<Vector<3>, 3>(Vector::from_column_slice, given, [since, patience]),
            _ => self.coast::<SpatialPose, 6>(pose, given, [since, patience]),
        }
    }

    fn coast<P: Pose<M>, const M: usize>(
        &mut self,
        pose: impl FnOnce(&[f64]) -> P,
        given: &Self,
        [since, patience]: [f64; 2],
    ) {
        let [dx, ddx] = [&given.dx, &given.ddx].map(|rate| Vector::<M>::from_column_slice(rate));
        let now = Sample { x: pose(&given.x), dx, ddx }.coasting(since, patience);
        self.x.copy_from_slice(now.x.as_slice());
        self.dx.copy_from_slice(now.dx.as_slice());
        self.ddx.copy_from_slice(now.ddx.as_slice());
    }
}

/// The pose of seven numbers that were checked to be one.
fn pose(x: &[f64]) -> SpatialPose {
    let orientation = UnitQuaternion::new([x[3], x[4], x[5], x[6]]).unwrap_or_default();
    SpatialPose::new(Vector::<3>::from_column_slice(&x[..3]), orientation)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Between two references it goes on as the last one said, its rates are those of its pose, and it comes to rest without a jump of
    /// its velocity or acceleration; in the plane as in space.
    #[test]
    fn it_goes_on_and_comes_to_rest() {
        let patience = 0.1;
        let plane = Reference { x: vec![1.0, 2.0], dx: vec![0.5, -0.2], ddx: vec![0.1, 0.4] };
        let space = Reference {
            x: vec![0.1, 0.2, 0.3, 0.8, 0.0, 0.6, 0.0],
            dx: vec![0.1, 0.0, -0.2, 0.0, 0.0, 0.7],
            ddx: vec![0.0, 0.3, 0.0, 0.0, 0.0, -0.5],
        };
        for given in [plane, space] {
            let position = given.dx.len().min(3) - usize::from(given.x.len() == 2);
            let widths = [given.x.len(), given.dx.len(), given.ddx.len()];
            let at = |since: f64| {
                let mut now = Reference::room(widths);
                now.coast_from(&given, since, patience);
                now
            };
            assert_eq!(at(0.0).dx, given.dx);
            assert!(at(0.0).x.iter().zip(&given.x).all(|(a, b)| (a - b).abs() < 1e-15));
            let h = 1e-5;
            for k in 1..250 {
                let since = 1e-3 * f64::from(k) + 3e-4;
                let [before, now, after] = [since - h, since, since + h].map(at);
                for i in 0..=position {
                    if i >= given.x.len().min(3) {
                        continue;
                    }
                    let slope = (after.x[i] - before.x[i]) / (2.0 * h);
                    assert!((slope - now.dx[i]).abs() < 1e-8, "{since} {i}");
                    let bend = (after.dx[i] - before.dx[i]) / (2.0 * h);
                    assert!((bend - now.ddx[i]).abs() < 1e-6, "{since} {i}");
                }
            }
            for since in [patience, 2.0 * patience] {
                let [before, after] = [since - 1e-7, since + 1e-7].map(at);
                let jumps = before.ddx.iter().zip(&after.ddx).map(|(a, b)| (a - b).abs());
                assert!(jumps.fold(0.0, f64::max) < 1e-3, "{since}");
            }
            let rest = at(3.0 * patience);
            assert!(rest.dx.iter().chain(&rest.ddx).all(|rate| *rate == 0.0));
            assert_eq!(at(10.0).x, rest.x);
            if given.x.len() == 7 {
                let norm: f64 = rest.x[3..].iter().map(|x| x * x).sum();
                assert!((norm - 1.0).abs() < 1e-12 && rest.x[3..] != given.x[3..]);
            }
        }
    }
}
