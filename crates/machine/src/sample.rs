//! What the machine reports, every servo cycle, and the table of channels that a record is made of.

use crate::overrides::Overrides;
use units::{StepId, Tick, ToolNumber, WorkingstepId};

/// What the machine was doing in a cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum Phase {
    /// Nothing to do.
    #[default]
    Ready = 0,
    /// Axes follow set-points.
    Running = 1,
    /// Waiting inside a program: axes getting into position, dwell, spindle getting to speed, tool change.
    Waiting = 2,
    /// A program stop: waits for cycle start.
    Paused = 3,
    /// A controlled stop is under way or done.
    Stopped = 4,
    /// Emergency stop.
    EmergencyStop = 5,
    /// A fault: following error, limit.
    Fault = 6,
    /// An axis is moved by hand.
    Jogging = 7,
    /// Looking for the references, or on the way home.
    Homing = 8,
}

/// How far a row can be trusted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum Quality {
    /// Measured.
    #[default]
    Good = 0,
    /// Made by a simulator.
    Simulated = 1,
    /// Older than the cycle it stands in.
    Stale = 2,
    /// Not measured.
    Unavailable = 3,
}

/// One servo cycle of the machine.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sample {
    /// Which cycle.
    pub tick: Tick,
    /// The step in execution; 0 is none.
    pub step: StepId,
    /// The workingstep in execution; 0 is none.
    pub workingstep: WorkingstepId,
    /// The tool in the spindle; 0 is none.
    pub tool: ToolNumber,
    /// What the machine was doing.
    pub phase: Phase,
    /// How far the row can be trusted.
    pub quality: Quality,
    /// Commanded gauge-point position of each axis, machine frame, mm.
    pub commanded: [f64; 3],
    /// Position of each axis by its encoder, machine frame, mm.
    pub actual: [f64; 3],
    /// Speed of each axis by its encoder, mm/s.
    pub velocity: [f64; 3],
    /// Motor torque of each axis, percent of rated.
    pub load: [f64; 3],
    /// Motor current of each axis, A.
    pub current: [f64; 3],
    /// Commanded speed along the path, mm/s.
    pub path_speed: f64,
    /// Spindle speed, rev/min, positive clockwise.
    pub spindle_speed: f64,
    /// Spindle torque, percent of rated.
    pub spindle_load: f64,
    /// The overrides in force.
    pub overrides: Overrides,
    /// Angle of the spindle from its index mark, degrees, 0 to below 360 clockwise; not a number while it is not known.
    pub spindle_angle: f64,
    /// How far the commanded path is ahead of the spindle's angle on a thread, mm; not a number where nothing is tied to it.
    pub thread_error: f64,
}

/// One measured column of a record: name, unit and scale are the same in program, log, agent and HMI.
#[derive(Clone, Copy)]
pub struct Channel {
    /// `component.TYPE.SUBTYPE` with MTConnect's type names.
    pub name: &'static str,
    /// Unit of the scaled value, in MTConnect's words.
    pub unit: &'static str,
    /// Value of one quantum: value = raw * scale, raw a 32-bit integer.
    pub scale: f64,
    /// Where the value stands in a sample.
    pub read: fn(&Sample) -> f64,
}

impl Channel {
    /// The integer that the record keeps; beyond the 32-bit range it is clipped to the nearest end.
    pub fn quantise(&self, sample: &Sample) -> i32 {
        let quanta = libm::round((self.read)(sample) / self.scale);
        // A cast of a float saturates, and not-a-number becomes 0.
        quanta as i32
    }
}

