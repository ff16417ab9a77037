//! Adapter logs.

use mtconnect::ReadOptions;

/// Reads a recording.
pub fn run(bytes: &[u8]) {
    let log = [b"2020-01-01T00:00:00Z|a|1\n", bytes].concat();
    mtconnect::read(&log, "f", &ReadOptions::default());
    mtconnect::read(bytes, "f", &ReadOptions::default());
}
