//! In which order the parts of a task give way (T193): what its directions weigh in a program, and what of them a look-ahead
//! holds that has let go some.

use crate::control::TaskMetric;
use crate::control::settings::{Part, TaskKind, Yielding};
use crate::robot::Robot;
use nalgebra::{SMatrix, SVector};
use std::ops::Range;

/// How much more the next part weighs.
const KEPT: f64 = 10.0;

/// The places of turn, tilt, approach and what is across among `parts`, or behind them, and those that a task of dimension `m` in
/// a space of dimension `d` has, in ascending order.
fn places(parts: &[Part], d: usize, m: usize) -> ([usize; 4], Vec<usize>) {
    let place = |part: Part| parts.iter().position(|named| *named == part);
    let places = [
        place(Part::Turn).or(place(Part::Orientation)),
        place(Part::Orientation),
        place(Part::Approach).or(place(Part::Position)),
        place(Part::Position),
    ]
    .map(|place| place.unwrap_or(parts.len()));
    let there = [m == 2 * d, m > d, true, true];
    let mut taken: Vec<usize> =
        places.into_iter().zip(there).filter_map(|(at, there)| there.then_some(at)).collect();
    taken.sort_unstable();
    taken.dedup();
    (places, taken)
}

impl Yielding {
    /// The parts of a task in a space of dimension `space`, what gives way first before what gives way last (T193); None is what
    /// `order` does not name. A look-ahead lets go so many of them as it says, from the first.
    ///
    /// # Example
    /// ```
    /// use vff_core::control::settings::{Part, TaskKind, Yielding};
    ///
    /// let yielding = Yielding { order: Some(vec![Part::Orientation]), ..Yielding::default() };
    /// assert_eq!(yielding.parts(3, TaskKind::Pose), [Some(Part::Orientation), None]);
    /// assert_eq!(Yielding::default().parts(3, TaskKind::Pose), [None]);
    /// ```
    pub fn parts(&self, space: usize, task: TaskKind) -> Vec<Option<Part>> {
        let named = self.order.as_deref().unwrap_or_default();
        let (_, taken) = places(named, space, task.dimension(space).unwrap_or(space));
        taken.into_iter().map(|at| named.get(at).copied()).collect()
    }
}

/// The directions of a task of dimension `M`, each with its place in the order.
#[derive(Debug, Clone)]
pub(crate) struct Order {
    /// The places of the turn about the tool's axis, of its tilt, of the approach along it, and of what is across.
    turn: usize,
    tilt: usize,
    approach: usize,
    across: usize,
    /// How many places there are.
    count: usize,
}

impl Order {
    /// That of the settings, for a task of dimension `M` in a space of dimension `D`.
    pub fn of<const D: usize, const M: usize>(settings: &Yielding) -> Self {
        Self::new::<D, M>(settings.order.as_deref().unwrap_or_default())
    }

    /// That of these parts; those that are not named come last. What the task does not have takes no place.
    pub fn new<const D: usize, const M: usize>(parts: &[Part]) -> Self {
        let (places, taken) = places(parts, D, M);
        let [turn, tilt, approach, across] =
            places.map(|at| taken.iter().position(|place| *place == at).unwrap_or(0));
        Self { turn, tilt, approach, across, count: taken.len() }
    }

    /// How many places there are: 1 where all give way alike.
    pub fn count(&self) -> usize {
        self.count
    }

    /// The matrix, in the rows of J, that multiplies the directions of a task at each place by its factor, for an arm in a space of
    /// dimension `D`.
    #[inline(never)]
    fn scaled<R: Robot<D>, const D: usize, const M: usize>(
        &self,
        robot: &R,
        factor: &dyn Fn(usize) -> f64,
    ) -> SMatrix<f64, M, M> {
        let [turn, tilt, approach, across] =
            [self.turn, self.tilt, self.approach, self.across].map(factor);
        // The tool's axis: z of its frame in space, x in the plane.
        let axis = robot.link_frame(robot.dof()).1.column(if D > 2 { 2 } else { 0 }).into_owned();
        let block = |i: usize, k: usize, along: f64, beside: f64| {
            let same = if i == k { beside } else { 0.0 };
            same + (along - beside) * axis[i] * axis[k]
        };
        // A turn in the plane, and a direction in the tool's own axes, are as they are.
        let turns = |i: usize, k: usize| {
            if M < 2 * D { block(i, k, tilt, tilt) } else { block(i, k, turn, tilt) }
        };
        SMatrix::from_fn(|i, k| match (i < D, k < D) {
            (true, true) => block(i, k, approach, across),
            (false, false) => turns(i - D, k - D),
            _ => 0.0,
        })
    }

    /// The projector on the directions of a task at these places.
    fn at<R: Robot<D>, const D: usize, const M: usize>(
        &self,
        robot: &R,
        places: Range<usize>,
    ) -> SMatrix<f64, M, M> {
        self.scaled(robot, &|place| f64::from(u8::from(places.contains(&place))))
    }

