//! What is left of a reference that another one has taken the place of: it fades, so that nothing jumps (T121, T179).

use crate::math::quintic::{Coordinates, horner, quintic};
use crate::math::{Vector, smoothstep};

/// Numbers that have faded after a while: a quintic each, from what is left at the start to rest at 0.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Fading {
    start: f64,
    duration: f64,
    pieces: Vec<[Vector<1>; 6]>,
}

impl Fading {
    /// Of what is `left` of each at `start` \[s\], with its first two derivatives, within `duration` \[s\], > 0.
    pub(super) fn new(start: f64, duration: f64, left: impl Iterator<Item = [f64; 3]>) -> Self {
        let rest = [Vector::zeros(); 3];
        let pieces = left.map(|left| quintic(left.map(Vector::<1>::new), rest, duration));
        Self { start, duration, pieces: pieces.collect() }
    }

    /// What is left of each at time `t` \[s\], and its derivatives; nothing before the start and after the end.
    pub(super) fn at(&self, t: f64) -> impl Iterator<Item = [f64; 3]> + '_ {
        let since = t - self.start;
        let is_left = (0.0..self.duration).contains(&since);
        let pieces = if is_left { &self.pieces[..] } else { &[] };
        pieces.iter().map(move |piece| {
            let Coordinates { x, dx, ddx } = horner(piece, since);
            [x[0], dx[0], ddx[0]]
        })
    }

    /// How much of the time has passed at `t` \[s\]: 0 to 1 from its start to its end.
    pub(super) fn passed(&self, t: f64) -> f64 {
        (t - self.start) / self.duration
    }
}

/// How far something was, with its first two derivatives, from what has taken its place, of which less and less is added to what that
/// asks for. An arm that something holds far from its reference is thereby let go: a reference that came back to it would push it away
/// with the speed at which it comes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Remainder<L> {
    start: f64,
    duration: f64,
    left: L,
}

impl<L> Remainder<L> {
    /// Of what is left at `start` \[s\], for `duration` \[s\], > 0.
    pub(super) fn new(start: f64, duration: f64, left: L) -> Self {
        Self { start, duration, left }
    }

    /// The share of it that is left at time `t` \[s\]; None before the start and after the end.
    #[inline]
    fn share(&self, t: f64) -> Option<f64> {
        let gone = (t - self.start) / self.duration;
        (0.0..1.0).contains(&gone).then(|| 1.0 - smoothstep(gone))
    }
}

impl Remainder<[Vector<6>; 3]> {
    /// What is left of a pose, its velocity and its acceleration at time `t` \[s\].
    #[inline]
    pub(super) fn at(&self, t: f64) -> Option<[Vector<6>; 3]> {
        self.share(t).map(|share| self.left.map(|left| left * share))
    }
}

impl Remainder<Vec<[f64; 3]>> {
    /// What is left of each number and its derivatives at time `t` \[s\]; nothing before the start and after the end.
    pub(super) fn each_at(&self, t: f64) -> impl Iterator<Item = [f64; 3]> + '_ {
        let share = self.share(t);
        let all = |share: f64| self.left.iter().map(move |left| left.map(|left| left * share));
        share.into_iter().flat_map(all)
    }
}

#[cfg(test)]
mod tests {
    use crate::math::{Noise, PlanarPose, Pointing, Pose, SpatialPose, UnitQuaternion, Vector};
    use crate::trajectory::{Guided, Pace, Reference, Sample, SpatialReference, Trajectory};

    fn same<P: Guided<M>, const M: usize>(a: &Sample<P, M>, b: &Sample<P, M>, most: f64) {
        let off = a.x.error(&b.x).norm().max((a.dx - b.dx).norm()).max((a.ddx - b.ddx).norm());
        assert!(off < most, "{a:?} is not {b:?}");
    }

