//! When a motion goes: it begins later, or goes more slowly, where it would meet what moves (T206).

use super::planner::{Certified, Planner};
use super::*;

/// How many times as long it takes.
const SLOWER: [f64; 5] = [1.0, 1.4, 2.0, 2.8, 4.0];
/// How many times after now are tried at which it begins.
const DELAYS: u32 = 40;

impl<S: SpaceTypes<D>, const D: usize> Planner<'_, S, D>
where
    S::State: Jointed<D>,
{
    /// The motion that is at its end the earliest of those that nothing meets, of which some begin later and some go more slowly, and how
    /// it is timed; None if there is none. As it is where what moves is in the way all the time.
    pub(super) fn let_pass(&mut self, certified: Certified) -> Option<(Certified, Option<Timing>)> {
        let Some(known) = self.space.course() else { return Some((certified, None)) };
        let (spline, _) = certified;
        let [_, end] = spline.span();
        let mut all: Vec<(f64, Timing)> = vec![];
        for slower in SLOWER {
            for k in 0..=DELAYS {
                let delay = known * f64::from(k) / f64::from(DELAYS);
                all.push((delay + slower * end, Timing { delay, slower }));
            }
        }
        sort_by_first(&mut all);
        let found = all.into_iter().find_map(|(end, timing)| {
            let motion = timing.of(&spline).filter(|_| end <= LONGEST)?;
            if !self.is_met_by_nothing(&motion, known) {
                return None;
            }
            // At the goal it keeps what it does until the horizon ends.
            let held = held_until(&motion, known);
            let kept = self.kept_along(held.as_ref().unwrap_or(&motion), true)?;
            let count = motion.times().len();
            let kept = kept.map(|rows| rows.into_iter().take(count).collect());
            Some(((motion, kept), Some(timing)))
        });
        self.space.show(None);
        found
    }

    /// Whether the chords of a motion are clear of what moves, and its end until that is `known` no longer \[s\].
    fn is_met_by_nothing(&mut self, motion: &JointSpline, known: f64) -> bool {
        let times = motion.times();
        let [mut before, mut state] = [0; 2].map(|_| [0; 3].map(|_| vec![0.0; motion.dof()]));
        let end = times[times.len() - 1];
        let last = motion.last().to_vec();
        self.space.is_passed_between(&last, &last, [end, end.max(known)])
            && times.windows(2).all(|pair| {
                motion.at(pair[0], before.each_mut().map(Vec::as_mut_slice));
                motion.at(pair[1], state.each_mut().map(Vec::as_mut_slice));
                self.space.is_passed_between(&before[0], &state[0], [pair[0], pair[1]])
            })
    }
}

/// The motion, with a rest after it until so long after its beginning \[s\]; None if it lasts as long.
fn held_until(spline: &JointSpline, time: f64) -> Option<JointSpline> {
    if spline.span()[1] >= time {
        return None;
    }
    let (mut times, mut points) = (spline.times().to_vec(), points_of(spline));
    times.push(time);
    points.push(spline.last().to_vec());
    JointSpline::new(&times, &points).ok()
}

/// Where a motion is at its knots, at its end to the last bit, as that makes a rest of what follows \[rad or m\].
fn points_of(spline: &JointSpline) -> Vec<Vec<f64>> {
    let mut points = spline.points();
    let last = points.len() - 1;
    points[last].copy_from_slice(spline.last());
    points
}

/// When a motion begins \[s\], and how many times as long it takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Timing {
    pub delay: f64,
    pub slower: f64,
}

impl Timing {
    /// The motion, with a rest before it.
    fn of(self, spline: &JointSpline) -> Option<JointSpline> {
        let Self { delay, slower } = self;
        let mut times: Vec<f64> = spline.times().iter().map(|t| delay + slower * t).collect();
        let mut points = points_of(spline);
        if delay > 0.0 {
            times.insert(0, 0.0);
            points.insert(0, spline.first().to_vec());
        }
        JointSpline::new(&times, &points).ok()
    }

    /// What is said of it, as the end of a sentence.
    pub fn sentence(self) -> String {
        let Self { delay, slower } = self;
        let begins =
            if delay > 0.0 { format!(" begins after {delay:.2} s") } else { String::new() };
        let takes =
            if slower > 1.0 { format!(" takes {slower} times as long") } else { String::new() };
        match (begins.is_empty(), takes.is_empty()) {
            (true, true) => {
                "; it goes where nothing is at that time, though something passes there".to_owned()
            }
            (false, false) => format!("; it{begins} and{takes}, so that what moves passes"),
            _ => format!("; it{begins}{takes}, so that what moves passes"),
        }
    }
}
