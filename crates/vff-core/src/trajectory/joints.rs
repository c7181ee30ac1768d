//! Joints along a plan: clamped cubic splines, at rest at both ends and wherever two knots in a row are the same (T117).

use super::piecewise;
use super::spline::{Ends, cubics};
use super::taking_over::{Fading, Remainder};
use super::{KeptMargins, TrajectoryError};
use crate::interrupt;
use crate::math::Vector;
use crate::math::quintic::horner;

/// Positions of `n` joints over time: cubics through knots (C²), at rest at the first and at the last of them, where it
/// stays before and after. Between two knots in a row that are the same it rests: what is before and after are two motions from
/// rest to rest.
///
/// ```
/// # fn main() -> Result<(), vff_core::trajectory::TrajectoryError> {
/// use vff_core::trajectory::JointSpline;
///
/// let spline = JointSpline::new(&[0.0, 1.0, 2.0], &[vec![0.0], vec![0.5], vec![1.0]])?;
/// let (mut q, mut dq, mut ddq) = ([0.0], [0.0], [0.0]);
/// spline.at(1.0, [&mut q, &mut dq, &mut ddq]);
/// assert!((q[0] - 0.5).abs() < 1e-12 && dq[0] > 0.0);
/// spline.at(5.0, [&mut q, &mut dq, &mut ddq]); // held at the end
/// assert_eq!((q, dq), ([1.0], [0.0]));
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct JointSpline {
    times: Vec<f64>,
    /// How many joints there are.
    n: usize,
    /// The cubics of all joints between the first two knots, then of all between the next.
    pieces: Vec<[Vector<1>; 4]>,
    first: Vec<f64>,
    last: Vec<f64>,
    /// What is left of the motion before, of each joint.
    before: Option<Fading>,
    /// By how much the posture still is elsewhere, of each joint.
    drawn: Option<Remainder<Vec<[f64; 3]>>>,
    /// What every link is known to keep on the way.
    margins: Option<KeptMargins>,
}

/// The farthest that joints go on a motion, of each joint.
///
/// # Example
/// ```
/// use vff_core::trajectory::{JointSpline, Peaks};
///
/// let spline = JointSpline::new(&[0.0, 1.0], &[vec![0.0], vec![1.0]]).unwrap();
/// let Peaks { positions, speeds, .. } = spline.peaks();
/// assert_eq!(positions, [[0.0, 1.0]]);
/// assert!(speeds[0] > 1.0); // from rest to rest
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Peaks {
    /// The least and the largest position \[rad or m\].
    pub positions: Vec<[f64; 2]>,
    /// The largest speed \[rad/s, m/s\].
    pub speeds: Vec<f64>,
    /// The largest acceleration, of either sign \[rad/s², m/s²\].
    pub accelerations: Vec<f64>,
    /// The largest jerk, of either sign \[rad/s³, m/s³\]; the acceleration with which it starts and that with which it ends come and go within
    /// the time between two knots.
    pub jerks: Vec<f64>,
}

impl JointSpline {
    /// Through `points`, one number per joint \[rad or m\], at `times` \[s\].
    ///
    /// # Errors
    /// With fewer than two times, times that do not increase, not as many points as times, or points of several lengths.
    pub fn new(times: &[f64], points: &[Vec<f64>]) -> Result<Self, TrajectoryError> {
        piecewise::check(times, points.len())?;
        let n = points[0].len();
        for (i, point) in points.iter().enumerate() {
            if point.len() != n {
                let field = format!("points[{i}]");
                return Err(TrajectoryError::Joints { field, expected: n, given: point.len() });
            }
        }
        let knots = times.len();
        let mut pieces = vec![[Vector::zeros(); 4]; n * (knots - 1)];
        let mut start = 0;
        for motion in points.chunk_by(|a, b| a != b) {
            let end = start + motion.len();
            for joint in 0..n {
                let point = |i: usize| Vector::<1>::new(motion[i][joint]);
                if motion.len() > 1 {
                    let fitted = cubics(&times[start..end], point, Ends::Clamped);
                    for (i, piece) in fitted.into_iter().enumerate() {
                        pieces[(start + i) * n + joint] = piece;
                    }
                }
                if end < knots {
                    pieces[(end - 1) * n + joint][0] = point(motion.len() - 1);
                }
            }
            start = end;
        }
        let (first, last) = (points[0].clone(), points[knots - 1].clone());
        let (before, drawn) = (None, None);
        Ok(Self { times: times.to_vec(), n, pieces, first, last, before, drawn, margins: None })
    }

