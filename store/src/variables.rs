//! What programs write and the control keeps: variables #500 to #999, counters, and the registers of the machine's tables.
//!
//! A kept variable is a process value like an offset, `<machine>/variable/501` in the program's own unit, so that every change has who,
//! when, why, before and after. Vacant is no number: `<machine>/variable/501/vacant` is 1 while a variable that once held a number is
//! vacant.

use crate::events::{apply_change, read_value};
use crate::registers::Register;
use crate::{DataDirectory, JobId, MachineFile, StoreError};
use ledger::{Change, ChangeRequest, Event, ProgramLine};
use plan::RegisterChange;
use serde_json::Value;
use std::collections::BTreeMap;
use units::{Axis, ToolNumber};

impl DataDirectory {
    /// The kept variables of a machine that hold something.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn variables(&self, machine: &MachineFile) -> Result<BTreeMap<u32, f64>, StoreError> {
        let prefix = format!("{}/variable/", machine.name);
        let values = self.values(&prefix)?;
        let is_vacant = |number: u32| values.get(&format!("{prefix}{number}/vacant")) == Some(&1.0);
        Ok(values
            .iter()
            .filter_map(|(path, value)| Some((path.strip_prefix(&prefix)?.parse::<u32>().ok()?, *value)))
            .filter(|(number, _)| !is_vacant(*number))
            .collect())
    }

    /// Keeps what happened in a job, and makes the changes of registers and kept variables that its program wrote: an event and what it
    /// changes are one transaction, so that after a power loss both are there or neither is, and nothing is ever applied twice. A write
    /// that leaves a value as it is changes nothing.
    ///
    /// # Errors
    /// They do not continue what is kept of this job, the job is not running, or the disk refuses. Nothing was written then.
    pub fn append_run_events(
        &mut self,
        job: JobId,
        machine: &MachineFile,
        who: &str,
        events: &[Event],
    ) -> Result<Vec<Change>, StoreError> {
        let failed = self.failed();
        let mut made = Vec::new();
        self.append_events_with(job, events, &mut |connection, chain, event| {
            let Some((change, line)) = written(event, job) else {
                return Ok(());
            };
            for (path, to) in values_of(machine, &change) {
                let now = read_value(connection, &path).map_err(&failed)?;
                if now == Some(to) || (now.is_none() && to == 0.0 && path.ends_with("/vacant")) {
                    continue;
                }
                let request = ChangeRequest {
                    path,
                    to,
                    expected: now,
                    who: author(&line),
                    why: format!("{} was written by the program, in job {job} of {who}", change.register.name()),
                    when: event.at(),
                };
                made.push(apply_change(connection, chain, (&request, Some(&line)), &failed, &mut || {})?);
            }
            Ok(())
        })?;
        Ok(made)
    }
}

/// Who stands behind a change that a program makes: the program and its line.
fn author(line: &ProgramLine) -> String {
    match line.line {
        Some(number) => format!("{} line {number}", line.file),
        None => line.file.clone(),
    }
}

/// The change that an event of a job tells of, and who asks for it; `None` for other events.
fn written(event: &Event, job: JobId) -> Option<(RegisterChange, ProgramLine)> {
    if event.kind != "register" {
        return None;
    }
    let text = |key: &str| event.detail.get(key).and_then(Value::as_str);
    let number = |key: &str| event.detail.get(key).and_then(Value::as_f64);
    let change = RegisterChange {
        register: plan::Register::named(text("register")?)?,
        before: number("before"),
        after: number("after"),
    };
    let line = event.detail.get("line").and_then(Value::as_u64);
    let line = ProgramLine {
        job: job.0,
        file: text("file").filter(|f| !f.is_empty()).unwrap_or("the program").to_owned(),
        line: line.and_then(|n| u32::try_from(n).ok()),
    };
    Some((change, line))
}

/// Variables that a control keeps when the power goes off. Outputs and settings (#1100, #3003) begin anew with every program.
fn is_kept(variable: u32) -> bool {
    matches!(variable, 500..=999 | 3901 | 3902)
}

