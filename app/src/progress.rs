//! Progress of long work: one line on stderr, rewritten, and only where a person sees it.

use std::io::{IsTerminal, Write, stderr};
use std::time::{Duration, Instant};

/// One line of progress.
pub struct Progress {
    what: &'static str,
    began: Instant,
    last: Option<Instant>,
    shown: bool,
}

impl Progress {
    /// Nothing is shown before the work has taken a quarter of a second.
    pub fn new(what: &'static str) -> Progress {
        Progress {
            what,
            began: Instant::now(),
            last: None,
            shown: stderr().is_terminal(),
        }
    }

    /// Says how far it is; cheap enough to be called often.
    pub fn at(&mut self, text: impl FnOnce() -> String) {
        let now = Instant::now();
        let since = now - self.last.unwrap_or(self.began);
        if self.shown && since > Duration::from_millis(250) {
            self.last = Some(now);
            let _ = write!(stderr(), "\r\x1b[K{}: {}", self.what, text());
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        if self.shown && self.last.is_some() {
            let _ = write!(stderr(), "\r\x1b[K");
        }
    }
}
