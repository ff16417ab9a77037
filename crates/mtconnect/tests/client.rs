//! The recording of an agent, without sockets and without a clock: what goes over the line is written here.

use mtconnect::client::gap::{Gap, GapCause};
use mtconnect::client::query::Query;
use mtconnect::client::session::{Action, Client, Ending, Event, Position};
use std::fmt::Write;
use std::time::Duration;
use units::Timestamp;

/// The agent's side of the line.
struct Line {
    client: Client,
    now: Duration,
    /// The request lines that came.
    asked: Vec<String>,
    seen: String,
}

impl Line {
    fn to(address: &str, position: Option<Position>) -> Line {
        Line {
            client: Client::new(Query::parse(address).expect("an address"), position),
            now: Duration::ZERO,
            asked: Vec::new(),
            seen: String::new(),
        }
    }

    /// Lets the client do what it wants until it waits for bytes; gives its last request.
    fn request(&mut self) -> String {
        for _ in 0..20 {
            match self.client.action(self.now) {
                Action::Connect => self.client.connected(self.now),
                Action::Send(bytes) => {
                    let text = String::from_utf8(bytes).expect("ASCII");
                    self.asked.push(text.split(' ').nth(1).expect("a target").to_owned());
                }
                Action::Wait(until) => self.now = until,
                Action::Close => {}
                Action::Receive(_) => return self.asked.last().expect("something was asked").clone(),
                Action::Stop(ending) => panic!("{ending:?}"),
            }
        }
        panic!("it does not come to an end: {:?}", self.asked);
    }

    fn answer(&mut self, body: &str) {
        let head = format!(
            "HTTP/1.1 200 OK\r\nContent-Type: text/xml\r\nContent-Length: {}\r\n\r\n",
            body.len()
        );
        self.bytes(&(head + body));
    }

    fn stream(&mut self) {
        self.bytes("HTTP/1.1 200 OK\r\nContent-Type: multipart/x-mixed-replace;boundary=b\r\n\r\n");
    }

    fn part(&mut self, body: &str) {
        self.bytes(&format!(
            "\r\n--b\r\nContent-type: text/xml\r\nContent-length: {}\r\n\r\n{body}",
            body.len()
        ));
    }

    fn bytes(&mut self, bytes: &str) {
        self.client.received(self.now, bytes.as_bytes());
        self.look();
    }

    fn look(&mut self) {
        let events: Vec<Event> = self.client.take_events().collect();
        for event in events {
            match event {
                Event::Agent(header) => writeln!(self.seen, "agent {}", header.instance).expect("a string"),
                Event::Observations(told) => {
                    let all: Vec<String> = told.iter().map(|t| t.sequence.to_string()).collect();
                    writeln!(self.seen, "{}", all.join(" ")).expect("a string");
                }
                Event::Gap(Gap {
                    instance,
                    from_sequence,
                    to_sequence,
                    cause,
                    ..
                }) => writeln!(
                    self.seen,
                    "gap {} of {instance}: {from_sequence} to {to_sequence:?}",
                    cause.word()
                )
                .expect("a string"),
            }
        }
    }

    /// Probe and current are answered; gives the first sample request.
    fn begun(&mut self, instance: u64, first: u64, next: u64) -> String {
        assert!(self.request().ends_with("/probe"));
        self.answer("<MTConnectDevices><Header/><Devices><Device name=\"d\"/></Devices></MTConnectDevices>");
        assert!(self.request().contains("/current"));
        self.answer(&streams(instance, first, next, &[]));
        self.request()
    }
}

fn streams(instance: u64, first: u64, next: u64, sequences: &[u64]) -> String {
    let told: String = sequences
        .iter()
        .map(|s| {
            format!(
                "<PathPosition dataItemId=\"p\" sequence=\"{s}\" timestamp=\"2026-01-01T00:00:{:02}Z\">1 2 {s}</PathPosition>",
                s % 60
            )
        })
        .collect();
    format!(
        "<MTConnectStreams><Header creationTime=\"2026-01-01T00:01:00Z\" instanceId=\"{instance}\" firstSequence=\"{first}\" nextSequence=\"{next}\" lastSequence=\"{}\" bufferSize=\"1000\"/><Streams><DeviceStream name=\"d\" uuid=\"u\"><ComponentStream component=\"Path\" componentId=\"c\"><Samples>{told}</Samples></ComponentStream></DeviceStream></Streams></MTConnectStreams>",
        next.saturating_sub(1)
    )
}

