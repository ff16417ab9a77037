//! What frames carry.

use super::frame::{FRAME, Header, Kind, write_frame};
use super::loading::Loads;
use super::wire::{Reader, Wire, WireError, Writer, wire_enum, wire_struct};
use crate::controller::Request;
use crate::sample::Quality;
use crate::watch::Frequency;
use crate::{Command, MachineParameters};
use units::{Millimetres, ToolNumber};

/// The unit word of the hello: mm, mm/s, mm/s^2, rev/min, cycles of 1 ms. There is no other.
pub const UNITS: [u8; 4] = *b"mmms";
/// Axes of the link: X, Y, Z.
pub const AXES: u8 = 3;

/// Cycles of set-points that may be under way to the machine and in its queue, beside the stop tail.
pub const LOOK_AHEAD: u64 = 250;
/// Set-points of a stop tail at most. What does not stop within them is slowed down by the controller itself, on the path.
pub const TAIL: usize = 250;
/// Commands of a block at most, without its tail.
pub const BLOCK: usize = 64;
/// After this many cycles without a word each side says that it is there.
pub const HEARTBEAT: u64 = 50;
/// After this many cycles without a word the other side is gone, and the machine makes a controlled stop.
pub const SILENCE: u64 = 300;

/// A name, at most 47 bytes of UTF-8; what is longer is cut.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Name([u8; 48]);

impl Name {
    /// A name from a text.
    pub fn new(text: &str) -> Self {
        let mut end = text.len().min(47);
        while !text.is_char_boundary(end) {
            end -= 1;
        }
        let mut name = [0; 48];
        name[0] = end as u8;
        name[1..=end].copy_from_slice(&text.as_bytes()[..end]);
        Name(name)
    }

    /// The text.
    pub fn text(&self) -> &str {
        let end = usize::from(self.0[0]).min(47);
        core::str::from_utf8(&self.0[1..=end]).unwrap_or("?")
    }
}

impl core::fmt::Debug for Name {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{:?}", self.text())
    }
}

impl Wire for Name {
    fn write(&self, to: &mut Writer<'_>) {
        let end = usize::from(self.0[0]).min(47);
        to.put(&self.0[..=end]);
    }
    fn read(from: &mut Reader<'_>) -> Result<Self, WireError> {
        let length = u8::read(from)?;
        if length > 47 {
            return Err(from.unknown("a name of at most 47 bytes"));
        }
        let mut name = [0; 48];
        name[0] = length;
        for byte in &mut name[1..=usize::from(length)] {
            *byte = u8::read(from)?;
        }
        match core::str::from_utf8(&name[1..=usize::from(length)]) {
            Ok(_) => Ok(Name(name)),
            Err(_) => Err(from.unknown("a name in UTF-8")),
        }
    }
}

/// Which plan: a hash over the program, the machine's limits and all that the set-points depend on. Two senders with the same plan id
/// send the same set-points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PlanId(pub [u8; 32]);

impl Wire for PlanId {
    fn write(&self, to: &mut Writer<'_>) {
        self.0.write(to);
    }
    fn read(from: &mut Reader<'_>) -> Result<Self, WireError> {
        Wire::read(from).map(PlanId)
    }
}

/// The limits of a machine that a plan was made for, as one number (FNV-1a over their bits): both sides must mean the same machine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LimitsHash(pub u64);

impl LimitsHash {
    /// Travels, speeds, accelerations, jerks and pulses of the axes, and the spindle's highest speed.
    pub fn of(machine: &MachineParameters) -> Self {
        let axes = machine
            .axes
            .iter()
            .flat_map(|a| [a.lowest.0, a.highest.0, a.v_max.0, a.a_max.0, a.j_max.0, a.pulses_per_mm]);
        let hash = axes
            .chain([machine.spindle.highest.0])
            .flat_map(|n| n.to_bits().to_le_bytes());
        LimitsHash(hash.fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
        }))
    }
}

impl Wire for LimitsHash {
    fn write(&self, to: &mut Writer<'_>) {
        self.0.write(to);
    }
    fn read(from: &mut Reader<'_>) -> Result<Self, WireError> {
        Wire::read(from).map(LimitsHash)
    }
}

