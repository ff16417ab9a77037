//! Reading a contour for G70 to G73: the blocks from N(P) to N(Q) of the program being executed, wherever they stand in it.

use super::{File, GcodeProgram, Kind};
use crate::cycles::roughing::{Contour, ContourRequest, not_found};
use crate::fault::{Fault, Site};
use plan::Alarm;

impl GcodeProgram {
    /// Reads the contour that a cycle asks for, begins the cycle, and goes on behind what was read.
    pub(super) fn read_contour(&mut self, request: ContourRequest, cycle_line: u32) {
        let behind_cycle = self.files[self.current].lines.position();
        let before = self.interpreter.begin_contour();
        let mut contour = Contour::default();
        match self.contour_blocks(&request, &mut contour) {
            Ok(behind_contour) => {
                // A contour that follows its cycle is not executed once more; one that came before is.
                let go_to = match behind_contour.0 > behind_cycle.0 && request.skips() {
                    true => behind_contour,
                    false => behind_cycle,
                };
                self.files[self.current].lines.seek(go_to.0, go_to.1);
                if let Err(fault) = self.interpreter.begin_contour_cycle(&request, contour, before) {
                    let site = Site {
                        text: b"",
                        number: cycle_line,
                    };
                    self.alarm = Some(fault.into_alarm(&self.files[self.current].name, site));
                }
            }
            Err(alarm) => {
                self.interpreter.restore(before);
                self.alarm = Some(alarm);
            }
        }
    }

    /// Executes the blocks into `contour`; gives where the line behind the last one begins.
    fn contour_blocks(&mut self, request: &ContourRequest, contour: &mut Contour) -> Result<(u64, u32), Alarm> {
        let name = self.files[self.current].name.clone();
        let cycle_line = self.files[self.current].lines.position().1;
        let at_cycle = |fault: Box<Fault>| {
            fault.into_alarm(
                &name,
                Site {
                    text: b"",
                    number: cycle_line,
                },
            )
        };
        let Some(first) = self.find_block(request.first) else {
            return Err(at_cycle(not_found(request.at, request.first, request.cycle)));
        };
        self.files[self.current].lines.seek(first.0, first.1);
        loop {
            let file = &mut self.files[self.current];
            let line = match file.lines.next() {
                Ok(Some(line)) => line,
                Ok(None) => return Err(at_cycle(not_found(request.at, request.last, request.cycle))),
                Err(error) => return Err(super::line_error(error).in_file(name).into()),
            };
            let site = Site {
                text: file.lines.bytes(line),
                number: line.number,
            };
            let kind = self.block.read(site.text, self.interpreter.reading(), &self.interpreter);
            let result = match kind {
                Ok(Kind::Blank) => continue,
                Ok(Kind::Words) if self.block.program.is_none() => {
                    let number = self.block.look(b'N').map_or(0.0, |n| n.value);
                    let told = self.interpreter.contour_block(contour, request, &mut self.block, site);
                    if told.is_ok() && number == f64::from(request.last) {
                        return Ok(self.files[self.current].lines.position());
                    }
                    told
                }
                Ok(Kind::TapeMark | Kind::Words) => return Err(at_cycle(not_found(request.at, request.last, request.cycle))),
                Ok(_) => Err(Fault::new(
                    0,
                    66,
                    "contour-block",
                    "a macro statement inside a contour",
                    "compute before the cycle, and use the variables in the contour",
                )),
                Err(fault) => Err(fault),
            };
            if let Err(fault) = result {
                return Err(fault.into_alarm(&name, site));
            }
        }
    }

    /// Where block N`number` of the program being executed begins: first behind the reading place, then from the program's start.
    fn find_block(&mut self, number: u32) -> Option<(u64, u32)> {
        let start = match self.calls.last() {
            Some(call) => call.body,
            None => self.start,
        };
        let file = &mut self.files[self.current];
        let here = file.lines.position();
        search(file, number, here.0, here.1, u64::MAX).or_else(|| search(file, number, start.0, start.1, here.0))
    }
}

impl ContourRequest {
    fn skips(&self) -> bool {
        self.cycle != crate::cycles::roughing::ContourCycle::Finish
    }
}

fn search(file: &mut File, number: u32, offset: u64, lines_before: u32, until: u64) -> Option<(u64, u32)> {
    file.lines.seek(offset, lines_before);
    let mut any = false;
    loop {
        let before = file.lines.position();
        if before.0 >= until {
            return None;
        }
        let line = file.lines.next().ok()??;
        let text = file.lines.bytes(line).trim_ascii();
        match text.first() {
            Some(b'%') if any => return None,
            Some(b'O' | b'o' | b':') if any => return None, // the next program
            None => {}
            _ => any = true,
        }
        if sequence_number(text) == Some(number) {
            return Some(before);
        }
    }
}

/// The sequence number at the head of a line, behind a block skip.
fn sequence_number(text: &[u8]) -> Option<u32> {
    let mut rest = text;
    if let [b'/', behind @ ..] = rest {
        rest = behind;
        if let [b'1'..=b'9', behind @ ..] = rest {
            rest = behind;
        }
        rest = rest.trim_ascii_start();
    }
    let [b'N' | b'n', rest @ ..] = rest else { return None };
    let rest = rest.trim_ascii_start();
    let digits = rest.iter().take_while(|b| b.is_ascii_digit()).count();
    match digits {
        1..=8 => Some(rest[..digits].iter().fold(0, |n, d| n * 10 + u32::from(d - b'0'))),
        _ => None,
    }
}
