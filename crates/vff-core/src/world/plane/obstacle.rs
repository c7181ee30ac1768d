//! One obstacle, as it is described in a scenario.

use super::Shape;
use crate::world::Motion;
use serde::Deserialize;
use std::collections::BTreeMap;

/// An obstacle in the plane: an outline, where it starts and how it moves.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub struct Obstacle {
    /// PlanarGeometry in the obstacle's own frame.
    pub shape: Shape,
    /// Initial position \[m\]: where the origin of the own frame lies. Default (0, 0).
    #[serde(default)]
    pub position: [f64; 2],
    /// Angle of the own frame \[rad\] at t = 0. Default 0.
    #[serde(default)]
    pub angle: f64,
    /// How fast it turns about its position \[rad/s\], anticlockwise. Default 0.
    #[serde(default)]
    pub angular_velocity: f64,
    /// Motion from the initial position. Default: none.
    #[serde(default)]
    pub motion: Motion<2>,
    /// Links that may touch it, by name, and [`LOAD`](crate::world::LOAD) for what the arm carries: they are not measured against
    /// it. Default: none.
    #[serde(default)]
    pub ignore: Vec<String>,
    /// What every link keeps from it \[m\], in place of the margin of the law and of plans. Default: that margin.
    #[serde(default)]
    pub margin: Option<f64>,
    /// The same of links by name, and of [`LOAD`](crate::world::LOAD), in place of `margin`. Default: none.
    #[serde(default)]
    pub margins: BTreeMap<String, f64>,
    /// How likely it is that something will be there, if it is a possible future that look-ahead alone sees. Default: it is there.
    #[serde(default)]
    pub likelihood: Option<f64>,
    /// What people call that future, of which other obstacles may be parts, too. Default: it is one of its own.
    #[serde(default)]
    pub future: Option<String>,
}

impl Obstacle {
    /// Of this shape, at rest at the origin, and without a word of links.
    ///
    /// # Example
    /// ```
    /// use vff_core::world::plane::{Obstacle, Shape};
    ///
    /// let ball = Obstacle { position: [0.5, 0.4], ..Obstacle::of(Shape::Circle { radius: 0.1 }) };
    /// assert!(ball.ignore.is_empty() && ball.margin.is_none());
    /// ```
    pub fn of(shape: Shape) -> Self {
        Self {
            shape,
            position: [0.0; 2],
            angle: 0.0,
            angular_velocity: 0.0,
            motion: Motion::default(),
            ignore: vec![],
            margin: None,
            margins: BTreeMap::new(),
            likelihood: None,
            future: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_with_defaults() {
        let obstacle: Obstacle = toml::from_str("shape = { circle = { radius = 0.3 } }").unwrap();
        assert_eq!(
            obstacle,
            Obstacle {
                shape: Shape::Circle { radius: 0.3 },
                position: [0.0; 2],
                angle: 0.0,
                angular_velocity: 0.0,
                motion: Motion::Static {},
                ignore: vec![],
                margin: None,
                margins: [].into(),
                likelihood: None,
                future: None,
            }
        );
    }

    #[test]
    fn a_full_table() {
        let obstacle: Obstacle = toml::from_str(
            "shape = { box = { size = [1, 2.0] } }\n\
             position = [1.5, 2.0]\n\
             angle = 0.5\n\
             angular_velocity = -2\n\
             motion = { sinusoid = { amplitude = [0, 1], angular_frequency = 0.5 } }",
        )
        .unwrap();
        assert_eq!(obstacle.shape, Shape::Box { size: [1.0, 2.0] });
        assert_eq!((obstacle.angle, obstacle.angular_velocity), (0.5, -2.0));
        assert_eq!(
            obstacle.motion,
            Motion::Sinusoid {
                amplitude: [0.0, 1.0],
                angular_frequency: 0.5,
                phase: 0.0,
                foreseen: false
            }
        );
    }

    #[test]
    fn unknown_names_are_refused() {
        for text in [
            "shape = { circle = { radius = 0.3, colour = 1 } }",
            "shape = { circle = { radius = 0.3 } }\nvelocity = [1.0, 0.0]",
            "shape = { disc = { radius = 0.3 } }",
        ] {
            let error = toml::from_str::<Obstacle>(text).unwrap_err().to_string();
            assert!(error.contains("expected"), "{error}");
        }
    }
}
