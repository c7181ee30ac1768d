//! The obstacles at later instants, as far as look-ahead asks for them.

use crate::interrupt;
use crate::math::Capsule;
use crate::world::{CollisionQuery, Contact};

/// What look-ahead asks of the surroundings. Unlike a [`CollisionQuery`] it can be a trait object, so that
/// look-ahead is compiled once, not once for each kind of surroundings.
pub trait Prediction<const D: usize> {
    /// How many obstacles there are.
    fn count(&self) -> usize;

    /// Adds to `found` the obstacles nearer than `reach` [m] to a link, each once.
    fn obstacles_near(&mut self, links: &[Capsule<D>], reach: f64, found: &mut Vec<usize>);

    /// The contact of a link with `obstacle`, predicted for `after` [s] from now at its present velocity.
    fn predicted_contact(
        &self,
        link: usize,
        capsule: &Capsule<D>,
        obstacle: usize,
        after: f64,
    ) -> Contact<D>;
}

impl<S: CollisionQuery<D>, const D: usize> Prediction<D> for S {
    fn count(&self) -> usize {
        self.obstacle_count()
    }

    fn obstacles_near(&mut self, links: &[Capsule<D>], reach: f64, found: &mut Vec<usize>) {
        self.for_each_contact(
            links.iter().copied(),
            reach,
            |_, _| {},
            |pair| {
                interrupt::spend(64 + found.len());
                if !found.contains(&pair.obstacle) {
                    found.push(pair.obstacle);
                }
            },
        );
    }

    fn predicted_contact(
        &self,
        link: usize,
        capsule: &Capsule<D>,
        obstacle: usize,
        after: f64,
    ) -> Contact<D> {
        self.contact_after(link, capsule, obstacle, after)
    }
}

/// Some of the obstacles, moved on for a while at their present velocities.
pub struct Later<'a, const D: usize> {
    /// All obstacles at present.
    pub surroundings: &'a dyn Prediction<D>,
    /// Those that are meant.
    pub obstacles: &'a [usize],
    /// How much later [s].
    pub after: f64,
}

impl<const D: usize> CollisionQuery<D> for Later<'_, D> {
    fn obstacle_count(&self) -> usize {
        self.obstacles.len()
    }

    fn for_each_contact(
        &mut self,
        links: impl IntoIterator<Item = Capsule<D>>,
        reach: f64,
        mut distance: impl FnMut(usize, f64),
        mut visit: impl FnMut(&Contact<D>),
    ) {
        for (i, link) in links.into_iter().enumerate() {
            interrupt::spend(64 * self.obstacles.len());
            let mut least = f64::INFINITY;
            for &j in self.obstacles {
                let contact = self.surroundings.predicted_contact(i, &link, j, self.after);
                least = least.min(contact.distance);
                if contact.distance < reach {
                    visit(&contact);
                }
            }
            distance(i, least);
        }
    }

    fn contact_after(&self, link: usize, capsule: &Capsule<D>, j: usize, after: f64) -> Contact<D> {
        self.surroundings.predicted_contact(link, capsule, j, self.after + after)
    }
}
