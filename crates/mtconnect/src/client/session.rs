//! The recording of one agent as a machine: what happens on the connection goes in, what to do and what was observed come out.
//!
//! First it asks for the device model, which proves that an agent answers; then for the newest values, whose header says where the
//! agent's buffer begins and ends; then for a stream from the sequence number wanted. [`Position`] is all that a recording has to
//! remember: with it the stream is taken up after a cut, or by another process, without doubles and without loss. What the agent's
//! buffer no longer holds is a [`Gap`] with its numbers.
//!
//! Time is a duration since any moment of the caller's, and only rises.

mod continuity;

use super::document::{AgentError, Document, NotRead, Told, read_document};
use super::gap::{Gap, GapCause};
use super::http::{Head, HttpEvent, ResponseReader};
use super::items::Items;
use super::multipart::{PartReader, boundary_of};
use super::query::{Query, Request};
use crate::streams::Header;
use plan::{Diagnostic, Diagnostics};
use std::collections::VecDeque;
use std::time::Duration;
use units::Timestamp;

/// How long the first answer of an agent is waited for, over all tries.
pub const FIRST_CONTACT: Duration = Duration::from_secs(10);
/// Longest document: an agent of 131072 slots gives some 30 MB at most.
pub const LONGEST_DOCUMENT: usize = 64 << 20;
/// Longest pause between two tries to connect.
pub const LONGEST_PAUSE: Duration = Duration::from_secs(2);

const COUNT: u64 = 5000;
const INTERVAL: Duration = Duration::from_millis(100);
const HEARTBEAT: Duration = Duration::from_secs(10);
/// How long an answer that is no stream may be silent.
const ANSWER: Duration = Duration::from_secs(30);
/// Observations that are ahead of the agent's own clock by more have a wrong time.
const AHEAD: i64 = 60_000_000_000;

/// How far a recording is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Position {
    /// Which start of the agent: its `instanceId`.
    pub instance: u64,
    /// The sequence number to ask for next.
    pub next: u64,
    /// Time of the last observation recorded.
    pub last: Option<Timestamp>,
}

/// What the caller has to do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Action {
    /// Open a connection, then call [`Client::connected`] or [`Client::closed`].
    Connect,
    /// Send these bytes.
    Send(Vec<u8>),
    /// Wait for bytes, until then at most.
    Receive(Duration),
    /// Do nothing until then.
    Wait(Duration),
    /// Close the connection.
    Close,
    /// There is no use in going on.
    Stop(Ending),
}

/// Why there is no use in going on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ending {
    /// Nobody answered within [`FIRST_CONTACT`].
    Unreachable(String),
    /// Somebody answers who is no MTConnect agent.
    NotAnAgent(String),
    /// The agent refuses the query.
    Refused(String),
}

/// What came of it.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// An agent answered, or answers after it was started anew.
    Agent(Header),
    /// Observations in the order of their numbers, each once.
    Observations(Vec<Told>),
    /// Something is missing between the observations before and those after.
    Gap(Gap),
}

/// What happened so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Observations given out.
    pub observations: u64,
    /// Observations that came a second time and were dropped.
    pub doubles: u64,
    /// Documents read.
    pub documents: u64,
    /// Documents without observations: signs of life.
    pub heartbeats: u64,
    /// Connections that ended before they should.
    pub cuts: u64,
    /// Connections opened after the first.
    pub reconnects: u64,
    /// Bytes received.
    pub bytes: u64,
    /// The agent's newest number, as far as it told.
    pub agent_last: u64,
}

