//! References in space: a curve of positions and one of orientations (T100–T103).

mod orientation;
mod position;
mod reference;
#[cfg(test)]
mod tests;

use super::{Guided, Knots, Sample, TrajectoryError};
use crate::math::quintic::Coordinates;
use crate::math::rotation::{OrientationError, UnitQuaternion};
use crate::math::{Pointing, Pose, SpatialPose, Vector};
use orientation::{Orientation, Turning};
use position::Position;

pub use reference::SpatialReference;

/// A curve of positions.
#[derive(Debug, Clone, PartialEq)]
pub struct PositionCurve(Position);

/// A curve of positions and orientations.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseCurve {
    position: Position,
    orientation: Orientation,
}

impl PoseCurve {
    fn new(reference: &SpatialReference, start: &SpatialPose) -> Result<Self, TrajectoryError> {
        Ok(Self {
            position: Position::new(reference, start.position())?,
            orientation: Orientation::new(reference, start.orientation())?,
        })
    }

    fn aim(&self, t: f64, goal: &[f64], rate: f64) -> Self {
        Self {
            position: self.position.aim(t, goal, rate),
            orientation: self.orientation.rest(t, turned(goal), rate),
        }
    }

    fn rests_from(&self) -> Option<f64> {
        Some(self.position.rests_from()?.max(self.orientation.rests_from()?))
    }

    /// The same from `x`, with its rates in world axes.
    fn leave(x: &SpatialPose, rates: [Vector<6>; 2], t: f64, goal: &[f64], rate: f64) -> Self {
        let [dx, ddx] = rates.map(|rate| rate.fixed_rows::<3>(0).into_owned());
        let [omega, alpha] = rates.map(|rate| rate.fixed_rows::<3>(3).into_owned());
        let turning = Turning { orientation: x.orientation(), omega, alpha };
        Self {
            position: Position::leave(Coordinates { x: x.position(), dx, ddx }, t, goal, rate),
            orientation: turning.rest(t, turned(goal), rate),
        }
    }
}

/// The orientation of a goal that has one.
fn turned(goal: &[f64]) -> Option<UnitQuaternion> {
    UnitQuaternion::new(goal.get(3..7)?.try_into().ok()?).ok()
}

/// A position in space. An orientation is of no use.
impl Guided<3> for Vector<3> {
    type Reference = SpatialReference;
    type Curve = PositionCurve;

    fn curve(reference: &SpatialReference, start: &Self) -> Result<PositionCurve, TrajectoryError> {
        match Orientation::spoken_of(reference) {
            Some(field) => Err(TrajectoryError::UselessOrientation { field }),
            None => Ok(PositionCurve(Position::new(reference, *start)?)),
        }
    }

    #[inline]
    fn at(curve: &PositionCurve, t: f64) -> Sample<Self, 3> {
        let Coordinates { x, dx, ddx } = curve.0.at(t);
        Sample { x, dx, ddx }
    }

    fn aim(curve: &PositionCurve, t: f64, goal: &[f64], rate: f64) -> PositionCurve {
        PositionCurve(curve.0.aim(t, goal, rate))
    }

    fn leave(state: &Sample<Self, 3>, t: f64, goal: &[f64], rate: f64) -> PositionCurve {
        let Sample { x, dx, ddx } = *state;
        PositionCurve(Position::leave(Coordinates { x, dx, ddx }, t, goal, rate))
    }

    fn plan(reference: &SpatialReference) -> Option<Knots<'_>> {
        reference.plan()
    }

    fn rests_from(curve: &PositionCurve) -> Option<f64> {
        curve.0.rests_from()
    }
}

/// A position and the direction of the tool; see [`Sample::in_world_axes`] for the derivatives.
impl Guided<5> for Pointing {
    type Reference = SpatialReference;
    type Curve = PoseCurve;

    fn curve(reference: &SpatialReference, start: &Self) -> Result<PoseCurve, TrajectoryError> {
        PoseCurve::new(reference, &start.0)
    }

    #[inline]
    fn at(curve: &PoseCurve, t: f64) -> Sample<Self, 5> {
        let Coordinates { x, dx, ddx } = curve.position.at(t);
        let Turning { orientation, omega, alpha } = curve.orientation.at(t);
        let x = Self(SpatialPose::new(x, orientation));
        Sample { x, dx: x.velocity(&dx, &omega), ddx: x.acceleration(&ddx, &omega, &alpha) }
    }