fn error(code: &str) -> String {
    format!(
        "<MTConnectError><Header instanceId=\"7\"/><Errors><Error errorCode=\"{code}\">so it is</Error></Errors></MTConnectError>"
    )
}

#[test]
fn without_from_it_begins_with_the_agents_buffer_and_goes_on_live() {
    let mut line = Line::to("http://a:5000/d/sample?count=10&path=//X", None);
    let asked = line.begun(7, 5, 9);
    assert_eq!(asked, "/d/sample?path=//X&from=5&count=10&interval=100&heartbeat=10000");
    line.stream();
    line.part(&streams(7, 5, 9, &[5, 8, 7]));
    line.part(&streams(7, 5, 9, &[]));
    line.part(&streams(7, 5, 12, &[9, 10, 11]));
    assert_eq!(line.seen, "agent 7\n5 7 8\n9 10 11\n");
    let counters = line.client.counters();
    assert_eq!((counters.observations, counters.doubles, counters.heartbeats), (6, 0, 1));
}

#[test]
fn after_a_cut_it_goes_on_at_the_next_number_and_drops_what_comes_twice() {
    let mut line = Line::to("http://a:5000", None);
    line.begun(7, 1, 5);
    line.stream();
    line.part(&streams(7, 1, 5, &[1, 2, 3, 4]));
    line.bytes("\r\n--b\r\nContent-type: text/xml\r\nContent-length: 99\r\n\r\n<MTConn");
    line.client.closed(line.now, "reset");
    assert!(line.request().contains("from=5&"));
    line.stream();
    line.part(&streams(7, 1, 8, &[3, 4, 5, 6, 6, 7]));
    assert_eq!(line.seen, "agent 7\n1 2 3 4\n5 6 7\n");
    let counters = line.client.counters();
    assert_eq!((counters.doubles, counters.cuts, counters.reconnects), (3, 1, 1));
}

#[test]
fn what_the_buffer_no_longer_holds_is_a_gap_with_its_numbers() {
    let mut line = Line::to("http://a:5000", None);
    line.begun(7, 1, 5);
    line.stream();
    line.part(&streams(7, 1, 5, &[1, 2, 3, 4]));
    line.client.closed(line.now, "reset");
    line.request();
    line.answer(&error("OUT_OF_RANGE"));
    assert!(line.request().contains("/current"));
    line.answer(&streams(7, 50, 90, &[]));
    assert!(line.request().contains("from=50&"));
    line.answer(&error("OUT_OF_RANGE"));
    line.request();
    line.answer(&streams(7, 60, 99, &[]));
    line.request();
    line.stream();
    line.part(&streams(7, 62, 99, &[62, 63]));
    assert_eq!(
        line.seen,
        "agent 7\n1 2 3 4\nagent 7\nagent 7\ngap overrun of 7: 5 to Some(61)\n62 63\n"
    );
}

#[test]
fn an_agent_that_was_started_anew_is_recorded_from_its_first_number() {
    let mut line = Line::to("http://a:5000", None);
    line.begun(7, 1, 5);
    line.stream();
    line.part(&streams(7, 1, 5, &[1, 2, 3, 4]));
    line.client.closed(line.now, "reset");
    assert!(line.request().contains("from=5&"));
    line.stream();
    // Its numbers have come as far as ours already, so nothing is out of range.
    line.part(&streams(8, 1, 9, &[5, 6, 7, 8]));
    assert!(line.request().contains("/current"));
    line.answer(&streams(8, 2, 9, &[]));
    assert!(line.request().contains("from=2&"));
    line.stream();
    line.part(&streams(8, 2, 9, &[2, 3]));
    assert_eq!(
        line.seen,
        "agent 7\n1 2 3 4\nagent 8\ngap agent-restart of 7: 5 to None\ngap overrun of 8: 1 to Some(1)\n2 3\n"
    );
}

