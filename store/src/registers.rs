//! Paths of the process values that a run depends on, and the tables that a program reads, built from them.
//!
//! A path is `<machine>/tool/3/wear/x_mm`: two machines may work in one data directory. Lengths are mm. X of an axis that counts
//! diameters (a lathe's) is a diameter in every register, as on the control; [`tables`] halves it, because inside the house X is a
//! radius.

use crate::machine_file::Driver;
use crate::{DataDirectory, MachineFile, StoreError};
use ledger::{Change, ChangeRequest};
use plan::tables::Offset;
use plan::{Missing, Tables, ToolEntry};
use std::collections::BTreeMap;
use std::fmt;
use units::{Axis, Millimetres, Point, Timestamp, ToolNumber, Transform, Vector};

/// A process value of a machine.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Register {
    /// From tip to gauge point along an axis, measured with a new tool: `tool/3/geometry/x_mm`.
    ToolGeometry {
        /// Which tool.
        tool: ToolNumber,
        /// Along which axis.
        axis: Axis,
    },
    /// Correction since: `tool/3/wear/x_mm`.
    ToolWear {
        /// Which tool.
        tool: ToolNumber,
        /// Along which axis.
        axis: Axis,
    },
    /// Cutting diameter: `tool/3/diameter_mm`.
    ToolDiameter(ToolNumber),
    /// Radius register of compensation, a mill's D or a nose radius: `tool/3/radius_mm`.
    ToolRadius(ToolNumber),
    /// Correction of the radius: `tool/3/radius_wear_mm`.
    ToolRadiusWear(ToolNumber),
    /// Where the imaginary tip of a turning tool lies, 0 to 9: `tool/3/tip_direction`.
    ToolTipDirection(ToolNumber),
    /// A work offset along an axis: `offset/G54/x_mm`.
    WorkOffset {
        /// G54, or the set-up's name.
        name: String,
        /// Along which axis.
        axis: Axis,
    },
}

impl fmt::Display for Register {
    /// The path within the machine.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Register::ToolGeometry { tool, axis } => write!(f, "tool/{}/geometry/{}_mm", tool.0, axis.letter()),
            Register::ToolWear { tool, axis } => write!(f, "tool/{}/wear/{}_mm", tool.0, axis.letter()),
            Register::ToolDiameter(tool) => write!(f, "tool/{}/diameter_mm", tool.0),
            Register::ToolRadius(tool) => write!(f, "tool/{}/radius_mm", tool.0),
            Register::ToolTipDirection(tool) => write!(f, "tool/{}/tip_direction", tool.0),
            Register::ToolRadiusWear(tool) => write!(f, "tool/{}/radius_wear_mm", tool.0),
            // A set-up's name is free text; a slash in it must not make another path.
            Register::WorkOffset { name, axis } => {
                write!(
                    f,
                    "offset/{}/{}_mm",
                    name.replace('%', "%25").replace('/', "%2F"),
                    axis.letter()
                )
            }
        }
    }
}

impl Register {
    /// The whole path: `sim-lathe/tool/3/wear/x_mm`.
    pub fn of(&self, machine: &MachineFile) -> String {
        format!("{}/{self}", machine.name)
    }

    /// Reads a path within a machine; `None` when it is none of ours.
    pub fn parse(path: &str) -> Option<Register> {
        let axis = |key: &str| {
            Axis::ALL
                .into_iter()
                .find(|a| key.strip_suffix("_mm") == Some(a.letter().encode_utf8(&mut [0; 4])))
        };
        let number = |text: &str| {
            let plain = text.bytes().all(|b| b.is_ascii_digit()) && (text == "0" || !text.starts_with('0'));
            plain.then(|| text.parse().ok().map(ToolNumber)).flatten()
        };
        let parts: Vec<&str> = path.split('/').collect();
        Some(match *parts.as_slice() {
            ["tool", tool, "geometry", key] => Register::ToolGeometry {
                tool: number(tool)?,
                axis: axis(key)?,
            },
            ["tool", tool, "wear", key] => Register::ToolWear {
                tool: number(tool)?,
                axis: axis(key)?,
            },
            ["tool", tool, "diameter_mm"] => Register::ToolDiameter(number(tool)?),
            ["tool", tool, "radius_mm"] => Register::ToolRadius(number(tool)?),
            ["tool", tool, "tip_direction"] => Register::ToolTipDirection(number(tool)?),
            ["tool", tool, "radius_wear_mm"] => Register::ToolRadiusWear(number(tool)?),
            ["offset", name, key] => Register::WorkOffset {
                name: name.replace("%2F", "/").replace("%25", "%"),
                axis: axis(key)?,
            },
            _ => return None,
        })
    }
}

