//! The controller's side of the link: who may drive the machine, what came, and what is told.
//!
//! It runs in the tasks that receive and send. What it hands to the realtime thread are [`Order`]s and [`UrgentOrder`]s; what it hears
//! from there are reports and the follower's account.

mod coming;
mod living;
mod telling;

use super::error::LinkError;
use super::wire::{Came, Wired};
use super::words;
use living::Register;
use machine::link::message::{
    AXES, BLOCK, BlockHead, HEARTBEAT, Hello, LoadHead, LoadWhat, ReportsHead, SILENCE, SenderHeartbeat, TAIL, UNITS, Welcome,
};
use machine::link::{Entry, Kind, LimitsHash, LoadPart, Name, Order, PlanId, Reader, Refusal, Status, Urgent, UrgentOrder, Wire};
use machine::watch::condition::LONGEST;
use machine::watch::{ALARMS_OF_A_WATCH, Firing};
use machine::{Command, MachineParameters, Quality, Report, State};
use std::collections::{BTreeMap, VecDeque};
use units::Tick;

/// A number for a connection, given by the shell; none that is in use.
pub type Connection = u32;

/// After this many cycles without its holder the lease is free, if the machine does nothing.
pub const LEASE: u64 = 5_000;
/// Reports that are kept for a sender that is away: eight seconds.
const KEPT_REPORTS: usize = 8_192;
/// Reports in one frame at most.
const REPORTS_IN_A_FRAME: usize = 64;
/// Firings that are kept with them: what comes beyond is lost, and counted.
const KEPT_FIRINGS: usize = 65_536;
/// Firings in one frame, beyond which it takes no further report. Those of one cycle are fewer than the machine keeps.
const FIRINGS_IN_A_FRAME: usize = 1_024;
/// Orders that wait for the realtime thread before bytes are left in the socket.
const WAITING_ORDERS: usize = 2_048;

/// What the machine says of itself.
#[derive(Clone, Debug, PartialEq)]
pub struct MachineCard {
    /// Its name.
    pub name: String,
    /// What its measurements are worth.
    pub quality: Quality,
    /// Its limits.
    pub limits: LimitsHash,
    /// Reports that are sent together; 1 sends each at once.
    pub batch: usize,
}

impl MachineCard {
    /// The card of a machine; ten reports go together.
    pub fn new(name: &str, quality: Quality, parameters: &MachineParameters) -> Self {
        MachineCard {
            name: name.to_owned(),
            quality,
            limits: LimitsHash::of(parameters),
            batch: 10,
        }
    }
}

/// Something for the controller's log.
#[derive(Clone, Debug, PartialEq)]
pub enum Notice {
    /// A sender has the lease now.
    Taken {
        /// Who.
        name: String,
        /// It goes on with what it began before.
        continues: bool,
    },
    /// A sender was turned away.
    Refused {
        /// Who.
        name: String,
        /// Why.
        why: Refusal,
    },
    /// A connection was given up.
    Closed {
        /// Which.
        connection: Connection,
        /// Why.
        why: LinkError,
    },
    /// The holder of the lease is silent or has gone: the machine was asked to stop on the path.
    Lost {
        /// Who.
        name: String,
    },
    /// It is done and the lease is free.
    Done {
        /// Who.
        name: String,
    },
    /// Somebody ended what lived in the machine.
    Ended {
        /// Who.
        name: String,
        /// Its number.
        mark: u32,
        /// The line that started it.
        line: String,
    },
}

impl std::fmt::Display for Notice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Notice::Taken { name, continues: false } => write!(f, "'{name}' drives the machine"),
            Notice::Taken { name, continues: true } => write!(f, "'{name}' is back"),
            Notice::Refused { name, why } => write!(f, "'{name}' was refused: {why}"),
            Notice::Closed { connection, why } => write!(f, "connection {connection} was closed: {why}"),
            Notice::Lost { name } => write!(f, "'{name}' is silent: controlled stop"),
            Notice::Done { name } => write!(f, "'{name}' is done"),
            Notice::Ended { name, mark, line } => write!(f, "'{name}' ended synchronized action {mark}: {line}"),
        }
    }
}

