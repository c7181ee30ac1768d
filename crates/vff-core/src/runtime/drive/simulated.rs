//! The plant of a scenario as a robot: to try a drive, and to measure a loop in which nothing but the loop takes time.

use super::driver::Driver;
use crate::control::Gravity;
use crate::math::ScalarOrVec;
use crate::runtime::arm::{AnyArm, AnyState};
use crate::runtime::real_time::at_rate;
use crate::runtime::run::AnyRun;
use crate::scenario::{Scenario, ScenarioError};

/// The plant of a scenario, with its friction, stops, sensors and drives, but without its controller. It goes on by one
/// period whenever it gets a torque, so that its time does not depend on the clock.
#[derive(Debug, Clone)]
pub struct SimulatedRobot {
    run: AnyRun,
    /// Plant steps per period.
    every: usize,
    /// The arm whose weight it compensates, if somebody has said which.
    weight: Option<AnyState>,
    /// Whether it compensates its weight.
    is_weightless: bool,
    held: Vec<f64>,
    /// What was changed or is odd, in sentences.
    pub notes: Vec<String>,
}

impl SimulatedRobot {
    /// The plant of `scenario`, which gets torques at `rate` \[Hz\]. With `arm` it adds the torque against gravity of that arm itself;
    /// without, that of its own where the `command` of the scenario leaves gravity to the robot.
    ///
    /// # Errors
    /// If the scenario cannot be run at this rate.
    pub fn new(
        scenario: &Scenario,
        rate: f64,
        arm: Option<&AnyArm>,
    ) -> Result<Self, ScenarioError> {
        let (mut scenario, mut notes) = at_rate(scenario, rate);
        let gravity = &mut scenario.controller.command.gravity;
        let is_weightless = arm.is_some() || *gravity == Gravity::Robot;
        if arm.is_some() {
            *gravity = Gravity::Controller; // once is enough
        }
        if scenario.replan.take().is_some() && scenario.controller.posture.is_none() {
            // Plans are for who drives it, and its own law has none to pull to.
            scenario.controller.posture_stiffness = ScalarOrVec::Uniform(0.0);
        }
        scenario.validate()?;
        let ready = scenario.prepare_recorded(false)?;
        notes.extend(ready.warnings);
        Ok(Self {
            held: vec![0.0; ready.run.snapshot().q.len()],
            run: ready.run,
            every: scenario.simulation.control_every,
            weight: arm.map(AnyArm::state),
            is_weightless,
            notes,
        })
    }

    /// Whether it adds the torque against gravity itself.
    pub fn is_weightless(&self) -> bool {
        self.is_weightless
    }

    /// The number of joints.
    pub fn dof(&self) -> usize {
        self.held.len()
    }
}

impl Driver for SimulatedRobot {
    fn read(&mut self, q: &mut [f64], dq: &mut [f64]) -> Result<f64, String> {
        let now = self.run.snapshot();
        let measured = !now.q_measured.is_empty();
        q.copy_from_slice(if measured { now.q_measured } else { now.q });
        dq.copy_from_slice(if measured { now.dq_measured } else { now.dq });
        Ok(now.t)
    }

    /// That of the scenario's wrenches.
    fn external_torque(&mut self, tau: &mut [f64]) -> Result<bool, String> {
        match self.run.snapshot().tau_ext {
            Some(external) => tau.copy_from_slice(external),
            None => tau.fill(0.0),
        }
        Ok(true)
    }

    fn write(&mut self, command: &[f64]) -> Result<(), String> {
        self.held.copy_from_slice(command);
        if let Some(arm) = &mut self.weight {
            let now = self.run.snapshot();
            arm.update(now.q, now.dq);
            let weight = arm.gravity_torque();
            self.held.iter_mut().zip(weight).for_each(|(held, weight)| *held += weight);
        }
        match (0..self.every).all(|_| self.run.advance(Some(&self.held))) {
            true => Ok(()),
            false => Err("its next state would not be finite".into()),
        }
    }
}
