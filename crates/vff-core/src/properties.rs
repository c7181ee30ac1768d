//! Random tests whose cases are of one type, whatever is drawn: what draws, runs and shrinks them is compiled once instead of once for each test,
//! which was an eighth of the largest program that there is to compile.

use proptest::strategy::BoxedStrategy;
use proptest::test_runner::{Config, TestCaseResult, TestRunner, contextualize_config};
use std::fmt::{self, Debug, Formatter};

/// What `proptest!` makes of tests of this form.
macro_rules! properties {
    (#![proptest_config($config:expr)] $(
        $(#[$meta:meta])*
        fn $name:ident($($given:pat in $strategy:expr),+ $(,)?) $body:block
    )*) => {$(
        $(#[$meta])*
        fn $name() {
            let cases = proptest::strategy::Strategy::prop_map(($($strategy,)+), |values| {
                let names = stringify!(($($given),+));
                $crate::properties::Case::new(values, names, |($($given,)+)| {
                    let () = $body;
                    Ok(())
                })
            });
            let name = concat!(module_path!(), "::", stringify!($name));
            $crate::properties::run($config, [file!(), name], &proptest::strategy::Strategy::boxed(cases));
        }
    )*};
    ($($tests:tt)*) => {
        properties! { #![proptest_config(proptest::test_runner::Config::default())] $($tests)* }
    };
}

/// What has been drawn, and what it is for.
pub struct Case(Box<dyn Tested>);

trait Tested {
    fn test(self: Box<Self>) -> TestCaseResult;
    fn show(&self, f: &mut Formatter<'_>) -> fmt::Result;
}

struct Drawn<T> {
    values: T,
    names: &'static str,
    body: fn(T) -> TestCaseResult,
}

impl<T: Debug> Tested for Drawn<T> {
    fn test(self: Box<Self>) -> TestCaseResult {
        (self.body)(self.values)
    }

    fn show(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{} = {:?}", self.names, self.values)
    }
}

impl Case {
    pub fn new<T: Debug + 'static>(
        values: T,
        names: &'static str,
        body: fn(T) -> TestCaseResult,
    ) -> Self {
        Self(Box::new(Drawn { values, names, body }))
    }
}

impl Debug for Case {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        self.0.show(f)
    }
}

/// Runs a test of a file, after the cases that have failed before.
pub fn run(config: Config, [file, name]: [&'static str; 2], cases: &BoxedStrategy<Case>) {
    let mut config = contextualize_config(config);
    (config.source_file, config.test_name) = (Some(file), Some(name));
    let mut runner = TestRunner::new(config);
    if let Err(error) = runner.run(cases, |case| case.0.test()) {
        panic!("{error}\n{runner}");
    }
}

mod tests {
    use std::panic::catch_unwind;

    properties! {
        #![proptest_config(super::Config { failure_persistence: None, ..super::Config::with_cases(100) })]
        fn numbers_are_small(x in 0..1000_u32, [_, y] in [0..10_u32, 0..10]) {
            proptest::prop_assert!(x < 500, "{y}");
        }
    }

    #[test]
    fn what_fails_is_told_as_small_as_it_is() {
        let told = catch_unwind(numbers_are_small).unwrap_err();
        let told = told.downcast_ref::<String>().unwrap();
        assert!(told.contains("minimal failing input: (x, [_, y]) = (500, [0, 0])"), "{told}");
    }
}
