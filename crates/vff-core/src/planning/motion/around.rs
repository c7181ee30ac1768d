//! What is around an arm at the instants at which it is looked for.

use crate::interrupt;
use crate::math::{Vector, sort_by_first};
use crate::world::{HORIZON, ObstacleBoxes, ObstacleGeometry, World};
use std::ops::Range;

/// How far something that moves may go from one of the places at which it is looked for to the next \[m\].
const STRIDE: f64 = 0.04;
/// The most of these places.
const MAX_PLACES: f64 = 64.0;
/// Of what goes too far from one place to the next for these, so many obstacles have places of their own; if there are more, those go
/// together whose speeds differ by no more than this factor, or by its square, and so on, until there are no more groups.
const MOST_ALONE: usize = 16;
const ALIKE: f64 = 1.1;
/// From this slack on \[m\], rounding is no longer far below all that matters, and this share of it is added.
const FAR: f64 = 1e3;
const ROUNDING: f64 = 1e-9;
/// How long the parts of a course are at least \[s\], how many there are at most, and of how many bodies together; and in how many places
/// something is looked for in a part.
const PART: f64 = 0.05;
const MOST_PARTS: f64 = 200.0;
const MOST_TOGETHER: usize = 1 << 13;
const PLACES_OF_A_PART: f64 = 8.0;

/// From when to when things that move are looked for \[s\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window {
    /// The beginning.
    pub start: f64,
    /// How long, ≥ 0; 0 takes them for standing still. None: only what rests at the beginning is there.
    pub duration: Option<f64>,
    /// Whether each place counts only when it is passed, not throughout.
    pub in_time: bool,
}

/// Obstacles at an instant.
#[derive(Debug, Clone)]
pub struct Around<S: ObstacleGeometry<D>, const D: usize> {
    pub world: World<S, D>,
    pub boxes: ObstacleBoxes<D>,
    /// Their numbers, before they were parted.
    pub numbers: Vec<usize>,
    /// How far they go between two instants at which they are looked for, at most half of it \[m\]; ∞ where they are too far away for
    /// anybody to tell, so that they are in the way of everything.
    pub slack: f64,
}

impl<S: ObstacleGeometry<D>, const D: usize> Around<S, D> {
    /// All of `world`, with the numbers of its obstacles.
    pub fn new(world: World<S, D>, numbers: &[usize], slack: f64) -> Self {
        Self { boxes: world.boxes(), world, numbers: numbers.to_vec(), slack }
    }

    /// Obstacles of `world` that move, at the instants at which they are looked for from one time to another \[s\], in a ball around the arm.
    pub fn passing(
        world: &World<S, D>,
        moving: &[usize],
        times: [f64; 2],
        ball: (Vector<D>, f64),
    ) -> Vec<Self> {
        Self::in_places(world, moving, times, ball, MAX_PLACES)
    }

    /// The same, in so many places at most.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "at least 1, and few"
    )]
    fn in_places(
        world: &World<S, D>,
        moving: &[usize],
        [start, end]: [f64; 2],
        (center, radius): (Vector<D>, f64),
        most: f64,
    ) -> Vec<Self> {
        let duration = end - start;
        // Those that are looked for equally often go together, but for what goes too far from one place to the next.
        let mut groups: Vec<Group> = vec![];
        let mut fast: Vec<(f64, usize)> = vec![];
        for j in moving {
            interrupt::checkpoint(64);
            let speed = world.top_speed(*j, [start, end], center, radius);
            // What is not a number is as fast as can be.
            let speed = if speed.is_nan() { f64::INFINITY } else { speed };
            let places = (duration * speed / STRIDE).ceil().clamp(1.0, most);
            if places >= most {
                fast.push((speed, *j));
                continue;
            }
            let places = (places as u32).max(1); // of no time at an endless speed, too
            match groups.iter_mut().find(|group| group.places == places) {
                Some(group) => {
                    group.fastest = group.fastest.max(speed);
                    group.members.push(*j);
                }
                None => groups.push(Group { places, fastest: speed, members: vec![*j] }),
            }
        }
        groups.extend(Group::of_fast(fast, most));
        groups.sort_by_key(|group| group.members[0]);
        let mut all = vec![];
        for Group { places, fastest, members } in groups {
            let bodies: usize = members.iter().map(|j| world.bodies(*j)).sum();
            let alone = world.only(members.iter().copied());
            let stride = duration / f64::from(places);
            let slack = if duration > 0.0 { slack_of(0.5 * stride * fastest) } else { 0.0 };
            for k in 0..places {
                interrupt::checkpoint(256 * bodies);
                let mut there = alone.clone();
                there.update(start + stride * (f64::from(k) + 0.5));
                let is_known =
                    (0..there.len()).all(|j| there.position(j).iter().all(|x| x.abs() <= HORIZON));
                let slack = if is_known { slack } else { f64::INFINITY };
                all.push(Self::new(there, &members, slack));
            }
        }
        all
    }
}

/// The places that things pass, by when they do: parts of a time, and how they stand after it.
#[derive(Debug, Clone)]
pub struct Course<S: ObstacleGeometry<D>, const D: usize> {
    /// How long a part is, and all of them are \[s\].
    part: f64,
    pub duration: f64,
    parts: Vec<Vec<Around<S, D>>>,
    /// How many places each has, and which parts are taken out.
    sizes: Vec<usize>,
    taken: Range<usize>,
}

