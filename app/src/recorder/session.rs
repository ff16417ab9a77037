//! The loop of a recording: does what the client says, and gives the sink what came of it.

use super::{Refused, Sink};
use crate::clock;
use crate::failure::{Exit, Failure};
use crate::net::Connection;
use crate::progress::Progress;
use mtconnect::client::gap::GapCause;
use mtconnect::client::session::{Action, Client, Counters, Ending, Event};
use plan::Diagnostic;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// What is kept is on the medium after so long at most.
const SYNC: Duration = Duration::from_millis(100);
/// The longest wait in one piece, so that a stop is heard.
const SLICE: Duration = Duration::from_millis(50);
/// When nothing came for so long, what waits for more is written.
const REST: Duration = Duration::from_millis(500);
/// Pause before the disk is tried again.
const DISK_PAUSE: Duration = Duration::from_secs(1);

/// How a recording ended.
#[derive(Debug)]
pub struct Ended {
    /// What happened on the line.
    pub counters: Counters,
    /// What was odd.
    pub diagnostics: Vec<Diagnostic>,
    /// How often the disk refused.
    pub disk_refusals: u64,
    /// Observations that could not be written before the end, in the disk's words.
    pub unwritten: Option<String>,
    /// Why it ended: `stopped`, `duration`.
    pub because: &'static str,
}

/// Records until it is stopped, or `duration` is over.
///
/// # Errors
/// There is no agent, or it refuses the query, or the sink has no use for what it tells.
pub fn record(
    mut client: Client,
    host: (&str, u16),
    sink: &mut dyn Sink,
    duration: Option<Duration>,
    stop: &Arc<AtomicBool>,
) -> Result<Ended, Failure> {
    let began = Instant::now();
    let mut line: Option<Connection> = None;
    let mut buffer = vec![0; 1 << 18];
    let mut synced = Duration::ZERO;
    let mut heard = Duration::ZERO;
    let mut disk = DiskTrouble::default();
    let mut said_trouble = None;
    let mut progress = Progress::new("recording");
    let because = loop {
        let now = began.elapsed();
        if stop.load(Ordering::Relaxed) {
            break "stopped";
        }
        if duration.is_some_and(|d| now >= d) {
            break "duration";
        }
        let slice = |until: Duration| until.saturating_sub(now).min(SLICE);
        match client.action(now) {
            Action::Connect => match Connection::open(host.0, host.1) {
                Ok(open) => {
                    line = Some(open);
                    client.connected(began.elapsed());
                }
                Err(error) => client.closed(began.elapsed(), &error.to_string()),
            },
            Action::Send(bytes) => {
                let sent = line.as_mut().map(|line| line.send(&bytes));
                if let Some(Err(error)) = sent {
                    line = None;
                    client.closed(began.elapsed(), &error.to_string());
                }
            }
            Action::Receive(until) => {
                let Some(open) = &mut line else {
                    client.closed(now, "there is no connection");
                    continue;
                };
                match open.receive(&mut buffer, slice(until)) {
                    Ok(None) => {}
                    Ok(Some(count)) => {
                        heard = began.elapsed();
                        client.received(heard, &buffer[..count]);
                    }
                    Err(error) => {
                        line = None;
                        client.closed(began.elapsed(), &error.to_string());
                    }
                }
            }
            Action::Wait(until) => std::thread::sleep(slice(until)),
            Action::Close => line = None,
            Action::Stop(ending) => {
                return Err(match ending {
                    Ending::Unreachable(why) => Failure::machine(format_args!(
                        "{}:{}: {why}; look at the address, the network and whether the agent runs",
                        host.0, host.1
                    )),
                    Ending::NotAnAgent(why) => Failure::unreadable(why),
                    Ending::Refused(why) => Failure::usage(why),
                });
            }
        }
        let mut kept = take(&mut client, sink);
        let now = began.elapsed();
        if kept.is_ok() && now.saturating_sub(heard) > REST {
            kept = sink.rest();
        }
        if kept.is_ok() && now.saturating_sub(synced) >= SYNC {
            synced = now;
            kept = sink.sync();
        }
        match kept {
            Ok(()) => disk.is_good(sink),
            Err(Refused::Never(failure)) => return Err(failure),
            Err(Refused::Disk(why)) => {
                disk.refuses(why);
                if let Some(position) = sink.kept() {
                    client.go_back(now, position, DISK_PAUSE, GapCause::NotStored);
                }
            }
        }
        let trouble = client.trouble().map(str::to_owned);
        if trouble != said_trouble && client.counters().documents > 0 {
            if let Some(why) = &trouble {
                eprintln!("{}: no data: {why}; trying again", clock::utc(clock::start_time(None)?));
            } else {
                eprintln!("{}: data again", clock::utc(clock::start_time(None)?));
            }
            said_trouble = trouble;
        }
        progress.at(|| words(sink, &client.counters(), began.elapsed()));
    };
    client.finish();
    let mut last = take(&mut client, sink);
    if last.is_ok() {
        last = sink.close(clock::start_time(None)?);
    }
    let unwritten = match last {
        // What was refused last has not come again.
        Ok(()) => disk.refused.then_some(disk.why),
        Err(Refused::Disk(why)) => Some(why),
        Err(Refused::Never(failure)) => return Err(failure),
    };
    if client.counters().documents == 0 && because == "duration" {
        let why = client.trouble().unwrap_or("it did not answer").to_owned();
        return Err(Failure {
            exit: Exit::Machine,
            message: format!(
                "error: {}:{}: no agent was reached before the duration was over: {why}",
                host.0, host.1
            ),
        });
    }
    Ok(Ended {
        counters: client.counters(),
        diagnostics: client.diagnostics().as_slice().to_vec(),
        disk_refusals: disk.count,
        unwritten,
        because,
    })
}

/// Gives the sink everything that came.
fn take(client: &mut Client, sink: &mut dyn Sink) -> Result<(), Refused> {
    let events: Vec<Event> = client.take_events().collect();
    for event in &events {
        match event {
            Event::Agent(_) => {}
            Event::Observations(told) => sink.observations(told, client.items())?,
            Event::Gap(gap) => sink.gap(gap)?,
        }
    }
    match client.position() {
        Some(position) => sink.reached(position),
        None => Ok(()),
    }
}

/// What a person should know about the disk, once.
#[derive(Default)]
struct DiskTrouble {
    count: u64,
    refused: bool,
    why: String,
    observations: u64,
}

impl DiskTrouble {
    fn refuses(&mut self, why: String) {
        self.count += 1;
        if !self.refused {
            eprintln!("error: {why}: nothing is kept any more; recording goes on when the disk takes it again");
        }
        (self.refused, self.why) = (true, why);
    }

    fn is_good(&mut self, sink: &dyn Sink) {
        let observations = sink.tally().observations;
        if self.refused && observations > self.observations {
            eprintln!("the disk takes it again: recording goes on");
            self.refused = false;
        }
        if !self.refused {
            self.observations = observations;
        }
    }
}

fn words(sink: &dyn Sink, counters: &Counters, running: Duration) -> String {
    let tally = sink.tally();
    let rate = tally.observations as f64 / running.as_secs_f64().max(0.001);
    let lag = counters.agent_last.saturating_sub(tally.last_sequence.unwrap_or(0));
    format!(
        "{} observations, {:.1} MB, {rate:.0}/s, {} gaps, {lag} behind the agent",
        tally.observations,
        tally.bytes as f64 * 1e-6,
        tally.gaps.len()
    )
}
