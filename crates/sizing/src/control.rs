//! What a real control has for generated macros: which variables, how many offsets, how long a name may be.
//!
//! Every control stands here as data, or in a file of the person's own with the same keys:
//!
//! ```toml
//! name = "my lathe"
//! dialect = "fanuc-lathe"        # how its programs are read
//! kept = [500, 999]              # common variables that survive power off and are free for sizing
//! job_variable = 140             # one that is lost at reset, free in part programs: a program says there which job it is
//! name_length = 8                # of a variable's name
//! wear_x = 2000                  # system variable of wear X of offset 0; offset 5 is 2005
//! wear_z = 2100
//! wear_radius = 2200             # of the nose; on a mill of D
//! offsets = 64
//! secondary = 20                 # sizes for offset 5 are typed into offset 25 (method g65)
//! prints = true                  # DPRNT has a device to print to
//! mill = false                   # true: T names a tool and not station and offset
//! parameters = { "6000.3" = 1 }   # settings of the control that the proof runs with
//! ```

use crate::{Column, Dimension};
use plan::Diagnostic;
use serde::Deserialize;
use std::collections::BTreeMap;
use units::Axis;

/// A control that macro programs are generated for.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Control {
    /// Its name.
    pub name: String,
    /// How its programs are read: a name of `gcode::PROFILES`.
    pub dialect: String,
    /// First and last of the common variables that survive power off and are free for sizing.
    pub kept: [u32; 2],
    /// A common variable that is lost at reset, in which a part program says which job it is.
    pub job_variable: u32,
    /// Longest name of a variable.
    pub name_length: usize,
    /// System variable of wear X of offset 0; a mill has none.
    pub wear_x: Option<u32>,
    /// System variable of wear Z of offset 0; on a mill of H.
    pub wear_z: Option<u32>,
    /// System variable of wear Y of offset 0, where the lathe has a Y axis.
    pub wear_y: Option<u32>,
    /// System variable of the wear of the radius of offset 0: of the nose, or of a mill's D.
    pub wear_radius: Option<u32>,
    /// How many offsets it has.
    pub offsets: u32,
    /// Sizes are typed into the offset with a number larger by this (method g65).
    pub secondary: u32,
    /// True when DPRNT has a device to print to: without one POPEN is an alarm.
    pub prints: bool,
    /// On a mill T names a tool; on a lathe its last two digits are the offset.
    #[serde(default)]
    pub mill: bool,
    /// Parameters that the proof runs with, by number or number and bit.
    #[serde(default)]
    pub parameters: BTreeMap<String, i64>,
}

impl Control {
    /// The controls that need no file.
    pub fn built_in() -> [Control; 7] {
        let lathe = |name: &str, kept| Control {
            name: name.to_owned(),
            dialect: "fanuc-lathe".to_owned(),
            kept,
            job_variable: 140,
            name_length: 8,
            wear_x: Some(2000),
            wear_z: Some(2100),
            wear_y: Some(2400),
            wear_radius: Some(2200),
            offsets: 64,
            secondary: 20,
            prints: true,
            mill: false,
            parameters: BTreeMap::new(),
        };
        let mill = |name: &str, wear_z, wear_radius| Control {
            dialect: "fanuc-mill".to_owned(),
            wear_x: None,
            wear_y: None,
            wear_z: Some(wear_z),
            wear_radius: Some(wear_radius),
            offsets: 200,
            secondary: 50,
            mill: true,
            ..lathe(name, [500, 999])
        };
        [
            // 16i, 18i, 21i and 0i with the option of more common variables.
            lathe("fanuc-lathe", [500, 999]),
            // The same without it.
            lathe("fanuc-lathe-base", [500, 531]),
            // More than 64 offsets; two digits of a T word reach 99 of them.
            Control {
                dialect: "fanuc-30i-lathe".to_owned(),
                name_length: 31,
                wear_x: Some(10_000),
                wear_z: Some(11_000),
                wear_y: Some(14_000),
                wear_radius: Some(12_000),
                offsets: 999,
                secondary: 100,
                ..lathe("fanuc-30i-lathe", [500, 999])
            },
            // Offset memory C: H and D have wear of their own.
            mill("fanuc-mill", 2000, 12_000),
            // Offset memories A and B: H and D are numbers in one table.
            mill("fanuc-mill-a", 2000, 2000),
            // Parameter 6000.3 (V15): geometry and wear change places.
            Control {
                parameters: BTreeMap::from([("6000.3".to_owned(), 1)]),
                ..mill("fanuc-mill-series-15", 2200, 2600)
            },
            Control {
                dialect: "fanuc-30i-mill".to_owned(),
                name_length: 31,
                offsets: 400,
                ..mill("fanuc-30i-mill", 10_000, 12_000)
            },
        ]
    }

