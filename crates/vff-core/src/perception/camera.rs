//! A depth camera: the ray that every pixel looks along, and the pixel in which a point is seen (T181).

use super::PerceptionError;
use crate::interrupt;
use crate::math::{UnitQuaternion, Vector, upright};
use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

/// Steps in which the distortion is inverted, and the error that may be left of it \[pixels\].
const STEPS: usize = 100;
const OPEN: f64 = 1e-2;

/// The most pixels of a camera.
const MAX_PIXELS: usize = 1 << 23;

/// What is known of a depth camera: its picture, and where it stands.
///
/// Depths are along the optical axis. A point at (x, y, 1) in the frame of the camera (z forward, x to the right, y down) is seen
/// at column fₓx′ + cₓ and row f_y y′ + c_y, counted from the middle of the first pixel, with (x′, y′) after the lens:
/// Brown's distortion with the coefficients k₁, k₂, p₁, p₂, k₃ in the order of OpenCV (D. C. Brown, "Close-range camera
/// calibration", Photogrammetric Engineering 37, 1971).
///
/// # Example
/// ```
/// use vff_core::perception::DepthCamera;
///
/// let camera: DepthCamera = toml::from_str(
///     "columns = 640\nrows = 480\nfocal = [600.0, 600.0]\ncentre = [319.5, 239.5]\nposition = [1.0, 0.0, 0.8]",
/// )
/// .unwrap();
/// assert_eq!(camera.distortion, [0.0; 5]);
/// ```
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct DepthCamera {
    /// Pixels side by side, ≥ 1.
    pub columns: usize,
    /// Pixels one below the other, ≥ 1.
    pub rows: usize,
    /// Focal lengths fₓ, f_y \[pixels\], > 0.
    pub focal: [f64; 2],
    /// Where the optical axis is in the picture, cₓ, c_y \[pixels\].
    pub centre: [f64; 2],
    /// k₁, k₂, p₁, p₂, k₃. Default: none.
    #[serde(default)]
    pub distortion: [f64; 5],
    /// Where it stands \[m\]. Default: the origin.
    #[serde(default)]
    pub position: [f64; 3],
    /// The quaternion \[w, x, y, z\] of its frame in the world. Default: that of the world.
    #[serde(default = "upright")]
    pub orientation: [f64; 4],
}