/// What a machine has ready when a program starts: the first day of its file, overlaid by `values`, the registers in force by whole
/// path. What is in neither is assumed on the simulator and an alarm on any other machine.
///
/// # Errors
/// A register holds something that cannot be.
pub fn tables(machine: &MachineFile, values: &BTreeMap<String, f64>) -> Result<Tables, StoreError> {
    let mut all = first_day(machine);
    let prefix = format!("{}/", machine.name);
    for (path, &value) in values
        .range(prefix.clone()..)
        .take_while(|(path, _)| path.starts_with(&prefix))
    {
        let bad = |what: &str| StoreError::BadRegister {
            path: path.clone(),
            value,
            what: what.to_owned(),
        };
        // Values of other kinds live beside the offsets and are not ours to judge.
        if let Some(register) = Register::parse(&path[prefix.len()..]) {
            if !value.is_finite() {
                return Err(bad("an offset must be a finite number"));
            }
            if matches!(register, Register::ToolDiameter(_)) && value <= 0.0 {
                return Err(bad("a cutting diameter must be above 0"));
            }
            let is_tip = matches!(register, Register::ToolTipDirection(_));
            if is_tip && !(value.trunc() == value && (0.0..=9.0).contains(&value)) {
                return Err(bad("a tip direction is a whole number from 0 to 9"));
            }
            all.insert(register, value);
        }
    }
    let mut tools: BTreeMap<ToolNumber, ToolEntry> = BTreeMap::new();
    let mut origins: BTreeMap<String, [f64; 3]> = BTreeMap::new();
    for (number, tool) in &machine.tools {
        tools.entry(*number).or_default().name.clone_from(&tool.name);
    }
    for (register, value) in all {
        let inside = |axis: Axis| if machine.counts_diameters(axis) { value / 2.0 } else { value };
        match register {
            Register::ToolGeometry { tool, axis } => along(&mut tools.entry(tool).or_default().geometry, axis, inside(axis)),
            Register::ToolWear { tool, axis } => along(&mut tools.entry(tool).or_default().wear, axis, inside(axis)),
            Register::ToolDiameter(tool) => tools.entry(tool).or_default().diameter = Some(Millimetres(value)),
            Register::ToolRadius(tool) => tools.entry(tool).or_default().radius = Millimetres(value),
            Register::ToolTipDirection(tool) => tools.entry(tool).or_default().tip_direction = value as u8,
            Register::ToolRadiusWear(tool) => tools.entry(tool).or_default().radius_wear = Millimetres(value),
            Register::WorkOffset { name, axis } => origins.entry(name).or_default()[axis.index()] = inside(axis),
        }
    }
    Ok(Tables {
        // The machine frame begins at home, and a run begins there.
        position: Point::ORIGIN,
        tools,
        work_offsets: origins
            .into_iter()
            .map(|(name, origin)| (name, Transform::shift(origin)))
            .collect(),
        missing: match machine.driver {
            Driver::Sim => Missing::Assume,
            Driver::Card(_) => Missing::Fail,
        },
    })
}

fn along(offset: &mut Offset, axis: Axis, value: f64) {
    let mut xyz = offset.0.xyz;
    xyz[axis.index()] = value;
    *offset = Offset(Vector::from_xyz(xyz));
}

/// The values that a machine file begins with. Axes that the machine does not have are left out.
pub fn first_day(machine: &MachineFile) -> BTreeMap<Register, f64> {
    let mut values = BTreeMap::new();
    let axes = || Axis::ALL.into_iter().filter(|a| machine.axis(*a).is_some());
    for (&number, tool) in &machine.tools {
        for axis in axes() {
            values.insert(Register::ToolGeometry { tool: number, axis }, tool.geometry[axis.index()]);
        }
        if let Some(diameter) = tool.diameter {
            values.insert(Register::ToolDiameter(number), diameter.0);
        }
        if let Some(radius) = tool.radius {
            values.insert(Register::ToolRadius(number), radius.0);
        }
        if let Some(direction) = tool.tip_direction {
            values.insert(Register::ToolTipDirection(number), f64::from(direction));
        }
    }
    for (name, offset) in &machine.work_offsets {
        for axis in axes() {
            let name = name.clone();
            values.insert(Register::WorkOffset { name, axis }, offset[axis.index()]);
        }
    }
    values
}

impl DataDirectory {
    /// Writes what a machine file begins with into the registers that were never set, so that every later change has a before. Calling
    /// it again changes nothing.
    ///
    /// # Errors
    /// The disk refuses; nothing was changed then.
    pub fn take_over(&mut self, machine: &MachineFile, who: &str, when: Timestamp) -> Result<Vec<Change>, StoreError> {
        let known = self.values(&format!("{}/", machine.name))?;
        let missing = first_day(machine)
            .into_iter()
            .map(|(register, to)| (register.of(machine), to));
        let requests: Vec<ChangeRequest> = missing
            .filter(|(path, _)| !known.contains_key(path))
            .map(|(path, to)| ChangeRequest {
                path,
                to,
                expected: None,
                who: who.to_owned(),
                why: format!("first value from the machine file of {}", machine.name),
                when,
            })
            .collect();
        self.change_values(&requests)
    }

