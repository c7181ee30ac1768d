//! The few with the smallest keys, of any number.

/// At most `N` of them, the smallest key first. Allocates nothing.
pub(crate) struct KSmallest<T, const N: usize> {
    kept: [(f64, T); N],
    count: usize,
}

impl<T: Copy, const N: usize> KSmallest<T, N> {
    /// None yet; `filler` is never given back.
    pub fn new(filler: T) -> Self {
        Self { kept: [(f64::INFINITY, filler); N], count: 0 }
    }

    /// Of equal keys the first comes first.
    pub fn add(&mut self, key: f64, value: T) {
        let at = self.kept[..self.count].partition_point(|kept| kept.0 <= key);
        if at < N {
            self.count = N.min(self.count + 1);
            self.kept[at..self.count].rotate_right(1);
            self.kept[at] = (key, value);
        }
    }

    /// Calls `visit` with all of them.
    pub fn for_each(&self, mut visit: impl FnMut(&T)) {
        self.kept[..self.count].iter().for_each(|(_, value)| visit(value));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    properties! {
        /// They are the first of all, sorted in the order in which they came where keys are equal.
        #[test]
        fn they_are_the_first_when_sorted(keys in prop::collection::vec(0u8..20, 0..40)) {
            let mut fewest = KSmallest::<usize, 8>::new(99);
            keys.iter().enumerate().for_each(|(i, key)| fewest.add(f64::from(*key), i));
            let mut sorted: Vec<usize> = (0..keys.len()).collect();
            sorted.sort_by_key(|i| keys[*i]);
            sorted.truncate(8);
            let mut found = vec![];
            fewest.for_each(|i| found.push(*i));
            prop_assert_eq!(found, sorted);
        }
    }
}