/// The sender introduces itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hello {
    /// [`UNITS`].
    pub units: [u8; 4],
    /// [`AXES`].
    pub axes: u8,
    /// Who it is: the holder of the lease, in the words that another writer will read.
    pub name: Name,
    /// The plan it sends.
    pub plan: PlanId,
    /// The limits it was planned for.
    pub limits: LimitsHash,
    /// The session that it wants to go on with; 0: a new one.
    pub session: u32,
    /// Reports that it has, by their number.
    pub reports: u64,
    /// Firings that it has, by their number.
    pub firings: u64,
}
wire_struct!(Hello {
    units,
    axes,
    name,
    plan,
    limits,
    session,
    reports,
    firings,
});

/// The machine takes the sender.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Welcome {
    /// The machine's name.
    pub machine: Name,
    /// What its measurements are worth: [`Quality::Simulated`] behind a simulated plant.
    pub quality: Quality,
    /// Its limits.
    pub limits: LimitsHash,
    /// The session; the sender's own when it goes on with it.
    pub session: u32,
    /// The plan that was being executed; the sender's own, or it cannot go on with it.
    pub plan: PlanId,
    /// True when the machine keeps what the sender sent in this session before.
    pub continues: bool,
    /// The epoch that is being received, when it continues.
    pub epoch: u32,
    /// The entry of it that is wanted next.
    pub wanted: u64,
    /// How far everything is.
    pub status: Status,
}
wire_struct!(Welcome {
    machine,
    quality,
    limits,
    session,
    plan,
    continues,
    epoch,
    wanted,
    status,
});

/// Why a sender is not taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Refusal {
    /// Another one has the lease.
    Busy {
        /// Who.
        holder: Name,
    },
    /// Another one has it still and is gone, silent or dead: it is free in some seconds, when the machine stands.
    Left {
        /// Who.
        holder: Name,
    },
    /// It planned for another machine.
    Limits {
        /// The machine's name.
        machine: Name,
        /// Its limits.
        limits: LimitsHash,
    },
    /// It speaks in other units, or of another number of axes.
    Units,
}
wire_enum!(Refusal {
    1 = Busy { holder },
    2 = Limits { machine, limits },
    3 = Units,
    4 = Left { holder },
});

impl core::fmt::Display for Refusal {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Refusal::Busy { holder } => write!(f, "the machine is driven by '{}': wait until it is done", holder.text()),
            Refusal::Left { holder } => write!(
                f,
                "the machine is kept for '{}', which is gone: it is free in some seconds, when it stands",
                holder.text()
            ),
            Refusal::Limits { machine, .. } => write!(
                f,
                "'{}' has other limits than the plan was made for: use its machine file on both sides",
                machine.text()
            ),
            Refusal::Units => write!(f, "the other side means other units or axes: use the same release on both"),
        }
    }
}

/// A command and how far the plan is when it is done.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Entry {
    /// What the machine is to do.
    pub command: Command,
    /// Commands of the plan that are done with it: itself for one of the plan, fewer for one on the way back to it.
    pub done: u64,
}
wire_struct!(Entry { command, done });

/// The beginning of a block; behind it stand `body` entries and then `tail` more.
///
/// The tail goes on from the last entry of the body, on the path, and comes to rest. It is used when the next block does not come, and
/// superseded by it when it does. Its first entry is the first of the next block. It is empty where the body ends at rest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlockHead {
    /// Which stretch: it grows by one each time the sender begins anew at a place where the machine stands.
    pub epoch: u32,
    /// Number of the first entry in its epoch.
    pub first: u64,
    /// Time stamp of the first entry: cycles of set-points before it in its epoch.
    pub cycle: u64,
    /// Entries to be executed.
    pub body: u16,
    /// Entries of the stop tail.
    pub tail: u16,
}
wire_struct!(BlockHead {
    epoch,
    first,
    cycle,
    body,
    tail,
});

