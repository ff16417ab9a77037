//! Frames: what a segment file is made of.
//!
//! ```text
//! file    magic "TMRKSEG1" | frame | frame | ...
//! frame   len u32 | crc32c u32 | seq u64 | t_first i64 | kind u8 | payload      all little-endian
//! ```
//!
//! `len` counts what stands behind the checksum; the checksum covers `len` and everything behind itself. `seq` rises by one from 0, so
//! that a frame that is missing, doubled or of another place is found. `t_first` is the time of the first row, microseconds UTC.
//!
//! Arrow's own stream format has no checksum: four flipped bytes were read as good data, and zeros at the end as a clean end. Here a
//! length of zero is no frame, and nothing ends without an end frame.

/// The first bytes of a segment file; the digit is the version of this format.
pub const MAGIC: [u8; 8] = *b"TMRKSEG1";

/// Bytes of a frame before its payload.
pub const HEAD: usize = 4 + 4 + 8 + 8 + 1;
/// What `len` and the checksum themselves take.
const PREFIX: usize = 8;
/// No frame is longer: a damaged length must not ask for the memory of the house.
pub const LONGEST: usize = 64 << 20;

/// What a frame holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Kind {
    /// The Arrow schema as an IPC stream, with the metadata of the segment. Always the first frame, and only that.
    Schema = 1,
    /// Rows: number of the first row, count, Arrow IPC.
    Batch = 2,
    /// The same, the Arrow IPC compressed with zstd.
    CompressedBatch = 3,
    /// Rows that were lost, as JSON.
    Gap = 4,
    /// Something that happened, as JSON.
    Event = 5,
    /// The end: the number of rows. Nothing comes behind it.
    End = 6,
}

impl Kind {
    const ALL: [Kind; 6] = [
        Kind::Schema,
        Kind::Batch,
        Kind::CompressedBatch,
        Kind::Gap,
        Kind::Event,
        Kind::End,
    ];
    fn of(byte: u8) -> Option<Kind> {
        Self::ALL.into_iter().find(|k| *k as u8 == byte)
    }
}

/// A frame as it was read, its checksum checked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame<'a> {
    /// Its place in the file, from 0.
    pub seq: u64,
    /// Time of its first row, microseconds UTC.
    pub t_first: i64,
    /// What the payload is.
    pub kind: Kind,
    /// The payload.
    pub payload: &'a [u8],
}

/// Why bytes are not the frame that was expected.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BadFrame {
    /// Fewer bytes than the frame needs.
    #[error("the file is cut inside a frame: {there} of {needed} bytes are there")]
    Cut {
        /// Bytes that are there.
        there: u64,
        /// Bytes that the frame needs.
        needed: u64,
    },
    /// Zeros, as a file system leaves them behind a length that reached the disk before the content.
    #[error("zeros where a frame was expected")]
    Zeros,
    /// A length that no frame has.
    #[error("a length of {0} bytes, which no frame has")]
    Length(u32),
    /// The checksum does not fit.
    #[error("the checksum is {found:08x} and not {expected:08x}")]
    Checksum {
        /// What the frame says.
        expected: u32,
        /// What its bytes give.
        found: u32,
    },
    /// A frame of another place.
    #[error("frame {found} stands where frame {expected} was expected")]
    Sequence {
        /// Which frame belongs here.
        expected: u64,
        /// Which one is here.
        found: u64,
    },
    /// A kind that this program does not know.
    #[error("a frame of kind {0}, which this program does not know")]
    Kind(u8),
    /// The frame is whole and its content makes no sense.
    #[error("the content of the frame is not readable: {0}")]
    Content(String),
    /// Bytes behind the end frame.
    #[error("bytes behind the end")]
    BehindTheEnd,
}

