//! The plain text form of a recording.

use mtconnect::ReadOptions;

/// Reads a recording.
pub fn run(bytes: &[u8]) {
    let reading = mtconnect::read(bytes, "f", &ReadOptions::default());
    assert!(reading.track.points.iter().all(|p| p.position.iter().all(|c| c.is_finite())));
}
