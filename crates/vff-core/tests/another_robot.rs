//! Another robot than those of the crate runs through the whole loop: a chain with a slider, in dense textbook matrices.
//!
//! [`Chain`] shares no code with `robot::planar`. What it proves is that the law, the fields, `cbf`, look-ahead and the
//! closed loop ask a robot for nothing but [`Robot`]: neither revolute joints, nor one body per link, nor links that
//! begin where the one before ends.

use nalgebra::{DMatrix, DVector, SMatrix, SVector};
use std::sync::Arc;
use vff_core::control::avoidance::preview::{Present, Preview};
use vff_core::control::{
    Avoidance, Budget, Controller, Formulation, Gains, PreviewSettings, Settings, Yielding,
};
use vff_core::field::{Field, FieldKind};
use vff_core::geometry::Body;
use vff_core::math::{Capsule, Vector};
use vff_core::robot::{Limits, Manipulator, Matrices, Model, Robot};
use vff_core::simulation::{
    ClosedLoop, Control, Options, Outcome, Perceive, Perception, PerceptionKind,
    PerceptionSettings, Physics, Reality, Run, SpaceTypes, Status, System, Value,
};
use vff_core::trajectory::{Reference, Sample, Trajectory};
use vff_core::world::plane::{Obstacle, PlanarGeometry, Shape, World};
use vff_core::world::{CollisionQuery, Motion};

type V = Vector<2>;

/// `v` turned by 90°.
fn quarter(v: V) -> V {
    V::new(-v.y, v.x)
}

/// What a joint does to its link.
#[derive(Debug, Clone, Copy)]
enum Kind {
    Revolute,
    /// Slides along this unit vector in the frame of the link before.
    Prismatic(V),
}

#[derive(Debug, Clone, Copy)]
struct Link {
    joint: Kind,
    /// To the next joint, along the link's own x axis \[m\].
    length: f64,
    mass: f64,
    /// In the link's frame \[m\], and the moment of inertia about it \[kg·m²\].
    com: V,
    inertia: f64,
    radius: f64,
}

/// A chain of sliding and turning links. Its last link carries a second body, a finger that sticks out sideways.
#[derive(Debug, Clone)]
struct Chain {
    links: Vec<Link>,
    gravity: V,
    limits: Limits,
}

/// How far the sliders go either way \[m\].
const TRAVEL: f64 = 2.0;
/// The finger: where on the last link it stands, as a share of the length, and how long it is \[m\].
const FINGER: [f64; 2] = [0.5, 0.12];

impl Chain {
    fn new(joints: &[Kind]) -> Arc<Self> {
        let link = |(i, joint): (usize, &Kind)| {
            let length = if matches!(joint, Kind::Revolute) { 0.6 } else { 0.2 };
            let mass = 1.0 + 0.3 * (i as f64);
            // Neither slender nor symmetric.
            let com = V::new(0.45 * length, 0.02);
            Link { joint: *joint, length, mass, com, inertia: 0.1 * mass * length, radius: 0.03 }
        };
        let range = |joint: &Kind| match joint {
            Kind::Revolute => [-6.0, 6.0],
            Kind::Prismatic(_) => [-TRAVEL, TRAVEL],
        };
        Arc::new(Self {
            links: joints.iter().enumerate().map(link).collect(),
            gravity: V::new(0.0, -9.81),
            limits: Limits { joint: joints.iter().map(range).collect(), ..Limits::default() },
        })
    }

    /// A slider along a tilted rail, and three links that turn.
    fn on_a_rail() -> Arc<Self> {
        let rail = Kind::Prismatic(V::new(0.8, 0.6));
        Self::new(&[rail, Kind::Revolute, Kind::Revolute, Kind::Revolute])
    }

    /// A slider that is swung about, whose motion couples with the rotation before it.
    fn telescope() -> Arc<Self> {
        let out = Kind::Prismatic(V::new(1.0, 0.0));
        Self::new(&[Kind::Revolute, out, Kind::Revolute, Kind::Prismatic(V::new(0.0, 1.0))])
    }

    fn frames(&self, q: &[f64], dq: &[f64]) -> (Vec<Frame>, V) {
        let (mut angle, mut rate) = (0.0, 0.0);
        let (mut end, mut end_velocity) = (V::zeros(), V::zeros());
        let mut frames = vec![];
        for ((link, q), dq) in self.links.iter().zip(q).zip(dq) {
            let mut axis = V::zeros();
            match link.joint {
                Kind::Revolute => {
                    angle += q;
                    rate += dq;
                }
                Kind::Prismatic(along) => {
                    axis = turned(angle, along);
                    end_velocity += axis * *dq + quarter(axis) * (rate * q);
                    end += axis * *q;
                }
            }
            frames.push(Frame { angle, rate, origin: end, velocity: end_velocity, axis });
            let along = turned(angle, V::new(link.length, 0.0));
            end += along;
            end_velocity += quarter(along) * rate;
        }
        (frames, end)
    }
}

