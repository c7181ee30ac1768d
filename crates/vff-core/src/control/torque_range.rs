//! What the drives accept next, and how sharp a demand may be that they can still follow (T130–T134).
//!
//! A demand that changes faster than the torque may is followed too late, which makes the next demand larger: the arm
//! oscillates. So everything that asks for torque knows how long that torque takes to build up.

use crate::robot::Robot;

/// Where the next torque of the law may be, joint by joint. Nothing allocates after construction.
#[derive(Debug, Clone)]
pub struct TorqueRange {
    /// The least torque \[N·m, N\].
    pub lower: Vec<f64>,
    /// The largest torque \[N·m, N\].
    pub upper: Vec<f64>,
    /// The torque of the law that acts at present \[N·m, N\].
    pub present: Vec<f64>,
    /// How fast it may change \[N·m/s, N/s\].
    rate: Vec<f64>,
    /// Until it may change again \[s\].
    pub period: f64,
}

/// c in (T131): how much of the torque rate a barrier takes up at most, as the share 0.23 c² of it.
const SHARPNESS: f64 = 1.4;
/// w in (T131): the speed at which obstacles and links close in that barriers reckon with \[m/s\].
const CLOSING: f64 = 1.0;
/// How much faster the three poles of (T131) are than the two of (T67), which react as early.
const THREE_POLES: f64 = 1.5;
/// Share of the torque rate that braking one speed before its limit takes up (T132).
const BRAKING: f64 = 0.125;
/// In parts of j/k³: a height that is farther below 0 asks for no more than this one.
const DEEPEST: f64 = 0.3;
/// The least share of (T161): a distance that joints hardly change is not worth everything else.
const LEAST_SHARE: f64 = 1e-3;

impl TorqueRange {
    /// For drives whose torque may change so fast \[N·m/s, N/s\], each.
    pub fn new(rate: Vec<f64>) -> Self {
        let zeros = || vec![0.0; rate.len()];
        Self { lower: zeros(), upper: zeros(), present: zeros(), rate, period: 0.0 }
    }

    /// How long the drives take to build up `tau` \[s\].
    pub fn build_up(&self, tau: &[f64]) -> f64 {
        tau.iter().zip(&self.rate).fold(0.0, |most, (tau, rate)| most.max(tau.abs() / rate))
    }

    /// j = Jₕ M⁻¹ Jₕᵀ minᵢ rᵢ/|Jₕᵢ|, how fast a force along its own gradient can change ḧ (T130); `response` is M⁻¹Jₕᵀ.
    pub fn jerk(&self, gradient: &[f64], response: &[f64]) -> f64 {
        let mobility: f64 = gradient.iter().zip(response).map(|(g, y)| g * y).sum();
        let slowest = self.build_up(gradient);
        if slowest > 0.0 { mobility / slowest } else { 0.0 }
    }

    /// The least ḧ after this period for a height h that is to stay positive, of which `now` is \[h, ḣ, ḧ\], where ḧ can
    /// be changed by `jerk` and ḣ is −`closing` at worst (T131); no earlier than (T67) reacts with `rate` \[1/s\].
    pub fn least_acceleration(&self, now: [f64; 3], jerk: f64, closing: f64, rate: f64) -> f64 {
        self.least_behind(self.pole(jerk, closing, rate), now, jerk)
    }

    /// The same with the pole k.
    fn least_behind(&self, k: f64, [h, dh, ddh]: [f64; 3], jerk: f64) -> f64 {
        let h = h.max(-DEEPEST * jerk / (k * k * k));
        ddh - self.period * k * (3.0 * ddh + k * (3.0 * dh + k * h))
    }

    /// k of (T131) \[1/s\].
    fn pole(&self, jerk: f64, closing: f64, rate: f64) -> f64 {
        let fastest = THREE_POLES * rate;
        (SHARPNESS * (jerk / closing).sqrt()).min(fastest).min(1.0 / (3.0 * self.period))
    }

