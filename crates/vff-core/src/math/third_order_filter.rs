//! A smooth way to a goal that may change at any time.

use super::Vector;

/// A point that follows a goal through a filter with three equal poles: position, velocity and
/// acceleration are known exactly at every instant, and none of them jumps when the goal does.
///
/// From rest it goes straight to the goal and never beyond.
///
/// # Example
/// ```
/// use vff_core::math::{ThirdOrderFilter, Vector};
///
/// let goal = Vector::<2>::new(1.0, 0.0);
/// let filter = ThirdOrderFilter::new(0.0, [Vector::<2>::zeros(); 3], goal, 4.0);
/// let [x, dx, _] = filter.at(5.0);
/// assert!((x - goal).norm() < 1e-5 && dx.norm() < 1e-4);
/// assert_eq!(filter.goal(), goal);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ThirdOrderFilter<const D: usize> {
    /// The instant at which the goal was set \[s\].
    start: f64,
    goal: Vector<D>,
    /// x − goal = (c₀ + c₁τ + c₂τ²) e^(−ωτ), τ the time since `start`.
    c: [Vector<D>; 3],
    /// ω, the pole \[1/s\].
    rate: f64,
}

impl<const D: usize> ThirdOrderFilter<D> {
    /// From \[x, ẋ, ẍ\] at time `start` \[s\] to `goal`, most of the way within 5/`rate` \[1/s\].
    pub fn new(start: f64, [x, dx, ddx]: [Vector<D>; 3], goal: Vector<D>, rate: f64) -> Self {
        let c0 = x - goal;
        let c1 = dx + c0 * rate;
        let c2 = (ddx + dx * (2.0 * rate) + c0 * (rate * rate)) * 0.5;
        Self { start, goal, c: [c0, c1, c2], rate }
    }

    /// \[x, ẋ, ẍ\] at time `t` \[s\]; at rest in the state of `start` before it.
    pub fn at(&self, t: f64) -> [Vector<D>; 3] {
        let Self { goal, c: [c0, c1, c2], rate, .. } = self;
        let tau = (t - self.start).max(0.0);
        let decay = (-rate * tau).exp();
        let value = c0 + c1 * tau + c2 * (tau * tau);
        let slope = c1 + c2 * (2.0 * tau);
        [
            goal + value * decay,
            (slope - value * *rate) * decay,
            (c2 * 2.0 - slope * (2.0 * rate) + value * (rate * rate)) * decay,
        ]
    }

    /// A distance from the goal that is never exceeded.
    pub fn span(&self) -> f64 {
        // The largest τ e^(−ωτ) and τ² e^(−ωτ) are 1/(eω) and (2/(eω))².
        let e = std::f64::consts::E * self.rate;
        let [c0, c1, c2] = self.c.map(|c| c.norm());
        c0 + c1 / e + c2 * 4.0 / (e * e)
    }

    /// A speed that is never exceeded.
    pub fn top_speed(&self) -> f64 {
        let e = std::f64::consts::E * self.rate;
        let slope = self.c[1].norm() + self.c[2].norm() * 2.0 / e;
        slope + self.rate * self.span()
    }

    /// From when on it is as good as at rest at the goal: within 1e-10 of what it had to go \[s\].
    pub fn rests_from(&self) -> f64 {
        self.start + 30.0 / self.rate
    }

    /// Where it goes.
    pub fn goal(&self) -> Vector<D> {
        self.goal
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn two() -> impl Strategy<Value = Vector<2>> {
        [-3.0..3.0, -3.0..3.0].prop_map(Vector::from)
    }

    properties! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// It starts in the state that it is given, its derivatives are those of its positions, it
        /// stays within its span and below its top speed, and it arrives.
        #[test]
        fn it_is_what_it_says(
            x in two(), dx in two(), ddx in two(), goal in two(), rate in 1.0..30.0, share in 0.0..1.0,
        ) {
            let filter = ThirdOrderFilter::new(2.0, [x, dx, ddx], goal, rate);
            let start = filter.at(2.0);
            for (found, given) in start.iter().zip([x, dx, ddx]) {
                prop_assert!((found - given).norm() < 1e-10 * (1.0 + rate * rate));
            }
            let (t, h) = (2.0 + 1e-3 + share * 10.0 / rate, 1e-5 / rate);
            let [before, now, after] = [t - h, t, t + h].map(|t| filter.at(t));
            for k in 0..2 {
                let difference = (after[k] - before[k]) / (2.0 * h);
                let scale = (1.0 + filter.span()) * rate.powi(1 + i32::from(k == 1));
                prop_assert!((difference - now[k + 1]).norm() < 1e-5 * scale);
            }
            prop_assert!((now[0] - goal).norm() <= filter.span() * (1.0 + 1e-12));
            prop_assert!(now[1].norm() <= filter.top_speed() * (1.0 + 1e-12));
            prop_assert!((filter.at(2.0 + 60.0 / rate)[0] - goal).norm() < 1e-9);
        }

        /// From rest: straight to the goal, monotone, not beyond; after 5/ω 88 % of the way.
        #[test]
        fn from_rest_it_does_not_overshoot(x in two(), goal in two(), rate in 1.0..30.0) {
            let zero = Vector::zeros();
            let filter = ThirdOrderFilter::new(0.0, [x, zero, zero], goal, rate);
            let mut left = (x - goal).norm();
            for k in 0..200 {
                let [at, ..] = filter.at(f64::from(k) * 0.1 / rate);
                let offset = at - goal;
                prop_assert!(offset.norm() <= left + 1e-12);
                prop_assert!((offset.dot(&(x - goal))) >= -1e-12);
                left = offset.norm();
            }
            let [at, ..] = filter.at(5.0 / rate);
            // 1 − e⁻⁵ (1 + 5 + 12.5), the step response of three equal poles.
            let share = 1.0 - (-5f64).exp() * 18.5;
            prop_assert!(((at - x) - (goal - x) * share).norm() < 1e-12 * (1.0 + x.norm()));
        }
    }
}
