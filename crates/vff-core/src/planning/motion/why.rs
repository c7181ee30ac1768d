//! Why there is no motion, in a sentence: what is in the way of what, by how much, and what would help.

use super::ranges_of;
use crate::robot::Limits;
use crate::settings::readable;

/// What keeps a configuration from being free, with the signed distance \[m\].
#[derive(Debug, Clone, PartialEq)]
pub enum Obstruction {
    /// A link and an obstacle, by its number; one that passes by within the horizon only, or one that is there.
    Obstacle { link: String, obstacle: usize, distance: f64, passes: bool },
    /// Two bodies of the arm, and whether it has hulls of meshes.
    Own { links: [String; 2], distance: f64, hulls: bool },
}

/// Where on a motion something is in the way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    Start,
    Goal,
    /// On the straight way from the start.
    Retreat,
    /// On the straight way to the goal.
    Approach,
}

impl Place {
    /// There, in a sentence.
    pub fn there(self) -> &'static str {
        match self {
            Self::Start => "at the start",
            Self::Goal => "at the goal",
            Self::Retreat => "on the straight way from the start",
            Self::Approach => "on the straight way to the goal",
        }
    }

    /// Another one of what helps.
    pub fn other(self) -> &'static str {
        match self {
            Self::Start => "start",
            Self::Goal => "goal",
            Self::Retreat | Self::Approach => "direction",
        }
    }
}

/// A length for people.
fn mm(length: f64) -> String {
    format!("{:.2} mm", 1e3 * length)
}

/// A length of any size for people.
pub fn length(length: f64) -> String {
    if length < 1e-3 { format!("{:.2} µm", 1e6 * length) } else { format!("{length:.3} m") }
}

/// Why a goal is not reached that the arm stays away from by `gap` \[m\]; whether it has an orientation.
pub fn too_far(gap: f64, is_turned: bool) -> String {
    format!(
        "no configuration within the joint limits was found nearer to the goal than {}; a goal within the arm's reach{} helps",
        length(gap),
        if is_turned { ", or without an orientation," } else { "" },
    )
}

/// Why a goal is of no use at which the end effector is tilted by `tilt`, of at most so much \[rad\].
pub fn too_tilted(tilt: f64, most: f64) -> String {
    let [tilt, most] = [tilt, most].map(f64::to_degrees);
    format!(
        "at the goal the end effector is tilted by {tilt:.2}°, and may be by {most:.2}°; a goal where it is upright, or a greater \
         tilt, helps",
    )
}

/// Why a goal is of no use from which a point is off the axis of the end effector by `off`, of at most so much \[rad\].
pub fn out_of_view(off: f64, most: f64) -> String {
    let [off, most] = [off, most].map(f64::to_degrees);
    format!(
        "at the goal the point that is to be kept in view is {off:.2}° off the axis of the end effector, and may be {most:.2}°; a goal \
         that looks at it, or a greater angle of view, helps",
    )
}

impl Obstruction {
    /// How far they are from each other \[m\].
    pub fn distance(&self) -> f64 {
        let (Self::Obstacle { distance, .. } | Self::Own { distance, .. }) = self;
        *distance
    }

    /// The sentence.
    pub fn sentence(&self, place: Place, horizon: Option<f64>) -> String {
        let (there, other) = (place.there(), place.other());
        match self {
            Self::Obstacle { link, obstacle, distance, passes: false } => format!(
                "{there} {link} is {} inside obstacle {obstacle}; another {other} helps, or `ignore` of the obstacle \
                 where the link may touch it",
                mm(-distance),
            ),
            Self::Obstacle { obstacle, distance: f64::NEG_INFINITY, .. } => format!(
                "obstacle {obstacle} goes farther within the horizon of {:e} s than it can be looked for, and may come by anywhere; a \
                 shorter horizon or a slower obstacle helps",
                horizon.unwrap_or(0.0),
            ),
            Self::Obstacle { link, obstacle, distance, .. } => readable(&format!(
                "obstacle {obstacle} passes within the horizon of {} s where {link} is {there}, up to {} into it; \
                 a shorter horizon or another {other} helps, a horizon of 0 takes what moves for standing still",
                horizon.unwrap_or(0.0),
                mm(-distance),
            )),
            Self::Own { links: [a, b], distance, hulls } => format!(
                "{there} {a} is {} inside {b}; another {other} helps, or shapes nearer to the links \
                 ({}), or to `ignore` the pair where these always overlap",
                mm((-distance).max(0.0)),
                if *hulls {
                    "the mesh of one in several `pieces`"
                } else {
                    "`collision = \"file\"`"
                },
            ),
        }
    }
}

/// The joint that is farthest beyond its limits, if one is.
pub fn beyond(
    q: &[f64],
    limits: &Limits,
    place: Place,
    mut name: impl FnMut(usize) -> String,
) -> Option<String> {
    let over = |i: usize, q: f64| {
        let [lower, upper] = ranges_of(limits, i);
        if q < lower { (lower - q, lower) } else { (q - upper, upper) }
    };
    let (i, (excess, limit)) = (0..q.len())
        .map(|i| (i, over(i, q[i])))
        .max_by(|(_, (a, _)), (_, (b, _))| a.total_cmp(b))
        .filter(|(_, (excess, _))| *excess > 0.0)?;
    Some(format!(
        "{} {} is at {:.4}, {excess:.3} beyond its limit of {limit:.4}; another {} helps",
        place.there(),
        name(i),
        q[i],
        place.other(),
    ))
}

/// A joint that cannot hold what it would have to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Heavy {
    pub joint: usize,
    /// What holding takes, and what it may take \[N·m, N\].
    pub torque: [f64; 2],
}

impl Heavy {
    /// The sentence; of its limit the joint may use a `share`.
    pub fn sentence(&self, name: &str, slides: bool, share: f64) -> String {
        let ([holds, most], unit) = (self.torque, if slides { "N" } else { "N·m" });
        format!(
            "on the way {name} would have to hold {holds:.3} {unit}, and may take {most:.3} {unit}, {:.0} % of its limit; \
             a lighter payload, a higher limit or another goal helps",
            100.0 * share,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Nobody is advised to take what there is already.
    #[test]
    fn shapes_that_help_are_others() {
        let sentence = |hulls| {
            let links = ["a", "b"].map(String::from);
            Obstruction::Own { links, distance: -2e-3, hulls }.sentence(Place::Goal, None)
        };
        let [capsules, hulls] = [false, true].map(sentence);
        assert!(capsules.starts_with("at the goal a is 2.00 mm inside b; another goal helps, or"));
        assert!(capsules.contains("`collision = \"file\"`") && !capsules.contains("pieces"));
        assert!(hulls.contains("in several `pieces`") && !hulls.contains("collision"), "{hulls}");
    }
}
