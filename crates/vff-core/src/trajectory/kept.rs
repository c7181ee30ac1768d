//! What every link keeps along a plan: a uniform cubic B-spline that stays below what was said at the knots (T151).

use super::piecewise;
use super::taking_over::Fading;
use super::{Pace, TrajectoryError};
use crate::math::smoothstep;

/// Control points reach over so many knots to either side.
const REACH: usize = 2;

/// What every link keeps from obstacles, over time: C² where the knots are evenly spaced, and between two of them at most the
/// smaller of what was said there. Of obstacles that have a margin of their own it is the share of that which each link keeps.
///
/// # Example
/// ```
/// use vff_core::trajectory::{KeptMargins, Pace};
///
/// let kept = KeptMargins::new(&[0.0, 1.0], &[vec![0.02], vec![0.05]], None, 1).unwrap();
/// let mut margins = [[0.0; 3]; 2];
/// kept.at(&Pace::of_time(0.0), 0.1, &mut margins);
/// assert!((margins[0][0] - 0.02).abs() < 1e-12 && (margins[1][0] - 1.0).abs() < 1e-12);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct KeptMargins {
    times: Vec<f64>,
    /// The least of the knots around, of all links at the first knot \[m\], of margins of their own behind that, then of all at the next.
    control: Vec<f64>,
    links: usize,
    /// How much more is still kept because it was before, of each link, and whether the reference before said anything.
    before: Option<(Fading, bool)>,
}

impl KeptMargins {
    /// Of `margins` \[m\] at `times` \[s\], a number for each of so many `links`, and `shares` of margins of their own alike: all of
    /// these without.
    ///
    /// # Errors
    /// With times that do not increase, not as many margins as times, or margins of another length.
    pub fn new(
        times: &[f64],
        margins: &[Vec<f64>],
        shares: Option<&[Vec<f64>]>,
        links: usize,
    ) -> Result<Self, TrajectoryError> {
        piecewise::check(times, times.len())?;
        for (field, rows) in [("margins", Some(margins)), ("shares", shares)] {
            let Some(rows) = rows else { continue };
            if times.len() != rows.len() {
                let (expected, given) = (times.len(), rows.len());
                return Err(TrajectoryError::RowCount { field, expected, given });
            }
            if let Some(i) = rows.iter().position(|row| row.len() != links) {
                let (field, given) = (format!("{field}[{i}]"), rows[i].len());
                return Err(TrajectoryError::Joints { field, expected: links, given });
            }
        }
        let mut control = Vec::with_capacity(2 * times.len() * links);
        for k in 0..times.len() {
            let around = k.saturating_sub(REACH)..times.len().min(k + REACH + 1);
            let least = |rows: &[Vec<f64>], link: usize| {
                rows[around.clone()].iter().map(|row| row[link]).fold(f64::INFINITY, f64::min)
            };
            control.extend((0..links).map(|link| least(margins, link)));
            control.extend((0..links).map(|link| shares.map_or(1.0, |rows| least(rows, link))));
        }
        Ok(Self { times: times.to_vec(), control, links, before: None })
    }

    /// The same, of which at time `t` \[s\] each link still keeps what it has kept until then: what `old` says, or if that says nothing,
    /// `usual` \[m\], which is the most. `duration` \[s\], > 0, later it keeps what it is known to keep.
    #[must_use]
    pub fn taking_over(mut self, old: Option<&Self>, usual: f64, t: f64, duration: f64) -> Self {
        let mut before = vec![[usual, 0.0, 0.0]; self.links];
        before.resize(2 * self.links, [1.0, 0.0, 0.0]);
        let mut kept = before.clone();
        if let Some(old) = old {
            old.at(&Pace::of_time(t), usual, &mut before);
        }
        self.known_at(&Pace::of_time(t), usual, &mut kept);
        let left = before.iter().zip(&kept);
        let left = left.map(|([before, ..], [now, rate, change])| [before - now, -rate, -change]);
        self.before = Some((Fading::new(t, duration, left), old.is_some()));
        self
    }

    /// How much of what is kept at time `t` \[s\] is said by the plan, from 0 to 1.
    pub fn share(&self, t: f64) -> f64 {
        match &self.before {
            Some((fading, false)) => smoothstep(fading.passed(t)),
            _ => 1.0,
        }
    }

    /// What each link keeps at `pace` \[m\], no more than `most`, and behind that of margins of their own, with the first and second
    /// derivative in time. Does not allocate.
    pub fn at(&self, pace: &Pace, most: f64, kept: &mut [[f64; 3]]) {
        self.known_at(pace, most, kept);
        let Some((before, _)) = &self.before else { return };
        for ([x, dx, ddx], [value, rate, change]) in before.at(pace.time).zip(kept) {
            *value += x;
            *rate += dx * pace.speed;
            *change += ddx * pace.speed * pace.speed + dx * pace.change;
        }
    }

