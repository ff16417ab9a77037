//! The office half: keeps the machine's queue filled, pairs every step with the tick at which its turn came, answers the program's
//! questions, and writes the log.
//!
//! It hears of the machine only through [`Report`]s and speaks to it only through commands and requests, so the realtime half may be in
//! the same thread, in another, or at the end of a wire.

use crate::events::{self, Detail, detail};
use crate::sink::RecordSink;
use crate::source::{CommandSource, Output};
use ledger::Chain;
use machine::watch::{Firing, LoadError, Situation, WatchOrder};
use machine::{Command, Counters, FaultCause, Overrides, Report, Request, Sample, State, StopCause, Wait};
use plan::{Alarm, Answer, Level, Place, Question, Step, StepKind};
use serde_json::{Value, json};
use std::collections::VecDeque;
use trace::compile::Compiled;
use trace::record::{Order, Recorder};
use units::{StepId, Tick, Timestamp};

/// Steps without motion that may wait for their turn: more of them wait in the program.
const PENDING: usize = 4096;
/// An axis that stays this near to one place stands there, mm: two pulses of its encoder. A speed would not do: one pulse in a cycle is
/// 1 mm/s, and an axis that creeps at that speed is not at rest.
const STANDSTILL: f64 = 0.0025;
/// A measured speed below this may be noise, mm/s.
const SLOW: f64 = 2.0;

/// Cycles for which the axes have to stand before a run is over.
const SETTLING: u64 = 30;
/// Cycles after which a person who asked for home asks again.
const ASKS_AGAIN: u64 = 1_000;
/// Cycles for which the person waits at a starved machine for set-points to come back: a minute.
const PATIENCE: u64 = 60_000;

/// What the person at the machine does; by default nobody is there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Operator {
    /// The optional-stop switch.
    pub optional_stop: bool,
    /// Cycles after which a paused, held or starved machine gets cycle start; `None`: never, and the run ends there.
    pub cycle_start_after: Option<u64>,
}

/// How a run ended.
#[derive(Clone, Debug, PartialEq)]
pub enum Ended {
    /// The program ran to its end.
    Completed,
    /// The program could not go on.
    Alarm(Box<Alarm>),
    /// A controlled stop.
    Stopped(StopCause),
    /// The emergency stop.
    EmergencyStop,
    /// A fault of the machine.
    Fault(FaultCause),
    /// The machine waits for cycle start and nobody is there.
    Waiting,
    /// The machine does not know where its axes are and nobody is there.
    NotHomed,
}

impl Ended {
    /// One word for scripts.
    pub fn word(&self) -> &'static str {
        match self {
            Ended::Completed => "completed",
            Ended::Alarm(_) => "alarm",
            Ended::Stopped(_) => "stopped",
            Ended::EmergencyStop => "emergency-stop",
            Ended::Fault(_) => "fault",
            Ended::Waiting => "waiting",
            Ended::NotHomed => "not-homed",
        }
    }

    /// A sentence for people.
    pub fn text(&self) -> String {
        match self {
            Ended::Completed => "the program ran to its end".to_owned(),
            Ended::Alarm(alarm) => alarm.to_string(),
            Ended::Stopped(cause) => format!("controlled stop: {cause}"),
            Ended::EmergencyStop => "emergency stop".to_owned(),
            Ended::Fault(cause) => format!("fault: {cause}"),
            Ended::Waiting => "the machine waits for cycle start and nobody is there".to_owned(),
            Ended::NotHomed => "the machine is not homed and nobody is there: home it, then start again".to_owned(),
        }
    }
}

/// Answers a program's question; the sample is the machine's last.
pub type Answers<'a> = Box<dyn FnMut(&Question, &Sample) -> Answer + 'a>;

