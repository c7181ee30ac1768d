//! One obstacle in space, as it is described in a scenario.

use super::Shape;
use crate::math::upright;
use crate::world::Motion;
use serde::Deserialize;
use std::collections::BTreeMap;

/// An obstacle in space: a shape, where it starts and how it moves.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub struct Obstacle {
    /// Shape in the obstacle's own frame.
    pub shape: Shape,
    /// Initial position \[m\]: where the origin of the own frame lies. Default (0, 0, 0).
    #[serde(default)]
    pub position: [f64; 3],
    /// Orientation of the own frame at t = 0: a quaternion \[w, x, y, z\] of norm 1 within 1 %. Default: none.
    #[serde(default = "upright")]
    pub orientation: [f64; 4],
    /// Angular velocity with which it turns about its position \[rad/s\], world axes. Default: none.
    #[serde(default)]
    pub angular_velocity: [f64; 3],
    /// Motion from the initial position. Default: none.
    #[serde(default)]
    pub motion: Motion<3>,
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
    /// use vff_core::world::space::{Obstacle, Shape};
    ///
    /// let ball = Obstacle { position: [0.5, 0.4, 0.3], ..Obstacle::of(Shape::Sphere { radius: 0.1 }) };
    /// assert!(ball.ignore.is_empty() && ball.margin.is_none());
    /// ```
    pub fn of(shape: Shape) -> Self {
        Self {
            shape,
            position: [0.0; 3],
            orientation: upright(),
            angular_velocity: [0.0; 3],
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
        let obstacle: Obstacle = toml::from_str("shape = { sphere = { radius = 0.3 } }").unwrap();
        assert_eq!(
            obstacle,
            Obstacle {
                shape: Shape::Sphere { radius: 0.3 },
                position: [0.0; 3],
                orientation: [1.0, 0.0, 0.0, 0.0],
                angular_velocity: [0.0; 3],
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
    fn every_shape() {
        let shape = |text: &str| toml::from_str::<Obstacle>(text).unwrap().shape;
        assert_eq!(
            shape("shape = { capsule = { a = [0, 0, 0], b = [0, 0, 1.5], radius = 0.1 } }"),
            Shape::Capsule { a: [0.0; 3], b: [0.0, 0.0, 1.5], radius: 0.1 }
        );
        assert_eq!(
            shape("shape = { box = { size = [1, 2.0, 3] } }"),
            Shape::Box { size: [1.0, 2.0, 3.0] }
        );
        assert_eq!(
            shape("shape = { convex = { vertices = [[0, 0, 0], [1, 0, 0]] } }"),
            Shape::Convex { vertices: vec![[0.0; 3], [1.0, 0.0, 0.0]] }
        );
        assert_eq!(
            shape("shape = { half_space = { normal = [0, 0, 1] } }"),
            Shape::HalfSpace { normal: [0.0, 0.0, 1.0] }
        );
        assert_eq!(
            shape("shape = { points = { points = [[0, 0, 0], [1, 0, 0.5]], radius = 0.02 } }"),
            Shape::Points { points: vec![[0.0; 3], [1.0, 0.0, 0.5]], radius: 0.02 }
        );
    }

    #[test]
    fn a_full_table() {
        let obstacle: Obstacle = toml::from_str(
            "shape = { box = { size = [1, 2.0, 3] } }\n\
             position = [1.5, 2.0, 0.5]\n\
             orientation = [0, 1, 0, 0]\n\
             angular_velocity = [0, 0.5, 0]\n\
             motion = { sinusoid = { amplitude = [0, 1, 2], angular_frequency = 0.5 } }",
        )
        .unwrap();
        assert_eq!(
            obstacle,
            Obstacle {
                shape: Shape::Box { size: [1.0, 2.0, 3.0] },
                position: [1.5, 2.0, 0.5],
                orientation: [0.0, 1.0, 0.0, 0.0],
                angular_velocity: [0.0, 0.5, 0.0],
                motion: Motion::Sinusoid {
                    amplitude: [0.0, 1.0, 2.0],
                    angular_frequency: 0.5,
                    phase: 0.0,
                    foreseen: false,
                },
                ignore: vec![],
                margin: None,
                margins: [].into(),
                likelihood: None,
                future: None,
            }
        );
    }

    #[test]
    fn unknown_names_are_refused() {
        for text in [
            "shape = { sphere = { radius = 0.3, colour = 1 } }",
            "shape = { sphere = { radius = 0.3 } }\nangle = 1.0",
            "shape = { circle = { radius = 0.3 } }",
            "shape = { box = { size = [1.0, 2.0] } }",
        ] {
            let error = toml::from_str::<Obstacle>(text).unwrap_err().to_string();
            assert!(error.contains("expected"), "{error}");
        }
    }
}
