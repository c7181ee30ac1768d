//! `cbf`: of all accelerations that keep every distance and every limit, the nearest to that of the
//! null-space law (T67–T70).
//!
//! ```text
//! min ½(ẍ − ẍ₀)ᵀW_x(ẍ − ẍ₀) + ½(ν̇ − ν̇₀)ᵀΛ_n(ν̇ − ν̇₀) + ½ρ‖δ‖²
//! so that d̈ + 2kḋ + k²(d − margin) ≥ −δ for every pair, and the same for angles and speeds of the joints,
//!         −τ_max ≤ Mq̈ + Cq̇ + g ≤ τ_max
//! ```
//!
//! Behind a limit of the torque rate the last row says what may be sent next, and the others what must be begun now
//! (T130–T132). Without pairs, the same keeps the limits of the other ways of giving way.

use super::{Keep, Yielding};
use crate::control::distance::{DistanceRate, OwnPair};
use crate::control::quadratic_program::{Outcome, Problem, QuadraticProgram};
use crate::control::{OperationalSpace, TaskMetric, Torque, TorqueRange, torque_range};
use crate::interrupt;
use crate::math::dot;
use crate::robot::Robot;
use crate::world::Contact;
use nalgebra::SMatrix;

/// k where it is not given \[1/s\].
pub const RATE: f64 = 40.0;

/// k \[1/s\].
pub fn rate(settings: &Yielding) -> f64 {
    settings.rate.unwrap_or(RATE)
}

/// Bodies of the arm that are farther apart \[m\] cannot touch within a few 1/k.
pub const OWN_REACH: f64 = 0.3;

/// What they are kept apart \[m\]: little, because shapes that are fitted to links contain more than these.
const OWN_MARGIN: f64 = 0.005;

/// What holds where nothing is given.
struct Usual {
    /// W_x \[kg\].
    task_weight: f64,
    /// ρ: a row that costs as much as the task is violated by a 2000th.
    slack_price: f64,
    /// \[m\].
    activation: f64,
}

/// In a space of dimension `D`: arms in space are heavier and smaller, and leave less of a null space.
fn usual<const D: usize>() -> Usual {
    if D > 2 {
        Usual { task_weight: 300.0, slack_price: 6e5, activation: 0.4 }
    } else {
        Usual { task_weight: 20.0, slack_price: 4e4, activation: 1.2 }
    }
}

/// How much more what is to be kept weighs.
const KEPT: f64 = 10.0;

/// How much more a joint's angle and speed weigh than a distance where the torque rate does not leave room for all.
const JOINTS: f64 = 100.0;

/// Share of a joint's largest speed that is kept where the torque rate couples its braking to that of other joints.
const KEPT_SPEED: f64 = 0.98;

/// What a joint keeps from its limits there \[rad, m\], or a hundredth of its range where that is less: robots end a motion that
/// comes to them.
const KEPT_ANGLE: f64 = 0.01;

/// How much faster the three poles of (T131) are than the two of (T67), which react as early.
pub const THREE_POLES: f64 = 1.5;

/// How near pairs are rows of the QP \[m\] in a space of dimension `D`.
pub fn activation<const D: usize>(settings: &Yielding) -> f64 {
    settings.activation.unwrap_or(usual::<D>().activation)
}

/// W_x = `task_weight` S², what is kept `KEPT` times that (T69).
pub fn weight<const D: usize, const M: usize>(
    settings: &Yielding,
    metric: &TaskMetric<M>,
) -> SMatrix<f64, M, M> {
    let mut weight = metric.weight() * settings.task_weight.unwrap_or(usual::<D>().task_weight);
    if let Some(keep) = settings.keep {
        let kept = if keep == Keep::Position { 0..D } else { D..M };
        kept.for_each(|i| weight[(i, i)] *= KEPT);
    }
    weight
}

/// Barriers that may be violated at one instant; beyond that the QP is left unfinished.
const MOST_VIOLATED: usize = 48;