    /// One of the built-in controls by its name.
    pub fn find(name: &str) -> Option<Control> {
        Control::built_in().into_iter().find(|c| c.name == name)
    }

    /// Reads a control's own file; `file` is its name in messages.
    ///
    /// # Errors
    /// With the place: no TOML, an unknown or missing key, a range upside down.
    pub fn parse(text: &str, file: &str) -> Result<Control, Box<Diagnostic>> {
        let refuse =
            |message: &str| Box::new(Diagnostic::error("control-profile", message.trim().replace('\n', ", ")).in_file(file));
        let read: Control = toml::from_str(text).map_err(|e| {
            let before = e.span().and_then(|s| text.get(..s.start)).unwrap_or_default();
            let line = before.matches('\n').count() + 1;
            let column = before.rsplit('\n').next().unwrap_or_default().chars().count() + 1;
            let mut found = refuse(e.message());
            (found.line, found.column) = (line as u32, column as u32);
            found
        })?;
        let (first, last) = (read.kept[0], read.kept[1]);
        if first > last || first < 500 || last > 999 {
            return Err(refuse(&format!(
                "kept = [{first}, {last}] is no range within the common variables 500 to 999"
            )));
        }
        if !(100..=149).contains(&read.job_variable) {
            return Err(refuse(&format!(
                "job_variable = {} must be one that is lost at reset: 100 to 149",
                read.job_variable
            )));
        }
        if read.name_length == 0 || read.offsets == 0 {
            return Err(refuse("name_length and offsets must be above 0"));
        }
        Ok(read)
    }

    /// The system variable of a register of offset 0; `None` when this control has none that a macro may write.
    pub fn base_of(&self, column: Column) -> Option<u32> {
        match column {
            Column::Wear(Axis::X) => self.wear_x,
            Column::Wear(Axis::Z) => self.wear_z,
            Column::Wear(Axis::Y) => self.wear_y,
            Column::CutterRadius => self.wear_radius,
        }
    }

    /// The system variable of a dimension's register.
    pub fn register_of(&self, dimension: &Dimension) -> Option<u32> {
        Some(self.base_of(dimension.column)? + dimension.offset)
    }

    /// What a T word says of a dimension: the tool on a mill, the offset on a lathe.
    pub fn called_by(&self, dimension: &Dimension) -> u32 {
        if self.mill { dimension.tool.0 } else { dimension.offset }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = "name = \"mine\"\ndialect = \"fanuc-lathe\"\nkept = [600, 649]\njob_variable = 120\nname_length = 8\n\
                        wear_x = 2000\nwear_z = 2100\noffsets = 32\nsecondary = 16\nprints = false\n";

    #[test]
    fn a_control_of_ones_own_is_read_and_its_slips_are_named() {
        let mine = Control::parse(FILE, "mine.toml").expect("good");
        assert_eq!((mine.kept, mine.offsets, mine.prints), ([600, 649], 32, false));
        assert_eq!(mine.base_of(Column::Wear(Axis::Y)), None);
        let check = |from: &str, to: &str, expected: &str| {
            let refused = Control::parse(&FILE.replace(from, to), "mine.toml").expect_err(expected);
            assert!(refused.to_string().contains(expected), "{refused}");
        };
        check("[600, 649]", "[649, 600]", "no range within the common variables");
        check("[600, 649]", "[100, 149]", "no range within the common variables");
        check("120", "520", "lost at reset");
        check("prints", "print", "mine.toml:10:1: unknown field `print`");
    }
}
