//! From points to the corners, edges and faces of their hull.
//!
//! parry says which triangles the hull consists of. What lies in one plane is made one face here: a diagonal across the
//! side of a box is no edge, and a point in the middle of it no corner.

use super::enclosing::{distribution, extent};
use super::farthest::Farthest;
use super::{Corner, Edge, Face, Facing, Hull};
use crate::interrupt;
use crate::math::{Capsule, UnitQuaternion, Vector};
use nalgebra::Matrix3;
use parry3d_f64::math::Vector as Vec3;
use parry3d_f64::transformation::try_convex_hull;
use std::collections::{BTreeSet, HashMap};
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

/// The most corners of a hull: every corner and every edge is a row of `cbf`.
pub const MAX_CORNERS: usize = 64;

/// The most points that a hull is made of.
pub const MAX_POINTS: usize = 10_000;

/// Hulls of few points that were made before: an arm is checked, built and read again for every plan and run.
static MADE: LazyLock<Mutex<HashMap<Vec<[u64; 3]>, Made>>> = LazyLock::new(Mutex::default);
const MOST_MADE: usize = 256;

/// A hull, and a capsule around it if that was asked for.
struct Made {
    hull: Hull,
    around: Option<Capsule<3>>,
    /// And as it was turned last.
    turned: Option<(UnitQuaternion, Hull)>,
}

const _: () = assert!(2 * MAX_CORNERS - 4 <= Facing::BITS as usize);

/// What is thinner than this, relative to its size, has no inside.
const THINNEST: f64 = 1e-6;

/// Triangles count as one face where no corner is further from its plane than this, relative to the size of the hull.
const FLAT: f64 = 1e-12;

/// How often points are turned before they are given up.
const ATTEMPTS: u8 = 6;

/// Why points have no hull that obstacles can be made of.
///
/// # Example
/// ```
/// use vff_core::geometry::{HullError, check_hull};
///
/// assert_eq!(check_hull(&[[0.0; 3]]), Err(HullError::TooFew(1)));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum HullError {
    /// Points that coincide count once.
    #[error("4 or more different points, not {0}")]
    TooFew(usize),
    /// Of that many points.
    #[error("at most {MAX_POINTS} points, not {0}")]
    TooMany(usize),
    /// All in one plane, or nearly so.
    #[error("points that do not lie in one plane, not a hull that is {0:e} m thick")]
    Flat(f64),
    /// Of that many corners.
    #[error(
        "points whose hull has at most {MAX_CORNERS} corners, not {0}: take fewer, or several obstacles"
    )]
    TooManyCorners(usize),
    /// Rounding makes it impossible to say which of them are corners.
    #[error(
        "points of which it can be told which are corners of their hull: round them, or take fewer"
    )]
    Undecided,
}

/// Whether points have a hull that obstacles can be made of.
///
/// # Errors
/// If not, why.
pub fn check_hull(points: &[[f64; 3]]) -> Result<(), HullError> {
    Hull::new(points).map(drop)
}

/// The faces of the hull of points, each as the numbers of its corners, counter-clockwise from outside.
///
/// # Errors
/// As [`check_hull`].
pub fn faces_of_hull(points: &[[f64; 3]]) -> Result<Vec<Vec<usize>>, HullError> {
    let hull = Hull::new(points)?;
    let number = |corner: usize| {
        let here = hull.corners[corner].point;
        points.iter().position(|p| Vector::from(*p) == here)
    };
    let ring = |face: &Face<3>| {
        // Along the border so that the face lies to the left.
        let after: HashMap<usize, usize> = (face.border.iter())
            .map(|&(edge, side)| {
                let Edge { line, ends: [a, b], into, .. } = &hull.edges[edge];
                let is_left = face.normal.cross(&line.direction).dot(&into[side]) > 0.0;
                if is_left { (*a, *b) } else { (*b, *a) }
            })
            .collect();
        let first = after.keys().min().copied();
        let ring = std::iter::successors(first, |at| {
            after.get(at).copied().filter(|to| Some(*to) != first)
        });
        ring.take(after.len()).map(number).collect::<Option<Vec<usize>>>()
    };
    hull.faces.iter().map(|face| ring(face).ok_or(HullError::Undecided)).collect()
}

