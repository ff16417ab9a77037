//! A program walked through without moving anything, with the answers that its run got from the machine.

use crate::failure::Failure;
use crate::program::Program;
use crate::shop;
use crate::survey::beforehand;
use ledger::Event;
use plan::{Answer, Modal, Next, Question, Step, Tables};
use serde_json::Value;
use std::collections::VecDeque;
use store::{DataDirectory, Job, JobId, Log};

/// Events of a job that are read at once.
const EVENTS: usize = 10_000;

/// What the program asks on the way, answered as in the run before, as far as its log goes.
#[derive(Clone, Debug, Default)]
pub struct Answers {
    of_the_run: VecDeque<Option<Value>>,
}

impl Answers {
    /// The answers in the log of a job. Where it took up another one, what was asked before that stands in the other's log.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn of(directory: &DataDirectory, job: &Job) -> Result<Answers, Failure> {
        let mut parts = vec![];
        let mut job = job.clone();
        let mut before = u64::MAX;
        loop {
            let mut told: Vec<Option<Value>> = vec![];
            let mut taken_up = None;
            each_event(directory, &job, |event| {
                let step = event.detail.get("step").and_then(Value::as_u64).unwrap_or(0);
                if event.kind == "question" && step < before {
                    told.push(event.detail.get("answer").cloned());
                }
                taken_up = taken_up.take().or_else(|| event.detail.get("taken_up").cloned());
            })?;
            parts.push(told);
            let number = |name: &str| taken_up.as_ref()?.get(name)?.as_u64();
            // A job is taken up by a later one, so this ends.
            let earlier = number("after_job")
                .and_then(|id| i64::try_from(id).ok())
                .filter(|id| *id < job.id.0);
            let (Some(earlier), Some(step)) = (earlier, number("step")) else {
                break;
            };
            before = before.min(step);
            job = directory.job(JobId(earlier)).map_err(shop::failure)?;
        }
        Ok(Answers {
            of_the_run: parts.into_iter().rev().flatten().collect(),
        })
    }

    /// The answers among the events of one run.
    pub fn of_events(events: &[Event]) -> Answers {
        let questions = events.iter().filter(|event| event.kind == "question");
        Answers {
            of_the_run: questions.map(|event| event.detail.get("answer").cloned()).collect(),
        }
    }

    /// The next one.
    pub fn answer(&mut self, question: &Question) -> Answer {
        let Some(told) = self.of_the_run.pop_front() else {
            return beforehand(question);
        };
        let place = |value: &Value| {
            let list: Vec<f64> = value.as_array()?.iter().filter_map(Value::as_f64).collect();
            <[f64; 3]>::try_from(list).ok().map(units::Point::from_xyz)
        };
        // The log leaves out what is null: a number that was vacant, a signal that did not come.
        match (question, told) {
            (_, Some(Value::String(_))) => Answer::Unknown,
            (Question::OptionalStop | Question::Condition(_), Some(Value::Bool(truth))) => Answer::Truth(truth),
            (Question::Number(_), number) => Answer::Number(number.and_then(|n| n.as_f64())),
            (Question::Skip { .. }, found) => Answer::Place(found.as_ref().and_then(place)),
            _ => beforehand(question),
        }
    }
}

/// Every event of a job, in order.
///
/// # Errors
/// The disk refuses.
pub fn each_event(directory: &DataDirectory, job: &Job, mut hear: impl FnMut(&Event)) -> Result<(), Failure> {
    let mut from = 1;
    loop {
        let events = directory.events(Log::Job(job.id), from, EVENTS).map_err(shop::failure)?;
        let Some(last) = events.last() else { return Ok(()) };
        from = last.sequence + 1;
        events.iter().for_each(&mut hear);
    }
}

/// Walks through a program without moving anything, as long as `each` says so; gives why it could not be read to its end.
///
/// # Errors
/// It cannot be read at all.
pub fn walk(
    program: &Program,
    tables: &Tables,
    answers: &Answers,
    mut each: impl FnMut(&Step, &Modal) -> bool,
) -> Result<Option<String>, Failure> {
    let mut stream = program.stream(tables)?;
    let mut answers = answers.clone();
    let mut modal = Modal::default();
    let mut reply = None;
    loop {
        match stream.next(reply.take()) {
            Next::Step(step) => {
                if !each(&step, &modal) {
                    return Ok(None);
                }
                modal.follow(&step);
            }
            Next::Ask(question) => reply = Some(answers.answer(&question)),
            Next::End => return Ok(None),
            Next::Alarm(alarm) => return Ok(Some(alarm.to_string())),
        }
    }
}
