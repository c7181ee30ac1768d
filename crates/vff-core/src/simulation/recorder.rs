//! The record of a run: row-major arrays, allocated once, handed on without a copy.

use super::Snapshot;
use crate::control::{energy, limits};
use crate::world::Positions;
use std::mem;

/// How large the arrays of a record are.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Sizes {
    /// Dimension D of the space.
    pub dimension: usize,
    /// Number of joints n.
    pub joints: usize,
    /// Task dimension m.
    pub task: usize,
    /// Numbers p of a pose: of its position, and in the plane its angle.
    pub pose: usize,
    /// Numbers r of a pose in space that are its orientation: 4, a quaternion, or 0.
    pub orientation: usize,
    /// Number of obstacles k.
    pub obstacles: usize,
    /// Number of rays r of the range sensors.
    pub rays: usize,
}

impl Sizes {
    /// Those of a run like `s`.
    pub fn of(s: &Snapshot<'_>) -> Self {
        Self {
            dimension: s.dimension,
            joints: s.q.len(),
            task: s.error.len(),
            pose: s.x.len() - orientation_width(s.dimension, s.x.len()),
            orientation: orientation_width(s.dimension, s.x.len()),
            obstacles: s.obstacles.count(),
            rays: s.sensed.map_or(0, Positions::count),
        }
    }

    /// The most that one row takes \[bytes\].
    pub fn row_bytes(self) -> usize {
        let mut empty = Record { sizes: self, ..Record::default() };
        8 * empty.columns(None).iter().map(|column| column.width()).sum::<usize>()
    }
}

/// How many of the `width` numbers that a pose takes are a quaternion.
pub const fn orientation_width(dimension: usize, width: usize) -> usize {
    if dimension == 3 && width > 3 { 4 } else { 0 }
}

/// Every recorded quantity, one row per recorded instant (units as in [`Snapshot`]). One that the run
/// does not have stays empty.
///
/// # Example
/// ```
/// use vff_core::scenario::Scenario;
/// use vff_core::simulation::{Array, Outcome, Record, Sizes, Status};
///
/// let scenario = Scenario::from_toml(
///     r#"
///     duration = 0.05
///     q0 = [0.4, 0.5, -0.6]
///     arm = { lengths = [0.5, 0.5, 0.5], masses = 2.0 }
///     reference = { kind = "setpoint", point = [1.2, 0.5] }
///     "#,
/// )
/// .unwrap();
/// let mut run = scenario.prepare().unwrap().run;
/// while run.step() {}
/// let Outcome { status, record, .. } = run.outcome();
/// assert_eq!(status, Status::Completed);
/// let Sizes { joints, .. } = record.sizes;
/// assert_eq!(record.q.len(), joints * record.rows);
/// let rows = record.rows;
/// let arrays = Record::into_arrays(record);
/// let Array { shape, .. } = arrays.into_iter().find_map(|(name, array)| array.filter(|_| name == "q")).unwrap();
/// assert_eq!(shape, [rows, 3]);
/// ```
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Record {
    /// Number of rows T.
    pub rows: usize,
    /// How long a row of each array is.
    pub sizes: Sizes,
    /// (T).
    pub t: Vec<f64>,
    /// (T, n).
    pub q: Vec<f64>,
    /// (T, n).
    pub dq: Vec<f64>,
    /// (T, n).
    pub tau: Vec<f64>,
    /// (T, n).
    pub tau_task: Vec<f64>,
    /// (T, n).
    pub tau_null: Vec<f64>,
    /// (T, n).
    pub tau_vff: Vec<f64>,
    /// (T, p).
    pub x: Vec<f64>,
    /// (T, 4) of poses in space, or empty.
    pub orientation: Vec<f64>,
    /// (T, m).
    pub dx: Vec<f64>,
    /// (T, p).
    pub x_ref: Vec<f64>,
    /// (T, 4) of poses in space, or empty.
    pub orientation_ref: Vec<f64>,
    /// (T, m).
    pub error: Vec<f64>,
    /// (T, n).
    pub force: Vec<f64>,
    /// (T, n).
    pub clearance: Vec<f64>,
    /// (T, k, D).
    pub obstacles: Vec<f64>,
    /// (T, n), or empty without `[measurement]`.
    pub q_measured: Vec<f64>,
    /// (T, n), or empty without `[measurement]`.
    pub dq_measured: Vec<f64>,
    /// (T, n), or empty where it is the commanded one.
    pub tau_applied: Vec<f64>,
    /// (T, r, D), or empty without range sensors.
    pub sensed: Vec<f64>,
    /// (T, [`energy::ENERGIES`]).
    pub energy: Vec<f64>,
    /// (T, [`energy::PORTS`]).
    pub power: Vec<f64>,
    /// (T).
    pub manipulability: Vec<f64>,
    /// (T, [`limits::OBJECTIVES`]), or empty.
    pub objective_scale: Vec<f64>,
    /// (T), or empty.
    pub self_clearance: Vec<f64>,
    /// (T), or empty.
    pub tank: Vec<f64>,
    /// (T, n), or empty.
    pub tau_ext: Vec<f64>,
    /// (T, k, D), or empty.
    pub contact_force: Vec<f64>,
    /// (T, n), or empty.
    pub tau_ext_estimate: Vec<f64>,
    /// (T, m), or empty.
    pub wrench_estimate: Vec<f64>,
    /// (T), or empty.
    pub touched_link: Vec<f64>,
    /// (T, n), or empty.
    pub contact_deviation: Vec<f64>,
    /// (T, n), or empty.
    pub contact_threshold: Vec<f64>,
    /// (T), or empty.
    pub yielded: Vec<f64>,
    /// (T), or empty.
    pub released: Vec<f64>,
    /// (T), or empty.
    pub slack: Vec<f64>,
    /// (T), or empty.
    pub path_time: Vec<f64>,
    /// (T, n), or empty.
    pub q_plan: Vec<f64>,
}