/// The process values that a change writes.
fn values_of(machine: &MachineFile, change: &RegisterChange) -> Vec<(String, f64)> {
    use plan::Register as Written;
    let tool = |number: &u32| ToolNumber(*number);
    let axis = |index: &usize| Axis::ALL.into_iter().nth(*index).filter(|a| machine.axis(*a).is_some());
    let register = match &change.register {
        Written::Variable(number) if !is_kept(*number) => return Vec::new(),
        Written::Variable(number) => {
            let path = format!("{}/variable/{number}", machine.name);
            let vacant = format!("{path}/vacant");
            return match change.after {
                Some(value) => vec![(path, value), (vacant, 0.0)],
                None => vec![(vacant, 1.0)],
            };
        }
        Written::ToolGeometry {
            tool: number,
            axis: index,
        } => axis(index).map(|axis| Register::ToolGeometry {
            tool: tool(number),
            axis,
        }),
        Written::ToolWear {
            tool: number,
            axis: index,
        } => axis(index).map(|axis| Register::ToolWear {
            tool: tool(number),
            axis,
        }),
        Written::ToolRadius { tool: number } => Some(Register::ToolRadius(tool(number))),
        Written::ToolRadiusWear { tool: number } => Some(Register::ToolRadiusWear(tool(number))),
        Written::TipDirection { tool: number } => Some(Register::ToolTipDirection(tool(number))),
        Written::WorkOffset { name, axis: index } => axis(index).map(|axis| Register::WorkOffset {
            name: name.clone(),
            axis,
        }),
    };
    let (Some(register), Some(value)) = (register, change.after) else {
        return Vec::new();
    };
    // Registers of an axis that counts diameters hold diameters, as on the control.
    let counts_diameters = match &register {
        Register::ToolGeometry { axis, .. } | Register::ToolWear { axis, .. } | Register::WorkOffset { axis, .. } => {
            machine.counts_diameters(*axis)
        }
        _ => false,
    };
    vec![(register.of(machine), if counts_diameters { 2.0 * value } else { value })]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Log, MachineKind, NewJob};
    use ledger::{Chain, Hash};
    use serde_json::json;
    use units::Timestamp;

    /// Events of a run, in the order in which a program wrote its registers: name, value, line.
    fn writes(chain: &mut Chain, all: &[(&str, Value, u32)]) -> Vec<Event> {
        let event = |(register, after, line): &(&str, Value, u32)| {
            let detail = BTreeMap::from([
                ("register".to_owned(), json!(register)),
                ("after".to_owned(), after.clone()),
                ("file".to_owned(), json!("O9000.nc")),
                ("line".to_owned(), json!(line)),
            ]);
            let detail = detail.into_iter().filter(|(_, v)| !v.is_null()).collect();
            chain.append(Timestamp(i64::from(*line)), "register", detail)
        };
        all.iter().map(event).collect()
    }

    fn begin(directory: &mut DataDirectory, machine: &MachineFile) -> JobId {
        let new = NewJob {
            program: "part.nc",
            program_hash: Hash::of(b"part"),
            machine: &machine.name,
            seed: 1,
            start: Timestamp(0),
            folder: None,
            who: "Maria",
        };
        directory.begin_job(&new).unwrap().id
    }

    #[test]
    fn what_a_program_wrote_is_there_at_the_next_start() {
        let folder = tempfile::tempdir().unwrap();
        let mut directory = DataDirectory::open(folder.path(), "test").unwrap();
        let machine = MachineFile::simulated(MachineKind::Lathe);
        let job = begin(&mut directory, &machine);
        let mut chain = Chain::default();
        let mut run = |directory: &mut DataDirectory, all: &[(&str, Value, u32)]| {
            let events = writes(&mut chain, all);
            directory.append_run_events(job, &machine, "Maria", &events).unwrap()
        };
        let wrote = [
            ("#501", json!(3.2351), 1),
            ("#502", json!(7.0), 2),
            ("tool 5 wear X", json!(-0.01), 3),
            ("G55 Z", json!(-400.5), 4),
            ("#3901", json!(12.0), 5),
            ("#1100", json!(1.0), 6),
        ];
        assert_eq!(run(&mut directory, &wrote).len(), 5, "an output is not kept");
        assert_eq!(run(&mut directory, &wrote).len(), 0, "nothing twice");
        assert_eq!(
            directory.variables(&machine).unwrap(),
            BTreeMap::from([(501, 3.2351), (502, 7.0), (3901, 12.0)])
        );
        let wear = format!("{}/tool/5/wear/x_mm", machine.name);
        assert_eq!(directory.value(&wear).unwrap(), Some(-0.02), "a diameter");
        let told = directory.changes_of(&wear, 0).unwrap();
        assert_eq!(told.len(), 1);
        assert_eq!(told[0].detail["who"], "O9000.nc line 3");
        assert_eq!(told[0].detail["job"], job.0);
        assert_eq!(
            told[0].detail["why"],
            "tool 5 wear X was written by the program, in job 1 of Maria"
        );
        run(&mut directory, &[("#502", Value::Null, 7)]);
        assert_eq!(directory.variables(&machine).unwrap().get(&502), None, "vacant");
        run(&mut directory, &[("#502", json!(0.0), 8)]);
        assert_eq!(directory.variables(&machine).unwrap().get(&502), Some(&0.0));
        assert_eq!(directory.verify().unwrap(), []);
    }

    #[test]
    fn an_event_that_does_not_follow_changes_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let mut directory = DataDirectory::open(folder.path(), "test").unwrap();
        let machine = MachineFile::simulated(MachineKind::Lathe);
        let job = begin(&mut directory, &machine);
        let mut events = writes(&mut Chain::default(), &[("#501", json!(1.0), 1), ("#502", json!(2.0), 2)]);
        events.push(events[1].clone());
        assert!(directory.append_run_events(job, &machine, "Maria", &events).is_err());
        assert_eq!(directory.variables(&machine).unwrap(), BTreeMap::new());
        assert_eq!(directory.events(Log::Job(job), 1, 10).unwrap(), []);
    }
}
