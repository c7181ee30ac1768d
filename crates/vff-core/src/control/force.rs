//! Force control along one direction of the task, motion in the others (T158, T159): the tip presses on a surface that
//! nobody has measured, and moves along it.
//!
//! ```text
//! ẍ_c ← (I − u uᵀ) ẍ_c − u (d uᵀẋ + k max(uᵀe − h, 0)) + Λ⁻¹ u f
//! f = min(f_d + k_p (f_d − λ̂) + I, max(λ̂, 0) + Λ_u d v),   at least 0,      İ = k_i (f_d − λ̂)
//! ```
//!
//! u is the way in which it presses, λ̂ = −uᵀf̂ what the surface answers, 1/Λ_u = uᵀΛ⁻¹u. The second bound of f lets
//! what is not in contact approach at v at most; no mode is switched where contact begins or ends.

use super::OperationalSpace;
use crate::math::Vector;
use crate::robot::Robot;
use crate::settings::settings;
use crate::world::Contact;
use nalgebra::SVector;
use serde::{Deserialize, Serialize};

/// Less than this share of the force that is wanted is no contact: the integral fades.
const CONTACT: f64 = 0.25;

/// The cosine of 37°.
const FACING: f64 = 0.8;

settings! {
    /// `[controller.touch.force]`.
    pub struct ForceSettings {
        /// The way in which it presses, into the surface: a vector of any length; must be given.
        direction: Option<Vec<f64>> = None, "";
        /// Whose axes `direction` has: those of the `world`, or of the `tool`.
        frame: ForceFrame = ForceFrame::World, "";
        /// The force with which it presses.
        target: f64 = 10.0, "N", POSITIVE;
        /// k_p, how much of what is missing is added at once; at most 0.8 `damping` / `observer.bandwidth`.
        gain: f64 = 0.5, "", NOT_NEGATIVE;
        /// k_i, how fast the rest is; at most 0.5 (1 + `gain`) / (1 / `damping` + 1 / `observer.bandwidth`).
        integral: f64 = 10.0, "1/s", NOT_NEGATIVE;
        /// Damping along the direction relative to inertia; at most 0.5 per control period.
        damping: f64 = 100.0, "1/s", POSITIVE;
        /// The largest speed at which it approaches a surface.
        approach: f64 = 0.02, "m/s", POSITIVE;
        /// How far beyond the reference it goes to find one.
        reach: f64 = 0.05, "m", POSITIVE;
    }
}

/// Whose axes a direction has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ForceFrame {
    /// Those of the world.
    #[default]
    World,
    /// Those of the tool.
    Tool,
}

impl ForceSettings {
    /// The largest [`gain`](Self::gain) that is stable on every surface behind an observer of this `bandwidth` \[1/s\] (T159).
    pub fn largest_gain(&self, bandwidth: f64) -> f64 {
        0.8 * self.damping / bandwidth
    }

    /// The largest [`integral`](Self::integral) \[1/s\] that is (T159).
    pub fn largest_integral(&self, bandwidth: f64) -> f64 {
        0.5 * (1.0 + self.gain) / (self.damping.recip() + bandwidth.recip())
    }

    /// The key below `controller` and the rate \[1/s\] of what a control period of `period` \[s\] is too long for (T159), behind an
    /// observer of this `bandwidth` \[1/s\]; None if it is not.
    pub fn too_fast(&self, bandwidth: f64, period: f64) -> Option<(&'static str, f64)> {
        let rates = [("touch.force.damping", self.damping), ("observer.bandwidth", bandwidth)];
        rates.into_iter().find(|(_, rate)| rate * period > 0.5)
    }
}

/// The controller of the force with its memory. Nothing allocates after construction.
///
/// # Example
/// ```
/// use vff_core::control::force::{ForceControl, ForceFrame, ForceSettings};
///
/// let settings = ForceSettings { frame: ForceFrame::Tool, ..ForceSettings::default() };
/// assert!(settings.largest_gain(50.0) > 0.0); // for an estimate of 50 1/s
/// let mut control = ForceControl::<3>::new(&settings);
/// control.elapse(0.001);
/// control.forget();
/// ```
#[derive(Debug, Clone)]
pub struct ForceControl<const D: usize> {
    settings: ForceSettings,
    /// `direction`, of length 1, in the axes that it is given in.
    direction: Vector<D>,
    /// I \[N\], and how it changes after the last command \[N/s\].
    integral: f64,
    rate: f64,
}

