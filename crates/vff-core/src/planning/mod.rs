//! What could have been done, for those who know the future.

pub mod feasibility;
