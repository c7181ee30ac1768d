//! How far bodies are from what is nearest, where it is nearer than a limit: boxes around obstacles tell that most are not.

use super::broad_phase::{box_of, widened};
use super::{Carrier, ObstacleGeometry, Pair, PairMargin, Placed, World};
use crate::geometry::Body;
use crate::math::{Capsule, Vector};

/// Boxes around the obstacles of a world, where they were when it was asked for them.
///
/// # Example
/// ```
/// use vff_core::geometry::Body;
/// use vff_core::math::{Capsule, Vector};
/// use vff_core::world::ObstacleBoxes;
/// use vff_core::world::plane::{Obstacle, World};
///
/// let disc = r#"position = [2.0, 0.0]
/// shape = { circle = { radius = 0.5 } }"#;
/// let mut world = World::new(vec![toml::from_str::<Obstacle>(disc).unwrap()]);
/// let boxes: ObstacleBoxes<2> = world.boxes();
/// let link = Capsule::new(Vector::<2>::zeros(), Vector::<2>::new(1.0, 0.0), 0.1);
/// assert!((world.distance_within(&boxes, &Body::new(0, link), 1.0) - 0.4).abs() < 1e-12);
/// assert_eq!(world.distance_within(&boxes, &Body::new(0, link), 0.1), f64::INFINITY);
/// ```
#[derive(Debug, Clone)]
pub struct ObstacleBoxes<const D: usize>(Vec<[Vector<D>; 2]>);

impl<S: ObstacleGeometry<D>, const D: usize> World<S, D> {
    /// Boxes around all obstacles where the last [`update`](Self::update) put them. Allocates.
    pub fn boxes(&self) -> ObstacleBoxes<D> {
        ObstacleBoxes(
            self.obstacles.iter().map(|obstacle| box_of(obstacle, [self.time; 2])).collect(),
        )
    }

    /// What `body` keeps from obstacle `j`.
    pub fn margin_of(&self, j: usize, body: &Body<'_, D>) -> PairMargin {
        self.obstacles[j].margin_of(Carrier::of(body))
    }

    /// Calls `visit` with every margin of its own that `body` keeps from something, and how far it is from that \[m\]: of pairs that
    /// are measured against each other.
    pub fn for_each_own_margin(&self, body: &Body<'_, D>, mut visit: impl FnMut(PairMargin, f64)) {
        let carrier = Carrier::of(body);
        for j in 0..self.obstacles.len() {
            let obstacle = &self.obstacles[j];
            let margin = obstacle.margin_of(carrier);
            if margin.is_own() && !obstacle.is_hidden && !obstacle.is_ignored_by(carrier) {
                visit(margin, self.contact(0, body, j).distance);
            }
        }
    }

    /// The distance of `body` from what is nearest and not hidden \[m\], if it is less than `limit`; otherwise ∞. NaN for a body that is nowhere.
    ///
    /// # Arguments
    /// * `boxes`: those of this world since its last update.
    pub fn distance_within(
        &mut self,
        boxes: &ObstacleBoxes<D>,
        body: &Body<'_, D>,
        limit: f64,
    ) -> f64 {
        self.distance_of_those(boxes, body, limit, |_| true)
    }

    /// The same from what it keeps the usual margin from alone.
    pub fn usual_distance_within(
        &mut self,
        boxes: &ObstacleBoxes<D>,
        body: &Body<'_, D>,
        limit: f64,
    ) -> f64 {
        let carrier = Carrier::of(body);
        self.distance_of_those(boxes, body, limit, |it| !it.margin_of(carrier).is_own())
    }

    fn distance_of_those(
        &mut self,
        boxes: &ObstacleBoxes<D>,
        body: &Body<'_, D>,
        limit: f64,
        is_meant: impl Fn(&Placed<S, D>) -> bool,
    ) -> f64 {
        let probe = S::probe(&body.shape);
        let mut least = f64::INFINITY;
        self.for_each_within(boxes, body, limit, |world, j| {
            let bound = least.min(limit);
            let obstacle = &mut world.obstacles[j];
            if !is_meant(obstacle) {
                return bound;
            }
            obstacle.move_to(world.time);
            let distance = match &body.hull {
                None => obstacle.distance_below(&probe, bound),
                // A plane between them tells for less work that it is not nearer.
                Some(hull)
                    if obstacle.at_least(Some(hull), &probe, bound, &mut Vector::zeros())
                        >= bound =>
                {
                    return bound;
                }
                Some(hull) => {
                    let pair = Pair::default();
                    let (state, turn) = (&obstacle.state, obstacle.turn());
                    obstacle.hull_contact(pair, hull, &probe, state, turn).distance
                }
            };
            if distance >= bound {
                return bound;
            }
            least = distance;
            if least.is_nan() { f64::NEG_INFINITY } else { least.min(limit) }
        });
        least
    }

