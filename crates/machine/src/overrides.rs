//! Feed, rapid and spindle override: what a person turns while a program runs.

/// The three overrides, in percent of what is programmed, 0 to 200.
///
/// Whole percents, as the switches of a machine have them: there is no override that is not a number, and a log can say what was set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Overrides {
    /// Of feeds; 0 stands on the path.
    pub feed: u8,
    /// Of rapids; 0 stands on the path, above 100 is 100.
    pub rapid: u8,
    /// Of the spindle; usual is 50 to 120.
    pub spindle: u8,
}

/// The highest override, percent.
pub const HIGHEST_OVERRIDE: u8 = 200;

impl Default for Overrides {
    /// As programmed.
    fn default() -> Self {
        Overrides {
            feed: 100,
            rapid: 100,
            spindle: 100,
        }
    }
}

impl Overrides {
    /// The same within what there is: at most 200 %, rapids at most 100 %.
    pub fn limited(self) -> Self {
        Overrides {
            feed: self.feed.min(HIGHEST_OVERRIDE),
            rapid: self.rapid.min(100),
            spindle: self.spindle.min(HIGHEST_OVERRIDE),
        }
    }

    /// Of feeds, 1 is 100 %.
    pub fn feed_fraction(self) -> f64 {
        f64::from(self.feed) / 100.0
    }

    /// Of rapids, 1 is 100 %.
    pub fn rapid_fraction(self) -> f64 {
        f64::from(self.rapid) / 100.0
    }

    /// Of the spindle, 1 is 100 %.
    pub fn spindle_fraction(self) -> f64 {
        f64::from(self.spindle) / 100.0
    }
}