    /// The same motion, taken over from `old` at time `t` \[s\] without a jump of position, velocity or acceleration: the
    /// difference between both fades within `duration` \[s\], > 0, along the quintic that ends at rest.
    ///
    /// # Panics
    /// If they have not as many joints.
    #[must_use]
    pub fn taking_over(mut self, old: &Self, t: f64, duration: f64) -> Self {
        let zeros = || [0; 3].map(|_| vec![0.0; self.n]);
        let [mut from, mut to] = [zeros(), zeros()];
        old.at(t, from.each_mut().map(Vec::as_mut_slice));
        self.at(t, to.each_mut().map(Vec::as_mut_slice));
        let left = |i: usize| [0, 1, 2].map(|k| from[k][i] - to[k][i]);
        self.before = Some(Fading::new(t, duration, (0..self.n).map(left)));
        self
    }

    /// The same motion; at time `t` \[s\] the posture of the null space is in the state `from`: of each joint where it is \[rad or m\], and
    /// its derivatives; nowhere if there are none. Of what lies between less and less is left until it is where the joints are,
    /// `duration` \[s\], > 0, later ([`draw`](Self::draw)).
    #[must_use]
    pub fn drawing_from(
        mut self,
        from: impl Iterator<Item = [f64; 3]>,
        t: f64,
        duration: f64,
    ) -> Self {
        let mut there = [0; 3].map(|_| vec![0.0; self.n]);
        self.at(t, there.each_mut().map(Vec::as_mut_slice));
        let left = from.zip(0..self.n).map(|(x, i)| [0, 1, 2].map(|k| x[k] - there[k][i]));
        self.drawn = Some(Remainder::new(t, duration, left.collect()));
        self
    }

    /// The same motion, on which every link is known to keep `margins` \[m\] from obstacles, and of margins of their own these
    /// `shares`, or all.
    ///
    /// # Errors
    /// If there is not one number for each link at each knot.
    pub fn keeping(
        mut self,
        margins: &[Vec<f64>],
        shares: Option<&[Vec<f64>]>,
    ) -> Result<Self, TrajectoryError> {
        self.margins = Some(KeptMargins::new(&self.times, margins, shares, self.n)?);
        Ok(self)
    }

    /// The same motion, on which at time `t` \[s\] every link still keeps what it has kept until then: what it keeps along `old`, or
    /// `usual` \[m\], which is the most.
    #[must_use]
    pub fn keeping_on(mut self, old: Option<&Self>, usual: f64, t: f64, duration: f64) -> Self {
        let old = old.and_then(Self::margins);
        self.margins = self.margins.map(|own| own.taking_over(old, usual, t, duration));
        self
    }

    /// What every link is known to keep on the way.
    pub fn margins(&self) -> Option<&KeptMargins> {
        self.margins.as_ref()
    }