#[test]
fn another_process_goes_on_where_the_first_one_was() {
    let position = Position {
        instance: 7,
        next: 4,
        last: Some(Timestamp(0)),
    };
    let mut line = Line::to("http://a:5000", Some(position));
    assert!(line.begun(7, 1, 9).contains("from=4&"));
    let mut line = Line::to("http://a:5000", Some(position));
    assert!(line.begun(7, 6, 9).contains("from=6&"));
    line.stream();
    line.part(&streams(7, 6, 9, &[6]));
    assert_eq!(line.seen, "agent 7\ngap overrun of 7: 4 to Some(5)\n6\n");
}

#[test]
fn what_could_not_be_written_is_asked_for_again_and_is_a_gap_when_it_is_gone() {
    let mut line = Line::to("http://a:5000", None);
    line.begun(7, 1, 5);
    line.stream();
    line.part(&streams(7, 1, 5, &[1, 2, 3, 4]));
    let kept = Position {
        instance: 7,
        next: 3,
        last: None,
    };
    line.client
        .go_back(line.now, kept, Duration::from_secs(1), GapCause::NotStored);
    assert!(line.request().contains("/current"));
    line.answer(&streams(7, 5, 9, &[]));
    line.request();
    line.stream();
    line.part(&streams(7, 5, 9, &[5, 6]));
    assert_eq!(
        line.seen,
        "agent 7\n1 2 3 4\nagent 7\ngap not-stored of 7: 3 to Some(4)\n5 6\n"
    );
}

#[test]
fn a_document_that_is_broken_every_time_costs_one_number_and_no_more() {
    let mut line = Line::to("http://a:5000", None);
    line.begun(7, 1, 9);
    let mut counts = Vec::new();
    for _ in 0..20 {
        let asked = line.request();
        let value = |name: &str| -> u64 {
            let rest = asked.split(&format!("{name}=")).nth(1).expect("it is asked");
            rest.split('&').next().and_then(|v| v.parse().ok()).expect("a number")
        };
        let (from, count) = (value("from"), value("count"));
        counts.push(count);
        let told: Vec<u64> = (from..(from + count).min(9)).collect();
        let text = streams(7, 1, told.last().map_or(from, |l| l + 1), &told);
        line.stream();
        line.part(&text.replace(">1 2 4<", "><broken<"));
        if !told.contains(&4) && told.contains(&8) {
            break;
        }
        line.client.closed(line.now, "for the next request");
    }
    line.client.finish();
    line.look();
    assert!(
        line.seen.contains("gap unreadable of 7: 4 to Some(4)"),
        "{} {counts:?}",
        line.seen
    );
    let numbers: Vec<&str> = line
        .seen
        .lines()
        .filter(|l| !l.contains(' ') || l.starts_with(char::is_numeric))
        .collect();
    assert_eq!(numbers.join(" "), "1 2 3 5 6 7 8", "{}", line.seen);
}

#[test]
fn an_agent_without_streams_is_asked_again_after_the_interval_when_there_is_nothing_more() {
    let mut line = Line::to("http://a:5000/sample?interval=500", None);
    line.begun(7, 1, 9);
    line.answer(&streams(7, 1, 5, &[1, 2, 3, 4]).replace("lastSequence=\"4\"", "lastSequence=\"8\""));
    let before = line.now;
    assert!(line.request().contains("from=5&"));
    assert_eq!(line.now, before);
    line.answer(&streams(7, 1, 9, &[5, 6, 7, 8]));
    assert!(line.request().contains("from=9&"));
    assert_eq!(line.now, before + Duration::from_millis(500));
    assert_eq!(line.seen, "agent 7\n1 2 3 4\n5 6 7 8\n");
}

