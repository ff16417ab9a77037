//! `,C` and `,R`, on a lathe also C and R of a G1 block: a chamfer or a rounding put in between two straight moves.
//!
//! The move that says it is held until the next one is known. C is measured from the corner along both moves; R is a radius. Alarms are
//! the 16i's: 051 when no straight move in the plane follows at once, 052 when an arc does, 055 when a move is too short for it.
//! Comes before compensation: the corner is part of the contour.

use crate::block::{Block, Word};
use crate::fault::{Fault, Outcome, Site};
use crate::interpreter::Interpreter;
use plan::{Arc, Origin, Path, Speed};
use units::{Point, Radians, Setup, Vector};

/// What is put in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Chamfer,
    Rounding,
}

/// A corner's word.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CornerWord {
    kind: Kind,
    length: f64,
}

/// The straight move before a corner.
#[derive(Clone, Debug)]
struct Before {
    from: Point<Setup>,
    to: Point<Setup>,
    speed: Speed,
    origin: Origin,
    word: CornerWord,
}

/// A corner being made.
#[derive(Clone, Debug, Default)]
pub(crate) struct Corner {
    /// Asked for by the move that comes next.
    pub asked: Option<CornerWord>,
    held: Option<Before>,
}

impl Corner {
    pub(crate) fn holds(&self) -> bool {
        self.held.is_some()
    }
}

impl Interpreter {
    /// The corner's word of a G1 block.
    pub(crate) fn take_corner(&mut self, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        let mut said: Option<(u8, Word)> = block.corner.take();
        if self.profile.turning {
            for letter in [b'C', b'R'] {
                if let Some(word) = block.take(letter) {
                    said = said.or(Some((letter, word)));
                }
            }
        }
        let Some((letter, word)) = said else { return Ok(()) };
        let kind = match letter {
            b'C' => Kind::Chamfer,
            _ => Kind::Rounding,
        };
        let grown = self.shaping.radius_factor(self.plane).unwrap_or(1.0);
        let length = self.length(letter, word, site).abs() * grown;
        if length > 0.0 {
            self.corner.asked = Some(CornerWord { kind, length });
        }
        Ok(())
    }

    /// A move of the programmed contour on its way to compensation.
    pub(crate) fn round(&mut self, path: Path<Setup>, speed: Speed) -> Outcome<()> {
        let asked = self.corner.asked.take();
        if !self.corner.holds() {
            self.tell_writes();
        }
        let Some(before) = self.corner.held.take() else {
            return match (asked, &path) {
                (Some(word), Path::Line { from, to }) => {
                    self.hold(*from, *to, speed, word);
                    Ok(())
                }
                _ => self.take_move(path, speed),
            };
        };
        let Path::Line { to, .. } = path else {
            return Err(alarm(
                52,
                "an arc follows a corner",
                "put corners between straight moves only",
            ));
        };
        let made = make(self.plane.axes(), &before, to)?;
        let here = std::mem::replace(&mut self.origin, before.origin);
        let first = match made.begin == before.from {
            true => Ok(()),
            false => self.take_move(
                Path::Line {
                    from: before.from,
                    to: made.begin,
                },
                before.speed,
            ),
        };
        self.tell_writes();
        let first = match (first, made.between) {
            (Ok(()), Some(between)) => self.take_move(between, before.speed),
            (other, _) => other,
        };
        self.origin = here;
        first?;
        match asked {
            Some(word) => {
                self.hold(made.end, to, speed, word);
                Ok(())
            }
            None if made.end == to => Ok(()),
            None => self.take_move(Path::Line { from: made.end, to }, speed),
        }
    }

    fn hold(&mut self, from: Point<Setup>, to: Point<Setup>, speed: Speed, word: CornerWord) {
        self.corner.held = Some(Before {
            from,
            to,
            speed,
            origin: self.origin,
            word,
        });
    }

    /// Something other than a move follows a corner: alarm 051 at the end of the block; the move itself is made.
    pub(crate) fn end_corner(&mut self) {
        let Some(before) = self.corner.held.take() else { return };
        let here = std::mem::replace(&mut self.origin, before.origin);
        let path = Path::Line {
            from: before.from,
            to: before.to,
        };
        let made = self.take_move(path, before.speed);
        self.origin = here;
        self.tell_writes();
        let fault = made.err().unwrap_or_else(|| {
            alarm(
                51,
                "no straight move follows a corner at once",
                "let the next block be the G1 that the corner leads to",
            )
        });
        self.compensation.fault.get_or_insert(fault);
    }
}

/// Where a corner begins and ends, and what lies between.
struct Made {
    begin: Point<Setup>,
    between: Option<Path<Setup>>,
    end: Point<Setup>,
}

fn make([a, b, c]: [usize; 3], before: &Before, to: Point<Setup>) -> Outcome<Made> {
    let corner = before.to;
    let (first, second) = (corner - before.from, to - corner);
    let (l1, l2) = (first.length(), second.length());
    if first.xyz[c] != 0.0 || second.xyz[c] != 0.0 {
        return Err(alarm(
            51,
            "a corner between moves that leave the plane",
            "put corners between moves in the plane in force (G17, G18, G19)",
        ));
    }
    let (t1, t2) = (first * (1.0 / l1), second * (1.0 / l2));
    let cosine = t1.xyz[a] * t2.xyz[a] + t1.xyz[b] * t2.xyz[b];
    let sine = t1.xyz[a] * t2.xyz[b] - t1.xyz[b] * t2.xyz[a];
    let turn = libm::atan2(sine, cosine);
    if turn.abs() < 1e-9 {
        // Straight on: there is no corner to round.
        return Ok(Made {
            begin: corner,
            between: None,
            end: corner,
        });
    }
    let short = match before.word.kind {
        Kind::Chamfer => before.word.length,
        Kind::Rounding => before.word.length * libm::tan(turn.abs() / 2.0),
    };
    // A move may end right where the corner begins.
    if !(short <= l1 + 1e-9 && short <= l2 + 1e-9) {
        return Err(alarm(
            55,
            &format!(
                "a move of {:.4} mm is too short for a corner that takes {short:.4} mm of it",
                l1.min(l2)
            ),
            "make the corner smaller",
        ));
    }
    let (begin, end) = (corner - t1 * short, corner + t2 * short);
    let between = match before.word.kind {
        Kind::Chamfer => Path::Line { from: begin, to: end },
        Kind::Rounding => {
            let mut inward = [0.0; 3];
            (inward[a], inward[b]) = (-t1.xyz[b] * turn.signum(), t1.xyz[a] * turn.signum());
            let mut normal = [0.0; 3];
            normal[c] = 1.0;
            Path::Arc(Arc {
                from: begin,
                centre: begin + Vector::from_xyz(inward) * before.word.length,
                normal: Vector::from_xyz(normal),
                sweep: Radians(turn),
                rise: 0.0,
            })
        }
    };
    Ok(Made {
        begin,
        between: Some(between),
        end,
    })
}

fn alarm(number: u32, message: &str, remedy: &str) -> Box<Fault> {
    Fault::new(0, number, "corner", message, remedy)
}