/// A recording of one agent.
#[derive(Debug)]
pub struct Client {
    query: Query,
    items: Items,
    diagnostics: Diagnostics,
    counters: Counters,
    events: VecDeque<Event>,
    position: Option<Position>,
    /// Gaps whose end is not known before the next observation.
    open_gaps: Vec<Gap>,
    /// Why the agent's buffer may have run over: set while we could not take what it gave.
    blame: Option<GapCause>,
    ask: Ask,
    link: Link,
    started: Option<Duration>,
    /// An agent has answered once.
    known: bool,
    connections: u64,
    /// Tries since something came of one.
    failures: u32,
    reason: String,
    /// Where a document was broken, and how often in a row.
    broken: (u64, u32),
    /// The same for refusals.
    out_of_range: (u64, u32),
    /// How often in a row the buffer's beginning was gone when it was asked for.
    chases: u32,
    /// What such a chase skipped was asked for once: the buffer may move on by what we do not record.
    looked_back: bool,
    buffer_size: u64,
    /// Time of the newest observation of each data item.
    newest: Vec<Timestamp>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Ask {
    Probe,
    Current,
    Sample,
}

#[derive(Debug)]
enum Link {
    /// No connection; the next try is not before that.
    Down {
        until: Duration,
    },
    Connecting,
    Open(Box<Conversation>),
    /// The caller has to close it; then a pause.
    Closing {
        until: Duration,
    },
    Over(Ending),
}

#[derive(Debug)]
struct Conversation {
    http: ResponseReader,
    head: Head,
    parts: Option<PartReader>,
    body: Vec<u8>,
    /// To be sent, not before that.
    send_at: Option<Duration>,
    heard: Duration,
    /// The deadline is over and the line was looked at once more: bytes may have waited there while we did not run.
    looked: bool,
}

/// How it goes on after a document.
enum After {
    /// As before.
    GoOn,
    /// With the next request, at once.
    Ask,
    /// With the next request, on a connection of its own.
    Reconnect,
    /// The connection is of no more use.
    Failed(String),
    Stop(Ending),
}

impl Client {
    /// A recording of what `query` wants; goes on at `position`, or begins where the query says.
    pub fn new(query: Query, position: Option<Position>) -> Client {
        Client {
            query,
            items: Items::default(),
            diagnostics: Diagnostics::new(),
            counters: Counters::default(),
            events: VecDeque::new(),
            position,
            open_gaps: Vec::new(),
            blame: None,
            ask: Ask::Probe,
            link: Link::Down { until: Duration::ZERO },
            started: None,
            known: false,
            connections: 0,
            failures: 0,
            reason: String::new(),
            broken: (0, 0),
            out_of_range: (0, 0),
            chases: 0,
            looked_back: false,
            buffer_size: 0,
            newest: Vec::new(),
        }
    }

    /// What to do now.
    pub fn action(&mut self, now: Duration) -> Action {
        let started = *self.started.get_or_insert(now);
        match &mut self.link {
            Link::Over(ending) => Action::Stop(ending.clone()),
            Link::Down { .. } if !self.known && now.saturating_sub(started) > FIRST_CONTACT => {
                let seconds = FIRST_CONTACT.as_secs();
                let ending = Ending::Unreachable(format!("no agent answered in {seconds} s: {}", self.reason));
                self.link = Link::Over(ending.clone());
                Action::Stop(ending)
            }
            Link::Down { until } if now < *until => Action::Wait(*until),
            Link::Down { .. } => {
                self.link = Link::Connecting;
                Action::Connect
            }
            Link::Connecting => Action::Connect,
            Link::Closing { until } => {
                let until = *until;
                self.link = Link::Down { until };
                Action::Close
            }
            Link::Open(talk) => {
                match talk.send_at {
                    Some(at) if at <= now => {
                        talk.send_at = None;
                        (talk.heard, talk.looked) = (now, false);
                        return Action::Send(self.query.request(self.request()));
                    }
                    Some(at) => return Action::Wait(at),
                    None => {}
                }
                let (heard, looked) = (talk.heard, talk.looked);
                let deadline = heard + self.patience();
                if now >= deadline && !looked {
                    if let Link::Open(talk) = &mut self.link {
                        talk.looked = true;
                    }
                    return Action::Receive(now);
                }
                if now >= deadline {
                    let seconds = self.patience().as_secs_f64();
                    self.failed(now, format!("the agent gave no sign of life for {seconds} s"));
                    return self.action(now);
                }
                Action::Receive(deadline)
            }
        }
    }

    /// The connection is open.
    pub fn connected(&mut self, now: Duration) {
        self.connections += 1;
        self.counters.reconnects = self.connections - 1;
        self.link = Link::Open(Box::new(Conversation {
            http: ResponseReader::default(),
            head: Head::default(),
            parts: None,
            body: Vec::new(),
            send_at: Some(now),
            heard: now,
            looked: false,
        }));
    }

