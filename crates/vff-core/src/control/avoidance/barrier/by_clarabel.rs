//! What tests know of the last program, and what another solver makes of it.

use super::Barrier;

impl Barrier {
    /// y as the program has it; None where nothing was to be solved: a breach by rounding alone, 1e-15, is beyond an
    /// interior-point method.
    pub(crate) fn solution(&self) -> Option<&[f64]> {
        self.bounds.iter().any(|b| *b > 1e-9).then(|| self.program.x())
    }

    /// Whether a constraint from the `first` on is active.
    pub(crate) fn is_active_from(&self, first: usize) -> bool {
        self.program.active().any(|(i, _)| i >= first)
    }

    /// y by Clarabel, every soft constraint with an unknown of its own.
    pub(crate) fn solution_by_clarabel(&self) -> Vec<f64> {
        use clarabel::algebra::CscMatrix;
        use clarabel::solver::{
            DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus,
            SupportedConeT,
        };
        use nalgebra::DMatrix;

        let (n, m) = (self.nominal.len(), self.bounds.len());
        let soft: Vec<usize> = (0..m).filter(|&i| self.softness[i] > 0.0).collect();
        let size = n + soft.len();
        let mut p = DMatrix::<f64>::zeros(size, size);
        let mut a = DMatrix::<f64>::zeros(m, size);
        for i in 0..n {
            for k in 0..=i {
                p[(k, i)] = self.hessian[i * n + k];
            }
        }
        for i in 0..m {
            for k in 0..n {
                a[(i, k)] = -self.normals[i * n + k];
            }
        }
        for (k, &i) in soft.iter().enumerate() {
            p[(n + k, n + k)] = 1.0 / self.softness[i];
            a[(i, n + k)] = -1.0;
        }
        let columns = |matrix: &DMatrix<f64>| -> Vec<Vec<f64>> {
            matrix.row_iter().map(|row| row.iter().copied().collect()).collect()
        };
        let b: Vec<f64> = self.bounds.iter().map(|b| -b).collect();
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
}