fn turned(angle: f64, v: V) -> V {
    let (sin, cos) = angle.sin_cos();
    V::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y)
}

/// A link in the world. `axis` is that of a slider; zero if the joint turns.
#[derive(Debug, Clone, Copy)]
struct Frame {
    angle: f64,
    rate: f64,
    origin: V,
    velocity: V,
    axis: V,
}

impl Frame {
    fn at(&self, local: V) -> V {
        self.origin + turned(self.angle, local)
    }

    /// The velocity of the material point that is now at `point`.
    fn velocity_at(&self, point: V) -> V {
        self.velocity + quarter(point - self.origin) * self.rate
    }

    fn turns(&self) -> bool {
        self.axis == V::zeros()
    }

    /// What this joint does to a point farther out: a column of J, and of J̇ for the velocity of the point.
    fn columns(&self, point: V, velocity: V) -> [V; 2] {
        if self.turns() {
            [quarter(point - self.origin), quarter(velocity - self.velocity)]
        } else {
            [self.axis, quarter(self.axis) * self.rate]
        }
    }
}

/// J and J̇ of a point of link `i`, three rows with the angle, (3, n).
fn point_jacobians(frames: &[Frame], i: usize, point: V) -> [DMatrix<f64>; 2] {
    let velocity = frames[i].velocity_at(point);
    let mut both = [DMatrix::zeros(3, frames.len()), DMatrix::zeros(3, frames.len())];
    for (k, frame) in frames[..=i].iter().enumerate() {
        for (matrix, column) in both.iter_mut().zip(frame.columns(point, velocity)) {
            matrix.fixed_view_mut::<2, 1>(0, k).copy_from(&column);
        }
        both[0][(2, k)] = f64::from(u8::from(frame.turns()));
    }
    both
}

/// A [`Chain`] at (q, q̇), with every matrix computed anew at each update.
#[derive(Debug, Clone)]
struct ChainState {
    chain: Arc<Chain>,
    q: Vec<f64>,
    dq: Vec<f64>,
    frames: Vec<Frame>,
    tip: V,
    mass: DMatrix<f64>,
    inverse: DMatrix<f64>,
    coriolis: DMatrix<f64>,
    gravity: DVector<f64>,
    jacobian: DMatrix<f64>,
    jacobian_dot: DMatrix<f64>,
}

impl ChainState {
    /// M = Σ J_iᵀ diag(m, m, I) J_i, and ∂M/∂q_k of it, for ∂J/∂q_k is J̇ at the joint velocity e_k.
    fn refresh(&mut self) {
        let n = self.q.len();
        let inertias = || {
            let links = self.chain.links.iter().enumerate();
            links.map(|(i, link)| (i, link, self.frames[i].at(link.com)))
        };
        let weight = |link: &Link| {
            DMatrix::from_diagonal(&DVector::from_vec(vec![link.mass, link.mass, link.inertia]))
        };
        let mut mass = DMatrix::zeros(n, n);
        let mut gravity = DVector::zeros(n);
        for (i, link, com) in inertias() {
            let [j, _] = point_jacobians(&self.frames, i, com);
            mass += j.transpose() * weight(link) * &j;
            gravity -= j.rows(0, 2).transpose() * self.chain.gravity * link.mass;
        }
        let slopes: Vec<DMatrix<f64>> = (0..n)
            .map(|k| {
                let mut unit = vec![0.0; n];
                unit[k] = 1.0;
                let (frames, _) = self.chain.frames(&self.q, &unit);
                let mut slope = DMatrix::zeros(n, n);
                for (i, link, com) in inertias() {
                    let [j, change] = point_jacobians(&frames, i, com);
                    let half = change.transpose() * weight(link) * j;
                    slope += &half + half.transpose();
                }
                slope
            })
            .collect();
        // Christoffel: c_ij = Σ_k ½ (∂M_ij/∂q_k + ∂M_ik/∂q_j − ∂M_jk/∂q_i) q̇_k.
        let coriolis = DMatrix::from_fn(n, n, |i, j| {
            let symbol =
                |k: usize| 0.5 * (slopes[k][(i, j)] + slopes[j][(i, k)] - slopes[i][(j, k)]);
            (0..n).map(|k| symbol(k) * self.dq[k]).sum()
        });
        let undefined = || DMatrix::from_element(n, n, f64::NAN);
        self.inverse = mass.clone().cholesky().map_or_else(undefined, |root| root.inverse());
        (self.mass, self.coriolis, self.gravity) = (mass, coriolis, gravity);
    }