    /// The connection could not be opened, or has ended.
    pub fn closed(&mut self, now: Duration, why: &str) {
        match std::mem::replace(&mut self.link, Link::Down { until: now }) {
            Link::Open(mut talk) => {
                // An answer may last until the connection ends.
                let mut after = After::Failed(why.to_owned());
                let whole = talk.parts.is_none() && talk.http.may_end() && !talk.body.is_empty();
                if whole {
                    after = self.whole_body(now, &mut talk);
                }
                match after {
                    After::Stop(ending) => self.link = Link::Over(ending),
                    After::Failed(why) => {
                        self.failed(now, why);
                        self.link = Link::Down { until: self.pause(now) };
                    }
                    After::GoOn | After::Ask | After::Reconnect => {
                        let until = talk.send_at.unwrap_or(now);
                        self.link = Link::Down { until };
                    }
                }
            }
            over @ Link::Over(_) => self.link = over,
            _ => {
                self.failed(now, why.to_owned());
                self.link = Link::Down { until: self.pause(now) };
            }
        }
    }

    /// Bytes came.
    pub fn received(&mut self, now: Duration, bytes: &[u8]) {
        self.counters.bytes += bytes.len() as u64;
        let link = std::mem::replace(&mut self.link, Link::Down { until: now });
        let Link::Open(mut talk) = link else {
            self.link = link;
            return;
        };
        (talk.heard, talk.looked) = (now, false);
        match self.listen(now, &mut talk, bytes) {
            After::GoOn | After::Ask => self.link = Link::Open(talk),
            After::Reconnect => {
                let until = talk.send_at.unwrap_or(now);
                self.link = Link::Closing { until };
            }
            After::Stop(ending) => self.link = Link::Over(ending),
            After::Failed(why) => self.failed(now, why),
        }
    }

    /// What came of it since it was asked for last.
    pub fn take_events(&mut self) -> impl Iterator<Item = Event> + '_ {
        self.events.drain(..)
    }

    /// Closes the gaps that wait for an observation to end them; for the end of a recording.
    pub fn finish(&mut self) {
        for gap in self.open_gaps.drain(..) {
            self.events.push_back(Event::Gap(gap));
        }
    }

    /// What was given out after `position` is not kept: the connection is closed and taken up there, not before `pause` is over. What
    /// the agent has lost by then is a gap with that cause.
    pub fn go_back(&mut self, now: Duration, position: Position, pause: Duration, cause: GapCause) {
        self.events.clear();
        self.open_gaps.clear();
        self.position = Some(position);
        self.blame = Some(cause);
        let until = now + pause;
        self.ask = Ask::Current;
        self.link = match std::mem::replace(&mut self.link, Link::Down { until }) {
            Link::Open(_) | Link::Closing { .. } => Link::Closing { until },
            over @ Link::Over(_) => over,
            _ => Link::Down { until },
        };
    }

    /// Where the recording goes on; `None` before the agent's buffer is known. Before a gap whose end has not come yet: such a gap was
    /// not given out.
    pub fn position(&self) -> Option<Position> {
        let before_gap = self.open_gaps.first().map(|gap| Position {
            instance: gap.instance,
            next: gap.from_sequence,
            last: gap.from,
        });
        before_gap.or(self.position)
    }

    /// What is observed.
    pub fn items(&self) -> &Items {
        &self.items
    }

    /// What happened so far.
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// What was odd.
    pub fn diagnostics(&self) -> &Diagnostics {
        &self.diagnostics
    }

    /// Why there is no connection, for a person.
    pub fn trouble(&self) -> Option<&str> {
        (self.failures > 0).then_some(self.reason.as_str())
    }

    fn interval(&self) -> Duration {
        self.query.interval.unwrap_or(INTERVAL)
    }

    fn heartbeat(&self) -> Duration {
        self.query.heartbeat.unwrap_or(HEARTBEAT).max(Duration::from_millis(1))
    }

    /// How long the agent may be silent: two signs of life may be missed by a slow line.
    fn patience(&self) -> Duration {
        match self.ask {
            Ask::Sample => 2 * self.heartbeat() + self.interval() + Duration::from_secs(1),
            _ => ANSWER,
        }
    }

