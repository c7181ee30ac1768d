//! Obstacles that are felt: the forces between them and the links that press into them (T148).

use super::wrench::Acting;
use crate::geometry::Body;
use crate::math::{Capsule, Vector};
use crate::robot::Robot;
use crate::settings::settings;
use crate::world::{CollisionQuery, Contact, ObstacleGeometry, World};

/// The speed below which friction is that of a viscous fluid \[m/s\].
const SLIP: f64 = 1e-3;
/// How near an obstacle has to be that may be met within a plant step \[m\].
const NEAR: f64 = 0.05;

settings! {
    /// `contact` of one of `[[obstacles]]`: how it resists.
    ///
    /// # Example
    /// ```
    /// use vff_core::simulation::ContactSettings;
    ///
    /// let felt: ContactSettings = toml::from_str("stiffness = 5000").unwrap();
    /// assert_eq!(felt, ContactSettings { stiffness: 5000.0, ..ContactSettings::default() });
    /// ```
    #[derive(Copy)]
    pub struct ContactSettings {
        /// 10 N sink in by 0.1 mm.
        stiffness: f64 = 1e5, "N/m", POSITIVE;
        /// A link that hits at the small speed v leaves at about v · (1 − ⅔ · damping · v).
        damping: f64 = 2.0, "s/m", NOT_NEGATIVE;
        /// Share of the pressure that holds it back along the surface (Coulomb); below 1 mm/s a link creeps.
        friction: f64 = 0.5, "", NOT_NEGATIVE;
        /// Whether the controller knows of it, with look-ahead, plans and sensors. What it does not know of is felt alone.
        seen: bool = true, "";
    }
}

impl ContactSettings {
    /// The force on a link that is `depth` \[m\] deep, along the normal, and what of it friction can take; `speed` is that at
    /// which it comes out \[m/s\].
    fn pressure(&self, depth: f64, speed: f64) -> f64 {
        self.stiffness * depth.max(0.0) * (1.0 - self.damping * speed).max(0.0)
    }

    /// The force on a link that moves at `velocity` relative to the obstacle \[N\].
    fn force<const D: usize>(
        &self,
        contact: &Contact<D>,
        velocity: &Vector<D>,
        share: f64,
    ) -> Vector<D> {
        let speed = contact.normal.dot(velocity);
        let pressure = share * self.pressure(-contact.distance, speed);
        let along = velocity - contact.normal * speed;
        contact.normal * pressure - along * (self.friction * pressure / along.norm().hypot(SLIP))
    }
}

/// Hides from whoever asks `world` what is not to be seen by these `settings` of its first obstacles.
pub fn hide_unseen<S: ObstacleGeometry<D>, const D: usize>(
    world: &mut World<S, D>,
    settings: &[Option<ContactSettings>],
) {
    for (j, settings) in settings.iter().enumerate() {
        if settings.is_some_and(|settings| !settings.seen) {
            world.hide(j);
        }
    }
}

/// The obstacles of a scenario, and the torque that those of them that are felt are for the joints. Nothing allocates but
/// what changes which there are.
#[derive(Debug, Clone)]
pub struct Contacts<R: Robot<D>, S: ObstacleGeometry<D>, const D: usize> {
    world: World<S, D>,
    /// How each obstacle resists, if it does.
    settings: Vec<Option<ContactSettings>>,
    /// Whether a plant elsewhere says what the forces are.
    is_told: bool,
    /// Where bodies with an axis are in contact.
    long: Vec<Contact<D>>,
    on_links: Vec<R::Wrench>,
    torque: Vec<f64>,
    total: Vec<f64>,
    /// The force of each obstacle, one coordinate after the other.
    forces: Vec<f64>,
}

impl<R: Robot<D>, S: ObstacleGeometry<D>, const D: usize> Contacts<R, S, D> {
    /// Those of `robot` in a world; none if no obstacle resists.
    pub fn new(
        world: &World<S, D>,
        settings: &[Option<ContactSettings>],
        robot: &R,
    ) -> Option<Self> {
        let n = robot.dof();
        let mut settings = settings.to_vec();
        settings.resize(world.len(), None);
        settings.iter().any(Option::is_some).then(|| Self {
            long: Vec::with_capacity(robot.body_count() * world.len()),
            forces: vec![0.0; D * world.len()],
            world: world.clone(),
            settings,
            is_told: false,
            on_links: vec![R::Wrench::default(); n],
            torque: vec![0.0; n],
            total: vec![0.0; n],
        })
    }

    /// Whether obstacle `j` does.
    pub fn resists(&self, j: usize) -> bool {
        self.settings.get(j).is_some_and(Option::is_some)
    }

    /// The obstacles, to be changed.
    pub fn world_mut(&mut self) -> &mut World<S, D> {
        &mut self.world
    }

    /// Of the obstacle that was added to the world last.
    pub fn add(&mut self, settings: Option<ContactSettings>) {
        self.settings.push(settings);
        self.forces.extend([0.0; D]);
    }

    /// Obstacle `j` was taken out of the world.
    pub fn remove(&mut self, j: usize) {
        self.settings.remove(j);
        self.forces.truncate(D * self.settings.len());
    }

    /// Obstacles move to time `t` \[s\].
    pub fn go_to(&mut self, t: f64) {
        self.world.update(t);
    }

