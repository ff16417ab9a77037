//! The realtime half: controller and drives in one cycle, with a bounded queue of reports towards the office half.

use crate::controller::{Controller, Counters, Request};
use crate::drive::CyclicDrive;
use crate::overrides::Overrides;
use crate::pad::{ControlPad, NoPad, Notices};
use crate::parameters::MachineParameters;
use crate::ring::Ring;
use crate::sample::{Quality, Sample};
use crate::state::State;
use crate::watch::{Firing, Mode, Ordered, Reaction, Readings, Situation, WatchCost, WatchOrder, Watches};
use crate::{Command, DriveOrders};
use units::{Millimetres, Tick, ToolNumber};

/// Reports that wait for the office half at most: a quarter of a second.
pub const REPORTS: usize = 256;

/// One cycle as the office half hears of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Report {
    /// The row of the record.
    pub sample: Sample,
    /// The controller's state after the cycle.
    pub state: State,
    /// What was counted up to and including the cycle.
    pub counters: Counters,
    /// True when nothing is queued or in work and the axes stand.
    pub idle: bool,
    /// What the drives were told.
    pub orders: DriveOrders,
    /// What the conditions of the cycle before cost.
    pub watches: WatchCost,
    /// The overrides in force.
    pub overrides: Overrides,
    /// Emergency stop, mode, joystick and home, once when it happens.
    pub notices: Notices,
}

/// Controller and drives of one machine.
#[derive(Clone, Debug)]
pub struct RealtimeHalf<D, P = NoPad> {
    controller: Controller,
    drive: D,
    pad: P,
    quality: Quality,
    reports: Ring<Report, REPORTS>,
    lost_reports: u64,
    parameters: MachineParameters,
    watches: Watches,
    readings: Readings,
    situation: Situation,
}

impl<D: CyclicDrive> RealtimeHalf<D> {
    /// A machine without power and without a pad. `quality` is what its measurements are worth: a simulated drive's are
    /// [`Quality::Simulated`].
    pub fn new(parameters: &MachineParameters, drive: D, quality: Quality) -> Self {
        RealtimeHalf::with_pad(parameters, drive, NoPad, quality)
    }
}

impl<D: CyclicDrive, P: ControlPad> RealtimeHalf<D, P> {
    /// The same with a control pad.
    pub fn with_pad(parameters: &MachineParameters, drive: D, pad: P, quality: Quality) -> Self {
        RealtimeHalf {
            controller: Controller::new(parameters),
            drive,
            pad,
            quality,
            reports: Ring::new(),
            lost_reports: 0,
            parameters: *parameters,
            watches: Watches::new(),
            readings: Readings::new(),
            situation: Situation::default(),
        }
    }

    /// Lost cycles in a row that are run after all, as [`Controller::made_up_for`].
    pub fn made_up_for(&mut self, cycles: u32) {
        self.controller.made_up_for(cycles);
    }

    /// Counts cycles that come too late on drives that have waited for them, as [`Controller::count_late`].
    pub fn count_late(&mut self, cycles: u64) {
        self.controller.count_late(cycles);
    }

    /// One servo cycle: read, control, order, report.
    pub fn tick(&mut self, now: Tick) {
        self.tick_by(now, &mut || 0);
    }

    /// The same with a clock, ns from anywhere, that tells how long the conditions take: a data item like any other
    /// (`CONTROLLER.WATCH_TIME`). Simulated time has none, and counts operations alone.
    pub fn tick_by(&mut self, now: Tick, clock: &mut dyn FnMut() -> u64) {
        let before = self.controller.state();
        let feedback = self.drive.read(now);
        self.controller.look_at_pad(self.pad.read(now));
        let orders = self.controller.tick(now, &feedback);
        self.drive.order(now, &orders);
        let sample = self.controller.sample(now, &feedback, self.quality);
        let watches = self.situation.cost;
        let began = clock();
        self.watch(before, &sample);
        let took = clock().saturating_sub(began);
        self.situation.cost.nanoseconds = u32::try_from(took).unwrap_or(u32::MAX);
        let report = Report {
            sample,
            state: self.controller.state(),
            counters: self.controller.counters(),
            idle: self.controller.is_idle(),
            orders,
            watches,
            overrides: self.controller.overrides(),
            notices: self.controller.take_notices(),
        };
        if self.reports.push(report).is_err() {
            self.lost_reports += 1;
        }
    }