impl Hull {
    /// The hull of these points.
    ///
    /// # Errors
    /// If they lie in one plane, if it has too many corners, or if there are too many of them.
    pub fn new(points: &[[f64; 3]]) -> Result<Self, HullError> {
        Self::made(points, |made| made.hull.clone())
    }

    /// The hull of these points, turned about the origin.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub(crate) fn new_turned(points: &[[f64; 3]], by: &UnitQuaternion) -> Result<Self, HullError> {
        Self::made(points, |Made { hull, turned, .. }| match &*turned {
            _ if *by == UnitQuaternion::IDENTITY => hull.clone(),
            Some((known, turned)) if known == by => turned.clone(),
            _ => turned.insert((*by, hull.turned(by))).1.clone(),
        })
    }

    /// The hull of these points and its [capsule](Self::enclosing).
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub(crate) fn with_capsule(points: &[[f64; 3]]) -> Result<(Self, Capsule<3>), HullError> {
        Self::made(points, |Made { hull, around, .. }| {
            (hull.clone(), *around.get_or_insert_with(|| hull.enclosing()))
        })
    }

    fn made<T>(points: &[[f64; 3]], take: impl FnOnce(&mut Made) -> T) -> Result<T, HullError> {
        if points.len() > MAX_POINTS {
            return Err(HullError::TooMany(points.len()));
        }
        let new = || Ok(Made { hull: Self::of_points(points)?, around: None, turned: None });
        if points.len() > MAX_CORNERS {
            return Ok(take(&mut new()?));
        }
        let key: Vec<[u64; 3]> = points.iter().map(|p| p.map(f64::to_bits)).collect();
        let all = || MADE.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = all().get_mut(&key) {
            return Ok(take(known));
        }
        let made = new()?;
        let mut all = all();
        if all.len() >= MOST_MADE {
            all.clear();
        }
        Ok(take(all.entry(key).or_insert(made)))
    }

    fn of_points(points: &[[f64; 3]]) -> Result<Self, HullError> {
        interrupt::checkpoint(128 * points.len() * points.len());
        let points = distinct(points);
        if points.len() < 4 {
            return Err(HullError::TooFew(points.len()));
        }
        let scaled = Scaled::new(&points);
        let thinnest = scaled.extents.min();
        if thinnest.is_nan() || thinnest <= THINNEST {
            return Err(HullError::Flat(thinnest * scaled.size));
        }
        // Where rounding leaves it undecided which of the points in one plane are corners, it falls out otherwise when they
        // are turned.
        let attempt = |k: u8| {
            let turn = UnitQuaternion::exp(&(Vector::<3>::new(0.3, -0.5, 0.7) * f64::from(k)));
            let triangles = scaled.triangles(&turn.matrix())?;
            Faces::new(&scaled.points, &triangles)?.hull(&points, scaled.size)
        };
        (1..ATTEMPTS).fold(attempt(0), |found, k| match found {
            Err(HullError::Undecided) => attempt(k),
            found => found,
        })
    }
}

/// Each of the points that are numbers, once.
fn distinct(points: &[[f64; 3]]) -> Vec<Vector<3>> {
    let points = points.iter().map(|p| Vector::from(*p));
    // Adding 0 turns −0 into 0.
    let mut points: Vec<_> =
        points.filter(|p| p.sum().is_finite()).map(|p| p.add_scalar(0.0)).collect();
    let order = |a: &Vector<3>, b: &Vector<3>| {
        (0..3)
            .map(|k| a[k].total_cmp(&b[k]))
            .find(|o| o.is_ne())
            .unwrap_or(std::cmp::Ordering::Equal)
    };
    points.sort_by(order);
    points.dedup_by(|a, b| order(a, b).is_eq());
    points
}

/// Points about their middle, of size 1.
struct Scaled {
    points: Vec<Vector<3>>,
    /// The longest of their extents \[m\].
    size: f64,
    /// The axes of their distribution as columns.
    axes: Matrix3<f64>,
    /// How far they reach along these.
    extents: Vector<3>,
}

impl Scaled {
    fn new(points: &[Vector<3>]) -> Self {
        let first = points[0];
        let [low, high] = extent(points);
        let size = (high - low).max();
        let points: Vec<_> = points.iter().map(|p| (p - first) / size).collect();
        let (mean, axes) = distribution(&points);
        let along: Vec<_> = points.iter().map(|p| axes.tr_mul(&(p - mean))).collect();
        let [low, high] = extent(&along);
        Self { points, size, axes, extents: high - low }
    }

