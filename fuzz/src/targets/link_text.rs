//! The published text protocol, both directions, and what the controller makes of it.

use cell::link::{TextOrder, TextReceiver, TextSender};
use machine::MachineParameters;
use machine::link::text::{LineReader, ToldReader};
use std::collections::BTreeMap;

/// Reads the bytes at once, byte by byte and as the answer of a controller. Whatever comes, no set-point is further from the one before
/// than an axis can go.
pub fn run(bytes: &[u8]) {
    let machine = MachineParameters::small_machining_centre();
    let mut receiver = TextReceiver::new(&machine);
    receiver.connected(1);
    receiver.receive(1, bytes);
    let mut before: Option<[f64; 3]> = None;
    while let Some(order) = receiver.order() {
        match order {
            TextOrder::Command(machine::Command::SetPoint(s)) => {
                assert!(s.position.iter().chain(&s.velocity).all(|n| n.is_finite()), "{s:?}");
                if let Some(before) = before.replace(s.position) {
                    let far = (0..3).any(|k| (s.position[k] - before[k]).abs() > 0.502);
                    assert!(!far, "from {before:?} to {s:?}");
                }
            }
            // A new beginning, or a tool of another length.
            _ => before = None,
        }
    }
    let mut lines = LineReader::new();
    for byte in bytes {
        if let Some(Ok(line)) = lines.take(*byte) {
            // What was read is written as what reads the same.
            let mut again = LineReader::new();
            let text = line.text();
            let read: Vec<_> = text.bytes().iter().filter_map(|b| again.take(*b)).collect();
            let in_its_place = matches!(read[..], [Ok(same)] if same == line) || read.iter().all(Result::is_err);
            assert!(in_its_place, "{line:?} came back as {read:?}");
        }
    }
    let mut told = ToldReader::new();
    for byte in bytes {
        if let Some(Ok(line)) = told.take(*byte) {
            let mut again = ToldReader::new();
            let read: Vec<_> = line.text().bytes().iter().filter_map(|b| again.take(*b)).collect();
            assert_eq!(read, [Ok(line)]);
        }
    }
    let _ = TextSender::new(&machine, BTreeMap::new()).receive(bytes);
}
