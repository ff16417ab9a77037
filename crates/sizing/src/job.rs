//! The file in which a job declares its sizes.
//!
//! ```toml
//! name = "SHAFT D40"
//! number = 200             # 1 to 7999: number of the set-up program on a control, and how it tells this job from another
//! unit = "inch"            # of every length below: "mm" or "inch"
//! x_reversed = false       # true when X plus is towards the spindle axis
//!
//! [[dimension]]
//! name = "DIM A"
//! kind = "outside diameter"      # or inside diameter, length, depth, outside width, inside width
//! nominal = 3.2342
//! tolerance = 0.001              # plus and minus; or low = and high =; or tolerance = [-0.050, -0.025]
//! tool = 5
//!
//! # What follows may be left out.
//! offset = 5                     # default: the tool's number
//! axis = "X"                     # "X", "Y", "Z", or "radius" for the cutter's radius; default: X for diameters, Z for length and depth
//! target = 3.2337                # default: a quarter of the band from the limit that wear leads away from
//! window = [3.22, 3.245]         # what an entry may be, without its ends; default: the limits and one band more on each side
//! largest_step = 0.002           # of the offset, without a person of level 3; default: what the whole band takes
//! increment = 0.0001             # finest step of the offset; default 0.001 mm, 0.0001 in
//! role = "controls"              # or "watch", or "mean" with the others of the same offset and axis
//! factor = 1.0                   # by how much the size grows when the offset grows by 1; default: by kind and axis
//! wear = "grows"                 # or "shrinks": what wear does to the size; default: by kind
//! every = 5                      # every how many parts it is measured
//! ```
//!
//! A key that nobody knows is an error with line and column, because a misspelt limit is a limit that is not there.

use crate::{Column, Dimension, Kind, Role, Unit, one_controls_each_register};
use plan::Diagnostic;
use serde::Deserialize;
use toml::Spanned;
use units::{Axis, ToolNumber};

/// The sizes of a job, ready for entries.
#[derive(Clone, Debug, PartialEq)]
pub struct Job {
    /// What people call it.
    pub name: String,
    /// Number of its set-up program on a control, by which the control knows it.
    pub number: u32,
    /// The unit of the job, which is the control's.
    pub unit: Unit,
    /// Its sizes, in the order of the file.
    pub dimensions: Vec<Dimension>,
}

/// What a job has to know of its machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MachineAxes {
    /// Its name: the beginning of its registers' paths.
    pub name: String,
    /// Whether the registers of X, Y and Z count diameters.
    pub counts_diameters: [bool; 3],
}

impl Job {
    /// Reads the text of a job file; `file` is its name in messages.
    ///
    /// # Errors
    /// With line and column: the text is no TOML, a key is unknown or missing, a value cannot be, a dimension makes no sense, or two of
    /// them would move one register.
    pub fn parse(text: &str, file: &str, machine: &MachineAxes) -> Result<Job, Box<Diagnostic>> {
        let refuse = |at: Option<usize>, message: &str| {
            let found = Diagnostic::error("sizing-job", message.trim().replace('\n', ", ")).in_file(file);
            Box::new(match at.map(|at| place(text, at)) {
                Some((line, column)) => found.at_line(line, column),
                None => found,
            })
        };
        let read: Text = toml::from_str(text).map_err(|e| refuse(e.span().map(|s| s.start), e.message()))?;
        read.checked(machine).map_err(|(at, message)| refuse(Some(at), &message))
    }

    /// A dimension by its name; blanks around it and capitals do not matter.
    pub fn dimension(&self, name: &str) -> Option<&Dimension> {
        let wanted = name.trim();
        self.dimensions.iter().find(|d| d.name.eq_ignore_ascii_case(wanted))
    }
}

/// Line and column, from 1, in characters.
fn place(text: &str, at: usize) -> (u32, u32) {
    let before = text.get(..at).unwrap_or(text);
    let line = before.matches('\n').count() + 1;
    let column = before.rsplit('\n').next().unwrap_or_default().chars().count() + 1;
    (line as u32, column as u32)
}

