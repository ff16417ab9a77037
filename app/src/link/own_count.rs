//! A run's own count of cycles, and of what was counted in them: it begins with the run's first report, and goes on when the controller was
//! started again in the middle, whose own count began anew then.

use machine::{Counters, Report};
use std::time::Instant;
use units::Tick;

/// Counts for one run.
#[derive(Clone, Debug, Default)]
pub struct OwnCount {
    /// What a cycle of the controller is more than one of the run.
    ahead: i128,
    /// What the controller had counted before.
    before: Counters,
    /// What controllers before the present one have counted for this run.
    carried: Counters,
    /// The last report as it came, as it was given, and when.
    last: Option<(Report, Report, Instant)>,
}

impl OwnCount {
    /// A report of the controller as one of the run, which came at `at`.
    pub fn report(&mut self, told: Report, at: Instant) -> Report {
        match self.last {
            None => {
                self.ahead = i128::from(told.sample.tick.0);
                self.before = told.counters;
            }
            Some((last, own, when)) if told.sample.tick < last.sample.tick => {
                // It was away for as long as the clock says: rows of the record have their time.
                let away = at.saturating_duration_since(when).as_millis().max(1);
                let away = i128::try_from(away).unwrap_or(i128::MAX / 4);
                self.ahead = i128::from(told.sample.tick.0) - i128::from(own.sample.tick.0) - away;
                (self.before, self.carried) = (Counters::default(), own.counters);
            }
            Some(_) => {}
        }
        let mut own = told;
        own.sample.tick = self.tick(told.sample.tick);
        // `completed` is the link's own account of this plan.
        own.counters = each(&told.counters, &self.before, &self.carried, |now, before, carried| {
            now.saturating_sub(before) + carried
        });
        own.counters.completed = told.counters.completed;
        self.last = Some((told, own, at));
        own
    }

    /// The newest report, as one of the run.
    pub fn newest(&self) -> Option<Report> {
        self.last.map(|(_, own, _)| own)
    }

    /// A cycle of the controller as one of the run; what was before it is its first.
    pub fn tick(&self, tick: Tick) -> Tick {
        Tick(u64::try_from(i128::from(tick.0) - self.ahead).unwrap_or(0))
    }
}

/// A counter that does not stand here does not compile.
fn each(a: &Counters, b: &Counters, c: &Counters, of: impl Fn(u64, u64, u64) -> u64) -> Counters {
    macro_rules! of_each {
        ($($name:ident),* $(,)?) => { Counters { $($name: of(a.$name, b.$name, c.$name)),* } };
    }
    of_each!(
        accepted,
        completed,
        discarded,
        late_ticks,
        late_gaps,
        starved_ticks,
        starvations,
        off_path_stops,
        bridged_readings,
        following_warnings,
        in_position_time_outs,
        spindle_limited,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use machine::{MachineParameters, Plant, Quality, RealtimeHalf};
    use std::time::Duration;
    use units::Point;

    /// A report of a cycle, as a machine without power gives it, with so many late cycles so far.
    fn told(tick: u64, late_ticks: u64) -> Report {
        let parameters = MachineParameters::small_machining_centre();
        let plant = Plant::new(&parameters, Point::ORIGIN, 1);
        let mut half = Box::new(RealtimeHalf::new(&parameters, plant, Quality::Simulated));
        half.tick(Tick(tick));
        let mut report = half.report().expect("a report each cycle");
        report.counters.late_ticks = late_ticks;
        report
    }

    #[test]
    fn cycles_of_a_run_go_on_over_a_controller_that_was_started_again() {
        let mut own = OwnCount::default();
        let began = Instant::now();
        let mut heard = |tick, late, after_ms| {
            let report = own.report(told(tick, late), began + Duration::from_millis(after_ms));
            (report.sample.tick.0, report.counters.late_ticks)
        };
        assert_eq!(heard(7000, 30, 0), (0, 0), "what was before is not its own");
        assert_eq!(heard(7001, 30, 1), (1, 0));
        assert_eq!(heard(9000, 42, 2000), (2000, 12));
        // Three seconds later another process answers, whose count has begun anew.
        assert_eq!(heard(50, 2, 5000), (5000, 14));
        assert_eq!(heard(51, 2, 5001), (5001, 14));
        assert_eq!(heard(60, 5, 5010), (5010, 17));
        // And once more, at once.
        assert_eq!(heard(0, 0, 5010), (5011, 17));
        assert_eq!(own.tick(Tick(3)), Tick(5014), "firings are counted alike");
    }
}