/// The office half of one run.
pub struct OfficeHalf<'a, S> {
    source: S,
    operator: Operator,
    answers: Option<Answers<'a>>,
    start: Timestamp,
    chain: Chain,
    /// A command that the machine's queue had no place for.
    waiting: Option<Command>,
    /// Commands that the machine took.
    commands: u64,
    /// What has its turn when that many commands are done.
    pending: VecDeque<(u64, Pending)>,
    last_step: StepId,
    workingsteps: u32,
    asked: Option<Question>,
    answer: Option<Answer>,
    said_end: bool,
    source_over: bool,
    /// The program alarmed; its turn has come and it is told.
    alarm: Option<Box<Alarm>>,
    state: State,
    counters: Counters,
    overrides: Overrides,
    lost_reports: u64,
    begun_anew: u64,
    /// Cycles in the present waiting state.
    waited: u64,
    /// Cycles for which the axes have stood, and where.
    stood: u64,
    stands_at: [f64; 3],
    /// Commands that the machine had taken when its state changed last.
    commands_at_change: u64,
    last_sample: Sample,
    ended: Option<Ended>,
    /// Does what the program's functions say.
    functions: Option<Box<Recorder>>,
    /// What the machine has to be told for a function, before the program goes on.
    orders: VecDeque<Command>,
    /// A condition that has to be loaded before the program goes on.
    to_load: Option<(String, Compiled, StepId)>,
    /// Firings of the coming report's cycle.
    firings: Vec<Firing>,
    lost_firings: u64,
}

enum Pending {
    Step(Step),
    Alarm(Alarm),
}

/// What the machine itself can answer: where its axes are, by their encoders, and the time.
fn of_the_machine(question: &Question, sample: &Sample, start: Timestamp) -> Answer {
    let Question::Number(name) = question else {
        return Answer::Unknown;
    };
    for (index, axis) in ["X", "Y", "Z"].iter().enumerate() {
        let (actual, commanded) = (sample.actual[index], sample.commanded[index]);
        match name.strip_prefix(axis) {
            Some(".POSITION.ACTUAL") => return Answer::Number(Some(actual)),
            Some(".POSITION.DEVIATION") => return Answer::Number(Some(commanded - actual)),
            _ => {}
        }
    }
    match name.as_str() {
        "EQUIPMENT_TIMER.POWERED" | "EQUIPMENT_TIMER.WORKING" => Answer::Number(Some(sample.tick.seconds().0)),
        "CLOCK_TIME" => Answer::Number(Some(start.at(sample.tick).0 as f64 / 1e9)),
        _ => Answer::Unknown,
    }
}

impl<'a, S: CommandSource> OfficeHalf<'a, S> {
    /// An office half for one run that begins at `start`. Events go on the end of `chain`.
    pub fn new(source: S, operator: Operator, start: Timestamp, chain: Chain) -> Self {
        OfficeHalf {
            source,
            operator,
            answers: None,
            start,
            chain,
            waiting: None,
            commands: 0,
            pending: VecDeque::new(),
            last_step: StepId::NONE,
            workingsteps: 0,
            asked: None,
            answer: None,
            said_end: false,
            source_over: false,
            alarm: None,
            state: State::Off,
            counters: Counters::default(),
            overrides: Overrides::default(),
            lost_reports: 0,
            begun_anew: 0,
            waited: 0,
            stood: 0,
            stands_at: [0.0; 3],
            commands_at_change: 0,
            last_sample: Sample::default(),
            ended: None,
            functions: None,
            orders: VecDeque::new(),
            to_load: None,
            firings: Vec::new(),
            lost_firings: 0,
        }
    }

    /// Does what the functions of the program say; without it they are told as steps and do nothing.
    pub fn with_functions(mut self, recorder: Recorder) -> Self {
        self.functions = Some(Box::new(recorder));
        self
    }

    /// Answers questions other than the optional stop; what it does not know, and without it, the machine answers: places and times.
    pub fn answered_by(mut self, answers: Answers<'a>) -> Self {
        self.answers = Some(answers);
        self
    }

