//! Bodies that are round (T205): the ball that what is seen of a body lies on, followed by its middle.
//!
//! The mean of what is seen of a ball is not a place of the ball: it wanders where the arm or another body hides a part. The middle
//! stays, and with it is known what no camera sees.

use super::PerceiverSettings;
use super::estimate::{BELIEVED, Estimate};
use super::voxels::Voxel;
use crate::geometry::directions;
use crate::math::Vector;
use nalgebra::{Matrix3, Matrix4, Vector4};

/// Cells that a ball is fitted to, at least.
const LEAST: usize = 8;
/// By cells: what is nearer to a ball is on it; as far as its points are off it in the mean square, at first and later, it is one; and
/// it is known if no standard deviation is more, of its radius, or of its place along the axis along which that is known least.
const ON_IT: f64 = 0.5;
const SMOOTH: [f64; 2] = [0.1, 0.15];
const KNOWN: f64 = 0.3;
/// A radius is never known better than this, by cells.
const LEAST_ERROR: f64 = 0.05;
/// A ball is none any more after so many pictures in which it does not fit, one after the other.
const FAILURES: usize = 3;
/// So much of what is seen of a body lies on its ball, or it does not fit.
const SHARE: f64 = 0.8;
/// Directions around a ball of which those are looked at that are turned to a camera.
const FACING: u32 = 64;
/// Of Gauss and Newton: by then the steps are smaller than rounding.
const STEPS: usize = 4;

/// A ball that points lie on, in the sense of least squares.
#[derive(Debug, Clone, Copy)]
struct Fit {
    centre: Vector<3>,
    radius: f64,
    /// A standard deviation \[m\]: of the radius, where that is looked for, or else of the place.
    error: f64,
    /// How far the points are off it, in the mean square \[m\].
    rms: f64,
}

impl Fit {
    /// The ball that points lie on; none where they say nothing of one.
    #[expect(clippy::cast_precision_loss, reason = "a count of cells")]
    fn new(points: &[Vector<3>]) -> Option<Self> {
        if points.len() < LEAST {
            return None;
        }
        let count = points.len() as f64;
        let mean = points.iter().sum::<Vector<3>>() / count;
        // |p|² = 2 c·p + k is linear in c and k.
        let (mut normal, mut right) = (Matrix4::zeros(), Vector4::zeros());
        for point in points {
            let row = (point - mean).push(1.0);
            normal += row * row.transpose();
            right += row * (point - mean).norm_squared();
        }
        let found = normal.cholesky()?.solve(&right);
        let off = 0.5 * found.xyz();
        let mut fit = Self {
            centre: mean + off,
            radius: (found.w + off.norm_squared()).sqrt(),
            error: f64::INFINITY,
            rms: f64::INFINITY,
        };
        for _ in 0..STEPS {
            let (mut normal, mut right, mut squares) = (Matrix4::zeros(), Vector4::zeros(), 0.0);
            for point in points {
                let (away, off) = fit.off(point)?;
                let row = away.push(1.0);
                normal += row * row.transpose();
                right += row * off;
                squares += off * off;
            }
            let inverse = normal.try_inverse()?;
            let step = inverse * right;
            fit.centre += step.xyz();
            fit.radius += step.w;
            fit.rms = (squares / count).sqrt();
            fit.error = (squares / (count - 4.0) * inverse[(3, 3)]).sqrt();
        }
        (fit.radius > 0.0 && fit.error.is_finite()).then_some(fit)
    }

    /// The direction from its middle to a point, and how far the point is off it \[m\]; none in the middle.
    fn off(&self, point: &Vector<3>) -> Option<(Vector<3>, f64)> {
        let off = point - self.centre;
        let distance = off.norm();
        (distance > 0.0).then(|| (off / distance, distance - self.radius))
    }
}

/// A body that is a ball, as far as it is known.
#[derive(Debug, Clone)]
pub(super) struct Ball {
    /// Of its middle.
    pub(super) centre: Estimate,
    radius: f64,
    /// One over the variance of the radius \[1/m²\].
    information: f64,
    failures: usize,
}

impl Ball {
    /// That these points are on, seen for the first time.
    pub(super) fn new(points: &[Vector<3>], settings: &PerceiverSettings) -> Option<Self> {
        let fit = Self::fit(points, settings)?;
        let variance = settings.track_error.powi(2);
        Some(Self {
            centre: Estimate::new(fit.centre, variance, settings.speed),
            radius: fit.radius,
            information: Self::information(&fit, settings),
            failures: 0,
        })
    }

