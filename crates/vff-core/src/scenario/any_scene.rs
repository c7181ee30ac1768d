//! The scene of any arm behind one type.

use super::plane::PlanarScene;
use super::scene::{FromDocument, Scene};
use super::space::SpatialScene;
use crate::math::Vector;
use crate::robot::{Model, Robot};
use crate::world::{Description, space};
use std::sync::Arc;

fn bodies<S: FromDocument<D>, const D: usize>(scene: &Scene<S, D>) -> usize {
    S::arm(&scene.arm).map_or(0, |arm| Arc::new(arm).state().body_count())
}

/// The scene of any arm: the list of all that there are.
#[derive(Debug, Clone, PartialEq)]
pub enum AnyScene {
    /// In the plane.
    Plane(Box<PlanarScene>),
    /// In space.
    Space(Box<SpatialScene>),
}

/// Does the same with whatever scene it is.
macro_rules! on_scene {
    ($scene:expr, $inner:ident => $body:expr) => {
        match $scene {
            $crate::scenario::AnyScene::Plane($inner) => $body,
            $crate::scenario::AnyScene::Space($inner) => $body,
        }
    };
}

pub(crate) use on_scene;

impl AnyScene {
    /// Of the space.
    pub fn dimension(&self) -> usize {
        match self {
            Self::Plane(_) => 2,
            Self::Space(_) => 3,
        }
    }

    /// How many obstacles there are.
    pub fn obstacle_count(&self) -> usize {
        on_scene!(self, scene => scene.obstacles.len())
    }

    /// How many points the clouds among them have.
    pub fn cloud_points(&self) -> usize {
        let Self::Space(scene) = self else { return 0 };
        let points = scene.obstacles.iter().map(|obstacle| match &obstacle.shape {
            space::Shape::Points { points, .. } => points.len(),
            _ => 0,
        });
        points.sum()
    }

    /// How many bodies the arm has, none if there is no such arm.
    pub fn body_count(&self) -> usize {
        on_scene!(self, scene => bodies(scene))
    }

    /// The highest speed of any obstacle \[m/s\].
    pub fn top_speed(&self) -> f64 {
        on_scene!(self, scene => {
            let speeds = scene.obstacles.iter().map(|obstacle| obstacle.motion().top_speed());
            speeds.fold(0.0, f64::max)
        })
    }

    /// Displaces every obstacle with its motion by a number of `draw` \[m\] along every axis.
    pub fn shift_obstacles(&mut self, mut draw: impl FnMut() -> f64) {
        on_scene!(self, scene => for obstacle in &mut scene.obstacles {
            let shift = Vector::from_fn(|_, _| draw());
            obstacle.set_position(obstacle.position() + shift);
            obstacle.set_motion(obstacle.motion().shifted(&shift));
        });
    }

    /// The scene, if it is in the plane.
    pub fn plane(&self) -> Option<&PlanarScene> {
        match self {
            Self::Plane(scene) => Some(scene),
            Self::Space(_) => None,
        }
    }

    /// The same, to be changed.
    pub fn plane_mut(&mut self) -> Option<&mut PlanarScene> {
        match self {
            Self::Plane(scene) => Some(scene),
            Self::Space(_) => None,
        }
    }
}