    /// Gives the machine what it takes. `push` is the machine's end of the queue.
    pub fn refill(&mut self, mut push: impl FnMut(Command) -> Result<(), Command>) {
        if self.ended.is_some() {
            return;
        }
        loop {
            if let Some(command) = self.waiting.take() {
                if let Err(back) = push(command) {
                    self.waiting = Some(back);
                    return;
                }
                self.commands += 1;
            }
            if let Some(order) = self.orders.pop_front() {
                self.waiting = Some(order);
                continue;
            }
            if self.to_load.is_some() {
                return;
            }
            if self.asked.is_some() || self.source_over || self.pending.len() >= PENDING || !self.source.is_ready() {
                return;
            }
            match self.source.next(self.answer.take()) {
                Output::Command(command) => {
                    self.said_end = matches!(command, Command::End { .. });
                    self.waiting = Some(command);
                }
                Output::Passed(step) => {
                    self.last_step = step.id;
                    let mut after = self.commands;
                    if let Some(recorder) = &mut self.functions {
                        let orders = recorder.orders(&step);
                        self.take_orders(orders, step.id);
                        // A condition is over when the machine has stopped it: until then it fires, behind a cut for a long time.
                        if self.orders.iter().any(stops_a_condition) {
                            after += self.orders.len() as u64;
                        }
                    }
                    self.pending.push_back((after, Pending::Step(step)));
                }
                Output::Ask(question) => self.asked = Some(question),
                Output::End => {
                    self.source_over = true;
                    if !self.said_end {
                        self.waiting = Some(Command::End { step: self.last_step });
                    }
                }
                Output::Alarm(alarm) => {
                    self.source_over = true;
                    self.pending.push_back((self.commands, Pending::Alarm(alarm)));
                }
            }
        }
    }

    fn take_orders(&mut self, orders: Vec<Order>, step: StepId) {
        for order in orders {
            match order {
                Order::Say(order) => self.orders.push_back(Command::Watch { order, step }),
                Order::Load(line, compiled) => self.to_load = Some((line, compiled, step)),
            }
        }
    }

    /// A condition that has to be loaded into the machine's watches before the program goes on: one that was not seen beforehand.
    /// With it the line that starts it.
    pub fn to_load(&self) -> Option<(&str, &Compiled)> {
        self.to_load.as_ref().map(|(line, compiled, _)| (line.as_str(), compiled))
    }

    /// What became of it.
    pub fn loaded(&mut self, number: Result<u16, LoadError>) {
        let (Some((line, _, step)), Some(recorder)) = (self.to_load.take(), &mut self.functions) else {
            return;
        };
        match number {
            Ok(number) => {
                let orders = recorder.loaded(&line, number);
                self.take_orders(orders, step);
            }
            Err(why) => recorder.not_loaded(&line, why.text(), self.last_sample.tick),
        }
    }

    /// Hears of a watch that fired, before the report of its cycle.
    pub fn fired(&mut self, firing: Firing) {
        self.firings.push(firing);
    }

    /// Firings that were lost on the way, in all.
    pub fn firings_lost(&mut self, lost: u64) {
        if let Some(recorder) = &mut self.functions
            && lost > self.lost_firings
        {
            recorder.lost_firings(lost - self.lost_firings, self.last_sample.tick);
            self.lost_firings = lost;
        }
    }

    /// Hears of one cycle: gives sample and events to the sink, and says what the person or the office wants of the machine now.
    /// `truth` is where a simulator's slides really are, mm ([`RecordSink::truth`]).
    pub fn receive(&mut self, report: &Report, truth: Option<[f64; 3]>, sink: &mut dyn RecordSink) -> Option<Request> {
        sink.sample(&report.sample);
        if let Some(position) = truth {
            sink.truth(&report.sample, position);
        }
        self.last_sample = report.sample;
        if let Some(recorder) = &mut self.functions {
            let situation = Situation {
                feed_override: f64::from(report.overrides.feed),
                cost: report.watches,
                ..Situation::default()
            };
            recorder.cycle(&report.sample, situation);
        }
        let place = report.sample.actual;
        if place.iter().zip(self.stands_at).all(|(p, at)| (p - at).abs() <= STANDSTILL) {
            self.stood += 1;
        } else {
            (self.stood, self.stands_at) = (0, place);
        }
        self.tell_counts(report, sink);
        self.tell_overrides(report, sink);
        self.tell_steps(report, sink);
        self.tell_state(report, sink);
        self.do_functions(report, sink);
        if self.ended.is_some() {
            return None;
        }
        self.answer_question(report, sink);
        self.decide(report, sink)
    }

