//! The registers of a motion card as a file that two programs share: 32 words of 32 bits, little-endian, in the order of
//! [`machine::registers::register`]; `docs/register-card.md` is its layout for who writes the other side.
//!
//! The file is read and written at fixed places, once each in a cycle, and not mapped: a mapping would be the one unsafe place of the store,
//! and a read of 64 bytes and a write of as many take about a microsecond of a millisecond. Both see the same pages, so the other side may well
//! map it. On a memory file system (`/dev/shm`) neither call waits for a disk.
//!
//! What cannot be read is zeros, and zeros are an open emergency stop circuit and drives in fault.

use crate::StoreError;
use machine::Registers;
use machine::registers::register;
use std::fs::{File, OpenOptions};
use std::path::Path;

/// Registers of a card.
pub const WORDS: usize = 32;
/// The first that is written by us; those before it are the card's.
const FIRST_OUT: usize = 16;
const BYTES: usize = 4;

/// The registers in a file.
#[derive(Debug)]
pub struct RegisterFile {
    file: File,
    words: [i32; WORDS],
    failures: u64,
}

impl RegisterFile {
    /// Opens the file that the card's program made.
    ///
    /// # Errors
    /// It is not there, may not be written, or is too short.
    pub fn open(path: &Path) -> Result<RegisterFile, StoreError> {
        let file = OpenOptions::new()
            .read(true)
            .write(true)
            .open(path)
            .map_err(StoreError::io("open the registers", path))?;
        let length = file.metadata().map_err(StoreError::io("read", path))?.len();
        if length < (WORDS * BYTES) as u64 {
            let short = std::io::Error::new(
                std::io::ErrorKind::UnexpectedEof,
                format!(
                    "it has {length} bytes, and a card's registers are {} bytes; start the card's program first",
                    WORDS * BYTES
                ),
            );
            return Err(StoreError::io("use the registers", path)(short));
        }
        Ok(RegisterFile {
            file,
            words: [0; WORDS],
            failures: 0,
        })
    }

    /// How often it could not be read or written.
    pub fn failures(&self) -> u64 {
        self.failures
    }

    /// Takes what the card tells, all of it at once.
    fn take(&mut self) {
        let mut bytes = [0; FIRST_OUT * BYTES];
        if place::read(&self.file, &mut bytes, 0).is_err() {
            bytes.fill(0);
            self.failures += 1;
        }
        for (word, bytes) in self.words.iter_mut().zip(bytes.as_chunks().0) {
            *word = i32::from_le_bytes(*bytes);
        }
    }

    /// Gives what the card is told, all of it at once.
    fn give(&mut self) {
        let mut bytes = [0; (WORDS - FIRST_OUT) * BYTES];
        for (word, bytes) in self.words[FIRST_OUT..].iter().zip(bytes.as_chunks_mut().0) {
            *bytes = word.to_le_bytes();
        }
        if place::write(&self.file, &bytes, (FIRST_OUT * BYTES) as u64).is_err() {
            self.failures += 1;
        }
    }
}

impl Registers for RegisterFile {
    /// The inputs are the first that a cycle asks for: with them all of the card's words are taken.
    fn read(&mut self, register: u16) -> i32 {
        if register == register::INPUTS {
            self.take();
        }
        self.words.get(usize::from(register)).copied().unwrap_or(0)
    }

    /// The count of orders is the last that a cycle writes: with it all of ours are given.
    fn write(&mut self, register: u16, value: i32) {
        if let Some(word) = self.words.get_mut(usize::from(register)) {
            *word = value;
        }
        if register == register::ALIVE {
            self.give();
        }
    }
}

#[cfg(unix)]
mod place {
    use std::fs::File;
    use std::os::unix::fs::FileExt;

    pub(super) fn read(file: &File, bytes: &mut [u8], at: u64) -> std::io::Result<()> {
        file.read_exact_at(bytes, at)
    }
    pub(super) fn write(file: &File, bytes: &[u8], at: u64) -> std::io::Result<()> {
        file.write_all_at(bytes, at)
    }
}

#[cfg(not(unix))]
mod place {
    use std::fs::File;
    use std::io::{Read, Seek, SeekFrom, Write};

    pub(super) fn read(mut file: &File, bytes: &mut [u8], at: u64) -> std::io::Result<()> {
        file.seek(SeekFrom::Start(at))?;
        file.read_exact(bytes)
    }
    pub(super) fn write(mut file: &File, bytes: &[u8], at: u64) -> std::io::Result<()> {
        file.seek(SeekFrom::Start(at))?;
        file.write_all(bytes)
    }
}
