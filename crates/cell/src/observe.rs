//! A record as an MTConnect agent would see it: positions now and then, at times that are not quite true.

use crate::sink::RecordSink;
use ledger::Event;
use machine::Sample;
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};
use units::{Seconds, Timestamp};

/// One observation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation {
    /// When, as the agent says.
    pub at: Timestamp,
    /// Position by the encoders, machine frame, mm.
    pub position: [f64; 3],
}

/// A sink that keeps one position of every interval, with jitter in its time stamp.
///
/// The time stamps jitter, the positions do not: an adapter reads the control, and stamps what it read a little later. Time stamps never
/// go back.
#[derive(Clone, Debug)]
pub struct Thinned {
    start: Timestamp,
    interval: u64,
    jitter: Seconds,
    dice: ChaCha8Rng,
    next: u64,
    /// What was seen.
    pub observations: Vec<Observation>,
}

impl Thinned {
    /// Observes every `interval` ticks (at least 1) a machine whose tick 0 was at `start`; time stamps are off by up to `jitter` either way.
    pub fn new(start: Timestamp, interval: u64, jitter: Seconds, seed: u64) -> Self {
        Thinned {
            start,
            interval: interval.max(1),
            jitter: if jitter.0 > 0.0 { jitter } else { Seconds::ZERO },
            dice: ChaCha8Rng::seed_from_u64(seed),
            next: 0,
            observations: Vec::new(),
        }
    }
}

impl RecordSink for Thinned {
    fn sample(&mut self, sample: &Sample) {
        if sample.tick.0 < self.next {
            return;
        }
        self.next = (sample.tick.0 / self.interval + 1) * self.interval;
        // -1 to 1 in steps of 2^-52.
        let share = (self.dice.next_u64() >> 11) as f64 / (1u64 << 52) as f64 - 1.0;
        let stamped = self.start.at(sample.tick) + self.jitter * share;
        let earliest = self.observations.last().map_or(stamped, |last| Timestamp(last.at.0 + 1));
        self.observations.push(Observation {
            at: stamped.max(earliest),
            position: sample.actual,
        });
    }

    fn event(&mut self, _event: &Event) {}
}

#[cfg(test)]
mod tests {
    use super::*;
    use units::Tick;

    fn observed(interval: u64, jitter: f64, seed: u64) -> Vec<Observation> {
        let mut thinned = Thinned::new(Timestamp(0), interval, Seconds(jitter), seed);
        for n in 0..1000 {
            thinned.sample(&Sample {
                tick: Tick(n),
                actual: [n as f64, 0.0, 0.0],
                ..Sample::default()
            });
        }
        thinned.observations
    }

    #[test]
    fn without_jitter_it_is_every_interval_exactly() {
        let seen = observed(100, 0.0, 1);
        let times: Vec<i64> = seen.iter().map(|o| o.at.0 / 1_000_000).collect();
        assert_eq!(times, (0..10).map(|k| k * 100).collect::<Vec<_>>());
        assert_eq!(seen[3].position[0], 300.0);
    }

    #[test]
    fn jitter_moves_time_stamps_within_its_bounds_and_never_backwards() {
        for seed in 0..50 {
            let seen = observed(10, 0.02, seed);
            assert!(seen.windows(2).all(|o| o[0].at < o[1].at), "seed {seed}");
            assert!(seen.iter().any(|o| o.at.0 % 1_000_000 != 0));
            for o in &seen {
                let off = o.at.since(Timestamp(o.position[0] as i64 * 1_000_000)).0;
                assert!(off.abs() < 0.04, "seed {seed}: {off}");
            }
        }
        assert_eq!(observed(10, 0.02, 3), observed(10, 0.02, 3));
    }
}
