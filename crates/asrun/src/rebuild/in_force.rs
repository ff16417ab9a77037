//! The frame of a record, stated or fitted, and the offsets that were in force on the machine.

use super::Options;
use crate::align::Spot;
use crate::flat::{Flat, Space};
use crate::labels::Label;
use crate::planned::PlannedProgram;
use crate::recording::{InForce, RecordFrame, RecordPoint, Setting};
use crate::vec3::{V3, sub};
use plan::ToolOffset;
use units::{Point, StepId, Timestamp};

/// The frame of a record, stated or fitted.
pub(super) struct FrameFit {
    pub(super) space: Space,
    /// What is added to positions; `None` when the frame was stated.
    pub(super) shift: Option<V3>,
}

impl FrameFit {
    pub(super) fn of(
        plan: &PlannedProgram,
        frame: RecordFrame,
        spots: &[Spot],
        options: &Options,
        findings: &mut Vec<String>,
    ) -> FrameFit {
        match frame {
            RecordFrame::Machine => FrameFit {
                space: Space::Gauge,
                shift: None,
            },
            RecordFrame::Setup => FrameFit {
                space: Space::Tip,
                shift: None,
            },
            RecordFrame::Unknown => {
                let mut best: Option<(f64, FrameFit)> = None;
                for space in [Space::Tip, Space::Gauge] {
                    let flat = Flat::new(plan, space, options.acceleration.0);
                    if let Some((score, shift)) = crate::coarse::fit_shift(&flat, spots)
                        && best.as_ref().is_none_or(|(least, _)| score < least * 0.8 - 1e-3)
                    {
                        best = Some((
                            score,
                            FrameFit {
                                space,
                                shift: Some(shift),
                            },
                        ));
                    }
                }
                let Some((score, fit)) = best else {
                    return FrameFit {
                        space: Space::Tip,
                        shift: Some([0.0; 3]),
                    };
                };
                let [x, y, z] = fit.shift.unwrap_or_default();
                let name = if fit.space == Space::Tip { "set-up" } else { "machine" };
                findings.push(format!(
                    "the record does not state its frame: {name} positions shifted by X {x:+.3} Y {y:+.3} Z {z:+.3} mm lie on the plan best (estimated; 80 % of the samples then lie within {score:.3} mm); a shifted set-up cannot be told from it"
                ));
                fit
            }
        }
    }
}

/// Tool offsets and frames that were in force on the machine, for each toolpath.
pub(crate) struct Offsets {
    pub(super) tool: Vec<ToolOffset>,
    /// True when the record's own events told it, not the plan.
    pub(super) told: Vec<bool>,
    pub(super) frame: Vec<Option<plan::FrameChange>>,
}

impl Offsets {
    pub(super) fn new(plan: &PlannedProgram, events: &[InForce], points: &[RecordPoint], labels: &[Label]) -> Offsets {
        let n = plan.toolpaths.len();
        let mut began: Vec<Option<Timestamp>> = vec![None; n];
        for (point, label) in points.iter().zip(labels) {
            if let Label::On(toolpath) = label {
                began[*toolpath].get_or_insert(point.at);
            }
        }
        let mut offsets = Offsets {
            tool: Vec::with_capacity(n),
            told: vec![false; n],
            frame: Vec::with_capacity(n),
        };
        let mut sorted: Vec<&InForce> = events.iter().collect();
        sorted.sort_by_key(|e| (e.at, e.step));
        for (toolpath, planned) in plan.toolpaths.iter().enumerate() {
            let in_force = |event: &&&InForce| {
                if event.step != StepId::NONE {
                    event.step <= planned.steps.0
                } else {
                    began[toolpath].is_none_or(|at| event.at <= at)
                }
            };
            let mut tool = None;
            let mut frame = None;
            for event in sorted.iter().filter(in_force) {
                match &event.setting {
                    Setting::Frame(f) => frame = Some(f.clone()),
                    Setting::ToolOffset(o) => tool = Some(*o),
                }
            }
            offsets.told[toolpath] = tool.is_some();
            offsets.tool.push(tool.unwrap_or(planned.tool_offset));
            offsets.frame.push(frame);
        }
        offsets
    }

    /// Tool tip in the plan's own set-up.
    pub(super) fn tip(&self, plan: &PlannedProgram, toolpath: usize, gauge: V3) -> V3 {
        (plan.machine_from_setup(toolpath).inverse() * (Point::from_xyz(gauge) - self.tool[toolpath].total())).xyz
    }

    /// What was taken out, in words.
    pub(super) fn words(&self, plan: &PlannedProgram, toolpaths: &[usize]) -> String {
        let mut all: Vec<String> = Vec::new();
        for &toolpath in toolpaths {
            let offset = &self.tool[toolpath];
            let mut words = String::new();
            let frame = plan.frame_name(toolpath);
            if !frame.is_empty() {
                words += frame;
                if plan.toolpaths[toolpath].frame.is_some_and(|f| plan.frames[f].assumed) {
                    words += " (assumed)";
                }
                words += ", ";
            }
            if offset.number == 0 && offset.total().xyz == [0.0; 3] {
                words += "no tool offset";
            } else {
                let axes = |v: V3| {
                    let parts: Vec<String> = ["X", "Y", "Z"]
                        .iter()
                        .zip(v)
                        .filter(|(_, c)| *c != 0.0)
                        .map(|(a, c)| format!("{a} {c:.3}"))
                        .collect();
                    if parts.is_empty() { "0".to_owned() } else { parts.join(" ") }
                };
                words += &format!(
                    "offset {} geometry {} wear {} mm",
                    offset.number,
                    axes(offset.geometry.xyz),
                    axes(offset.wear.xyz)
                );
                if offset.assumed {
                    words += " (assumed)";
                }
            }
            if !self.told[toolpath] {
                words += " (by the plan)";
            }
            if !all.contains(&words) {
                all.push(words);
            }
        }
        all.join("; ")
    }

    /// Where the machine's own frame was another one than the plan's.
    pub(super) fn frame_findings(
        &self,
        plan: &PlannedProgram,
        toolpaths: &[usize],
        workingstep: &str,
        findings: &mut Vec<String>,
    ) {
        for &toolpath in toolpaths {
            let Some(real) = &self.frame[toolpath] else { continue };
            let planned = plan.machine_from_setup(toolpath);
            let off = sub(real.machine_from_setup.origin, planned.origin);
            let turned = angle(&real.machine_from_setup.rotation, &planned.rotation);
            let name = if real.name.is_empty() {
                plan.frame_name(toolpath)
            } else {
                &real.name
            };
            let mut parts: Vec<String> = ["X", "Y", "Z"]
                .iter()
                .zip(off)
                .filter(|(_, c)| c.abs() >= 5e-4)
                .map(|(a, c)| format!("{:.3} mm off in {a} ({c:+.3})", c.abs()))
                .collect();
            if turned > 1e-4 {
                parts.push(format!("turned by {:.3} degrees", turned.to_degrees()));
            }
            if !parts.is_empty() {
                let text = format!(
                    "set-up {name} of workingstep '{workingstep}' was {} on the machine",
                    parts.join(" and ")
                );
                if !findings.contains(&text) {
                    findings.push(text);
                }
            }
        }
    }
}

/// Angle between two rotations.
fn angle(a: &[[f64; 3]; 3], b: &[[f64; 3]; 3]) -> f64 {
    let trace: f64 = (0..3).map(|r| (0..3).map(|c| a[r][c] * b[r][c]).sum::<f64>()).sum();
    libm::acos(((trace - 1.0) / 2.0).clamp(-1.0, 1.0))
}
