//! A job file proposed from what a design states: nominal values and limits are there, what only the shop knows is open.
//!
//! What is open stands as `"?"` with a comment behind it; [`crate::Job::parse`] refuses it with line and column, so that nothing is taken
//! for granted because nobody looked. Offset number, axis and the direction of X are always the shop's. What cannot become a size is in
//! the file as a comment with the reason.

use crate::entry::Unit;
use crate::{Kind, generate};
use std::collections::BTreeSet;
use std::fmt::Write;
use units::Millimetres;

/// What a design states of one size.
#[derive(Clone, Debug, PartialEq)]
pub struct Stated {
    /// What to call it; made unique by a number when it is there already.
    pub name: String,
    /// What it is, and what says so; the words of all kinds that it may be when nothing says it.
    pub kind: Result<(Kind, String), Vec<Kind>>,
    /// Its nominal value.
    pub nominal: Millimetres,
    /// Signed deviations of its limits, or why they are open.
    pub deviations: Result<[Millimetres; 2], String>,
    /// Numbers of the tools that make it, each with its workingstep in words.
    pub tools: Vec<(u32, String)>,
    /// Where it comes from, in words.
    pub source: String,
}

/// A whole job.
#[derive(Clone, Debug, PartialEq)]
pub struct Proposal {
    /// The file it comes from.
    pub source: String,
    /// Name of the job.
    pub name: String,
    /// Number of its set-up program, when the person gave one.
    pub number: Option<u32>,
    /// The unit of the job file.
    pub unit: Unit,
    /// Its sizes.
    pub dimensions: Vec<Stated>,
    /// What was left out, and why.
    pub left_out: Vec<String>,
}

/// A proposed job file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Proposed {
    /// The TOML text.
    pub text: String,
    /// What a person has to fill in, each with its place: `name: kind`.
    pub open: Vec<String>,
}

impl Proposal {
    /// Writes it as a job file.
    pub fn written(&self) -> Proposed {
        let mut out = Proposed {
            text: String::new(),
            open: Vec::new(),
        };
        out.line(&format!(
            "# Proposed from {}. \"?\" is open: the file does not say it. Fill it in, look at every line, then: toolmark size job FILE",
            flat(&self.source)
        ));
        out.line(&format!("name = {}", quoted(&self.name)));
        match self.number {
            Some(number) => out.line(&format!("number = {number}")),
            None => out.open("number", "", "1 to 7999: number of the set-up program on the control"),
        }
        out.line(&format!(
            "unit = {}",
            quoted(match self.unit {
                Unit::Mm => "mm",
                Unit::Inch => "inch",
            })
        ));
        out.line("# x_reversed = true    # CHECK: the file does not say which way X counts; take the # away when X plus is towards the spindle axis");
        let mut names = BTreeSet::new();
        for stated in &self.dimensions {
            let wanted = match flat(stated.name.trim()) {
                name if name.is_empty() => "SIZE".to_owned(),
                name => name,
            };
            let mut name = wanted.clone();
            let mut count = 1;
            while !names.insert(name.to_uppercase()) {
                count += 1;
                name = format!("{wanted} {count}");
            }
            self.dimension(&name, stated, &mut out);
        }
        if !self.left_out.is_empty() {
            out.line("\n# Left out:");
            for what in &self.left_out {
                out.line(&format!("# - {}", flat(what)));
            }
        }
        out
    }

    fn dimension(&self, name: &str, stated: &Stated, out: &mut Proposed) {
        let length = |mm: Millimetres| number(generate::in_unit(self.unit, mm));
        out.line(&format!("\n# {}", flat(&stated.source)));
        out.line("[[dimension]]");
        out.line(&format!("name = {}", quoted(name)));
        match &stated.kind {
            Ok((kind, because)) => out.line(&format!("kind = {}    # {}", quoted(kind.words()), flat(because))),
            Err(candidates) => {
                let words: Vec<String> = candidates.iter().map(|kind| quoted(kind.words())).collect();
                out.open("kind", name, &words.join(" or "));
            }
        }
        out.line(&format!("nominal = {}", length(stated.nominal)));
        match &stated.deviations {
            Ok([lower, upper]) => out.line(&format!("tolerance = [{}, {}]", length(*lower), length(*upper))),
            Err(why) => out.open("tolerance", name, &format!("[lower, upper]: {}", flat(why))),
        }
        let numbers: BTreeSet<u32> = stated.tools.iter().map(|(number, _)| *number).collect();
        let made: Vec<String> = stated
            .tools
            .iter()
            .map(|(n, step)| format!("T{n} in {}", flat(step)))
            .collect();
        match numbers.iter().collect::<Vec<_>>().as_slice() {
            [tool] => out.line(&format!("tool = {tool}    # {}", made.join(", "))),
            [] => out.open("tool", name, "the file ties no workingstep to it"),
            _ => out.open("tool", name, &format!("which of {} makes its last cut", made.join(", "))),
        }
        out.open("offset", name, "number of the offset on the control that corrects it");
        out.open(
            "axis",
            name,
            "\"X\", \"Y\", \"Z\", or \"radius\" of a cutter: the register that moves it",
        );
        out.line(
            "# factor = 1.0    # CHECK: sign and size follow from kind and axis; say it where the tool works from the far side",
        );
    }
}