/// What was counted since the controller started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReceiverCounts {
    /// Blocks taken.
    pub blocks: u64,
    /// Frames that came twice and were passed over.
    pub duplicates: u64,
    /// Connections given up because of what came on them.
    pub broken: u64,
    /// Times the link was lost.
    pub losses: u64,
}

/// Who may write.
#[derive(Clone, Debug)]
struct Lease {
    name: Name,
    plan: PlanId,
    session: u32,
    connection: Option<Connection>,
    heard: Tick,
    lost: bool,
}

#[derive(Clone, Debug)]
struct Side {
    wired: Wired,
    out: Vec<u8>,
    greeted: bool,
    /// It asks, and does not drive.
    asked: bool,
    closing: bool,
}

/// The controller's side of the link.
#[derive(Clone, Debug)]
pub struct LinkReceiver {
    card: MachineCard,
    sides: BTreeMap<Connection, Side>,
    lease: Option<Lease>,
    sessions: u32,
    orders: VecDeque<Order>,
    urgent: VecDeque<UrgentOrder>,
    /// What comes next: epoch, entry, time stamp.
    epoch: u32,
    wanted: u64,
    cycle: u64,
    reports: VecDeque<Report>,
    /// Number of the oldest kept report, and of the next to be sent.
    first_report: u64,
    next_report: u64,
    lost_reports: u64,
    firings: VecDeque<Firing>,
    /// Number of the oldest kept firing, and of the next to be sent.
    first_firing: u64,
    next_firing: u64,
    lost_firings: u64,
    status: Status,
    state: State,
    standing: bool,
    notices: VecDeque<Notice>,
    counts: ReceiverCounts,
    register: Register,
}

impl LinkReceiver {
    /// A controller that nobody has connected to.
    pub fn new(card: MachineCard) -> Self {
        LinkReceiver {
            card,
            sides: BTreeMap::new(),
            lease: None,
            sessions: 0,
            orders: VecDeque::new(),
            urgent: VecDeque::new(),
            epoch: 0,
            wanted: 0,
            cycle: 0,
            reports: VecDeque::new(),
            first_report: 0,
            next_report: 0,
            lost_reports: 0,
            firings: VecDeque::new(),
            first_firing: 0,
            next_firing: 0,
            lost_firings: 0,
            status: Status {
                needs_resume: true,
                ..Status::default()
            },
            state: State::Off,
            standing: true,
            notices: VecDeque::new(),
            counts: ReceiverCounts::default(),
            register: Register::default(),
        }
    }

    /// Somebody connected.
    pub fn connected(&mut self, connection: Connection, now: Tick) {
        let side = Side {
            wired: Wired::new(now),
            out: Vec::new(),
            greeted: false,
            asked: false,
            closing: false,
        };
        self.sides.insert(connection, side);
    }

    /// Bytes came. What is wrong with them closes the connection ([`LinkReceiver::output`] says so) and is a [`Notice`].
    pub fn receive(&mut self, connection: Connection, now: Tick, bytes: &[u8]) {
        let Some(mut side) = self.sides.remove(&connection) else {
            return;
        };
        let mut bytes = bytes;
        while !side.closing {
            let came = match side.wired.next(now, &mut bytes) {
                Ok(None) => break,
                Ok(Some(came)) => self.frame(connection, now, &mut side, &came),
                Err(error) => Err(error),
            };
            if let Err(why) = came {
                self.counts.broken += 1;
                side.closing = true;
                self.notices.push_back(Notice::Closed { connection, why });
            }
        }
        self.sides.insert(connection, side);
    }

    /// The connection is gone.
    pub fn disconnected(&mut self, connection: Connection, _now: Tick) {
        if let Some(side) = self.sides.remove(&connection) {
            self.counts.duplicates += side.wired.duplicates;
        }
        if let Some(lease) = self.lease.as_mut().filter(|l| l.connection == Some(connection)) {
            lease.connection = None;
        }
    }