    /// The registers of a machine that were ever set, with the events that set them.
    ///
    /// # Errors
    /// The disk refuses.
    pub fn registers(&self, machine: &MachineFile) -> Result<BTreeMap<Register, (f64, u64)>, StoreError> {
        let prefix = format!("{}/", machine.name);
        let all = || -> rusqlite::Result<Vec<(String, f64, i64)>> {
            let mut statement = self
                .database
                .prepare("SELECT path, value, event FROM registers WHERE substr(path, 1, length(?1)) = ?1")?;
            let rows = statement.query_map([&prefix], |row| Ok((row.get(0)?, row.get(1)?, row.get(2)?)))?;
            rows.collect()
        };
        let rows = all().map_err(self.failed())?;
        let ours = rows
            .into_iter()
            .filter_map(|(path, value, event)| Some((Register::parse(&path[prefix.len()..])?, (value, event.unsigned_abs()))));
        Ok(ours.collect())
    }

    /// What a machine has ready now.
    ///
    /// # Errors
    /// The disk refuses, or a register holds something that cannot be.
    pub fn tables(&self, machine: &MachineFile) -> Result<Tables, StoreError> {
        tables(machine, &self.values(&format!("{}/", machine.name))?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::MachineKind;

    const T5: ToolNumber = ToolNumber(5);

    #[test]
    fn a_path_reads_back_as_its_register() {
        let (tool, axis) = (T5, Axis::X);
        for (register, path) in [
            (Register::ToolGeometry { tool, axis: Axis::Z }, "tool/5/geometry/z_mm"),
            (Register::ToolWear { tool, axis }, "tool/5/wear/x_mm"),
            (Register::ToolDiameter(tool), "tool/5/diameter_mm"),
            (Register::ToolRadiusWear(tool), "tool/5/radius_wear_mm"),
            (Register::ToolRadius(tool), "tool/5/radius_mm"),
            (Register::ToolTipDirection(tool), "tool/5/tip_direction"),
            (
                Register::WorkOffset {
                    name: "G54".into(),
                    axis,
                },
                "offset/G54/x_mm",
            ),
            (
                Register::WorkOffset {
                    name: "G54.1 P3".into(),
                    axis,
                },
                "offset/G54.1 P3/x_mm",
            ),
            (
                Register::WorkOffset {
                    name: "front/left 50%".into(),
                    axis,
                },
                "offset/front%2Fleft 50%25/x_mm",
            ),
            (
                Register::WorkOffset {
                    name: "%2F".into(),
                    axis,
                },
                "offset/%252F/x_mm",
            ),
        ] {
            assert_eq!(register.to_string(), path);
            assert_eq!(Register::parse(path), Some(register));
        }
        for odd in [
            "",
            "tool",
            "tool/x/wear/x_mm",
            "tool/05/wear/x_mm",
            "tool/+5/wear/x_mm",
            "tool/5/wear/x_in",
            "offset/G54/w_mm",
        ] {
            assert_eq!(Register::parse(odd), None, "{odd}");
        }
    }

    #[test]
    fn a_lathes_x_registers_are_diameters_and_its_tables_are_radii() {
        let lathe = MachineFile::simulated(MachineKind::Lathe);
        let wear = Register::ToolWear { tool: T5, axis: Axis::X };
        let values = BTreeMap::from([(wear.of(&lathe), -0.04), ("other/tool/5/wear/x_mm".to_owned(), 9.0)]);
        let tables = tables(&lathe, &values).expect("good values");
        assert_eq!(tables.tools[&T5].wear.0, Vector::new(-0.02, 0.0, 0.0));
        assert_eq!(tables.tools[&T5].geometry.0, Vector::new(40.0, 0.0, 38.0));
        assert_eq!(tables.work_offsets["G54"].origin, [-240.0, 0.0, -400.0]);
        assert_eq!(tables.missing, Missing::Assume);
    }

    #[test]
    fn registers_are_taken_over_once_and_live_values_win() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut directory = DataDirectory::open(folder.path(), "test").expect("free");
        let mill = MachineFile::simulated(MachineKind::Mill);
        let first = directory.take_over(&mill, "system", Timestamp(1)).expect("taken over");
        assert!(first.len() > 10);
        assert_eq!(directory.take_over(&mill, "system", Timestamp(2)).expect("nothing left"), []);
        let length = Register::ToolGeometry { tool: T5, axis: Axis::Z };
        let request = ChangeRequest {
            path: length.of(&mill),
            to: 101.5,
            expected: Some(100.0),
            who: "Maria".into(),
            why: "measured anew".into(),
            when: Timestamp(3),
        };
        directory.change_value(&request).expect("allowed");
        assert_eq!(
            directory.tables(&mill).expect("reads").tools[&T5].geometry.0,
            Vector::new(0.0, 0.0, 101.5)
        );
        assert_eq!(directory.verify().expect("verifies"), []);
    }

    #[test]
    fn a_diameter_of_nothing_is_named() {
        let mill = MachineFile::simulated(MachineKind::Mill);
        let values = BTreeMap::from([(Register::ToolDiameter(T5).of(&mill), 0.0)]);
        let refused = tables(&mill, &values).expect_err("no tool cuts 0");
        assert_eq!(
            refused.to_string(),
            "register sim-mill/tool/5/diameter_mm = 0: a cutting diameter must be above 0"
        );
    }
}
