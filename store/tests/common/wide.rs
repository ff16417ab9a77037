//! Sixty-four channels of a machine at 1 kHz, as DESIGN asks for them: positions at encoder resolution, loads and currents with at least
//! four quanta rms of noise.

use store::segment::{Column, Reading};
use units::{StepId, Tick, ToolNumber, WorkingstepId};

/// Channels.
pub const CHANNELS: usize = 64;
/// A row.
pub type Row = Reading<CHANNELS>;

const AXES: [&str; 8] = ["X", "Y", "Z", "A", "C", "U", "V", "W"];

/// Eight axes with six readings each, two spindles with four, four forces, four temperatures.
pub fn columns() -> Vec<Column> {
    let mut columns = Vec::new();
    for axis in AXES {
        for (what, unit, scale) in [
            ("POSITION.COMMANDED", "MILLIMETER", 1e-4),
            ("POSITION.ACTUAL", "MILLIMETER", 1e-3),
            ("AXIS_FEEDRATE.ACTUAL", "MILLIMETER/SECOND", 1e-1),
            ("FOLLOWING_ERROR", "MILLIMETER", 1e-3),
            ("LOAD", "PERCENT", 1e-1),
            ("AMPERAGE", "AMPERE", 1e-2),
        ] {
            columns.push(Column::reading(&format!("{axis}.{what}"), unit, scale, 0.0));
        }
    }
    for spindle in ["S1", "S2"] {
        for (what, unit, scale) in [
            ("ROTARY_VELOCITY.ACTUAL", "REVOLUTION/MINUTE", 1e-1),
            ("LOAD", "PERCENT", 1e-1),
            ("AMPERAGE", "AMPERE", 1e-2),
            ("TEMPERATURE", "CELSIUS", 1e-1),
        ] {
            columns.push(Column::reading(&format!("{spindle}.{what}"), unit, scale, 0.0));
        }
    }
    for force in ["FX", "FY", "FZ", "MZ"] {
        columns.push(Column::reading(&format!("DYNAMOMETER.{force}"), "NEWTON", 1.0, 0.0));
    }
    for place in ["COOLANT", "BED", "CABINET", "HEAD"] {
        columns.push(Column::reading(&format!("{place}.TEMPERATURE"), "CELSIUS", 1e-1, -20.0));
    }
    assert_eq!(columns.len(), CHANNELS);
    columns
}

/// The rows of a machine that mills: the same ones every time.
pub struct Machine {
    tick: u64,
    random: u64,
}

impl Machine {
    /// At its first row.
    pub fn new() -> Machine {
        Machine {
            tick: 0,
            random: 0x9e37_79b9_7f4a_7c15,
        }
    }

    /// About normal with the given rms: four 16-bit uniforms of one xorshift word.
    fn noise(&mut self, rms: f64) -> f64 {
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        let word = self.random;
        let sum: u32 = (0..4).map(|k| (word >> (16 * k)) as u16 as u32).sum();
        // Four uniforms of 0 to 65535: mean 131070, variance 4 * 65536^2 / 12.
        (f64::from(sum) - 131_070.0) / 37_837.2 * rms
    }

    /// The next row.
    pub fn row(&mut self) -> Row {
        let tick = self.tick;
        self.tick += 1;
        let t = tick as f64 * 0.001;
        let mut values = [0.0; CHANNELS];
        // X, Y, Z and C move on a path; A steps now and then; U, V, W stand still under current.
        let place = |axis: usize, t: f64| match axis {
            0 => 40.0 * (0.5 * t).sin() - 300.0,
            1 => 40.0 * (0.5 * t).cos() - 200.0,
            2 => -5.0 - (t / 30.0).floor() * 0.5,
            3 => (t / 60.0).floor() % 360.0,
            4 => (3.0 * t) % 360.0,
            _ => 12.5,
        };
        for axis in 0..AXES.len() {
            let (commanded, before) = (place(axis, t), place(axis, t - 0.004));
            let speed = (place(axis, t) - place(axis, t - 0.001)) / 0.001;
            let actual = before + self.noise(0.0005);
            let reading = [
                commanded,
                actual,
                speed + self.noise(0.1),
                commanded - actual,
                20.0 + 0.5 * speed.clamp(-50.0, 50.0) + self.noise(0.4),
                2.0 + 0.05 * speed.clamp(-50.0, 50.0) + self.noise(0.04),
            ];
            values[axis * 6..axis * 6 + 6].copy_from_slice(&reading);
        }
        for spindle in 0..2 {
            let reading = [
                8000.0 + self.noise(0.4),
                35.0 + self.noise(0.4),
                9.0 + self.noise(0.04),
                35.0 + 5.0 * (t / 900.0).sin() + self.noise(0.05),
            ];
            values[48 + spindle * 4..52 + spindle * 4].copy_from_slice(&reading);
        }
        for force in 0..4 {
            // Four teeth at 8000 rev/min, and noise of five quanta.
            values[56 + force] = 120.0 * (t * 533.3 * std::f64::consts::TAU + force as f64).sin() + self.noise(5.0);
        }
        for sensor in 0..4 {
            values[60 + sensor] = 24.0 + 3.0 * (t / 1800.0 + sensor as f64).sin() + self.noise(0.05);
        }
        Row {
            tick: Tick(tick),
            step: StepId((t / 0.5) as u32 + 1),
            workingstep: WorkingstepId((t / 30.0) as u32 + 1),
            tool: ToolNumber(4),
            phase: machine::Phase::Running,
            quality: machine::Quality::Simulated,
            values,
        }
    }
}
