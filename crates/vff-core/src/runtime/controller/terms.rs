//! What a torque consists of, as people look at it.

use crate::control::ObjectiveScale;
use crate::control::energy::{ENERGIES, PORTS};
use nalgebra::DMatrix;

/// The parts of the last torque, as they are shown to people.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TermsView<'a> {
    /// Joint torque, (n).
    pub tau: &'a [f64],
    /// What serves the task, and what makes it give way, (n).
    pub tau_task: &'a [f64],
    /// What acts in the null space, (n).
    pub tau_null: &'a [f64],
    /// Repulsion before its projection, (n).
    pub tau_vff: &'a [f64],
    /// Magnitude of the repulsion on each link \[N\], (n).
    pub force: &'a [f64],
    /// Signed distance of each link from the nearest obstacle \[m\], (n).
    pub clearance: &'a [f64],
    /// What is a number.
    pub scalars: Scalars,
}

/// Those parts that are numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scalars {
    /// By how much barriers are violated at most \[m/s²\]; None without barriers.
    pub slack: Option<f64>,
    /// [`ENERGIES`] \[J\].
    pub energy: [f64; ENERGIES.len()],
    /// [`PORTS`] \[W\].
    pub power: [f64; PORTS.len()],
    /// What the limits let through of each objective.
    pub objective_scale: ObjectiveScale,
    /// Energy in the tank \[J\]; None without one.
    pub tank: Option<f64>,
    /// Signed distance of the nearest two bodies that must not touch \[m\].
    pub self_clearance: f64,
    /// √det(J Jᵀ).
    pub manipulability: f64,
    /// Whether the task force is damped because of a singularity.
    pub singular: bool,
    /// ‖J M⁻¹ τ_null‖ \[m/s²\].
    pub null_acceleration: f64,
}

/// The same to be kept, with the projector.
///
/// # Example
/// ```
/// use vff_core::runtime::controller::{Scalars, Terms, TermsView};
/// use vff_core::runtime::{AnyArm, AnyController, Target};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let arm = AnyArm::read(&toml::toml! { lengths = [0.5, 0.5, 0.5] masses = 2.0 })?;
/// let mut controller = AnyController::new(&arm, &toml::Table::new())?;
/// let target = Target { x: &[1.2, 0.5], dx: &[0.0; 2], ddx: &[0.0; 2] };
/// controller.torque(&[0.4, 0.5, -0.6], &[0.0; 3], &target, 0.0)?;
/// let TermsView { tau, scalars, .. } = controller.terms_view(); // borrowed, for a loop
/// let Scalars { singular, .. } = scalars;
/// assert_eq!((tau.len(), singular), (3, false));
/// let Terms { projector, .. } = controller.terms();
/// assert_eq!(projector.nrows(), 3);
/// # Ok(())
/// # }
/// ```
///
/// # See also
/// [`TermsView`] and its [`Scalars`].
#[derive(Debug, Clone, PartialEq)]
pub struct Terms {
    /// As in [`TermsView`].
    pub tau: Vec<f64>,
    /// As in [`TermsView`].
    pub tau_task: Vec<f64>,
    /// As in [`TermsView`].
    pub tau_null: Vec<f64>,
    /// As in [`TermsView`].
    pub tau_vff: Vec<f64>,
    /// As in [`TermsView`].
    pub force: Vec<f64>,
    /// As in [`TermsView`].
    pub clearance: Vec<f64>,
    /// As in [`TermsView`].
    pub scalars: Scalars,
    /// The null-space projector, (n, n).
    pub projector: DMatrix<f64>,
}

impl TermsView<'_> {
    /// A copy to be kept.
    pub(super) fn to_terms(self, projector: DMatrix<f64>) -> Terms {
        Terms {
            tau: self.tau.to_vec(),
            tau_task: self.tau_task.to_vec(),
            tau_null: self.tau_null.to_vec(),
            tau_vff: self.tau_vff.to_vec(),
            force: self.force.to_vec(),
            clearance: self.clearance.to_vec(),
            scalars: self.scalars,
            projector,
        }
    }
}
