//! A path without corners: the uniform cubic B-spline of points along it, which starts and ends where the path does.

use super::free_space::FreeSpace;
use super::levers::Jointed;
use crate::interrupt;
use crate::world::ObstacleGeometry;

/// How far control points are apart at first, and how often that is halved \[rad, m\].
const SPACING: f64 = 0.3;
const HALVINGS: usize = 6;
/// Chords per span at which a curve is checked.
const CHORDS: u32 = 4;
/// The fewest spans.
const FEWEST: f64 = 4.0;

/// A curve through configurations, C² in its parameter, which runs from 0 to [`end`](Self::end).
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// Control points, with one more beyond either end.
    points: Vec<Vec<f64>>,
}

impl Curve {
    /// Along `path`, with control points `spacing` apart. At the ends, where it is without curvature, it is on the path.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "at least 1, and few"
    )]
    fn along(path: &[Vec<f64>], spacing: f64) -> Self {
        let mut points = vec![path[0].clone()];
        for pair in path.windows(2) {
            let squares = pair[0].iter().zip(&pair[1]).map(|(a, b)| (a - b) * (a - b));
            let pieces = (squares.sum::<f64>().sqrt() / spacing).ceil().max(1.0);
            let few = if path.len() == 2 { FEWEST } else { 2.0 };
            let pieces = pieces.max(few) as u32;
            for k in 1..=pieces {
                let share = f64::from(k) / f64::from(pieces);
                points
                    .push(pair[0].iter().zip(&pair[1]).map(|(a, b)| a + share * (b - a)).collect());
            }
        }
        let beyond = |end: &[f64], inner: &[f64]| -> Vec<f64> {
            end.iter().zip(inner).map(|(end, inner)| 2.0 * end - inner).collect()
        };
        let last = points.len() - 1;
        let after = beyond(&points[last], &points[last - 1]);
        points.insert(0, beyond(&points[0], &points[1]));
        points.push(after);
        Self { points }
    }

    /// Along `path`, as round as it can be in free space; none if it is not free however narrow its corners are.
    pub fn round<R: Jointed<D>, S: ObstacleGeometry<D>, const D: usize>(
        space: &mut FreeSpace<R, S, D>,
        path: &[Vec<f64>],
    ) -> Option<Self> {
        let mut spacing = SPACING;
        for _ in 0..=HALVINGS {
            let curve = Self::along(path, spacing);
            if curve.is_free(space) {
                return Some(curve);
            }
            spacing *= 0.5;
        }
        None
    }

    fn is_free<R: Jointed<D>, S: ObstacleGeometry<D>, const D: usize>(
        &self,
        space: &mut FreeSpace<R, S, D>,
    ) -> bool {
        let n = self.points[0].len();
        let mut state = [0; 3].map(|_| vec![0.0; n]);
        let mut before = self.points[1].clone();
        let spans = u32::try_from(self.points.len() - 3).unwrap_or(u32::MAX);
        (1..=CHORDS * spans).all(|k| {
            self.at(f64::from(k) / f64::from(CHORDS), &mut state);
            let free = space.is_free_between(&before, &state[0]);
            before.copy_from_slice(&state[0]);
            free
        })
    }

    /// The last parameter.
    #[expect(clippy::cast_precision_loss, reason = "few points")]
    pub fn end(&self) -> f64 {
        (self.points.len() - 3) as f64
    }

    /// q, q′ and q″ at the parameter `u`.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "clamped to the spans"
    )]
    pub fn at(&self, u: f64, [q, first, second]: &mut [Vec<f64>; 3]) {
        interrupt::checkpoint(16 * q.len());
        let spans = self.points.len() - 3;
        let i = (u.max(0.0) as usize).min(spans - 1);
        #[expect(clippy::cast_precision_loss, reason = "few spans")]
        let s = u - i as f64;
        let (r, ss) = (1.0 - s, s * s);
        let [a, b, c, d] = [0, 1, 2, 3].map(|k| &self.points[i + k]);
        for k in 0..q.len() {
            q[k] = (r * r * r * a[k]
                + (3.0 * ss * s - 6.0 * ss + 4.0) * b[k]
                + (-3.0 * ss * s + 3.0 * ss + 3.0 * s + 1.0) * c[k]
                + ss * s * d[k])
                / 6.0;
            first[k] = 0.5
                * (-r * r * a[k]
                    + (3.0 * ss - 4.0 * s) * b[k]
                    + (-3.0 * ss + 2.0 * s + 1.0) * c[k]
                    + ss * d[k]);
            second[k] = r * a[k] + (3.0 * s - 2.0) * b[k] + (1.0 - 3.0 * s) * c[k] + s * d[k];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// It starts and ends on the path, its derivatives are those of its points, and on a straight path it is straight.
    #[test]
    fn smooth_from_end_to_end() {
        let path = [vec![0.0, 1.0], vec![1.0, 1.0], vec![1.0, 2.5]];
        let curve = Curve::along(&path, 0.3);
        let at = |u: f64| {
            let mut state = [0; 3].map(|_| vec![0.0; 2]);
            curve.at(u, &mut state);
            state
        };
        for (u, end) in [(0.0, &path[0]), (curve.end(), &path[2])] {
            for (a, b) in at(u)[0].iter().zip(end) {
                assert!((a - b).abs() < 1e-14);
            }
            assert!(at(u)[2].iter().all(|second| second.abs() < 1e-13));
        }
        let h = 1e-5;
        for k in 1..40 {
            let u = curve.end() * f64::from(k) / 40.0;
            let [before, now, after] = [u - h, u, u + h].map(at);
            for order in 0..2 {
                for joint in 0..2 {
                    let rate = (after[order][joint] - before[order][joint]) / (2.0 * h);
                    assert!((rate - now[order + 1][joint]).abs() < 1e-4, "{order} at {u}");
                }
            }
        }
        let straight = Curve::along(&path[..2], 0.3);
        for k in 0..=10 {
            let mut state = [0; 3].map(|_| vec![0.0; 2]);
            straight.at(straight.end() * f64::from(k) / 10.0, &mut state);
            assert!((state[0][0] - 0.1 * f64::from(k)).abs() < 1e-14);
            assert!((state[0][1] - 1.0).abs() < 1e-14);
        }
    }
}