    /// Times that the controller knew nothing of the run any more, in all: it was started again, or did something else in between. What it
    /// had not told is lost, and nobody knows how much. Conditions and recordings wait until the machine goes on.
    pub fn machine_begun_anew(&mut self, times: u64, sink: &mut dyn RecordSink) {
        if times > self.begun_anew {
            self.begun_anew = times;
            let Sample { tick, step, .. } = self.last_sample;
            if let Some(recorder) = &mut self.functions {
                recorder.started_again(tick);
            }
            self.tell_functions(sink);
            self.emit("controller-begun-anew", step, tick, Detail::new(), sink);
        }
    }

    /// Reports that were lost on the way, in all: a gap in the record is told.
    pub fn reports_lost(&mut self, lost: u64, now: Tick, sink: &mut dyn RecordSink) {
        if lost > self.lost_reports {
            let count = lost - self.lost_reports;
            if let Some(recorder) = &mut self.functions {
                recorder.lost(count, now);
            }
            self.lost_reports = lost;
            self.emit(
                "record-gap",
                self.last_sample.step,
                now,
                detail(json!({ "count": count })),
                sink,
            );
        }
    }

    /// Appends an event of the run's own to the log: `job-started`, and what only the caller knows.
    pub fn tell(&mut self, kind: &str, now: Tick, data: Detail, sink: &mut dyn RecordSink) {
        self.emit(kind, StepId::NONE, now, data, sink);
    }

    /// Somebody else stands at the machine from here on, or does something else.
    pub fn attended_by(&mut self, operator: Operator) {
        self.operator = operator;
    }

    /// A person asked for a stop, and the machine stands without anything of the program that a stop could end: it was started again, or has
    /// not begun. The run is over.
    pub fn stopped_at_rest(&mut self, report: &Report, sink: &mut dyn RecordSink) {
        if self.ended.is_none() {
            self.end(Ended::Stopped(StopCause::Asked), &report.sample, &report.counters, sink);
        }
    }

    /// How the run ended; `None` while it goes on.
    pub fn ended(&self) -> Option<&Ended> {
        self.ended.as_ref()
    }

    /// Commands that the machine took.
    pub fn commands(&self) -> u64 {
        self.commands
    }

    /// The end of the log.
    pub fn chain(&self) -> Chain {
        self.chain
    }

    /// Where the commands come from.
    pub fn source(&self) -> &S {
        &self.source
    }

    /// What the functions do in this cycle, and what they have to tell of it.
    fn do_functions(&mut self, report: &Report, sink: &mut dyn RecordSink) {
        let over = self.is_all_done(report);
        let Some(recorder) = &mut self.functions else { return };
        for firing in self.firings.drain(..) {
            recorder.fired(&firing);
        }
        recorder.state(report.state, report.sample.tick, over);
        recorder.take_samples();
        self.tell_functions(sink);
    }

    fn tell_functions(&mut self, sink: &mut dyn RecordSink) {
        let Some(recorder) = &mut self.functions else { return };
        for row in recorder.take_rows() {
            if let Some(stream) = recorder.stream(row.stream) {
                sink.recorded(&row, stream);
            }
        }
        for told in recorder.take_told() {
            self.emit(
                trace::record::EVENT,
                told.step,
                told.tick,
                told.data.into_iter().collect(),
                sink,
            );
        }
    }

    fn emit(&mut self, kind: &str, step: StepId, tick: Tick, mut data: Detail, sink: &mut dyn RecordSink) {
        if let Some(recorder) = &mut self.functions
            && trace::record::CONTROL_EVENTS.contains(&kind)
        {
            recorder.control_event(kind, &data, tick, step);
        }
        data.insert("step".to_owned(), Value::from(step.0));
        data.insert("tick".to_owned(), Value::from(tick.0));
        let event = self.chain.append(self.start.at(tick), kind, data);
        sink.event(&event);
    }

