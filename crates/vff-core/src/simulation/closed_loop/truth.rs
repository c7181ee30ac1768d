//! What a controller with perfect sensors knows.

use crate::control::distance::OwnPair;
use crate::control::operational_space;
use crate::geometry::Body;
use crate::math::{Pose, Vector, dot, keep_least};
use crate::robot::{Manipulator, Robot};
use crate::simulation::System;
use crate::world::{CollisionQuery, World};

/// Where the arm is in truth, and what that comes to.
#[derive(Debug, Clone)]
pub(super) struct Truth<S: System<D, M>, const D: usize, const M: usize> {
    pub dx: Vector<M>,
    pub error: Vector<M>,
    pub clearance: Vec<f64>,
    pub self_clearance: f64,
    /// The links that are so near to each other; none for the base.
    pub nearest_pair: [Option<usize>; 2],
    /// Kinetic and potential energy of the controller's model \[J\].
    pub energy: [f64; 2],
    pub manipulability: f64,
    /// The controller's model there.
    model: S::State,
    momentum: Vec<f64>,
    bodies: Vec<Body<'static, D>>,
}

impl<S: System<D, M>, const D: usize, const M: usize> Truth<S, D, M> {
    /// Of an arm of which the controller has this `model`.
    pub fn new(model: S::State) -> Self {
        let n = model.dof();
        Self {
            dx: Vector::zeros(),
            error: Vector::zeros(),
            clearance: vec![f64::INFINITY; n],
            self_clearance: f64::INFINITY,
            nearest_pair: [None; 2],
            energy: [0.0; 2],
            manipulability: 0.0,
            momentum: vec![0.0; n],
            bodies: Vec::with_capacity(model.body_count()),
            model,
        }
    }

    /// Looks at the `plant`; whether its links are measured against each other is asked of the controller.
    pub fn refresh(
        &mut self,
        plant: &S::State,
        reference: &S::Pose,
        world: &mut World<S::Geometry, D>,
        measures_itself: bool,
    ) {
        self.dx = plant.task_velocity();
        self.error = plant.pose().error(reference);
        self.clearance.fill(f64::INFINITY);
        let nearest = |link: usize, d: f64| keep_least(&mut self.clearance[link], d);
        world.for_each_contact(plant.bodies(), f64::NEG_INFINITY, nearest, |_| {});
        world.for_each_hidden(plant.bodies(), |contact| {
            keep_least(&mut self.clearance[contact.link], contact.distance);
        });
        (self.self_clearance, self.nearest_pair) = (f64::INFINITY, [None; 2]);
        if measures_itself {
            let Self { bodies, self_clearance, nearest_pair, .. } = self;
            OwnPair::for_each_within(plant, bodies, f64::INFINITY, |pair| {
                if pair.nearest.distance < *self_clearance {
                    (*self_clearance, *nearest_pair) = (pair.nearest.distance, pair.links);
                }
                *self_clearance
            });
        }
        let Self { model, momentum, .. } = self;
        model.update(plant.configuration(), plant.velocity());
        model.mass_mul(model.velocity(), momentum);
        self.energy = [0.5 * dot(model.velocity(), momentum), model.potential_energy()];
        self.manipulability = operational_space::manipulability::<_, D, M>(model);
    }
}
