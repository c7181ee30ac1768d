//! The settings of a controller, resolved for one robot.

use super::metric::TaskMetric;
use super::motion_limits::MotionLimits;
use super::settings::{Avoidance, Settings};
use crate::math::{ScalarOrVec, short_way};
use crate::robot::{Model, Robot};
use nalgebra::SVector;
use std::ops::{Deref, DerefMut};

/// Damping of the null space, proportional to M: its sampled bound d·dt < 2 is the same in every
/// configuration (T31).
#[derive(Debug, Clone, PartialEq)]
pub enum NullDamping {
    /// D_q = d M with d \[1/s\].
    Uniform(f64),
    /// D_q = √d M √d, the diagonal √d \[1/√s\] one per joint.
    Each(Vec<f64>),
}

impl NullDamping {
    fn new(d: &ScalarOrVec) -> Self {
        match d {
            ScalarOrVec::Uniform(d) => Self::Uniform(*d),
            ScalarOrVec::Each(each) => Self::Each(each.iter().map(|d| d.sqrt()).collect()),
        }
    }

    /// d of joint `i` \[1/s\].
    pub fn get(&self, i: usize) -> f64 {
        match self {
            Self::Uniform(d) => *d,
            Self::Each(roots) => roots[i] * roots[i],
        }
    }

    /// Turns the momentum `M v` in `out` into `D_q v`, with `brake` added to every d.
    pub fn scale_momentum<R: Robot<D>, const D: usize>(
        &self,
        robot: &R,
        brake: f64,
        v: &[f64],
        out: &mut [f64],
        scratch: &mut [f64],
    ) {
        match self {
            Self::Uniform(d) => out.iter_mut().for_each(|p| *p *= d + brake),
            Self::Each(roots) => {
                let root = |root: &f64| (root * root + brake).sqrt();
                let scaled = v.iter().zip(roots);
                scratch.iter_mut().zip(scaled).for_each(|(s, (v, r))| *s = v * root(r));
                robot.mass_mul(scratch, out);
                out.iter_mut().zip(roots).for_each(|(p, r)| *p *= root(r));
            }
        }
    }
}

/// [`Settings`] resolved for a robot of n joints and a task of dimension `M`: what one number for all stands for, and what
/// depends on the arm. Everything else is that of the settings themselves.
///
/// ```
/// use vff_core::control::{Gains, NullDamping, Settings};
/// use vff_core::math::ScalarOrVec;
///
/// let settings = Settings { stiffness: ScalarOrVec::Each(vec![100.0, 25.0]), ..Settings::default() };
/// let gains = Gains::<2>::new(&settings);
/// assert_eq!(gains.stiffness.y, 25.0);
/// assert_eq!(gains.damping.y, 8.0); // one number for all
/// assert!(gains.enforce_limits); // as the settings have it
/// assert!(matches!(gains.null_damping, NullDamping::Uniform(_)));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Gains<const M: usize> {
    /// K \[1/s²\].
    pub stiffness: SVector<f64, M>,
    /// D \[1/s\].
    pub damping: SVector<f64, M>,
    /// D_q.
    pub null_damping: NullDamping,
    /// Posture spring: (q_d \[rad\], K_v \[N·m/rad\]) per joint, empty without posture.
    pub posture: Vec<(f64, f64)>,
    /// Which joints turn without an end; none where nothing is known of the arm.
    endless: Vec<bool>,
    /// See [`Settings::characteristic_length`].
    pub characteristic_length: f64,
    /// What moves the joints, where that is no torque.
    pub moved: Option<MotionLimits>,
    /// Where the random numbers of look-ahead come from.
    pub seed: u64,
    settings: Settings,
}

impl<const M: usize> Deref for Gains<M> {
    type Target = Settings;

    fn deref(&self) -> &Settings {
        &self.settings
    }
}

impl<const M: usize> DerefMut for Gains<M> {
    fn deref_mut(&mut self) -> &mut Settings {
        &mut self.settings
    }
}

/// Where the springs of a posture rest \[rad or m\], and how stiff they are.
fn posture_of(settings: &Settings) -> impl Iterator<Item = (f64, f64)> + '_ {
    let rest = settings.posture.iter().flatten().enumerate();
    rest.map(|(i, q)| (*q, settings.posture_stiffness.get(i)))
}

impl Settings {
    /// Whether the law looks ahead: only a program with barriers does.
    pub fn looks_ahead(&self) -> bool {
        self.avoidance == Avoidance::Cbf && self.yielding.preview.is_some()
    }

    /// The fastest rate at which the law reacts \[1/s\], the largest of D, D_q and √K.
    pub fn fastest_rate(&self) -> f64 {
        let Self { stiffness, damping, null_damping, .. } = self;
        let rates = damping.values().iter().chain(null_damping.values()).copied();
        stiffness.values().iter().map(|k| k.sqrt()).chain(rates).fold(0.0, f64::max)
    }

