//! The realtime half: controller and drives in one cycle, with a bounded queue of reports towards the office half.

use crate::controller::{Controller, Counters, Request};
use crate::drive::CyclicDrive;
use crate::overrides::Overrides;
use crate::pad::{ControlPad, NoPad, Notices};
use crate::parameters::MachineParameters;
use crate::ring::Ring;
use crate::sample::{Quality, Sample};
use crate::state::State;
use crate::{Command, DriveOrders};
use units::Tick;

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
        }
    }

    /// One servo cycle: read, control, order, report.
    pub fn tick(&mut self, now: Tick) {
        let feedback = self.drive.read(now);
        self.controller.look_at_pad(self.pad.read(now));
        let orders = self.controller.tick(now, &feedback);
        self.drive.order(now, &orders);
        let report = Report {
            sample: self.controller.sample(now, &feedback, self.quality),
            state: self.controller.state(),
            counters: self.controller.counters(),
            idle: self.controller.is_idle(),
            orders,
            overrides: self.controller.overrides(),
            notices: self.controller.take_notices(),
        };
        if self.reports.push(report).is_err() {
            self.lost_reports += 1;
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
        self.controller.request(request);
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
