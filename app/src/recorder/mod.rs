//! Where recorded observations go: a [`Sink`] for each form, and the loop that feeds it from an agent.
//!
//! A sink tells how far it has come ([`Sink::kept`]); when the disk refuses, the agent is asked again from there, and what it no longer
//! has by then is a gap in the recording like any other.

pub mod observations;
pub mod segments;
pub mod session;
pub mod store;
pub mod text;

use mtconnect::client::document::Told;
use mtconnect::client::gap::Gap;
use mtconnect::client::items::Items;
use mtconnect::client::session::Position;
use plan::Diagnostic;
use units::Timestamp;

/// Why a sink does not go on.
#[derive(Debug)]
pub enum Refused {
    /// The disk refuses: the sink is as it was before, and may be tried again.
    Disk(String),
    /// There is no use in trying again.
    Never(crate::failure::Failure),
}

impl Refused {
    /// As the end of a command.
    pub fn into_failure(self) -> crate::failure::Failure {
        match self {
            Refused::Disk(why) => crate::failure::Failure::machine(why),
            Refused::Never(failure) => failure,
        }
    }
}

/// Takes observations and keeps them.
pub trait Sink {
    /// Where the recording goes on, when there is one already.
    fn kept(&self) -> Option<Position>;

    /// Keeps observations, in order.
    ///
    /// # Errors
    /// None of them is kept then.
    fn observations(&mut self, told: &[Told], items: &Items) -> Result<(), Refused>;

    /// Keeps a gap.
    ///
    /// # Errors
    /// It is not kept then.
    fn gap(&mut self, gap: &Gap) -> Result<(), Refused>;

    /// The agent has told everything up to there.
    ///
    /// # Errors
    /// What waited for more could not be kept.
    fn reached(&mut self, position: Position) -> Result<(), Refused>;

    /// Nothing comes at the moment.
    ///
    /// # Errors
    /// What waited for more could not be kept.
    fn rest(&mut self) -> Result<(), Refused>;

    /// Puts on the medium what was kept: acknowledged is what [`Sink::kept`] says afterwards.
    ///
    /// # Errors
    /// The disk refuses; the sink is as it was after the last time.
    fn sync(&mut self) -> Result<(), Refused>;

    /// Ends the recording.
    ///
    /// # Errors
    /// The disk refuses.
    fn close(&mut self, now: Timestamp) -> Result<(), Refused>;

    /// What was kept since the sink was opened.
    fn tally(&self) -> &Tally;

    /// What was odd.
    fn remarks(&self) -> &[Diagnostic] {
        &[]
    }
}

/// What a sink kept since it was opened.
#[derive(Clone, Debug, Default)]
pub struct Tally {
    /// Observations.
    pub observations: u64,
    /// Bytes written.
    pub bytes: u64,
    /// The first observation's number.
    pub first_sequence: Option<u64>,
    /// The last one's.
    pub last_sequence: Option<u64>,
    /// Time of the last one.
    pub last: Option<Timestamp>,
    /// Starts of the agent, in order.
    pub instances: Vec<u64>,
    /// What is missing.
    pub gaps: Vec<Gap>,
}

impl Tally {
    /// Counts an observation.
    pub fn count(&mut self, instance: u64, sequence: u64, at: Timestamp) {
        self.observations += 1;
        self.first_sequence.get_or_insert(sequence);
        self.last_sequence = Some(sequence);
        self.last = Some(at);
        if self.instances.last() != Some(&instance) {
            self.instances.push(instance);
        }
    }
}