    /// The force of each obstacle on the arm where that was when [`torque`](Self::torque) was asked for last \[N\], one
    /// coordinate after the other.
    pub fn forces(&self) -> &[f64] {
        &self.forces
    }

    /// Lets a plant elsewhere say what the forces are: none until it has [told](Self::tell).
    pub fn listen(&mut self) {
        self.is_told = true;
        self.torque.fill(0.0);
        self.forces.fill(0.0);
    }

    /// Takes in what a plant elsewhere says: the obstacle of each contact, and the force on a link of `robot`, where that is.
    pub fn tell(&mut self, robot: &R, told: impl Iterator<Item = (usize, Acting<D>)>) {
        let Self { on_links, torque, forces, .. } = self;
        on_links.fill(R::Wrench::default());
        forces.fill(0.0);
        for (obstacle, Acting { link, point, force, .. }) in told {
            robot.add_force(on_links, link, &point, &force);
            for (sum, part) in forces[D * obstacle..].iter_mut().zip(force.iter()) {
                *sum += part;
            }
        }
        robot.wrenches_tr_mul(on_links, torque);
    }

    /// The torque for the joints of `robot` where that is \[N·m, N\], (n).
    pub fn torque(&mut self, robot: &R) -> &[f64] {
        if self.is_told {
            return &self.torque;
        }
        let Self { world, settings, long, on_links, torque, forces, .. } = self;
        on_links.fill(R::Wrench::default());
        forces.fill(0.0);
        visit(world, settings, long, robot, 0.0, |contact, settings, share| {
            let Contact { link, witness, velocity, obstacle, .. } = contact;
            let velocity = robot.point_velocity(*link, witness) - velocity;
            let force = settings.force(contact, &velocity, share);
            robot.add_force(on_links, *link, witness, &force);
            for (sum, part) in forces[D * obstacle..].iter_mut().zip(force.iter()) {
                *sum += part;
            }
        });
        robot.wrenches_tr_mul(on_links, torque);
        torque
    }

    /// τ and this torque together \[N·m, N\], (n).
    pub fn add_to(&mut self, robot: &R, tau: &[f64]) -> &[f64] {
        self.torque(robot);
        let Self { torque, total, .. } = self;
        for ((total, tau), torque) in total.iter_mut().zip(tau).zip(&*torque) {
            *total = tau + torque;
        }
        total
    }

    /// No eigenvalue of what contacts make of the motion of `robot` within the next `dt` \[s\] is larger \[1/s\] (T147).
    pub fn rate(&mut self, robot: &R, dt: f64) -> f64 {
        if self.is_told {
            return 0.0;
        }
        let Self { world, settings, long, .. } = self;
        let mut sum = 0.0;
        visit(world, settings, long, robot, NEAR, |contact, settings, share| {
            let Contact { link, witness, normal, .. } = contact;
            let velocity = robot.point_velocity(*link, witness) - contact.velocity;
            let speed = normal.dot(&velocity);
            let depth = dt * velocity.norm() - contact.distance;
            if depth <= 0.0 {
                return;
            }
            let unit = |k| Vector::from_fn(|row, _| f64::from(u8::from(row == k)));
            let along = |k| robot.point_mobility(*link, witness, &unit(k));
            let mobility: f64 = (0..D).map(along).sum();
            let stiffness = share * settings.stiffness;
            let pressure = share * settings.pressure(depth, -speed.abs());
            let damping =
                stiffness * depth * settings.damping + settings.friction * pressure / SLIP;
            sum += damping * mobility + (stiffness * mobility).sqrt();
        });
        sum
    }
}

/// Calls `act` with every contact nearer than `reach` \[m\] with an obstacle that resists, and the share of its stiffness that
/// resists there.
///
/// Of a body with an axis the ends count beside the nearest point, each by how far along the axis it is from that. So the
/// force does not jump where the nearest point goes from one end to the other, and a link that lies on a face has two feet.
fn visit<R: Robot<D>, S: ObstacleGeometry<D>, const D: usize>(
    world: &mut World<S, D>,
    settings: &[Option<ContactSettings>],
    long: &mut Vec<Contact<D>>,
    robot: &R,
    reach: f64,
    mut act: impl FnMut(&Contact<D>, &ContactSettings, f64),
) {
    long.clear();
    world.for_each_contact(
        robot.bodies(),
        reach,
        |_, _| {},
        |contact| {
            if let Some(settings) = &settings[contact.obstacle] {
                act(contact, settings, 1.0);
                long.push(*contact);
            }
        },
    );
    for nearest in long.iter() {
        let Contact { body: index, obstacle: j, .. } = *nearest;
        let Body { link, shape, hull, .. } = robot.body(index);
        let Some(settings) = settings[j].as_ref().filter(|_| hull.is_none() && world.is_convex(j))
        else {
            continue;
        };
        let Capsule { start, direction, length, .. } = shape;
        if length <= 0.0 {
            continue;
        }
        let passed = (nearest.point - start).dot(&direction) / length;
        for (end, share) in [(start, passed), (start + direction * length, 1.0 - passed)] {
            let share = share.clamp(0.0, 1.0);
            let foot = Body::new(link, Capsule { start: end, length: 0.0, ..shape });
            let contact = world.contact(index, &foot, j);
            if share > 0.0 && contact.distance < reach {
                act(&contact, settings, share);
            }
        }
    }
}