/// What does not wait behind blocks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Urgent {
    /// A person's request.
    Request(Request),
    /// What was queued is to be forgotten; what follows begins where the machine stands. Only at rest.
    Resume {
        /// The epoch that begins.
        epoch: u32,
        /// Commands of the plan that are done.
        done: u64,
    },
}
wire_enum!(Urgent {
    1 = Request(request),
    2 = Resume { epoch, done },
});

/// How far everything is, in every reports and heartbeat frame from the controller.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Status {
    /// The session that the realtime thread knows of.
    pub session: u32,
    /// The epoch that is being executed.
    pub epoch: u32,
    /// Entries of it that the machine has in its queue or has done.
    pub taken: u64,
    /// Entries of it that are done.
    pub executed: u64,
    /// Commands of the plan that are done; `None` when the controller does not know, because it was started anew.
    pub done: Option<u64>,
    /// Path length at the last set-point that is done, mm.
    pub path_length: f64,
    /// The queue does not lead on: the stop tail was used, the queue was emptied, or the session is a new one. The sender has to say where
    /// it goes on.
    pub needs_resume: bool,
    /// Reports of which the sender has heard so far are numbered below this.
    pub reports: u64,
    /// Reports that were lost because nobody took them.
    pub lost_reports: u64,
    /// What became of what the sender gave to be loaded.
    pub loads: Loads,
    /// Firings of which the sender has heard so far are numbered below this.
    pub firings: u64,
    /// Firings that were lost, in all.
    pub lost_firings: u64,
}
wire_struct!(Status {
    session,
    epoch,
    taken,
    executed,
    done,
    path_length,
    needs_resume,
    reports,
    lost_reports,
    loads,
    firings,
    lost_firings,
});

/// The beginning of a reports frame; behind it stand `count` reports, and then `firings` of [`crate::watch::Firing`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReportsHead {
    /// How far everything is.
    pub status: Status,
    /// Number of the first report.
    pub first: u64,
    /// How many follow.
    pub count: u16,
    /// Number of the first firing.
    pub first_firing: u64,
    /// Firings of their cycles, in order.
    pub firings: u16,
}
wire_struct!(ReportsHead {
    status,
    first,
    count,
    first_firing,
    firings,
});

/// What a load frame carries: its number in the plan, from 0, and what is loaded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoadHead {
    /// Which.
    pub number: u32,
    /// What.
    pub what: LoadWhat,
}
wire_struct!(LoadHead { number, what });

/// What is loaded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LoadWhat {
    /// A condition; behind it stand its operations, its orders for alarms, and the line that starts it with its length in two bytes.
    Watch {
        /// When it fires.
        frequency: Frequency,
        /// It goes on in every mode.
        all_modes: bool,
        /// How many operations.
        operations: u8,
        /// How many orders for alarms.
        alarms: u8,
    },
    /// The diameter of a tool, for cutting speeds.
    Tool {
        /// Which tool.
        tool: ToolNumber,
        /// Its diameter.
        diameter: Millimetres,
    },
}
wire_enum!(LoadWhat {
    1 = Watch { frequency, all_modes, operations, alarms },
    2 = Tool { tool, diameter },
});

/// A heartbeat of the sender: reports and firings that it has, by their number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SenderHeartbeat {
    /// Reports below this number have come.
    pub reports: u64,
    /// Firings below this number have come.
    pub firings: u64,
}
wire_struct!(SenderHeartbeat { reports, firings });

/// Writes a whole frame around one message.
///
/// # Panics
/// Never for the messages of this file, which are far smaller than a frame: what can be longer is written with [`write_frame`].
pub fn small_frame(kind: Kind, session: u32, sequence: u32, acknowledged: u32, message: &impl Wire) -> ([u8; 512], usize) {
    let mut bytes = [0; 512];
    let header = Header {
        kind,
        session,
        sequence,
        acknowledged,
    };
    let length = write_frame(&mut bytes, &header, |to| message.write(to)).expect("a small message");
    (bytes, length)
}

const _: () = assert!(
    (BLOCK + TAIL) * 128 < FRAME,
    "a block of the longest entries fits into a frame"
);
const _: () = assert!(
    LOOK_AHEAD as usize + TAIL < crate::QUEUE,
    "what may be under way fits into the machine's queue"
);