    /// Evaluates the conditions of the program on the values of this cycle. What they do to the motion is in the next set-point.
    fn watch(&mut self, before: State, sample: &Sample) {
        let now = sample.tick;
        let mut reaction = Reaction::None;
        while let Some(Ordered { order, .. }) = self.controller.watch_order() {
            match order {
                WatchOrder::OperationBegins => self.readings.operation(now, true),
                WatchOrder::OperationEnds => self.readings.operation(now, false),
                WatchOrder::OperationUnderWay => self.readings.operation_under_way(now),
                _ => {}
            }
            reaction = reaction.max(self.watches.obey(order));
        }
        if self.readings.workingstep() != sample.workingstep {
            reaction = reaction.max(self.watches.operation_ends());
        }
        self.situation.mode = match self.controller.mode_in_force() {
            crate::pad::Mode::Auto => Mode::Automatic,
            crate::pad::Mode::Jog { .. } => Mode::Jog,
        };
        self.situation.feed_override = f64::from(self.controller.overrides().feed);
        self.readings.take(sample, &self.parameters, self.situation);
        let verdict = self.watches.cycle(now, &self.readings, self.situation.mode);
        self.situation.cost.operations = verdict.operations;
        match reaction.max(verdict.reaction) {
            Reaction::None | Reaction::StopAfterOperation => {}
            Reaction::FeedHold => self.controller.request(Request::Hold),
            Reaction::StopNow => self.controller.request(Request::Stop),
        }
        if self.controller.state() == State::Ready && !matches!(before, State::Ready | State::Off) {
            self.watches.program_ends();
        }
    }

    /// Takes a command into the queue.
    ///
    /// # Errors
    /// As [`Controller::push`].
    pub fn push(&mut self, command: Command) -> Result<(), Command> {
        self.controller.push(command)
    }

    /// Takes the last commands of the queue back, as [`Controller::withdraw`].
    pub fn withdraw(&mut self, count: usize) -> bool {
        self.controller.withdraw(count)
    }

    /// Empties the queue at rest, as [`Controller::forget_queue`].
    pub fn forget_queue(&mut self) -> bool {
        self.controller.forget_queue()
    }

    /// A request of a person.
    pub fn request(&mut self, request: Request) {
        let before = self.controller.state();
        self.controller.request(request);
        match request {
            Request::CycleStart => self.watches.acknowledge(),
            Request::Reset if before != self.controller.state() => self.watches.reset(),
            Request::PowerOff if before != self.controller.state() => self.watches.power_off(),
            _ => {}
        }
    }

    /// The conditions of the program: loaded before it starts, heard of while it runs.
    pub fn watches(&mut self) -> &mut Watches {
        &mut self.watches
    }

    /// Another program: conditions and tools of the one before are forgotten ([`Watches::new_program`]).
    pub fn new_program(&mut self) {
        self.watches.new_program();
        self.readings.new_program();
    }

    /// The oldest firing of a watch up to a cycle that was not taken yet: those of a cycle belong to its report.
    pub fn firing(&mut self, until: Tick) -> Option<Firing> {
        self.watches.next_firing().filter(|firing| firing.tick <= until)?;
        self.watches.firing()
    }

    /// Tells the diameter of a tool, for cutting speeds; false when there is no place for more.
    pub fn know_tool(&mut self, tool: ToolNumber, diameter: Millimetres) -> bool {
        self.readings.know_tool(tool.0, diameter.0)
    }

    /// The oldest report that was not taken yet, left in place.
    pub fn next_report(&self) -> Option<&Report> {
        self.reports.front()
    }

    /// The oldest report that was not taken yet.
    pub fn report(&mut self) -> Option<Report> {
        self.reports.pop()
    }

    /// Reports that found no place, because the office half was away: a gap in the record, counted.
    pub fn lost_reports(&self) -> u64 {
        self.lost_reports
    }

    /// The controller.
    pub fn controller(&self) -> &Controller {
        &self.controller
    }

    /// The drives.
    pub fn drive(&self) -> &D {
        &self.drive
    }

    /// The pad.
    pub fn pad_mut(&mut self) -> &mut P {
        &mut self.pad
    }

    /// The drives, to disturb simulated ones.
    pub fn drive_mut(&mut self) -> &mut D {
        &mut self.drive
    }
}