impl Proposed {
    /// True when nothing is open.
    pub fn is_complete(&self) -> bool {
        self.open.is_empty()
    }

    fn line(&mut self, text: &str) {
        let _ = writeln!(self.text, "{text}");
    }

    fn open(&mut self, key: &str, dimension: &str, what: &str) {
        self.line(&format!("{key} = \"?\"    # OPEN: {what}"));
        self.open.push(match dimension {
            "" => key.to_owned(),
            name => format!("{name}: {key}"),
        });
    }
}

/// A decimal as people write it: no dust of a conversion, and a point so that it stays a length.
fn number(value: f64) -> String {
    let rounded = libm::round(value * 1e8) / 1e8;
    // -0 is 0.
    format!("{:?}", if rounded == 0.0 { 0.0 } else { rounded })
}

/// Text for one line of a comment.
fn flat(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}

/// A TOML string.
fn quoted(text: &str) -> String {
    let inside = flat(text).replace('\\', "\\\\").replace('"', "\\\"");
    format!("\"{inside}\"")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Column, Job, MachineAxes};
    use units::{Axis, ToolNumber};

    fn lathe() -> MachineAxes {
        MachineAxes {
            name: "sim-lathe".into(),
            counts_diameters: [true, false, false],
        }
    }

    fn bore() -> Stated {
        Stated {
            name: "bore \"A\"\n".into(),
            kind: Ok((Kind::InsideDiameter, "a ROUND_HOLE".into())),
            nominal: Millimetres(25.4),
            deviations: Ok([Millimetres(-0.0254), Millimetres(0.0)]),
            tools: vec![(3, "'finish bore'".into())],
            source: "#910 of the file\n[[dimension]]".into(),
        }
    }

    fn proposal(unit: Unit, dimensions: Vec<Stated>) -> Proposal {
        Proposal {
            source: "part.stpnc".into(),
            name: "PART".into(),
            number: Some(40),
            unit,
            dimensions,
            left_out: vec!["flatness top (FLATNESS_TOLERANCE): no offset makes it".into()],
        }
    }

    #[test]
    fn what_is_open_is_refused_with_its_place_until_a_person_fills_it_in() {
        let open = Stated {
            kind: Err(vec![Kind::OutsideDiameter, Kind::InsideDiameter]),
            deviations: Err("H7 of ISO 286".into()),
            tools: vec![],
            ..bore()
        };
        let written = Proposal {
            number: None,
            ..proposal(Unit::Mm, vec![open])
        }
        .written();
        let places = [
            "number",
            "bore \"A\": kind",
            "bore \"A\": tolerance",
            "bore \"A\": tool",
            "bore \"A\": offset",
            "bore \"A\": axis",
        ];
        assert_eq!(written.open, places);
        assert!(!written.is_complete());
        let mut text = written.text;
        for (question, answer) in [
            ("number = \"?\"", "number = 40"),
            ("tolerance = \"?\"", "tolerance = [0.0, 0.021]"),
            ("tool = \"?\"", "tool = 3"),
            ("offset = \"?\"", "offset = 7"),
            ("kind = \"?\"", "kind = \"inside diameter\""),
            ("axis = \"?\"", "axis = \"X\""),
        ] {
            let refused = Job::parse(&text, "proposed.toml", &lathe()).expect_err("something is open");
            let line = text.lines().position(|l| l.starts_with(question)).map(|n| n as u32 + 1);
            assert!(refused.line > 0 && line.is_some(), "{refused}");
            text = text.replace(question, answer);
        }
        let job = Job::parse(&text, "proposed.toml", &lathe()).expect("complete");
        let size = &job.dimensions[0];
        assert_eq!((size.name.as_str(), size.offset, size.tool), ("bore \"A\"", 7, ToolNumber(3)));
        assert_eq!(
            (size.column, size.low, size.high),
            (Column::Wear(Axis::X), Millimetres(25.4), Millimetres(25.421))
        );
    }

    #[test]
    fn lengths_are_written_in_the_unit_of_the_job_and_names_are_unique() {
        let written = proposal(Unit::Inch, vec![bore(), bore()]).written();
        assert!(
            written.text.contains("nominal = 1.0\ntolerance = [-0.001, 0.0]"),
            "{}",
            written.text
        );
        assert!(written.text.contains("name = \"bore \\\"A\\\"\""), "{}", written.text);
        assert!(written.text.contains("name = \"bore \\\"A\\\" 2\""), "{}", written.text);
        assert!(written.text.contains("tool = 3    # T3 in 'finish bore'"), "{}", written.text);
        assert!(
            written
                .text
                .ends_with("# Left out:\n# - flatness top (FLATNESS_TOLERANCE): no offset makes it\n")
        );
        assert_eq!(
            written.text.matches("\n[[dimension]]\n").count(),
            2,
            "no text of the file becomes a line of its own"
        );
    }
}
