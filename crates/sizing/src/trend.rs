//! What several sizes tell together: how fast the tool wears, how many parts are left until a limit, and marks of well-known rules.
//!
//! A size jumps with every correction, so wear is looked for in the size that would have been made with the register at 0: the measured
//! size less what the register did. That line is straight as long as the tool wears evenly.

use crate::Dimension;
use serde::Serialize;
use units::Millimetres;

/// One measured size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sized {
    /// The number of its entry.
    pub entry: u64,
    /// The number of the part.
    pub part: f64,
    /// What was measured.
    pub measured: Millimetres,
    /// What stood in the register while it was cut, mm.
    pub register: f64,
}

/// What the last sizes say about the next parts.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case", tag = "outlook")]
pub enum Outlook {
    /// Too few sizes to say anything.
    NotEnough {
        /// How many there are since the tool was new.
        have: usize,
        /// How many it takes.
        need: usize,
    },
    /// No wear can be told from the scatter.
    NoTrend {
        /// Change of the size with each part, mm; derived.
        slope_mm: f64,
        /// Its standard error.
        slope_error_mm: f64,
        /// Scatter about the line, rms, mm.
        scatter_mm: f64,
    },
    /// The size moves towards a limit.
    Wears {
        /// Change of the size with each part, mm; derived.
        slope_mm: f64,
        /// Its standard error.
        slope_error_mm: f64,
        /// Scatter about the line, rms, mm.
        scatter_mm: f64,
        /// The limit that comes nearer, mm.
        limit_mm: f64,
        /// Parts until the limit, most likely; 0 when it is passed.
        parts: u64,
        /// At the earliest, with twice the standard error.
        earliest: u64,
        /// At the latest; `None` when it may never come.
        latest: Option<u64>,
    },
}

/// Fewer points than this draw any line.
pub const NEEDED: usize = 5;

/// Looks at the last `last` sizes, which are in order; `register` is what stands in the register now.
pub fn outlook(dimension: &Dimension, sizes: &[Sized], last: usize, register: f64) -> Outlook {
    let sizes = &sizes[sizes.len().saturating_sub(last.max(NEEDED))..];
    let gain = dimension.response.size_per_register();
    let n = sizes.len() as f64;
    let mean = |of: &dyn Fn(&Sized) -> f64| sizes.iter().map(of).sum::<f64>() / n;
    let bare = |s: &Sized| s.measured.0 - gain * s.register;
    let (mean_part, mean_size) = (mean(&|s| s.part), mean(&bare));
    let spread: f64 = sizes.iter().map(|s| (s.part - mean_part) * (s.part - mean_part)).sum();
    if sizes.len() < NEEDED || spread <= 0.0 {
        return Outlook::NotEnough {
            have: sizes.len(),
            need: NEEDED,
        };
    }
    let slope = sizes
        .iter()
        .map(|s| (s.part - mean_part) * (bare(s) - mean_size))
        .sum::<f64>()
        / spread;
    let rest = |s: &Sized| bare(s) - mean_size - slope * (s.part - mean_part);
    let scatter = libm::sqrt(sizes.iter().map(|s| rest(s) * rest(s)).sum::<f64>() / (n - 2.0));
    let slope_error = scatter / libm::sqrt(spread);
    let told = (slope, slope_error, scatter);
    // Twice the standard error: one in twenty such lines is no trend.
    if slope.abs() <= 2.0 * slope_error || slope.abs() < 1e-9 {
        let (slope_mm, slope_error_mm, scatter_mm) = told;
        return Outlook::NoTrend {
            slope_mm,
            slope_error_mm,
            scatter_mm,
        };
    }
    let limit = if slope > 0.0 { dimension.high } else { dimension.low };
    let now = sizes.last().map_or(mean_part, |s| s.part);
    // The line turns about the middle of its points.
    let parts_at = |slope: f64| ((limit.0 - gain * register - mean_size) / slope + mean_part - now).max(0.0);
    let whole = |parts: f64| libm::floor(parts.min(1e9)) as u64;
    let slowest = slope.abs() - 2.0 * slope_error;
    let (slope_mm, slope_error_mm, scatter_mm) = told;
    Outlook::Wears {
        slope_mm,
        slope_error_mm,
        scatter_mm,
        limit_mm: limit.0,
        parts: whole(parts_at(slope)),
        earliest: whole(parts_at(slope + 2.0 * slope_error * slope.signum())),
        latest: (slowest > 1e-9).then(|| whole(parts_at(slowest * slope.signum()))),
    }
}

