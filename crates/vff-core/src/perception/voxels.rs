//! What is known to be where (T183): cells of a grid that something was seen in, until it is seen through them or time is up.
//!
//! A grid of numbers says which cell is remembered where, so that the work of a picture grows with its pixels and with what is
//! remembered, never with the room. What a picture shows to be free is found the other way round: every cell that is remembered
//! is looked up in the picture, not every pixel's ray followed through the cells.

use crate::math::Vector;

/// No cell, and one that belongs to what is known.
const NONE: u32 = u32::MAX;
const KNOWN: u32 = u32::MAX - 1;

/// What is added where a cell is hit, taken off where it is seen through, and where it ends: log odds.
const HIT: f64 = 1.5;
const MISS: f64 = -2.0;
const SURE: f64 = 3.0;

/// How long what is hidden goes on as it was seen to move \[s\]; after that it stands where it has come to.
pub(super) const COASTS: f64 = 0.3;

/// What the arm has to do with a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Arm {
    /// All of it is cut away.
    Inside,
    /// Nothing of it.
    Outside,
    /// Each point is asked.
    Across,
}

/// What a point of a picture is in.
pub(super) enum Touched<'a> {
    /// A cell that is remembered from now on.
    Cell(&'a mut Voxel),
    /// One for which there is no room.
    NoRoom,
    /// None: outside, or in what is known.
    Nothing,
}

/// A cell that is remembered.
#[derive(Debug, Clone)]
pub(super) struct Voxel {
    pub(super) cell: u32,
    pub(super) odds: f64,
    /// Since when it is taken \[s\], and when it was hit last.
    pub(super) since: f64,
    pub(super) last: f64,
    /// The mean of the points in it when it was hit last \[m\].
    pub(super) point: Vector<3>,
    /// At which velocity that goes on \[m/s\].
    pub(super) velocity: Vector<3>,
    /// From there to where the body may end that it is a part of, away from the camera \[m\]; 0 where nothing is reckoned with.
    pub(super) behind: Vector<3>,
    /// Which camera hit it last.
    camera: usize,
    /// Of the present picture: whether it was asked for, the points in it, their sum, and what of it is the arm.
    picture: u32,
    pub(super) hits: u32,
    pub(super) sum: Vector<3>,
    /// Opposite corners of a box around the points.
    pub(super) corners: [Vector<3>; 2],
    /// Whether more of it may be where the picture or the room ends.
    pub(super) is_cut: bool,
    pub(super) arm: Arm,
    /// Of the present picture: which cluster it belongs to.
    pub(super) cluster: u32,
    /// Which round body it was seen as last, and whether one that is shown stands for it.
    pub(super) round: Option<u64>,
    pub(super) is_covered: bool,
}

/// A box of cells.
#[derive(Debug, Clone)]
pub(super) struct VoxelMap {
    low: Vector<3>,
    side: f64,
    counts: [usize; 3],
    /// The place of each cell in the list.
    places: Vec<u32>,
    voxels: Vec<Voxel>,
    most: usize,
    picture: u32,
    /// Points that there was no room for.
    pub(super) left_out: usize,
}

impl VoxelMap {
    /// From a corner on so many cells of this side \[m\], of which so many can be remembered.
    pub(super) fn new(low: Vector<3>, side: f64, counts: [usize; 3], most: usize) -> Self {
        let cells = counts.iter().product();
        let (places, voxels) = (vec![NONE; cells], Vec::with_capacity(most));
        Self { low, side, counts, places, voxels, most, picture: 0, left_out: 0 }
    }

    pub(super) fn voxels(&self) -> &[Voxel] {
        &self.voxels
    }

    pub(super) fn voxels_mut(&mut self) -> &mut [Voxel] {
        &mut self.voxels
    }

    /// The middle of a cell \[m\].
    #[expect(clippy::cast_precision_loss, reason = "a number of cells")]
    pub(super) fn middle(&self, cell: u32) -> Vector<3> {
        let [nx, ny, _] = self.counts;
        let cell = cell as usize;
        let at = [cell % nx, cell / nx % ny, cell / nx / ny].map(|i| i as f64 + 0.5);
        self.low + Vector::from(at) * self.side
    }

    /// Half the diagonal of a cell \[m\].
    pub(super) fn half_diagonal(&self) -> f64 {
        0.5 * 3.0_f64.sqrt() * self.side
    }