    fn place(&mut self, q: &[f64], dq: &[f64]) {
        (self.q, self.dq) = (q.to_vec(), dq.to_vec());
        (self.frames, self.tip) = self.chain.frames(q, dq);
        let last = q.len() - 1;
        [self.jacobian, self.jacobian_dot] = point_jacobians(&self.frames, last, self.tip);
    }

    fn velocity_vector(&self) -> DVector<f64> {
        DVector::from_column_slice(&self.dq)
    }

    fn normal_column(&self, i: usize, point: &V, n: &V) -> DVector<f64> {
        point_jacobians(&self.frames, i, *point)[0].rows(0, 2).transpose() * n
    }
}

fn multiply(matrix: &DMatrix<f64>, v: &[f64], out: &mut [f64]) {
    out.copy_from_slice((matrix * DVector::from_column_slice(v)).as_slice());
}

fn top<const M: usize>(matrix: &DMatrix<f64>, i: usize) -> SVector<f64, M> {
    SVector::from_fn(|row, _| matrix[(row, i)])
}

impl Model<2> for Chain {
    type State = ChainState;

    fn dof(&self) -> usize {
        self.links.len()
    }

    fn limits(&self) -> &Limits {
        &self.limits
    }

    fn integrate(&self, q: &mut [f64], v: &[f64], dt: f64) {
        q.iter_mut().zip(v).for_each(|(q, v)| *q += v * dt);
    }

    fn reach(&self) -> f64 {
        let one = |link: &Link| match link.joint {
            Kind::Revolute => link.length,
            Kind::Prismatic(_) => link.length + TRAVEL,
        };
        self.links.iter().map(one).sum()
    }

    fn characteristic_length(&self) -> f64 {
        1.0
    }

    fn typical_torque(self: &Arc<Self>) -> Vec<f64> {
        let (mass, reach) = (self.links.iter().map(|link| link.mass).sum::<f64>(), self.reach());
        let one = |link: &Link| match link.joint {
            Kind::Revolute => mass * self.gravity.norm() * reach,
            Kind::Prismatic(_) => mass * self.gravity.norm(),
        };
        self.links.iter().map(one).collect()
    }

    fn state(self: &Arc<Self>) -> ChainState {
        let n = self.dof();
        let empty = || DMatrix::zeros(0, 0);
        let mut state = ChainState {
            chain: Arc::clone(self),
            q: vec![],
            dq: vec![],
            frames: vec![],
            tip: V::zeros(),
            mass: empty(),
            inverse: empty(),
            coriolis: empty(),
            gravity: DVector::zeros(0),
            jacobian: empty(),
            jacobian_dot: empty(),
        };
        state.update(&vec![0.0; n], &vec![0.0; n]);
        state
    }
}

impl Manipulator<2, 2> for ChainState {
    type Pose = V;

    fn pose(&self) -> V {
        self.tip
    }
}

/// Force, and moment about the origin of the world.
#[derive(Debug, Clone, Copy, Default)]
struct Push {
    force: V,
    moment: f64,
}

impl Robot<2> for ChainState {
    type Wrench = Push;

    fn dof(&self) -> usize {
        self.q.len()
    }

    fn update(&mut self, q: &[f64], dq: &[f64]) {
        self.place(q, dq);
        self.refresh();
    }

    /// Whoever asks for dynamics after this gets nonsense that shows.
    fn update_positions(&mut self, q: &[f64]) {
        let dq = self.dq.clone();
        self.place(q, &dq);
        for matrix in [&mut self.mass, &mut self.inverse, &mut self.coriolis] {
            matrix.fill(f64::NAN);
        }
    }

    fn update_velocities(&mut self, v: &[f64]) {
        let q = self.q.clone();
        self.place(&q, v);
    }

    fn configuration(&self) -> &[f64] {
        &self.q
    }

    fn velocity(&self) -> &[f64] {
        &self.dq
    }

    fn integrate(&self, q: &mut [f64], v: &[f64], dt: f64) {
        self.chain.integrate(q, v, dt);
    }

    fn total_mass(&self) -> f64 {
        self.chain.links.iter().map(|link| link.mass).sum()
    }

    fn limits(&self) -> &Limits {
        &self.chain.limits
    }

    fn mass_mul(&self, v: &[f64], out: &mut [f64]) {
        multiply(&self.mass, v, out);
    }

    fn mass_solve(&self, b: &[f64], out: &mut [f64]) {
        multiply(&self.inverse, b, out);
    }

    fn coriolis_mul(&self, v: &[f64], out: &mut [f64]) {
        multiply(&self.coriolis, v, out);
    }

