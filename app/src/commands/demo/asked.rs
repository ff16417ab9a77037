//! The chapter of what a program asks for: a recording and a synchronized action, put into the bracket's program, done by the machine, and
//! written for another control.

use super::{BRACKET, Chapter, Story};
use crate::cli::PostArgs;
use crate::commands::post;
use crate::failure::Failure;
use crate::functions::Told;
use crate::{files, program::Program};
use cell::Ended;
use serde_json::{Value, json};
use stepnc::edit::ProgramEdits;
use stepnc::select::select_spot;
use units::Seconds;

/// What is put before which workingstep.
const ASKED: [(&str, &str, &str); 3] = [
    (
        "round pocket",
        "watch the time",
        "trace:1 start_synchronized_action its_id=1 its_mode_scope=ALL its_frequency=WHEN its_condition=\"ws_time > 5 s\" \
         its_actions=\"read_sensor_value its_sensor=POSITION.ACTUAL its_axes=X,Y,Z\",\"read_sensor_value its_sensor=LOAD \
         its_axes=X,Y,Z\",\"set_alarm its_alarm_id=101 its_text=\"\"this takes longer than 5 s\"\" its_reaction=none\"",
    ),
    (
        "round pocket",
        "record the loads",
        "trace:1 start_sensor_recording its_function_id=R1 its_sensors=LOAD its_axes=X,Y,Z its_sampling=10",
    ),
    (
        "wave groove",
        "loads are recorded",
        "trace:1 stop_sensor_recording its_function_id=R1",
    ),
];

impl Story<'_> {
    /// Functions put into a program, seen on the machine, and posted.
    pub(super) fn asked(&mut self) -> Result<Chapter, Failure> {
        (self.tell)("");
        (self.tell)("3. What the program itself asks for: a recording and a condition, put into the bracket's program");
        let path = self.folder.join("bracket-traced.stpnc");
        let text = with_functions(BRACKET)?;
        files::write(&path, &text)?;
        let program = Program::open(&path, None, None)?;
        let run = self.run(&program, "bracket-traced", vec![], None, self.start + Seconds(2400.0), None)?;
        let told = &run.printed.functions;
        let find = |function: &str, state: &str| {
            told.iter()
                .find(|t| t.function == function && t.data.get("state") == Some(&json!(state)))
        };
        let recorded = find("stop_sensor_recording", "ended");
        let fired = find("start_synchronized_action", "fired");
        let samples = recorded.and_then(|t| t.data.get("samples")?.as_u64());
        (self.tell)(&format!(
            "   recording R1: X, Y and Z load every 10th cycle of 'round pocket': {} samples, in functions.parquet",
            samples.map_or("no".to_owned(), |n| n.to_string())
        ));
        let cycle = |name: &str| fired.and_then(|t: &Told| t.data.get(name)?.as_u64());
        let condition = cycle("cycle_of_condition");
        (self.tell)(&format!(
            "   condition 'ws_time > 5 s': {}, place and loads are in the log, alarm 101 is set",
            condition.map_or("never true".to_owned(), |n| format!(
                "first true in servo cycle {n}, acted on in the same"
            ))
        ));
        let posted = post::posted(
            &PostArgs {
                program: path.clone(),
                control: "siemens-840d".to_owned(),
                out: None,
                number: None,
                chord: 0.005,
                check_every: 20,
                as_interpreted: false,
            },
            &program,
            "sim",
        )?;
        let out = self.folder.join("bracket-traced.mpf");
        files::write(&out, &posted.text)?;
        let lines = String::from_utf8_lossy(&posted.text).into_owned();
        let action = lines.lines().find(|line| line.starts_with("IDS=1 "));
        (self.tell)(&format!(
            "   the same for a Siemens 840D, in {} lines: {} ...",
            posted.posted.lines,
            action.map_or("no action", |line| line.split(" DO ").next().unwrap_or(line))
        ));
        Ok(Chapter {
            came_true: run.outcome.ended == Ended::Completed
                && samples.is_some_and(|n| n > 0)
                && fired.is_some()
                && action.is_some(),
            numbers: json!({
                "recorded": recorded.map(|t| Value::from_iter(t.data.clone())),
                "fired": fired.map(|t| Value::from_iter(t.data.clone())),
                "posted_lines": posted.posted.lines,
                "posted_action": action,
            }),
        })
    }
}

/// The program with the functions in it; nothing else of it changes.
fn with_functions(text: &str) -> Result<Vec<u8>, Failure> {
    let mut bytes = text.as_bytes().to_vec();
    for (before, name, function) in ASKED {
        let program =
            stepnc::Program::read("bracket.stpnc", bytes).map_err(|e| Failure::unreadable(format_args!("bracket.stpnc: {e}")))?;
        let spot = select_spot(&program, before).map_err(|e| Failure::unreadable(format_args!("bracket.stpnc: {e}")))?;
        let mut edits = ProgramEdits::new(&program);
        let saved = edits
            .insert_function(spot, name, function)
            .and_then(|_| edits.save())
            .map_err(|e| Failure::unreadable(format_args!("bracket.stpnc: {e}")))?;
        bytes = saved.bytes;
    }
    Ok(bytes)
}
