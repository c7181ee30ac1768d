//! What a search of the self-motion has found, to be looked at.

/// The distances along the self-motion, now and later, and the path through them (T173, T174).
///
/// Places are numbered along the self-motion, the posture at which the search began in the middle; instants from the time at
/// which it began.
///
/// # Example
/// ```
/// use vff_core::control::SelfMotionMap;
/// use vff_core::scenario::Scenario;
///
/// # fn main() -> Result<(), vff_core::scenario::ScenarioError> {
/// let scenario = Scenario::from_toml(
///     r#"
///     duration = 1.0
///     q0 = [0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8]
///     arm = { model = "panda" }
///     controller = { task = "pose", avoidance = "cbf", yielding = { preview = { self_motion = {} } } }
///     reference = { kind = "setpoint" }
///     [[obstacles]]
///     shape = { kind = "sphere", radius = 0.08 }
///     position = [-0.05, -0.6, 0.62]
///     motion = { kind = "linear", velocity = [0.0, 0.4, 0.0] }
///     "#,
/// )?;
/// let mut run = scenario.prepare()?.run;
/// (0..200).for_each(|_| assert!(run.step()));
/// let map: SelfMotionMap = run.self_motion_map().expect("a ball comes");
/// assert_eq!(map.distances.len(), map.places * map.instants);
/// assert_eq!(map.path[0], map.places / 2);
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct SelfMotionMap {
    /// How many places there are.
    pub places: usize,
    /// From one place to the next \[rad\].
    pub spacing: f64,
    /// How many instants there are.
    pub instants: usize,
    /// From one instant to the next \[s\].
    pub step: f64,
    /// How long ago the search began \[s\].
    pub elapsed: f64,
    /// Of every place, one after the other, the smallest distance at every instant \[m\], as one of a pair that has no margin of its own
    /// ([`PairMargin::as_usual`](crate::world::PairMargin::as_usual)): as far as it matters, ∞ beyond. NaN where
    /// there is no posture, and where nobody can be that early.
    pub distances: Vec<f64>,
    /// The place at every instant along the path that is followed; none where there is no path.
    pub path: Vec<usize>,
    /// The margin that a path keeps as long as it has to \[m\].
    pub margin: f64,
    /// From where on more distance is no better \[m\].
    pub clearance: f64,
}
