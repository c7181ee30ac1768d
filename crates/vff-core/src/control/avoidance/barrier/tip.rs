//! How fast the tip moves and turns (T114, T198).

use super::Barrier;
use crate::control::TorqueRange;
use crate::interrupt;
use crate::math::{Vector, dot};
use crate::robot::Robot;

/// w_ω at the largest speed at which the tip may turn \[kg·m²\], beside which what turns with a wrist is light; and from which
/// share of that speed on there is any (T198).
const TURNING: f64 = 3.0;
const CALM: f64 = 0.5;

/// The most planes each for its speed and its turning that a program gets beside the first, and by which share the tip may be
/// beyond what they let it do then.
pub(super) const CUTS: usize = 8;
const SLIGHTLY: f64 = 1e-4;

/// Which acceleration says where the tip goes.
#[derive(Debug, Clone, Copy)]
pub(super) enum Toward<'a> {
    /// The desired one; behind a limit of the torque rate that which acts at present, for another one takes time.
    Desired(Option<&'a TorqueRange>),
    /// The last program's.
    Found(Option<&'a TorqueRange>),
}

/// A constraint of the program that is a plane of (T114).
#[derive(Debug, Clone, Copy)]
pub(super) struct Plane {
    row: usize,
    /// Of how it turns, not of how it moves.
    turns: bool,
}

/// How the tip moves, or turns.
struct Pace<'a, const N: usize> {
    turns: bool,
    /// What is kept of it \[m/s, rad/s\].
    most: f64,
    velocity: Vector<N>,
    /// Its rate while q̈ = 0.
    drift: Vector<N>,
    /// What a joint adds to it.
    column: &'a dyn Fn(usize) -> Vector<N>,
}

impl Barrier {
    /// How fast the tip moves and turns (T114): whether that adds a constraint.
    pub(super) fn keep_tip<R: Robot<D>, const D: usize>(
        &mut self,
        robot: &R,
        toward: Toward<'_>,
    ) -> bool {
        let [speed, turning] = self.tip.map(|most| self.tip_share * most);
        let mut keeps = false;
        if speed.is_finite() {
            let (velocity, drift) = (robot.task_velocity::<D>(), robot.task_bias_acceleration());
            let column = &|i| robot.jacobian_column::<D>(i);
            let pace = Pace { turns: false, most: speed, velocity, drift, column };
            keeps |= self.keep_pace(&pace, robot, toward);
        }
        if turning.is_finite() {
            let [velocity, drift] = robot.turning();
            let column = &|i| robot.turning_column(i);
            let pace = Pace { turns: true, most: turning, velocity, drift, column };
            keeps |= self.keep_pace(&pace, robot, toward);
            let share = (velocity.norm() / turning - CALM) / (1.0 - CALM);
            self.turning_weight = TURNING * share.clamp(0.0, 1.0);
        }
        keeps
    }

