//! A sender of the text protocol, a wire, and the machine behind it.
#![allow(dead_code, reason = "each test uses a part of it")]

use cell::Output;
use cell::link::channel::Way;
use cell::link::{TextNotice, TextOrder, TextReceiver, TextSender};
use cell::source::Planned;
use machine::link::text::{Line, LineReader};
use machine::{Command, MachineParameters, Plant, Quality, RealtimeHalf, Report, Request, State};
use std::collections::{BTreeMap, VecDeque};
use units::{Point, Tick};

pub fn machine() -> MachineParameters {
    let mut machine = MachineParameters::small_machining_centre();
    machine.tool_change = units::Seconds(0.3);
    machine
}

pub fn commands(program: &Planned) -> VecDeque<Command> {
    let commands = program.outputs.iter().filter_map(|o| match o {
        Output::Command(command) => Some(*command),
        _ => None,
    });
    let mut commands: VecDeque<Command> = commands.collect();
    if !matches!(commands.back(), Some(Command::End { .. })) {
        commands.push_back(Command::End { step: units::StepId(0) });
    }
    commands
}

/// Sender and machine with a wire between them.
pub struct TextWorld {
    pub commands: VecDeque<Command>,
    pub sender: Option<TextSender>,
    pub receiver: TextReceiver,
    pub half: Box<RealtimeHalf<Plant>>,
    pub way: Way,
    pub connection: Option<u32>,
    pub now: Tick,
    pub held: Option<TextOrder>,
    pub transcript: Vec<String>,
    pub seen: LineReader,
    pub last: Option<Report>,
    pub late: u64,
    pub notices: Vec<TextNotice>,
    pub refused: Option<String>,
    pub spindle: Vec<Command>,
}

impl TextWorld {
    pub fn new(program: &Planned, seed: u64, delay: (u64, u64)) -> Self {
        let parameters = machine();
        let mut half = Box::new(RealtimeHalf::new(
            &parameters,
            Plant::new(&parameters, Point::ORIGIN, seed),
            Quality::Simulated,
        ));
        half.request(Request::PowerOn);
        let mut receiver = TextReceiver::new(&parameters);
        assert!(receiver.connected(1));
        TextWorld {
            commands: commands(program),
            sender: Some(TextSender::new(&parameters, BTreeMap::from([(1, 34.4)]))),
            receiver,
            half,
            way: Way::new(delay, seed),
            connection: Some(1),
            now: Tick(0),
            held: None,
            transcript: Vec::new(),
            seen: LineReader::new(),
            last: None,
            late: 0,
            notices: Vec::new(),
            refused: None,
            spindle: Vec::new(),
        }
    }

    /// One millisecond; the report of the cycle, if it took place.
    pub fn advance(&mut self) -> Option<Report> {
        let now = self.now;
        self.now += 1;
        if let Some(sender) = &mut self.sender {
            while let Some(command) = self.commands.pop_front() {
                if let Err(back) = sender.push(command) {
                    self.commands.push_front(back);
                    break;
                }
            }
            let mut bytes = Vec::new();
            if let Err(refusal) = sender.output(now, &mut bytes) {
                self.refused = Some(refusal.to_string());
                sender.request(Request::Stop);
            }
            for &byte in &bytes {
                if let Some(Ok(line)) = self.seen.take(byte) {
                    self.note(&line);
                }
            }
            if self.connection.is_some() {
                self.way.send(now, bytes);
            }
        }
        while self.receiver.reads()
            && let Some(bytes) = self.way.arrive(now)
        {
            if let Some(connection) = self.connection {
                self.receiver.receive(connection, &bytes);
            }
        }
        while let Some(request) = self.receiver.urgent() {
            self.held = None;
            self.half.request(request);
        }
        if self.late > 0 {
            self.late -= 1;
            return None;
        }
        while let Some(order) = self.held.take().or_else(|| self.receiver.order()) {
            match order {
                TextOrder::Command(command) => {
                    if self.half.push(command).is_err() {
                        self.held = Some(order);
                        break;
                    }
                    if matches!(
                        command,
                        Command::Spindle { .. } | Command::Tool { .. } | Command::ToolLength { .. }
                    ) {
                        self.spindle.push(command);
                    }
                }
                other => {
                    if let Some(request) = other.request() {
                        self.half.request(request);
                    }
                }
            }
        }
        self.half.tick(now);
        let report = self.half.report()?;
        self.receiver.reported(&report);
        self.tell();
        while let Some(notice) = self.receiver.notice() {
            self.notices.push(notice);
        }
        self.last = Some(report);
        Some(report)
    }

    pub fn tell(&mut self) {
        while let Some(told) = self.receiver.told() {
            let text = told.text();
            let line = String::from_utf8_lossy(text.bytes()).trim_end().to_owned();
            self.transcript.push(format!("          {line}"));
            if let Some(sender) = &mut self.sender {
                sender.receive(text.bytes()).expect("our own line");
            }
        }
    }

    /// Writes a line down; of movements in a row the first and the last.
    pub fn note(&mut self, line: &Line) {
        let text = String::from_utf8_lossy(line.text().bytes()).into_owned();
        if !matches!(line, Line::Movement(_)) {
            return self.transcript.push(text);
        }
        let before = self.transcript.len();
        let moved =
            |line: Option<&String>| line.is_some_and(|l| l.starts_with(|c: char| c == '-' || c == '.' || c.is_ascii_digit()));
        if moved(self.transcript.last()) && before > 1 && moved(self.transcript.get(before - 2)) {
            let last = self.transcript.len() - 1;
            self.transcript[last] = format!("... {text}");
        } else if moved(self.transcript.last()) {
            self.transcript.push(format!("... {text}"));
        } else {
            self.transcript.push(text);
        }
    }

    pub fn is_over(&self) -> bool {
        let ended = self.sender.as_ref().is_none_or(TextSender::ended);
        ended
            && self
                .last
                .is_some_and(|r| r.idle && matches!(r.state, State::Ready) || r.state.needs_a_person())
    }
}
