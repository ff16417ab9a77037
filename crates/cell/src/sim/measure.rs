//! The simulated part on the gauge: sizes that the true tool tip left behind, with the repeatability of a gauge on top. All SIMULATED.
//!
//! The part is not modelled as a solid. A feature is where the operator would measure: a range along Z, and what is cut there. What counts
//! is the tip: its true place (behind play and warmth of the axes), with the true tool, which may differ from the tool table by a
//! [`Fault::ToolWear`]. Tool nose radius and deflection are left out.

use crate::events::{frame_of, tool_offset_of};
use crate::faults::Fault;
use crate::sink::RecordSink;
use ledger::Event;
use machine::{Phase, Sample};
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};
use std::collections::BTreeMap;
use units::{Machine, Millimetres, Point, Setup, ToolNumber, Transform, Vector};

/// A gauge: bell-shaped noise from a seed.
#[derive(Clone, Debug)]
pub struct Gauge {
    repeatability: Millimetres,
    dice: ChaCha8Rng,
}

impl Gauge {
    /// A gauge whose readings scatter by `repeatability` (rms).
    pub fn new(repeatability: Millimetres, seed: u64) -> Self {
        Gauge {
            repeatability,
            dice: ChaCha8Rng::seed_from_u64(seed),
        }
    }

    /// One reading of a true size, to a tenth of a micrometre.
    fn read(&mut self, size: f64) -> Millimetres {
        // Sum of twelve uniform numbers: mean 6, rms 1.
        let sum: f64 = (0..12)
            .map(|_| (self.dice.next_u64() >> 11) as f64 / (1u64 << 53) as f64)
            .sum();
        Millimetres(libm::round((size + self.repeatability.0 * (sum - 6.0)) * 1e4) / 1e4)
    }
}

/// A size read off a simulated part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measurement {
    /// What the gauge says. SIMULATED.
    pub value: Millimetres,
    /// The true size, which a person could not know; for tests and for saying how good the gauge was.
    pub true_value: Millimetres,
    /// Recorded tip positions behind it.
    pub samples: u64,
}

/// What is measured, in the set-up frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Feature {
    /// The diameter that a turning tool left between two places along Z.
    TurnedDiameter {
        /// From, lower end.
        z_from: Millimetres,
        /// To, upper end.
        z_to: Millimetres,
    },
    /// The width of what a milling cutter left at or below a height: of a pocket or bore (inside), or of a boss or plate (outside).
    MilledWidth {
        /// Along which axis, 0 is X, 1 is Y.
        axis: usize,
        /// The middle, along that axis.
        centre: Millimetres,
        /// Only where the other axis is between these: from.
        across_from: Millimetres,
        /// To.
        across_to: Millimetres,
        /// Only where the tip is at or below this height.
        z_below: Millimetres,
        /// True for a pocket: the cutter was within.
        inside: bool,
        /// Nominal cutter radius, unless the program tells the diameter of its tools.
        cutter_radius: Millimetres,
    },
}

/// A sink that watches one feature being made.
#[derive(Clone, Debug)]
pub struct Part {
    feature: Feature,
    wear: BTreeMap<ToolNumber, f64>,
    tool_radii: BTreeMap<u32, f64>,
    machine_from_setup: Transform<Machine, Setup>,
    setup_from_machine: Transform<Setup, Machine>,
    geometry: Vector<Machine>,
    /// Smallest radius for each tenth of a millimetre along Z.
    turned: BTreeMap<i64, f64>,
    /// What was cut furthest towards minus and plus.
    sides: [Option<f64>; 2],
    samples: u64,
}

impl Part {
    /// A blank on which `feature` will be made; the tools are as true as the faults leave them.
    pub fn new(feature: Feature, faults: &[Fault]) -> Self {
        let wear = faults.iter().filter_map(|fault| match fault {
            Fault::ToolWear { tool, radial } => Some((*tool, radial.0)),
            _ => None,
        });
        Part {
            feature,
            wear: wear.collect(),
            tool_radii: BTreeMap::new(),
            machine_from_setup: Transform::IDENTITY,
            setup_from_machine: Transform::IDENTITY,
            geometry: Vector::ZERO,
            turned: BTreeMap::new(),
            sides: [None; 2],
            samples: 0,
        }
    }