    /// A plane that touches the ball of (T114) the way that the tip would go.
    #[inline(never)]
    fn keep_pace<R: Robot<D>, const D: usize, const N: usize>(
        &mut self,
        pace: &Pace<'_, N>,
        robot: &R,
        toward: Toward<'_>,
    ) -> bool {
        let Pace { most, velocity, drift, column, .. } = *pace;
        let n = self.nominal.len();
        interrupt::checkpoint(24 * n);
        let rate = self.rates().resting;
        let later = |ddq: &dyn Fn(usize) -> f64| {
            velocity + (0..n).fold(drift, |sum, i| sum + column(i) * ddq(i)) / rate
        };
        let way = match toward {
            Toward::Desired(Some(_)) => later(&|i| self.present[i]),
            Toward::Desired(None) => later(&|i| self.nominal[i]),
            Toward::Found(_) => later(&|i| self.nominal[i] + self.program.x()[i]),
        };
        let speed = way.norm();
        let way = if speed > 0.0 { way / speed } else { way };
        let is_found = matches!(toward, Toward::Found(_));
        if is_found {
            self.bend(pace, &way, speed);
        }
        let start = self.normals.len();
        self.normals.extend((0..n).map(|i| way.dot(&column(i))));
        let (left, drift) = (most - way.dot(&velocity), way.dot(&drift));
        let Self { present, normals, scratch, .. } = self;
        let normal = &normals[start..];
        let upper = match toward {
            Toward::Desired(Some(range)) | Toward::Found(Some(range)) => {
                robot.mass_solve(normal, scratch);
                let jerk = TorqueRange::braking_jerk(range.jerk(normal, scratch));
                let next = range.period * (dot(normal, present) + drift);
                TorqueRange::most_acceleration(left - next, jerk, rate)
            }
            _ => rate * left,
        };
        let excess = dot(normal, &self.nominal) + drift - upper;
        if is_found {
            let found = excess + dot(normal, self.program.x());
            let most = SLIGHTLY * rate * most;
            if found <= (1.0 + SLIGHTLY) * self.beyond(pace.turns) + most {
                self.normals.truncate(start);
                return false;
            }
            self.softness.push(self.softness[self.shares.len()]); // like a joint's
        }
        self.planes.push(Plane { row: self.bounds.len(), turns: pace.turns });
        self.bounds.push(excess);
        self.normals[start..].iter_mut().for_each(|x| *x = -*x);
        true
    }

    /// How much more the last program lets the tip accelerate than a plane says, where something else costs more \[m/s², rad/s²\].
    fn beyond(&self, turns: bool) -> f64 {
        let Self { planes, normals, bounds, program, nominal, .. } = self;
        let n = nominal.len();
        let beyond = |Plane { row, .. }: &Plane| {
            bounds[*row] - dot(&normals[row * n..(row + 1) * n], program.x())
        };
        planes.iter().filter(|plane| plane.turns == turns).map(beyond).fold(0.0, f64::max)
    }

    /// What the ball of (T114) is beyond its planes, where the last program has it: the curvature of |v + v̇/k|, times what the planes
    /// bear, joins the cost (sequential quadratic programming), so that a few planes are enough.
    fn bend<const N: usize>(&mut self, pace: &Pace<'_, N>, way: &Vector<N>, speed: f64) {
        let rate = self.rates().resting;
        let Self { program, planes, hessian, gradient, nominal, .. } = self;
        let n = nominal.len();
        let is_plane =
            |row: usize| planes.iter().any(|plane| plane.row == row && plane.turns == pace.turns);
        let borne: f64 =
            program.active().filter(|(row, _)| is_plane(*row)).map(|(_, force)| force).sum();
        if borne == 0.0 {
            return;
        }
        let across = |i: usize| {
            let column = (pace.column)(i);
            column - way * way.dot(&column)
        };
        let share = borne / (rate * speed);
        let moved =
            (0..n).fold(Vector::<N>::zeros(), |sum, i| sum + across(i) * program.x()[i]) * share;
        for i in 0..n {
            let column = across(i);
            gradient[i] -= column.dot(&moved);
            for k in 0..=i {
                hessian[i * n + k] += share * column.dot(&across(k));
            }
        }
    }

    /// Adds w_ω J_ωᵀJ_ω (T198): where the task leaves the tip free to turn, the least of motions that slows its turning would turn it
    /// about the lightest axis of the wrist instead, another one in every period.
    #[cold]
    #[inline(never)]
    pub(super) fn weigh_turning<R: Robot<D>, const D: usize>(&mut self, robot: &R) {
        let Self { hessian, turning_weight, nominal, .. } = self;
        let n = nominal.len();
        interrupt::checkpoint(8 * n * n);
        for i in 0..n {
            let weighted = robot.turning_column(i) * *turning_weight;
            for k in 0..=i {
                hessian[i * n + k] += robot.turning_column(k).dot(&weighted);
            }
        }
    }
}
