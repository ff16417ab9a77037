//! The receiving and the sending task of the published text protocol: lines in on one connection, a few lines back on another, which the
//! controller opens itself.
//!
//! The protocol reports nothing that a record could be made of, so the controller keeps the record of what it machines
//! ([`super::recording`]).

use super::realtime::{AtOnce, Ends, Queued, Told};
use super::recording::Recording;
use super::serving::{Served, Trouble, stands};
use crate::link::socket::Socket;
use cell::link::{TextNotice, TextOrder, TextReceiver};
use machine::{Report, Request, State};
use std::io::ErrorKind;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant};

/// How often the thread looks.
const LOOK: Duration = Duration::from_millis(1);
/// How long the driving side may take to answer when its report port is connected to.
const CONNECT: Duration = Duration::from_millis(300);
/// How long a machine may take to come to rest when the process ends.
const COMING_TO_REST: Duration = Duration::from_secs(20);
/// On a simulated machine somebody acknowledges a stop after so long.
const ACKNOWLEDGED: Duration = Duration::from_millis(500);

/// Where and how it serves.
pub struct Place<'a> {
    /// Where lines come in.
    pub listener: &'a TcpListener,
    /// Port of the driving side for the lines back.
    pub report_port: u16,
    /// Somebody stands at the machine and acknowledges what can be acknowledged.
    pub attended: bool,
}

/// Serves until `stop`, then stops the machine on its path.
pub fn serve(
    place: &Place<'_>,
    mut receiver: TextReceiver,
    mut ends: Ends,
    recording: &mut Option<Recording>,
    stop: &AtomicBool,
    say: &mut dyn FnMut(&str),
) -> Served {
    let mut client: Option<(u32, Socket)> = None;
    let mut back: Option<Socket> = None;
    let mut connections = 0;
    let mut served = Served::default();
    let mut urgent: Option<Request> = None;
    let mut last: Option<Report> = None;
    let mut stopped_since: Option<Instant> = None;
    let mut stopping: Option<Instant> = None;
    // Commands that went to the realtime thread.
    let mut given: u64 = 0;
    let mut bytes = Vec::new();
    let mut trouble = Trouble::default();
    loop {
        // ---- the receiving task
        while let Some((stream, from)) = accepted(place.listener) {
            connections += 1;
            if !receiver.connected(connections) {
                served.refused += 1;
                continue;
            }
            served.senders += 1;
            match Socket::new(stream, None) {
                Ok(socket) => client = Some((connections, socket)),
                Err(_) => receiver.disconnected(connections),
            }
            let to = SocketAddr::new(from.ip(), place.report_port);
            back = TcpStream::connect_timeout(&to, CONNECT)
                .and_then(|stream| Socket::new(stream, None))
                .ok();
            if back.is_none() {
                say(&format!(
                    "nobody listens for reports on {to}: the driving side will hear of no emergency stop"
                ));
            }
        }
        if let Some((number, socket)) = &mut client
            && receiver.reads()
        {
            bytes.clear();
            let read = socket.read(&mut bytes);
            receiver.receive(*number, &bytes);
            if read.is_err() {
                receiver.disconnected(*number);
                client = None;
                back.take().into_iter().for_each(Socket::close);
            }
        }
        while let Some(request) = urgent.take().or_else(|| receiver.urgent()) {
            if ends.at_once.push(AtOnce::Request(request)).is_err() {
                urgent = Some(request);
                break;
            }
        }
        while urgent.is_none()
            && let Some(order) = receiver.order()
        {
            let taken = match (order, order.request()) {
                (TextOrder::Command(command), _) => ends.queued.push(Queued::Command(command)).is_ok(),
                (_, Some(request)) => ends.at_once.push(AtOnce::Request(request)).is_ok(),
                (_, None) => true,
            };
            if !taken {
                receiver.give_back(order);
                break;
            }
            given += u64::from(matches!(order, TextOrder::Command(_)));
        }

        // ---- the sending task
        while let Ok(Told { report, .. }) = ends.told.pop() {
            served.counters = report.counters;
            last = Some(report);
            if let Some(line) = trouble.line(report.state) {
                say(&line);
            }
            receiver.reported(&report);
            let done = report.counters.completed + report.counters.discarded;
            if let Some(recording) = recording
                && let Some(line) = recording.hear(&report, receiver.machining(), given.saturating_sub(done))
            {
                say(&line);
            }
        }
        served.lost_reports = ends.lost_reports.load(Relaxed);
        while let Some(line) = receiver.told() {
            let sent = back
                .as_mut()
                .map(|socket| socket.write(line.text().bytes()).and_then(|()| socket.flush()));
            if matches!(sent, Some(Err(_))) {
                back = None;
            }
        }
        while let Some(notice) = receiver.notice() {
            if matches!(notice, TextNotice::Stopped(_)) {
                served.losses += 1;
            }
            say(&notice.to_string());
        }
        if place.attended {
            acknowledge(last.as_ref(), &mut stopped_since, &mut ends, stop);
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
                client
                    .into_iter()
                    .map(|(_, socket)| socket)
                    .chain(back)
                    .for_each(Socket::close);
                return served;
            }
        }
        std::thread::sleep(LOOK);
    }
}

fn accepted(listener: &TcpListener) -> Option<(TcpStream, SocketAddr)> {
    loop {
        match listener.accept() {
            Ok(accepted) => return Some(accepted),
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            // Nobody, or nobody any more.
            Err(_) => return None,
        }
    }
}

fn acknowledge(last: Option<&Report>, since: &mut Option<Instant>, ends: &mut Ends, stop: &AtomicBool) {
    let stopped = last.is_some_and(|report| {
        let can_be = matches!(
            report.state,
            State::Stopped(_) | State::EmergencyStopReleased | State::Fault(_)
        );
        can_be && stands(report)
    });
    if !stopped || stop.load(Relaxed) {
        *since = None;
        return;
    }
    if since.get_or_insert_with(Instant::now).elapsed() > ACKNOWLEDGED {
        *since = None;
        let _ = ends.at_once.push(AtOnce::Request(Request::Reset));
    }
}