    /// The farthest that each joint goes, of the cubics themselves and not of samples: where their velocities and
    /// accelerations are zero, or at knots. What is left of a motion before is not counted.
    pub fn peaks(&self) -> Peaks {
        let still = |q: &f64| [*q, *q];
        let mut peaks = Peaks {
            positions: self.first.iter().map(still).collect(),
            speeds: vec![0.0; self.n],
            accelerations: vec![0.0; self.n],
            jerks: vec![0.0; self.n],
        };
        for (i, pair) in self.times.windows(2).enumerate() {
            let h = pair[1] - pair[0];
            interrupt::checkpoint(32 * self.n);
            for (joint, piece) in self.pieces[i * self.n..(i + 1) * self.n].iter().enumerate() {
                let [b, c, d] = [piece[1].x, 2.0 * piece[2].x, 3.0 * piece[3].x];
                // Where the velocity b + c t + d t² is zero, without a difference of what is nearly the same.
                let root = 0.5 * (-c - c.signum() * (c * c - 4.0 * b * d).sqrt());
                let turns = [h, root / d, b / root, -0.5 * c / d];
                for t in turns.into_iter().filter(|t| (0.0..=h).contains(t)) {
                    let at = horner(piece, t);
                    let [low, high] = &mut peaks.positions[joint];
                    (*low, *high) = (low.min(at.x[0]), high.max(at.x[0]));
                    peaks.speeds[joint] = peaks.speeds[joint].max(at.dx[0].abs());
                }
                let [start, end] = [0.0, h].map(|t| horner(piece, t).ddx[0].abs());
                peaks.accelerations[joint] = peaks.accelerations[joint].max(start).max(end);
                let ends = [(i == 0, start), (i + 2 == self.times.len(), end)];
                let jumps = ends.map(|(is_end, pull)| if is_end { pull / h } else { 0.0 });
                let jerk = (6.0 * piece[3].x).abs().max(jumps[0]).max(jumps[1]);
                peaks.jerks[joint] = peaks.jerks[joint].max(jerk);
            }
        }
        peaks
    }

    /// The number of joints.
    pub fn dof(&self) -> usize {
        self.n
    }

    /// Where it starts \[rad or m\].
    pub fn first(&self) -> &[f64] {
        &self.first
    }

    /// Where it ends \[rad or m\].
    pub fn last(&self) -> &[f64] {
        &self.last
    }

    /// The instants of its knots \[s\].
    pub fn times(&self) -> &[f64] {
        &self.times
    }

    /// Where it is at its knots, the last one but for rounding \[rad or m\].
    pub(crate) fn points(&self) -> Vec<Vec<f64>> {
        let mut state = [0; 3].map(|_| vec![0.0; self.n]);
        let mut at = |t: &f64| {
            self.on_spline(*t, state.each_mut().map(Vec::as_mut_slice));
            state[0].clone()
        };
        self.times.iter().map(&mut at).collect()
    }

    /// When it starts and when it ends \[s\].
    pub fn span(&self) -> [f64; 2] {
        [self.times[0], self.times[self.times.len() - 1]]
    }

    /// Positions, velocities and accelerations of all joints at time `t` \[s\]. Does not allocate.
    ///
    /// # Panics
    /// If one of the slices has not a number for each joint.
    pub fn at(&self, t: f64, [q, dq, ddq]: [&mut [f64]; 3]) {
        self.on_spline(t, [&mut *q, &mut *dq, &mut *ddq]);
        if let Some(before) = &self.before {
            add(before.at(t), [q, dq, ddq]);
        }
    }

    /// Makes of positions, velocities and accelerations at time `t` \[s\] those of the posture that the null space is drawn to.
    ///
    /// # Panics
    /// If one of the slices has not a number for each joint.
    pub fn draw(&self, t: f64, state: [&mut [f64]; 3]) {
        if let Some(drawn) = &self.drawn {
            add(drawn.each_at(t), state);
        }
    }

    fn on_spline(&self, t: f64, [q, dq, ddq]: [&mut [f64]; 3]) {
        let [start, end] = self.span();
        let outside = [(t < start, &self.first), (t > end, &self.last)];
        if let Some((_, there)) = outside.into_iter().find(|(is_there, _)| *is_there) {
            q.copy_from_slice(there);
            dq.fill(0.0);
            ddq.fill(0.0);
            return;
        }
        let i = self.times[1..self.times.len() - 1].partition_point(|time| *time <= t);
        let since = t - self.times[i];
        for (joint, piece) in self.pieces[i * self.n..(i + 1) * self.n].iter().enumerate() {
            let at = horner(piece, since);
            (q[joint], dq[joint], ddq[joint]) = (at.x[0], at.dx[0], at.ddx[0]);
        }
    }
}