    fn coriolis_tr_mul(&self, u: &[f64], out: &mut [f64]) {
        multiply(&self.coriolis.transpose(), u, out);
    }

    fn gravity_torque(&self, out: &mut [f64]) {
        out.copy_from_slice(self.gravity.as_slice());
    }

    fn bias_torque(&self, out: &mut [f64]) {
        let bias = &self.coriolis * self.velocity_vector() + &self.gravity;
        out.copy_from_slice(bias.as_slice());
    }

    fn potential_energy(&self) -> f64 {
        let links = self.chain.links.iter().zip(&self.frames);
        links.map(|(link, frame)| -link.mass * self.chain.gravity.dot(&frame.at(link.com))).sum()
    }

    fn turning(&self) -> [Vector<3>; 2] {
        [self.task_velocity::<3>(), self.task_bias_acceleration()]
            .map(|twist| Vector::z() * twist.z)
    }

    fn turning_column(&self, _i: usize) -> Vector<3> {
        Vector::<3>::z()
    }

    fn task_velocity<const M: usize>(&self) -> SVector<f64, M> {
        self.jacobian_mul(&self.dq)
    }

    fn task_bias_acceleration<const M: usize>(&self) -> SVector<f64, M> {
        self.jacobian_dot_mul(&self.dq)
    }

    fn jacobian_column<const M: usize>(&self, i: usize) -> SVector<f64, M> {
        top(&self.jacobian, i)
    }

    fn jacobian_dot_column<const M: usize>(&self, i: usize) -> SVector<f64, M> {
        top(&self.jacobian_dot, i)
    }

    fn task_response<const M: usize>(&self, y: &mut [SVector<f64, M>]) -> SMatrix<f64, M, M> {
        let j = self.jacobian.rows(0, M);
        let response = &self.inverse * j.transpose();
        for (i, y) in y.iter_mut().enumerate() {
            *y = SVector::from_fn(|k, _| response[(i, k)]);
        }
        let product = j * response;
        SMatrix::from_fn(|a, b| product[(a, b)])
    }

    fn body_count(&self) -> usize {
        self.q.len() + 1
    }

    fn body(&self, i: usize) -> Body<'_, 2> {
        let last = self.q.len() - 1;
        let link = i.min(last);
        let (frame, Link { length, radius, .. }) = (&self.frames[link], self.chain.links[link]);
        let [along, out] = FINGER;
        let ends = if i <= last {
            [V::zeros(), V::new(length, 0.0)]
        } else {
            [V::new(along * length, 0.0), V::new(along * length, out)]
        };
        let [start, end] = ends.map(|local| frame.at(local));
        Body::new(link, Capsule::new(start, end, radius))
    }

    /// Links that share no joint, and the finger with all but the last two.
    fn body_pairs(&self) -> impl Iterator<Item = [usize; 2]> {
        let n = self.q.len();
        let links = (2..n).flat_map(|j| (0..j - 1).map(move |i| [i, j]));
        links.chain((0..n.saturating_sub(2)).map(move |i| [i, n]))
    }

    fn point_velocity(&self, i: usize, point: &V) -> V {
        self.frames[i].velocity_at(*point)
    }

    fn point_jacobian_tr_mul(&self, i: usize, point: &V, f: &V, out: &mut [f64]) {
        out.copy_from_slice(self.normal_column(i, point, f).as_slice());
    }

    fn point_bias_acceleration(&self, i: usize, point: &V) -> V {
        let acceleration = &point_jacobians(&self.frames, i, *point)[1] * self.velocity_vector();
        V::new(acceleration[0], acceleration[1])
    }

    fn point_mobility(&self, i: usize, point: &V, n: &V) -> f64 {
        let column = self.normal_column(i, point, n);
        column.dot(&(&self.inverse * &column))
    }

    fn add_force(&self, wrenches: &mut [Push], i: usize, point: &V, f: &V) {
        wrenches[i].force += f;
        wrenches[i].moment += quarter(*point).dot(f);
    }

    fn add_torque(&self, wrenches: &mut [Push], i: usize, torque: &nalgebra::Vector3<f64>) {
        wrenches[i].moment += torque.z;
    }

    fn link_frame(&self, i: usize) -> (V, nalgebra::Matrix2<f64>) {
        let frame = &self.frames[i.min(self.frames.len() - 1)];
        let origin = if i < self.frames.len() { frame.origin } else { self.tip };
        let along = turned(frame.angle, V::x());
        (origin, nalgebra::Matrix2::from_columns(&[along, quarter(along)]))
    }

    fn wrenches_tr_mul(&self, wrenches: &[Push], out: &mut [f64]) {
        for (k, (out, frame)) in out.iter_mut().zip(&self.frames).enumerate() {
            let one = |push: &Push| {
                if frame.turns() {
                    push.moment - quarter(frame.origin).dot(&push.force)
                } else {
                    frame.axis.dot(&push.force)
                }
            };
            *out = wrenches[k..].iter().map(one).sum();
        }
    }

    fn matrices<const M: usize>(&self) -> Matrices<M> {
        let n = self.q.len();
        let rows = |matrix: &DMatrix<f64>| {
            nalgebra::OMatrix::<f64, nalgebra::Const<M>, nalgebra::Dyn>::from_fn(n, |a, b| {
                matrix[(a, b)]
            })
        };
        Matrices {
            mass: self.mass.clone(),
            coriolis: self.coriolis.clone(),
            gravity: self.gravity.clone(),
            jacobian: rows(&self.jacobian),
            jacobian_dot: rows(&self.jacobian_dot),
            velocity: self.velocity_vector(),
        }
    }
}