impl<const D: usize> ForceControl<D> {
    /// As the settings have it; its direction has been validated.
    pub fn new(settings: &ForceSettings) -> Self {
        let given = settings.direction.as_deref().unwrap_or_default();
        let direction = Vector::<D>::from_fn(|i, _| given.get(i).copied().unwrap_or(0.0));
        Self {
            settings: settings.clone(),
            direction: direction.normalize(),
            integral: 0.0,
            rate: 0.0,
        }
    }

    /// u, the way in which the tip of `robot` presses, in the world.
    pub fn direction<R: Robot<D>>(&self, robot: &R) -> Vector<D> {
        match self.settings.frame {
            ForceFrame::World => self.direction,
            ForceFrame::Tool => robot.link_frame(robot.dof()).1 * self.direction,
        }
    }

    /// u as a direction of the task.
    pub fn task_direction<R: Robot<D>, const M: usize>(&self, robot: &R) -> SVector<f64, M> {
        let direction = self.direction(robot);
        SVector::from_fn(|i, _| if i < D { direction[i] } else { 0.0 })
    }

    /// The task acceleration for the motion `ddx` \[m/s², rad/s²\] with the force along u in the place of what moves along it
    /// (T158), at the error `e` of a task of this `stiffness` \[1/s²\], where `wrench` \[N, N·m\], (m), acts on the tip.
    pub fn select<R: Robot<D>, const M: usize>(
        &mut self,
        robot: &R,
        space: &OperationalSpace<M>,
        stiffness: &SVector<f64, M>,
        e: &SVector<f64, M>,
        wrench: &[f64],
        ddx: &SVector<f64, M>,
    ) -> SVector<f64, M> {
        let ForceSettings { target, gain, integral, damping, approach, reach, .. } = self.settings;
        let u = self.task_direction::<R, M>(robot);
        let mobility = mobility(robot, space, &u); // Λ⁻¹u
        let inertia = u.dot(&mobility).recip(); // Λ_u

        let pressed = -u.dot(&SVector::<f64, M>::from_fn(|i, _| wrench[i])); // λ̂
        let missing = target - pressed;
        let wanted = target + gain * missing + self.integral;
        let most = pressed.max(0.0) + inertia * damping * approach;
        let force = wanted.min(most).max(0.0);
        self.rate = if pressed < CONTACT * target {
            -integral * self.integral
        } else if (wanted > most && missing > 0.0) || (wanted < 0.0 && missing < 0.0) {
            0.0
        } else {
            integral * missing
        };

        let beyond = (u.dot(e) - reach).max(0.0);
        let pull = u.component_mul(&u).dot(stiffness) * beyond;
        let along = -damping * u.dot(&space.dx) - pull;
        ddx + u * (along - u.dot(ddx)) + mobility * force
    }

    /// The part of an error `e` that nothing works against: along u, up to `reach` beyond the reference.
    pub fn free_part<R: Robot<D>, const M: usize>(
        &self,
        robot: &R,
        e: &SVector<f64, M>,
    ) -> SVector<f64, M> {
        let u = self.task_direction::<R, M>(robot);
        u * u.dot(e).min(self.settings.reach)
    }

    /// Lets `dt` \[s\] pass under the last command: the integral goes on, within what is wanted of the force.
    pub fn elapse(&mut self, dt: f64) {
        let Self { settings: ForceSettings { target, .. }, integral, rate, .. } = self;
        *integral = (*integral + *rate * dt).clamp(-*target, *target);
    }

    /// Forgets the integral.
    pub fn forget(&mut self) {
        (self.integral, self.rate) = (0.0, 0.0);
    }

    /// Takes over the integral of another controller.
    pub fn believe(&mut self, other: &Self) {
        (self.integral, self.rate) = (other.integral, other.rate);
    }
}

/// Whether `contact` is what the tip of `robot` presses on in the direction `pressed`: of the last link, with a surface whose
/// normal is nearer than 37° to the opposite.
pub fn is_pressed<R: Robot<D>, const D: usize>(
    robot: &R,
    pressed: Option<&Vector<D>>,
    contact: &Contact<D>,
) -> bool {
    pressed.is_some_and(|u| contact.link + 1 == robot.dof() && contact.normal.dot(u) < -FACING)
}

/// Λ⁻¹u = J M⁻¹Jᵀu, how the end effector accelerates per force along u.
fn mobility<R: Robot<D>, const D: usize, const M: usize>(
    robot: &R,
    space: &OperationalSpace<M>,
    u: &SVector<f64, M>,
) -> SVector<f64, M> {
    let columns = space.y.iter().enumerate();
    columns.map(|(i, y)| robot.jacobian_column::<M>(i) * y.dot(u)).sum()
}
