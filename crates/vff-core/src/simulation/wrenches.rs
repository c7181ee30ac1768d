//! All that pushes and pulls the plant from outside, τ_ext = Σ Jᵀw (T143).

use super::pull::Spring;
use super::wrench::{Acting, Placed, Wrench};
use crate::robot::{Model, Robot};

/// All wrenches on an arm, and the torque that they are for its joints. Nothing allocates but [`add`](Self::add).
#[derive(Debug, Clone)]
pub struct Wrenches<R: Robot<D>, const D: usize> {
    all: Vec<Placed<D>>,
    /// How many of them are the scenario's; those after them push while it runs.
    given: usize,
    /// The share of each that acts in the present step.
    shares: Vec<f64>,
    /// What somebody pulls with, if anybody does.
    pull: Option<Spring<D>>,
    on_links: Vec<R::Wrench>,
    torque: Vec<f64>,
    total: Vec<f64>,
}

impl<R: Robot<D>, const D: usize> Wrenches<R, D> {
    /// Those of a scenario on an arm, which has a link for each.
    ///
    /// # Errors
    /// With the index of the first whose link the arm does not have, and the names of those that it has.
    pub fn new(given: &[Wrench<D>], arm: &impl Model<D>) -> Result<Self, (usize, Vec<String>)> {
        let n = arm.dof();
        let mut this = Self {
            all: vec![],
            given: given.len(),
            shares: vec![],
            pull: None,
            on_links: vec![R::Wrench::default(); n],
            torque: vec![0.0; n],
            total: vec![0.0; n],
        };
        for (i, wrench) in given.iter().enumerate() {
            this.add(wrench.clone(), arm).map_err(|known| (i, known))?;
        }
        Ok(this)
    }

    /// One more.
    ///
    /// # Errors
    /// If the arm has no such link: with the names of those that it has.
    pub fn add(&mut self, wrench: Wrench<D>, arm: &impl Model<D>) -> Result<(), Vec<String>> {
        self.all.push(Placed::new(wrench, arm)?);
        self.shares.push(0.0);
        Ok(())
    }

    /// Whether there is none, and nobody pulls.
    pub fn is_empty(&self) -> bool {
        self.all.is_empty() && self.pull.is_none()
    }

    /// Lets somebody pull from now on, or let go.
    pub fn pull(&mut self, spring: Option<Spring<D>>) {
        self.pull = spring;
    }

    /// What somebody pulls with.
    pub fn pulled(&self) -> Option<&Spring<D>> {
        self.pull.as_ref()
    }

    /// The same, to be moved.
    pub fn pulled_mut(&mut self) -> Option<&mut Spring<D>> {
        self.pull.as_mut()
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.all.len()
    }

    /// Forgets those that were added and are over at `t` \[s\].
    pub fn forget_past(&mut self, t: f64) {
        let mut i = 0;
        let given = self.given;
        self.all.retain(|placed| {
            i += 1;
            i <= given || placed.wrench.start + placed.wrench.length() > t
        });
        self.shares.truncate(self.all.len());
    }

    /// Forgets those that were added; nobody pulls any more.
    pub fn forget_added(&mut self) {
        self.pull = None;
        self.all.truncate(self.given);
        self.shares.truncate(self.given);
    }

    /// From now on what acts is that of time `t` \[s\].
    pub fn go_to(&mut self, t: f64) {
        for (share, placed) in self.shares.iter_mut().zip(&self.all) {
            *share = placed.wrench.share(t);
        }
    }

    /// Those of the scenario and those that were added, as they are where `robot` is.
    pub fn acting<'a>(&'a self, robot: &'a R) -> impl Iterator<Item = Acting<D>> + 'a {
        self.all.iter().zip(&self.shares).map(|(placed, share)| placed.acting(robot, *share))
    }

    /// τ_ext where `robot` is \[N·m, N\], (n).
    pub fn torque(&mut self, robot: &R) -> &[f64] {
        let Self { all, shares, pull, on_links, torque, .. } = self;
        on_links.fill(R::Wrench::default());
        if let Some(spring) = pull {
            let Acting { link, point, force, .. } = spring.acting(robot);
            robot.add_force(on_links, link, &point, &force);
        }
        for (placed, share) in all.iter().zip(&*shares).filter(|(_, share)| **share != 0.0) {
            let Acting { link, point, force, torque } = placed.acting(robot, *share);
            robot.add_force(on_links, link, &point, &force);
            robot.add_torque(on_links, link, &torque);
        }
        robot.wrenches_tr_mul(on_links, torque);
        torque
    }

    /// τ + τ_ext where `robot` is \[N·m, N\], (n).
    pub fn add_to(&mut self, robot: &R, tau: &[f64]) -> &[f64] {
        self.torque(robot);
        let Self { torque, total, .. } = self;
        for ((total, tau), torque) in total.iter_mut().zip(tau).zip(&*torque) {
            *total = tau + torque;
        }
        total
    }
}