/// Workspace of the law. The unknown is y = q̈ − q̈₀, so that a row is violated at y = 0 only if its bound is
/// positive, and most instants need no QP at all.
#[derive(Debug, Clone)]
pub struct Barrier {
    program: QuadraticProgram,
    nominal: Vec<f64>,
    /// q̈ at present, behind a limit of the torque rate.
    present: Vec<f64>,
    /// M, row by row.
    mass: Vec<f64>,
    hessian: Vec<f64>,
    gradient: Vec<f64>,
    scratch: Vec<f64>,
    normals: Vec<f64>,
    bounds: Vec<f64>,
    softness: Vec<f64>,
    /// What every joint can be sent \[N·m, N\]; empty if anything.
    ends: Vec<[f64; 2]>,
    /// Largest speed of every joint \[rad/s\].
    speed: Vec<f64>,
    /// Whether that is a limit, and not only what is reckoned with.
    keeps_speeds: bool,
    /// See [`Yielding`].
    rate: f64,
    margin: f64,
    slack_price: f64,
}

/// What is to be kept.
#[derive(Debug, Clone, Copy)]
pub struct Kept<'a, const D: usize> {
    /// The distances from obstacles.
    pub pairs: &'a [Contact<D>],
    /// The distances of the bodies from each other.
    pub own: &'a [OwnPair<D>],
    /// What the drives accept next, behind a limit of the torque rate.
    pub range: Option<&'a TorqueRange>,
}

impl Barrier {
    /// For the joints of `robot`.
    pub fn new<R: Robot<D>, const D: usize>(robot: &R, settings: &Yielding) -> Self {
        let n = robot.dof();
        let zeros = |count: usize| vec![0.0; count];
        let mut this = Self {
            program: QuadraticProgram::new(n, 0, MOST_VIOLATED),
            nominal: zeros(n),
            present: zeros(n),
            mass: zeros(n * n),
            hessian: zeros(n * n),
            gradient: zeros(n),
            scratch: zeros(n),
            normals: vec![],
            bounds: vec![],
            softness: vec![],
            ends: Vec::with_capacity(n),
            speed: settings.joint_speeds(robot),
            keeps_speeds: true,
            rate: rate(settings),
            margin: settings.margin,
            slack_price: settings.slack_price.unwrap_or(usual::<D>().slack_price),
        };
        this.reserve(0);
        this
    }

    /// Leaves the speeds of an arm without velocity limits alone.
    pub fn without_speeds<R: Robot<D>, const D: usize>(self, robot: &R) -> Self {
        Self { keeps_speeds: !robot.limits().velocity.is_empty(), ..self }
    }

    /// Room for this many pairs.
    pub fn reserve(&mut self, pairs: usize) {
        let n = self.nominal.len();
        let rows = pairs + 4 * n;
        self.normals.clear();
        self.bounds.clear();
        self.softness.clear();
        self.normals.reserve(rows * n);
        self.bounds.reserve(rows);
        self.softness.reserve(rows);
        self.program.reserve(rows);
    }

    /// Adds M y to the torque and returns the largest δ of a pair \[m/s²\].
    pub fn act<R: Robot<D>, const D: usize, const M: usize>(
        &mut self,
        robot: &R,
        space: &OperationalSpace<M>,
        weight: &SMatrix<f64, M, M>,
        kept: Kept<'_, D>,
        bias: &[f64],
        torque: &mut Torque,
    ) -> f64 {
        robot.accelerate(&torque.total, bias, &mut self.scratch, &mut self.nominal);
        self.normals.clear();
        self.bounds.clear();
        self.softness.clear();
        let softness = 1.0 / self.slack_price;
        let distances = match kept.range {
            None => {
                self.keep_distances(robot, kept);
                let distances = self.bounds.len();
                self.keep_joints(robot);
                self.softness.resize(self.bounds.len(), softness);
                distances
            }
            Some(range) => {
                robot.accelerate(&range.present, bias, &mut self.scratch, &mut self.present);
                self.keep_distances_in_time(robot, kept, range);
                let distances = self.bounds.len();
                self.softness.resize(distances, softness);
                self.keep_joints_in_time(robot, range);
                self.softness.resize(self.bounds.len(), softness / JOINTS);
                distances
            }
        };
        self.ends.clear();
        match kept.range {
            None => self.ends.extend(robot.limits().torque.iter().map(|limit| [-limit, *limit])),
            Some(TorqueRange { lower, upper, .. }) => {
                self.ends.extend(lower.iter().zip(upper).map(|(lower, upper)| [*lower, *upper]));
            }
        }
        let inside = |(tau, [lower, upper]): (&f64, &[f64; 2])| (*lower..=*upper).contains(tau);
        if torque.total.iter().zip(&self.ends).all(inside)
            && self.bounds.iter().all(|bound| *bound <= 0.0)
        {
            return 0.0;
        }
        // Damped, or the smallest of motions would cost next to nothing close to a singularity, and rounding decide (T25).
        self.weigh(&(weight - space.lambda_damped), robot);
        self.keep_torques(&torque.total);
        let outcome = self.program.solve(&Problem {
            hessian: &self.hessian,
            gradient: &self.gradient,
            normals: &self.normals,
            bounds: &self.bounds,
            softness: &self.softness,
        });
        let y = self.program.x();
        let n = y.len();
        if outcome != Outcome::NotConvex {
            torque.add_to_task(|i| dot(&self.mass[i * n..(i + 1) * n], y));
        }
        if outcome != Outcome::Solved {
            torque.cut_to(&self.ends);
        }
        if outcome == Outcome::NotConvex {
            return 0.0; // The state is not finite: the run ends here.
        }
        let missing = |(a, bound): (&[f64], &f64)| bound - dot(a, y);
        let rows = self.normals.chunks_exact(n).zip(&self.bounds).take(distances);
        rows.map(missing).fold(0.0, f64::max)
    }