    fn request(&self) -> Request {
        match (self.ask, self.position) {
            (Ask::Probe, _) => Request::Probe,
            (Ask::Current, _) | (_, None) => Request::Current,
            (Ask::Sample, Some(position)) => Request::Sample {
                from: position.next,
                count: self.count(),
                interval: self.interval(),
                heartbeat: self.heartbeat(),
            },
        }
    }

    /// Agents refuse a count beyond their buffer. Where a document was broken, and where connections are cut before a document was
    /// whole, smaller ones are asked for.
    fn count(&self) -> u64 {
        let most = if self.buffer_size > 0 { self.buffer_size } else { u64::MAX };
        let count = self.query.count.unwrap_or(COUNT).clamp(1, most);
        let broken_here = self.position.is_some_and(|p| p.next == self.broken.0);
        let broken = if broken_here { self.broken.1 } else { 0 };
        (count >> (4 * broken + 2 * self.failures.saturating_sub(1)).min(63)).max(1)
    }

    /// 0.1 s after the first failure in a row, then twice as long each time.
    fn pause(&self, now: Duration) -> Duration {
        let factor = 1u32 << self.failures.saturating_sub(1).min(10);
        now + (Duration::from_millis(100) * factor).min(LONGEST_PAUSE)
    }

    fn failed(&mut self, now: Duration, why: String) {
        self.failures += 1;
        self.reason = why;
        if self.known {
            self.counters.cuts += 1;
        }
        self.link = Link::Closing { until: self.pause(now) };
    }

    fn listen(&mut self, now: Duration, talk: &mut Conversation, mut bytes: &[u8]) -> After {
        loop {
            let event = match talk.http.next(&mut bytes) {
                Ok(None) => return After::GoOn,
                Ok(Some(event)) => event,
                Err(error) if !self.known => {
                    return After::Stop(Ending::NotAnAgent(format!("the answer is no HTTP: {error}")));
                }
                Err(error) => return After::Failed(format!("the answer is no HTTP: {error}")),
            };
            match event {
                HttpEvent::Head(head) => {
                    talk.parts = boundary_of(&head.content_type).map(|b| PartReader::new(&b, LONGEST_DOCUMENT));
                    talk.body.clear();
                    if (300..400).contains(&head.status) {
                        let message = format!(
                            "the answer to {} is a redirection to {}",
                            self.query.authority(),
                            head.location
                        );
                        return After::Stop(Ending::NotAnAgent(message));
                    }
                    talk.head = head;
                }
                HttpEvent::Body(piece) => match &mut talk.parts {
                    None => {
                        talk.body.extend_from_slice(piece);
                        if talk.body.len() > LONGEST_DOCUMENT {
                            return After::Failed(format!("a document is longer than {LONGEST_DOCUMENT} bytes"));
                        }
                    }
                    Some(parts) => {
                        parts.receive(piece);
                        while let Some(parts) = &mut talk.parts {
                            match parts.next_part() {
                                Ok(Some(part)) => match self.document(&part.body, talk.head.status) {
                                    After::GoOn => {}
                                    // A stream is not ended by a request: only by its connection.
                                    After::Ask => return After::Reconnect,
                                    other => return other,
                                },
                                Ok(None) => break,
                                Err(error) => return After::Failed(format!("the stream cannot be read: {error}")),
                            }
                        }
                    }
                },
                HttpEvent::End if talk.parts.is_some() => return After::Failed("the agent ended its stream".to_owned()),
                HttpEvent::End => match self.whole_body(now, talk) {
                    After::GoOn | After::Ask if talk.head.closes => return After::Reconnect,
                    After::GoOn | After::Ask => {}
                    other => return other,
                },
            }
        }
    }

    /// An answer that is one document: the next request comes at once, or after the interval when there is nothing more to tell.
    fn whole_body(&mut self, now: Duration, talk: &mut Conversation) -> After {
        let body = std::mem::take(&mut talk.body);
        let after = self.document(&body, talk.head.status);
        let polls = matches!(after, After::GoOn) && self.ask == Ask::Sample;
        let behind = self.position.is_some_and(|p| p.next <= self.counters.agent_last);
        talk.send_at = Some(if polls && !behind { now + self.interval() } else { now });
        after
    }

