//! The edges of obstacles.

use super::Vec2;

/// One edge of a convex polygon.
#[derive(Debug, Clone, Copy)]
pub(super) struct Face {
    pub(super) start: Vec2,
    /// Unit vector, outward.
    pub(super) normal: Vec2,
    /// Length of the edge, positive \[m\].
    pub(super) length: f64,
}

/// The edges of the polygon with these counter-clockwise corners, except those without length.
pub(super) fn faces(vertices: &[Vec2]) -> Vec<Face> {
    let next = vertices.iter().cycle().skip(1);
    vertices
        .iter()
        .zip(next)
        .filter_map(|(&start, &end)| {
            let edge = end - start;
            let length = edge.length();
            length.is_normal().then(|| Face { start, normal: -edge.perp() / length, length })
        })
        .collect()
}

impl Face {
    #[inline]
    pub(super) fn end(&self) -> Vec2 {
        self.start + self.normal.perp() * self.length
    }

    /// Signed distance of `point` from the line through the edge, positive outside.
    #[inline]
    pub(super) fn height(&self, point: Vec2) -> f64 {
        self.normal.dot(point - self.start)
    }

    /// Whether the perpendicular from `point` meets the edge between its ends.
    #[inline]
    pub(super) fn is_below(&self, point: Vec2) -> bool {
        (0.0..=self.length).contains(&self.normal.perp().dot(point - self.start))
    }
}
