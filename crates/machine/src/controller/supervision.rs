//! What is looked at every cycle, what the drives are ordered, and what a change of state means.

use super::*;

/// Supervision and states.
impl Controller {
    /// Changes the state by the table, and does what entering the new one means.
    pub(super) fn happen(&mut self, event: Event) {
        let before = self.state;
        self.state = next_state(before, event);
        if self.state == before {
            return;
        }
        match (self.state, event) {
            (State::NotHomed, Event::PowerOn | Event::Reset) => {
                self.spindle = SpindleCommand::Stop;
                self.coolant = CoolantOutlets::default();
                (self.spindle_rests, self.powerless) = (false, false);
                self.hand.was_in_the_middle = false;
                self.forget_program();
                self.end_machining();
            }
            (State::Ready, Event::ProgramEnd) => {
                self.spindle = SpindleCommand::Stop;
                self.coolant = CoolantOutlets::default();
                self.is_jerky = false;
                self.end_machining();
            }
            (State::Running, Event::Work) if before == State::Ready => (self.rate, self.rate_change) = (1.0, 0.0),
            (State::Resuming, _) => {
                self.spindle_rests = false;
                self.restoring = seconds_in_cycles(self.parameters.spindle.time_out.0);
            }
            (State::EmergencyStop, _) => {
                self.notices.emergency_stop = Some(true);
                self.powerless = false;
            }
            (State::EmergencyStopReleased, _) => self.notices.emergency_stop = Some(false),
            (State::Fault(FaultCause::Encoder { axis }), _) if !self.parameters.absolute_encoders => {
                // What counts from power-on has lost its count.
                self.is_known[usize::from(axis)] = false;
            }
            _ => {}
        }
        if self.state == State::NotHomed && self.is_homed() {
            self.state = next_state(self.state, Event::ReferencesKnown);
        }
    }

    /// Empties the queue and stands where the axes are commanded to be.
    pub(super) fn forget_program(&mut self) {
        self.counters.discarded += self.queue.clear() as u64 + u64::from(self.in_work.take().is_some());
        self.barrier = None;
        self.is_jerky = false;
        self.length.next = self.length.now;
        self.queued_length = self.length;
        self.stand_at(self.commanded);
        (self.step, self.workingstep) = (StepId::NONE, WorkingstepId(0));
    }

    /// Makes a place the commanded one, at rest.
    pub(super) fn stand_at(&mut self, position: [f64; 3]) {
        self.here = SetPoint {
            position,
            step: self.step,
            path_length: self.here.path_length,
            ..SetPoint::default()
        };
        if self.queue.is_empty() {
            self.tail = self.here;
        }
        self.commanded = position;
        self.commanded_velocity = [0.0; 3];
        self.path_speed = 0.0;
        self.fraction = 0.0;
        (self.rate, self.rate_change) = (1.0, 0.0);
        self.astray = false;
        self.thread = Thread::default();
        (self.hand.acceleration, self.hand.moving) = ([0.0; 3], false);
    }

    /// What the drives tell, with places in the machine frame.
    pub(super) fn in_machine_frame(&self, feedback: &Feedback) -> Feedback {
        Feedback {
            position: core::array::from_fn(|k| feedback.position[k] + self.zero[k]),
            ..*feedback
        }
    }

    /// Looks at what the drives tell, and gives the positions to go by: an impossible reading is bridged a few times.
    pub(super) fn supervise(&mut self, feedback: &Feedback, lost: u64) -> [f64; 3] {
        let is_pressed = feedback.emergency_stop || self.hand.pad.is_some_and(|pad| pad.emergency_stop);
        self.happen(if is_pressed {
            Event::EmergencyStop
        } else {
            Event::EmergencyStopReleased
        });
        let stands = feedback.velocity.iter().all(|v| v.abs() < STANDSTILL);
        self.powerless |= stands && matches!(self.state, State::EmergencyStop | State::EmergencyStopReleased);
        if feedback.drive_fault {
            self.happen(Event::Fault(self.why_drives_stopped(lost)));
        }
        let comparable = self.mode() == DriveMode::Follow && lost == 0 && !self.synchronise;
        let mut position = feedback.position;
        for (k, reading) in position.iter_mut().enumerate() {
            let expected = self.last_position[k] + self.last_velocity[k] * TICK.0;
            let possible = (*reading - expected).abs() <= IMPOSSIBLE;
            if comparable && !possible {
                self.counters.bridged_readings += 1;
                self.bridged_in_a_row[k] += 1;
                if self.bridged_in_a_row[k] > BRIDGED_READINGS {
                    self.happen(Event::Fault(FaultCause::Encoder { axis: k as u8 }));
                } else {
                    *reading = expected;
                }
            } else {
                self.bridged_in_a_row[k] = 0;
            }
        }
        self.last_position = position;
        self.last_velocity = feedback.velocity;
        position
    }

