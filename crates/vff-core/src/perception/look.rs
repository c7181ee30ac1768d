//! Whether a picture looks through a cell that is remembered: then nothing is there any more.

use super::Depth;
use super::camera::{Camera, Sight};
use super::self_filter::SelfFilter;
use super::settings::PerceiverSettings;
use super::voxels::VoxelMap;
use crate::math::Vector;

/// Whether a picture looks through a cell.
pub(super) struct Look<'a> {
    eye: &'a Camera,
    depth: &'a Depth<'a>,
    filter: &'a SelfFilter<'a>,
    half: f64,
    depth_error: f64,
    range: f64,
}

impl<'a> Look<'a> {
    pub(super) fn new(
        eye: &'a Camera,
        depth: &'a Depth<'a>,
        filter: &'a SelfFilter<'a>,
        map: &VoxelMap,
        settings: &PerceiverSettings,
    ) -> Self {
        let PerceiverSettings { depth_error, range, .. } = *settings;
        Self { eye, depth, filter, half: map.half_diagonal(), depth_error, range }
    }

    /// Whether all that is measured where the cell is in the picture lies behind it, at five of nine places or more. What is the arm's
    /// own says nothing of the cell: it is not what was there.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "within the picture"
    )]
    pub(super) fn is_through(&self, middle: &Vector<3>) -> bool {
        let Some(Sight { column, row, depth }) = self.eye.sight(middle) else { return false };
        let behind = depth + self.half + self.depth_error * depth * depth;
        if depth <= self.half || behind > self.range {
            return false;
        }
        let spread = self.eye.focal() * self.half / depth;
        let last = [self.eye.columns() - 1, self.eye.rows() - 1].map(|last| last as f64);
        let mut through = 0;
        for down in [-spread, 0.0, spread] {
            for aside in [-spread, 0.0, spread] {
                let [u, v] = [(column + aside).round(), (row + down).round()];
                if !(0.0..=last[0]).contains(&u) || !(0.0..=last[1]).contains(&v) {
                    continue;
                }
                let pixel = v as usize * self.eye.columns() + u as usize;
                match self.depth.metres(pixel) {
                    Some(measured) if measured > behind => through += 1,
                    Some(measured) => {
                        let point = self.eye.point(pixel, measured);
                        if self.filter.clearance(&point, self.half) >= 0.0 {
                            return false;
                        }
                    }
                    None => {}
                }
            }
        }
        through >= 5
    }
}
