//! Frames: a length, a header, a payload, a checksum over all of it.
//!
//! | bytes | what |
//! |---|---|
//! | 4 | length of everything behind these four |
//! | 2 | `TM` |
//! | 1 | version of the link, [`VERSION`] |
//! | 1 | [`Kind`] |
//! | 4 | session, 0 before there is one |
//! | 4 | sequence: 1 is the first frame of this side on this connection |
//! | 4 | acknowledgement: the sequence of the last frame that came from the other side, 0 is none |
//! | n | payload ([`super::message`]) |
//! | 4 | CRC-32C over all before it |
//!
//! All numbers are little-endian. A connection on which anything of it is wrong is closed: what was lost is asked for on the next one.

use super::crc::crc32c;
use super::wire::{Reader, Wire, WireError, Writer};

/// The version that this side speaks.
pub const VERSION: u8 = 3;
/// Bytes of a frame at most: a block of set-points and its stop tail.
pub const FRAME: usize = 48 * 1024;
/// Bytes before the payload.
const HEADER: usize = 20;
/// Bytes of the checksum.
const CHECKSUM: usize = 4;
/// Bytes of a payload at most.
pub const PAYLOAD: usize = FRAME - HEADER - CHECKSUM;

const MARK: [u8; 2] = *b"TM";

/// What a frame is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The sender introduces itself.
    Hello,
    /// The controller takes it.
    Welcome,
    /// The controller does not.
    Refusal,
    /// Set-points and switching.
    Block,
    /// What must not wait behind blocks: stop, hold, a person's requests, where to go on.
    Urgent,
    /// What the machine did.
    Reports,
    /// Nothing to say, still there; and how far everything is.
    Heartbeat,
    /// The sender is done: the lease is free.
    Goodbye,
    /// A condition, or a tool's diameter, that the machine is to know before it is told of it.
    Load,
    /// Somebody who does not drive asks what lives in the machine, or ends it: the first and only frame of its connection.
    Inquiry,
    /// What it hears.
    Answer,
}
super::wire::wire_enum!(Kind {
    1 = Hello,
    2 = Welcome,
    3 = Refusal,
    4 = Block,
    5 = Urgent,
    6 = Reports,
    7 = Heartbeat,
    8 = Goodbye,
    9 = Load,
    10 = Inquiry,
    11 = Answer,
});

/// What stands in a frame before its payload.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// What it is.
    pub kind: Kind,
    /// Whose it is.
    pub session: u32,
    /// Which it is, on this connection and from this side.
    pub sequence: u32,
    /// The last that came from the other side.
    pub acknowledged: u32,
}

/// A frame whose checksum fits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame<'a> {
    /// Its header.
    pub header: Header,
    /// What it carries.
    pub payload: &'a [u8],
}

/// Writes a frame; `payload` writes what it carries. Gives its length, or `None` when the buffer is too small.
pub fn write_frame(to: &mut [u8], header: &Header, payload: impl FnOnce(&mut Writer<'_>)) -> Option<usize> {
    let mut writer = Writer::new(to);
    0u32.write(&mut writer);
    MARK.write(&mut writer);
    VERSION.write(&mut writer);
    header.kind.write(&mut writer);
    header.session.write(&mut writer);
    header.sequence.write(&mut writer);
    header.acknowledged.write(&mut writer);
    payload(&mut writer);
    let end = writer.finish()?;
    let total = end + CHECKSUM;
    if total > FRAME || to.len() < total {
        return None;
    }
    to[..4].copy_from_slice(&u32::try_from(total - 4).ok()?.to_le_bytes());
    let checksum = crc32c(&to[..end]);
    to[end..total].copy_from_slice(&checksum.to_le_bytes());
    Some(total)
}

/// Bytes that are no frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameError {
    /// Where the frame begins, bytes from the start of the connection.
    pub offset: u64,
    /// What is wrong with it.
    pub fault: FrameFault,
}

/// What can be wrong with a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameFault {
    /// No frame has this length.
    Length(u32),
    /// Its checksum is another.
    Checksum {
        /// What stands in it.
        said: u32,
        /// What its bytes come to.
        computed: u32,
    },
    /// It is whole, and not of this link.
    Mark,
    /// It is of another version of this link.
    Version(u8),
    /// It is whole, and of a kind or content that this version does not know.
    Content(WireError),
}

