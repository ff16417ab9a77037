//! The recording of an agent: bytes and events in any order.

use mtconnect::client::gap::GapCause;
use mtconnect::client::query::Query;
use mtconnect::client::session::{Action, Client, Event};
use std::time::Duration;

/// The first byte of each line says what happens, the rest is what comes over the line. Numbers rise, and none comes twice.
pub fn run(bytes: &[u8]) {
    let query = Query::parse("http://a:5000/sample?count=10").expect("an address");
    let mut client = Client::new(query, None);
    let mut now = Duration::ZERO;
    let mut last = (0, 0);
    for piece in bytes.split(|b| *b == 0) {
        for _ in 0..20 {
            match client.action(now) {
                Action::Connect => client.connected(now),
                Action::Wait(until) => now = now.max(until),
                Action::Receive(_) | Action::Stop(_) => break,
                Action::Send(_) | Action::Close => {}
            }
        }
        match piece.first() {
            Some(b'!') => client.closed(now, "cut"),
            Some(b'+') => now += Duration::from_secs(5),
            _ => client.received(now, piece),
        }
        for event in client.take_events() {
            match event {
                Event::Observations(told) => {
                    for t in told {
                        assert!(t.instance != last.0 || t.sequence > last.1, "{t:?} after {last:?}");
                        last = (t.instance, t.sequence);
                    }
                }
                Event::Agent(_) => {}
                Event::Gap(gap) => {
                    assert!(gap.to_sequence.is_none_or(|to| to >= gap.from_sequence), "{gap:?}");
                    // An agent that was started anew may even keep its instance: its numbers begin again all the same.
                    if gap.cause == GapCause::AgentRestart {
                        last = (0, 0);
                    }
                }
            }
        }
    }
}
