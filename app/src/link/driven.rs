//! What only a run in real time can tell of itself: how near the axes followed, how deep the buffer was, how late the machine, what became of
//! the link. The side that hears of every cycle watches: the driving side of the default link, the controller of the text protocol.

use machine::{Counters, Sample};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Where a record keeps it, as JSON in its metadata, when nobody but the controller can know it.
pub const METADATA_KEY: &str = "toolmark.driven";
/// Cycles at the end of a motion whose depth does not count: more than are ever under way.
const LAST_OF_MOTION: usize = 300;
/// Depths are counted up to here, ms: above what either link lets be under way.
const DEEPEST: usize = 1024;

/// What a run in real time tells.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Driven {
    /// What was spoken: `default`, or `text`.
    pub link: String,
    /// Where the controller is.
    pub controller: String,
    /// Largest distance of each axis from where it shall be, mm.
    pub following_error_max_mm: [f64; 3],
    /// Its root mean square while the axes move, mm.
    pub following_error_rms_mm: [f64; 3],
    /// Set-points on their way to the machine or in its queue while the path moved and was to move on, ms of motion: fewest; `None` when no
    /// motion was so long that it could tell.
    pub buffer_fewest_ms: Option<u64>,
    /// Half of the cycles in motion had no more; `None` when nothing moved.
    pub buffer_median_ms: Option<u64>,
    /// The mean of them.
    pub buffer_mean_ms: f64,
    /// Servo cycles that did not take place in time.
    pub late_ticks: u64,
    /// Times that happened.
    pub late_gaps: u64,
    /// Times set-points did not come in time.
    pub starvations: u64,
    /// Times this side was given the machine: once, and once more after each cut.
    pub leases: u64,
    /// Times the connection was cut.
    pub link_cuts: u64,
    /// Times the machine was led back onto the path.
    pub resumed: u64,
}

/// What a run over a link is known by, beside what is seen of its motion.
#[derive(Clone, Debug, Default)]
pub struct OnLink {
    /// What was spoken.
    pub link: &'static str,
    /// Where the controller is.
    pub controller: String,
    /// See [`Driven::leases`].
    pub leases: u64,
    /// See [`Driven::link_cuts`].
    pub cuts: u64,
    /// See [`Driven::resumed`].
    pub resumed: u64,
}

impl Driven {
    /// The buffer in words.
    pub fn buffer(&self) -> String {
        let known = |ms: Option<u64>| ms.map_or_else(|| "not known".to_owned(), |ms| format!("{ms} ms"));
        match (self.buffer_fewest_ms, self.buffer_median_ms) {
            (None, None) => "nothing moved".to_owned(),
            (fewest, median) => format!("{} at least, {} median", known(fewest), known(median)),
        }
    }

    /// Largest distance of any axis from where it shall be, mm.
    pub fn worst_following_error(&self) -> f64 {
        self.following_error_max_mm.iter().copied().fold(0.0, f64::max)
    }

    /// Late cycles in words.
    pub fn late(&self) -> String {
        match self.late_ticks {
            0 => "no late ticks".to_owned(),
            ticks => format!("{}, in {}", counted(ticks, "late tick"), counted(self.late_gaps, "gap")),
        }
    }

    /// What became of the link, in words.
    pub fn on_the_link(&self) -> String {
        let resumed = match self.resumed {
            0 => "not resumed".to_owned(),
            times => format!("resumed {}", counted(times, "time")),
        };
        format!(
            "{}, {}, {resumed}",
            counted(self.leases, "lease"),
            counted(self.link_cuts, "cut")
        )
    }

    /// Lines for people.
    pub fn lines(&self) -> [String; 2] {
        [
            format!(
                "driven over {} ({} link): following error at most {:.4} mm, buffer {}",
                self.controller,
                self.link,
                self.worst_following_error(),
                self.buffer()
            ),
            format!(
                "{}, {}; link: {}",
                self.late(),
                counted(self.starvations, "starvation"),
                self.on_the_link()
            ),
        ]
    }
}

/// `no gaps`, `1 gap`, `2 gaps`.
fn counted(count: u64, what: &str) -> String {
    match count {
        0 => format!("no {what}s"),
        1 => format!("1 {what}"),
        count => format!("{count} {what}s"),
    }
}

/// Looks on while a machine moves.
#[derive(Clone, Debug)]
pub struct Watched {
    following: [f64; 3],
    squares: [f64; 3],
    moving: u64,
    fewest: Option<u64>,
    /// Of the last cycles of the present motion: at its end the queue has to run empty, and that is no lack.
    recent: VecDeque<u64>,
    /// Cycles in motion by depth, the last with everything above.
    depths: Vec<u64>,
    sum: f64,
}