/// Such chains among planar obstacles.
#[derive(Debug, Clone, Copy)]
struct Sliding;

impl SpaceTypes<2> for Sliding {
    type State = ChainState;
    type Arm = Chain;
    type Geometry = PlanarGeometry;
    type Perception = Perception;
}

impl System<2, 2> for Sliding {
    type Pose = V;

    fn attainable(arm: &Chain, _: &V, goal: &V) -> V {
        goal * (arm.reach() / goal.norm()).min(1.0)
    }
}

fn at(chain: &Arc<Chain>, q: &[f64], dq: &[f64]) -> ChainState {
    let mut state = chain.state();
    state.update(q, dq);
    state
}

fn moved(q: &[f64], v: &[f64], h: f64) -> Vec<f64> {
    q.iter().zip(v).map(|(q, v)| q + h * v).collect()
}

fn assert_close(a: &DMatrix<f64>, b: &DMatrix<f64>, tolerance: f64) {
    assert!((a - b).amax() <= tolerance * (1.0 + b.amax()), "{a} is not {b}");
}

/// J, J̇, Ṁ = C + Cᵀ, Ṁ − 2C skew, g = ∂V/∂q, and what a point of a body does, by central differences.
#[test]
fn operators_agree_with_finite_differences() {
    const H: f64 = 1e-5;
    let (q, dq) = ([0.3, -0.7, 1.1, 0.4], [0.9, -1.3, 0.5, 1.7]);
    for chain in [Chain::on_a_rail(), Chain::telescope()] {
        let now = at(&chain, &q, &dq);
        let [before, after] = [-H, H].map(|h| at(&chain, &moved(&q, &dq, h), &dq));
        let rate = (&after.mass - &before.mass) / (2.0 * H);
        assert_close(&(&now.coriolis + now.coriolis.transpose()), &rate, 1e-8);
        let power = &rate - 2.0 * &now.coriolis;
        assert_close(&power, &-power.transpose(), 1e-8);
        assert!(now.coriolis.amax() > 0.1, "the joints are not coupled");
        let rate = (&after.jacobian - &before.jacobian) / (2.0 * H);
        assert_close(&now.jacobian_dot, &rate, 1e-8);
        let identity = DMatrix::identity(4, 4);
        assert_close(&(&now.mass * &now.inverse), &identity, 1e-12);
        for k in 0..4 {
            let unit = identity.column(k);
            let [back, on] = [-H, H].map(|h| at(&chain, &moved(&q, unit.as_slice(), h), &dq));
            let slope = (on.potential_energy() - back.potential_energy()) / (2.0 * H);
            assert!(
                (now.gravity[k] - slope).abs() < 1e-7,
                "{k}: {} is not {slope}",
                now.gravity[k]
            );
            let column = (on.tip - back.tip) / (2.0 * H);
            assert!((now.jacobian_column::<2>(k) - column).norm() < 1e-8);
        }
        for i in 0..now.body_count() {
            let Body { link, shape, .. } = now.body(i);
            let (point, normal) = (shape.end(), V::new(0.6, -0.8));
            let [p, n] = [&before, &after].map(|state| state.body(i).shape.end());
            assert!((now.point_velocity(link, &point) - (n - p) / (2.0 * H)).norm() < 1e-7);
            let bend =
                [-1e-3, 1e-3].map(|h| at(&chain, &moved(&q, &dq, h), &dq).body(i).shape.end());
            let curve = (bend[0] + bend[1] - 2.0 * point) / 1e-6;
            assert!((now.point_bias_acceleration(link, &point) - curve).norm() < 1e-4, "{i}");
            // A force at the point is the torque of its wrench, and does the power that it does there.
            let (mut column, mut torque) = ([f64::NAN; 4], [f64::NAN; 4]);
            now.point_jacobian_tr_mul(link, &point, &normal, &mut column);
            let mut wrenches = [Push::default(); 4];
            now.add_force(&mut wrenches, link, &point, &normal);
            now.wrenches_tr_mul(&wrenches, &mut torque);
            let [column, torque] =
                [column, torque].map(|torque| DVector::from_column_slice(&torque));
            assert!((&column - &torque).amax() < 1e-14, "{i}");
            let power = column.dot(&now.velocity_vector());
            assert!((power - normal.dot(&now.point_velocity(link, &point))).abs() < 1e-14, "{i}");
        }
    }
}