    fn document(&mut self, bytes: &[u8], status: u16) -> After {
        let text = String::from_utf8_lossy(bytes);
        if matches!(text, std::borrow::Cow::Owned(_)) {
            let message = "a document holds bytes that are not UTF-8; they stand as \u{FFFD}";
            self.diagnostics
                .add(Diagnostic::warning("not-utf8", message).in_file(self.query.authority()));
        }
        let found = read_document(&text, &self.query.authority(), &mut self.items, &mut self.diagnostics);
        let document = match found {
            Ok(document) => document,
            Err(NotRead::OtherKind(what)) if !self.known && status < 500 => {
                let message = format!(
                    "{} answers (status {status}), but not as an MTConnect agent: {what}",
                    self.query.authority()
                );
                return After::Stop(Ending::NotAnAgent(message));
            }
            Err(NotRead::OtherKind(what)) => {
                return After::Failed(format!("the answer (status {status}) is no MTConnect document: {what}"));
            }
            Err(NotRead::Broken(what)) => return self.broken_document(&what),
        };
        self.known = true;
        self.counters.documents += 1;
        match (self.ask, document) {
            (_, Document::Errors(header, errors)) => self.refused(&header, &errors),
            (Ask::Probe, Document::Devices(..)) => {
                self.ask = Ask::Current;
                After::Ask
            }
            (Ask::Current, Document::Streams(header, _)) => self.learned(header),
            (Ask::Sample, Document::Streams(header, told)) => {
                if self.position.is_none_or(|p| p.instance != header.instance) {
                    self.ask = Ask::Current;
                    return After::Ask;
                }
                let is_quiet = told.is_empty();
                self.observed(&header, told);
                if is_quiet && self.looks_back(&header) {
                    return After::Ask;
                }
                After::GoOn
            }
            (ask, _) => After::Failed(format!("the answer to {ask:?} is a document of another kind")),
        }
    }

    /// A document that is whole and yet no XML will be no XML the next time either: it is asked for in ever smaller pieces, until one
    /// number is left, and that one is a gap.
    fn broken_document(&mut self, what: &str) -> After {
        if self.ask == Ask::Sample
            && let Some(position) = self.position
        {
            let times = if self.broken.0 == position.next {
                self.broken.1 + 1
            } else {
                1
            };
            if times > 1 && self.count() == 1 {
                self.open_gap(Gap {
                    instance: position.instance,
                    from_sequence: position.next,
                    to_sequence: Some(position.next),
                    cause: GapCause::Unreadable,
                    from: position.last,
                    to: None,
                });
                self.position = Some(Position {
                    next: position.next + 1,
                    ..position
                });
                self.failures = 0;
                self.broken = (0, 0);
            } else {
                self.broken = (position.next, times);
            }
        }
        After::Failed(format!("a document is broken: {what}"))
    }

    fn refused(&mut self, header: &Header, errors: &[AgentError]) -> After {
        let words: Vec<String> = errors.iter().map(|e| format!("{}: {}", e.code, e.message)).collect();
        let words = words.join("; ");
        let is = |codes: &[&str]| errors.iter().any(|e| codes.contains(&e.code.as_str()));
        if self.ask == Ask::Sample && is(&["OUT_OF_RANGE"]) {
            // The buffer has moved on, or the agent was started anew; `current` tells which.
            let other_agent = self
                .position
                .is_some_and(|p| header.instance != 0 && p.instance != header.instance);
            self.ask = Ask::Current;
            let next = self.position.map_or(0, |p| p.next);
            let times = if self.out_of_range.0 == next {
                self.out_of_range.1 + 1
            } else {
                1
            };
            self.out_of_range = (next, times);
            // Refused again and again at a place that the agent says it has: the count or the interval is out of range.
            if times > 5 && !other_agent {
                return After::Stop(Ending::Refused(format!("the agent refuses the query: {words}")));
            }
            return After::Ask;
        }
        if is(&["INTERNAL_ERROR", "QUEUE_FULL", "TOO_MANY"]) {
            return After::Failed(format!("the agent answers with an error: {words}"));
        }
        let remedy = if is(&["INVALID_XPATH"]) {
            "; look at --path: it selects data items of the device model"
        } else if is(&["NO_DEVICE"]) {
            "; look at the device's name in the address"
        } else {
            ""
        };
        After::Stop(Ending::Refused(format!("the agent refuses the query: {words}{remedy}")))
    }
}