    /// The same for a distance along whose gradient the joints push, and what this period asks for in parts of what (T67) would ask
    /// for at once (T161); leaves M⁻¹Jₕᵀ in `response`.
    pub fn least_distance_acceleration<R: Robot<D>, const D: usize>(
        &self,
        robot: &R,
        now: [f64; 3],
        gradient: &[f64],
        response: &mut [f64],
        rate: f64,
    ) -> [f64; 2] {
        robot.mass_solve(gradient, response);
        let jerk = self.jerk(gradient, response);
        let k = self.pole(jerk, CLOSING, rate);
        let share = self.period * k.powi(3) / (rate * rate);
        [self.least_behind(k, now, jerk), share.clamp(LEAST_SHARE, 1.0)]
    }

    /// What of the `jerk` that drives have for one speed alone brakes it before its limit (T132).
    pub fn braking_jerk(jerk: f64) -> f64 {
        BRAKING * jerk
    }

    /// How fast every joint can lose acceleration while all of them do \[rad/s³\] (T176), of the masses M, row by row, and the
    /// largest speeds; infinite where a joint has none.
    pub fn jerks_together(&self, mass: &[f64], speeds: &[f64], jerks: &mut [f64]) {
        let n = speeds.len();
        for (i, (jerk, speed)) in jerks.iter_mut().zip(speeds).enumerate() {
            *jerk = speed / mass[i * n + i].sqrt();
        }
        let mut share = f64::INFINITY;
        for (row, rate) in mass.chunks_exact(n).zip(&self.rate) {
            let limited = row.iter().zip(&*jerks).filter(|(_, jerk)| jerk.is_finite());
            let torque: f64 = limited.map(|(m, jerk)| m.abs() * jerk).sum();
            share = share.min(rate / torque);
        }
        jerks.iter_mut().for_each(|jerk| *jerk *= share);
    }

    /// The speed towards a stop from which `jerk` brings a joint to rest there that is so far \[rad, m\] from it, and how fast it
    /// changes while the joint has this speed towards it (T200).
    pub fn speed_towards(jerk: f64, [height, dq]: [f64; 2]) -> [f64; 2] {
        let root = height.max(0.0).cbrt();
        let factor = (4.5 * jerk).cbrt();
        let speed = factor * root * root;
        let change =
            if root > 0.0 { -2.0 / 3.0 * factor / root * dq.max(0.0).min(speed) } else { 0.0 };
        [speed, change]
    }