/// Where the arm of the runs below begins, and the pose it holds.
const START: [f64; 4] = [0.1, 1.2, -0.9, -0.8];

fn start() -> ChainState {
    at(&Chain::on_a_rail(), &START, &[0.0; 4])
}

fn disc(radius: f64, position: V, motion: Motion<2>) -> Obstacle {
    Obstacle { position: position.into(), motion, ..Obstacle::of(Shape::Circle { radius }) }
}

fn linear(velocity: [f64; 2]) -> Motion<2> {
    Motion::Linear { velocity }
}

/// The arm holds its end effector where it is, among these obstacles, for so long \[s\].
fn run(settings: &Settings, options: &Options, obstacles: &[Obstacle], duration: f64) -> Outcome {
    let mut run = prepared(settings, options, obstacles, duration);
    while run.step() {}
    run.outcome()
}

fn prepared(
    settings: &Settings,
    options: &Options,
    obstacles: &[Obstacle],
    duration: f64,
) -> Run<Sliding, 2, 2> {
    perceived(settings, options, obstacles, duration, None)
}

/// The same, where the controller knows of the obstacles only what `perception` tells it.
fn perceived(
    settings: &Settings,
    options: &Options,
    obstacles: &[Obstacle],
    duration: f64,
    perception: Option<Perception>,
) -> Run<Sliding, 2, 2> {
    let chain = Chain::on_a_rail();
    let tip = start().tip;
    let reference = Reference::Setpoint { point: vec![tip.x, tip.y] };
    let reality = Reality {
        plant: Physics::of(&chain),
        measurement: None,
        perception,
        actuator: None,
        wrenches: vec![],
        contacts: vec![],
    };
    let closed_loop = ClosedLoop::new(
        &chain,
        Gains::new(settings).with_seed(3),
        World::new(obstacles.to_vec()),
        Trajectory::new(&reference, &tip).unwrap(),
        options.clone(),
        reality,
        [START.to_vec(), vec![0.0; 4]],
    );
    Run::new(closed_loop, options, duration, true).unwrap()
}

fn metric(outcome: &Outcome, name: &str) -> f64 {
    let found = outcome.metrics.iter().find(|(metric, _)| metric.name == name);
    match found.unwrap().1 {
        Value::Number(value) => value,
        ref other => panic!("{name} is {other:?}"),
    }
}

/// The farthest that the end effector was from where it began, by the kinematics of this file.
fn deviation(outcome: &Outcome) -> f64 {
    let chain = Chain::on_a_rail();
    let goal = start().tip;
    let rows = outcome.record.q.chunks_exact(4);
    rows.map(|q| (chain.frames(q, &[0.0; 4]).1 - goal).norm()).fold(0.0, f64::max)
}

fn pushing() -> Field {
    Field { kind: FieldKind::Bounded, gain: 60.0, influence: 0.35, ..Field::OFF }
}

/// A disc that comes down on the elbow.
fn on_the_elbow() -> Vec<Obstacle> {
    let elbow = start().frames[2].origin;
    vec![disc(0.1, elbow + V::new(0.1, 0.55), linear([0.0, -0.3]))]
}

/// A disc pushes the links aside and the end effector feels nothing of it, in both formulations.
#[test]
fn the_null_space_moves_and_the_end_effector_does_not() {
    const DURATION: f64 = 2.0;
    let options = Options { control: Control::Continuous, dt: 2e-3, ..Options::default() };
    let off = run(&Settings::default(), &options, &on_the_elbow(), DURATION);
    assert_eq!(off.status, Status::Collided, "{}", off.message);
    let mut records = vec![];
    for formulation in [Formulation::Recursive, Formulation::ExtendedJacobian] {
        let settings = Settings { field: pushing(), formulation, ..Settings::default() };
        let on = run(&settings, &options, &on_the_elbow(), DURATION);
        assert_eq!(on.status, Status::Completed, "{formulation:?}: {}", on.message);
        let [free, hit] = [&on, &off].map(|outcome| metric(outcome, "min_clearance"));
        assert!(free > 0.0 && hit < 0.0, "{formulation:?}: {free}, {hit}");
        assert!(deviation(&on) <= 1e-9, "{formulation:?}: {}", deviation(&on));
        assert!(metric(&on, "max_null_acceleration") <= 1e-9);
        // The joints, slider included, did move.
        let last = on.record.q.chunks_exact(4).next_back().unwrap();
        assert!((last[0] - START[0]).abs() > 0.01 && (last[2] - START[2]).abs() > 0.05, "{last:?}");
        records.push(on.record.q);
    }
    let apart = records[0].iter().zip(&records[1]).map(|(a, b)| (a - b).abs());
    assert!(apart.fold(0.0, f64::max) < 1e-8);
}