// -- the text, as serde reads it

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Text {
    name: String,
    number: Spanned<u32>,
    unit: UnitWord,
    #[serde(default)]
    x_reversed: bool,
    #[serde(default)]
    dimension: Vec<Spanned<DimensionText>>,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
enum UnitWord {
    Mm,
    Inch,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum ToleranceText {
    Same(f64),
    Two([f64; 2]),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DimensionText {
    name: Spanned<String>,
    kind: Spanned<String>,
    nominal: f64,
    tolerance: Option<Spanned<ToleranceText>>,
    low: Option<f64>,
    high: Option<f64>,
    tool: Spanned<u32>,
    offset: Option<Spanned<u32>>,
    axis: Option<Spanned<String>>,
    target: Option<f64>,
    window: Option<[f64; 2]>,
    largest_step: Option<f64>,
    increment: Option<f64>,
    role: Option<Spanned<String>>,
    factor: Option<f64>,
    wear: Option<Spanned<String>>,
    every: Option<Spanned<u32>>,
}

/// A refusal and where in the text.
type Refusal = (usize, String);

impl Text {
    fn checked(self, machine: &MachineAxes) -> Result<Job, Refusal> {
        let number = *self.number.get_ref();
        // O8000 and on is where controls keep macros that are locked against editing.
        if !(1..=7999).contains(&number) {
            return Err((
                self.number.span().start,
                format!("number {number} cannot be the number of a set-up program: 1 to 7999"),
            ));
        }
        let unit = match self.unit {
            UnitWord::Mm => Unit::Mm,
            UnitWord::Inch => Unit::Inch,
        };
        if self.dimension.is_empty() {
            return Err((0, "the job has no [[dimension]]: declare what is measured".to_owned()));
        }
        let mut dimensions: Vec<Dimension> = Vec::new();
        for text in self.dimension {
            let (at, name_at) = (text.span().start, text.get_ref().name.span().start);
            let dimension = text.into_inner().checked(unit, self.x_reversed, machine)?;
            if let Err(error) = dimension.check() {
                return Err((at, error.to_string()));
            }
            if dimensions.iter().any(|d| d.name.eq_ignore_ascii_case(&dimension.name)) {
                return Err((
                    name_at,
                    format!("dimension {:?} is there twice: every name once", dimension.name),
                ));
            }
            dimensions.push(dimension);
            // A mean is complete only when the last of the file was read.
            if let Err(conflict @ crate::Conflict::Two { .. }) = one_controls_each_register(&dimensions) {
                return Err((at, conflict.to_string()));
            }
        }
        one_controls_each_register(&dimensions).map_err(|conflict| (0, conflict.to_string()))?;
        Ok(Job {
            name: self.name,
            number,
            unit,
            dimensions,
        })
    }
}

impl DimensionText {
    fn checked(self, unit: Unit, x_reversed: bool, machine: &MachineAxes) -> Result<Dimension, Refusal> {
        let name = self.name.get_ref().trim().to_owned();
        let kind = word_of(&self.kind, &Kind::ALL, "kind")?;
        let role = self
            .role
            .as_ref()
            .map_or(Ok(Role::Controls), |r| word_of(r, &Role::ALL, "role"))?;
        let column = match &self.axis {
            Some(axis) => word_of(axis, &COLUMNS, "axis")?,
            None => match kind {
                Kind::OutsideDiameter | Kind::InsideDiameter => Column::Wear(Axis::X),
                Kind::Length | Kind::Depth => Column::Wear(Axis::Z),
                Kind::OutsideWidth | Kind::InsideWidth => Column::CutterRadius,
            },
        };
        let counts_diameters = matches!(column, Column::Wear(axis) if machine.counts_diameters[axis.index()]);
        let by_kind = kind.response(column, counts_diameters).map(|r| {
            let reversed = x_reversed && column == Column::Wear(Axis::X);
            if reversed { opposite(r) } else { r }
        });
        let response = match self.factor {
            Some(factor) => crate::Response::Times(factor),
            None => by_kind.ok_or_else(|| {
                let message = format!(
                    "dimension {name:?}: {} by {column} needs factor =, the change of the size for a change of the offset",
                    kind.words()
                );
                (self.kind.span().start, message)
            })?,
        };
        let (low, high) = self.limits(&name)?;
        let band = high - low;
        let increment = self.increment.unwrap_or(match unit {
            Unit::Mm => 0.001,
            Unit::Inch => 0.0001,
        });
        let grows_with_wear = match &self.wear {
            Some(word) => word_of(word, &[("grows", true), ("shrinks", false)], "wear")?,
            None => kind.grows_with_wear(),
        };
        let target = self.target.unwrap_or_else(|| target(low, high, increment, grows_with_wear));
        let window = self.window.unwrap_or([decimal(low - band), decimal(high + band)]);
        let largest_step = self
            .largest_step
            .unwrap_or_else(|| decimal(band / response.size_per_register().abs()));
        let not_zero = |number: &Spanned<u32>, what: &str| match *number.get_ref() {
            0 => Err((number.span().start, format!("{what} 0 is none: number it from 1"))),
            n => Ok(n),
        };
        let tool = not_zero(&self.tool, "tool")?;
        let offset = self.offset.as_ref().map_or(Ok(tool), |o| not_zero(o, "offset"))?;
        let every = self.every.as_ref().map_or(Ok(1), |e| not_zero(e, "every"))?;
        let length = |number| unit.length(number);
        Ok(Dimension {
            name,
            kind,
            unit,
            nominal: length(self.nominal),
            low: length(low),
            high: length(high),
            target: length(target),
            tool: ToolNumber(tool),
            offset,
            column,
            register: column.path(&machine.name, offset),
            response,
            window: (length(window[0]), length(window[1])),
            largest_step: length(largest_step),
            increment: length(increment),
            role,
            grows_with_wear,
            every,
        })
    }

    /// Smallest and largest good size.
    fn limits(&self, name: &str) -> Result<(f64, f64), Refusal> {
        match (&self.tolerance, self.low, self.high) {
            (None, Some(low), Some(high)) => Ok((low, high)),
            (Some(tolerance), None, None) => Ok(match tolerance.get_ref() {
                ToleranceText::Same(t) => (decimal(self.nominal - t), decimal(self.nominal + t)),
                ToleranceText::Two([low, high]) => (decimal(self.nominal + low), decimal(self.nominal + high)),
            }),
            (tolerance, ..) => Err((
                tolerance.as_ref().map_or(self.name.span().start, |t| t.span().start),
                format!("dimension {name:?} needs its limits: either tolerance = or both low = and high ="),
            )),
        }
    }
}

const COLUMNS: [(&str, Column); 4] = [
    ("X", Column::Wear(Axis::X)),
    ("Y", Column::Wear(Axis::Y)),
    ("Z", Column::Wear(Axis::Z)),
    ("radius", Column::CutterRadius),
];

fn word_of<T: Copy>(word: &Spanned<String>, known: &[(&str, T)], key: &str) -> Result<T, Refusal> {
    let found = known
        .iter()
        .find(|(text, _)| text.eq_ignore_ascii_case(word.get_ref().trim()));
    found.map(|(_, meaning)| *meaning).ok_or_else(|| {
        let words: Vec<&str> = known.iter().map(|(text, _)| *text).collect();
        let message = format!("{key} {:?} is unknown: it is one of {}", word.get_ref(), words.join(", "));
        (word.span().start, message)
    })
}

fn opposite(response: crate::Response) -> crate::Response {
    use crate::Response::{Opposite, OppositeTwice, Same, Times, Twice};
    match response {
        Same => Opposite,
        Opposite => Same,
        Twice => OppositeTwice,
        OppositeTwice => Twice,
        Times(factor) => Times(-factor),
    }
}

/// A quarter of the band from the limit that wear leads away from: the size then wanders through the band and not only through half of
/// it, and a quarter is left for the scatter of process and gauge.
fn target(low: f64, high: f64, increment: f64, grows_with_wear: bool) -> f64 {
    let quarter = (high - low) / 4.0;
    let exact = if grows_with_wear { low + quarter } else { high - quarter };
    let on_a_step = decimal(libm::round(exact / increment) * increment);
    // A band of a few steps has no room for rounding.
    if quarter > 2.0 * increment {
        on_a_step
    } else {
        decimal(exact)
    }
}

/// Sums of decimals as a person would write them, without the dust of binary fractions.
fn decimal(number: f64) -> f64 {
    let rounded = libm::round(number * 1e8) / 1e8;
    if rounded.is_finite() { rounded } else { number }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::dimension::tests::published;
    use units::Millimetres;

    pub(crate) fn lathe() -> MachineAxes {
        MachineAxes {
            name: "lathe".into(),
            counts_diameters: [true, false, false],
        }
    }

    /// The example of the article, with the window of its call.
    pub(crate) const PUBLISHED: &str = r#"name = "EXAMPLE"
number = 200
unit = "inch"

[[dimension]]
name = "DIM A"
kind = "outside diameter"
nominal = 3.2342
tolerance = 0.001
target = 3.2342
window = [3.22, 3.245]
largest_step = 0.005
tool = 5
"#;

    fn parsed(text: &str) -> Job {
        Job::parse(text, "job.toml", &lathe()).unwrap_or_else(|e| panic!("{e}"))
    }

    #[test]
    fn the_published_example_is_read_from_its_job_file() {
        let job = parsed(PUBLISHED);
        assert_eq!((job.name.as_str(), job.number, job.unit), ("EXAMPLE", 200, Unit::Inch));
        assert_eq!(job.dimensions, [published()]);
    }

    /// A job of one dimension in mm with 0.04 of tolerance about 20.
    fn one(kind: &str, more: &str) -> String {
        format!(
            "name = \"J\"\nnumber = 1\nunit = \"mm\"\n[[dimension]]\nname = \"A\"\nkind = \"{kind}\"\nnominal = 20\ntolerance = 0.02\ntool = 3\n{more}\n"
        )
    }

    #[track_caller]
    fn check_defaults(kind: &str, more: &str, target: f64, factor: f64, register: &str) {
        let dimension = parsed(&one(kind, more)).dimensions.remove(0);
        assert_eq!(dimension.target.0, target, "{kind}");
        assert_eq!(dimension.response.size_per_register(), factor, "{kind}");
        assert_eq!(dimension.register, register, "{kind}");
        assert_eq!(dimension.window, (Millimetres(19.94), Millimetres(20.06)), "{kind}");
        assert_eq!(dimension.largest_step.0, 0.04 / factor.abs(), "{kind}");
    }

    #[test]
    fn what_is_left_out_follows_from_kind_and_limits_and_wear_uses_the_whole_band() {
        check_defaults("outside diameter", "", 19.99, 1.0, "lathe/tool/3/wear/x_mm");
        check_defaults("inside diameter", "", 20.01, 1.0, "lathe/tool/3/wear/x_mm");
        check_defaults("length", "", 19.99, 1.0, "lathe/tool/3/wear/z_mm");
        check_defaults("depth", "offset = 13", 20.01, -1.0, "lathe/tool/13/wear/z_mm");
        check_defaults("outside width", "", 19.99, 2.0, "lathe/tool/3/radius_wear_mm");
        check_defaults("inside width", "", 20.01, -2.0, "lathe/tool/3/radius_wear_mm");
        check_defaults("inside width", "wear = \"grows\"", 19.99, -2.0, "lathe/tool/3/radius_wear_mm");
    }

    #[test]
    fn a_reversed_x_turns_the_sign_of_x_only_and_a_register_of_radii_takes_half() {
        let reversed = |kind| parsed(&one(kind, "").replace("[[dim", "x_reversed = true\n[[dim"));
        assert_eq!(reversed("outside diameter").dimensions[0].response.size_per_register(), -1.0);
        assert_eq!(reversed("length").dimensions[0].response.size_per_register(), 1.0);
        let radii = MachineAxes {
            counts_diameters: [false; 3],
            ..lathe()
        };
        let job = Job::parse(&one("inside diameter", ""), "j", &radii).expect("good");
        assert_eq!(job.dimensions[0].response.size_per_register(), 2.0);
    }

    #[track_caller]
    fn check_refused(text: &str, expected: &str) {
        let refused = Job::parse(text, "job.toml", &lathe()).expect_err(expected).to_string();
        assert!(refused.contains(expected), "{refused}");
    }

    #[test]
    fn a_job_that_makes_no_sense_is_refused_at_its_place() {
        check_refused(
            &one("diameter", ""),
            "error: job.toml:6:8: kind \"diameter\" is unknown: it is one of outside diameter, ",
        );
        check_refused(&one("length", "tolerence = 1"), "job.toml:10:1: unknown field `tolerence`");
        check_refused(&one("length", "low = 1"), "needs its limits");
        check_refused(&one("length", "target = 21"), "its target 21.000 mm must lie in its limits");
        check_refused(&one("length", "window = [19.99, 20]"), "inside its entry window");
        check_refused(&one("length", "offset = 0"), "job.toml:10:10: offset 0 is none");
        check_refused(&one("length", "factor = 0"), "must be a number and not 0");
        check_refused(&one("length", "largest_step = nan"), "every size must be a finite number");
        check_refused(&one("length", "tool = 4"), "duplicate key");
        check_refused(&one("inside width", "axis = \"Z\""), "needs factor =");
        check_refused(&PUBLISHED.replace("200", "9000"), "job.toml:2:10: number 9000");
        check_refused("name = \"x\"\nnumber = 1\nunit = \"mm\"", "has no [[dimension]]");
        check_refused("name = ", "job.toml:1:");
    }

    #[test]
    fn two_dimensions_that_move_one_register_are_refused_at_the_second() {
        let second = "[[dimension]]\nname = \"B\"\nkind = \"outside diameter\"\nnominal = 30\ntolerance = 0.02\ntool = 3\n";
        let both = |role: &str| one("outside diameter", role) + second + role;
        check_refused(
            &both(""),
            "job.toml:11:1: dimensions \"A\" and \"B\" both move lathe/tool/3/wear/x_mm",
        );
        assert_eq!(parsed(&both("role = \"mean\"\n")).dimensions.len(), 2);
        assert_eq!(parsed(&both("role = \"watch\"\n")).dimensions.len(), 2);
        check_refused(
            &one("length", "role = \"mean\""),
            "moves its register by a mean, but no other",
        );
        check_refused(
            &(one("length", "") + &second.replace('B', "a").replace("tool = 3", "tool = 4")),
            "is there twice",
        );
    }
}
