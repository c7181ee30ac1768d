//! What is said of a motion that was found.

use super::in_time::Timing;
use super::planner::{Certified, Planner};
use super::*;

/// Instants at which a motion is looked at between knot `k` and the next \[s\].
fn instants(spline: &JointSpline, k: usize) -> impl Iterator<Item = f64> + use<> {
    let [from, to] = [k, k + 1].map(|k| spline.times()[k]);
    let share = |k: u32| f64::from(k) / f64::from(2 * CHECKS);
    (0..=2 * CHECKS).map(move |k| from + share(k) * (to - from))
}

impl<S: SpaceTypes<D>, const D: usize> Planner<'_, S, D>
where
    S::State: Jointed<D>,
{
    /// The plan, with a sentence of what it keeps.
    pub(super) fn finished(
        &mut self,
        (spline, [margins, shares]): Certified,
        timing: Option<Timing>,
        [samples, nodes]: [usize; 2],
        asked: &Margins,
        off_lines: [Option<f64>; 2],
    ) -> Plan {
        let n = self.start.len();
        let mut state = [0; 3].map(|_| vec![0.0; n]);
        let mut plan = Plan {
            status: PlanStatus::Found,
            message: String::new(),
            times: spline.times().to_vec(),
            q: vec![],
            dq: vec![],
            ddq: vec![],
            tip: vec![],
            clearance: f64::INFINITY,
            margin: [spline.first(), spline.last()]
                .into_iter()
                .filter_map(|end| asked.lowered_at(end))
                .chain(asked.far.iter().copied())
                .fold(f64::INFINITY, f64::min),
            margins: margins.concat(),
            shares: if self.space.has_own_margins() { shares.concat() } else { vec![] },
            tilt: None,
            view: None,
            begins: timing.map(|_| self.settings.time),
            gap: 0.0,
            samples,
            nodes,
        };
        for t in spline.times() {
            spline.at(*t, state.each_mut().map(Vec::as_mut_slice));
            // Its knots are within the limits but for rounding.
            plan.q.extend(state[0].iter().enumerate().map(|(i, q)| {
                let [lower, upper] = ranges_of(self.arm.limits(), i);
                q.clamp(lower, upper)
            }));
            plan.dq.extend_from_slice(&state[1]);
            plan.ddq.extend_from_slice(&state[2]);
        }
        plan.clearance = self.clearance_of(&spline, &margins);
        if let Some(known) = self.space.course() {
            let [_, end] = spline.span();
            self.space.show(Some([end, end.max(known)]));
            let held = self.space.clearance_within(spline.last(), plan.clearance);
            plan.clearance = plan.clearance.min(held);
        }
        let mut through: Option<(f64, [String; 2], f64)> = None;
        // How far off each is at most where it has to point, whether by more than it may be, and from when on by no more.
        let mut off = vec![(0.0_f64, false, None); self.space.pointings.len()];
        if !self.space.pointings.is_empty() || !self.space.keeps_apart() {
            for t in (0..spline.times().len() - 1).flat_map(|k| instants(&spline, k)) {
                spline.at(t, state.each_mut().map(Vec::as_mut_slice));
                let each = self.space.each_off(&state[0]);
                for ((most, is_off, from), (now, allowed)) in off.iter_mut().zip(each) {
                    *most = most.max(now);
                    if *is_off && now <= allowed {
                        *from = Some(t);
                    }
                    *is_off = now > allowed;
                }
                if let Some((depth, links)) = self.space.passed_through(&state[0])
                    && through.as_ref().is_none_or(|(most, ..)| depth > *most)
                {
                    through = Some((depth, links, t));
                }
            }
        }
        plan.message = format!("a motion of {:.3} s", spline.span()[1]);
        if plan.clearance.is_finite() {
            let _ = write!(plan.message, " that keeps {:.1} mm", 1e3 * plan.clearance);
        }
        plan.message += &timing.map_or_else(String::new, Timing::sentence);
        for (pointing, (most, _, from)) in self.space.pointings.iter().zip(off) {
            let (told, what) = if pointing.is_view() {
                (&mut plan.view, "has the point off its axis")
            } else {
                (&mut plan.tilt, "tilts")
            };
            *told = Some(most);
            let [most, allowed] = [most, pointing.most()].map(f64::to_degrees);
            let _ = write!(plan.message, "; the end effector {what} by up to {most:.1}°");
            let _ = match from {
                None => write!(plan.message, " of {allowed:.1}°"),
                Some(t) => {
                    let t = (100.0 * t).ceil() / 100.0; // not from before
                    write!(plan.message, ", and no more than {allowed:.1}° from {t:.2} s on")
                }
            };
        }
        for (place, off) in ["from the start", "to the goal"].into_iter().zip(off_lines) {
            if let Some(off) = off {
                let _ = write!(plan.message, "; straight {place} but for {}", length(off));
            }
        }
        plan.message += &self.lowered(&spline, asked);
        if let Some((depth, [a, b], t)) = through {
            let _ = write!(
                plan.message,
                "; it takes {a} {:.1} mm into {b} at {t:.2} s, which `controller.self_collision = \"avoid\"` forbids",
                1e3 * depth,
            );
        }
        plan
    }

    /// How near the arm comes to everything outside \[m\], of which links are certain to keep these `margins` around knots: what may come
    /// nearest is looked at first, and what cannot come nearer not at all.
    fn clearance_of(&mut self, spline: &JointSpline, margins: &[Vec<f64>]) -> f64 {
        let most = |(a, b): (&f64, &f64)| a.max(*b);
        let least = |rows: &[Vec<f64>]| {
            rows[0].iter().zip(&rows[1]).map(most).fold(f64::INFINITY, f64::min)
        };
        let mut pieces: Vec<(f64, usize)> =
            margins.windows(2).map(least).enumerate().map(|(k, kept)| (kept, k)).collect();
        sort_by_first(&mut pieces);
        let others = self.space.has_own_margins();
        let (mut clearance, mut state) =
            (f64::INFINITY, [0; 3].map(|_| vec![0.0; self.start.len()]));
        for (kept, k) in pieces {
            if kept > clearance && !others {
                break;
            }
            self.space.show(Some([0, 1].map(|next| spline.times()[k + next])));
            for t in instants(spline, k) {
                spline.at(t, state.each_mut().map(Vec::as_mut_slice));
                clearance = clearance.min(self.space.clearance_within(&state[0], clearance));
            }
        }
        clearance
    }

    /// Where less than the margin is kept, as the end of a sentence.
    fn lowered(&mut self, spline: &JointSpline, asked: &Margins) -> String {
        let most = self.space.asked;
        let differ = self.space.has_own_margins();
        let of = |kept: f64| {
            if differ {
                format!("{:.0} %", 100.0 * kept / most)
            } else {
                format!("{:.1} mm", 1e3 * kept)
            }
        };
        let ends = [("start", spline.first()), ("goal", spline.last())];
        let mut told: Vec<String> = ends
            .into_iter()
            .filter_map(|(place, q)| Some((place, asked.lowered_at(q)?)))
            .map(|(place, kept)| format!("{} at the {place}", of(kept)))
            .collect();
        let least = (0..asked.far.len()).min_by(|a, b| asked.far[*a].total_cmp(&asked.far[*b]));
        if let Some(link) = least.filter(|link| asked.far[*link] < most) {
            let (name, kept) = (self.space.robot().link_name(Some(link)), asked.far[link]);
            told.push(format!("{} by {name} all the way", of(kept)));
        }
        let mut sentence = String::new();
        if !told.is_empty() {
            let told = told.join(", ");
            let margin = if differ {
                "margins".to_owned()
            } else {
                format!("margin of {:.1} mm", 1e3 * most)
            };
            let _ = write!(sentence, "; less than the {margin} is kept: {told}");
        }
        let apart: Vec<String> = ends
            .into_iter()
            .filter_map(|(place, q)| Some((place, asked.apart_lowered_at(q)?)))
            .map(|(place, kept)| format!("{:.2} mm at the {place}", 1e3 * kept))
            .collect();
        if asked.apart < APART {
            let kept = 1e3 * asked.apart;
            let _ = write!(
                sentence,
                "; bodies of the arm keep {kept:.2} mm from each other all the way"
            );
        } else if !apart.is_empty() {
            let (apart, most) = (apart.join(", "), 1e3 * APART);
            let _ = write!(
                sentence,
                "; bodies of the arm keep {apart} from each other, up to {most:.0} mm elsewhere",
            );
        }
        sentence
    }
}
