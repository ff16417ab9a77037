//! G74 and G75: pecks along Z (face) or along X (groove), column by column, in their two-block and one-block forms.
//!
//! `G74 R e` then `G74 X Z P i Q k R d`: pecks of k along Z, back by e after each, and at the bottom d away before the way out; then i
//! along X to the next column. G75 is the same with X and Z changing places: P is still a length along X, Q along Z.

use crate::block::Block;
use crate::cycles::{Expansion, illegal};
use crate::fault::{Outcome, Site};
use crate::interpreter::{Interpreter, MOST_ITEMS, missing_word};
use plan::Speed;

/// The columns of one block.
struct Columns {
    /// Axis of the pecks, and axis from column to column.
    deep: usize,
    across: usize,
    bottom: f64,
    /// Where the last column is, and how far apart they are; 0 when there is one only.
    last: f64,
    step: f64,
    peck: f64,
    back: f64,
    relief: f64,
    home: [f64; 3],
    column: f64,
    feed: Speed,
    over: bool,
}

impl Interpreter {
    /// G74 (`deep` is Z, 2) and G75 (`deep` is X, 0).
    pub(crate) fn peck_cycle(&mut self, deep: usize, at: usize, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        let name = if deep == 2 { "G74" } else { "G75" };
        if !block.has_any(b"XUZWPQIKD") {
            let Some(r) = block.take(b'R') else {
                return Err(missing_word(at, name, "R, or X, Z, P and Q"));
            };
            let back = self.length(b'R', r, site);
            if back < 0.0 {
                return Err(illegal(r.at, format!("the return of {name} is negative"), "correct R"));
            }
            self.turning_cycles.peck_return = back;
            return Ok(());
        }
        let across = 2 - deep;
        let home = self.tip;
        let to = self.target(block, site)?.unwrap_or(home);
        let one_block = block.has_any(b"IKD");
        let letters: [u8; 2] = if one_block { [b'I', b'K'] } else { [b'P', b'Q'] };
        let mut lengths = [None; 2];
        for (length, letter) in lengths.iter_mut().zip(letters) {
            if let Some(w) = block.take(letter) {
                let value = if one_block {
                    self.length(letter, w, site)
                } else {
                    self.increments(w)
                };
                if value < 0.0 {
                    return Err(illegal(
                        w.at,
                        format!("{} of {name} is negative", char::from(letter)),
                        "write it without sign",
                    ));
                }
                *length = Some(value);
            }
        }
        let relief_letter = if one_block { b'D' } else { b'R' };
        let relief = match block.take(relief_letter) {
            Some(w) => self.length(relief_letter, w, site),
            None => 0.0,
        };
        let of = |axis: usize| lengths[usize::from(axis == 2)].unwrap_or(0.0);
        let (peck, step) = (of(deep), of(across));
        let depth = (home[deep] - to[deep]).abs();
        if depth > 0.0 && peck <= 0.0 {
            let letter = char::from(letters[usize::from(deep == 2)]);
            return Err(illegal(
                at,
                format!("{name} without {letter}, the depth of a peck, or with {letter}0"),
                "write the depth of a peck; without a point it counts least increments",
            ));
        }
        let width = (home[across] - to[across]).abs();
        if width > 0.0 && step <= 0.0 {
            let letter = char::from(letters[usize::from(across == 2)]);
            return Err(illegal(
                at,
                format!("{name} goes across and has no {letter}, the way from column to column"),
                "write it, or leave the other axis out",
            ));
        }
        let most = MOST_ITEMS as f64;
        if depth / peck.max(1e-12) * 2.0 > most || width / step.max(1e-12) > 1e6 || home[deep] + peck == home[deep] && depth > 0.0
        {
            return Err(illegal(
                at,
                format!("the pecks of {name} are too small for its depth and width"),
                "check P and Q",
            ));
        }
        let feed = self.cutting(at)?;
        self.note_no_compensation(name, at, site);
        self.prepare_move(at, site)?;
        let back = self.turning_cycles.peck_return;
        self.begin_expansion(Columns {
            deep,
            across,
            bottom: to[deep],
            last: to[across],
            step,
            peck,
            back,
            // Away from where the next column is; in a single column the sign says where to.
            relief: if width > 0.0 {
                -relief.abs() * (to[across] - home[across]).signum()
            } else {
                relief
            },
            home,
            column: home[across],
            feed,
            over: false,
        });
        Ok(())
    }
}

impl Expansion for Columns {
    fn next(&mut self, i: &mut Interpreter) -> bool {
        if self.over {
            i.go([(self.across, self.home[self.across]); 2], Speed::Rapid);
            return false;
        }
        i.go([(self.across, self.column); 2], Speed::Rapid);
        self.pecks(i);
        // The first column has stock on both sides: no way to go, unless it is the only one and the sign says where.
        let first = self.column == self.home[self.across] && self.column != self.last;
        if self.relief != 0.0 && !first {
            i.go([(self.across, self.column + self.relief); 2], self.feed);
        }
        i.go([(self.deep, self.home[self.deep]); 2], Speed::Rapid);
        if self.column == self.last {
            self.over = true;
        } else {
            let way = (self.last - self.column).signum();
            let next = self.column + way * self.step;
            self.column = if (self.last - next) * way <= 0.0 { self.last } else { next };
        }
        true
    }
}

impl Columns {
    fn pecks(&self, i: &mut Interpreter) {
        let way = (self.bottom - self.home[self.deep]).signum();
        let mut reached = self.home[self.deep];
        while reached != self.bottom {
            let next = reached + way * self.peck;
            reached = if (self.bottom - next) * way <= 0.0 {
                self.bottom
            } else {
                next
            };
            i.go([(self.deep, reached); 2], self.feed);
            if reached != self.bottom && self.back > 0.0 {
                i.go([(self.deep, reached - way * self.back); 2], Speed::Rapid);
            }
        }
    }
}