    /// Drives that get no orders stop by themselves and report it, in the cycle in which the controller is back or soon after: the reason is
    /// here and not there.
    fn why_drives_stopped(&self, lost: u64) -> FaultCause {
        match self.state {
            _ if lost > u64::from(self.parameters.late_ticks_allowed) => {
                let (cycles, tolerated) = self.away(lost);
                FaultCause::Away { cycles, tolerated }
            }
            State::Stopping(StopCause::Late { cycles, tolerated }) | State::Stopped(StopCause::Late { cycles, tolerated }) => {
                FaultCause::Away { cycles, tolerated }
            }
            _ => FaultCause::Drive,
        }
    }

    /// So many cycles in a row were lost, and how many would have been tolerated.
    pub(super) fn away(&self, lost: u64) -> (u32, u32) {
        (
            u32::try_from(lost).unwrap_or(u32::MAX),
            self.parameters.late_ticks_allowed.max(self.made_up),
        )
    }

    /// Two levels: the first is counted, the second is a fault.
    pub(super) fn check_following(&mut self, position: [f64; 3]) {
        let mut warn = false;
        for (k, actual) in position.iter().enumerate() {
            let error = (self.commanded[k] - actual).abs();
            warn |= error > self.parameters.following_warning.0;
            if error > self.parameters.following_fault.0 || error.is_nan() {
                self.happen(Event::Fault(FaultCause::FollowingError { axis: k as u8 }));
            }
        }
        self.counters.following_warnings += u64::from(warn && !self.warned);
        self.warned = warn;
    }

    /// What the drives shall do in the present state.
    pub(super) fn mode(&self) -> DriveMode {
        match self.state {
            State::Off => DriveMode::Off,
            // SS1 of IEC 61800-5-2: brake, then no power.
            State::EmergencyStop | State::EmergencyStopReleased if self.powerless => DriveMode::Off,
            State::EmergencyStop | State::EmergencyStopReleased | State::Fault(_) => DriveMode::QuickStop,
            _ => DriveMode::Follow,
        }
    }

    pub(super) fn orders(&mut self, acceleration: [f64; 3], position: [f64; 3]) -> DriveOrders {
        let mode = self.mode();
        let stopped = mode != DriveMode::Follow || matches!(self.state, State::Stopped(cause) if !cause.can_go_on());
        let changing_tool = self
            .in_work
            .is_some_and(|w| matches!(w.wait, Wait::ToolAway | Wait::Tool | Wait::ToolBack));
        let spindle_stands = stopped || self.spindle_rests || (changing_tool && self.parameters.tool_change_stops_spindle);
        DriveOrders {
            mode,
            axes: core::array::from_fn(|k| {
                let (p, v) = (self.commanded[k], self.commanded_velocity[k]);
                let order = self.loops[k].order(p, v, acceleration[k], position[k]);
                AxisOrder {
                    position: p - self.zero[k],
                    velocity: order.velocity,
                    planned: order.planned,
                    torque: order.torque,
                }
            }),
            spindle: if spindle_stands {
                SpindleCommand::Stop
            } else {
                self.turning_order().unwrap_or_else(|| self.spindle_order())
            },
            coolant: if stopped || self.spindle_rests {
                CoolantOutlets::default()
            } else {
                self.coolant
            },
            path_speed: self.path_speed,
        }
    }

    /// True when the axes are commanded to stand.
    pub(super) fn stands(&self) -> bool {
        self.commanded_velocity == [0.0; 3]
    }
}
