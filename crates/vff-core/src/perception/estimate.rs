//! Place and velocity of what is seen: a Kalman filter of constant velocity (T184).

use crate::math::Vector;

/// What is farther from where a body is expected than so many standard deviations is another one.
pub(super) const GATE: f64 = 4.0;
/// A velocity of less than so many standard deviations is none.
pub(super) const SIGNIFICANT: f64 = 2.0;
/// From so many pictures on, one after the other as expected, a velocity is believed.
pub(super) const BELIEVED: usize = 3;

/// Place and velocity of something, as far as they are known.
#[derive(Debug, Clone)]
pub(super) struct Estimate {
    pub(super) position: Vector<3>,
    pub(super) velocity: Vector<3>,
    /// As of a [`Track`](super::Track).
    pub(super) covariance: [f64; 3],
    /// In how many pictures it was where it was expected.
    pub(super) seen: usize,
}

impl Estimate {
    /// Of something seen for the first time.
    pub(super) fn new(position: Vector<3>, variance: f64, speed: f64) -> Self {
        Self {
            position,
            velocity: Vector::zeros(),
            covariance: [variance, 0.0, speed * speed],
            seen: 1,
        }
    }

    /// Goes on for a time \[s\] at constant velocity, while an acceleration that nobody knows acts on it.
    pub(super) fn predict(&mut self, h: f64, acceleration: f64) {
        let [a, b, c] = self.covariance;
        let noise = acceleration * acceleration * h * h;
        self.position += self.velocity * h;
        self.covariance = [
            a + h * (2.0 * b + h * c) + 0.25 * noise * h * h,
            b + h * c + 0.5 * noise * h,
            c + noise,
        ];
    }

    /// Takes in where it is seen \[m\], with this variance \[m²\].
    pub(super) fn correct(&mut self, position: &Vector<3>, variance: f64) {
        let [a, b, c] = self.covariance;
        let [of_place, of_velocity] = [a, b].map(|x| x / (a + variance));
        let off = position - self.position;
        self.position += off * of_place;
        self.velocity += off * of_velocity;
        self.covariance = [a * (1.0 - of_place), b * (1.0 - of_place), c - of_velocity * b];
        self.seen += 1;
    }

    /// Takes in where it is seen; what is too far off for it has not gone there, but is another place, and begins anew.
    pub(super) fn follow(&mut self, position: &Vector<3>, variance: f64, speed: f64) {
        let expected = self.covariance[0] + variance;
        if (position - self.position).norm_squared() > GATE * GATE * expected {
            *self = Self::new(*position, variance, speed);
        } else {
            self.correct(position, variance);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// From four places that are known to a millimetre its velocity is known, and the covariance is that of the matrix form.
    #[test]
    fn velocities_come_of_places() {
        let velocity = Vector::<3>::new(0.3, -0.4, 0.0);
        let mut track = Estimate::new(Vector::zeros(), 1e-6, 1.0);
        let mut p = nalgebra::Matrix2::new(1e-6, 0.0, 0.0, 1.0);
        let (h, a) = (1.0 / 30.0, 3.0);
        for k in 1..4 {
            let t = h * f64::from(k);
            track.predict(h, a);
            track.correct(&(velocity * t), 1e-6);
            let f = nalgebra::Matrix2::new(1.0, h, 0.0, 1.0);
            let g = nalgebra::Vector2::new(0.5 * h * h, h) * a;
            p = f * p * f.transpose() + g * g.transpose();
            let gain = p.column(0) / (p[(0, 0)] + 1e-6);
            p -= gain * p.row(0);
            let [place, both, speed] = track.covariance;
            let found = nalgebra::Matrix2::new(place, both, both, speed);
            assert!((found - p).norm() < 1e-12, "{found} {p}");
        }
        assert!((track.velocity - velocity).norm() < 0.01);
    }
}