    /// True for a step whose condition is still on its way into the machine: its turn comes when that is decided.
    fn is_loading(&self, pending: &Pending) -> bool {
        matches!((pending, &self.to_load), (Pending::Step(step), Some((_, _, loading))) if step.id == *loading)
    }

    /// Events of the steps whose turn has come.
    fn tell_steps(&mut self, report: &Report, sink: &mut dyn RecordSink) {
        let tick = report.sample.tick;
        while self
            .pending
            .front()
            .is_some_and(|(after, pending)| *after <= report.counters.completed && !self.is_loading(pending))
        {
            match self.pending.pop_front() {
                None => return,
                Some((_, Pending::Step(step))) => {
                    if let Some(recorder) = &mut self.functions {
                        recorder.step(&step, tick);
                    }
                    let Some((kind, mut data)) = events::of_step(&step) else {
                        continue;
                    };
                    if matches!(&step.kind, StepKind::Begin(marker) if marker.level == Level::Workingstep) {
                        self.workingsteps += 1;
                        data.insert("workingstep".to_owned(), Value::from(self.workingsteps));
                    }
                    if matches!(step.kind, StepKind::Register(_)) {
                        // Who changed an offset is a line of a program.
                        data.insert("file".to_owned(), Value::from(self.source.file_name(step.origin.file)));
                        if let Place::Text { line, .. } = step.origin.place {
                            data.insert("line".to_owned(), Value::from(line));
                        }
                    }
                    self.emit(kind, step.id, tick, data, sink);
                }
                Some((after, Pending::Alarm(alarm))) => {
                    self.pending.push_front((after, Pending::Alarm(alarm)));
                    self.tell_alarm(tick, sink);
                }
            }
        }
    }

    /// True when nothing but an alarm is left to tell.
    fn alarms_next(&self) -> bool {
        matches!(self.pending.front(), Some((_, Pending::Alarm(_))))
    }

    fn tell_alarm(&mut self, tick: Tick, sink: &mut dyn RecordSink) {
        if let Some((_, Pending::Alarm(alarm))) = self.pending.pop_front() {
            self.emit("alarm", self.last_step, tick, events::of_alarm(&alarm), sink);
            self.alarm = Some(Box::new(alarm));
        }
    }

    /// Events of what the machine counts.
    fn tell_counts(&mut self, report: &Report, sink: &mut dyn RecordSink) {
        let (old, new) = (self.counters, report.counters);
        if old == new {
            return;
        }
        self.counters = new;
        let Sample { tick, step, .. } = report.sample;
        if new.late_ticks > old.late_ticks {
            let lost = new.late_ticks - old.late_ticks;
            self.emit("late", step, tick, detail(json!({ "lost_ticks": lost })), sink);
        }
        for (kind, before, after) in [
            ("following-warning", old.following_warnings, new.following_warnings),
            ("in-position-timeout", old.in_position_time_outs, new.in_position_time_outs),
            ("encoder-bridged", old.bridged_readings, new.bridged_readings),
            ("spindle-limited", old.spindle_limited, new.spindle_limited),
            ("off-path-stop", old.off_path_stops, new.off_path_stops),
            ("starved", old.starvations, new.starvations),
        ] {
            if after > before {
                self.emit(kind, step, tick, detail(json!({ "count": after - before })), sink);
            }
        }
    }

    /// Events of the overrides. Below what was planned for the machine runs slower by itself; for more the rest is planned anew.
    fn tell_overrides(&mut self, report: &Report, sink: &mut dyn RecordSink) {
        let (before, after) = (self.overrides, report.overrides);
        if before == after {
            return;
        }
        self.overrides = after;
        let planned = |o: Overrides| o.feed_fraction().max(1.0);
        if planned(before) != planned(after) {
            self.source.set_override(planned(after), 1.0);
        }
        let Sample { tick, step, .. } = report.sample;
        let data = json!({ "feed_percent": after.feed, "rapid_percent": after.rapid, "spindle_percent": after.spindle });
        self.emit("override", step, tick, detail(data), sink);
    }

