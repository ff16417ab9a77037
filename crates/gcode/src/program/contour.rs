//! Reading a contour for G70 to G73: the blocks from N(P) to N(Q) of the program being executed, wherever they stand in it.

use super::{GcodeProgram, Kind, Line};
use crate::awaited::no_answer_in_contour;
use crate::cycles::roughing::{Contour, ContourCycle, ContourRequest, not_found};
use crate::fault::{Fault, Outcome, Site};
use crate::listing::Place;
use plan::{Alarm, Question};

impl GcodeProgram {
    /// Reads the contour that a cycle asks for, begins the cycle, and goes on behind what was read.
    pub(crate) fn read_contour(&mut self, request: ContourRequest) -> Outcome<()> {
        let behind_cycle = self.here.after;
        let before = self.interpreter.begin_contour();
        let (traced, carried) = (self.interpreter.trace.path.len(), self.interpreter.carried);
        let mut contour = Contour::default();
        let read = self.contour_blocks(&request, &mut contour);
        self.interpreter.trace.path.truncate(traced);
        self.interpreter.carried = carried;
        match read {
            Ok(behind_contour) => {
                // A contour that follows its cycle is not executed once more; one that came before is.
                let go_to = match behind_contour > behind_cycle && request.cycle != ContourCycle::Finish {
                    true => behind_contour,
                    false => behind_cycle,
                };
                self.go_to(go_to);
                self.interpreter.begin_contour_cycle(&request, contour, before)
            }
            Err(alarm) => {
                self.interpreter.restore(before);
                self.alarm = Some(*alarm);
                Ok(())
            }
        }
    }

    /// Executes the blocks into `contour`; gives where the line behind the last one begins.
    fn contour_blocks(&mut self, request: &ContourRequest, contour: &mut Contour) -> Result<Place, Box<Alarm>> {
        let name = self.files[self.current].name.clone();
        let cycle_line = self.here.number;
        let at_cycle = |fault: Box<Fault>| {
            Box::new(fault.into_alarm(
                &name,
                Site {
                    text: b"",
                    number: cycle_line,
                },
            ))
        };
        let first = self
            .targets
            .block(&mut self.files, self.current, self.body, self.here.after, request.first);
        let Some(first) = first else {
            return Err(at_cycle(not_found(request.at, request.first, request.cycle)));
        };
        self.files[self.current].lines.seek(first.offset, first.lines);
        let mut line = Line::default();
        loop {
            let file = &mut self.files[self.current];
            let raw = match file.lines.next() {
                Ok(Some(raw)) => raw,
                Ok(None) => return Err(at_cycle(not_found(request.at, request.last, request.cycle))),
                Err(error) => return Err(Box::new(super::line_error(error).in_file(name).into())),
            };
            let site = Site {
                text: file.lines.bytes(raw),
                number: raw.number,
            };
            let read = line.read(site.text, &self.reading).and_then(|()| {
                let interpreter = &self.interpreter;
                interpreter.unknown_to_contour(&line)?;
                self.block.fill(&line, &interpreter.macros, interpreter, &mut self.stack)
            });
            let read = read.map_err(|fault| match &fault.ask {
                Some(Question::Number(name)) => no_answer_in_contour(name),
                _ => fault,
            });
            let result = match line.kind {
                _ if read.is_err() => read,
                _ if line.function.is_some() => Err(Fault::new(
                    line.function.unwrap_or_default(),
                    0,
                    "T-12",
                    "a function stands inside the contour of a cycle",
                    "move it before the cycle, or behind the contour",
                )),
                Kind::Blank => continue,
                Kind::Words if line.program.is_none() => {
                    let told = self.interpreter.contour_block(contour, request, &mut self.block, site);
                    if told.is_ok() && line.sequence == Some(request.last) {
                        let (offset, lines) = self.files[self.current].lines.position();
                        return Ok(Place { offset, lines });
                    }
                    told
                }
                Kind::TapeMark | Kind::Words => return Err(at_cycle(not_found(request.at, request.last, request.cycle))),
                Kind::Statement => Err(Fault::new(
                    0,
                    66,
                    "contour-block",
                    "a macro statement inside a contour",
                    "compute before the cycle, and use the variables in the contour",
                )),
            };
            if let Err(fault) = result {
                return Err(Box::new(fault.into_alarm(&name, site)));
            }
        }
    }
}