    /// The cell that holds a point.
    #[inline]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "within the grid, of which the number of cells is bounded"
    )]
    fn cell_of(&self, point: &Vector<3>) -> Option<usize> {
        let [nx, ny, nz] = self.counts;
        let at = (point - self.low) / self.side;
        // False for what is not a number.
        let [x, y, z] = [at.x, at.y, at.z];
        let inside = x >= 0.0 && y >= 0.0 && z >= 0.0;
        let (x, y, z) = (x as usize, y as usize, z as usize);
        (inside && x < nx && y < ny && z < nz).then(|| x + nx * (y + ny * z))
    }

    /// Whether the room ends with a cell.
    fn is_at_the_end(&self, cell: usize) -> bool {
        let [nx, ny, nz] = self.counts;
        let at = [cell % nx, cell / nx % ny, cell / nx / ny];
        at.iter().zip([nx, ny, nz]).any(|(i, n)| *i == 0 || i + 1 == n)
    }

    /// Leaves out all cells that come within a distance \[m\] of what is known.
    #[expect(clippy::cast_possible_truncation, reason = "the number of cells is bounded")]
    pub(super) fn subtract(&mut self, mut is_known: impl FnMut(&Vector<3>) -> bool) {
        for cell in 0..self.places.len() {
            if is_known(&self.middle(cell as u32)) {
                self.places[cell] = KNOWN;
            }
        }
    }

    /// What was seen later than `t` \[s\] was seen then; all rests until it is seen to move again.
    pub(super) fn go_back(&mut self, t: f64) {
        for voxel in &mut self.voxels {
            (voxel.last, voxel.since) = (voxel.last.min(t), voxel.since.min(t));
            voxel.velocity = Vector::zeros();
        }
    }

    /// Forgets all but what is known.
    pub(super) fn forget(&mut self) {
        for voxel in self.voxels.drain(..) {
            self.places[voxel.cell as usize] = NONE;
        }
    }

    /// Begins with another picture.
    pub(super) fn begin(&mut self) {
        self.picture = self.picture.wrapping_add(1);
        self.left_out = 0;
    }

    /// What a point of the present picture is in. `arm` is asked once for each cell.
    #[inline]
    #[expect(clippy::cast_possible_truncation, reason = "few")]
    pub(super) fn touch(
        &mut self,
        point: &Vector<3>,
        arm: impl FnOnce(&Vector<3>) -> Arm,
    ) -> Touched<'_> {
        let Some(cell) = self.cell_of(point) else { return Touched::Nothing };
        let place = match self.places[cell] {
            KNOWN => return Touched::Nothing,
            NONE if self.voxels.len() == self.most => {
                return Touched::NoRoom;
            }
            NONE => {
                let place = self.voxels.len();
                self.places[cell] = place as u32;
                self.voxels.push(Voxel {
                    cell: cell as u32,
                    odds: 0.0,
                    since: f64::INFINITY,
                    last: f64::NEG_INFINITY,
                    point: Vector::zeros(),
                    velocity: Vector::zeros(),
                    behind: Vector::zeros(),
                    camera: 0,
                    picture: self.picture.wrapping_sub(1),
                    hits: 0,
                    sum: Vector::zeros(),
                    corners: [Vector::zeros(); 2],
                    is_cut: false,
                    arm: Arm::Outside,
                    cluster: NONE,
                    round: None,
                    is_covered: false,
                });
                place
            }
            place => place as usize,
        };
        if self.voxels[place].picture != self.picture {
            let arm = arm(&self.middle(cell as u32));
            let (picture, is_cut) = (self.picture, self.is_at_the_end(cell));
            let voxel = &mut self.voxels[place];
            (voxel.picture, voxel.hits, voxel.sum, voxel.arm) = (picture, 0, Vector::zeros(), arm);
            voxel.corners = [Vector::repeat(f64::INFINITY), Vector::repeat(f64::NEG_INFINITY)];
            voxel.is_cut = is_cut;
        }
        Touched::Cell(&mut self.voxels[place])
    }

    /// Takes in what the present picture, of a camera at time `t` \[s\], says of all cells: those with so many points or more as
    /// `least` says of their place are hit, of the others those are seen through of which `is_seen_through` says so, asked where they have
    /// gone on to (T190). What has moved on to where this picture shows it, outside of what is cut away as the arm, what is not taken any
    /// more, and what was hit last longer ago than `memory` \[s\], is forgotten.
    pub(super) fn finish(
        &mut self,
        camera: usize,
        t: f64,
        least: impl Fn(&Vector<3>) -> f64,
        memory: f64,
        is_seen_through: impl Fn(&Vector<3>) -> bool,
        is_cut_away: impl Fn(&Vector<3>) -> bool,
    ) {
        let mut place = 0;
        while place < self.voxels.len() {
            let voxel = &self.voxels[place];
            let is_moving = voxel.velocity != Vector::<3>::zeros();
            let expected = if is_moving { voxel.at(t) } else { self.middle(voxel.cell) };
            let has_moved_on = is_moving
                && voxel.camera == camera
                && self.is_hit_around(&expected, &least)
                && !is_cut_away(&expected);
            let voxel = &mut self.voxels[place];
            voxel.cluster = NONE;
            if voxel.picture != self.picture {
                voxel.hits = 0;
            }
            if voxel.is_hit(&least) {
                voxel.odds = (voxel.odds + HIT).min(SURE);
                voxel.point = voxel.seen();
                voxel.since = voxel.since.min(t);
                voxel.last = voxel.last.max(t); // another camera's picture may be later, to which it goes on
                voxel.camera = camera;
            } else {
                voxel.hits = 0;
                if has_moved_on {
                    voxel.odds = 0.0;
                } else if voxel.odds > 0.0 && voxel.last <= t && is_seen_through(&expected) {
                    voxel.odds += MISS;
                }
            }
            if voxel.odds > 0.0 && t - voxel.last <= memory {
                place += 1;
            } else {
                self.remove(place);
            }
        }
    }

    /// Forgets the cells that are such.
    pub(super) fn drop_where(&mut self, is_such: impl Fn(&Voxel) -> bool) {
        let mut place = 0;
        while let Some(voxel) = self.voxels.get(place) {
            if is_such(voxel) { self.remove(place) } else { place += 1 }
        }
    }

    #[expect(clippy::cast_possible_truncation, reason = "few")]
    fn remove(&mut self, place: usize) {
        let removed = self.voxels.swap_remove(place);
        self.places[removed.cell as usize] = NONE;
        if let Some(moved) = self.voxels.get(place) {
            self.places[moved.cell as usize] = place as u32;
        }
    }

    /// Whether the present picture has so many points in the cell of a point, or in one of the six beside it.
    fn is_hit_around(&self, point: &Vector<3>, least: &impl Fn(&Vector<3>) -> f64) -> bool {
        let is_hit = |offset: Vector<3>| {
            let cell = self.cell_of(&(point + offset * self.side));
            let voxel = cell.and_then(|cell| self.voxels.get(self.places[cell] as usize));
            voxel.is_some_and(|voxel| voxel.picture == self.picture && voxel.is_hit(least))
        };
        let mut around = (0..3).flat_map(|axis| {
            [-1.0, 1.0].map(|side| Vector::<3>::from_fn(|k, _| if k == axis { side } else { 0.0 }))
        });
        is_hit(Vector::zeros()) || around.any(is_hit)
    }

    /// Calls `visit` with the places of the cells around the one at a place that are taken.
    #[expect(clippy::cast_possible_wrap, clippy::cast_sign_loss, reason = "within the grid")]
    pub(super) fn for_each_neighbour(&self, place: usize, mut visit: impl FnMut(usize)) {
        let [nx, ny, nz] = self.counts.map(|n| n as isize);
        let cell = self.voxels[place].cell as isize;
        let [x, y, z] = [cell % nx, cell / nx % ny, cell / nx / ny];
        for dz in (z - 1).max(0)..=(z + 1).min(nz - 1) {
            for dy in (y - 1).max(0)..=(y + 1).min(ny - 1) {
                for dx in (x - 1).max(0)..=(x + 1).min(nx - 1) {
                    let other = self.places[(dx + nx * (dy + ny * dz)) as usize];
                    if other < KNOWN && other as usize != place {
                        visit(other as usize);
                    }
                }
            }
        }
    }
}