    /// Events of the machine's states.
    fn tell_state(&mut self, report: &Report, sink: &mut dyn RecordSink) {
        let (before, after) = (self.state, report.state);
        if before == after {
            self.waited += 1;
            return;
        }
        self.state = after;
        self.waited = 0;
        self.commands_at_change = self.commands;
        let Sample { tick, step, .. } = report.sample;
        let (kind, data) = match after {
            // One wait may follow the other; the hold is the same.
            State::WaitingThenHold(_) if matches!(before, State::WaitingThenHold(_)) => return,
            State::Holding | State::WaitingThenHold(_) => ("hold", Detail::new()),
            State::Held if before == State::Waiting(Wait::Commands) => ("hold", Detail::new()),
            // It may wait for something in the very cycle in which it goes on.
            State::Running | State::Resuming | State::Waiting(_)
                if matches!(
                    before,
                    State::Held | State::Paused | State::Holding | State::WaitingThenHold(_) | State::Stopped(_)
                ) =>
            {
                ("cycle-start", Detail::new())
            }
            State::Homing { .. } if matches!(before, State::NotHomed | State::Ready) => ("homing", Detail::new()),
            State::Stopping(cause) => ("controlled-stop", events::of_stop(cause)),
            State::Stopped(cause) => {
                // A stop at rest is begun and over in one cycle.
                if !matches!(before, State::Stopping(_)) {
                    self.emit("controlled-stop", step, tick, events::of_stop(cause), sink);
                }
                ("stopped", events::of_stop(cause))
            }
            State::EmergencyStop => ("emergency-stop", Detail::new()),
            State::EmergencyStopReleased => ("emergency-stop-released", Detail::new()),
            State::Fault(cause) => ("fault", events::of_fault(cause)),
            _ => return,
        };
        self.emit(kind, step, tick, data, sink);
    }

    /// A question is answered when everything before it is done and the machine stands.
    fn answer_question(&mut self, report: &Report, sink: &mut dyn RecordSink) {
        if !self.orders.is_empty() || self.to_load.is_some() {
            return;
        }
        let everything_done = report.idle && report.counters.completed == self.commands && self.waiting.is_none();
        if !everything_done || !self.pending.is_empty() || !stands(report) {
            return;
        }
        let Some(question) = self.asked.take() else { return };
        let of_the_functions = self.of_the_functions(&question);
        let answer = match (&question, &mut self.answers) {
            _ if of_the_functions.is_some() => of_the_functions.unwrap_or(Answer::Unknown),
            (Question::OptionalStop, _) => Answer::Truth(self.operator.optional_stop),
            (_, Some(answers)) => match answers(&question, &report.sample) {
                Answer::Unknown => of_the_machine(&question, &report.sample, self.start),
                known => known,
            },
            (_, None) => of_the_machine(&question, &report.sample, self.start),
        };
        let data = events::of_question(&question, answer);
        self.emit("question", self.last_step, report.sample.tick, data, sink);
        self.answer = Some(answer);
    }

    /// What the functions of the program know: variables that they wrote, sensors and times that conditions name.
    fn of_the_functions(&self, question: &Question) -> Option<Answer> {
        let recorder = self.functions.as_ref()?;
        match question {
            Question::Condition(condition) => match condition.evaluate(&|name| recorder.lookup(name)).ok()? {
                plan::Value::Truth(truth) => Some(Answer::Truth(truth)),
                plan::Value::Number(_) => None,
            },
            Question::Number(name) => match recorder.lookup(name)? {
                plan::Value::Number(number) => Some(Answer::Number(Some(number))),
                plan::Value::Truth(truth) => Some(Answer::Truth(truth)),
            },
            Question::OptionalStop | Question::Skip { .. } => None,
        }
    }