impl Outlook {
    /// In words, for a person.
    pub fn words(&self, dimension: &Dimension) -> String {
        match self {
            Outlook::NotEnough { have, need } => format!("trend: not enough sizes yet, {have} of {need}"),
            Outlook::NoTrend { scatter_mm, .. } => {
                format!(
                    "trend: none to be told from a scatter of {}",
                    dimension.unit.words(Millimetres(*scatter_mm))
                )
            }
            Outlook::Wears {
                slope_mm,
                limit_mm,
                parts,
                earliest,
                latest,
                ..
            } => {
                let latest = latest.map_or("never".to_owned(), |l| l.to_string());
                let limit = dimension.unit.words(Millimetres(*limit_mm));
                let hundred = dimension.unit.words(Millimetres(slope_mm * 100.0));
                format!("trend: {hundred} in 100 parts; limit {limit} in about {parts} parts ({earliest} to {latest})")
            }
        }
    }
}

/// A rule that a size completes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Rule {
    /// It is beyond a limit.
    BeyondLimit,
    /// Six in a row, each larger than the one before.
    SixRising,
    /// Six in a row, each smaller than the one before.
    SixFalling,
    /// Two of three on the same side, beyond two thirds of the way from the middle of the band to the limit.
    TwoOfThree,
    /// Seven in a row on one side of the middle of the band.
    SevenOnOneSide,
}

impl Rule {
    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Rule::BeyondLimit => "beyond the limit",
            Rule::SixRising => "six rising",
            Rule::SixFalling => "six falling",
            Rule::TwoOfThree => "two of three beyond two thirds of the band",
            Rule::SevenOnOneSide => "seven on one side of the middle",
        }
    }
}