/// J M⁻¹ Nᵀ τ = 0 for every τ, and Nᵀ lets through what Jᵀf is not.
#[test]
fn the_projector_is_dynamically_consistent() {
    for chain in [Chain::on_a_rail(), Chain::telescope()] {
        let mut controller =
            Controller::<_, 2, 2>::new(chain.state(), Gains::new(&Settings::default()));
        let dq = [0.4, -0.3, 0.8, -0.6];
        controller.observe(&START, &dq, &mut World::new(vec![]));
        let state = at(&chain, &START, &dq);
        for k in 0..4 {
            let mut tau = [0.0; 4];
            tau[k] = 10.0;
            controller.project(&mut tau);
            let tau = DVector::from_column_slice(&tau);
            let felt = state.jacobian.rows(0, 2) * &state.inverse * &tau;
            assert!(tau.amax() > 0.1, "nothing is left of it");
            assert!(felt.amax() < 1e-12, "{k}: {felt}");
        }
        let mut of_task = [0.0; 4];
        state.jacobian_tr_mul(&V::new(3.0, -2.0), &mut of_task);
        controller.project(&mut of_task);
        assert!(of_task.iter().all(|tau| tau.abs() < 1e-12), "{of_task:?}");
    }
}

/// Where the end effector itself is in the way, it yields to the distance and returns.
#[test]
fn barriers_keep_the_margin() {
    const DURATION: f64 = 7.0;
    let options = Options::default();
    // Straight through the place of the tip, from ahead and above; then on, out of the way.
    let crossing = [disc(0.1, start().tip + V::new(0.5, 0.8), linear([-0.25, -0.4]))];
    let settings = Settings { field: pushing(), ..Settings::default() };
    let rigid = run(&settings, &options, &crossing, DURATION);
    assert_eq!(rigid.status, Status::Collided, "{}", rigid.message);
    assert!(metric(&rigid, "min_clearance") < -0.05);
    let settings = Settings { avoidance: Avoidance::Cbf, ..settings };
    let yielding = run(&settings, &options, &crossing, DURATION);
    let margin = settings.yielding.margin;
    assert_eq!(yielding.status, Status::Completed, "{}", yielding.message);
    let kept = metric(&yielding, "min_clearance");
    assert!(kept >= margin - 5e-5, "{kept}");
    assert!(kept < margin + 0.05, "it never came near: {kept}");
    assert!(deviation(&yielding) > 0.05);
    assert!(metric(&yielding, "max_error_tail") < 5e-3);
}

/// Two discs that close in on the arm are foreseen, and the motion that is found gets it through.
#[test]
fn look_ahead_foresees_two_discs() {
    const DURATION: f64 = 2.5;
    let middle = start().body(2).shape;
    let middle = 0.5 * (middle.start + middle.end());
    let closing = [
        disc(0.15, middle + V::new(0.0, 0.9), linear([0.0, -0.6])),
        disc(0.15, middle - V::new(0.0, 0.9), linear([0.0, 0.6])),
    ];
    let plain = Settings { avoidance: Avoidance::Cbf, ..Settings::default() };
    let preview = PreviewSettings::default();
    let ahead = Settings {
        yielding: Yielding { preview: Some(preview.clone()), ..Yielding::default() },
        ..plain.clone()
    };
    // The trigger by itself: at rest where the discs are one second from contact.
    let robot = start();
    let reference = Sample::at_rest(robot.tip);
    let fires = |obstacles: &[Obstacle]| {
        let mut preview_alone = Preview::new(&robot, &Gains::new(&ahead).with_seed(3), &preview);
        let mut world = World::new(obstacles.to_vec());
        world.update(0.4);
        for _ in 0..6 {
            let unlimited = Budget::of_simulation(None);
            let present = Present { robot: &robot, sent: None, unknown: &[] };
            preview_alone.advance(&present, &mut world, &|_| reference, &unlimited);
            preview_alone.elapse(preview.period);
        }
        preview_alone.is_active()
    };
    assert!(fires(&closing));
    let resting = closing.clone().map(|disc| Obstacle { motion: linear([0.0, 0.0]), ..disc });
    assert!(!fires(&resting));
    // And in the loop.
    let options = Options::default();
    let [blind, seeing] = [&plain, &ahead].map(|s| run(s, &options, &closing, DURATION));
    assert_ne!(blind.record.q, seeing.record.q, "it found nothing to do");
    assert_eq!(seeing.status, Status::Completed, "{}", seeing.message);
    assert!((seeing.end_time - DURATION).abs() < 1e-9);
    assert!(seeing.record.q.iter().chain(&seeing.record.tau).all(|value| value.is_finite()));
    let [without, with] = [&blind, &seeing].map(|outcome| metric(outcome, "min_clearance"));
    assert!(without < 0.0 && with > 0.0, "{without}, {with}");
}

