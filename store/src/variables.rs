//! What programs write and the control keeps: variables #500 to #999, counters, and the registers of the machine's tables.
//!
//! A kept variable is a process value like an offset, `<machine>/variable/501` in the program's own unit, so that every change has who,
//! when, why, before and after. Vacant is no number: `<machine>/variable/501/vacant` is 1 while a variable that once held a number is
//! vacant.

use crate::registers::Register;
use crate::{DataDirectory, MachineFile, StoreError};
use ledger::{Change, ChangeRequest};
use plan::RegisterChange;
use std::collections::BTreeMap;
use units::{Axis, Timestamp, ToolNumber};

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

    /// Takes what a program wrote into the machine's values, in order; what is there already changes nothing.
    ///
    /// # Errors
    /// The disk refuses. What came before in the list is written.
    pub fn write_registers(
        &mut self,
        machine: &MachineFile,
        changes: &[RegisterChange],
        (who, why): (&str, &str),
        when: Timestamp,
    ) -> Result<Vec<Change>, StoreError> {
        let mut made = Vec::new();
        for change in changes {
            for (path, to) in values_of(machine, change) {
                let now = self.value(&path)?;
                if now == Some(to) || (now.is_none() && to == 0.0 && path.ends_with("/vacant")) {
                    continue;
                }
                made.push(self.change_value(&ChangeRequest {
                    path,
                    to,
                    expected: now,
                    who: who.to_owned(),
                    why: why.to_owned(),
                    when,
                })?);
            }
        }
        Ok(made)
    }
}

/// The process values that a change writes.
fn values_of(machine: &MachineFile, change: &RegisterChange) -> Vec<(String, f64)> {
    use plan::Register as Written;
    let tool = |number: &u32| ToolNumber(*number);
    let axis = |index: &usize| Axis::ALL.into_iter().nth(*index).filter(|a| machine.axis(*a).is_some());
    let register = match &change.register {
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
    use crate::MachineKind;

    fn change(register: plan::Register, after: Option<f64>) -> RegisterChange {
        RegisterChange {
            register,
            before: None,
            after,
        }
    }

    #[test]
    fn what_a_program_wrote_is_there_at_the_next_start() {
        let folder = tempfile::tempdir().unwrap();
        let mut directory = DataDirectory::open(folder.path(), "test").unwrap();
        let machine = MachineFile::simulated(MachineKind::Lathe);
        let wrote = [
            change(plan::Register::Variable(501), Some(3.2351)),
            change(plan::Register::Variable(502), Some(7.0)),
            change(plan::Register::ToolWear { tool: 5, axis: 0 }, Some(-0.01)),
        ];
        let by = ("operator", "O9000");
        assert_eq!(
            directory.write_registers(&machine, &wrote, by, Timestamp(1)).unwrap().len(),
            3
        );
        assert_eq!(
            directory.write_registers(&machine, &wrote, by, Timestamp(2)).unwrap().len(),
            0,
            "nothing twice"
        );
        assert_eq!(
            directory.variables(&machine).unwrap(),
            BTreeMap::from([(501, 3.2351), (502, 7.0)])
        );
        let wear = directory.value(&format!("{}/tool/5/wear/x_mm", machine.name)).unwrap();
        assert_eq!(wear, Some(-0.02), "a diameter");
        let vacant = [change(plan::Register::Variable(502), None)];
        directory.write_registers(&machine, &vacant, by, Timestamp(3)).unwrap();
        assert_eq!(directory.variables(&machine).unwrap(), BTreeMap::from([(501, 3.2351)]));
        let again = [change(plan::Register::Variable(502), Some(0.0))];
        directory.write_registers(&machine, &again, by, Timestamp(4)).unwrap();
        assert_eq!(directory.variables(&machine).unwrap().get(&502), Some(&0.0));
    }
}
