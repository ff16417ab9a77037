//! One side of one connection: frames in order, and the account of which came.

use super::error::LinkError;
use machine::link::wire::Writer;
use machine::link::{FRAME, FrameReader, Header, Kind, Wire, write_frame};
use units::Tick;

/// A frame that came, its payload copied.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Came {
    pub header: Header,
    pub payload: Vec<u8>,
    pub offset: u64,
}

impl Came {
    /// Its payload, all of it, as one message.
    pub fn message<T: Wire>(&self) -> Result<T, LinkError> {
        let mut reader = machine::link::Reader::new(&self.payload);
        let read = T::read(&mut reader).and_then(|read| reader.end().map(|()| read));
        read.map_err(|error| self.wrong(error))
    }

    pub fn wrong(&self, error: machine::link::WireError) -> LinkError {
        LinkError::Content {
            offset: self.offset,
            error,
        }
    }
}

/// One side of one connection.
#[derive(Clone, Debug)]
pub(super) struct Wired {
    reader: Box<FrameReader>,
    scratch: Vec<u8>,
    sent: u32,
    received: u32,
    /// The last of ours that the other side had.
    pub acknowledged: u32,
    /// Frames that came a second time.
    pub duplicates: u64,
    pub session: u32,
    pub heard: Tick,
    pub spoke: Tick,
}

impl Wired {
    pub fn new(now: Tick) -> Self {
        Wired {
            reader: Box::new(FrameReader::new()),
            scratch: vec![0; FRAME],
            sent: 0,
            received: 0,
            acknowledged: 0,
            duplicates: 0,
            session: 0,
            heard: now,
            spoke: now,
        }
    }

    /// Takes bytes up to the next frame that is in its turn; what came before already is passed over.
    pub fn next(&mut self, now: Tick, bytes: &mut &[u8]) -> Result<Option<Came>, LinkError> {
        loop {
            let Some(frame) = self.reader.feed(bytes)? else {
                return Ok(None);
            };
            let (header, payload) = (frame.header, frame.payload.to_vec());
            let offset = self.reader.offset();
            self.heard = now;
            if header.sequence <= self.received {
                self.duplicates += 1;
                continue;
            }
            if header.sequence != self.received + 1 {
                return Err(LinkError::Gap {
                    expected: self.received + 1,
                    found: header.sequence,
                });
            }
            self.received = header.sequence;
            self.acknowledged = self.acknowledged.max(header.acknowledged);
            return Ok(Some(Came { header, payload, offset }));
        }
    }

    /// True when something was sent.
    pub fn spoken(&self) -> bool {
        self.sent > 0
    }

    /// Appends a frame; gives its sequence.
    pub fn send(&mut self, now: Tick, kind: Kind, out: &mut Vec<u8>, payload: impl FnOnce(&mut Writer<'_>)) -> u32 {
        self.sent += 1;
        let header = Header {
            kind,
            session: self.session,
            sequence: self.sent,
            acknowledged: self.received,
        };
        let length = write_frame(&mut self.scratch, &header, payload).expect("every frame is cut to what a frame holds");
        out.extend_from_slice(&self.scratch[..length]);
        self.spoke = now;
        self.sent
    }
}