    /// Puts the part on a gauge; `None` when nothing was cut there.
    pub fn measure(&self, gauge: &mut Gauge) -> Option<Measurement> {
        let size = match self.feature {
            Feature::TurnedDiameter { .. } => {
                // The middle one of all radii: ends of the range, where the tool came and went, do not count.
                let mut radii: Vec<f64> = self.turned.values().copied().collect();
                radii.sort_by(f64::total_cmp);
                2.0 * *radii.get(radii.len() / 2)?
            }
            Feature::MilledWidth { .. } => self.sides[1]? - self.sides[0]?,
        };
        Some(Measurement {
            value: gauge.read(size),
            true_value: Millimetres(size),
            samples: self.samples,
        })
    }

    fn cut_at(&mut self, tool: ToolNumber, tip: Point<Setup>) {
        let [x, y, z] = tip.xyz;
        let wear = self.wear.get(&tool).copied().unwrap_or(0.0);
        match self.feature {
            Feature::TurnedDiameter { z_from, z_to } => {
                if z < z_from.0 || z > z_to.0 {
                    return;
                }
                let radius = x + wear;
                let bin = libm::floor(z * 10.0) as i64;
                let smallest = self.turned.entry(bin).or_insert(radius);
                *smallest = smallest.min(radius);
            }
            Feature::MilledWidth {
                axis,
                centre,
                across_from,
                across_to,
                z_below,
                inside,
                cutter_radius,
            } => {
                let (along, across) = if axis == 0 { (x, y) } else { (y, x) };
                if z > z_below.0 || across < across_from.0 || across > across_to.0 {
                    return;
                }
                let nominal = self.tool_radii.get(&tool.0).copied().unwrap_or(cutter_radius.0);
                let radius = nominal - wear;
                let reach = if inside { radius } else { -radius };
                // A pocket is as wide as the cutter went furthest, a boss as it came nearest.
                let (side, edge) = if along < centre.0 {
                    (0, along - reach)
                } else {
                    (1, along + reach)
                };
                let kept = self.sides[side].unwrap_or(edge);
                let lower = (side == 0) == inside;
                self.sides[side] = Some(if lower { kept.min(edge) } else { kept.max(edge) });
            }
        }
        self.samples += 1;
    }
}

impl RecordSink for Part {
    fn sample(&mut self, _sample: &Sample) {}

    fn event(&mut self, event: &Event) {
        match event.kind.as_str() {
            "frame" => {
                if let Some(frame) = frame_of(&event.detail) {
                    self.machine_from_setup = frame;
                    self.setup_from_machine = self.machine_from_setup.inverse();
                }
            }
            "tool-offset" => {
                // The table's wear moves the gauge point on purpose; the tool itself is as long as its geometry says, but for the fault.
                if let Some((geometry, _wear)) = tool_offset_of(&event.detail) {
                    self.geometry = geometry;
                }
            }
            "tool" => {
                let number = event.detail.get("number").and_then(|v| v.as_u64());
                let diameter = event.detail.get("diameter_mm").and_then(|v| v.as_f64());
                if let (Some(number), Some(diameter)) = (number.and_then(|n| u32::try_from(n).ok()), diameter) {
                    self.tool_radii.insert(number, diameter / 2.0);
                }
            }
            _ => {}
        }
    }

    fn truth(&mut self, sample: &Sample, position: [f64; 3]) {
        if sample.phase == Phase::Running && sample.spindle_speed.abs() > 10.0 {
            let gauge_point: Point<Machine> = Point::from_xyz(position);
            let tip = self.setup_from_machine * (gauge_point + -self.geometry);
            self.cut_at(sample.tool, tip);
        }
    }
}
