//! What a link is for, by its name.

/// What the name of a link or joint lets one expect, the likeliest tip first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Role {
    Tool,
    Any,
    /// A finger, a sensor, or what is only drawn.
    Finger,
}

impl Role {
    pub fn of(name: &str) -> Self {
        const FINGERS: [&str; 16] = [
            "finger",
            "thumb",
            "knuckle",
            "jaw",
            "pad",
            "camera",
            "sensor",
            "imu",
            "accelerometer",
            "gyro",
            "range",
            "sonar",
            "optical",
            "screen",
            "visual",
            "collision",
        ];
        const TOOLS: [&str; 7] = ["tool", "tcp", "hand", "gripper", "effector", "flange", "eef"];
        let name = name.to_lowercase();
        match () {
            () if FINGERS.iter().any(|word| name.contains(*word)) => Self::Finger,
            () if TOOLS.iter().any(|word| name.contains(*word)) => Self::Tool,
            () if name.split(|c: char| !c.is_alphanumeric()).any(|word| word == "ee") => Self::Tool,
            () => Self::Any,
        }
    }

    /// Whether a joint opens and closes a gripper, by its name.
    pub fn grips(joint: &str) -> bool {
        let joint = joint.to_lowercase();
        ["grip", "finger", "jaw", "knuckle", "thumb"].iter().any(|word| joint.contains(word))
    }
}
