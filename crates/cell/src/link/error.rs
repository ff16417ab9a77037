//! Why a connection is given up.

use machine::link::{FrameError, LimitsHash, Refusal, WireError};

/// Why a connection is given up. All but those of which [`LinkError::is_final`] is true are over with the next connection.
#[derive(Clone, Debug, PartialEq)]
pub enum LinkError {
    /// What came is no frame.
    Frame(FrameError),
    /// A frame whose content is not what its kind says.
    Content {
        /// Where the frame begins, bytes from the start of the connection.
        offset: u64,
        /// What is wrong in it.
        error: WireError,
    },
    /// A frame is missing.
    Gap {
        /// The sequence that was to come.
        expected: u32,
        /// The one that came.
        found: u32,
    },
    /// Whole and in order, and against the rules of the link.
    Rules(&'static str),
    /// The controller does not take this sender.
    Refused(Refusal),
    /// The machine has other limits than the plan was made for.
    Limits {
        /// Its name.
        machine: String,
        /// Its limits.
        found: LimitsHash,
    },
    /// The machine has given a condition of the plan another number than before it was started again, or none: the plan's own orders would
    /// mean other conditions.
    Conditions {
        /// Which load.
        number: u32,
    },
    /// Not a word for too long.
    Silent,
}

impl LinkError {
    /// True when another try will fail alike: a person has to do something.
    pub fn is_final(&self) -> bool {
        matches!(
            self,
            LinkError::Refused(_) | LinkError::Limits { .. } | LinkError::Conditions { .. }
        )
    }
}

impl std::fmt::Display for LinkError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            LinkError::Frame(error) => error.fmt(f),
            LinkError::Content { offset, error } => write!(f, "byte {offset} of the connection: in the frame, {error}"),
            LinkError::Gap { expected, found } => write!(f, "frame {expected} is missing: frame {found} came"),
            LinkError::Rules(what) => write!(f, "the other side broke the rules of the link: {what}"),
            LinkError::Refused(refusal) => refusal.fmt(f),
            LinkError::Limits { machine, .. } => {
                write!(
                    f,
                    "'{machine}' has other limits than the plan was made for: use its machine file on both sides"
                )
            }
            LinkError::Conditions { number } => write!(
                f,
                "the machine was started again and does not take condition {number} of the program as it did before: start the program again"
            ),
            LinkError::Silent => write!(f, "the other side has said nothing for too long"),
        }
    }
}
impl std::error::Error for LinkError {}

impl From<FrameError> for LinkError {
    fn from(error: FrameError) -> Self {
        LinkError::Frame(error)
    }
}
