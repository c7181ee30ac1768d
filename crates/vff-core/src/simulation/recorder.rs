//! The record of a run: row-major arrays, allocated once, handed on without a copy.

use super::Snapshot;
use crate::control::{energy, limits};

/// Every recorded quantity, one row per recorded instant (units as in [`Snapshot`]). One that the run
/// does not have stays empty.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Record {
    /// Number of rows T.
    pub rows: usize,
    /// Number of joints n.
    pub joints: usize,
    /// Task dimension m.
    pub task: usize,
    /// Number of obstacles k.
    pub obstacles_count: usize,
    /// Number of rays r of the range sensors.
    pub rays: usize,
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
    /// (T, m).
    pub x: Vec<f64>,
    /// (T, m).
    pub dx: Vec<f64>,
    /// (T, m).
    pub x_ref: Vec<f64>,
    /// (T, m).
    pub error: Vec<f64>,
    /// (T, n).
    pub force: Vec<f64>,
    /// (T, n).
    pub clearance: Vec<f64>,
    /// (T, k, 2).
    pub obstacles: Vec<f64>,
    /// (T, n), or empty without `[measurement]`.
    pub q_measured: Vec<f64>,
    /// (T, n), or empty without `[measurement]`.
    pub dq_measured: Vec<f64>,
    /// (T, n), or empty without `[actuator]`.
    pub tau_applied: Vec<f64>,
    /// (T, r, 2), or empty without range sensors.
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
    /// (T), or empty.
    pub slack: Vec<f64>,
    /// (T), or empty.
    pub path_time: Vec<f64>,
}

/// The largest record that is accepted, and the largest sum of the records of a batch [bytes]: systems
/// that promise more memory than they have would otherwise end the process in the middle of a run.
pub const MAX_BYTES: usize = 8_000_000_000;

/// The record of a run would be too large.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{rows} recorded rows take {gigabytes:.1} GB, more than there is or than the 8 GB allowed")]
pub struct RecordTooLarge {
    /// Rows asked for.
    pub rows: usize,
    /// Memory they need [GB].
    pub gigabytes: f64,
}

impl Record {
    /// Room for `rows` rows like `s`.
    ///
    /// # Errors
    /// If they take too much memory.
    pub fn with_capacity(rows: usize, s: &Snapshot<'_>) -> Result<Self, RecordTooLarge> {
        let (joints, task, obstacles_count) = (s.q.len(), s.x.len(), s.world.len());
        let rays = s.sensed.len();
        let mut record = Self { joints, task, obstacles_count, rays, ..Self::default() };
        let row_bytes = 8 * record.arrays(Some(s)).iter().map(|(_, width)| width).sum::<usize>();
        let fits = rows.checked_mul(row_bytes).is_some_and(|bytes| bytes <= MAX_BYTES);
        let reserve =
            |(array, width): (&mut Vec<f64>, usize)| array.try_reserve_exact(rows * width);
        if fits && record.arrays(Some(s)).into_iter().try_for_each(reserve).is_ok() {
            return Ok(record);
        }
        #[expect(clippy::cast_precision_loss, reason = "a message")]
        let gigabytes = 1e-9 * rows as f64 * row_bytes as f64;
        Err(RecordTooLarge { rows, gigabytes })
    }

    /// The most that one row takes [bytes].
    pub fn row_bytes(n: usize, m: usize, obstacles: usize, rays: usize) -> usize {
        let (joints, task, obstacles_count) = (n, m, obstacles);
        let mut empty = Self { joints, task, obstacles_count, rays, ..Self::default() };
        8 * empty.arrays(None).iter().map(|(_, width)| width).sum::<usize>()
    }

    /// Every array with the length of its rows: of a run like `s`, or of one that has everything.
    fn arrays(&mut self, s: Option<&Snapshot<'_>>) -> [(&mut Vec<f64>, usize); 26] {
        let (n, m) = (self.joints, self.task);
        let optional = |given: fn(&Snapshot<'_>) -> bool, width: usize| {
            if s.is_none_or(given) { width } else { 0 }
        };
        [
            (&mut self.t, 1),
            (&mut self.q, n),
            (&mut self.dq, n),
            (&mut self.tau, n),
            (&mut self.tau_task, n),
            (&mut self.tau_null, n),
            (&mut self.tau_vff, n),
            (&mut self.x, m),
            (&mut self.dx, m),
            (&mut self.x_ref, m),
            (&mut self.error, m),
            (&mut self.force, n),
            (&mut self.clearance, n),
            (&mut self.obstacles, 2 * self.obstacles_count),
            (&mut self.q_measured, optional(|s| !s.q_measured.is_empty(), n)),
            (&mut self.dq_measured, optional(|s| !s.dq_measured.is_empty(), n)),
            (&mut self.tau_applied, optional(|s| !s.tau_applied.is_empty(), n)),
            (&mut self.sensed, 2 * self.rays),
            (&mut self.energy, energy::ENERGIES.len()),
            (&mut self.power, energy::PORTS.len()),
            (&mut self.manipulability, 1),
            (
                &mut self.objective_scale,
                optional(|s| s.objective_scale.is_some(), limits::OBJECTIVES.len()),
            ),
            (&mut self.self_clearance, optional(|s| s.self_clearance.is_some(), 1)),
            (&mut self.tank, optional(|s| s.tank.is_some(), 1)),
            (&mut self.slack, optional(|s| s.slack.is_some(), 1)),
            (&mut self.path_time, optional(|s| s.path_time.is_some(), 1)),
        ]
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
        self.x.extend_from_slice(s.x);
        self.dx.extend_from_slice(s.dx);
        self.x_ref.extend_from_slice(s.x_ref);
        self.error.extend_from_slice(s.error);
        self.force.extend_from_slice(s.force);
        self.clearance.extend_from_slice(s.clearance);
        for position in s.obstacles() {
            self.obstacles.extend_from_slice(position.as_slice());
        }
        for point in s.sensed {
            self.sensed.extend_from_slice(point.as_slice());
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
        self.slack.extend(s.slack);
        self.path_time.extend(s.path_time);
    }
}