pub use crate::math::memory::MAX_BYTES;

/// The record of a run would be too large.
///
/// # Example
/// ```
/// use vff_core::simulation::RecordTooLarge;
///
/// let error = RecordTooLarge { rows: 1_000_000_000, gigabytes: 720.0 };
/// assert!(error.to_string().contains("720"));
/// ```
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{rows} recorded rows take {gigabytes:.1} GB, more than there is or than the 8 GB allowed")]
pub struct RecordTooLarge {
    /// Rows asked for.
    pub rows: usize,
    /// Memory they need \[GB\].
    pub gigabytes: f64,
}

/// One array of a record.
struct Column<'a> {
    name: &'static str,
    values: &'a mut Vec<f64>,
    /// Its shape without the rows: (), (a) or (a, b).
    shape: Vec<usize>,
    /// Whether runs may lack it.
    optional: bool,
}

impl Column<'_> {
    /// Numbers per row.
    fn width(&self) -> usize {
        self.shape.iter().product()
    }
}

/// An array of a record, row-major, with its shape.
#[derive(Debug, Clone, PartialEq)]
pub struct Array {
    /// The numbers.
    pub values: Vec<f64>,
    /// The number of rows T, then that of the entries along each further axis.
    pub shape: Vec<usize>,
}

impl Record {
    /// Room for `rows` rows like `s`.
    ///
    /// # Errors
    /// If they take too much memory.
    pub fn with_capacity(rows: usize, s: &Snapshot<'_>) -> Result<Self, RecordTooLarge> {
        let mut record = Self { sizes: Sizes::of(s), ..Self::default() };
        let row_bytes = 8 * record.columns(Some(s)).iter().map(Column::width).sum::<usize>();
        let fits = rows.checked_mul(row_bytes).is_some_and(|bytes| bytes <= MAX_BYTES);
        let reserve = |column: &mut Column<'_>| {
            let width = column.width();
            column.values.try_reserve_exact(rows * width)
        };
        if fits && record.columns(Some(s)).iter_mut().try_for_each(reserve).is_ok() {
            return Ok(record);
        }
        #[expect(clippy::cast_precision_loss, reason = "a message")]
        let gigabytes = 1e-9 * rows as f64 * row_bytes as f64;
        Err(RecordTooLarge { rows, gigabytes })
    }

    /// All arrays by their names; `None` for what the run does not have.
    pub fn into_arrays(mut self) -> Vec<(&'static str, Option<Array>)> {
        let rows = self.rows;
        let array = |column: Column<'_>| {
            let values = mem::take(column.values);
            let absent = column.optional && values.is_empty();
            let shape = std::iter::once(rows).chain(column.shape).collect();
            (column.name, (!absent).then_some(Array { values, shape }))
        };
        self.columns(None).into_iter().map(array).collect()
    }

    /// The one list of arrays: as long as those of a run like `s`, or of one that has everything.
    fn columns(&mut self, s: Option<&Snapshot<'_>>) -> Vec<Column<'_>> {
        let Sizes { dimension: d, joints: n, task: m, pose, orientation, obstacles, rays } =
            self.sizes;
        let column = |name, values, shape: &[usize]| Column {
            name,
            values,
            shape: shape.to_vec(),
            optional: false,
        };
        let optional = |name, values, shape: &[usize], given: fn(&Snapshot<'_>) -> bool| {
            let shape = if s.is_none_or(given) { shape.to_vec() } else { vec![0] };
            Column { name, values, shape, optional: true }
        };
        let objectives = limits::OBJECTIVES.len();
        vec![
            column("t", &mut self.t, &[]),
            column("q", &mut self.q, &[n]),
            column("dq", &mut self.dq, &[n]),
            column("tau", &mut self.tau, &[n]),
            column("tau_task", &mut self.tau_task, &[n]),
            column("tau_null", &mut self.tau_null, &[n]),
            column("tau_vff", &mut self.tau_vff, &[n]),
            column("x", &mut self.x, &[pose]),
            column("dx", &mut self.dx, &[m]),
            column("x_ref", &mut self.x_ref, &[pose]),
            column("error", &mut self.error, &[m]),
            column("force", &mut self.force, &[n]),
            column("clearance", &mut self.clearance, &[n]),
            column("obstacles", &mut self.obstacles, &[obstacles, d]),
            column("energy", &mut self.energy, &[energy::ENERGIES.len()]),
            column("power", &mut self.power, &[energy::PORTS.len()]),
            column("manipulability", &mut self.manipulability, &[]),
            optional("orientation", &mut self.orientation, &[orientation], |_| true),
            optional("orientation_ref", &mut self.orientation_ref, &[orientation], |_| true),
            optional("q_measured", &mut self.q_measured, &[n], |s| !s.q_measured.is_empty()),
            optional("dq_measured", &mut self.dq_measured, &[n], |s| !s.dq_measured.is_empty()),
            optional("tau_applied", &mut self.tau_applied, &[n], |s| !s.tau_applied.is_empty()),
            optional("objective_scale", &mut self.objective_scale, &[objectives], |s| {
                s.objective_scale.is_some()
            }),
            optional("sensed", &mut self.sensed, &[rays, d], |s| s.sensed.is_some()),
            optional("self_clearance", &mut self.self_clearance, &[], |s| {
                s.self_clearance.is_some()
            }),
            optional("tank", &mut self.tank, &[], |s| s.tank.is_some()),
            optional("tau_ext", &mut self.tau_ext, &[n], |s| s.tau_ext.is_some()),
            optional("contact_force", &mut self.contact_force, &[obstacles, d], |s| {
                s.contact_force.is_some()
            }),
            optional("tau_ext_estimate", &mut self.tau_ext_estimate, &[n], |s| {
                s.tau_ext_estimate.is_some()
            }),
            optional("wrench_estimate", &mut self.wrench_estimate, &[m], |s| {
                s.wrench_estimate.is_some()
            }),
            optional("touched_link", &mut self.touched_link, &[], |s| s.touched_link.is_some()),
            optional("contact_deviation", &mut self.contact_deviation, &[n], |s| {
                s.contact_deviation.is_some()
            }),
            optional("contact_threshold", &mut self.contact_threshold, &[n], |s| {
                s.contact_threshold.is_some()
            }),
            optional("yielded", &mut self.yielded, &[], |s| s.yielded.is_some()),
            optional("released", &mut self.released, &[], |s| s.released.is_some()),
            optional("slack", &mut self.slack, &[], |s| s.slack.is_some()),
            optional("path_time", &mut self.path_time, &[], |s| s.path_time.is_some()),
            optional("q_plan", &mut self.q_plan, &[n], |s| s.has_plans()),
        ]
    }

    /// Takes rows away from the end until the last is finite. Infinite clearances and readings of nothing are.
    pub fn end_with_finite_row(&mut self) {
        while self.rows > 0 && !self.ends_finite() {
            let rows = self.rows;
            for column in self.columns(None) {
                column.values.truncate(column.values.len() / rows * (rows - 1));
            }
            self.rows -= 1;
        }
    }

    fn ends_finite(&mut self) -> bool {
        let rows = self.rows;
        self.columns(None).into_iter().all(|column| {
            let last = column.values.len() - column.values.len() / rows;
            column.values[last..].iter().all(|value| match column.name {
                "clearance" | "self_clearance" | "contact_threshold" => {
                    value.is_finite() || *value == f64::INFINITY
                }
                "sensed" | "touched_link" | "q_plan" => true,
                _ => value.is_finite(),
            })
        })
    }

    /// Appends one row.
    pub fn push(&mut self, s: &Snapshot<'_>) {
        self.rows += 1;
        self.t.push(s.t);
        self.q.extend_from_slice(s.q);
        self.dq.extend_from_slice(s.dq);
        self.tau.extend_from_slice(&s.torque.total);
        self.tau_task.extend_from_slice(&s.torque.task);
        self.tau_null.extend_from_slice(&s.torque.null);
        self.tau_vff.extend_from_slice(s.tau_vff);
        let [x, x_ref] = [s.x, s.x_ref].map(|pose| pose.split_at(self.sizes.pose));
        self.x.extend_from_slice(x.0);
        self.orientation.extend_from_slice(x.1);
        self.dx.extend_from_slice(s.dx);
        self.x_ref.extend_from_slice(x_ref.0);
        self.orientation_ref.extend_from_slice(x_ref.1);
        self.error.extend_from_slice(s.error);
        self.force.extend_from_slice(s.force);
        self.clearance.extend_from_slice(s.clearance);
        s.obstacles.append_to(&mut self.obstacles);
        if let Some(sensed) = s.sensed {
            sensed.append_to(&mut self.sensed);
        }
        self.energy.extend_from_slice(&s.energy.values());
        self.power.extend_from_slice(&s.power.values());
        self.manipulability.push(s.manipulability);
        if !s.q_measured.is_empty() {
            self.q_measured.extend_from_slice(s.q_measured);
            self.dq_measured.extend_from_slice(s.dq_measured);
        }
        if !s.tau_applied.is_empty() {
            self.tau_applied.extend_from_slice(s.tau_applied);
        }
        if let Some(objective_scale) = s.objective_scale {
            self.objective_scale.extend_from_slice(objective_scale);
        }
        self.self_clearance.extend(s.self_clearance);
        self.tank.extend(s.tank);
        for (column, values) in [
            (&mut self.tau_ext, s.tau_ext),
            (&mut self.contact_force, s.contact_force),
            (&mut self.tau_ext_estimate, s.tau_ext_estimate),
            (&mut self.wrench_estimate, s.wrench_estimate),
            (&mut self.contact_deviation, s.contact_deviation),
            (&mut self.contact_threshold, s.contact_threshold),
        ] {
            if let Some(values) = values {
                column.extend_from_slice(values);
            }
        }
        #[expect(clippy::cast_precision_loss, reason = "few links")]
        let touched = |link| if link < s.q.len() { link as f64 } else { f64::NAN };
        self.touched_link.extend(s.touched_link.map(touched));
        self.yielded.extend(s.yielded);
        #[expect(clippy::cast_precision_loss, reason = "few parts")]
        self.released.extend(s.released.map(|parts| parts as f64));
        self.slack.extend(s.slack);
        self.path_time.extend(s.path_time);
        match s.q_plan {
            Some(q) => self.q_plan.extend_from_slice(q),
            None if s.has_plans() => self.q_plan.extend(s.q.iter().map(|_| f64::NAN)),
            None => {}
        }
    }
}
