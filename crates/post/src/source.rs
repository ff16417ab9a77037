//! Programs that are streams and nothing more, as structured programs: G-code and cutter-location files, whose control flow the
//! reader has decided. What the machine would have to decide is refused, unless the person wants the program as it runs without a machine.

use plan::flow::{Part, StructuredProgram};
use plan::tables::Offset;
use plan::{Alarm, Answer, Diagnostic, FileId, Next, Origin, Place, ProgramStream, Question, Step, StepKind, StopKind, Tables};
use std::collections::BTreeMap;
use units::{Point, StepId, ToolNumber, Transform, Vector};

/// A stream as a program without structure.
pub struct Interpreted<S> {
    stream: S,
    /// Where the reader decided something that a program of another control would have to decide again; `None` as long as it did not.
    decided: fn(&S) -> Option<String>,
    as_interpreted: bool,
    reply: Option<Answer>,
    after_stop: bool,
}

impl<S: ProgramStream> Interpreted<S> {
    /// The program of a stream. `decided` tells of branches and loops that were decided while reading; with `as_interpreted` they and
    /// the machine's values are taken as they come without a machine.
    pub fn new(stream: S, decided: fn(&S) -> Option<String>, as_interpreted: bool) -> Self {
        Interpreted {
            stream,
            decided,
            as_interpreted,
            reply: None,
            after_stop: false,
        }
    }

    fn refused(&self, code: &'static str, what: String) -> Box<Alarm> {
        Box::new(Alarm::from(
            Diagnostic::error(code, what).remedy(
                "post it from STEP-NC, whose conditions are kept, or post with --as-interpreted what the program does without a machine",
            ),
        ))
    }
}

impl<S: ProgramStream> StructuredProgram for Interpreted<S> {
    fn next_part(&mut self) -> Result<Option<Part>, Box<Alarm>> {
        loop {
            let next = self.stream.next(self.reply.take());
            if !self.as_interpreted
                && let Some(what) = (self.decided)(&self.stream)
            {
                return Err(self.refused(
                    "control-flow",
                    format!("{what}: a branch of a macro would be decided here and not at the machine"),
                ));
            }
            match next {
                Next::Step(step) => return Ok(Some(Part::Step(step))),
                Next::Ask(Question::OptionalStop) => {
                    // It becomes an optional stop of the other control, whose switch decides.
                    self.reply = Some(Answer::Truth(false));
                    self.after_stop = true;
                    return Ok(Some(Part::Step(Step {
                        id: StepId(0),
                        origin: Origin {
                            file: FileId(0),
                            place: Place::Given,
                        },
                        kind: StepKind::Stop(StopKind::Optional),
                    })));
                }
                Next::Ask(Question::Skip { .. }) => {
                    return Err(Box::new(Alarm::from(
                        Diagnostic::error(
                            "probing",
                            "the program probes (G31), and where it goes next is the probe's word",
                        )
                        .remedy("probe with the control's own cycles"),
                    )));
                }
                Next::Ask(question) => {
                    if !self.as_interpreted {
                        let what = match question {
                            Question::Number(name) => format!("the program asks the machine for {name}"),
                            other => format!("the program asks the machine: {other:?}"),
                        };
                        return Err(self.refused("asks-machine", what));
                    }
                    self.reply = Some(Answer::NotAsked);
                }
                Next::End => return Ok(None),
                Next::Alarm(alarm) => return Err(Box::new(alarm)),
            }
        }
    }

    fn diagnostics(&self) -> &[Diagnostic] {
        self.stream.diagnostics()
    }

    fn file_name(&self, file: FileId) -> &str {
        self.stream.file_name(file)
    }
}

/// The machine with its axes, work offsets and tool lengths elsewhere, differently in each pass and for each tool: a program whose words are
/// absolute does not notice. Radii and wear of radii stay, because cutter compensation is worked out.
pub fn elsewhere(tables: &Tables, pass: usize, turning: bool) -> Tables {
    // No program has words for these places, so no move is left out because the tool is there already.
    let pass = pass as f64;
    let mut moved = tables.clone();
    moved.position = match turning {
        true => Point::new(319.137_913 + 7.31 * pass, 0.0, 617.719_311 + 11.37 * pass),
        false => Point::new(
            -319.137_913 - 7.31 * pass,
            -217.371_917 - 5.93 * pass,
            617.719_311 + 11.37 * pass,
        ),
    };
    let y = if turning { 0.0 } else { -173.917_371 - 3.17 * pass };
    let place = |n: f64| Transform::shift([-211.719_137 - 2.713 * pass - n, y, -431.371_193 - 4.391 * pass - n]);
    let names = (54..=59)
        .map(|n| format!("G{n}"))
        .chain((1..=300).map(|n| format!("G54.1 P{n}")));
    moved
        .work_offsets
        .extend(names.enumerate().map(|(n, name)| (name, place(n as f64))));
    for number in 1..=999 {
        let entry = moved.tools.entry(ToolNumber(number)).or_default();
        // No two are alike: a word that leads another tool to the same height is a move, and stays.
        let own = 0.071_317 * f64::from(number);
        let across = if turning { 31.379_171 + pass + own } else { 0.0 };
        entry.geometry = Offset(Vector::new(across, 0.0, 97.137_931 + 1.19 * pass + own));
        entry.wear = Offset(Vector::ZERO);
    }
    moved
}

/// Variables that the control has kept: other ones in each pass, so that a program that lives on them is noticed.
pub fn other_variables(pass: usize) -> BTreeMap<u32, f64> {
    match pass {
        0 => BTreeMap::new(),
        _ => (100..200).chain(500..1000).map(|n| (n, 0.137 + f64::from(n))).collect(),
    }
}

/// Lengths of the tools of tables, to tell G43 from G44.
pub fn lengths(tables: &Tables) -> BTreeMap<ToolNumber, f64> {
    tables
        .tools
        .iter()
        .map(|(number, entry)| (*number, entry.geometry.0.xyz[2]))
        .collect()
}