    /// A ball that is known well, and as deep as is reckoned with at most.
    fn fit(points: &[Vector<3>], settings: &PerceiverSettings) -> Option<Fit> {
        let PerceiverSettings { voxel, hidden, .. } = *settings;
        Fit::new(points).filter(|fit| {
            fit.rms < SMOOTH[0] * voxel && fit.error < KNOWN * voxel && 2.0 * fit.radius <= hidden
        })
    }

    fn information(fit: &Fit, settings: &PerceiverSettings) -> f64 {
        fit.error.max(LEAST_ERROR * settings.voxel).powi(-2)
    }

    /// Whether its velocity is believed.
    pub(super) fn is_believed(&self) -> bool {
        self.centre.seen >= BELIEVED
    }

    /// Whether it was on what was seen of it last.
    pub(super) fn fits(&self) -> bool {
        self.failures == 0
    }

    /// Takes in what is seen of it; false once that does not fit any more.
    #[expect(clippy::cast_precision_loss, reason = "a count of cells")]
    pub(super) fn follow(&mut self, points: &[Vector<3>], settings: &PerceiverSettings) -> bool {
        let within = ON_IT * settings.voxel;
        if let Some(fit) = Self::fit(points, settings) {
            let known = Self::information(&fit, settings);
            self.radius += (fit.radius - self.radius) * known / (self.information + known);
            // So that it goes on being learnt.
            let most = 4.0 * (LEAST_ERROR * settings.voxel).powi(-2);
            self.information = (self.information + known).min(most);
        }
        let found = self.place(points, 2.0 * within, settings.track_error);
        let found = found.filter(|fit| {
            let is_on = |p: &&Vector<3>| fit.off(p).is_some_and(|(_, off)| off.abs() < within);
            let on_it = points.iter().filter(is_on).count() as f64;
            fit.rms < SMOOTH[1] * settings.voxel && on_it >= SHARE * points.len() as f64
        });
        let Some(Fit { centre, error, .. }) = found else {
            self.failures += 1;
            return self.failures < FAILURES;
        };
        self.failures = 0;
        if error < KNOWN * settings.voxel {
            self.centre.follow(&centre, error * error, settings.speed);
        }
        true
    }

    /// The ball of its radius that these points are on, those that are `within` \[m\] of it: its error is that of its place along the
    /// axis along which that is known least.
    fn place(&self, points: &[Vector<3>], within: f64, track_error: f64) -> Option<Fit> {
        let mut fit =
            Fit { centre: self.centre.position, radius: self.radius, error: 0.0, rms: 0.0 };
        for _ in 0..STEPS {
            let (mut normal, mut right) = (Matrix3::zeros(), Vector::<3>::zeros());
            let (mut squares, mut count) = (0.0, 0.0);
            for (away, off) in points.iter().filter_map(|point| fit.off(point)) {
                if off.abs() <= within {
                    normal += away * away.transpose();
                    right += away * off;
                    squares += off * off;
                    count += 1.0;
                }
            }
            let of_one = (squares / f64::max(count - 3.0, 1.0)).sqrt();
            fit.rms = (squares / f64::max(count, 1.0)).sqrt();
            fit.error = of_one.max(track_error) / normal.symmetric_eigenvalues().min().sqrt();
            fit.centre += normal.cholesky()?.solve(&right);
        }
        fit.error.is_finite().then_some(fit)
    }

    /// As it is shown.
    pub(super) fn round(&self, number: u64, centre: Vector<3>, velocity: Vector<3>) -> Round {
        Round { number, centre, radius: self.radius, velocity }
    }
}

/// A round body that is shown.
#[derive(Debug, Clone)]
pub(super) struct Round {
    /// Which body it is.
    pub(super) number: u64,
    centre: Vector<3>,
    radius: f64,
    pub(super) velocity: Vector<3>,
}

impl Round {
    /// How far a point is off its surface \[m\], if that is on it, in cells of this side \[m\].
    pub(super) fn distance_on(&self, point: &Vector<3>, voxel: f64) -> Option<f64> {
        let off = off(point, &self.centre, self.radius).abs();
        (off < ON_IT * voxel).then_some(off)
    }

    /// Whether a cell at time `t` \[s\] is one of it, or of nothing else that is round.
    pub(super) fn is_known_by(&self, voxel: &Voxel, t: f64, side: f64) -> bool {
        let is_else = voxel.round.is_some_and(|other| other != self.number);
        !is_else && self.distance_on(&voxel.at(t), side).is_some()
    }

    /// Whether a point is on it or in it.
    pub(super) fn covers(&self, point: &Vector<3>, voxel: f64) -> bool {
        off(point, &self.centre, self.radius) < ON_IT * voxel
    }

    /// Whether it reaches into what is so far away from a place \[m\].
    pub(super) fn meets(&self, clearance: impl Fn(&Vector<3>) -> f64) -> bool {
        clearance(&self.centre) < self.radius
    }

