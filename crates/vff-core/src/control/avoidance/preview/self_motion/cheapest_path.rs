//! The cheapest path through a grid of places and instants with bounded speed and acceleration, by dynamic programming (T174).

/// What a path may do and what that costs.
pub trait Passage {
    /// The cost of being at `place` at instant `k`; infinite where nothing can be.
    fn cost(&self, place: usize, k: usize) -> f64;
    /// Whether one can go from place `from` at instant `k` to place `to` at the next.
    fn is_open(&self, from: usize, to: usize, k: usize) -> bool;
    /// The cost of going on by so many places in one step.
    fn cost_of_going(&self, places: usize) -> f64;
    /// The cost of each instant that a path does not reach because it leads nowhere: more than any on a path.
    fn cost_of_ending(&self) -> f64;
}

/// The search, with its workspace. A state is a place and the step, in places, that led to it.
#[derive(Debug, Clone)]
pub struct CheapestPath {
    places: usize,
    /// The largest step, and by how much it changes at most.
    largest: usize,
    change: usize,
    /// Of every state the least cost up to it, at this instant and at the next.
    values: Vec<f64>,
    next: Vec<f64>,
    /// Of every state of every instant after the first, the step before, counted from the most negative one.
    before: Vec<u8>,
    /// How many instants have been reached, after the first, and which places there.
    done: usize,
    reached: [usize; 2],
    /// Of all paths so far that which is the cheapest if it ends where it is: at which instant, in which state, and its cost less that
    /// of the instants that it has reached.
    best: (usize, usize, f64),
}

impl CheapestPath {
    /// Steps of more places than this have no room in the workspace.
    pub const LARGEST: usize = 100;

    /// Over this many `places`, for `instants` after the first.
    pub fn new(places: usize, instants: usize, largest: usize, change: usize) -> Self {
        let largest = largest.min(Self::LARGEST);
        let states = places * (2 * largest + 1);
        Self {
            places,
            largest,
            change,
            values: vec![f64::INFINITY; states],
            next: vec![f64::INFINITY; states],
            before: vec![0; states * instants],
            done: 0,
            reached: [0; 2],
            best: (0, 0, 0.0),
        }
    }

    /// The largest step, in places.
    pub fn largest(&self) -> usize {
        self.largest
    }

    fn width(&self) -> usize {
        2 * self.largest + 1
    }

    /// Begins at `place` after a step of `speed` places.
    pub fn begin(&mut self, place: usize, speed: isize) {
        let speed = speed.clamp(-self.largest.cast_signed(), self.largest.cast_signed());
        let state = place * self.width() + self.largest.wrapping_add_signed(speed);
        self.values.fill(f64::INFINITY);
        self.values[state] = 0.0;
        (self.done, self.reached) = (0, [place, place]);
        self.best = (0, state, 0.0);
    }

    /// Goes on to the next instant.
    pub fn advance(&mut self, passage: &impl Passage) {
        let width = self.width();
        let Self { places, largest, values, next, before, done, reached, best, .. } = self;
        let (largest, k) = (*largest, *done);
        #[expect(clippy::cast_precision_loss, reason = "few instants")]
        let spared = (k + 1) as f64 * passage.cost_of_ending();
        next.fill(f64::INFINITY);
        let before = &mut before[k * *places * width..][..*places * width];
        let [first, last] = *reached;
        *reached = [*places, 0];
        for from in first..=last {
            let here = &values[from * width..][..width];
            if here.iter().all(|value| value.is_infinite()) {
                continue;
            }
            let staying = passage.cost(from, k + 1);
            for direction in [1, -1_isize] {
                // Whatever lies between is passed, too.
                let mut worst = staying;
                for places in usize::from(direction < 0)..=largest {
                    let by = direction * places.cast_signed();
                    let Some(to) = from.checked_add_signed(by).filter(|to| *to < self.places)
                    else {
                        break;
                    };
                    worst = worst.max(passage.cost(to, k + 1));
                    if worst.is_infinite() {
                        break;
                    }
                    if !passage.is_open(from, to, k) {
                        continue;
                    }
                    let step = largest.wrapping_add_signed(by);
                    let lowest = step.saturating_sub(self.change);
                    let highest = (step + self.change).min(width - 1);
                    let mut least = f64::INFINITY;
                    let mut of = 0;
                    for (index, value) in (lowest..).zip(&here[lowest..=highest]) {
                        if *value < least {
                            (least, of) = (*value, index);
                        }
                    }
                    if least.is_finite() {
                        let state = to * width + step;
                        let cost = least + worst + passage.cost_of_going(places);
                        next[state] = cost;
                        // Less is left that is not reached.
                        let total = cost - spared;
                        if total < best.2 {
                            *best = (k + 1, state, total);
                        }
                        #[expect(clippy::cast_possible_truncation, reason = "at most 200")]
                        let of = of as u8;
                        before[state] = of;
                        *reached = [reached[0].min(to), reached[1].max(to)];
                    }
                }
            }
        }
        std::mem::swap(values, next);
        *done += 1;
    }