    /// Calls `visit` with the number of every obstacle that is measured against the body and whose box comes within `limit` \[m\] of the body's;
    /// it returns the limit from then on, −∞ for no more.
    ///
    /// # Arguments
    /// * `boxes`: those of this world since its last update.
    pub(crate) fn for_each_within(
        &mut self,
        boxes: &ObstacleBoxes<D>,
        body: &Body<'_, D>,
        mut limit: f64,
        mut visit: impl FnMut(&mut Self, usize) -> f64,
    ) {
        let [low, high] = box_around(&body.shape);
        for (j, [rear, front]) in boxes.0.iter().enumerate() {
            let obstacle = &self.obstacles[j];
            if obstacle.is_hidden || obstacle.is_ignored_by(Carrier::of(body)) {
                continue;
            }
            let gap = (rear - high).sup(&(low - front)).map(|gap| gap.max(0.0));
            // False where it is undefined.
            if limit <= 0.0 && gap.amax() > 0.0
                || limit > 0.0 && gap.norm_squared() >= limit * limit
            {
                continue;
            }
            limit = visit(self, j);
            if limit == f64::NEG_INFINITY {
                return;
            }
        }
    }

    /// How far `body` is from obstacle `j` at least \[m\]; see [`ObstacleGeometry::at_least`]. What it leaves in `plane` makes it faster
    /// the next time, for the same two and near by.
    ///
    /// # Example
    /// ```
    /// use vff_core::geometry::Body;
    /// use vff_core::math::{Capsule, Vector};
    /// use vff_core::world::plane::{Obstacle, World};
    ///
    /// let disc = r#"position = [2.0, 0.0]
    /// shape = { circle = { radius = 0.5 } }"#;
    /// let mut world = World::new(vec![toml::from_str::<Obstacle>(disc).unwrap()]);
    /// let link = Capsule::new(Vector::<2>::zeros(), Vector::<2>::new(1.0, 0.0), 0.1);
    /// let plane = &mut Vector::<2>::zeros();
    /// let distance = world.at_least(0, &Body::new(0, link), f64::INFINITY, plane);
    /// assert!((distance - 0.4).abs() < 1e-12);
    /// assert!(world.at_least(0, &Body::new(0, link), 0.1, plane) >= 0.1);
    /// ```
    ///
    /// # Panics
    /// If `j` is not less than [`World::len`].
    pub fn at_least(
        &mut self,
        j: usize,
        body: &Body<'_, D>,
        limit: f64,
        plane: &mut Vector<D>,
    ) -> f64 {
        let obstacle = &mut self.obstacles[j];
        obstacle.move_to(self.time);
        obstacle.at_least(body.hull.as_ref(), &S::probe(&body.shape), limit, plane)
    }
}

/// A box that holds a capsule, roundings included.
fn box_around<const D: usize>(capsule: &Capsule<D>) -> [Vector<D>; 2] {
    let (start, end) = (capsule.start, capsule.end());
    let radius = Vector::repeat(capsule.radius);
    let size = start.amax() + end.amax() + capsule.radius + 1.0;
    widened([start.inf(&end) - radius, start.sup(&end) + radius], size)
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::space::{Obstacle, World, oracle::any_obstacle};
    use super::*;
    use crate::geometry::cases::any_link;
    use proptest::prelude::*;

    /// Asking all of them says the same, to the last bit.
    pub fn is_what_asking_all_says(obstacles: &[Obstacle], body: &Body<'_, 3>, limit: f64) {
        let mut world = World::new(obstacles.to_vec());
        let asked = (0..world.len()).map(|j| world.contact(0, body, j).distance);
        let least = asked.fold(f64::INFINITY, f64::min);
        let boxes = world.boxes();
        let found = world.distance_within(&boxes, body, limit);
        let expected = if least < limit { least } else { f64::INFINITY };
        assert_eq!(
            (found + 0.0).to_bits(),
            (expected + 0.0).to_bits(),
            "{found} is not {expected}"
        );
    }

    properties! {
        #[test]
        fn what_is_far_is_not_measured_and_nothing_is_missed(
            obstacles in prop::collection::vec(any_obstacle(), 0..8),
            link in any_link(),
            limit in prop_oneof![-0.5..2.0, Just(f64::INFINITY), Just(f64::NEG_INFINITY)],
        ) {
            is_what_asking_all_says(&obstacles, &Body::new(0, link), limit);
        }
    }
}