    /// d̈ + 2kḋ + k²(d − margin) ≥ −δ (T67), with the exact d̈ (T60).
    fn keep_distances<R: Robot<D>, const D: usize>(&mut self, robot: &R, kept: Kept<'_, D>) {
        for pair in kept.pairs {
            let motion = DistanceRate::cautious(robot, pair);
            self.keep_distance(pair.distance - self.margin, motion, |row, _| {
                robot.point_jacobian_tr_mul(pair.link, &pair.point, &pair.normal, row);
            });
        }
        for pair in kept.own {
            let height = pair.nearest.distance - OWN_MARGIN;
            self.keep_distance(height, pair.cautious(robot), |row, scratch| {
                pair.gradient(robot, row, scratch);
            });
        }
    }

    /// The row of a distance that is so much above what is to be kept \[m\].
    #[inline]
    fn keep_distance(
        &mut self,
        height: f64,
        motion: DistanceRate,
        gradient: impl FnOnce(&mut [f64], &mut [f64]),
    ) {
        let Self { rate: k, nominal, normals, bounds, scratch, .. } = self;
        interrupt::spend(64 + nominal.len());
        let start = normals.len();
        normals.resize(start + nominal.len(), 0.0);
        let row = &mut normals[start..];
        gradient(row, scratch);
        let present = dot(row, nominal) + motion.bias;
        bounds.push(-(present + 2.0 * *k * motion.rate + *k * *k * height));
    }

    /// The same behind a limit of the torque rate: what must be begun now so that every distance is kept (T131).
    fn keep_distances_in_time<R: Robot<D>, const D: usize>(
        &mut self,
        robot: &R,
        kept: Kept<'_, D>,
        range: &TorqueRange,
    ) {
        for pair in kept.pairs {
            let motion = DistanceRate::cautious(robot, pair);
            let height = pair.distance - self.margin;
            self.keep_distance_in_time(robot, height, motion, range, |row, _| {
                robot.point_jacobian_tr_mul(pair.link, &pair.point, &pair.normal, row);
            });
        }
        for pair in kept.own {
            let height = pair.nearest.distance - OWN_MARGIN;
            self.keep_distance_in_time(
                robot,
                height,
                pair.cautious(robot),
                range,
                |row, scratch| {
                    pair.gradient(robot, row, scratch);
                },
            );
        }
    }

    /// The row of a distance that is so much above what is to be kept \[m\], begun in time.
    fn keep_distance_in_time<R: Robot<D>, const D: usize>(
        &mut self,
        robot: &R,
        height: f64,
        motion: DistanceRate,
        range: &TorqueRange,
        gradient: impl FnOnce(&mut [f64], &mut [f64]),
    ) {
        let Self { rate, nominal, present, normals, bounds, scratch, .. } = self;
        interrupt::spend(64 + 8 * nominal.len());
        let start = normals.len();
        normals.resize(start + nominal.len(), 0.0);
        let row = &mut normals[start..];
        gradient(row, scratch);
        robot.mass_solve(row, scratch);
        let jerk = range.jerk(row, scratch);
        let now = [height, motion.rate, dot(row, present) + motion.bias];
        let closing = torque_range::CLOSING;
        let least = range.least_acceleration(now, jerk, closing, THREE_POLES * *rate);
        bounds.push(least - (dot(row, nominal) + motion.bias));
    }

