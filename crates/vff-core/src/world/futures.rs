//! How likely possible futures are, all together (T204).

use super::{Description, ObstacleGeometry, Placed};
use crate::interrupt;
use crate::math::sort_by_first;
use std::collections::HashMap;

/// Takes in of every possible future how likely it is that it or one that is no likelier comes true.
pub fn weigh<S: ObstacleGeometry<D>, const D: usize>(obstacles: &mut [Placed<S, D>]) {
    if !obstacles.iter().any(Placed::is_future) {
        return;
    }
    let said: Vec<_> = (obstacles.iter())
        .map(|it| (it.description.likelihood(), it.description.future()))
        .collect();
    let found = likelihoods_up_to(&said);
    obstacles.iter_mut().zip(found).for_each(|(it, found)| it.likelihood_up_to = found);
}

/// The same of what obstacles say, `(likelihood, name)`. Parts of a future count once, as the likeliest; of two that are as likely the first
/// counts as less so.
fn likelihoods_up_to(said: &[(Option<f64>, Option<&str>)]) -> Vec<Option<f64>> {
    interrupt::checkpoint(16 * said.len());
    // Of each the first part, by which it is known, and how likely the likeliest is.
    let mut named = HashMap::new();
    let first = |(j, (likelihood, name)): (usize, &(Option<f64>, Option<_>))| {
        likelihood.map(|_| name.map_or(j, |name| *named.entry(name).or_insert(j)))
    };
    let first_of: Vec<Option<usize>> = said.iter().enumerate().map(first).collect();
    let mut likeliest: Vec<(f64, usize)> = (0..said.len()).map(|j| (0.0, j)).collect();
    for (first, (likelihood, _)) in first_of.iter().zip(said) {
        if let (Some(first), Some(likelihood)) = (first, likelihood) {
            likeliest[*first].0 = likelihood.max(likeliest[*first].0);
        }
    }
    sort_by_first(&mut likeliest);
    let (mut sum, mut sums) = (0.0, vec![0.0; said.len()]);
    for (likelihood, first) in likeliest {
        sum += likelihood;
        sums[first] = sum;
    }
    first_of.into_iter().map(|first| first.map(|first| sums[first])).collect()
}
