//! Observations a second that the client takes in: a stream of documents, from bytes to observations in order.
//!
//! `cargo bench -p mtconnect`; the budget is 500 000 a second on one core.
#![allow(clippy::disallowed_methods, clippy::disallowed_types, reason = "a bench reads the clock")]

use mtconnect::client::query::Query;
use mtconnect::client::session::{Action, Client, Event};
use std::fmt::Write;
use std::time::{Duration, Instant};

const PER_DOCUMENT: u64 = 5_000;
const DOCUMENTS: u64 = 400;

fn main() {
    let mut client = Client::new(Query::parse("http://a:5000").expect("an address"), None);
    let whole = |body: &str| format!("HTTP/1.1 200 OK\r\nContent-Length: {}\r\n\r\n{body}", body.len());
    advance(&mut client);
    client.received(
        Duration::ZERO,
        whole("<MTConnectDevices><Header/></MTConnectDevices>").as_bytes(),
    );
    advance(&mut client);
    client.received(Duration::ZERO, whole(&document(1, 0)).as_bytes());
    advance(&mut client);
    let head = "HTTP/1.1 200 OK\r\nContent-Type: multipart/x-mixed-replace;boundary=b\r\nTransfer-Encoding: chunked\r\n\r\n";
    client.received(Duration::ZERO, head.as_bytes());
    let (mut taken, mut bytes, mut seconds) = (0, 0, 0.0);
    for k in 0..DOCUMENTS {
        let body = document(k * PER_DOCUMENT + 1, PER_DOCUMENT);
        let part = format!("\r\n--b\r\nContent-length: {}\r\n\r\n{body}", body.len());
        let chunk = format!("{:x}\r\n{part}\r\n", part.len());
        bytes += chunk.len();
        let began = Instant::now();
        for piece in chunk.as_bytes().chunks(1 << 18) {
            client.received(Duration::ZERO, piece);
        }
        for event in client.take_events() {
            if let Event::Observations(told) = event {
                taken += told.len();
            }
        }
        seconds += began.elapsed().as_secs_f64();
    }
    assert_eq!(taken as u64, PER_DOCUMENT * DOCUMENTS);
    println!("| what | count | per second | MB/s |\n|---|---|---|---|");
    println!(
        "| observations from the line | {taken} | {:.0} | {:.0} |",
        taken as f64 / seconds,
        bytes as f64 * 1e-6 / seconds
    );
}

fn advance(client: &mut Client) {
    loop {
        match client.action(Duration::ZERO) {
            Action::Connect => client.connected(Duration::ZERO),
            Action::Receive(_) => return,
            Action::Stop(ending) => panic!("{ending:?}"),
            _ => {}
        }
    }
}

/// Ten data items of three components, as a mill tells them.
fn document(first: u64, count: u64) -> String {
    let mut text = format!(
        "<MTConnectStreams><Header creationTime=\"2026-01-01T09:00:00Z\" instanceId=\"7\" firstSequence=\"1\" nextSequence=\"{}\" lastSequence=\"{}\" bufferSize=\"131072\"/><Streams><DeviceStream name=\"mill\" uuid=\"u\">",
        first + count,
        first + count - 1
    );
    for component in 0..3 {
        write!(
            text,
            "<ComponentStream component=\"Linear\" name=\"{component}\" componentId=\"c{component}\"><Samples>"
        )
        .expect("a string");
        for s in (first..first + count).filter(|s| s % 3 == component) {
            let (item, second, milli) = (s % 10, s / 1000 % 60, s % 1000);
            write!(
                text,
                "<Position dataItemId=\"c{component}i{item}\" timestamp=\"2026-01-01T08:00:{second:02}.{milli:03}Z\" name=\"pos{item}\" sequence=\"{s}\" subType=\"ACTUAL\">{}.{milli}</Position>",
                s % 500
            )
            .expect("a string");
        }
        text.push_str("</Samples></ComponentStream>");
    }
    text + "</DeviceStream></Streams></MTConnectStreams>"
}
