//! What the drives accept next, and how sharp a demand may be that they can still follow (T130–T134).
//!
//! A demand that changes faster than the torque may is followed too late, which makes the next demand larger: the arm
//! oscillates. So everything that asks for torque knows how long that torque takes to build up.

/// Where the next torque of the law may be, joint by joint. Nothing allocates after construction.
#[derive(Debug, Clone)]
pub struct TorqueRange {
    /// The least torque \[N·m, N\].
    pub lower: Vec<f64>,
    /// The largest torque \[N·m, N\].
    pub upper: Vec<f64>,
    /// The torque of the law that acts at present \[N·m, N\].
    pub present: Vec<f64>,
    /// How fast it may change \[N·m/s, N/s\].
    rate: Vec<f64>,
    /// Until it may change again \[s\].
    pub period: f64,
}

/// c in (T131): how much of the torque rate a barrier takes up at most, as the share 0.23 c² of it.
const SHARPNESS: f64 = 1.4;
/// w in (T131): the speed at which obstacles and links close in that barriers reckon with \[m/s\].
pub const CLOSING: f64 = 1.0;
/// Share of the torque rate that braking before a speed limit takes up (T132).
const BRAKING: f64 = 0.5;
/// In parts of j/k³: a height that is farther below 0 asks for no more than this one.
const DEEPEST: f64 = 0.3;

impl TorqueRange {
    /// For drives whose torque may change so fast \[N·m/s, N/s\], each.
    pub fn new(rate: Vec<f64>) -> Self {
        let zeros = || vec![0.0; rate.len()];
        Self { lower: zeros(), upper: zeros(), present: zeros(), rate, period: 0.0 }
    }

    /// How long the drives take to build up `tau` \[s\].
    pub fn build_up(&self, tau: &[f64]) -> f64 {
        tau.iter().zip(&self.rate).fold(0.0, |most, (tau, rate)| most.max(tau.abs() / rate))
    }

    /// j = Jₕ M⁻¹ Jₕᵀ minᵢ rᵢ/|Jₕᵢ|, how fast a force along its own gradient can change ḧ (T130); `response` is M⁻¹Jₕᵀ.
    pub fn jerk(&self, gradient: &[f64], response: &[f64]) -> f64 {
        let mobility: f64 = gradient.iter().zip(response).map(|(g, y)| g * y).sum();
        let slowest = self.build_up(gradient);
        if slowest > 0.0 { mobility / slowest } else { 0.0 }
    }

    /// The least ḧ after this period for a height h that is to stay positive, of which `now` is \[h, ḣ, ḧ\], where ḧ can
    /// be changed by `jerk` and ḣ is −`closing` at worst (T131). The pole is `fastest` \[1/s\] at most.
    pub fn least_acceleration(&self, now: [f64; 3], jerk: f64, closing: f64, fastest: f64) -> f64 {
        let [h, dh, ddh] = now;
        let k = (tune(0, SHARPNESS) * (jerk / (closing * tune(1, 1.0))).sqrt())
            .min(fastest)
            .min(1.0 / (3.0 * self.period));
        let h = h.max(-DEEPEST * jerk / (k * k * k));
        ddh - self.period * k * (3.0 * ddh + k * (3.0 * dh + k * h))
    }

    /// The largest acceleration with `left` to go to the largest speed: in proportion near it, and farther away as much
    /// as can be taken back at a share of `jerk` (T132).
    pub fn most_acceleration(left: f64, jerk: f64, rate: f64) -> f64 {
        let jerk = tune(2, BRAKING) * jerk;
        let near = jerk / (rate * rate);
        match left.abs() {
            distance if distance <= near => rate * left,
            distance => (2.0 * jerk * (distance - 0.5 * near)).sqrt().copysign(left),
        }
    }
}

/// TEMPORARY
pub fn tune(i: usize, d: f64) -> f64 {
    static V: std::sync::OnceLock<Vec<Option<f64>>> = std::sync::OnceLock::new();
    V.get_or_init(|| {
        std::env::var("TR").unwrap_or_default().split(',').map(|x| x.parse().ok()).collect()
    })
    .get(i)
    .copied()
    .flatten()
    .unwrap_or(d)
}