    /// The triangles of the hull as numbers of points, counter-clockwise from outside. What is a corner does not change when
    /// the points are stretched, which they are because parry takes for flat what is thinner than a thousandth, or then
    /// turned.
    fn triangles(&self, turn: &Matrix3<f64>) -> Result<Vec<[usize; 3]>, HullError> {
        let stretched = |p: &Vector<3>| {
            let along = turn * self.axes.tr_mul(p).component_div(&self.extents);
            Vec3::new(along.x, along.y, along.z)
        };
        let points: Vec<Vec3> = self.points.iter().map(stretched).collect();
        let key = |p: &Vec3| [p.x, p.y, p.z].map(f64::to_bits);
        let numbers: HashMap<_, _> = points.iter().enumerate().map(|(i, p)| (key(p), i)).collect();
        let (corners, triangles) = try_convex_hull(&points).map_err(|_| HullError::Undecided)?;
        let number = |i: u32| {
            corners
                .get(i as usize)
                .and_then(|p| numbers.get(&key(p)))
                .copied()
                .ok_or(HullError::Undecided)
        };
        // A stretched frame may be left-handed.
        let mirrored = self.axes.determinant() < 0.0;
        triangles
            .into_iter()
            .map(|[a, b, c]| {
                let [a, b, c] = [number(a)?, number(b)?, number(c)?];
                Ok(if mirrored { [a, c, b] } else { [a, b, c] })
            })
            .collect()
    }
}

/// Triangles grouped by the planes that they lie in.
struct Faces<'a> {
    points: &'a [Vector<3>],
    normals: Vec<Vector<3>>,
    /// The faces that meet in each point.
    contact: Vec<BTreeSet<usize>>,
    /// The pairs of faces that have a side of a triangle in common.
    neighbours: BTreeSet<[usize; 2]>,
}

impl<'a> Faces<'a> {
    fn new(points: &'a [Vector<3>], triangles: &[[usize; 3]]) -> Result<Self, HullError> {
        let area =
            |&[a, b, c]: &[usize; 3]| (points[b] - points[a]).cross(&(points[c] - points[a]));
        let areas: Vec<Vector<3>> = triangles.iter().map(area).collect();
        let sides = |i: usize| {
            let [a, b, c] = triangles[i];
            [[a, b], [b, c], [c, a]]
        };
        let mut owner = HashMap::new();
        for i in 0..triangles.len() {
            for side in sides(i) {
                owner.insert(side, i);
            }
        }
        let across = |[a, b]: [usize; 2]| owner.get(&[b, a]).copied().ok_or(HullError::Undecided);

        // The largest first: its plane is known best.
        let mut order: Vec<usize> = (0..triangles.len()).collect();
        order.sort_by(|&i, &j| areas[j].norm().total_cmp(&areas[i].norm()));
        let mut face_of = vec![None; triangles.len()];
        let mut normals = vec![];
        for seed in order {
            if face_of[seed].is_some() {
                continue;
            }
            let face = normals.len();
            let (normal, anchor) = (areas[seed].normalize(), points[triangles[seed][0]]);
            let level = |i: usize| {
                triangles[i].iter().all(|&p| normal.dot(&(points[p] - anchor)).abs() <= FLAT)
            };
            let (mut sum, mut open) = (Vector::zeros(), vec![seed]);
            face_of[seed] = Some(face);
            while let Some(i) = open.pop() {
                sum += areas[i];
                for side in sides(i) {
                    let next = across(side)?;
                    if face_of[next].is_none() && level(next) {
                        face_of[next] = Some(face);
                        open.push(next);
                    }
                }
            }
            normals.push(sum.normalize());
        }

        let face_of =
            |i: usize| face_of[i].expect("every triangle has been a seed or been reached");
        let mut contact = vec![BTreeSet::new(); points.len()];
        let mut neighbours = BTreeSet::new();
        for i in 0..triangles.len() {
            for side in sides(i) {
                let [one, other] = [face_of(i), face_of(across(side)?)];
                contact[side[0]].insert(one);
                if one != other {
                    neighbours.insert([one.min(other), one.max(other)]);
                }
            }
        }
        Ok(Self { points, normals, contact, neighbours })
    }