    /// The same for the angles and the speeds of the joints (T131, T132).
    fn keep_joints_in_time<R: Robot<D>, const D: usize>(&mut self, robot: &R, range: &TorqueRange) {
        let Self { rate, nominal, present, normals, bounds, scratch, hessian, speed, .. } = self;
        let keeps_speeds = self.keeps_speeds;
        let n = nominal.len();
        let (q, dq, ranges) = (robot.configuration(), robot.velocity(), &robot.limits().joint);
        let unit = &mut hessian[..n];
        unit.fill(0.0);
        for i in 0..n {
            interrupt::spend(10 * n);
            unit[i] = 1.0;
            robot.mass_solve(unit, scratch);
            let jerk = range.jerk(unit, scratch);
            unit[i] = 0.0;
            let next = dq[i] + range.period * present[i];
            let (mut lower, mut upper) = (f64::NEG_INFINITY, f64::INFINITY);
            if keeps_speeds {
                let most = KEPT_SPEED * speed[i];
                upper = TorqueRange::most_acceleration(most - next, jerk, *rate);
                lower = -TorqueRange::most_acceleration(most + next, jerk, *rate);
            }
            if let Some([low, high]) = ranges.get(i) {
                let least = |height, sign: f64| {
                    let now = [height, sign * dq[i], sign * present[i]];
                    sign * range.least_acceleration(now, jerk, speed[i], THREE_POLES * *rate)
                };
                let kept = KEPT_ANGLE.min(0.01 * (high - low));
                lower = lower.max(least(q[i] - low - kept, 1.0));
                upper = upper.min(least(high - q[i] - kept, -1.0));
            }
            for (sign, bound) in [(1.0, lower - nominal[i]), (-1.0, nominal[i] - upper)] {
                let start = normals.len();
                normals.resize(start + n, 0.0);
                normals[start + i] = sign;
                bounds.push(bound);
            }
        }
    }

    /// The same for the angles of the joints, and q̈ ≤ k(q̇_max − q̇) for their speeds (T68).
    fn keep_joints<R: Robot<D>, const D: usize>(&mut self, robot: &R) {
        let (k, n) = (self.rate, self.nominal.len());
        let (q, dq, ranges) = (robot.configuration(), robot.velocity(), &robot.limits().joint);
        for i in 0..n {
            interrupt::spend(2 * n);
            let mut lower = -k * (self.speed[i] + dq[i]);
            let mut upper = k * (self.speed[i] - dq[i]);
            if let Some([low, high]) = ranges.get(i) {
                lower = lower.max(-2.0 * k * dq[i] - k * k * (q[i] - low));
                upper = upper.min(-2.0 * k * dq[i] + k * k * (high - q[i]));
            }
            for (sign, bound) in [(1.0, lower - self.nominal[i]), (-1.0, self.nominal[i] - upper)] {
                let start = self.normals.len();
                self.normals.resize(start + n, 0.0);
                self.normals[start + i] = sign;
                self.bounds.push(bound);
            }
        }
    }

    /// H = JᵀW_xJ + NᵀMN = M + Jᵀ(W_x − Λ)J (T69); `difference` is W_x − Λ, close to a singularity with the damped Λ.
    fn weigh<R: Robot<D>, const D: usize, const M: usize>(
        &mut self,
        difference: &SMatrix<f64, M, M>,
        robot: &R,
    ) {
        let n = self.nominal.len();
        self.scratch.fill(0.0);
        for i in 0..n {
            interrupt::spend(16 * n);
            let row = i * n..(i + 1) * n;
            self.scratch[i] = 1.0;
            robot.mass_mul(&self.scratch, &mut self.mass[row.clone()]);
            self.scratch[i] = 0.0;
            let weighted = difference * robot.jacobian_column::<M>(i);
            let (hessian, mass) = (&mut self.hessian[row.clone()], &self.mass[row]);
            for k in 0..=i {
                hessian[k] = mass[k] + robot.jacobian_column::<M>(k).dot(&weighted);
            }
        }
    }