impl Voxel {
    /// Whether the present picture has as many points in it as are asked for where they are.
    fn is_hit(&self, least: &impl Fn(&Vector<3>) -> f64) -> bool {
        self.hits > 0 && f64::from(self.hits) >= least(&self.seen())
    }

    /// Where the points in it have gone on to at time `t` \[s\].
    pub(super) fn at(&self, t: f64) -> Vector<3> {
        self.point + self.velocity * (t - self.last).min(COASTS)
    }

    /// Whether it is reckoned with what is behind it.
    pub(super) fn is_deep(&self) -> bool {
        self.behind != Vector::<3>::zeros()
    }

    /// At which velocity they go on from there \[m/s\].
    pub(super) fn velocity_at(&self, t: f64) -> Vector<3> {
        if t - self.last < COASTS { self.velocity } else { Vector::zeros() }
    }

    /// The mean of the points of the present picture in it, which may not be the last one.
    pub(super) fn seen(&self) -> Vector<3> {
        self.sum / f64::from(self.hits)
    }

    /// Takes in a point that is in it \[m\], which may be one at the end of the picture.
    #[inline]
    pub(super) fn add(&mut self, point: &Vector<3>, at_the_end: bool) {
        self.hits += 1;
        self.sum += point;
        let [low, high] = &mut self.corners;
        (*low, *high) = (low.inf(point), high.sup(point));
        self.is_cut |= at_the_end;
    }
}
