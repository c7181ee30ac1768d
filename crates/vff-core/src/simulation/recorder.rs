//! The record of a run: row-major arrays, allocated once, handed on without a copy.

use super::Snapshot;

/// Every recorded quantity, one row per recorded instant (units as in [`Snapshot`]).
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
    /// (T), 0 without barriers.
    pub slack: Vec<f64>,
}

/// The largest record that is accepted [bytes]: systems that promise more memory than they have
/// would otherwise end the process in the middle of a run.
const MAX_BYTES: usize = 8_000_000_000;

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
    /// Room for `rows` rows.
    ///
    /// # Errors
    /// If they take too much memory.
    pub fn with_capacity(
        rows: usize,
        n: usize,
        m: usize,
        obstacles: usize,
    ) -> Result<Self, RecordTooLarge> {
        let mut record = Self { joints: n, task: m, obstacles_count: obstacles, ..Self::default() };
        let row_bytes = 8 * record.arrays().iter().map(|(_, width)| width).sum::<usize>();
        let fits = rows.checked_mul(row_bytes).is_some_and(|bytes| bytes <= MAX_BYTES);
        let reserve =
            |(array, width): (&mut Vec<f64>, usize)| array.try_reserve_exact(rows * width);
        if fits && record.arrays().into_iter().try_for_each(reserve).is_ok() {
            return Ok(record);
        }
        #[expect(clippy::cast_precision_loss, reason = "a message")]
        let gigabytes = 1e-9 * rows as f64 * row_bytes as f64;
        Err(RecordTooLarge { rows, gigabytes })
    }

    /// Every array with the length of its rows.
    fn arrays(&mut self) -> [(&mut Vec<f64>, usize); 15] {
        let (n, m) = (self.joints, self.task);
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
            (&mut self.slack, 1),
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
        self.slack.push(s.slack.unwrap_or(0.0));
    }
}