#[test]
fn an_agent_that_gives_no_sign_of_life_is_left_and_asked_again() {
    let mut line = Line::to("http://a:5000/sample?heartbeat=1000&interval=0", None);
    line.begun(7, 1, 9);
    line.stream();
    let Action::Receive(until) = line.client.action(line.now) else {
        panic!("it waits")
    };
    assert_eq!(until, Duration::from_secs(3));
    line.now = until;
    assert_eq!(line.client.action(line.now), Action::Receive(until), "a last look");
    assert_eq!(line.client.action(line.now), Action::Close);
    assert!(line.request().contains("from=1&"));
    assert!(line.client.trouble().expect("a reason").contains("no sign of life"));
}

/// As after a laptop's sleep, or a stopped process.
#[test]
fn what_waited_in_the_line_while_nobody_looked_is_a_sign_of_life() {
    let mut line = Line::to("http://a:5000/sample?heartbeat=1000&interval=0", None);
    line.begun(7, 1, 9);
    line.stream();
    line.now += Duration::from_secs(3600);
    assert_eq!(line.client.action(line.now), Action::Receive(line.now));
    line.part(&streams(7, 1, 5, &[1, 2, 3, 4]));
    assert_eq!(
        line.client.action(line.now),
        Action::Receive(line.now + Duration::from_secs(3))
    );
    assert_eq!(line.seen, "agent 7\n1 2 3 4\n");
    assert_eq!((line.client.counters().cuts, line.client.trouble()), (0, None));
}

#[test]
fn what_a_chase_skipped_is_asked_for_when_the_agent_has_gone_quiet() {
    let mut line = Line::to("http://a:5000", None);
    line.begun(7, 1, 5);
    line.stream();
    line.part(&streams(7, 1, 5, &[1, 2, 3, 4]));
    line.client.closed(line.now, "reset");
    line.request();
    for newest in (1000..).step_by(1000).take(12) {
        line.answer(&error("OUT_OF_RANGE"));
        line.request();
        line.answer(&streams(7, newest - 49, newest + 1, &[]));
        line.request();
    }
    assert!(
        line.asked.last().expect("a request").contains("from=12001&"),
        "{:?}",
        line.asked
    );
    // A sign of life without an observation, and the buffer is as it was.
    line.stream();
    line.part(&streams(7, 11_951, 12_001, &[]));
    assert!(line.request().contains("from=11951&"));
    line.stream();
    let all: Vec<u64> = (11_951..=12_000).collect();
    line.part(&streams(7, 11_951, 12_001, &all));
    let seen = line.seen.replace("agent 7\n", "");
    assert!(
        seen.starts_with("1 2 3 4\ngap overrun of 7: 5 to Some(11950)\n11951 11952 "),
        "{seen}"
    );
    line.part(&streams(7, 11_951, 12_001, &[]));
    assert!(
        matches!(line.client.action(line.now), Action::Receive(_)),
        "nothing is left to look back at"
    );
}

/// 500 slots, a thousand observations a second, and a tenth of a second from `current` to `sample`.
#[test]
fn a_buffer_that_moves_on_faster_than_it_is_asked_for_is_caught_further_back() {
    let mut line = Line::to("http://a:5000", None);
    line.begun(7, 1, 5);
    line.stream();
    line.part(&streams(7, 1, 5, &[1, 2, 3, 4]));
    line.client.closed(line.now, "reset");
    let mut newest = 10_000;
    let mut asked = line.request();
    let mut rounds = 0;
    loop {
        let from: u64 = asked
            .split("from=")
            .nth(1)
            .and_then(|t| t.split('&').next())
            .expect("a number")
            .parse()
            .expect("one");
        newest += 100;
        if from > newest - 500 {
            line.stream();
            line.part(&streams(7, newest - 499, newest + 1, &(from..=newest).collect::<Vec<_>>()));
            let seen = line.seen.replace("agent 7\n", "");
            assert!(
                seen.starts_with(&format!("1 2 3 4\ngap overrun of 7: 5 to Some({})\n{from} ", from - 1)),
                "{seen}"
            );
            break;
        }
        rounds += 1;
        assert!(rounds < 10, "it is never caught");
        line.answer(&error("OUT_OF_RANGE"));
        assert!(line.request().contains("/current"));
        line.answer(&streams(7, newest - 499, newest + 1, &[]));
        asked = line.request();
    }
}

