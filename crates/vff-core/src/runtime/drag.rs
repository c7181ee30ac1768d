//! What somebody drags: a place or an orientation on its way to where it is wanted, no faster than it may be.

use crate::math::UnitQuaternion;

/// A place on its way.
#[derive(Debug, Clone)]
pub(super) struct DragTarget {
    pub(super) goal: Vec<f64>,
    pub(super) wanted: Vec<f64>,
}

impl DragTarget {
    /// At `place` \[m\], and not going anywhere.
    pub(super) fn at(place: Vec<f64>) -> Self {
        Self { wanted: place.clone(), goal: place }
    }

    /// Goes at most `distance` \[m\] on; whether it has moved.
    pub(super) fn advance(&mut self, distance: f64) -> bool {
        let away = |(goal, wanted): (&f64, &f64)| wanted - goal;
        let length =
            self.goal.iter().zip(&self.wanted).map(away).map(|d| d * d).sum::<f64>().sqrt();
        if length <= distance {
            self.goal.copy_from_slice(&self.wanted);
        } else {
            for (goal, wanted) in self.goal.iter_mut().zip(&self.wanted) {
                *goal += (wanted - *goal) * (distance / length);
            }
        }
        length > 0.0
    }
}

/// An orientation on its way, always the short one.
#[derive(Debug, Clone, Copy)]
pub(super) struct DragTurn {
    pub(super) goal: UnitQuaternion,
    pub(super) wanted: UnitQuaternion,
}

impl DragTurn {
    /// Goes at most `angle` \[rad\] on; whether it has turned.
    pub(super) fn advance(&mut self, angle: f64) -> bool {
        let left = (self.wanted * self.goal.inverse()).log();
        let size = left.norm();
        if size <= angle {
            self.goal = self.wanted;
        } else {
            self.goal = UnitQuaternion::exp(&(left * (angle / size))) * self.goal;
        }
        size > 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vector;

    /// A place and an orientation arrive after as many steps as their ways take, and then stay.
    #[test]
    fn what_is_dragged_arrives() {
        let mut place = DragTarget::at(vec![0.0, 0.0]);
        place.wanted = vec![0.3, 0.4];
        assert!((0..5).all(|_| place.advance(0.1)));
        assert!((place.goal[0] - 0.3).abs() + (place.goal[1] - 0.4).abs() < 1e-15);
        place.advance(0.1);
        assert!(!place.advance(0.1) && place.goal == place.wanted);

        let wanted = UnitQuaternion::exp(&Vector::<3>::new(0.0, 0.3, 0.4));
        let mut turn = DragTurn { goal: UnitQuaternion::IDENTITY, wanted };
        assert!((0..3).all(|_| turn.advance(0.1)));
        let expected = Vector::<3>::new(0.0, 0.18, 0.24);
        assert!((turn.goal.log() - expected).norm() < 1e-14);
        assert!((0..2).all(|_| turn.advance(0.11)));
        assert!(!turn.advance(0.1) && turn.goal == wanted);
    }
}
