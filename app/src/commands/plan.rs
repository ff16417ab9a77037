//! `toolmark plan`: the set-points that a program becomes.

use super::{Done, print_json};
use crate::cli::{Common, FrameName, PlanArgs};
use crate::failure::{Exit, Failure};
use crate::program::{Program, machine_for, named_machine};
use crate::progress::Progress;
use crate::survey::{beforehand, minutes};
use crate::{say, shop};
use ::plan::{Diagnostic, StepKind};
use motion::{Limits, Output, Statistics, Trajectory};
use serde_json::{Value, json};
use std::path::Path;
use units::{Machine, Millimetres, MmPerSec, MmPerSec2, MmPerSec3, Point, Setup, TICK, Transform, Vector};

/// Runs the command.
///
/// # Errors
/// The program or the limits cannot be read, the program alarms, or the output cannot be written.
pub fn plan(args: &PlanArgs, common: &Common) -> Done {
    let ending = args.out.extension().map(|e| e.to_string_lossy().to_lowercase());
    if !matches!(ending.as_deref(), Some("csv" | "parquet")) {
        return Err(Failure::usage(format_args!(
            "--out {}: a name that ends in .csv or .parquet was expected",
            args.out.display()
        )));
    }
    let mut program = Program::open(
        &args.program,
        common.dialect.as_deref(),
        named_machine(&common.machine)?.as_ref(),
    )?;
    let machine = machine_for(&common.machine, program.turns())?;
    let shop::InForce {
        tables,
        variables,
        source,
    } = shop::in_force(common, &machine)?;
    program.variables = variables;
    let limits = match &args.limits {
        None => shop::limits(&machine),
        Some(file) => read_limits(file, shop::limits(&machine))?,
    };
    let mut trajectory = Trajectory::new(program.stream(&tables)?, tables.position, limits);
    let mut writer = store::trajectory::Writer::create(&args.out).map_err(shop::failure)?;
    let mut progress = Progress::new("planning");
    let mut setup_from_machine: Transform<Setup, Machine> = Transform::IDENTITY;
    let mut offset: Vector<Machine> = Vector::ZERO;
    let (mut tick, mut rows) = (0u64, 0u64);
    let mut answer = None;
    let alarm = loop {
        match trajectory.next(answer.take()) {
            Output::Command(machine::Command::SetPoint(point)) => {
                let placed = |gauge: Point<Machine>| match args.frame {
                    FrameName::Machine => gauge.xyz,
                    FrameName::Setup => (setup_from_machine * (gauge - offset)).xyz,
                };
                if rows == 0 {
                    // Where it begins, at rest: with it the path is whole.
                    let begins = store::trajectory::Point {
                        position: placed(tables.position),
                        ..Default::default()
                    };
                    writer.write(&begins).map_err(shop::failure)?;
                    rows += 1;
                }
                tick += 1;
                rows += 1;
                let position = placed(Point::from_xyz(point.position));
                let row = store::trajectory::Point {
                    t: tick as f64 * TICK.0,
                    position,
                    step: point.step,
                    path_length: point.path_length,
                    path_speed: point.path_speed,
                };
                writer.write(&row).map_err(shop::failure)?;
                progress.at(|| format!("{} of motion", minutes(tick as f64 * TICK.0)));
            }
            Output::Command(machine::Command::Dwell { cycles, .. }) => tick += u64::from(cycles),
            Output::Command(_) => {}
            Output::Passed(step) => match step.kind {
                StepKind::Frame(frame) => setup_from_machine = frame.machine_from_setup.inverse(),
                StepKind::ToolOffset(tool_offset) => offset = tool_offset.total(),
                _ => {}
            },
            Output::Ask(question) => answer = Some(beforehand(&question)),
            Output::End => break None,
            Output::Alarm(alarm) => break Some(alarm),
        }
    };
    drop(progress);
    if let Some(alarm) = alarm {
        return Err(alarm.into());
    }
    writer.finish().map_err(shop::failure)?;
    let s = trajectory.statistics();
    let mut remarks = trajectory.stream().diagnostics().to_vec();
    remarks.extend(over_limit(&s));
    let (dialect, because) = program.dialect();
    if common.json {
        print_json(&json!({
            "time_s": s.time.0,
            "blocks": s.blocks,
            "samples": rows,
            "path_length_mm": s.path_length.0,
            "max_deviation_mm": s.max_deviation.0,
            "worst_ratio": { "v": s.worst_speed_ratio, "a": s.worst_acceleration_ratio, "j": s.worst_jerk_ratio },
            "dialect": { "name": dialect, "because": because },
            "frame": match args.frame { FrameName::Machine => "machine", FrameName::Setup => "setup" },
            "offsets": source,
            "remarks": remarks,
        }))?;
    } else {
        for remark in &remarks {
            say(&remark.to_string());
        }
        say(&format!(
            "{}: {:.3} s for {} moves over {:.1} mm ({dialect}: {because})",
            program.name, s.time.0, s.blocks, s.path_length.0
        ));
        say(&format!(
            "{} set-points in {}; speed up to {:.2} %, acceleration up to {:.2} %{} of the limits, {:.4} mm off the path at most",
            rows,
            args.out.display(),
            100.0 * s.worst_speed_ratio,
            100.0 * s.worst_acceleration_ratio,
            s.worst_jerk_ratio
                .map_or(String::new(), |j| format!(", jerk up to {:.2} %", 100.0 * j)),
            s.max_deviation.0
        ));
    }
    Ok(Exit::Good)
}