/// Writes a frame behind `out`; `fill` writes its payload. False when it is longer than a frame may be; `out` is as before then.
///
/// # Errors
/// Those of `fill`; `out` is as before then.
pub fn put<E>(
    out: &mut Vec<u8>,
    seq: u64,
    t_first: i64,
    kind: Kind,
    fill: impl FnOnce(&mut Vec<u8>) -> Result<(), E>,
) -> Result<bool, E> {
    let begin = out.len();
    out.extend([0; PREFIX]);
    out.extend(seq.to_le_bytes());
    out.extend(t_first.to_le_bytes());
    out.push(kind as u8);
    if let Err(error) = fill(out) {
        out.truncate(begin);
        return Err(error);
    }
    let length = out.len() - begin - PREFIX;
    if length > LONGEST {
        out.truncate(begin);
        return Ok(false);
    }
    let length = (length as u32).to_le_bytes();
    let checksum = crc32c::crc32c_append(crc32c::crc32c(&length), &out[begin + PREFIX..]);
    out[begin..begin + 4].copy_from_slice(&length);
    out[begin + 4..begin + PREFIX].copy_from_slice(&checksum.to_le_bytes());
    Ok(true)
}

/// How many bytes a frame that begins with `prefix` takes in all, when `left` bytes of the file are left from its beginning on.
///
/// # Errors
/// No frame begins so.
pub fn length(prefix: &[u8; PREFIX], left: u64) -> Result<usize, BadFrame> {
    let length = u32_at(prefix, 0);
    if length == 0 {
        return Err(BadFrame::Zeros);
    }
    if (length as usize) < HEAD - PREFIX || length as usize > LONGEST {
        return Err(BadFrame::Length(length));
    }
    let needed = u64::from(length) + PREFIX as u64;
    if left < needed {
        return Err(BadFrame::Cut { there: left, needed });
    }
    Ok(needed as usize)
}

/// Reads the one frame that `bytes` are.
///
/// # Errors
/// They are not frame `seq`.
pub fn get(bytes: &[u8], seq: u64) -> Result<Frame<'_>, BadFrame> {
    let Some(prefix) = bytes.first_chunk::<PREFIX>() else {
        return Err(BadFrame::Cut {
            there: bytes.len() as u64,
            needed: HEAD as u64,
        });
    };
    let whole = length(prefix, bytes.len() as u64)?;
    let bytes = &bytes[..whole];
    let expected = u32_at(bytes, 4);
    let found = crc32c::crc32c_append(crc32c::crc32c(&bytes[..4]), &bytes[PREFIX..]);
    if found != expected {
        return Err(BadFrame::Checksum { expected, found });
    }
    let number = |at: usize| {
        let mut eight = [0; 8];
        eight.copy_from_slice(&bytes[at..at + 8]);
        eight
    };
    let found = u64::from_le_bytes(number(8));
    if found != seq {
        return Err(BadFrame::Sequence { expected: seq, found });
    }
    Ok(Frame {
        seq,
        t_first: i64::from_le_bytes(number(16)),
        kind: Kind::of(bytes[24]).ok_or(BadFrame::Kind(bytes[24]))?,
        payload: &bytes[HEAD..],
    })
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    let mut four = [0; 4];
    four.copy_from_slice(&bytes[at..at + 4]);
    u32::from_le_bytes(four)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn frame(seq: u64, payload: &[u8]) -> Vec<u8> {
        let mut out = Vec::new();
        put(&mut out, seq, -5, Kind::Batch, |out| {
            out.extend(payload);
            Ok::<(), ()>(())
        })
        .expect("written");
        out
    }

    #[test]
    fn a_frame_comes_back_as_it_was_written() {
        let bytes = frame(7, b"rows");
        let expected = Frame {
            seq: 7,
            t_first: -5,
            kind: Kind::Batch,
            payload: b"rows",
        };
        assert_eq!(get(&bytes, 7), Ok(expected));
        assert_eq!(get(&bytes, 8), Err(BadFrame::Sequence { expected: 8, found: 7 }));
        assert_eq!(get(&[0; 100], 0), Err(BadFrame::Zeros));
    }

    #[test]
    fn the_checksum_is_crc_32c_as_others_compute_it() {
        // The check value of CRC-32C in every catalogue.
        assert_eq!(crc32c::crc32c(b"123456789"), 0xe306_9283);
    }

    proptest! {
        #[test]
        fn a_flipped_bit_or_a_cut_anywhere_is_found(payload in prop::collection::vec(any::<u8>(), 0..200), at in any::<prop::sample::Index>(), bit in 0_u8..8) {
            let good = frame(3, &payload);
            let place = at.index(good.len());
            let mut flipped = good.clone();
            flipped[place] ^= 1_u8 << bit;
            prop_assert!(get(&flipped, 3).is_err());
            prop_assert!(get(&good[..place], 3).is_err());
        }
    }
}
