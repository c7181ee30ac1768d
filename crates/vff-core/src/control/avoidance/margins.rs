//! What barriers keep: the margin of the settings, or along a plan no more than that is known to keep (T151).

use crate::control::Yielding;
use crate::control::distance::DistanceRate;
use crate::trajectory::{JointSpline, Pace};
use crate::world::Contact;

/// What bodies of the arm are kept apart \[m\]: little, because shapes that are fitted to links contain more than these.
const OWN: f64 = 0.005;

/// The same along a plan that says what it keeps \[m\]: plans are certified to keep that.
pub const OWN_ALONG_PLAN: f64 = 0.001;

/// What each link keeps from obstacles, how that changes, and what bodies of the arm keep from each other.
#[derive(Debug, Clone)]
pub struct Margins {
    usual: f64,
    /// Value, rate and change of the rate \[m, m/s, m/s²\]; behind these, in parts of margins of their own.
    of_links: Vec<[f64; 3]>,
    /// \[m\]
    own: f64,
    /// How much of it a plan says, from 0 to 1.
    by_plan: f64,
    /// Whether all of this is what the settings ask for.
    is_usual: bool,
}

impl Margins {
    /// Those of `settings`, for `n` links.
    pub fn new(n: usize, settings: &Yielding) -> Self {
        let (usual, of_links) = (settings.margin, vec![[0.0; 3]; 2 * n]);
        let mut this = Self { usual, of_links, own: OWN, by_plan: 0.0, is_usual: false };
        this.go_to(None);
        this
    }

    /// Goes to where a plan is at `pace`; without one, or where it says nothing, to those of the settings.
    pub fn go_to(&mut self, plan: Option<(&JointSpline, &Pace)>) {
        if plan.is_none() && self.is_usual {
            return;
        }
        self.is_usual = plan.is_none();
        if let Some((joints, pace)) = plan
            && let Some(kept) = joints.margins()
        {
            self.by_plan = kept.share(pace.time);
            kept.at(pace, self.usual, &mut self.of_links);
            self.own = OWN_ALONG_PLAN + (1.0 - self.by_plan) * (OWN - OWN_ALONG_PLAN);
        } else {
            self.by_plan = f64::from(plan.is_some());
            let n = self.of_links.len() / 2;
            let (usual, own) = self.of_links.split_at_mut(n);
            usual.fill([self.usual, 0.0, 0.0]);
            own.fill([1.0, 0.0, 0.0]);
            self.own = OWN;
        }
    }

    /// How far a pair is above what it keeps \[m\], and how that changes.
    #[inline]
    pub fn above<const D: usize>(
        &self,
        pair: &Contact<D>,
        motion: DistanceRate,
    ) -> (f64, DistanceRate) {
        let [margin, rate, change] = match pair.margin.of_its_own() {
            None => self.of_links[pair.link],
            Some(own) => {
                self.of_links[self.of_links.len() / 2 + pair.link].map(|share| share * own)
            }
        };
        let motion = DistanceRate { rate: motion.rate - rate, bias: motion.bias - change };
        (pair.distance - margin, motion)
    }

    /// How much a plan is followed that knows what rests around it, from 0 to 1.
    #[inline]
    pub fn by_plan(&self) -> f64 {
        self.by_plan
    }

    /// What is kept usually \[m\].
    #[inline]
    pub fn usual(&self) -> f64 {
        self.usual
    }

    /// What links keep from obstacles at most \[m\], and of margins of their own, reckoned on as barriers of this `rate` \[1/s\] do.
    pub fn most(&self, rate: f64) -> [f64; 2] {
        let ahead = |[margin, speed, _]: &[f64; 3]| margin + 2.0 * speed / rate;
        let (usual, own) = self.of_links.split_at(self.of_links.len() / 2);
        [usual, own].map(|kept| kept.iter().map(ahead).fold(f64::NEG_INFINITY, f64::max))
    }

    /// What bodies of the arm keep from each other \[m\].
    #[inline]
    pub fn own(&self) -> f64 {
        self.own
    }
}
