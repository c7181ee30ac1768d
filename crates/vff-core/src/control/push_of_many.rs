//! How hard many contacts with one obstacle push: as one does, however many there are (T192).
//!
//! A cloud of points has a contact with a link for each of its points. Their potentials are not added, or a surface would push
//! in proportion to how densely it was sampled, but joined by the norm U = (Σ U_k^8)^(1/8), whose gradient is a sum of their
//! forces with weights that do not jump: those of the nearest are near to 1, if they are few.

use crate::math::{Vector, in_space};
use crate::world::{Contact, Pair};

/// One contact's part in the push of its obstacle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Part<const D: usize> {
    /// U_k \[J\].
    pub potential: f64,
    /// Where it acts \[m\], and the force \[N\].
    pub point: Vector<D>,
    pub force: Vector<D>,
    /// The power that the obstacle puts in, and that damping takes out \[W\].
    pub powers: [f64; 2],
}

/// What the contacts so far come to.
#[derive(Debug, Clone)]
pub(super) struct PushOfMany<const D: usize> {
    pair: Option<Pair>,
    /// The largest U_k \[J\], and Σ (U_k / largest)⁸.
    most: f64,
    sum: f64,
    /// Σ (U_k / largest)⁷ of forces \[N\], of their moments about `origin` \[N·m\], and of powers \[W\].
    origin: Vector<D>,
    force: Vector<D>,
    moment: Vector<3>,
    powers: [f64; 2],
}

/// The push of all contacts of a body with an obstacle: a force at a point, and a moment \[N·m\].
#[derive(Debug, Clone, Copy)]
pub(super) struct Joined<const D: usize> {
    pub link: usize,
    pub part: Part<D>,
    pub moment: Vector<3>,
}

impl<const D: usize> PushOfMany<D> {
    /// Of no contact.
    pub fn new() -> Self {
        Self {
            pair: None,
            most: 0.0,
            sum: 0.0,
            origin: Vector::zeros(),
            force: Vector::zeros(),
            moment: Vector::zeros(),
            powers: [0.0; 2],
        }
    }

    /// Takes in another contact. Returns the push of those before, if they are of another pair.
    #[inline(never)]
    pub fn add(&mut self, contact: &Contact<D>, part: &Part<D>) -> Option<Joined<D>> {
        let done = if self.pair == Some(contact.pair()) { None } else { self.finish() };
        if self.pair.is_none() {
            *self = Self { pair: Some(contact.pair()), origin: part.point, ..Self::new() };
        }
        let Part { potential, point, force, powers } = part;
        if *potential > self.most {
            let scale = self.most / potential;
            let seventh = to_the_seventh(scale);
            self.most = *potential;
            self.sum *= seventh * scale;
            self.force *= seventh;
            self.moment *= seventh;
            self.powers.iter_mut().for_each(|power| *power *= seventh);
        } else if self.most <= 0.0 {
            return done; // Where the field ends.
        }
        let ratio = potential / self.most;
        let weight = to_the_seventh(ratio);
        self.sum += weight * ratio;
        let force = force * weight;
        self.force += force;
        self.moment += cross(&(point - self.origin), &force);
        self.powers.iter_mut().zip(powers).for_each(|(sum, power)| *sum += weight * power);
        done
    }

    /// The push of what has been taken in; none, if it is nothing. Forgets it.
    pub fn finish(&mut self) -> Option<Joined<D>> {
        let Self { pair, most, sum, origin, force, moment, powers } =
            std::mem::replace(self, Self::new());
        let link = pair?.link;
        // Sums are at least 1 but for rounding: the largest has its part in them.
        let root = eighth_root(sum);
        let share = root / sum;
        (sum > 0.0).then(|| Joined {
            link,
            part: Part {
                potential: most * root,
                point: origin,
                force: force * share,
                powers: powers.map(|power| power * share),
            },
            moment: moment * share,
        })
    }
}

/// The norm of these potentials \[J\], and each potential's part in it, as U_k / U.
pub(super) fn ratios(potentials: &[f64]) -> (f64, Vec<f64>) {
    let most = potentials.iter().copied().fold(0.0, f64::max);
    if most <= 0.0 {
        return (0.0, vec![0.0; potentials.len()]);
    }
    let eighth = |ratio: f64| to_the_seventh(ratio) * ratio;
    let sum: f64 = potentials.iter().map(|potential| eighth(potential / most)).sum();
    let norm = most * eighth_root(sum);
    (norm, potentials.iter().map(|potential| potential / norm).collect())
}

/// A force's weight in the sum, of its potential's ratio U_k / U.
pub(super) fn to_the_seventh(ratio: f64) -> f64 {
    let square = ratio * ratio;
    square * square * square * ratio
}

/// From the roots that are exact, so that it is the same on every processor.
fn eighth_root(sum: f64) -> f64 {
    sum.sqrt().sqrt().sqrt()
}

