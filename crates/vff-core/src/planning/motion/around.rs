//! What is around an arm at the instants at which it is looked for.

use crate::math::Vector;
use crate::world::{ObstacleBoxes, ObstacleGeometry, World};

/// How far something that moves may go from one of the places at which it is looked for to the next \[m\].
const STRIDE: f64 = 0.04;
/// The most of these places.
const MAX_PLACES: f64 = 64.0;

/// From when to when things that move are looked for \[s\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window {
    /// The beginning.
    pub start: f64,
    /// How long, ≥ 0; 0 takes them for standing still. None: only what rests at the beginning is there.
    pub duration: Option<f64>,
}

/// Obstacles at an instant.
#[derive(Debug, Clone)]
pub struct Around<S: ObstacleGeometry<D>, const D: usize> {
    pub world: World<S, D>,
    pub boxes: ObstacleBoxes<D>,
    /// Their numbers, before they were parted.
    pub numbers: Vec<usize>,
    /// How far they go between two instants at which they are looked for, at most half of it \[m\].
    pub slack: f64,
}

impl<S: ObstacleGeometry<D>, const D: usize> Around<S, D> {
    /// All of `world`, with the numbers of its obstacles.
    pub fn new(world: World<S, D>, numbers: &[usize], slack: f64) -> Self {
        Self { boxes: world.boxes(), world, numbers: numbers.to_vec(), slack }
    }

    /// Obstacles of `world` that move, at the instants at which they are looked for from one time to another \[s\], in a ball around the arm.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "at least 1, and few"
    )]
    pub fn passing(
        world: &World<S, D>,
        moving: &[usize],
        [start, end]: [f64; 2],
        (center, radius): (Vector<D>, f64),
    ) -> Vec<Self> {
        let duration = end - start;
        // Those that are looked for equally often go together, but for what goes too far from one place to the next.
        let mut groups: Vec<(u32, f64, Vec<usize>)> = vec![];
        for j in moving {
            let speed = world.top_speed(*j, [start, end], center, radius);
            let places = (duration * speed / STRIDE).ceil().clamp(1.0, MAX_PLACES) as u32;
            match groups
                .iter_mut()
                .find(|group| group.0 == places && f64::from(places) < MAX_PLACES)
            {
                Some((_, fastest, group)) => {
                    *fastest = fastest.max(speed);
                    group.push(*j);
                }
                None => groups.push((places, speed, vec![*j])),
            }
        }
        let places = groups.into_iter().flat_map(|(places, speed, group)| {
            let stride = duration / f64::from(places);
            (0..places).map(move |k| {
                let mut there = world.only(group.iter().copied());
                there.update(start + stride * (f64::from(k) + 0.5));
                Self::new(there, &group, 0.5 * stride * speed)
            })
        });
        places.collect()
    }
}