/// The finger is one more body than there are joints: what is near it is seen, pushed and kept away, too.
#[test]
fn a_link_may_carry_two_bodies() {
    let robot = start();
    let finger = robot.body(4).shape;
    let beside = finger.end() + finger.direction * 0.2;
    let mut world = World::new(vec![disc(0.1, beside, Motion::default())]);
    let mut seen = vec![];
    let visit = |contact: &vff_core::world::Contact<2>| seen.push((contact.body, contact.link));
    world.for_each_contact(robot.bodies(), 0.1, |_, _| {}, visit);
    assert_eq!(seen, [(4, 3)]);
    let gains = Gains::new(&Settings { field: pushing(), ..Settings::default() });
    let mut controller = Controller::<_, 2, 2>::new(robot, gains);
    controller.observe(&START, &[0.0; 4], &mut world);
    assert!((controller.forces().clearance()[3] - 0.07).abs() < 1e-12);
    let expected = pushing().at(0.07).force;
    let resultant = controller.forces().resultant()[3];
    assert!(resultant.dot(&finger.direction) < -expected, "{resultant}");
}

/// Range sensors sit on every body, on the finger, too, whose disc no other body sees.
#[test]
fn every_body_has_range_sensors() {
    let robot = start();
    let (finger, upper) = (robot.body(4).shape, robot.body(3).shape);
    let settings = PerceptionSettings {
        kind: PerceptionKind::Range,
        sensors: 1,
        rays: 1,
        range: 0.15,
        ..PerceptionSettings::default()
    };
    let middle = finger.start + finger.direction * (0.5 * finger.length);
    let at = middle + upper.direction * 0.12;
    let world = World::new(vec![disc(0.05, at, Motion::default())]);
    let mut perception = Perception::new(&settings, 7, &robot, 1e-3);
    perception.start(&robot, &world);
    assert_eq!(perception.seen().len(), 2 * robot.body_count());
    let met = |point: &V| !point.x.is_nan();
    let bodies: Vec<usize> =
        (0..10).filter(|k| met(&perception.seen()[*k])).map(|k| k / 2).collect();
    assert_eq!(bodies, [4]);
    let mut found = vec![];
    perception.for_each_contact(robot.bodies(), 0.045, |_, _| {}, |c| found.push(*c));
    assert!(found.iter().any(|c| (c.body, c.link) == (4, 3)), "{found:?}");
    let touched = found.iter().find(|c| c.body == 4).unwrap();
    assert!((touched.distance - 0.04).abs() < 1e-12, "{}", touched.distance);
}

/// With range sensors alone the arm takes its finger out of the way of a disc.
#[test]
fn the_loop_runs_on_range_sensors() {
    const DURATION: f64 = 1.5;
    let robot = start();
    let (finger, upper) = (robot.body(4).shape, robot.body(3).shape);
    let away = finger.end() + upper.direction * 0.35;
    let slow = linear((upper.direction * -0.2).into());
    let coming = [disc(0.05, away, slow)];
    let settings = PerceptionSettings {
        kind: PerceptionKind::Range,
        range: 0.5,
        ..PerceptionSettings::default()
    };
    let options = Options { dt: 2e-3, ..Options::default() };
    let run = |field: Field| {
        let perception = Perception::new(&settings, 7, &robot, options.dt);
        let settings = Settings { field, ..Settings::default() };
        let mut run = perceived(&settings, &options, &coming, DURATION, Some(perception));
        while run.step() {}
        run.outcome()
    };
    let still = run(Field::OFF);
    assert_eq!(still.status, Status::Collided, "{}", still.message);
    let moved = run(pushing());
    assert_eq!(moved.status, Status::Completed, "{}", moved.message);
    assert!(metric(&moved, "min_clearance") > 0.01);
}
