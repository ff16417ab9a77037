//! Where the rows and the events of a run go: a file in the shell, a list in a test, a digest.

use ledger::{Event, Hash};
use machine::{CHANNELS, Sample};
use sha2::{Digest as _, Sha256};
use trace::record::{Row, Stream};

/// Takes a record as it is made.
///
/// The order of calls is the order of time: the sample of a tick, then the events of that tick. A sink that can fail keeps its failure
/// and tells it to its owner afterwards; a run is not stopped by it.
pub trait RecordSink {
    /// One servo cycle.
    fn sample(&mut self, sample: &Sample);

    /// Something that happened.
    fn event(&mut self, event: &Event);

    /// Where the slides of a simulated machine really were, mm, machine frame; called after [`RecordSink::sample`], by a simulator only.
    /// A real machine cannot know this. Nothing but the simulated gauge may use it.
    fn truth(&mut self, _sample: &Sample, _position: [f64; 3]) {}

    /// A value of a recording that a function of the program asked for.
    fn recorded(&mut self, _row: &Row, _stream: &Stream) {}
}

/// Keeps nothing.
impl RecordSink for () {
    fn sample(&mut self, _sample: &Sample) {}
    fn event(&mut self, _event: &Event) {}
}

/// Gives everything to several sinks, in order.
pub struct Tee<'a>(pub Vec<&'a mut dyn RecordSink>);

impl RecordSink for Tee<'_> {
    fn sample(&mut self, sample: &Sample) {
        self.0.iter_mut().for_each(|s| s.sample(sample));
    }
    fn event(&mut self, event: &Event) {
        self.0.iter_mut().for_each(|s| s.event(event));
    }
    fn truth(&mut self, sample: &Sample, position: [f64; 3]) {
        self.0.iter_mut().for_each(|s| s.truth(sample, position));
    }
    fn recorded(&mut self, row: &Row, stream: &Stream) {
        self.0.iter_mut().for_each(|s| s.recorded(row, stream));
    }
}

/// Keeps everything in memory, for tests and short runs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Kept {
    /// All rows.
    pub samples: Vec<Sample>,
    /// All events.
    pub events: Vec<Event>,
    /// All values of recordings, with the name of their stream.
    pub rows: Vec<(String, Row)>,
}

impl RecordSink for Kept {
    fn sample(&mut self, sample: &Sample) {
        self.samples.push(*sample);
    }
    fn event(&mut self, event: &Event) {
        self.events.push(event.clone());
    }
    fn recorded(&mut self, row: &Row, stream: &Stream) {
        self.rows.push((stream.name.clone(), *row));
    }
}

/// One hash over everything a run put out, in order: every row as the record keeps it, and every event.
#[derive(Clone, Debug, Default)]
pub struct RunDigest(Sha256);

impl RunDigest {
    /// The hash of everything so far.
    pub fn hash(&self) -> Hash {
        Hash(self.0.clone().finalize().into())
    }
}

impl RecordSink for RunDigest {
    fn sample(&mut self, sample: &Sample) {
        const FIXED: usize = 1 + 8 + 4 + 4 + 4 + 1 + 1;
        let mut row = [0u8; FIXED + 4 * CHANNELS.len()];
        let mut at = 0;
        let mut put = |bytes: &[u8]| {
            row[at..at + bytes.len()].copy_from_slice(bytes);
            at += bytes.len();
        };
        put(b"s");
        put(&sample.tick.0.to_le_bytes());
        put(&sample.step.0.to_le_bytes());
        put(&sample.workingstep.0.to_le_bytes());
        put(&sample.tool.0.to_le_bytes());
        put(&[sample.phase as u8, sample.quality as u8]);
        for channel in CHANNELS {
            put(&channel.quantise(sample).to_le_bytes());
        }
        self.0.update(row);
    }
    fn event(&mut self, event: &Event) {
        self.0.update(b"e");
        self.0.update(event.hash.as_bytes());
    }
    fn recorded(&mut self, row: &Row, _stream: &Stream) {
        self.0.update(b"r");
        self.0.update(row.tick.0.to_le_bytes());
        self.0.update(row.stream.to_le_bytes());
        self.0.update(row.value.unwrap_or(f64::NAN).to_le_bytes());
    }
}
