//! The receiving and the sending task of the default link: what came goes into the rings of the realtime thread, its reports go out.
//!
//! Both are steps of one ordinary thread, because one session and one encrypted connection are behind them; nothing in it makes the
//! realtime thread wait, and when it dies the machine stops on the stop tail that is in its queue already.

use super::realtime::{AtOnce, Ends, Queued, Told};
use crate::link::certificates::Server;
use crate::link::socket::Socket;
use cell::link::{Connection, LinkReceiver, Notice};
use machine::link::UrgentOrder;
use machine::{Counters, Report, Request, State, StopCause};
use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::net::TcpListener;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant};
use units::Tick;

/// How often the thread looks.
const LOOK: Duration = Duration::from_millis(1);
/// Connections at once at most: one drives, the others hear that it does.
const MOST: usize = 16;
/// How long a machine may take to come to rest when the process ends.
const COMING_TO_REST: Duration = Duration::from_secs(20);

/// What was seen while it served.
#[derive(Clone, Copy, Debug, Default)]
pub struct Served {
    /// The machine's counters at the end.
    pub counters: Counters,
    /// Senders that drove it.
    pub senders: u64,
    /// Senders that were turned away.
    pub refused: u64,
    /// Times the link was lost while it drove.
    pub losses: u64,
    /// Reports that nobody took.
    pub lost_reports: u64,
    /// It stood when the process ended.
    pub at_rest: bool,
}

/// Serves until `stop`, then stops the machine on its path.
pub fn serve(
    listener: &TcpListener,
    server: Option<&Server>,
    mut receiver: LinkReceiver,
    mut ends: Ends,
    stop: &AtomicBool,
    say: &mut dyn FnMut(&str),
) -> Served {
    let began = Instant::now();
    let mut sockets: BTreeMap<Connection, Socket> = BTreeMap::new();
    let mut last_number: Connection = 0;
    let mut served = Served::default();
    let mut urgent: Option<UrgentOrder> = None;
    let mut last: Option<Report> = None;
    let mut lost_told = 0;
    let mut trouble = Trouble::default();
    let mut said = String::new();
    let mut stopping: Option<Instant> = None;
    let (mut bytes, mut out) = (Vec::new(), Vec::new());
    loop {
        let now = Tick(u64::try_from(began.elapsed().as_millis()).unwrap_or(u64::MAX));
        accept(listener, server, &mut sockets, &mut last_number, &mut receiver, now);

        // ---- the receiving task
        let mut gone = Vec::new();
        for (&connection, socket) in &mut sockets {
            if !receiver.reads(connection) {
                continue;
            }
            bytes.clear();
            let read = socket.read(&mut bytes);
            receiver.receive(connection, now, &bytes);
            if read.is_err() {
                // Before the next one is heard: when this process was away its sender has tried again and again, and each try would find
                // the one before still there and be refused.
                receiver.disconnected(connection, now);
                gone.push(connection);
            }
        }
        for connection in gone.drain(..) {
            sockets.remove(&connection).into_iter().for_each(Socket::close);
        }
        receiver.pass(now);
        while let Some(order) = urgent.take().or_else(|| receiver.urgent()) {
            if ends.at_once.push(AtOnce::Order(order)).is_err() {
                urgent = Some(order);
                break;
            }
        }
        // What is urgent goes before what it is about.
        while urgent.is_none()
            && let Some(order) = receiver.order()
        {
            if ends.queued.push(Queued::Order(order)).is_err() {
                receiver.give_back(order);
                break;
            }
        }

        // ---- the sending task
        while let Ok(Told { report, status }) = ends.told.pop() {
            served.counters = report.counters;
            last = Some(report);
            if let Some(line) = trouble.line(report.state) {
                say(&line);
            }
            while ends.firings.peek().is_ok_and(|firing| firing.tick <= report.sample.tick) {
                ends.firings.pop().into_iter().for_each(|firing| receiver.fired(firing));
            }
            receiver.reported(report, status);
        }
        while let Ok(lives) = ends.lives.pop() {
            receiver.lives(now, lives);
        }
        let lost = ends.lost_reports.load(Relaxed);
        if lost > lost_told {
            receiver.reports_lost(lost - lost_told);
            lost_told = lost;
        }
        for (&connection, socket) in &mut sockets {
            out.clear();
            let open = receiver.output(connection, now, &mut out);
            let written = socket.write(&out).and_then(|()| socket.flush());
            if !matches!((open, written), (true, Ok(_)) | (false, Ok(false))) {
                gone.push(connection);
            }
        }
        for connection in gone {
            if let Some(socket) = sockets.remove(&connection) {
                receiver.disconnected(connection, now);
                socket.close();
            }
        }
        while let Some(notice) = receiver.notice() {
            match &notice {
                Notice::Taken { continues: false, .. } => served.senders += 1,
                Notice::Refused { .. } => served.refused += 1,
                _ => {}
            }
            // Who waits for the machine asks again and again.
            let line = notice.to_string();
            if line != said {
                say(&line);
                said = line;
            }
        }

        // ---- the end
        if stop.load(Relaxed) {
            let since = *stopping.get_or_insert_with(|| {
                // Full is no answer here: it is the only thing that is asked for.
                let _ = ends.at_once.push(AtOnce::Request(Request::Stop));
                Instant::now()
            });
            let rests = last.is_some_and(|report| stands(&report));
            if (rests && since.elapsed() > Duration::from_millis(100)) || since.elapsed() > COMING_TO_REST {
                served.at_rest = rests;
                served.losses = receiver.counts().losses;
                served.lost_reports = lost_told;
                sockets.into_values().for_each(Socket::close);
                return served;
            }
        }
        std::thread::sleep(LOOK);
    }
}

fn accept(
    listener: &TcpListener,
    server: Option<&Server>,
    sockets: &mut BTreeMap<Connection, Socket>,
    last: &mut Connection,
    receiver: &mut LinkReceiver,
    now: Tick,
) {
    while sockets.len() < MOST {
        let stream = match listener.accept() {
            Ok((stream, _)) => stream,
            Err(error) if error.kind() == ErrorKind::Interrupted => continue,
            // Nobody, or nobody any more.
            Err(_) => return,
        };
        let tls = server.map(Server::connection).transpose();
        let Ok(socket) = tls.and_then(|tls| Socket::new(stream, tls)) else {
            continue;
        };
        *last = last.wrapping_add(1);
        sockets.insert(*last, socket);
        receiver.connected(*last, now);
    }
}

/// What the machine cannot go on with, each once as it begins.
#[derive(Default)]
pub struct Trouble {
    before: State,
}

impl Trouble {
    /// The line for whoever looks at the controller.
    pub fn line(&mut self, state: State) -> Option<String> {
        let before = std::mem::replace(&mut self.before, state);
        match state {
            State::Fault(cause) if before != state => Some(format!("fault: {cause}")),
            State::Stopping(cause @ StopCause::Late { .. }) if before != state => Some(format!("controlled stop: {cause}")),
            _ => None,
        }
    }
}

/// The axes stand, and nothing makes them go.
pub fn stands(report: &Report) -> bool {
    let slow = report.sample.velocity.iter().all(|v| v.abs() < 2.0);
    slow && (report.idle || report.state.needs_a_person())
}
