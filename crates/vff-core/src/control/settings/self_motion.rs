//! What can be set on the search of the self-motion.

use crate::settings::settings;

settings! {
    /// How the self-motion is searched: the `[controller.yielding.preview.self_motion]` table of a scenario.
    pub struct SelfMotionSettings {
        /// Time over which a search is spread, rounded up to whole control steps; the next begins then.
        period: f64 = 0.05, "s", POSITIVE;
        /// How far ahead it looks.
        horizon: f64 = 3.0, "s", POSITIVE;
        /// Instants at which it looks, apart from the present one.
        steps: usize = 30, "", UP_TO_10000;
        /// How far apart the postures are that it looks at, along the self-motion.
        spacing: f64 = 0.03, "rad", POSITIVE;
        /// How far it goes along the self-motion, in both directions.
        range: f64 = 2.4, "rad", POSITIVE;
        /// Share of the joints' largest speeds that it plans with.
        speed: f64 = 0.95, "", SHARE;
        /// Largest acceleration along the self-motion that it plans with.
        acceleration: f64 = 10.0, "rad/s²", POSITIVE;
        /// A larger distance makes a posture no better.
        clearance: f64 = 0.1, "m", POSITIVE;
    }
}