    /// lower ≤ τ₀ + M y ≤ upper (T70): hard rows, which never contradict each other because M is regular.
    fn keep_torques(&mut self, nominal: &[f64]) {
        let n = self.nominal.len();
        for (i, ([lower, upper], tau)) in self.ends.iter().zip(nominal).enumerate() {
            let row = &self.mass[i * n..(i + 1) * n];
            self.normals.extend_from_slice(row);
            self.normals.extend(row.iter().map(|m| -m));
            self.bounds.extend([lower - tau, tau - upper]);
            self.softness.extend([0.0, 0.0]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::{Avoidance, Controller, Gains, Output};
    use crate::math::{ScalarOrVec, Vector};
    use crate::robot::{Manipulator, Model, PlanarState};
    use crate::scenario::Scenario;
    use crate::simulation::Control;
    use crate::trajectory::Trajectory;
    use crate::world::plane::World;
    use clarabel::algebra::CscMatrix;
    use clarabel::solver::{
        DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus, SupportedConeT,
    };
    use nalgebra::DMatrix;
    use std::sync::Arc;

    /// y by Clarabel, every soft row with an unknown of its own.
    fn oracle(barrier: &Barrier) -> Vec<f64> {
        let (n, m) = (barrier.nominal.len(), barrier.bounds.len());
        let soft: Vec<usize> = (0..m).filter(|&i| barrier.softness[i] > 0.0).collect();
        let size = n + soft.len();
        let mut p = DMatrix::<f64>::zeros(size, size);
        let mut a = DMatrix::<f64>::zeros(m, size);
        for i in 0..n {
            for k in 0..=i {
                p[(k, i)] = barrier.hessian[i * n + k];
            }
        }
        for i in 0..m {
            for k in 0..n {
                a[(i, k)] = -barrier.normals[i * n + k];
            }
        }
        for (k, &i) in soft.iter().enumerate() {
            p[(n + k, n + k)] = 1.0 / barrier.softness[i];
            a[(i, n + k)] = -1.0;
        }
        let columns = |matrix: &DMatrix<f64>| -> Vec<Vec<f64>> {
            matrix.row_iter().map(|row| row.iter().copied().collect()).collect()
        };
        let b: Vec<f64> = barrier.bounds.iter().map(|b| -b).collect();
        let cones: Vec<SupportedConeT<f64>> = vec![NonnegativeConeT(m)];
        let settings = DefaultSettings {
            verbose: false,
            tol_gap_abs: 1e-10,
            tol_gap_rel: 1e-10,
            tol_feas: 1e-10,
            ..DefaultSettings::default()
        };
        let [p, a] = [&p, &a].map(|matrix| CscMatrix::from(&columns(matrix)));
        let mut solver =
            DefaultSolver::new(&p, &vec![0.0; size], &a, &b, &cones, settings).unwrap();
        solver.solve();
        let status = solver.solution.status;
        assert!(matches!(status, SolverStatus::Solved | SolverStatus::AlmostSolved), "{status:?}");
        solver.solution.x[..n].to_vec()
    }

    /// The controller of a scenario, with its world and its reference.
    fn loop_of(
        scenario: &Scenario,
    ) -> (Controller<PlanarState, 2, 2>, World, Trajectory<Vector<2>, 2>) {
        let scene = scenario.scene.plane().unwrap();
        let arm = Arc::new(scene.arm.build().unwrap());
        let mut start = arm.state();
        start.update(&scenario.q0, &vec![0.0; arm.dof()]);
        let trajectory =
            Trajectory::new(&scene.reference, &Manipulator::<2, 2>::pose(&start)).unwrap();
        let controller = Controller::new(arm.state(), Gains::new(&scenario.controller));
        (controller, World::new(scene.obstacles.clone()), trajectory)
    }

    /// The QPs of a run, also of one whose torque limits act, or the limits of their rate, have the solutions that Clarabel
    /// finds.
    #[test]
    fn the_qps_of_a_run_agree_with_clarabel() {
        let text = include_str!("../../../tests/scenarios/on-path.toml");
        for (torque, rate) in [(None, None), (Some(40.0), None), (None, Some(300.0))] {
            let mut scenario = Scenario::from_toml(text).unwrap();
            scenario.controller.avoidance = Avoidance::Cbf;
            scenario.simulation.control = Control::Hold;
            let [torque, rate] = [torque, rate].map(|limit| limit.map(ScalarOrVec::Uniform));
            scenario.scene.plane_mut().unwrap().arm.torque_limits.clone_from(&torque);
            scenario.controller.command.torque_rate.clone_from(&rate);
            let (mut controller, mut world, trajectory) = loop_of(&scenario);
            let mut output = Output::new(&scenario.controller.command, scenario.q0.len());
            let mut sent: Option<Vec<f64>> = None;
            let mut run = scenario.prepare().unwrap().run;
            let (mut solved, mut at_limit) = (0, 0);
            while run.step() {
                let s = run.snapshot();
                world.update(s.t);
                controller.observe(s.q, s.dq, &mut world);
                if let Some(sent) = &sent {
                    controller.expect(&mut output, sent, 1e-3);
                }
                controller.command(&trajectory.at(s.t));
                sent = Some(s.torque.total.clone());
                let barrier = controller.avoider.as_ref().unwrap().barrier.as_ref().unwrap();
                // A breach by rounding alone, 1e-15, is beyond an interior-point method.
                if barrier.bounds.iter().all(|b| *b <= 1e-9) {
                    continue;
                }
                solved += 1;
                at_limit += usize::from(barrier.program.active().any(|(i, _)| i >= 18));
                if solved % 5 == 0 {
                    let (found, expected) = (barrier.program.x(), oracle(barrier));
                    let scale = expected.iter().fold(1.0, |m: f64, y| m.max(y.abs()));
                    for (y, expected) in found.iter().zip(&expected) {
                        assert!((y - expected).abs() < 1e-6 * scale, "{found:?} {expected:?}");
                    }
                }
            }
            assert!(solved > 500, "{solved}");
            let often = if rate.is_some() { 10 } else { 50 }; // demands are shaped for the rate
            assert_eq!(at_limit > often, torque.or(rate).is_some(), "{at_limit}");
        }
    }

    /// A link held flat above a box, a capsule and a polygon, pushed down by its task, rocks through
    /// parallel: in steps of 1e-5 rad the torque never changes by more than 0.05 N·m, and it pushes back.
    #[test]
    fn a_link_rocks_on_a_flat_side_without_a_jump() {
        let shapes = [
            r#"{ kind = "box", size = [0.6, 0.2] }"#,
            r#"{ kind = "capsule", a = [-0.3, 0], b = [0.3, 0], radius = 0.1 }"#,
            r#"{ kind = "polygon", vertices = [[-0.3, -0.2], [0.3, -0.2], [0.3, 0.1], [-0.3, 0.1]] }"#,
        ];
        for shape in shapes {
            let text = format!(
                r#"
                duration = 1.0
                q0 = [1.2, -1.2, 0.0]
                arm = {{ lengths = [1, 1, 1], masses = 1, radius = 0.05 }}
                reference = {{ kind = "setpoint", point = [2.3, 0.5] }}
                controller.avoidance = "cbf"
                controller.yielding = {{ margin = 0.03, rate = 20, task_weight = 5 }}
                [[obstacles]]
                shape = {shape}
                position = [1.86, 0.74]
                "#
            );
            let scenario = Scenario::from_toml(&text).unwrap();
            let (mut controller, mut world, trajectory) = loop_of(&scenario);
            let mut last: Option<Vec<f64>> = None;
            let (mut largest, mut pushed): (f64, usize) = (0.0, 0);
            for k in -1000..=1000 {
                let q = [1.2, -1.2 + 1e-5 * f64::from(k), 0.0];
                controller.observe(&q, &[0.0, -0.2, 0.0], &mut world);
                let torque = controller.command(&trajectory.at(0.0)).total.clone();
                pushed += usize::from(controller.slack().unwrap() > 0.0);
                if let Some(last) = last {
                    let change = last.iter().zip(&torque).map(|(a, b)| (a - b).abs());
                    largest = change.fold(largest, f64::max);
                }
                last = Some(torque);
            }
            assert!(largest < 0.05, "{shape}: {largest}");
            assert_eq!(pushed, 2001, "{shape}");
        }
    }
}
