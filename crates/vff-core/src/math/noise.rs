//! Random numbers that come back the same.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rand_distr::{Distribution, StandardNormal};

/// The random numbers of one use: every use has a stream of its own, so that none depends on another.
///
/// # Example
/// ```
/// use vff_core::math::Noise;
///
/// assert_eq!(Noise::new(7, 0).draw(), Noise::new(7, 0).draw());
/// assert_ne!(Noise::new(7, 0).draw(), Noise::new(7, 1).draw());
/// assert!((0.0..1.0).contains(&Noise::new(7, 0).share()));
/// ```
#[derive(Debug, Clone)]
pub struct Noise(ChaCha8Rng);

impl Noise {
    /// The stream of this number.
    pub fn new(seed: u64, stream: u64) -> Self {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        generator.set_stream(stream);
        Self(generator)
    }

    /// A number of the standard normal distribution.
    pub fn draw(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }

    /// A number between 0 and 1, every one as likely.
    #[expect(clippy::cast_precision_loss, reason = "53 bits")]
    pub fn share(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }
}
