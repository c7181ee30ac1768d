//! How far the joints of an arm carry its links.

use crate::math::Vector;
use crate::robot::{PlanarState, Robot, SpatialState};

/// What a planner asks of an arm beyond the operators of the law.
///
/// # Example
/// ```
/// use vff_core::math::Vector;
/// use vff_core::planning::motion::Jointed;
///
/// fn base<R: Jointed<D>, const D: usize>(robot: &R) -> Vector<D> {
///     robot.joint_position(0)
/// }
/// ```
pub trait Jointed<const D: usize>: Robot<D> {
    /// The origin of joint `i` \[m\].
    fn joint_position(&self, i: usize) -> Vector<D>;
    /// Whether joint `i` slides.
    fn slides(&self, i: usize) -> bool;
    /// What people call joint `i`.
    fn joint_name(&self, i: usize) -> String;
    /// What people call a link; None is the base.
    fn link_name(&self, link: Option<usize>) -> String;
}

impl Jointed<2> for PlanarState {
    fn joint_position(&self, i: usize) -> Vector<2> {
        Self::joint_position(self, i)
    }

    fn slides(&self, _: usize) -> bool {
        false
    }

    fn joint_name(&self, i: usize) -> String {
        format!("joint {i}")
    }

    fn link_name(&self, link: Option<usize>) -> String {
        link.map_or_else(|| "the base".to_owned(), |link| format!("link {link}"))
    }
}

impl Jointed<3> for SpatialState {
    fn joint_position(&self, i: usize) -> Vector<3> {
        Self::joint_position(self, i)
    }

    fn slides(&self, i: usize) -> bool {
        Self::slides(self, i)
    }

    fn joint_name(&self, i: usize) -> String {
        self.arm().joint_names().nth(i).map_or_else(String::new, |name| format!("`{name}`"))
    }

    fn link_name(&self, link: Option<usize>) -> String {
        let named = |link| self.arm().link_names().nth(link).map(|name| format!("`{name}`"));
        link.and_then(named).unwrap_or_else(|| "the base".to_owned())
    }
}

/// How far a motion carries what belongs to the arm \[m\].
#[derive(Debug, Clone)]
pub struct Levers {
    /// How far a point of link l is from joint i at most, number i·n + l; 1 where joint i slides.
    lever: Vec<f64>,
    n: usize,
}

impl Levers {
    /// Of `robot`, which is moved to q = 0.
    pub fn new<R: Jointed<D>, const D: usize>(robot: &mut R) -> Self {
        let n = robot.dof();
        robot.update_positions(&vec![0.0; n]);
        let travel = |k: usize| match robot.limits().joint.get(k) {
            Some([lower, upper]) if robot.slides(k) => lower.abs().max(upper.abs()),
            _ => 0.0,
        };
        let extent = |link: usize| {
            let origin = robot.joint_position(link);
            let bodies = robot.bodies().filter(|body| body.link == link);
            bodies.map(|body| body.reach_from(&origin)).fold(0.0, f64::max)
        };
        let mut lever = vec![0.0; n * n];
        for i in 0..n {
            let mut along = travel(i);
            for link in i..n {
                lever[i * n + link] = if robot.slides(i) { 1.0 } else { along + extent(link) };
                if link + 1 < n {
                    let next = robot.joint_position(link + 1) - robot.joint_position(link);
                    along += next.norm() + travel(link + 1);
                }
            }
        }
        Self { lever, n }
    }

    /// How far `link` goes at most as seen by `from`, the base or a link before it, while the joints go from `a` to `b`.
    pub fn way(&self, [a, b]: [&[f64]; 2], from: Option<usize>, link: usize) -> f64 {
        let first = from.map_or(0, |from| from + 1);
        (first..=link).map(|i| (b[i] - a[i]).abs() * self.lever[i * self.n + link]).sum()
    }
}