impl core::fmt::Display for FrameError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "byte {} of the connection: ", self.offset)?;
        match self.fault {
            FrameFault::Length(n) => write!(f, "no frame has {n} bytes: is the other side a toolmark?"),
            FrameFault::Checksum { said, computed } => {
                write!(f, "damaged frame: checksum {said:08x}, its bytes come to {computed:08x}")
            }
            FrameFault::Mark => write!(f, "the frame is not of this link"),
            FrameFault::Version(v) => write!(
                f,
                "the other side speaks version {v} of the link, this one {VERSION}: use the same release on both"
            ),
            FrameFault::Content(error) => write!(f, "in the frame, {error}"),
        }
    }
}
impl core::error::Error for FrameError {}

/// Puts frames together from bytes however they were split.
#[derive(Clone, Debug)]
pub struct FrameReader {
    bytes: [u8; FRAME],
    length: usize,
    /// Bytes of the connection before the frame in the making.
    offset: u64,
    /// The frame in front was given out.
    given: bool,
}

impl Default for FrameReader {
    fn default() -> Self {
        FrameReader::new()
    }
}

impl FrameReader {
    /// At the start of a connection.
    pub const fn new() -> Self {
        FrameReader {
            bytes: [0; FRAME],
            length: 0,
            offset: 0,
            given: false,
        }
    }

    /// Takes from the front of `bytes` up to the end of the next frame; `None`: all was taken, and no frame is whole yet.
    ///
    /// # Errors
    /// They are no frame. Nothing behind it can be trusted: the connection is to be closed.
    pub fn feed(&mut self, bytes: &mut &[u8]) -> Result<Option<Frame<'_>>, FrameError> {
        if self.given {
            self.offset += self.length as u64;
            (self.length, self.given) = (0, false);
        }
        if !self.fill(4, bytes) {
            return Ok(None);
        }
        let said = u32::from_le_bytes([self.bytes[0], self.bytes[1], self.bytes[2], self.bytes[3]]);
        let total = (said as usize).saturating_add(4);
        if !(HEADER + CHECKSUM..=FRAME).contains(&total) {
            return Err(self.error(FrameFault::Length(said)));
        }
        if !self.fill(total, bytes) {
            return Ok(None);
        }
        let (content, checksum) = self.bytes[..total].split_at(total - CHECKSUM);
        let said = checksum.first_chunk().copied().map_or(0, u32::from_le_bytes);
        let computed = crc32c(content);
        if said != computed {
            return Err(self.error(FrameFault::Checksum { said, computed }));
        }
        let mut reader = Reader::new(&self.bytes[4..HEADER]);
        let header = read_header(&mut reader).map_err(|fault| self.error(fault))?;
        self.given = true;
        Ok(Some(Frame {
            header,
            payload: &self.bytes[HEADER..total - CHECKSUM],
        }))
    }

    /// Where the frame that was given out last begins, bytes from the start of the connection.
    pub fn offset(&self) -> u64 {
        self.offset
    }

    /// Takes bytes until there are `wanted`; false when there are not so many.
    fn fill(&mut self, wanted: usize, bytes: &mut &[u8]) -> bool {
        let count = wanted.saturating_sub(self.length).min(bytes.len());
        let (now, later) = bytes.split_at(count);
        self.bytes[self.length..self.length + count].copy_from_slice(now);
        self.length += count;
        *bytes = later;
        self.length >= wanted
    }

    fn error(&self, fault: FrameFault) -> FrameError {
        FrameError {
            offset: self.offset,
            fault,
        }
    }
}

fn read_header(reader: &mut Reader<'_>) -> Result<Header, FrameFault> {
    let content = FrameFault::Content;
    if <[u8; 2]>::read(reader).map_err(content)? != MARK {
        return Err(FrameFault::Mark);
    }
    match u8::read(reader).map_err(content)? {
        VERSION => {}
        other => return Err(FrameFault::Version(other)),
    }
    Ok(Header {
        kind: Wire::read(reader).map_err(content)?,
        session: Wire::read(reader).map_err(content)?,
        sequence: Wire::read(reader).map_err(content)?,
        acknowledged: Wire::read(reader).map_err(content)?,
    })
}