impl<S: ObstacleGeometry<D>, const D: usize> Course<S, D> {
    /// Of obstacles of `world` that move, from `start` on for some time \[s\], in a ball around the arm.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "at least 1, and few"
    )]
    pub fn new(
        world: &World<S, D>,
        moving: &[usize],
        [start, duration]: [f64; 2],
        ball: (Vector<D>, f64),
    ) -> Self {
        let bodies: usize = moving.iter().map(|j| world.bodies(*j)).sum();
        let most = (MOST_TOGETHER / bodies.max(1)).max(1);
        let count = ((duration / PART).ceil().clamp(1.0, MOST_PARTS) as u32).min(most as u32);
        let part = duration / f64::from(count);
        let at = |k: u32| start + part * f64::from(k);
        let last = [at(count); 2];
        let parts = (0..count).map(|k| [at(k), at(k + 1)]).chain([last]);
        let parts: Vec<_> = parts
            .map(|times| Around::in_places(world, moving, times, ball, PLACES_OF_A_PART))
            .collect();
        let sizes = parts.iter().map(Vec::len).collect();
        Self { part, duration, parts, sizes, taken: 0..0 }
    }

    /// Puts back what was taken out, which stands behind the first of `worlds`, and takes out what is passed between two times after the
    /// start \[s\]. Whether that is something else.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "clamped to the parts"
    )]
    pub fn take(&mut self, times: Option<[f64; 2]>, worlds: &mut Vec<Around<S, D>>) -> bool {
        let last = self.parts.len() - 1;
        let asked = times.map_or(0..0, |times| {
            let [from, to] = times.map(|t| ((t / self.part).max(0.0) as usize).min(last));
            from..to + 1
        });
        if asked == self.taken {
            return false;
        }
        let mut back = worlds.split_off(1).into_iter();
        for k in self.taken.clone() {
            self.parts[k].extend(back.by_ref().take(self.sizes[k]));
        }
        for part in &mut self.parts[asked.clone()] {
            worlds.append(part);
        }
        self.taken = asked;
        true
    }
}

/// Obstacles that are looked for at the same instants.
struct Group {
    /// How many these are.
    places: u32,
    /// What none of them exceeds \[m/s\].
    fastest: f64,
    members: Vec<usize>,
}

impl Group {
    /// Those that go too far from one place to the next, each with its speed \[m/s\]: each by itself where they are few, as what is
    /// added for the fastest of a group is too much for the others.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "few")]
    fn of_fast(mut fast: Vec<(f64, usize)>, most: f64) -> Vec<Self> {
        let new = |(speed, j)| Self { places: most as u32, fastest: speed, members: vec![j] };
        if fast.len() <= MOST_ALONE {
            return fast.into_iter().map(new).collect();
        }
        sort_by_first(&mut fast);
        let mut alike = ALIKE;
        loop {
            let mut groups: Vec<Self> = vec![];
            let mut slowest = 0.0;
            for (speed, j) in &fast {
                match groups.last_mut() {
                    Some(group) if *speed <= slowest * alike => {
                        group.fastest = *speed;
                        group.members.push(*j);
                    }
                    _ => {
                        slowest = *speed;
                        groups.push(new((*speed, *j)));
                    }
                }
            }
            if groups.len() <= MOST_ALONE {
                return groups;
            }
            alike *= alike;
        }
    }
}

/// What is looked around for obstacles that go so far at most between a place and an instant before or after it \[m\].
fn slack_of(way: f64) -> f64 {
    let slack = if way > FAR { way * (1.0 + ROUNDING) } else { way };
    if slack <= HORIZON { slack } else { f64::INFINITY } // what is not a number, too
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Body;
    use crate::math::{Capsule, Noise};
    use crate::world::Motion;
    use crate::world::plane::{Obstacle, Shape, World as PlanarWorld};

    /// What is taken out for some time is nearer than anything comes within that, and all of it is there again and again.
    #[test]
    fn a_part_is_what_passes_then() {
        let circle = |x: f64, velocity: [f64; 2]| Obstacle {
            position: [x, 1.0],
            motion: Motion::Linear { velocity },
            ..Obstacle::of(Shape::Circle { radius: 0.1 })
        };
        let mut world = PlanarWorld::new(vec![
            circle(0.0, [1.0, 0.3]),
            circle(2.0, [-3.0, 0.0]),
            circle(-1.0, [0.0, 40.0]),
        ]);
        let (start, duration) = (0.4, 1.7);
        let ball = (Vector::zeros(), 2.0);
        let mut course = Course::new(&world, &[0, 1, 2], [start, duration], ball);
        let mut worlds = vec![Around::new(PlanarWorld::new(vec![]), &[], 0.0)];
        let mut noise = Noise::new(5, 0);
        let mut clear = 0;
        for _ in 0..400 {
            let from = 2.2 * noise.share();
            let times = [from, from + 0.2 * noise.share()];
            course.take(Some(times), &mut worlds);
            assert!(!course.take(Some(times), &mut worlds));
            let link = Capsule {
                start: Vector::<2>::new(2.0 * noise.draw(), 2.0 * noise.draw()),
                direction: Vector::<2>::x(),
                length: 0.5,
                radius: 0.05,
            };
            let least = |world: &mut PlanarWorld| {
                let mut least = f64::INFINITY;
                world.for_each_pair([Body::new(0, link)], |pair| least = least.min(pair.distance));
                least
            };
            let told = worlds[1..].iter_mut().map(|it| least(&mut it.world) - it.slack);
            let told = told.fold(f64::INFINITY, f64::min);
            for step in 0..=20 {
                let t = times[0] + (times[1] - times[0]) * f64::from(step) / 20.0;
                world.update(start + t.min(duration));
                assert!(told <= least(&mut world) + 1e-12);
            }
            clear += usize::from(told > 0.0);
        }
        assert!(clear > 50, "{clear}");
        course.take(None, &mut worlds);
        assert_eq!(worlds.len(), 1);
        assert!(course.parts.iter().zip(&course.sizes).all(|(part, size)| part.len() == *size));
    }
}
