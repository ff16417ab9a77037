//! Somebody who asks what lives in the machine, or has something of it ended, and does not drive it: one question, one connection.

use super::error::LinkError;
use super::wire::{Came, Wired};
use super::words;
use machine::link::asking::{AnswerEntry, AnswerHead, Asked, Inquiry};
use machine::link::{Kind, Name, Reader, Wire};
use machine::watch::{CONDITIONS, Living};
use units::Tick;

/// Something that lives in a machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Lived {
    /// What the machine knows of it; its mark is the number by which it is ended.
    pub living: Living,
    /// Whose run loaded it.
    pub by: String,
    /// The line of the program that started it; one that is very long is cut.
    pub line: String,
}

/// What is heard.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Answer {
    /// The machine's name.
    pub machine: String,
    /// Its cycle.
    pub now: Tick,
    /// What lives there, in the order in which it was loaded; after a question to end something: what was ended, as it was at its end, or
    /// nothing.
    pub lived: Vec<Lived>,
}

/// The side that asks.
#[derive(Clone, Debug)]
pub struct LinkAsker {
    inquiry: Inquiry,
    wired: Wired,
    answer: Answer,
}

impl LinkAsker {
    /// A question. `name` is what the controller's log calls who asks.
    pub fn new(name: &str, what: Asked, now: Tick) -> Self {
        let name = Name::new(name);
        LinkAsker {
            inquiry: Inquiry { name, what },
            wired: Wired::new(now),
            answer: Answer::default(),
        }
    }

    /// Appends what is to be written.
    pub fn output(&mut self, now: Tick, out: &mut Vec<u8>) {
        if !self.wired.spoken() {
            let inquiry = self.inquiry;
            self.wired.send(now, Kind::Inquiry, out, |to| inquiry.write(to));
        }
    }

    /// Bytes came; the answer when it is whole.
    ///
    /// # Errors
    /// They are not what a controller answers.
    pub fn receive(&mut self, now: Tick, bytes: &[u8]) -> Result<Option<Answer>, LinkError> {
        let mut bytes = bytes;
        while let Some(came) = self.wired.next(now, &mut bytes)? {
            if came.header.kind != Kind::Answer {
                return Err(LinkError::Rules("a controller answers an inquiry, and says nothing else"));
            }
            if self.take(&came)? {
                self.answer.lived.sort_by_key(|lived| lived.living.mark);
                return Ok(Some(std::mem::take(&mut self.answer)));
            }
        }
        Ok(None)
    }

    /// True when it was the last frame.
    fn take(&mut self, came: &Came) -> Result<bool, LinkError> {
        let mut reader = Reader::new(&came.payload);
        let wrong = |error| came.wrong(error);
        let head = AnswerHead::read(&mut reader).map_err(wrong)?;
        for _ in 0..head.count {
            let AnswerEntry { living, by } = AnswerEntry::read(&mut reader).map_err(wrong)?;
            self.answer.lived.push(Lived {
                living,
                by: by.text().to_owned(),
                line: words::read(&mut reader).map_err(wrong)?,
            });
        }
        reader.end().map_err(wrong)?;
        if self.answer.lived.len() > CONDITIONS {
            return Err(LinkError::Rules("more lives in it than a machine takes"));
        }
        self.answer.machine = head.machine.text().to_owned();
        self.answer.now = head.now;
        Ok(head.last)
    }
}