    /// With the points as they were given, which have this size \[m\].
    fn hull(&self, given: &[Vector<3>], size: f64) -> Result<Hull, HullError> {
        let is_corner = |p: &usize| self.contact[*p].len() > 2;
        let numbers: Vec<usize> = (0..given.len()).filter(is_corner).collect();
        if numbers.len() > MAX_CORNERS {
            return Err(HullError::TooManyCorners(numbers.len()));
        }
        // The corners of each face.
        let mut around = vec![vec![]; self.normals.len()];
        for (c, &p) in numbers.iter().enumerate() {
            self.contact[p].iter().for_each(|face| around[*face].push(c));
        }
        let mut corners: Vec<Corner<3>> =
            numbers.iter().map(|&p| Corner { point: given[p], along: vec![] }).collect();
        let mut faces: Vec<Face<3>> = (self.normals.iter().enumerate())
            .map(|(i, normal)| {
                let heights = around[i].iter().map(|&c| normal.dot(&given[numbers[c]]));
                let offset = heights.fold(f64::NEG_INFINITY, f64::max);
                Face { normal: *normal, offset, border: vec![] }
            })
            .collect();
        let mut edges = vec![];
        for &[one, other] in &self.neighbours {
            let both: Vec<usize> =
                around[one].iter().copied().filter(|c| around[other].contains(c)).collect();
            let [a, b] = both[..] else { return Err(HullError::Undecided) };
            let line = Capsule::new(corners[a].point, corners[b].point, 0.0);
            // The face lies on one side of its edge: that of its corner farthest from it.
            let into = [one, other].map(|face| {
                let across = self.normals[face].cross(&line.direction).normalize();
                let away = (around[face].iter())
                    .map(|&c| across.dot(&(self.points[numbers[c]] - self.points[numbers[a]])));
                let side =
                    away.fold(0.0, |most: f64, x| if x.abs() > most.abs() { x } else { most });
                across * 1f64.copysign(side)
            });
            for (side, face) in [one, other].into_iter().enumerate() {
                faces[face].border.push((edges.len(), side));
            }
            corners[a].along.push(line.direction);
            corners[b].along.push(-line.direction);
            edges.push(Edge { line, ends: [a, b], faces: [one, other], into });
        }
        let scale = given.iter().fold(size, |most, p| most.max(p.amax()));
        let hull = Hull {
            farthest: Farthest::of(&corners),
            corners: corners.into(),
            edges: edges.into(),
            faces: faces.into(),
            slack: 1e-9 * scale,
        };
        if hull.is_closed() && given.iter().all(|p| hull.holds(p)) {
            Ok(hull)
        } else {
            Err(HullError::Undecided)
        }
    }
}

impl Hull {
    /// The same hull turned about the origin.
    fn turned(&self, by: &UnitQuaternion) -> Self {
        let turn = |v: &Vector<3>| by.rotate(v);
        let corners: Arc<[Corner<3>]> = (self.corners.iter())
            .map(|Corner { point, along }| Corner {
                point: turn(point),
                along: along.iter().map(turn).collect(),
            })
            .collect();
        let turned = |edge: &Edge<3>| {
            let line = Capsule {
                start: turn(&edge.line.start),
                direction: turn(&edge.line.direction),
                ..edge.line
            };
            Edge { line, into: edge.into.each_ref().map(turn), ..edge.clone() }
        };
        Self {
            farthest: Farthest::of(&corners),
            corners,
            edges: self.edges.iter().map(turned).collect(),
            faces: self
                .faces
                .iter()
                .map(|f| Face { normal: turn(&f.normal), ..f.clone() })
                .collect(),
            slack: self.slack,
        }
    }

    /// Whether corners, edges and faces are those of a polyhedron (Euler).
    fn is_closed(&self) -> bool {
        self.corners.len() + self.faces.len() == self.edges.len() + 2
            && self.faces.iter().all(|face| face.border.len() > 2)
    }

    /// Whether a point lies inside, to rounding.
    fn holds(&self, point: &Vector<3>) -> bool {
        self.faces.iter().all(|face| face.height(point) <= self.slack)
    }
}
