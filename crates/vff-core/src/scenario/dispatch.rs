//! The one list of what runs: every space with its tasks.

/// Calls `$visit::<S, D, M>($argument, …)`, which returns a `Result<_, ScenarioError>`, for the space of `$of`, an
/// `$Any::Plane($inner)` or `$Any::Space($inner)`, and for a task. A task that this space does not have is an error: whoever
/// writes Rust can change a scenario after it was validated.
macro_rules! dispatch {
    ($of:expr, $task:expr, $Any:ident($inner:ident) => $visit:ident($($argument:expr),*)) => {{
        use $crate::control::TaskKind::{Pointing, Pose, Position};
        use $crate::simulation::{Plane, Space};
        match ($of, $task) {
            ($Any::Plane($inner), Position) => $visit::<Plane, 2, 2>($($argument),*),
            ($Any::Plane($inner), Pose) => $visit::<Plane, 2, 3>($($argument),*),
            ($Any::Plane(_), Pointing) => Err($crate::scenario::not_in_the_plane().inside("controller")),
            ($Any::Space($inner), Position) => $visit::<Space, 3, 3>($($argument),*),
            ($Any::Space($inner), Pointing) => $visit::<Space, 3, 5>($($argument),*),
            ($Any::Space($inner), Pose) => $visit::<Space, 3, 6>($($argument),*),
        }
    }};
}

pub(crate) use dispatch;