    /// The characteristic length \[m\]: that of `arm`, where nothing else is said.
    pub(crate) fn length_of<A: Model<D>, const D: usize>(&self, arm: &A) -> f64 {
        self.characteristic_length.unwrap_or_else(|| arm.characteristic_length())
    }
}

impl<const M: usize> Gains<M> {
    /// Resolves settings whose lengths `scenario` has validated.
    pub fn new(settings: &Settings) -> Self {
        Self {
            stiffness: SVector::from_fn(|i, _| settings.stiffness.get(i)),
            damping: SVector::from_fn(|i, _| settings.damping.get(i)),
            null_damping: NullDamping::new(&settings.null_damping),
            posture: posture_of(settings).collect(),
            endless: vec![],
            characteristic_length: settings.characteristic_length.unwrap_or(1.0),
            moved: None,
            seed: 0,
            settings: settings.clone(),
        }
    }

    /// The same with the characteristic length of `arm`, where the settings leave it open, and with what turns without an end.
    #[must_use]
    pub fn of_arm<A: Model<D>, const D: usize>(self, settings: &Settings, arm: &A) -> Self {
        let characteristic_length = settings.length_of(arm);
        Self { characteristic_length, endless: arm.endless(), ..self }
    }

    /// The largest speeds of the joints \[rad/s, m/s\]: of what moves them, or else of the arm; none if that has none.
    pub fn speed_limits<'a, R: Robot<D>, const D: usize>(&'a self, robot: &'a R) -> &'a [f64] {
        let of_arm = &robot.limits().velocity;
        self.moved.as_ref().map_or(of_arm, |moved| &moved.speed)
    }

    /// The same, of an arm that has none those that it is thought to have when it gives way.
    pub fn joint_speeds<R: Robot<D>, const D: usize>(&self, robot: &R) -> Vec<f64> {
        let limits = self.speed_limits(robot);
        if limits.is_empty() { vec![self.yielding.speed; robot.dof()] } else { limits.to_vec() }
    }

    /// The same for joints that are moved within these limits, if any, whatever the torque.
    #[must_use]
    pub fn moved_within(self, moved: Option<MotionLimits>) -> Self {
        Self { moved, ..self }
    }

    /// The same with random numbers from `seed`.
    #[must_use]
    pub fn with_seed(self, seed: u64) -> Self {
        Self { seed, ..self }
    }

    /// How lengths and angles of the task are put together in a space of dimension `D`.
    pub fn metric<const D: usize>(&self) -> TaskMetric<M> {
        TaskMetric::new::<D>(self.characteristic_length)
    }

    /// Moves the posture to `q` \[rad\]. Allocates where there was none.
    pub fn move_posture(&mut self, q: &[f64]) {
        let Self { posture, settings: Settings { posture_stiffness, .. }, .. } = self;
        if posture.is_empty() {
            posture.extend(q.iter().enumerate().map(|(i, q)| (*q, posture_stiffness.get(i))));
        }
        posture.iter_mut().zip(q).for_each(|((rest, _), q)| *rest = *q);
    }

    /// Makes room for a posture of `n` joints.
    pub(in crate::control) fn reserve_posture(&mut self, n: usize) {
        self.posture.reserve(n.saturating_sub(self.posture.len()));
    }

    /// Lets the posture be that of the settings.
    pub fn forget_posture(&mut self) {
        self.posture.clear();
        self.posture.extend(posture_of(&self.settings));
    }

    /// Whether a joint turns without an end.
    pub fn is_endless(&self, joint: usize) -> bool {
        self.endless.get(joint) == Some(&true)
    }

    /// From one angle or place of a joint to another \[rad or m\]: the short way round where that turns without an end.
    pub fn way(&self, joint: usize, from: f64, to: f64) -> f64 {
        short_way(to - from, self.is_endless(joint))
    }

    /// `out += K_v (q_d − q)` (T10), nothing without a posture.
    pub fn add_posture_torque(&self, q: &[f64], out: &mut [f64]) {
        for (i, ((out, q), (rest, stiffness))) in
            out.iter_mut().zip(q).zip(&self.posture).enumerate()
        {
            *out += stiffness * self.way(i, *q, *rest);
        }
    }

    /// ½ (q_d − q)ᵀ K_v (q_d − q) \[J\].
    pub fn posture_energy(&self, q: &[f64]) -> f64 {
        let springs = q.iter().zip(&self.posture).enumerate();
        springs.map(|(i, (q, (rest, k)))| 0.5 * k * self.way(i, *q, *rest).powi(2)).sum()
    }
}