/// The channels of a record, in column order. A new one is one line here.
pub const CHANNELS: &[Channel] = &[
    Channel {
        name: "X.POSITION.COMMANDED",
        unit: "MILLIMETER",
        scale: 1e-4,
        read: |s| s.commanded[0],
    },
    Channel {
        name: "Y.POSITION.COMMANDED",
        unit: "MILLIMETER",
        scale: 1e-4,
        read: |s| s.commanded[1],
    },
    Channel {
        name: "Z.POSITION.COMMANDED",
        unit: "MILLIMETER",
        scale: 1e-4,
        read: |s| s.commanded[2],
    },
    Channel {
        name: "X.POSITION.ACTUAL",
        unit: "MILLIMETER",
        scale: 1e-3,
        read: |s| s.actual[0],
    },
    Channel {
        name: "Y.POSITION.ACTUAL",
        unit: "MILLIMETER",
        scale: 1e-3,
        read: |s| s.actual[1],
    },
    Channel {
        name: "Z.POSITION.ACTUAL",
        unit: "MILLIMETER",
        scale: 1e-3,
        read: |s| s.actual[2],
    },
    Channel {
        name: "X.AXIS_FEEDRATE.ACTUAL",
        unit: "MILLIMETER/SECOND",
        scale: 1e-1,
        read: |s| s.velocity[0],
    },
    Channel {
        name: "Y.AXIS_FEEDRATE.ACTUAL",
        unit: "MILLIMETER/SECOND",
        scale: 1e-1,
        read: |s| s.velocity[1],
    },
    Channel {
        name: "Z.AXIS_FEEDRATE.ACTUAL",
        unit: "MILLIMETER/SECOND",
        scale: 1e-1,
        read: |s| s.velocity[2],
    },
    Channel {
        name: "X.LOAD",
        unit: "PERCENT",
        scale: 1e-1,
        read: |s| s.load[0],
    },
    Channel {
        name: "Y.LOAD",
        unit: "PERCENT",
        scale: 1e-1,
        read: |s| s.load[1],
    },
    Channel {
        name: "Z.LOAD",
        unit: "PERCENT",
        scale: 1e-1,
        read: |s| s.load[2],
    },
    Channel {
        name: "X.AMPERAGE",
        unit: "AMPERE",
        scale: 1e-2,
        read: |s| s.current[0],
    },
    Channel {
        name: "Y.AMPERAGE",
        unit: "AMPERE",
        scale: 1e-2,
        read: |s| s.current[1],
    },
    Channel {
        name: "Z.AMPERAGE",
        unit: "AMPERE",
        scale: 1e-2,
        read: |s| s.current[2],
    },
    Channel {
        name: "PATH.PATH_FEEDRATE.COMMANDED",
        unit: "MILLIMETER/SECOND",
        scale: 1e-2,
        read: |s| s.path_speed,
    },
    Channel {
        name: "S1.ROTARY_VELOCITY.ACTUAL",
        unit: "REVOLUTION/MINUTE",
        scale: 1e-1,
        read: |s| s.spindle_speed,
    },
    Channel {
        name: "S1.LOAD",
        unit: "PERCENT",
        scale: 1e-1,
        read: |s| s.spindle_load,
    },
    Channel {
        name: "PATH.PATH_FEEDRATE_OVERRIDE.PROGRAMMED",
        unit: "PERCENT",
        scale: 1.0,
        read: |s| f64::from(s.overrides.feed),
    },
    Channel {
        name: "PATH.PATH_FEEDRATE_OVERRIDE.RAPID",
        unit: "PERCENT",
        scale: 1.0,
        read: |s| f64::from(s.overrides.rapid),
    },
    Channel {
        name: "S1.ROTARY_VELOCITY_OVERRIDE",
        unit: "PERCENT",
        scale: 1.0,
        read: |s| f64::from(s.overrides.spindle),
    },
    Channel {
        name: "PATH.FOLLOWING_ERROR_LINEAR",
        unit: "MILLIMETER",
        scale: 1e-4,
        read: |s| s.thread_error,
    },
];

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;

    #[test]
    fn a_position_at_encoder_resolution_comes_back_bit_equal() {
        let x = &CHANNELS[3];
        let sample = Sample {
            actual: [123.457, 0.0, 0.0],
            ..Sample::default()
        };
        assert_eq!(x.quantise(&sample), 123_457);
    }

    #[test]
    fn channel_names_are_unique() {
        for (i, a) in CHANNELS.iter().enumerate() {
            assert!(CHANNELS[..i].iter().all(|b| b.name != a.name), "{}", a.name);
        }
    }
}