    /// Places on the side of it that is turned to a camera at `origin` \[m\].
    pub(super) fn facing(&self, origin: &Vector<3>) -> impl Iterator<Item = Vector<3>> {
        let Self { centre, radius, .. } = *self;
        let to_camera = (origin - centre).normalize();
        directions(FACING)
            .filter(move |away| away.dot(&to_camera) > 0.5)
            .map(move |away| centre + away * radius)
    }

    /// How far from its middle the points are that stand for it \[m\], as balls of this radius \[m\]: what these have between them is as
    /// far short of it as they are beyond it, a tenth of their radius.
    fn inset(&self, radius: f64) -> f64 {
        self.radius - 0.9 * radius
    }

    /// How many points stand for it, as balls of this radius \[m\].
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "few")]
    pub(super) fn count(&self, radius: f64) -> u32 {
        let share = (self.inset(radius) / radius).max(0.0);
        // As many as that takes, found for radii up to twenty times theirs: by areas, and more of them where few are bent around it.
        (20.0 * share.powi(2) + 18.0 * share + 1.0).ceil() as u32
    }

    /// These points \[m\]: all around it, or one in the middle of a small one.
    pub(super) fn points(&self, radius: f64) -> impl Iterator<Item = Vector<3>> {
        let (count, centre) = (self.count(radius), self.centre);
        let from_middle = if count == 1 { 0.0 } else { self.inset(radius) };
        directions(count).map(move |away| centre + away * from_middle)
    }
}

/// How far a point is off a ball \[m\], negative within.
fn off(point: &Vector<3>, centre: &Vector<3>, radius: f64) -> f64 {
    (point - centre).norm() - radius
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of a part of a ball as small as a quarter of it, its middle and its radius; of a plane and of few points nothing.
    #[test]
    fn a_ball_is_found_by_a_part_of_it() {
        let (centre, radius) = (Vector::<3>::new(0.4, -0.2, 0.7), 0.08);
        let directions: Vec<_> = directions(200).collect();
        for part in [-1.0, 0.0, 0.5] {
            let seen = directions.iter().filter(|away| away.x > part);
            let points: Vec<_> = seen.map(|away| centre + away * radius).collect();
            let fit = Fit::new(&points).unwrap();
            assert!((fit.centre - centre).norm() < 1e-12 && (fit.radius - radius).abs() < 1e-12);
        }
        let plane: Vec<_> =
            directions.iter().map(|away| Vector::from([away.x, away.y, 0.3])).collect();
        assert!(Fit::new(&plane).is_none_or(|fit| fit.radius > 1e3));
        assert!(Fit::new(&directions[..LEAST - 1]).is_none());
    }

    /// Balls at its points are short of it by a tenth of their radius at most, and go beyond it by no more.
    #[test]
    fn points_stand_for_all_of_a_ball() {
        let radius = 0.02;
        for k in 0..60 {
            let size = radius * (0.5 + 0.1 * f64::from(k));
            let round = Round {
                number: 0,
                centre: Vector::zeros(),
                radius: size,
                velocity: Vector::zeros(),
            };
            let points: Vec<_> = round.points(radius).collect();
            assert_eq!(points.len(), round.count(radius) as usize);
            for away in directions(3000) {
                let end = |point: &Vector<3>| {
                    let along = away.dot(point);
                    let root = radius * radius - (point.norm_squared() - along * along);
                    if root >= 0.0 { along + root.sqrt() } else { 0.0 }
                };
                let beyond = points.iter().map(end).fold(0.0, f64::max) - size;
                let most = if size < radius { radius - size } else { 0.1 * radius };
                assert!(beyond >= -0.1001 * radius && beyond <= most + 1e-12, "{size}: {beyond}");
            }
        }
    }

    /// The error of the radius is that of many fits to points that err.
    #[test]
    fn the_error_of_a_radius_is_known() {
        let (mut noise, mut errors, mut told) = (crate::math::Noise::new(5, 0), vec![], 0.0);
        let count = 400;
        for _ in 0..count {
            let away =
                || Vector::<3>::new(noise.draw().abs(), noise.draw(), noise.draw()).normalize();
            let places: Vec<_> = std::iter::repeat_with(away).take(40).collect();
            let points: Vec<_> =
                places.iter().map(|away| away * (0.1 + 0.002 * noise.draw())).collect();
            let fit = Fit::new(&points).unwrap();
            errors.push(fit.radius - 0.1);
            told += fit.error / f64::from(count);
        }
        let rms = (errors.iter().map(|off| off * off).sum::<f64>() / f64::from(count)).sqrt();
        assert!((told / rms - 1.0).abs() < 0.15, "{told} and {rms}");
    }
}