impl Default for Watched {
    fn default() -> Self {
        Watched {
            following: [0.0; 3],
            squares: [0.0; 3],
            moving: 0,
            fewest: None,
            recent: VecDeque::with_capacity(LAST_OF_MOTION + 1),
            depths: vec![0; DEEPEST + 1],
            sum: 0.0,
        }
    }
}

impl Watched {
    /// One cycle, in which the machine ran its path or not, with so many set-points under way.
    pub fn see(&mut self, sample: &Sample, runs: bool, depth: u64) {
        let moves = runs && sample.path_speed > 0.0;
        for k in 0..3 {
            let error = (sample.commanded[k] - sample.actual[k]).abs();
            self.following[k] = self.following[k].max(error);
            if moves {
                self.squares[k] += error * error;
            }
        }
        if !moves {
            self.recent.clear();
            return;
        }
        self.moving += 1;
        self.sum += depth as f64;
        self.depths[usize::try_from(depth).unwrap_or(DEEPEST).min(DEEPEST)] += 1;
        self.recent.push_back(depth);
        if self.recent.len() > LAST_OF_MOTION
            && let Some(before) = self.recent.pop_front()
        {
            self.fewest = Some(self.fewest.map_or(before, |fewest| fewest.min(before)));
        }
    }

    /// Largest distance of any axis from where it shall be so far, mm.
    pub fn worst_following_error(&self) -> f64 {
        self.following.iter().copied().fold(0.0, f64::max)
    }

    /// What it comes to.
    pub fn driven(&self, counters: &Counters, on: OnLink) -> Driven {
        let count = self.moving.max(1) as f64;
        Driven {
            link: on.link.to_owned(),
            controller: on.controller,
            following_error_max_mm: self.following,
            following_error_rms_mm: self.squares.map(|sum| (sum / count).sqrt()),
            buffer_fewest_ms: self.fewest,
            buffer_median_ms: self.median(),
            buffer_mean_ms: self.sum / count,
            late_ticks: counters.late_ticks,
            late_gaps: counters.late_gaps,
            starvations: counters.starvations,
            leases: on.leases,
            link_cuts: on.cuts,
            resumed: on.resumed,
        }
    }

    fn median(&self) -> Option<u64> {
        let half = self.moving.div_ceil(2);
        let mut seen = 0;
        let found = self.depths.iter().position(|count| {
            seen += count;
            half > 0 && seen >= half
        })?;
        u64::try_from(found).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// So many cycles in motion with these depths, one after another.
    fn watched(depths: impl IntoIterator<Item = u64>) -> Watched {
        let mut watched = Watched::default();
        let sample = Sample {
            path_speed: 10.0,
            commanded: [1.0, 2.0, 3.0],
            actual: [1.0, 2.5, 3.0],
            ..Sample::default()
        };
        for depth in depths {
            watched.see(&sample, true, depth);
        }
        watched
    }

    #[test]
    fn the_median_is_that_of_sorting_all_depths_and_the_end_of_a_motion_is_no_lack() {
        // A motion of a second: 200 under way, once 20, and at its end the queue runs empty.
        let depths = (0..1000).map(|k| match k {
            500 => 20,
            800.. => 999 - k,
            _ => 200,
        });
        let driven = watched(depths).driven(&Counters::default(), OnLink::default());
        assert_eq!((driven.buffer_fewest_ms, driven.buffer_median_ms), (Some(20), Some(200)));
        assert_eq!(driven.following_error_max_mm, [0.0, 0.5, 0.0]);
        assert!((driven.following_error_rms_mm[1] - 0.5).abs() < 1e-12);
        assert_eq!(driven.buffer(), "20 ms at least, 200 ms median");
    }

    #[test]
    fn what_did_not_move_has_no_buffer_and_depths_beyond_everything_are_counted() {
        let nothing = watched([]).driven(&Counters::default(), OnLink::default());
        assert_eq!((nothing.buffer_median_ms, nothing.buffer().as_str()), (None, "nothing moved"));
        let deep = watched([u64::MAX, 5000]).driven(&Counters::default(), OnLink::default());
        assert_eq!((deep.buffer_fewest_ms, deep.buffer_median_ms), (None, Some(1024)));
    }

    #[test]
    fn it_is_read_back_from_a_record_as_it_was_written() {
        let driven = Driven {
            link: "text".to_owned(),
            buffer_fewest_ms: Some(3),
            leases: 1,
            ..Driven::default()
        };
        let text = serde_json::to_string(&driven).expect("JSON");
        assert_eq!(serde_json::from_str::<Driven>(&text).expect("reads"), driven);
        assert_eq!(driven.on_the_link(), "1 lease, no cuts, not resumed");
    }
}
