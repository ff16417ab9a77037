//! MTConnectStreams documents.

use mtconnect::ReadOptions;

/// Reads a recording.
pub fn run(bytes: &[u8]) {
    mtconnect::read_streams(bytes, "f");
    // The same bytes behind the head that marks a recording as XML: the positions in it.
    mtconnect::read(bytes, "f", &ReadOptions::default());
}
