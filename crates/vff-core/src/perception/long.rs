//! Bodies that are long, and how they turn (T197).

use super::PerceiverSettings;
use super::estimate::{BELIEVED, Estimate, SIGNIFICANT};
use crate::math::Vector;

/// The standard deviation of a corner, by that of a mean: it is a matter of few points.
pub(super) const CORNER: f64 = 3.0;

/// Along what a long body lies, and how fast that turns: a unit vector and its rate (T197).
#[derive(Debug, Clone)]
pub(super) struct Axis {
    direction: Estimate,
    /// Half of how long it is \[m\].
    half: f64,
}

impl Axis {
    /// Of what is seen of a body for the first time.
    pub(super) fn new((along, half): (Vector<3>, f64), settings: &PerceiverSettings) -> Self {
        let variance = Self::variance(half, settings);
        Self { direction: Estimate::new(along, variance, settings.speed / half), half }
    }

    /// Of its direction \[rad²\], as an end is known as well as a corner.
    fn variance(half: f64, settings: &PerceiverSettings) -> f64 {
        (CORNER * settings.track_error / half).powi(2)
    }

    /// Turns on for a time \[s\].
    pub(super) fn predict(&mut self, h: f64, acceleration: f64) {
        let Estimate { position: along, velocity: rate, .. } = self.direction;
        self.direction.predict(h, acceleration / self.half);
        let speed = rate.norm();
        if speed > 0.0 {
            let (sin, cos) = (speed * h).sin_cos();
            self.direction.position = along * cos + rate * (sin / speed);
            self.direction.velocity = rate * cos - along * (speed * sin);
        }
    }

    /// Takes in along what the body is seen to lie; that has no sign.
    pub(super) fn follow(&mut self, (along, half): (Vector<3>, f64), settings: &PerceiverSettings) {
        let Self { direction, half: known } = self;
        *known = half;
        let along = if along.dot(&direction.position) < 0.0 { -along } else { along };
        direction.follow(&along, Self::variance(half, settings), settings.speed / half);
        direction.position = direction.position.normalize();
        direction.velocity -= direction.position * direction.position.dot(&direction.velocity);
    }

    /// The angular velocity \[rad/s\], zero where it is not certain.
    pub(super) fn turning(&self) -> Vector<3> {
        let Estimate { position, velocity, covariance, seen } = &self.direction;
        let is_certain = *seen >= BELIEVED && velocity.norm() > SIGNIFICANT * covariance[2].sqrt();
        if is_certain { position.cross(velocity) } else { Vector::zeros() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A rod that turns steadily about any axis across it: how fast is known after a few pictures, and once it has been turned by
    /// hand, not before a few more.
    #[test]
    fn turning_comes_of_directions() {
        let settings = PerceiverSettings::default();
        let across = Vector::<3>::new(0.3, -0.5, 0.8).normalize();
        let along = across.cross(&Vector::x()).normalize();
        let (rate, h) = (2.5, 1.0 / 30.0);
        let at = |angle: f64| (along * angle.cos() + across.cross(&along) * angle.sin(), 0.2);
        let mut axis = Axis::new(at(0.0), &settings);
        for k in 1..40 {
            axis.predict(h, settings.acceleration);
            let (seen, half) = at(rate * h * f64::from(k));
            axis.follow((if k % 2 == 0 { seen } else { -seen }, half), &settings);
            if k >= 5 {
                let off = (axis.turning() - across * rate).norm();
                assert!(off < 0.1, "{k}: {}", axis.turning());
            }
        }
        axis.predict(h, settings.acceleration);
        axis.follow(at(rate * h * 40.0 + 1.0), &settings);
        assert_eq!(axis.turning(), Vector::<3>::zeros());
    }
}