    /// From `old` to `new` at 0.7 s: what is asked for goes on from the one to the other, and nothing is left after half a second.
    fn check<P: Guided<M>, const M: usize>(old: &Trajectory<P, M>, new: &Trajectory<P, M>) {
        let both = new.clone().taking_over(old, &Pace::of_time(0.7), 0.5);
        same(&both.at(0.7), &old.at(0.7), 1e-11);
        for k in 0..1000 {
            let t = 0.7 + 5e-4 * f64::from(k);
            same(&both.at(t), &both.at(t + 5e-4), 0.1);
        }
        same(&both.at(1.2 - 1e-7), &new.at(1.2), 1e-5);
        assert_eq!(both.at(1.3), new.at(1.3));
        // Under a clock that goes at another rate as well, which goes on for what is new alone.
        let slow = Pace { time: 0.7, speed: 0.3, change: 0.4 };
        let slowed = new.clone().taking_over(old, &slow, 0.5);
        same(&slowed.at_pace(&slow), &old.at_pace(&slow), 1e-11);
        let soon = slowed.at_pace(&Pace { speed: 0.4, ..slow });
        let faster = (soon.dx - slowed.at_pace(&slow).dx) - new.at(0.7).dx * (0.4 - 0.3);
        assert!(faster.norm() < 1e-12, "{faster}");
        // One that is being taken over is taken over like any other, also for a goal.
        let [mut aimed, again] =
            [both.clone(), old.clone().taking_over(&both, &Pace::of_time(0.9), 0.5)];
        aimed.aim(0.9, &[0.1, 0.2], 10.0);
        for other in [again, aimed] {
            same(&other.at(0.9), &both.at(0.9), 1e-11);
        }
        // Off by what is left, an end effector is not off.
        let left = old.at(0.7).x.error(&new.at(0.7).x);
        assert!((both.way_off::<2>(&Vector::zeros(), 0.7) - left.rows(0, 2).norm()).abs() < 1e-12);
        assert!(both.way_off::<2>(&-left, 0.7) < 1e-12);
        assert!((both.way_off::<2>(&left, 1.3) - left.rows(0, 2).norm()).abs() < 1e-12);
    }

    fn orientation(noise: &mut Noise) -> [f64; 4] {
        UnitQuaternion::exp(&Vector::<3>::from_fn(|_, _| 0.5 * noise.draw())).to_array()
    }

    #[test]
    fn in_space_nothing_jumps() {
        let start = SpatialPose::new(Vector::zeros(), UnitQuaternion::IDENTITY);
        let mut checked = 0;
        for seed in 0..40 {
            let mut noise = Noise::new(seed, 3);
            let mut way = |duration: f64| SpatialReference::Waypoints {
                times: vec![0.0, 0.6, duration],
                points: (0..3).map(|_| [0; 3].map(|_| 0.3 * noise.draw())).collect(),
                orientations: Some((0..3).map(|_| orientation(&mut noise)).collect()),
                relative: false,
            };
            let [old, new] = [way(1.5), way(2.0)];
            let poses = |given| Trajectory::<SpatialPose, 6>::new(given, &start);
            let (Ok(a), Ok(b)) = (poses(&old), poses(&new)) else { continue };
            checked += 1;
            check(&a, &b);
            // In axes of its own, of which one may be turned about z against the other.
            let directions = |given| Trajectory::<Pointing, 5>::new(given, &Pointing(start));
            let [a, b] = [&old, &new].map(|given| directions(given).unwrap());
            let both = b.clone().taking_over(&a, &Pace::of_time(0.7), 0.5);
            let in_world = |sample: &Sample<Pointing, 5>| {
                [sample.dx, sample.ddx].map(|rates| {
                    sample.x.0.orientation().rotate(&Vector::<3>::new(rates[3], rates[4], 0.0))
                })
            };
            let [before, after] = [a.at(0.7), both.at(0.7)];
            assert!(after.x.error(&before.x).norm() < 1e-11);
            let rates = in_world(&before).into_iter().zip(in_world(&after));
            for (before, after) in rates {
                assert!((after - before).norm() < 1e-10, "{before} {after}");
            }
            same(&both.at(1.2 - 1e-7), &b.at(1.2), 1e-5);
            assert_eq!(both.at(1.3), b.at(1.3));
        }
        assert!(checked > 20);
    }

    #[test]
    fn in_the_plane_nothing_jumps() {
        let circle = |phase| Reference::Circle {
            center: [0.3, 0.2],
            radius: 0.5,
            angular_velocity: 1.0,
            phase,
            orientation: None,
        };
        let start = Vector::<2>::zeros();
        let [old, new] = [0.0, 2.0].map(|phase| Trajectory::new(&circle(phase), &start).unwrap());
        check::<Vector<2>, 2>(&old, &new);
        let line = |angle| Reference::Line {
            start: Some(vec![0.0, 1.0, 0.3]),
            end: vec![2.0, 0.0, angle],
            duration: 2.0,
        };
        let start = PlanarPose(Vector::zeros());
        let [old, new] = [0.5, 3.0].map(|angle| Trajectory::new(&line(angle), &start).unwrap());
        check::<PlanarPose, 3>(&old, &new);
    }
}