/// The rules that each size completes, by the number of its entry, in order.
pub fn marks(dimension: &Dimension, sizes: &[Sized]) -> Vec<(u64, Rule)> {
    let middle = (dimension.low.0 + dimension.high.0) / 2.0;
    let half = (dimension.high.0 - dimension.low.0) / 2.0;
    let off: Vec<f64> = sizes.iter().map(|s| s.measured.0 - middle).collect();
    let last = |k: usize, count: usize| (k + 1 >= count).then(|| &off[k + 1 - count..=k]);
    let mut marks = Vec::new();
    for (k, size) in sizes.iter().enumerate() {
        let here = off[k];
        let mut mark = |rule, is: bool| {
            if is {
                marks.push((size.entry, rule));
            }
        };
        mark(
            Rule::BeyondLimit,
            size.measured < dimension.low || size.measured > dimension.high,
        );
        let six = last(k, 6).unwrap_or_default();
        let runs = |rises: fn(f64, f64) -> bool| six.len() == 6 && six.windows(2).all(|w| rises(w[0], w[1]));
        mark(Rule::SixRising, runs(|a, b| b > a));
        mark(Rule::SixFalling, runs(|a, b| b < a));
        let far = |o: f64| o.abs() > half * 2.0 / 3.0 && o.signum() == here.signum();
        let three = last(k, 3).unwrap_or_default();
        mark(Rule::TwoOfThree, far(here) && three.iter().filter(|o| far(**o)).count() >= 2);
        let seven = last(k, 7).unwrap_or_default();
        let same_side = |o: &f64| o.signum() == here.signum() && *o != 0.0;
        mark(Rule::SevenOnOneSide, seven.len() == 7 && seven.iter().all(same_side));
    }
    marks
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dimension::tests::published;

    /// A diameter of 82 mm within 0.05, and sizes at parts 0, 5, 10 ... off the middle by so much with the register at 0.
    fn case(off: &[f64]) -> (Dimension, Vec<Sized>) {
        let dimension = Dimension {
            low: Millimetres(81.95),
            high: Millimetres(82.05),
            ..published()
        };
        let size = |(k, off): (usize, &f64)| Sized {
            entry: k as u64 + 1,
            part: 5.0 * k as f64,
            measured: Millimetres(82.0 + off),
            register: 0.0,
        };
        (dimension, off.iter().enumerate().map(size).collect())
    }

    #[test]
    fn steady_wear_tells_the_parts_until_the_limit() {
        let (dimension, sizes) = case(&[0.0, 0.0051, 0.0099, 0.0151, 0.0199]);
        let Outlook::Wears {
            slope_mm,
            parts,
            earliest,
            latest,
            limit_mm,
            ..
        } = outlook(&dimension, &sizes, 30, 0.0)
        else {
            panic!("it wears")
        };
        assert!((slope_mm - 0.001).abs() < 1e-5 && limit_mm == 82.05, "{slope_mm}");
        // From 82.02 to 82.05 at a thousandth a part.
        assert!((29..=31).contains(&parts), "{parts}");
        assert!(
            earliest <= parts && latest.is_some_and(|l| l >= parts),
            "{earliest} {latest:?}"
        );
        // A correction in force leaves room for more.
        let Outlook::Wears { parts: later, .. } = outlook(&dimension, &sizes, 30, -0.02) else {
            panic!("it wears")
        };
        assert_eq!(later, parts + 20);
    }

    #[test]
    fn a_correction_is_no_wear() {
        let (dimension, mut sizes) = case(&[0.0, 0.005, 0.010, -0.005, 0.0, 0.005]);
        for late in &mut sizes[3..] {
            late.register = -0.02;
        }
        let Outlook::Wears { slope_mm, .. } = outlook(&dimension, &sizes, 30, -0.02) else {
            panic!("it wears")
        };
        assert!((slope_mm - 0.001).abs() < 1e-9, "{slope_mm}");
    }

    #[test]
    fn few_sizes_and_mere_scatter_are_said_to_be_so() {
        let (dimension, sizes) = case(&[0.0, 0.01, 0.02, 0.03]);
        let few = outlook(&dimension, &sizes, 30, 0.0);
        assert_eq!(few, Outlook::NotEnough { have: 4, need: 5 });
        assert_eq!(few.words(&dimension), "trend: not enough sizes yet, 4 of 5");
        let (dimension, sizes) = case(&[0.01, -0.01, 0.012, -0.009, 0.008, -0.011]);
        assert!(matches!(outlook(&dimension, &sizes, 30, 0.0), Outlook::NoTrend { .. }));
        // The same part measured five times says nothing about wear.
        let same: Vec<Sized> = sizes.iter().map(|s| Sized { part: 3.0, ..*s }).collect();
        assert!(matches!(outlook(&dimension, &same, 30, 0.0), Outlook::NotEnough { .. }));
    }

    #[track_caller]
    fn check_marks(off: &[f64], expected: &[(u64, Rule)]) {
        let (dimension, sizes) = case(off);
        assert_eq!(marks(&dimension, &sizes), expected, "{off:?}");
    }

    #[test]
    fn rules_mark_the_size_that_completes_them() {
        check_marks(&[0.0, 0.051, 0.0], &[(2, Rule::BeyondLimit)]);
        check_marks(&[-0.02, -0.01, 0.0, 0.001, 0.002, 0.003], &[(6, Rule::SixRising)]);
        check_marks(&[0.02, 0.01, 0.0, -0.001, -0.002, -0.003], &[(6, Rule::SixFalling)]);
        check_marks(&[0.04, 0.0, 0.035], &[(3, Rule::TwoOfThree)]);
        check_marks(&[0.04, 0.0, -0.035], &[]);
        check_marks(&[0.01, 0.02, 0.01, 0.02, 0.01, 0.02, 0.01], &[(7, Rule::SevenOnOneSide)]);
        check_marks(&[], &[]);
    }
}
