//! What can be set of a perceiver.

use super::{MAX_CELLS, MAX_POINTS, PerceptionError};
use crate::math::Vector;
use crate::robot::SpatialArm;
use crate::settings::{Numbers, Table, settings};

settings! {
    /// How pictures become points, and how long they last.
    ///
    /// # Example
    /// ```
    /// use vff_core::perception::PerceiverSettings;
    ///
    /// let settings: PerceiverSettings = toml::from_str("voxel = 0.03").unwrap();
    /// assert_eq!(settings, PerceiverSettings { voxel: 0.03, ..PerceiverSettings::default() });
    /// ```
    pub struct PerceiverSettings {
        /// Opposite corners of the room that is looked at, in the world, the lower ones first; what is outside is not there.
        room: [[f64; 3]; 2] = [[-1.0, -1.0, -0.2], [1.0, 1.0, 1.4]], "m";
        /// The side of a cell.
        voxel: f64 = 0.02, "m", POSITIVE;
        /// Cells that are remembered at most: points of the cloud, up to 50 000, or half as many with `hidden`.
        most_voxels: usize = 25_000, "", AT_LEAST_ONE;
        /// Every how manieth row and column of a picture is looked at.
        stride: usize = 2, "", AT_LEAST_ONE;
        /// What is deeper in the picture is not looked at.
        range: f64 = 3.0, "m", POSITIVE;
        /// A cell is hit by so many points of a picture or more; what is less counts as an outlier. Where a cell is so far away that fewer than twice as many pixels look at it, half of these are enough.
        least_points: usize = 2, "", AT_LEAST_ONE;
        /// How long it is remembered that something was there, where nothing is seen any more.
        memory: f64 = 2.0, "s", NOT_NEGATIVE;
        /// What is cut away around the arm where it stands: calibration, noise, and errors of its shape.
        margin: f64 = 0.02, "m", NOT_NEGATIVE;
        /// By how much clocks of cameras and arm are wrong at most: a body is cut away wider by how far it goes meanwhile.
        time_error: f64 = 0.02, "s", NOT_NEGATIVE;
        /// What is added to the time of a picture, so that it is one of the arm's clock.
        time_offset: f64 = 0.0, "s", FINITE;
        /// A picture is refused if no state of the arm is known so near to its time.
        latest_state: f64 = 0.05, "s", NOT_NEGATIVE;
        /// The error of a depth at 1 m; it grows with the square of the depth.
        depth_error: f64 = 0.005, "m", NOT_NEGATIVE;
        /// A body that is not wider than this is taken for as deep as it is wide: its points are doubled, seen from the camera behind it, and one that is round has points all around; 0 adds none.
        hidden: f64 = 0.0, "m", NOT_NEGATIVE;
        /// What is left out around what is known.
        known_margin: f64 = 0.02, "m", NOT_NEGATIVE;
        /// After this time in its place what is there counts as standing.
        settling: f64 = 1.0, "s", POSITIVE;
        /// The acceleration of bodies that is reckoned with: a standard deviation.
        acceleration: f64 = 3.0, "m/s²", POSITIVE;
        /// The speed of bodies that are seen for the first time: a standard deviation.
        speed: f64 = 1.0, "m/s", POSITIVE;
        /// The error of the mean of what is seen of a body: a standard deviation.
        track_error: f64 = 0.002, "m", POSITIVE;
    }
}

impl PerceiverSettings {
    /// How many points of the cloud a cell has at most.
    pub fn points_of_a_cell(&self) -> usize {
        if self.hidden > 0.0 { 2 } else { 1 }
    }

    /// Whether the arm reaches into the room: around another place nothing would ever be seen.
    pub(super) fn check_reach(&self, arm: &SpatialArm) -> Result<(), PerceptionError> {
        let [low, high] = self.room.map(Vector::from);
        let (base, reach) = (arm.base(), arm.reach_bound());
        if (base - base.sup(&low).inf(&high)).norm() <= reach {
            return Ok(());
        }
        let [x, y, z] = <[f64; 3]>::from(*base);
        let problem = format!(
            "is out of reach of the arm, which goes {reach:.2} m around its base at ({x}, {y}, {z})"
        );
        Err(PerceptionError::Setting { key: "room", problem })
    }

    /// How many cells the room has along each axis, whether that can be or not.
    pub(crate) fn sides(&self) -> [f64; 3] {
        let [low, high] = self.room;
        [0, 1, 2].map(|k| ((high[k] - low[k]) / self.voxel).ceil())
    }

    /// How many cells the room has along each axis.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "compared with a bound before"
    )]
    pub(super) fn check(&self) -> Result<[usize; 3], PerceptionError> {
        Table::check(self, |key, numbers, requirement| {
            let given = match numbers {
                Numbers::One(x) => x,
                #[expect(clippy::cast_precision_loss, reason = "a count")]
                Numbers::Whole(count) => count as f64,
                Numbers::None | Numbers::Each(_) => return Ok(()),
            };
            if given.is_finite() && (requirement.holds)(given) {
                return Ok(());
            }
            let words = if given.is_finite() { requirement.words } else { "finite" };
            let problem = format!("must be {words}, got {given}");
            Err(PerceptionError::Setting { key, problem })
        })?;
        for (key, given, most) in [
            ("most_voxels", self.most_voxels, MAX_POINTS / self.points_of_a_cell()),
            ("least_points", self.least_points, 10_000),
        ] {
            if given > most {
                let problem = format!("must be at most {most}, got {given}");
                return Err(PerceptionError::Setting { key, problem });
            }
        }
        let sides = self.sides();
        #[expect(clippy::cast_precision_loss, reason = "a power of two")]
        let fits = sides.iter().product::<f64>() <= MAX_CELLS as f64;
        let is_room = sides.iter().all(|side| side.is_finite() && *side >= 1.0);
        if is_room && fits {
            return Ok(sides.map(|side| side as usize));
        }
        let problem = if is_room {
            format!("has {} × {} × {} cells, at most {MAX_CELLS} fit", sides[0], sides[1], sides[2])
        } else {
            "must have lower corners below its upper ones, all finite".into()
        };
        Err(PerceptionError::Setting { key: "room", problem })
    }
}
