//! Which instants of a motion are its knots: where its joints are accelerated evenly, fewer are enough (T207).

/// By how many a piece is longer than others at most: as a power of 2.
const DOUBLINGS: u32 = 2;
/// How far a joint goes in a longer piece at most \[rad or m\], and by how much it may leave its chord in half of one.
const WAY: f64 = 0.08;
const BULGE: f64 = 2e-4;
/// What a longer piece may change of a joint's speed, as a share of the largest.
const CHANGE: f64 = 1e-3;

/// The numbers of those `points` of a motion, `step` \[s\] apart, with which a cubic spline is the same but for so little of these largest
/// `speeds` \[rad/s or m/s\].
pub fn needed(points: &[Vec<f64>], step: f64, speeds: &[f64]) -> Vec<usize> {
    let last = points.len() - 1;
    let mut kept = vec![0];
    let mut at = 0;
    while at < last {
        let lengths = (0..=DOUBLINGS).rev().map(|k| 1usize << k);
        let longest = lengths.filter(|length| at % length == 0 && at + length <= last);
        let length =
            longest.clone().find(|length| is_even(points, [at, at + length], step, speeds));
        at += length.unwrap_or(1);
        kept.push(at);
    }
    kept
}

/// Whether the points between two of these are where one cubic is that goes as they do.
#[expect(clippy::cast_precision_loss, reason = "a few")]
fn is_even(points: &[Vec<f64>], [from, to]: [usize; 2], step: f64, speeds: &[f64]) -> bool {
    let length = to - from;
    if length == 1 {
        return true;
    }
    // The ends come to rest within a few steps.
    if from < 2 || to + 2 >= points.len() {
        return false;
    }
    let count = length as f64;
    (0..speeds.len()).all(|joint| {
        let q = |k: usize| points[k][joint];
        let second = |k: usize| q(k + 1) - 2.0 * q(k) + q(k - 1);
        // A cubic spline with knots h apart is off by q⁗h³/24 of a speed at most (Hall and Meyer, 1976).
        let fourth = |k: usize| (second(k + 1) - 2.0 * second(k) + second(k - 1)).abs();
        let least = 24.0 * CHANGE * speeds[joint] * step / count.powi(3);
        (q(to) - q(from)).abs() <= WAY
            && (from..=to)
                .all(|k| second(k).abs() * count * count <= 32.0 * BULGE && fourth(k) <= least)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trajectory::JointSpline;

    /// From rest to a speed, along evenly, through a bend and to rest: half of the points, and the same motion.
    #[test]
    fn fewer_are_the_same_motion() {
        let step = 0.04;
        let rise = |t: f64| {
            // Speed from 0 to 1 within 0.2 s, and what that comes to.
            let u = (t / 0.2).clamp(0.0, 1.0);
            0.2 * (u.powi(3) - 0.5 * u.powi(4)) + (t - 0.2).max(0.0)
        };
        let count = 200;
        let end = step * f64::from(count);
        let at = |t: f64| {
            let s = rise(t.min(0.5 * end)) + rise(0.5 * end) - rise((end - t).min(0.5 * end));
            vec![0.5 * s, 0.3 * (0.5 * s).sin()]
        };
        let points: Vec<_> = (0..=count).map(|k| at(step * f64::from(k))).collect();
        let kept = needed(&points, step, &[0.5, 0.5]);
        assert!(kept.len() < 110 && kept[..3] == [0, 1, 2], "{}", kept.len());
        assert_eq!(kept[kept.len() - 1], 200);
        let times: Vec<f64> = (0..=count).map(|k| step * f64::from(k)).collect();
        let few = JointSpline::new(
            &kept.iter().map(|k| times[*k]).collect::<Vec<_>>(),
            &kept.iter().map(|k| points[*k].clone()).collect::<Vec<_>>(),
        );
        let [few, all] = [few, JointSpline::new(&times, &points)].map(Result::unwrap);
        let state = |spline: &JointSpline, t: f64| {
            let mut state = [0; 3].map(|_| vec![0.0; 2]);
            spline.at(t, state.each_mut().map(Vec::as_mut_slice));
            state
        };
        for k in 0..4000 {
            let t = end * f64::from(k) / 4000.0;
            let [few, all] = [&few, &all].map(|spline| state(spline, t));
            for joint in 0..2 {
                assert!((few[0][joint] - all[0][joint]).abs() < 1e-5, "{t}");
                assert!((few[1][joint] - all[1][joint]).abs() < 1e-3, "{t}");
            }
        }
        for pair in kept.windows(2) {
            let way = points[pair[1]].iter().zip(&points[pair[0]]).map(|(a, b)| (a - b).abs());
            assert!(pair[1] - pair[0] == 1 || way.fold(0.0, f64::max) <= WAY);
        }
    }
}