    /// True while bytes of this connection are taken; false: leave them in the socket, the realtime thread has enough.
    pub fn reads(&self, connection: Connection) -> bool {
        self.orders.len() + self.urgent.len() < WAITING_ORDERS && self.sides.get(&connection).is_some_and(|s| !s.closing)
    }

    /// Lets time pass: a silent holder of the lease is a lost link.
    pub fn pass(&mut self, now: Tick) {
        let Some(lease) = &mut self.lease else { return };
        if let Some(side) = lease.connection.and_then(|c| self.sides.get(&c)) {
            lease.heard = side.wired.heard;
        }
        if !lease.lost && now.0.saturating_sub(lease.heard.0) > SILENCE {
            lease.lost = true;
            self.counts.losses += 1;
            self.urgent.push_back(UrgentOrder::LinkLost);
            self.notices.push_back(Notice::Lost {
                name: lease.name.text().to_owned(),
            });
            if let Some(connection) = lease.connection.take()
                && let Some(side) = self.sides.get_mut(&connection)
            {
                side.closing = true;
                self.notices.push_back(Notice::Closed {
                    connection,
                    why: LinkError::Silent,
                });
            }
        }
    }

    /// Appends what is to be written to this connection. False: write it and close.
    pub fn output(&mut self, connection: Connection, now: Tick, out: &mut Vec<u8>) -> bool {
        let Some(mut side) = self.sides.remove(&connection) else {
            return false;
        };
        out.append(&mut side.out);
        let leads = self.lease.as_ref().is_some_and(|l| l.connection == Some(connection));
        if leads && !side.closing {
            self.tell_reports(now, &mut side, out);
            if now.0.saturating_sub(side.wired.spoke.0) >= HEARTBEAT {
                let status = self.told_status();
                side.wired.send(now, Kind::Heartbeat, out, |to| status.write(to));
            }
        }
        let open = !side.closing;
        self.sides.insert(connection, side);
        open
    }

    /// The next order for the realtime thread.
    pub fn order(&mut self) -> Option<Order> {
        self.orders.pop_front()
    }

    /// An order found no place: it is the next again.
    pub fn give_back(&mut self, order: Order) {
        self.orders.push_front(order);
    }

    /// The next order that does not wait behind others.
    pub fn urgent(&mut self) -> Option<UrgentOrder> {
        self.urgent.pop_front()
    }

    /// A condition has fired; called before the report of its cycle.
    pub fn fired(&mut self, firing: Firing) {
        if self.firings.len() == KEPT_FIRINGS {
            self.lost_firings += 1;
            return;
        }
        self.firings.push_back(firing);
    }

    /// The realtime thread has made a cycle: its report, translated, and the follower's account.
    pub fn reported(&mut self, report: Report, status: Status) {
        self.state = report.state;
        self.standing = report.idle || report.state.needs_a_person();
        self.status = status;
        self.register.now = report.sample.tick;
        if self.lease.as_ref().is_none_or(|l| l.session != status.session) {
            // It is of nobody's run, or of the one before: nobody's record has a gap.
            self.first_report += self.reports.len() as u64 + 1;
            self.reports.clear();
            self.forget_firings(u64::MAX);
            self.next_report = self.first_report;
            return;
        }
        self.reports.push_back(report);
        if self.reports.len() > KEPT_REPORTS {
            self.reports.pop_front();
            self.first_report += 1;
            self.lost_reports += 1;
            self.next_report = self.next_report.max(self.first_report);
        }
    }

    /// Reports that the realtime thread could not hand over: a gap in the record.
    pub fn reports_lost(&mut self, count: u64) {
        self.lost_reports += count;
    }

    /// The next thing for the log.
    pub fn notice(&mut self) -> Option<Notice> {
        self.notices.pop_front()
    }

    /// What was counted.
    pub fn counts(&self) -> ReceiverCounts {
        let open: u64 = self.sides.values().map(|s| s.wired.duplicates).sum();
        ReceiverCounts {
            duplicates: self.counts.duplicates + open,
            ..self.counts
        }
    }

    /// Who drives the machine.
    pub fn holder(&self) -> Option<&str> {
        self.lease.as_ref().map(|l| l.name.text())
    }
}