    /// W_x in this order: what gives way last weighs ten times as much, each place before that a tenth of the next (T69, T193).
    pub fn weigh<R: Robot<D>, const D: usize, const M: usize>(
        &self,
        robot: &R,
        weight: &SMatrix<f64, M, M>,
    ) -> SMatrix<f64, M, M> {
        let factor = |place: usize| (place + 1..self.count).fold(KEPT, |factor, _| factor / KEPT);
        // It is the same for all lengths, and for all angles.
        weight * self.scaled::<R, D, M>(robot, &factor)
    }

    /// The directions that are held where the first `released` places are let go.
    pub fn held<R: Robot<D>, const D: usize, const M: usize>(
        &self,
        robot: &R,
        released: usize,
    ) -> SMatrix<f64, M, M> {
        self.at(robot, released..self.count)
    }

    /// The part of one place in a task vector.
    pub fn part<R: Robot<D>, const D: usize, const M: usize>(
        &self,
        robot: &R,
        place: usize,
        v: &SVector<f64, M>,
    ) -> SVector<f64, M> {
        if self.count() == 1 { *v } else { self.at::<R, D, M>(robot, place..place + 1) * v }
    }

    /// How large an error is \[m\] where each place counts a tenth of the one after it.
    pub fn size<R: Robot<D>, const D: usize, const M: usize>(
        &self,
        robot: &R,
        metric: &TaskMetric<M>,
        e: &SVector<f64, M>,
    ) -> f64 {
        if self.count() == 1 {
            return metric.norm(e);
        }
        (e.dot(&(self.weigh(robot, &metric.weight()) * e)) / KEPT).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::{SpatialState, models};
    use std::sync::Arc;

    fn panda() -> SpatialState {
        let mut state = Arc::new(models::named("panda").unwrap().build().unwrap()).state();
        state.update(&[0.3, -0.8, 0.2, -2.0, 0.4, 1.6, 0.8], &[0.0; 7]);
        state
    }

    /// The parts of all places are the whole, each is a projector, and turn and approach are along the tool's axis.
    #[test]
    fn parts_make_up_the_task() {
        use Part::{Approach, Orientation, Position, Turn};
        let robot = panda();
        let axis = robot.link_frame(7).1.column(2).into_owned();
        for parts in [
            vec![],
            vec![Turn],
            vec![Orientation],
            vec![Turn, Orientation, Approach, Position],
            vec![Approach, Position],
            vec![Position],
        ] {
            let order = Order::new::<3, 6>(&parts);
            let mut whole = SMatrix::<f64, 6, 6>::zeros();
            for place in 0..order.count() {
                let one: SMatrix<f64, 6, 6> = order.at(&robot, place..place + 1);
                assert!((one * one - one).norm() < 1e-14, "{parts:?}");
                assert!(one.trace() > 0.5, "{parts:?}: nothing at {place}");
                whole += one;
            }
            assert!((whole - SMatrix::identity()).norm() < 1e-14, "{parts:?}");
            let nothing: SMatrix<f64, 6, 6> = order.held(&robot, order.count());
            assert!(nothing.iter().all(|entry| *entry == 0.0));
        }
        let order = Order::new::<3, 6>(&[Turn, Orientation, Approach, Position]);
        let along = SVector::<f64, 6>::from_fn(|i, _| if i < 3 { 0.0 } else { axis[i - 3] });
        assert!((order.part(&robot, 0, &along) - along).norm() < 1e-14);
        let forward = SVector::<f64, 6>::from_fn(|i, _| if i < 3 { axis[i] } else { 0.0 });
        assert!((order.part(&robot, 2, &forward) - forward).norm() < 1e-14);
        let metric = TaskMetric::<6>::new::<3>(0.2);
        let weight = order.weigh::<_, 3, 6>(&robot, &metric.weight());
        assert!((along.dot(&(weight * along)) - 4e-4).abs() < 1e-14);
        assert!((forward.dot(&(weight * forward)) - 1.0).abs() < 1e-12);
        let sizes = [along, forward].map(|e| order.size::<_, 3, 6>(&robot, &metric, &e));
        assert!(
            (sizes[0] - 0.2 / 1e3f64.sqrt()).abs() < 1e-12
                && (sizes[1] - 1.0 / 10f64.sqrt()).abs() < 1e-12,
            "{sizes:?}"
        );
    }

    /// A part that the task does not have takes no place: there would be nothing to let go, and what is named would weigh less.
    #[test]
    fn what_a_task_does_not_have_takes_no_place() {
        use Part::{Approach, Orientation, Position};
        assert_eq!(Order::new::<3, 3>(&[Position]).count(), 1);
        assert_eq!(Order::new::<3, 3>(&[Approach, Position]).count(), 2);
        assert_eq!(Order::new::<3, 5>(&[Orientation]).count(), 2);
        assert_eq!(Order::new::<2, 3>(&[Position]).count(), 2);
        let robot = panda();
        let axis = robot.link_frame(7).1.column(2).into_owned();
        let metric = TaskMetric::<3>::new::<3>(0.2);
        let order = Order::new::<3, 3>(&[Approach, Position]);
        let weight = order.weigh::<_, 3, 3>(&robot, &metric.weight());
        assert!((axis.dot(&(weight * axis)) - 1.0).abs() < 1e-12);
        assert!((weight.trace() - 21.0).abs() < 1e-12);
    }
}