    /// The same without what is kept because it was before.
    pub fn known_at(&self, pace: &Pace, most: f64, kept: &mut [[f64; 3]]) {
        let [first, last] = [self.times[0], self.times[self.times.len() - 1]];
        let i = self.times[1..self.times.len() - 1].partition_point(|time| *time <= pace.time);
        let duration = self.times[i + 1] - self.times[i];
        let s = ((pace.time - self.times[i]) / duration).clamp(0.0, 1.0);
        let (r, moves) = (1.0 - s, (first..=last).contains(&pace.time));
        let weights = [
            r * r * r / 6.0,
            (3.0 * s * s * s - 6.0 * s * s + 4.0) / 6.0,
            (-3.0 * s * s * s + 3.0 * s * s + 3.0 * s + 1.0) / 6.0,
            s * s * s / 6.0,
        ];
        let slopes = [-0.5 * r * r, 1.5 * s * s - 2.0 * s, -1.5 * s * s + s + 0.5, 0.5 * s * s];
        let bends = [r, 3.0 * s - 2.0, 1.0 - 3.0 * s, s];
        for (column, kept) in kept.iter_mut().enumerate() {
            let most = if column < self.links { most } else { 1.0 };
            let point = |k: usize| {
                let knot = (i + k).saturating_sub(1).min(self.times.len() - 1);
                self.control[2 * knot * self.links + column].min(most)
            };
            let sum = |weights: &[f64; 4]| (0..4).map(|k| weights[k] * point(k)).sum::<f64>();
            *kept = [sum(&weights), 0.0, 0.0];
            if moves {
                let (slope, bend) = (sum(&slopes) / duration, sum(&bends) / (duration * duration));
                kept[1] = slope * pace.speed;
                kept[2] = bend * pace.speed * pace.speed + slope * pace.change;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    properties! {
        /// Never above what was said at either knot around, nor above the most that is asked for; its derivatives are those
        /// of what it changes by, at any pace, and it is at rest outside.
        #[test]
        fn stays_below_its_knots(
            said in prop::collection::vec(0.0..0.03, 12), most in 0.0..0.04, at in 0.01..0.99, speed in 0.1..1.0,
        ) {
            let times: Vec<f64> = (0..12).map(|k| 0.04 * f64::from(k)).collect();
            let rows: Vec<Vec<f64>> = said.iter().map(|margin| vec![1.0, *margin]).collect();
            let shares: Vec<Vec<f64>> = said.iter().map(|margin| vec![1.0, *margin]).collect();
            let kept = KeptMargins::new(&times, &rows, Some(&shares), 2).unwrap();
            let read = |t: f64| {
                let mut found = [[0.0; 3]; 4];
                kept.at(&Pace { time: t, speed, change: 0.0 }, most, &mut found);
                // A share of a margin of its own is told in the same way, whatever is asked for of others.
                assert!(found[2].iter().zip([1.0, 0.0, 0.0]).all(|(a, b)| (a - b).abs() < 1e-9));
                assert!(found[3][0] >= found[1][0] - 1e-12);
                found[1]
            };
            for k in 0..11 {
                let t = times[k] + at * 0.04;
                let [value, rate, bend] = read(t);
                prop_assert!((0.0..=most.min(said[k]).min(said[k + 1]) + 1e-15).contains(&value));
                let h = 1e-6;
                let [before, after] = [read(t - h * speed), read(t + h * speed)];
                for (k, derivative) in [rate, bend].into_iter().enumerate() {
                    let slope = (after[k] - before[k]) / (2.0 * h);
                    prop_assert!((slope - derivative).abs() < 1e-3 * (1.0 + derivative.abs()), "{slope} {derivative}");
                }
            }
            prop_assert_eq!(read(-1.0)[1..].to_vec(), vec![0.0, 0.0]);
            prop_assert!((read(1.0)[0] - read(0.44)[0]).abs() < 1e-15);
        }
    }

    /// What was kept before is kept on at first, whether it was usual or said, and fades with its derivatives, at any pace.
    #[test]
    fn what_was_kept_before_fades() {
        let times: Vec<f64> = (0..30).map(|k| 0.04 * f64::from(k)).collect();
        let said = |least: f64| {
            let rows = times.iter().map(|t| vec![least + 0.01 * (9.0 * t).sin().abs()]);
            KeptMargins::new(&times, &rows.collect::<Vec<_>>(), None, 1).unwrap()
        };
        let (old, new) = (said(0.008), said(0.003));
        let (usual, h) = (0.02, 1e-6);
        for before in [None, Some(&old)] {
            let taken = new.clone().taking_over(before, usual, 0.3, 0.5);
            let read = |kept: &KeptMargins, t: f64| {
                let mut found = [[0.0; 3]];
                kept.at(&Pace { time: t, speed: 0.5, change: 0.0 }, usual, &mut found);
                found[0]
            };
            let wanted = before.map_or(usual, |old| read(old, 0.3)[0]);
            let [value, rate, bend] = read(&taken, 0.3);
            assert!((value - wanted).abs() + rate.abs() + bend.abs() < 1e-12);
            for k in 0..40 {
                let t = 0.301 + 0.0123 * f64::from(k);
                let [_, rate, bend] = read(&taken, t);
                // A second of the clock's time takes two.
                let [before, after] = [t - 0.5 * h, t + 0.5 * h].map(|t| read(&taken, t));
                for (k, derivative) in [rate, bend].into_iter().enumerate() {
                    let slope = (after[k] - before[k]) / (2.0 * h);
                    assert!((slope - derivative).abs() < 1e-3 * (1.0 + derivative.abs()));
                }
            }
            assert_eq!(read(&taken, 0.81).map(f64::to_bits), read(&new, 0.81).map(f64::to_bits));
            let wanted = if before.is_none() { [0.0, 0.5, 1.0] } else { [1.0; 3] };
            for (t, wanted) in [0.3, 0.55, 0.8].into_iter().zip(wanted) {
                assert!((taken.share(t) - wanted).abs() < 1e-12);
            }
        }
    }
}