/// Depths, row by row.
///
/// # Example
/// ```
/// use vff_core::perception::Depth;
///
/// assert_eq!(Depth::Millimetres(&[0, 1500]).len(), 2);
/// assert_eq!(Depth::Millimetres(&[0, 1500]).metres(1), Some(1.5));
/// assert_eq!(Depth::Metres(&[f32::NAN]).metres(0), None);
/// ```
#[derive(Debug, Clone, Copy)]
pub enum Depth<'a> {
    /// Whole millimetres; 0 where nothing was measured.
    Millimetres(&'a [u16]),
    /// Metres; what is not a positive number where nothing was measured.
    Metres(&'a [f32]),
}

impl Depth<'_> {
    /// How many pixels there are.
    pub fn len(&self) -> usize {
        match self {
            Self::Millimetres(depths) => depths.len(),
            Self::Metres(depths) => depths.len(),
        }
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// That of a pixel \[m\], if one was measured.
    #[inline]
    pub fn metres(&self, pixel: usize) -> Option<f64> {
        let depth = match self {
            Self::Millimetres(depths) => 1e-3 * f64::from(depths[pixel]),
            Self::Metres(depths) => f64::from(depths[pixel]),
        };
        (depth > 0.0 && depth.is_finite()).then_some(depth)
    }
}

/// A camera, ready for its pictures.
#[derive(Debug, Clone)]
pub(super) struct Camera {
    model: DepthCamera,
    /// x and y of the ray of every pixel where z is 1.
    rays: Vec<[f32; 2]>,
    /// x² + y² of the farthest.
    widest: f64,
    rotation: Matrix3<f64>,
    origin: Vector<3>,
}

/// Where a point is seen.
pub(super) struct Sight {
    pub(super) column: f64,
    pub(super) row: f64,
    /// Depth \[m\].
    pub(super) depth: f64,
}

impl Camera {
    pub(super) fn new(model: &DepthCamera, number: usize) -> Result<Self, PerceptionError> {
        let fault = |problem: String| PerceptionError::Camera { number, problem };
        let DepthCamera { columns, rows, focal, centre, distortion, position, orientation } = model;
        if !(1..=MAX_PIXELS).contains(&columns.saturating_mul(*rows)) {
            let problem =
                format!("columns × rows must be 1 to {MAX_PIXELS}, got {columns} × {rows}");
            return Err(fault(problem));
        }
        if !focal.iter().all(|f| f.is_finite() && *f > 0.0) {
            return Err(fault(format!("focal must be greater than 0, got {focal:?}")));
        }
        let numbers = [&centre[..], distortion, position];
        if !numbers.into_iter().flatten().all(|x| x.is_finite()) {
            return Err(fault("centre, distortion and position must be finite".into()));
        }
        let turn = UnitQuaternion::new(*orientation)
            .map_err(|error| fault(format!("orientation: {error}")))?;
        let mut this = Self {
            rays: Vec::with_capacity(columns * rows),
            widest: 0.0,
            rotation: turn.matrix(),
            origin: Vector::from(*position),
            model: model.clone(),
        };
        for pixel in 0..columns * rows {
            interrupt::checkpoint(STEPS);
            let ray = this.undistorted(pixel).ok_or_else(|| {
                let (column, row) = (pixel % columns, pixel / columns);
                fault(format!("distortion cannot be undone at column {column}, row {row}"))
            })?;
            this.widest = this.widest.max(ray[0] * ray[0] + ray[1] * ray[1]);
            #[expect(
                clippy::cast_possible_truncation,
                reason = "1e-7 of a ray is far below a pixel"
            )]
            this.rays.push(ray.map(|x| x as f32));
        }
        Ok(this)
    }

    pub(super) fn columns(&self) -> usize {
        self.model.columns
    }

    pub(super) fn rows(&self) -> usize {
        self.model.rows
    }

    /// Where it stands \[m\].
    pub(super) fn origin(&self) -> &Vector<3> {
        &self.origin
    }

    /// The longer focal length \[pixels\].
    pub(super) fn focal(&self) -> f64 {
        self.model.focal[0].max(self.model.focal[1])
    }

    /// How many of the pixels that are looked at, every so manieth in rows and columns, a square of this side \[m\] at a place covers.
    #[expect(clippy::cast_precision_loss, reason = "a count of pixels")]
    pub(super) fn pixels_of(&self, place: &Vector<3>, side: f64, stride: usize) -> f64 {
        let depth = self.rotation.column(2).dot(&(place - self.origin));
        let [across, down] = self.model.focal.map(|focal| focal * side / (depth * stride as f64));
        across * down
    }

    /// Where the lens puts what is seen at (x, y, 1), before the focal length.
    fn distorted(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [k1, k2, p1, p2, k3] = self.model.distortion;
        let square = x * x + y * y;
        let radial = 1.0 + square * (k1 + square * (k2 + square * k3));
        [
            x * radial + 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x),
            y * radial + p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y,
        ]
    }

    /// (x, y) of the ray of a pixel: the fixed point of what the lens would have to be given; none if that is none.
    #[expect(clippy::cast_precision_loss, reason = "counts of pixels")]
    fn undistorted(&self, pixel: usize) -> Option<[f64; 2]> {
        let DepthCamera { columns, focal, centre, distortion, .. } = &self.model;
        let at = [(pixel % columns) as f64, (pixel / columns) as f64];
        let seen: [f64; 2] = std::array::from_fn(|k| (at[k] - centre[k]) / focal[k]);
        if distortion.iter().all(|k| *k == 0.0) {
            return Some(seen);
        }
        let mut ray = seen;
        for _ in 0..STEPS {
            let (before, moved) = (ray, self.distorted(ray));
            ray = std::array::from_fn(|k| ray[k] + (seen[k] - moved[k]));
            if ray.map(f64::to_bits) == before.map(f64::to_bits) {
                break;
            }
        }
        let back = self.distorted(ray);
        let open = (0..2).map(|k| ((back[k] - seen[k]) * focal[k]).abs()).fold(0.0, f64::max);
        (open < OPEN && ray.iter().all(|x| x.is_finite())).then_some(ray)
    }

    /// A picture of points in the frame of the camera \[m\]: in every pixel the depth of the nearest, 0 without one.
    pub(super) fn picture(&self, points: &[[f64; 3]]) -> Vec<f32> {
        let mut depths = vec![0.0_f32; self.rays.len()];
        for point in points {
            let Some(Sight { column, row, depth }) = self.sight_of(&Vector::from(*point)) else {
                continue;
            };
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "within the picture"
            )]
            let pixel =
                row.round().max(0.0) as usize * self.columns() + column.round().max(0.0) as usize;
            #[expect(clippy::cast_possible_truncation, reason = "a depth")]
            if let Some(nearest) = depths.get_mut(pixel)
                && (*nearest == 0.0 || (depth as f32) < *nearest)
            {
                *nearest = depth as f32;
            }
        }
        depths
    }

    /// The point at this depth \[m\] in a pixel \[m\], in the frame of the camera.
    #[inline]
    pub(super) fn deproject(&self, pixel: usize, depth: f64) -> Vector<3> {
        let [x, y] = self.rays[pixel].map(f64::from);
        Vector::<3>::new(x * depth, y * depth, depth)
    }

    /// The same in the world.
    #[inline]
    pub(super) fn point(&self, pixel: usize, depth: f64) -> Vector<3> {
        self.origin + self.rotation * self.deproject(pixel, depth)
    }

    /// Where a point of the world is seen; none behind the camera and outside of its picture.
    #[inline]
    pub(super) fn sight(&self, point: &Vector<3>) -> Option<Sight> {
        self.sight_of(&self.rotation.tr_mul(&(point - self.origin)))
    }

    /// The same of a point in the frame of the camera.
    #[inline]
    #[expect(clippy::cast_precision_loss, reason = "counts of pixels")]
    fn sight_of(&self, seen: &Vector<3>) -> Option<Sight> {
        let DepthCamera { columns, rows, focal, centre, .. } = &self.model;
        if seen.z <= 0.0 {
            return None;
        }
        let ray = [seen.x / seen.z, seen.y / seen.z];
        // Beyond, the polynomials of the lens may turn back into the picture.
        if ray[0] * ray[0] + ray[1] * ray[1] > 1.1 * self.widest + 1e-9 {
            return None;
        }
        let [x, y] = self.distorted(ray);
        let (column, row) = (focal[0] * x + centre[0], focal[1] * y + centre[1]);
        let inside = (-0.5..*columns as f64 - 0.5).contains(&column)
            && (-0.5..*rows as f64 - 0.5).contains(&row);
        inside.then_some(Sight { column, row, depth: seen.z })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wide() -> DepthCamera {
        DepthCamera {
            columns: 64,
            rows: 48,
            focal: [55.0, 57.0],
            centre: [30.2, 24.9],
            distortion: [-0.28, 0.09, 0.001, -0.002, -0.01],
            position: [0.3, -0.2, 1.4],
            orientation: [0.1, 0.9, -0.3, 0.3],
        }
    }

    /// What a pixel sees at a depth is seen in its middle, at that depth.
    #[test]
    fn points_are_seen_where_they_come_from() {
        let camera = Camera::new(&wide(), 0).unwrap();
        for pixel in 0..64 * 48 {
            for depth in [0.3, 2.7] {
                let Sight { column, row, depth: found } =
                    camera.sight(&camera.point(pixel, depth)).unwrap();
                assert!((column - (pixel % 64) as f64).abs() < 0.02, "{pixel} {column}");
                assert!((row - (pixel / 64) as f64).abs() < 0.02, "{pixel} {row}");
                assert!((found - depth).abs() < 1e-6);
            }
            let behind = camera.point(pixel, -1.0);
            assert!(camera.sight(&behind).is_none());
        }
    }

    #[test]
    fn unusable_cameras_are_refused() {
        type Spoil = fn(&mut DepthCamera);
        let cases: [(Spoil, &str); 5] = [
            (|it| it.columns = 0, "columns × rows"),
            (|it| it.focal[1] = -1.0, "focal"),
            (|it| it.position[2] = f64::NAN, "finite"),
            (|it| it.orientation = [0.0; 4], "orientation"),
            (|it| it.distortion = [-9.0, 0.0, 0.0, 0.0, 0.0], "cannot be undone"),
        ];
        for (spoil, expected) in cases {
            let mut model = wide();
            spoil(&mut model);
            let fault = Camera::new(&model, 3).unwrap_err().to_string();
            assert!(fault.contains(expected) && fault.contains("cameras[3]"), "{fault}");
        }
    }
}
