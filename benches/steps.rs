//! Takes the first steps of a scenario and says nothing, for programs that count instructions:
//! `steps SCENARIO.toml COUNT`, see `benches/instructions.py`.

use std::hint::black_box;
use vff_core::scenario::Scenario;

fn main() {
    let mut arguments = std::env::args().skip(1);
    let mut next = |what| arguments.next().expect(what);
    let text = std::fs::read_to_string(next("a scenario")).expect("a file that can be read");
    let count = next("a number of steps").parse().expect("a whole number");
    let scenario = Scenario::from_toml(&text).expect("a scenario");
    let mut run = scenario.prepare().expect("a scenario that can be run").run;
    for step in 0..count {
        assert!(black_box(run.step()), "the run ends after {step} steps");
    }
}