    fn aim(curve: &PoseCurve, t: f64, goal: &[f64], rate: f64) -> PoseCurve {
        curve.aim(t, goal, rate)
    }

    /// What turns about the tool's z axis is not known of the state, and stops.
    fn leave(state: &Sample<Self, 5>, t: f64, goal: &[f64], rate: f64) -> PoseCurve {
        PoseCurve::leave(&state.x.0, in_world_axes(state), t, goal, rate)
    }

    fn plan(reference: &SpatialReference) -> Option<Knots<'_>> {
        reference.plan()
    }

    fn rests_from(curve: &PoseCurve) -> Option<f64> {
        curve.rests_from()
    }

    fn displaced(sample: &Sample<Self, 5>, by: &[Vector<6>; 3]) -> Sample<Self, 5> {
        let [turn, dx, ddx] = by;
        let rates = in_world_axes(sample);
        Sample::<Self, 5>::in_world_axes(
            sample.x.0.moved(turn),
            &(rates[0] + dx),
            &(rates[1] + ddx),
        )
    }

    /// The smallest turn that leads from axis to axis.
    fn displacement(there: &Sample<Self, 5>, sample: &Sample<Self, 5>) -> [Vector<6>; 3] {
        let [from, to] = [sample, there].map(in_world_axes);
        let (x, old) = (sample.x.0, there.x.0);
        let turn = old.orientation().pointing_error(&x.orientation(), OrientationError::Logarithm);
        let turn = old.orientation().rotate(&Vector::<3>::new(turn.x, turn.y, 0.0));
        let way = stacked(&(old.position() - x.position()), &turn);
        [way, to[0] - from[0], to[1] - from[1]]
    }
}

/// A position and an orientation in space; derivatives are linear, then ω and α, in world axes.
impl Guided<6> for SpatialPose {
    type Reference = SpatialReference;
    type Curve = PoseCurve;

    fn curve(reference: &SpatialReference, start: &Self) -> Result<PoseCurve, TrajectoryError> {
        PoseCurve::new(reference, start)
    }

    #[inline]
    fn at(curve: &PoseCurve, t: f64) -> Sample<Self, 6> {
        let Coordinates { x, dx, ddx } = curve.position.at(t);
        let Turning { orientation, omega, alpha } = curve.orientation.at(t);
        Sample {
            x: Self::new(x, orientation),
            dx: stacked(&dx, &omega),
            ddx: stacked(&ddx, &alpha),
        }
    }

    fn aim(curve: &PoseCurve, t: f64, goal: &[f64], rate: f64) -> PoseCurve {
        curve.aim(t, goal, rate)
    }

    fn leave(state: &Sample<Self, 6>, t: f64, goal: &[f64], rate: f64) -> PoseCurve {
        PoseCurve::leave(&state.x, [state.dx, state.ddx], t, goal, rate)
    }

    fn plan(reference: &SpatialReference) -> Option<Knots<'_>> {
        reference.plan()
    }

    fn rests_from(curve: &PoseCurve) -> Option<f64> {
        curve.rests_from()
    }

    fn displacement(there: &Sample<Self, 6>, sample: &Sample<Self, 6>) -> [Vector<6>; 3] {
        let turn = (there.x.orientation() * sample.x.orientation().inverse()).log();
        let way = stacked(&(there.x.position() - sample.x.position()), &turn);
        [way, there.dx - sample.dx, there.ddx - sample.ddx]
    }
}

impl Sample<Pointing, 5> {
    /// From derivatives as others have them: linear, then angular, in world axes. What turns about the tool's z axis
    /// is left out of them.
    pub fn in_world_axes(x: SpatialPose, dx: &Vector<6>, ddx: &Vector<6>) -> Self {
        let x = Pointing(x);
        let [dx, ddx] = x.seen_in_world_axes(dx, ddx);
        Self { x, dx, ddx }
    }
}

/// Rates of a direction in world axes, with whose pose nothing turns about z.
fn in_world_axes(sample: &Sample<Pointing, 5>) -> [Vector<6>; 2] {
    [&sample.dx, &sample.ddx].map(|rates| {
        let turning = Vector::<3>::new(rates[3], rates[4], 0.0);
        let turning = sample.x.0.orientation().rotate(&turning);
        stacked(&rates.fixed_rows::<3>(0).into(), &turning)
    })
}

/// Linear components, then angular ones.
#[inline]
fn stacked(linear: &Vector<3>, angular: &Vector<3>) -> Vector<6> {
    Vector::<6>::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z)
}