/// The planner keeps back a part of each limit, and rare programs use more than all of it.
fn over_limit(s: &Statistics) -> Option<Diagnostic> {
    let ratios = [
        ("speed", s.worst_speed_ratio),
        ("acceleration", s.worst_acceleration_ratio),
        ("jerk", s.worst_jerk_ratio.unwrap_or(0.0)),
    ];
    let over: Vec<String> = (ratios.iter())
        .filter(|(_, ratio)| *ratio > 1.001)
        .map(|(name, ratio)| format!("{name} by {:.2} %", 100.0 * (ratio - 1.0)))
        .collect();
    let message = format!("an axis is over its limit at the worst set-point: {}", over.join(", "));
    let remedy = "plan with limits that are as much lower";
    (!over.is_empty()).then(|| Diagnostic::warning("over-limit", message).remedy(remedy))
}

/// Limits from a file; what it does not say is the machine's.
fn read_limits(file: &Path, mut limits: Limits) -> Result<Limits, Failure> {
    let name = file.display();
    let text = std::fs::read_to_string(file).map_err(|e| Failure::unreadable(format_args!("{name}: {e}")))?;
    let value: Value = serde_json::from_str(&text).map_err(|e| {
        let words = e.to_string();
        let what = words.split(" at line ").next().unwrap_or_default();
        let (line, column) = (e.line().max(1), e.column().max(1));
        Failure::unreadable(format_args!("{name}:{line}:{column}: {what}; {LIMITS_FORM}"))
    })?;
    let Value::Object(fields) = &value else {
        return Err(Failure::unreadable(format_args!("{name}:1:1: {LIMITS_FORM}")));
    };
    for (key, value) in fields {
        let unreadable = |what: String| {
            let (line, column) = place_of(&text, key);
            Failure::unreadable(format_args!("{name}:{line}:{column}: {what}"))
        };
        let axes = || -> Result<[f64; 3], Failure> {
            let positive = |v: &Value| v.as_f64().filter(|n| *n > 0.0 && n.is_finite());
            let numbers = match value {
                Value::Array(list) if list.len() == 3 => list.iter().map(positive).collect::<Option<Vec<f64>>>(),
                one => positive(one).map(|n| vec![n; 3]),
            };
            numbers.and_then(|n| n.try_into().ok()).ok_or_else(|| {
                unreadable(format!(
                    "{key}: a number above 0, or one for each of X, Y and Z, was expected, not {value}"
                ))
            })
        };
        match key.as_str() {
            "v_max_mm_s" => limits.v_max = axes()?.map(MmPerSec),
            "a_max_mm_s2" => limits.a_max = axes()?.map(MmPerSec2),
            "j_max_mm_s3" => limits.j_max = Some(axes()?.map(MmPerSec3)),
            "tolerance_mm" => {
                let tolerance = value.as_f64().filter(|n| *n >= 0.0 && n.is_finite());
                limits.tolerance =
                    Millimetres(tolerance.ok_or_else(|| unreadable(format!("tolerance_mm: {value} is no length")))?);
            }
            other => {
                return Err(unreadable(format!(
                    "{other} is unknown; known are v_max_mm_s, a_max_mm_s2, j_max_mm_s3, tolerance_mm"
                )));
            }
        }
    }
    Ok(limits)
}

const LIMITS_FORM: &str =
    "an object was expected, like {\"v_max_mm_s\":500,\"a_max_mm_s2\":3000,\"j_max_mm_s3\":50000,\"tolerance_mm\":0.01}";

/// Line and column, from 1, at which a key of a JSON object stands.
fn place_of(text: &str, key: &str) -> (usize, usize) {
    let before = text.find(&format!("\"{key}\"")).map_or("", |at| &text[..at]);
    let line = before.matches('\n').count() + 1;
    let column = before.chars().rev().take_while(|c| *c != '\n').count() + 1;
    (line, column)
}

#[cfg(test)]
mod tests {
    use super::over_limit;
    use motion::Statistics;

    #[test]
    fn a_plan_over_a_limit_says_which_and_by_how_much() {
        let mut s = Statistics {
            worst_speed_ratio: 0.9995,
            worst_acceleration_ratio: 1.0009,
            worst_jerk_ratio: Some(1.0005),
            ..Statistics::default()
        };
        assert!(over_limit(&s).is_none());
        s.worst_jerk_ratio = Some(1.0039);
        assert!(over_limit(&s).expect("a warning").to_string().contains("jerk by 0.39 %"));
    }
}