    /// True when there is nothing left of the program to do or to tell.
    fn is_all_done(&self, report: &Report) -> bool {
        self.source_over
            && self.waiting.is_none()
            && self.orders.is_empty()
            && self.to_load.is_none()
            && self.pending.is_empty()
            && report.counters.completed == self.commands
    }

    /// Whether the run is over, and what is asked of the machine.
    fn decide(&mut self, report: &Report, sink: &mut dyn RecordSink) -> Option<Request> {
        let all_done = self.is_all_done(report);
        let at_rest = stands(report);
        let mut request = None;
        let mut ended = None;
        match report.state {
            State::Ready if all_done && at_rest => ended = Some(self.alarm.clone().map_or(Ended::Completed, Ended::Alarm)),
            // The program alarmed: what came before is done, the machine stops for good.
            State::Running | State::Waiting(Wait::Commands) if self.alarm.is_some() && report.idle => {
                request = Some(Request::Stop);
            }
            State::Stopped(cause) if self.alarm.is_some() && at_rest => {
                ended = Some(self.alarm.clone().map_or(Ended::Stopped(cause), Ended::Alarm));
            }
            // It alarmed in the middle of a motion: the path ends there, and so does the run.
            State::Stopped(StopCause::Starved) if at_rest && self.alarms_next() => {
                self.tell_alarm(report.sample.tick, sink);
            }
            State::Stopped(cause) if cause.can_go_on() && at_rest => {
                // Going on makes sense when something new has come since the stop.
                let news = self.commands > self.commands_at_change;
                let none_to_come = self.asked.is_some() || (self.source_over && self.waiting.is_none());
                match self.operator.cycle_start_after {
                    Some(cycles) if news => {
                        if self.waited >= cycles {
                            request = Some(Request::CycleStart);
                        }
                    }
                    Some(_) if !none_to_come && self.waited < PATIENCE => {}
                    _ => ended = Some(Ended::Stopped(cause)),
                }
            }
            State::Stopped(cause) if at_rest => ended = Some(Ended::Stopped(cause)),
            State::EmergencyStop | State::EmergencyStopReleased if at_rest => ended = Some(Ended::EmergencyStop),
            State::Fault(cause) if at_rest => ended = Some(Ended::Fault(cause)),
            // Somebody who is there homes it; what was asked goes on then.
            State::NotHomed if at_rest => match self.operator.cycle_start_after {
                // The request may have been lost with a connection: a person presses the button again.
                Some(cycles) if self.waited % (cycles + ASKS_AGAIN) == cycles => request = Some(Request::Home),
                Some(_) => {}
                None => ended = Some(Ended::NotHomed),
            },
            State::Paused | State::Held if at_rest => match self.operator.cycle_start_after {
                Some(cycles) if self.waited >= cycles => request = Some(Request::CycleStart),
                Some(_) => {}
                None => ended = Some(Ended::Waiting),
            },
            _ => {}
        }
        // Rest has to last: the axes settle, and noise can hide a slow motion.
        if let Some(ended) = ended
            && self.waited.min(self.stood) >= SETTLING
        {
            self.end(ended, &report.sample, &report.counters, sink);
        }
        request
    }

    /// The run is over.
    fn end(&mut self, ended: Ended, last: &Sample, counters: &Counters, sink: &mut dyn RecordSink) {
        let data = detail(json!({
            "ended": ended.word(),
            "text": ended.text(),
            "commands": self.commands,
            "completed": counters.completed,
            "discarded": counters.discarded,
        }));
        if let Some(recorder) = &mut self.functions {
            recorder.finish(last.tick);
        }
        self.tell_functions(sink);
        self.emit("job-ended", last.step, last.tick, data, sink);
        self.ended = Some(ended);
    }
}

fn stops_a_condition(command: &Command) -> bool {
    matches!(
        command,
        Command::Watch {
            order: WatchOrder::Stop(_),
            ..
        }
    )
}

/// No axis is faster than the noise of its encoder: whether it really stands shows over time.
fn stands(report: &Report) -> bool {
    report.sample.velocity.iter().all(|v| v.abs() < SLOW)
}