    /// The largest acceleration with `left` to go to the largest speed: in proportion near it, and farther away as much
    /// as can be taken back at `jerk` (T132).
    pub fn most_acceleration(left: f64, jerk: f64, rate: f64) -> f64 {
        let near = jerk / (rate * rate);
        match left.abs() {
            distance if distance <= near => rate * left,
            distance => (2.0 * jerk * (distance - 0.5 * near)).sqrt().copysign(left),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::{Gains, Settings, task};
    use crate::math::{ScalarOrVec, Vector};
    use proptest::prelude::*;

    const PERIOD: f64 = 1e-3;

    /// A body on a critically damped spring of 30 rad/s, at rest where a wall comes at `speed` from 1 m away, goes 0.15 m too
    /// far, waits for a second and leaves; ẍ changes by no more than `jerk` a second. What came nearest, how far the body
    /// goes past its place on the way back, and how far it is from there 10 s later \[m\].
    fn pushed(jerk: f64, speed: f64) -> [f64; 3] {
        let (mass, margin) = (6.0, 0.02);
        let range = TorqueRange { period: PERIOD, ..TorqueRange::new(vec![mass * jerk]) };
        let gains = Gains::<1>::new(&Settings {
            stiffness: ScalarOrVec::Uniform(900.0),
            damping: ScalarOrVec::Uniform(60.0),
            ..Settings::default()
        });
        let (mut x, mut v, mut a) = (0.0_f64, 0.0_f64, 0.0);
        let mut found = [f64::INFINITY, 0.0, 0.0];
        let there = 1.15 / speed;
        for step in 0..(1000.0 * (2.0 * there + 11.0)) as usize {
            let t = PERIOD * step as f64;
            let (wall, velocity) = match t {
                t if t < there => (speed * t - 1.0, speed),
                t if t < there + 1.0 => (0.15, 0.0),
                t => ((0.15 - speed * (t - there - 1.0)).max(-1.0), -speed),
            };
            let h = [x - wall - margin, v - velocity, a];
            let mut build_up = |ddx: &Vector<1>| range.build_up(&[mass * ddx[0]]);
            let [e, de, zero] = [x, v, 0.0].map(Vector::<1>::new);
            let wanted = task::sendable_acceleration(&gains, &zero, e, de, &mut build_up)[0];
            let least = range.least_acceleration(h, jerk, CLOSING, 40.0);
            let most = PERIOD * jerk;
            a = wanted.max(least).clamp(a - most, a + most);
            v += PERIOD * a;
            x += PERIOD * v;
            found = [found[0].min(x - wall), found[1].max(-x), x.abs()];
        }
        found
    }

    properties! {
        /// Nothing oscillates, whatever the rate: the body keeps the distance from a wall of up to twice the speed that
        /// barriers reckon with, and comes back without going too far.
        #[test]
        fn what_is_begun_in_time_is_kept(jerk in 100.0..3000.0, speed in 0.1..2.0) {
            let [nearest, too_far, left] = pushed(jerk, speed);
            prop_assert!(nearest > 0.019, "{nearest}");
            prop_assert!(too_far < 1e-4, "{too_far}");
            prop_assert!(left < 1e-3, "{left}");
        }

        /// A joint that is asked for more than its largest speed comes to that speed without passing it.
        #[test]
        fn a_speed_is_reached_and_not_passed(jerk in 100.0..5e4, most in 0.5..5.0, torque in 5.0..500.0) {
            let (mut v, mut a) = (0.0, 0.0);
            let step = PERIOD * jerk;
            for _ in 0..4000 {
                let jerk = TorqueRange::braking_jerk(jerk);
                let bound = TorqueRange::most_acceleration(most - v - PERIOD * a, jerk, 40.0);
                a = bound.min(torque).clamp(a - step, a + step);
                v += PERIOD * a;
                prop_assert!(v <= most * (1.0 + 1e-3), "{v} of {most}");
            }
            prop_assert!(v > 0.99 * most, "{v} of {most}");
        }
    }

    properties! {
        /// Joints that couple by whatever masses, all of them on their way to their largest speeds, brake at the same time:
        /// (T176) asks for no more than the rate, and no speed is passed.
        #[test]
        fn coupled_joints_are_braked_together(
            factor in prop::collection::vec(-1.0..1.0, 16),
            most in prop::collection::vec(0.5..5.0, 4),
            begun in prop::collection::vec(-1.0..0.9, 4),
            rate in 100.0..2000.0,
        ) {
            let n = most.len();
            let mass: Vec<f64> = (0..n * n)
                .map(|at| {
                    let [i, k] = [at / n, at % n];
                    let inner: f64 = (0..n).map(|l| factor[n * i + l] * factor[n * k + l]).sum();
                    inner + if i == k { 0.05 } else { 0.0 }
                })
                .collect();
            let range = TorqueRange::new(vec![rate; n]);
            let mut jerks = vec![0.0; n];
            range.jerks_together(&mass, &most, &mut jerks);
            let bound =
                |i: usize, v: f64| TorqueRange::most_acceleration(most[i] - v, jerks[i], 40.0);
            let mut v: Vec<f64> = (0..n).map(|i| begun[i] * most[i]).collect();
            let mut a: Vec<f64> = (0..n).map(|i| bound(i, v[i])).collect();
            for _ in 0..3000 {
                let next: Vec<f64> = (0..n).map(|i| bound(i, v[i] + PERIOD * a[i])).collect();
                for row in mass.chunks_exact(n) {
                    let change: f64 = (0..n).map(|k| row[k] * (next[k] - a[k])).sum();
                    // A bound that curves down is steeper at the end of a period than at its beginning.
                    let most = PERIOD * rate / (1.0 - 40.0 * PERIOD);
                    prop_assert!(change.abs() <= most * (1.0 + 1e-9), "{change} of {most}");
                }
                a = next;
                for i in 0..n {
                    v[i] += PERIOD * a[i];
                    prop_assert!(v[i] <= most[i] * (1.0 + 1e-9));
                }
            }
        }
    }

    properties! {
        #![proptest_config(ProptestConfig::with_cases(32))]

        /// A joint that goes on at its speed comes to its stop with less than the jerk that is reckoned with, whatever its own
        /// would be; so does one that is pushed there, and none stays away.
        #[test]
        fn a_stop_takes_the_jerk_that_there_is(
            jerk in 5.0..500.0, own in 20.0..300.0, most in 0.5..4.0, pushed in prop::option::of(1.0..10.0),
        ) {
            const FINE: f64 = 1e-4;
            let range = TorqueRange { period: FINE, ..TorqueRange::new(vec![1.0]) };
            let share = 0.5 * jerk;
            let braking = TorqueRange::braking_jerk(own * jerk).min(share);
            let least = |h: f64, v: f64, a: f64| {
                let next = [h - FINE * v, v + FINE * a];
                let [speed, change] = TorqueRange::speed_towards(share, next);
                let bound = TorqueRange::most_acceleration(speed - next[1], braking, 40.0);
                (-change - bound).max(range.least_acceleration([h, -v, -a], own * jerk, most, 40.0))
            };
            let (mut h, mut v, mut a) = match pushed {
                None => (12.0 * most.powf(1.5) / braking.sqrt() + 1.0, most, 0.0_f64),
                Some(_) => (0.5, 0.0, 0.0),
            };
            let (mut nearest, mut hardest, mut begun) = (h, 0.0_f64, 0);
            for _ in 0..200_000 {
                let wanted = if h > 0.0 { pushed.unwrap_or(0.0) } else { 0.0 };
                let bound = -least(h, v, a);
                begun += usize::from(bound < wanted);
                let next = if begun > 0 { bound.min(wanted) } else { wanted };
                if begun > 1 {
                    hardest = hardest.max((a - next) / FINE);
                }
                h -= FINE * (v + 0.5 * FINE * next);
                (a, v) = (next, v + FINE * next);
                nearest = nearest.min(h);
            }
            prop_assert!(nearest > -1e-3, "{nearest}");
            prop_assert!(h < 2e-3, "{h}");
            // One that is pushed begins beyond what is bounded.
            prop_assert!(pushed.is_some() || hardest <= jerk, "{hardest} of {jerk}");
        }
    }

    /// What is undefined stays so, to be told by whoever sends it.
    #[test]
    fn an_undefined_jerk_is_no_end_of_it() {
        let [speed, change] = TorqueRange::speed_towards(f64::NAN, [0.1, 1.0]);
        assert!(speed.is_nan() && change.is_nan());
        assert!(TorqueRange::speed_towards(-1.0, [0.1, 1.0]).iter().all(|x| x.is_finite()));
    }

    /// The bound is the same from both sides of where its two parts meet, and so is its slope.
    #[test]
    fn the_bound_of_a_speed_has_no_corner() {
        let (jerk, rate) = (50.0, 40.0);
        let near = jerk / (rate * rate);
        let at = |left: f64| TorqueRange::most_acceleration(left, jerk, rate);
        let h = 1e-6 * near;
        assert!((at(near + h) - at(near) - rate * h).abs() < 1e-5 * rate * h);
        assert!((at(near) - at(near - h) - rate * h).abs() < 1e-5 * rate * h);
        assert!((at(near) + at(-near)).abs() < 1e-12);
    }

    /// Force builds up as fast as the slowest joint lets it.
    #[test]
    fn jerk_along_a_gradient() {
        let range = TorqueRange::new(vec![1000.0, 100.0]);
        // Along the first joint alone, of 2 kg·m²; along both, where the second one is the slower.
        assert!((range.jerk(&[0.5, 0.0], &[0.25, 0.0]) - 0.125 / 5e-4).abs() < 1e-9);
        assert!((range.jerk(&[0.5, 0.1], &[0.25, 0.05]) - 0.13 / 1e-3).abs() < 1e-9);
        assert!(range.jerk(&[0.0, 0.0], &[0.0, 0.0]) == 0.0);
        assert!((range.build_up(&[-10.0, 2.0]) - 0.02).abs() < 1e-15);
    }
}
