//! The record of a run: row-major arrays, allocated once, handed on without a copy.

use super::Snapshot;

/// Every recorded quantity, one row per recorded instant (THEORY's notation; units as in
/// [`Snapshot`]).
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
}

/// The record of a run does not fit into memory.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{rows} recorded rows need {gigabytes:.1} GB of memory")]
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
    /// If there is not enough memory.
    pub fn with_capacity(
        rows: usize,
        n: usize,
        m: usize,
        obstacles: usize,
    ) -> Result<Self, RecordTooLarge> {
        let mut record = Self { joints: n, task: m, obstacles_count: obstacles, ..Self::default() };
        for (array, width) in record.arrays() {
            let reserved = rows.checked_mul(width).map(|size| array.try_reserve_exact(size));
            if !matches!(reserved, Some(Ok(()))) {
                #[expect(clippy::cast_precision_loss, reason = "a message")]
                let gigabytes = 8e-9 * rows as f64 * (1 + 8 * n + 4 * m + 2 * obstacles) as f64;
                return Err(RecordTooLarge { rows, gigabytes });
            }
        }
        Ok(record)
    }

    /// Every array with the length of its rows.
    fn arrays(&mut self) -> [(&mut Vec<f64>, usize); 14] {
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
    }
}