/// How it ends when every connection fails in the same way.
fn end_of(address: &str, what: impl Fn(&mut Client, Duration)) -> (Ending, Duration) {
    let mut client = Client::new(Query::parse(address).expect("an address"), None);
    let mut now = Duration::ZERO;
    loop {
        match client.action(now) {
            Action::Connect => what(&mut client, now),
            Action::Wait(until) | Action::Receive(until) => now = until,
            Action::Stop(ending) => return (ending, now),
            Action::Send(_) | Action::Close => {}
        }
    }
}

#[test]
fn an_agent_that_is_not_there_is_given_up_after_ten_seconds() {
    let (ending, after) = end_of("http://a:5000", |client, now| client.closed(now, "connection refused"));
    assert!(
        matches!(&ending, Ending::Unreachable(why) if why.contains("connection refused")),
        "{ending:?}"
    );
    assert!(
        after > Duration::from_secs(10) && after < Duration::from_secs(20),
        "{after:?}"
    );
}

#[test]
fn who_is_no_agent_is_named_by_what_it_says() {
    for (answer, word) in [
        ("SSH-2.0-OpenSSH\r\n", "SSH-2.0"),
        ("HTTP/1.1 200 OK\r\nContent-Length: 13\r\n\r\n<html></html>", "<html>"),
        ("HTTP/1.1 404 No\r\nContent-Length: 4\r\n\r\nnope", "404"),
        (
            "HTTP/1.1 301 Moved\r\nLocation: https://b/\r\nContent-Length: 0\r\n\r\n",
            "https://b/",
        ),
    ] {
        let (ending, _) = end_of("http://a:5000", |client, now| {
            client.connected(now);
            client.action(now);
            client.received(now, answer.as_bytes());
        });
        assert!(matches!(&ending, Ending::NotAnAgent(why) if why.contains(word)), "{ending:?}");
    }
}

#[test]
fn a_wrong_query_is_refused_in_the_agents_words() {
    for code in ["NO_DEVICE", "INVALID_URI", "INVALID_XPATH"] {
        let (ending, _) = end_of("http://a:5000", |client, now| {
            client.connected(now);
            client.action(now);
            let body = error(code);
            let answer = format!("HTTP/1.1 404 Not Found\r\nContent-Length: {}\r\n\r\n{body}", body.len());
            client.received(now, answer.as_bytes());
        });
        assert!(
            matches!(&ending, Ending::Refused(why) if why.contains(code) && why.contains("so it is")),
            "{ending:?}"
        );
    }
    let mut line = Line::to("http://a:5000/sample?from=99", None);
    line.request();
    line.answer("<MTConnectDevices><Header/></MTConnectDevices>");
    line.request();
    line.answer(&streams(7, 1, 9, &[]));
    assert!(matches!(line.client.action(line.now), Action::Stop(Ending::Refused(why)) if why.contains("99 does not exist yet")));
}

#[test]
fn times_that_jump_are_kept_and_said() {
    let mut line = Line::to("http://a:5000", None);
    line.begun(7, 1, 5);
    line.stream();
    line.part(&streams(7, 1, 5, &[1, 2, 3]).replace("00:00:02Z", "09:00:00Z"));
    assert_eq!(line.seen, "agent 7\n1 2 3\n");
    let codes: Vec<&str> = line.client.diagnostics().as_slice().iter().map(|d| d.code).collect();
    assert_eq!(codes, ["time-ahead", "time-backwards"]);
}

#[test]
fn connections_that_are_cut_before_a_document_is_whole_are_asked_for_smaller_ones() {
    let mut line = Line::to("http://a:5000", None);
    line.begun(7, 1, 900);
    let counts: Vec<String> = (0..5)
        .map(|_| {
            let asked = line.request();
            line.client.closed(line.now, "reset");
            asked
                .split("count=")
                .nth(1)
                .and_then(|c| c.split('&').next())
                .expect("a count")
                .to_owned()
        })
        .collect();
    assert_eq!(counts, ["1000", "1000", "250", "62", "15"]);
}