    /// Writes the places of the cheapest path, one per instant from the first to the last that has been reached; those of a path that
    /// leads nowhere stay where it ends. How many instants it reaches after the first.
    pub fn trace(&self, path: &mut [usize]) -> usize {
        let width = self.width();
        let (last, mut state, _) = self.best;
        path[last..=self.done].fill(state / width);
        for k in (0..last).rev() {
            let (place, step) = (state / width, state % width);
            let from = place + self.largest - step;
            state = from * width
                + usize::from(self.before[k * self.places * width + place * width + step]);
            path[k] = from;
        }
        last
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Noise;

    const PLACES: usize = 5;
    const INSTANTS: usize = 5;

    /// Random costs, some of them infinite, and random doors.
    struct Maze {
        costs: [[f64; PLACES]; INSTANTS + 1],
        closed: [[[bool; PLACES]; PLACES]; INSTANTS],
    }

    impl Maze {
        fn drawn(noise: &mut Noise) -> Self {
            let mut maze = Self {
                costs: [[0.0; PLACES]; INSTANTS + 1],
                closed: [[[false; PLACES]; PLACES]; INSTANTS],
            };
            for cost in maze.costs.iter_mut().flatten() {
                *cost = if noise.share() < 0.2 { f64::INFINITY } else { noise.share() };
            }
            for closed in maze.closed.iter_mut().flatten().flatten() {
                *closed = noise.share() < 0.2;
            }
            maze
        }
    }

    impl Passage for Maze {
        fn cost(&self, place: usize, k: usize) -> f64 {
            self.costs[k][place]
        }

        fn is_open(&self, from: usize, to: usize, k: usize) -> bool {
            !self.closed[k][from][to]
        }

        fn cost_of_going(&self, places: usize) -> f64 {
            [0.0, 0.1, 0.4][places]
        }

        fn cost_of_ending(&self) -> f64 {
            10.0
        }
    }

    /// The least cost of all sequences of places, where every instant that is not reached costs 10.
    fn brute_force(maze: &Maze, at: usize, speed: isize, k: usize) -> f64 {
        #[expect(clippy::cast_precision_loss, reason = "a few")]
        let mut least = 10.0 * (INSTANTS - k) as f64;
        if k == INSTANTS {
            return least;
        }
        for step in (speed - 1).max(-2)..=(speed + 1).min(2) {
            let Some(to) = at.checked_add_signed(step).filter(|to| *to < PLACES) else { continue };
            if maze.closed[k][at][to] {
                continue;
            }
            let passed = at.min(to)..=at.max(to);
            let worst = passed.map(|place| maze.costs[k + 1][place]).fold(0.0, f64::max);
            let cost = worst + maze.cost_of_going(step.unsigned_abs());
            least = least.min(cost + brute_force(maze, to, step, k + 1));
        }
        least
    }

    /// The path is the best of all, it goes as far as one can, and its cost is what its steps cost.
    #[test]
    fn it_is_the_best_of_all_paths() {
        let mut noise = Noise::new(1, 0);
        let mut search = CheapestPath::new(PLACES, INSTANTS, 2, 1);
        let mut reached = [0; INSTANTS + 1];
        for case in 0..600 {
            let maze = Maze::drawn(&mut noise);
            let (start, speed) = (case % PLACES, (case % 3).cast_signed() - 1);
            let least = brute_force(&maze, start, speed, 0);
            search.begin(start, speed);
            (0..INSTANTS).for_each(|_| search.advance(&maze));
            let mut path = [0; INSTANTS + 1];
            let last = search.trace(&mut path);
            reached[last] += 1;
            #[expect(clippy::cast_precision_loss, reason = "a few")]
            let ending = 10.0 * (INSTANTS - last) as f64;
            assert_eq!(path[0], start);
            let (mut sum, mut before) = (0.0, speed);
            for (k, ends) in path[..=last].windows(2).enumerate() {
                let step = ends[1].cast_signed() - ends[0].cast_signed();
                assert!((step - before).abs() <= 1 && !maze.closed[k][ends[0]][ends[1]]);
                let passed = ends[0].min(ends[1])..=ends[0].max(ends[1]);
                sum += passed.map(|place| maze.costs[k + 1][place]).fold(0.0, f64::max);
                sum += maze.cost_of_going(step.unsigned_abs());
                before = step;
            }
            assert!((sum + ending - least).abs() < 1e-12, "{sum} {last} {least}");
            assert!(path[last..].iter().all(|place| *place == path[last]));
        }
        assert!(reached[INSTANTS] > 100 && reached[..INSTANTS].iter().sum::<i32>() > 50);
    }
}