/// Adds what is left of each joint.
#[inline(never)] // seldom anything is
fn add(left: impl Iterator<Item = [f64; 3]>, [q, dq, ddq]: [&mut [f64]; 3]) {
    for (joint, [x, dx, ddx]) in left.enumerate() {
        q[joint] += x;
        dq[joint] += dx;
        ddq[joint] += ddx;
    }
}

#[cfg(test)]
mod tests {
    use super::super::Knots;
    use super::*;
    use proptest::prelude::*;

    fn at(spline: &JointSpline, t: f64) -> [Vec<f64>; 3] {
        let mut state = [0; 3].map(|_| vec![0.0; spline.dof()]);
        spline.at(t, state.each_mut().map(Vec::as_mut_slice));
        state
    }

    properties! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// Through every knot, C² across it, the derivatives exact, and at rest at both ends.
        #[test]
        fn smooth_through_every_knot(
            steps in prop::collection::vec(0.2..1.0, 1..9),
            coordinates in prop::collection::vec(-1.0..1.0, 30), fraction in 0.01..0.99_f64,
        ) {
            let mut times = vec![-1.0];
            for step in steps {
                times.push(times[times.len() - 1] + step);
            }
            let points: Vec<_> = coordinates.chunks(3).take(times.len()).map(<[f64]>::to_vec).collect();
            let spline = JointSpline::new(&times, &points).unwrap();
            let h = 1e-4;
            for (k, (t, point)) in times.iter().zip(&points).enumerate() {
                let [q, dq, _] = at(&spline, *t);
                for (a, b) in q.iter().zip(point) {
                    prop_assert!((a - b).abs() < 1e-12);
                }
                if k == 0 || k + 1 == times.len() {
                    prop_assert!(dq.iter().all(|v| v.abs() < 1e-12), "{dq:?}");
                } else {
                    let [before, after] = [at(&spline, t - 1e-9), at(&spline, t + 1e-9)];
                    for k in 0..3 {
                        for (a, b) in before[k].iter().zip(&after[k]) {
                            prop_assert!((a - b).abs() < 1e-5, "derivative {k} jumps at {t}");
                        }
                    }
                }
            }
            for pair in times.windows(2) {
                let t = (pair[0] + fraction * (pair[1] - pair[0])).clamp(pair[0] + h, pair[1] - h);
                let [before, now, after] = [t - h, t, t + h].map(|t| at(&spline, t));
                for joint in 0..3 {
                    for k in 0..2 {
                        let rate = (after[k][joint] - before[k][joint]) / (2.0 * h);
                        prop_assert!((now[k + 1][joint] - rate).abs() < 1e-4);
                    }
                }
            }
            for (t, point) in [(-1.0 - fraction, &points[0]), (99.0, &points[times.len() - 1])] {
                let rest = [point.clone(), vec![0.0; 3], vec![0.0; 3]];
                prop_assert_eq!(at(&spline, t), rest);
            }
        }
    }

    properties! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// With rests it is, bit for bit, one motion from rest to rest after the other, and still in between.
        #[test]
        fn two_knots_that_are_the_same_are_a_rest(
            coordinates in prop::collection::vec(-1.0..1.0, 24), counts in prop::collection::vec(1..4_usize, 1..4), t in 0.0..1.0_f64,
        ) {
            let mut left = coordinates.chunks(2).map(<[f64]>::to_vec);
            let mut points = vec![left.next().unwrap()];
            let mut legs = vec![];
            for count in counts {
                let from = points.len() - 1;
                points.extend(left.by_ref().take(count));
                legs.push(from..points.len());
                points.push(points[points.len() - 1].clone());
            }
            points.pop();
            let times: Vec<f64> = (0_u32..).take(points.len()).map(|k| 0.3 * f64::from(k)).collect();
            let whole = JointSpline::new(&times, &points).unwrap();
            let knots = Knots { times: &times, points: &points, margins: None, shares: None };
            prop_assert_eq!(knots.rest_between(), legs.len() > 1);
            for (leg, next) in legs.iter().zip(legs.iter().skip(1).map(Some).chain([None])) {
                let alone = JointSpline::new(&times[leg.clone()], &points[leg.clone()]).unwrap();
                let [start, end] = alone.span();
                let within = start + t * (end - start);
                prop_assert_eq!(at(&whole, within), at(&alone, within));
                if let Some(next) = next {
                    let resting = end + t * (times[next.start] - end);
                    let [q, dq, ddq] = at(&whole, resting);
                    prop_assert_eq!(&q, &points[leg.end - 1]);
                    prop_assert!(t == 0.0 || dq.iter().chain(&ddq).all(|x| *x == 0.0));
                }
            }
        }

        /// No sample goes farther than the peaks, and samples come near to them.
        #[test]
        fn peaks_are_those_of_all_samples(coordinates in prop::collection::vec(-1.0..1.0, 7), step in 0.1..1.0) {
            let times: Vec<f64> = (0..7).map(|k| step * f64::from(k)).collect();
            let points: Vec<_> = coordinates.iter().map(|q| vec![*q]).collect();
            let spline = JointSpline::new(&times, &points).unwrap();
            let peaks = spline.peaks();
            let mut sampled = [f64::INFINITY, f64::NEG_INFINITY, 0.0, 0.0, 0.0];
            let mut before = 0.0;
            for k in 0..=60_000 {
                let [q, dq, ddq] = at(&spline, 6.0 * step * f64::from(k) / 60_000.0);
                sampled = [
                    sampled[0].min(q[0]), sampled[1].max(q[0]), sampled[2].max(dq[0].abs()), sampled[3].max(ddq[0].abs()),
                    // Within a sample, and at the start from rest within a knot.
                    match k {
                        // At the ends it may be at rest.
                        0 => 0.0,
                        1 => ddq[0].abs() / step,
                        60_000 => sampled[4],
                        _ => sampled[4].max((ddq[0] - before).abs() / (1e-4 * step)),
                    },
                ];
                before = if k < 60_000 { ddq[0] } else { before };
            }
            sampled[4] = sampled[4].max(before.abs() / step);
            let [low, high] = peaks.positions[0];
            let found = [low, high, peaks.speeds[0], peaks.accelerations[0], peaks.jerks[0]];
            let signs = [-1.0, 1.0, 1.0, 1.0, 1.0];
            // A difference of accelerations that are nearly the same is known to fewer digits.
            let rounding = [1e-12, 1e-12, 1e-12, 1e-12, 1e-6 * (1.0 + peaks.jerks[0])];
            for (((found, sampled), sign), rounding) in found.into_iter().zip(sampled).zip(signs).zip(rounding) {
                let beyond = sign * (found - sampled);
                prop_assert!(beyond > -rounding && beyond < 1e-2 * (1.0 + found.abs()), "{found} {sampled}");
            }
        }
    }

    /// The cubic from rest to rest is itself.
    #[test]
    fn two_knots_are_one_cubic() {
        let spline = JointSpline::new(&[0.0, 2.0], &[vec![1.0], vec![3.0]]).unwrap();
        for t in [0.0, 0.3, 1.0, 1.7, 2.0] {
            let s: f64 = 0.5 * t;
            let [q, dq, ddq] = at(&spline, t);
            assert!((q[0] - (1.0 + 2.0 * s * s * (3.0 - 2.0 * s))).abs() < 1e-14);
            assert!((dq[0] - 6.0 * s * (1.0 - s)).abs() < 1e-14);
            assert!((ddq[0] - (3.0 - 6.0 * s)).abs() < 1e-14);
        }
    }

    #[test]
    fn unusable_knots_are_named() {
        let field = |times: &[f64], points: &[Vec<f64>]| {
            JointSpline::new(times, points).unwrap_err().field()
        };
        let point = vec![1.0, 2.0];
        assert_eq!(field(&[0.0], std::slice::from_ref(&point)), "times");
        assert_eq!(field(&[0.0, 1.0], std::slice::from_ref(&point)), "points");
        assert_eq!(field(&[0.0, 0.0], &[point.clone(), point.clone()]), "times[1]");
        assert_eq!(field(&[0.0, 1.0], &[point, vec![1.0]]), "points[1]");
    }

    /// The state goes on from the one motion to the other, and is that of the other after the time it may take.
    #[test]
    fn another_motion_takes_over_without_a_jump() {
        let one =
            JointSpline::new(&[0.0, 1.0, 2.0], &[vec![0.0, 1.0], vec![1.0, 0.5], vec![0.5, 2.0]]);
        let one = one.unwrap();
        let two =
            JointSpline::new(&[0.7, 1.5, 2.5], &[vec![0.8, 0.7], vec![-1.0, 0.0], vec![0.0, 1.0]]);
        let two = two.unwrap();
        let both = two.clone().taking_over(&one, 0.7, 0.5);
        let close = |a: [Vec<f64>; 3], b: [Vec<f64>; 3], most: f64| {
            for (a, b) in a.iter().flatten().zip(b.iter().flatten()) {
                assert!((a - b).abs() < most, "{a} {b}");
            }
        };
        close(at(&both, 0.7), at(&one, 0.7), 1e-12);
        close(at(&both, 0.7 + 0.5 - 1e-9), at(&two, 1.2 - 1e-9), 1e-6);
        assert_eq!(at(&both, 1.3), at(&two, 1.3));
        let h = 1e-5;
        for k in 1..10 {
            let t = 0.7 + 0.05 * f64::from(k) + 0.01;
            let [q, dq, ddq] = at(&both, t);
            let [[q0, dq0, _], [q1, dq1, _]] = [at(&both, t - h), at(&both, t + h)];
            for i in 0..2 {
                assert!(((q1[i] - q0[i]) / (2.0 * h) - dq[i]).abs() < 1e-6, "{t} {q:?}");
                assert!(((dq1[i] - dq0[i]) / (2.0 * h) - ddq[i]).abs() < 1e-5, "{t}");
            }
        }
        // A motion that is being taken over is taken over like any other.
        let three = one.clone().taking_over(&both, 0.9, 0.5);
        close(at(&three, 0.9), at(&both, 0.9), 1e-12);
        // A posture goes on as it was, and the joints do not care.
        let from = [[0.3, 0.0, 0.0], [-0.2, 0.4, -1.5]];
        let drawn = both.clone().drawing_from(from.into_iter(), 0.8, 0.5);
        let posture = |t: f64| {
            let mut state = [0; 3].map(|_| vec![0.0; 2]);
            drawn.at(t, state.each_mut().map(Vec::as_mut_slice));
            drawn.draw(t, state.each_mut().map(Vec::as_mut_slice));
            state
        };
        close(posture(0.8), [vec![0.3, -0.2], vec![0.0, 0.4], vec![0.0, -1.5]], 1e-12);
        assert_eq!((at(&drawn, 0.8), posture(1.31)), (at(&both, 0.8), at(&both, 1.31)));
        // It is let go: half of what it was off, as it moved then, and nothing of how it comes.
        let ([first, then], half) = ([0.8, 1.05].map(|t| at(&both, t)), posture(1.05));
        let off = [[0.3, -0.2], [0.0, 0.4], [0.0, -1.5]];
        for (k, i) in [0, 1, 2].into_iter().flat_map(|k| [(k, 0), (k, 1)]) {
            assert!((half[k][i] - then[k][i] - 0.5 * (off[k][i] - first[k][i])).abs() < 1e-12);
        }
    }
}