/// The moment of a force; in the plane it is about the axis that comes out of it.
fn cross<const D: usize>(arm: &Vector<D>, force: &Vector<D>) -> Vector<3> {
    in_space(arm).cross(&in_space(force))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::{Field, FieldKind};
    use crate::geometry::Body;
    use crate::math::{Capsule, Noise};
    use crate::world::CollisionQuery;
    use crate::world::space::{Obstacle, Shape, World};

    const FIELD: Field =
        Field { kind: FieldKind::Bounded, gain: 40.0, influence: 0.2, ..Field::OFF };

    fn cloud(points: Vec<[f64; 3]>) -> World {
        World::new(vec![Obstacle::of(Shape::Points { points, radius: 0.01 })])
    }

    /// The push on a link along z that was moved by so much, and turned by so much about x.
    fn push(world: &mut World, moved: Vector<3>, turned: f64) -> Joined<3> {
        let along = Vector::<3>::new(0.0, -turned.sin(), turned.cos()) * 0.4;
        let link = Capsule::new(moved, moved + along, 0.05);
        let mut all = PushOfMany::new();
        world.for_each_contact(
            [Body::new(0, link)],
            FIELD.influence,
            |_, _| {},
            |contact| {
                let response = FIELD.at(contact.distance);
                let force = contact.normal * response.force;
                let part = Part {
                    potential: response.potential,
                    point: contact.point,
                    force,
                    powers: [0.0; 2],
                };
                assert!(all.add(contact, &part).is_none(), "one pair");
            },
        );
        all.finish().expect("within reach")
    }

    /// A wall of points beside a link, of which all the length is equally near, pushes as one of its points does but for the
    /// eighth root of how many there are.
    #[test]
    fn a_denser_cloud_hardly_pushes_harder() {
        let of_wall = [(20, 0.02), (40, 0.01), (80, 0.005)].map(|(count, apart): (i32, f64)| {
            let at = |i: i32| apart * f64::from(i);
            let points = (-count / 2..=count / 2)
                .flat_map(|i| (0..=count).map(move |k| [0.15, at(i), at(k)]))
                .collect();
            push(&mut cloud(points), Vector::zeros(), 0.0).part.force.norm()
        });
        let alone =
            push(&mut cloud(vec![[0.15, 0.0, 0.2]]), Vector::zeros(), 0.0).part.force.norm();
        assert!((alone - FIELD.at(0.09).force).abs() < 1e-12);
        assert!((1.0..2.5).contains(&(of_wall[2] / alone)), "{alone} {of_wall:?}");
        for denser in of_wall.windows(2) {
            let more = denser[1] / denser[0];
            assert!((1.0..1.01 * 4f64.powf(0.125)).contains(&more), "{of_wall:?}");
        }
    }

    /// Force and moment are the derivatives of the potential, and nothing jumps where points come within the field.
    #[test]
    fn it_is_the_gradient_of_one_potential() {
        let mut noise = Noise::new(5, 0);
        for _ in 0..50 {
            let mut draw =
                || [0.12 + 0.05 * noise.draw(), 0.1 * noise.draw(), 0.2 + 0.15 * noise.draw()];
            let mut world = cloud((0..60).map(|_| draw()).collect());
            let here = push(&mut world, Vector::zeros(), 0.0);
            let h = 1e-6;
            for k in 0..3 {
                let step = Vector::<3>::from_fn(|i, _| if i == k { h } else { 0.0 });
                let [up, down] = [step, -step].map(|d| push(&mut world, d, 0.0).part.potential);
                let slope = (down - up) / (2.0 * h);
                assert!((slope - here.part.force[k]).abs() < 1e-4 * FIELD.gain, "{slope} {here:?}");
            }
            // About the origin, the end of the link.
            let moment = here.moment + here.part.point.cross(&here.part.force);
            let [up, down] =
                [h, -h].map(|turn| push(&mut world, Vector::zeros(), turn).part.potential);
            let slope = (down - up) / (2.0 * h);
            assert!((slope - moment.x).abs() < 1e-4 * FIELD.gain, "{slope} {moment}");
        }
    }

    /// Of one contact it is that, to the last bit, and of none nothing.
    #[test]
    fn one_contact_pushes_alone() {
        let mut noise = Noise::new(6, 0);
        let mut world = cloud(vec![[0.1, 0.02, 0.1]]);
        let mut found = None;
        let link = Capsule::new(Vector::zeros(), Vector::<3>::new(0.0, 0.0, 0.4), 0.05);
        world.for_each_contact(
            [Body::new(0, link)],
            1.0,
            |_, _| {},
            |contact| found = Some(*contact),
        );
        let contact = found.expect("near");
        assert!(PushOfMany::<3>::new().finish().is_none());
        for _ in 0..100 {
            let mut draw = || Vector::<3>::from_fn(|_, _| noise.draw());
            let (point, force) = (draw(), draw());
            let part = Part { potential: force.norm(), point, force, powers: [force.x, force.y] };
            let mut all = PushOfMany::new();
            assert!(all.add(&contact, &part).is_none());
            let Joined { link, part: alone, moment } = all.finish().expect("one");
            assert_eq!(
                (link, alone.point, alone.force, alone.powers),
                (0, point, force, part.powers)
            );
            assert_eq!((alone.potential, moment), (part.potential, Vector::zeros()));
        }
    }
}
