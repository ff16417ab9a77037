//! The single cycles of a lathe: G90 turns, G94 faces, G92 cuts a thread. In force, each block with an axis word or R is one cycle; the
//! tool ends where it began.
//!
//! R is the taper: how much farther the cut begins along the axis of infeed than it ends (G90, G92: along X, a radius; G94: along Z).
//! Chamfer of G92: Fanuc parameter 5130, which G76 writes too.

use crate::block::Block;
use crate::cycles::{Expansion, threading::Pass};
use crate::fault::{Outcome, Site};
use crate::interpreter::{Interpreter, missing_word};
use plan::Speed;

/// Which single cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SingleKind {
    /// G90: along Z.
    Turn,
    /// G92: a thread along Z.
    Thread,
    /// G94: along X.
    Face,
}

/// A single cycle in force with the words that hold on.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Single {
    pub kind: SingleKind,
    x: Option<f64>,
    z: Option<f64>,
    taper: f64,
}

impl Single {
    pub(crate) fn new(kind: SingleKind) -> Self {
        Single {
            kind,
            x: None,
            z: None,
            taper: 0.0,
        }
    }

    pub(crate) fn code(&self) -> u16 {
        match self.kind {
            SingleKind::Turn => 90,
            SingleKind::Thread => 92,
            SingleKind::Face => 94,
        }
    }
}

/// Four straight sides, told at once.
struct Sides([([f64; 3], Speed); 4]);

impl Expansion for Sides {
    fn next(&mut self, i: &mut Interpreter) -> bool {
        for (to, speed) in self.0 {
            i.line(to, speed);
        }
        false
    }
}

impl Interpreter {
    /// A block with a single cycle in force.
    pub(crate) fn single_cycle(&mut self, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        let Some(mut single) = self.turning_cycles.single else {
            return Ok(());
        };
        if !block.has_any(b"XUZWR") {
            return Ok(());
        }
        let at = self.axis_at(block);
        let name = format!("G{}", single.code());
        let start = self.tip;
        if let Some(to) = self.target(block, site)? {
            if block.has_any(b"XU") {
                single.x = Some(to[0]);
            }
            if block.has_any(b"ZW") {
                single.z = Some(to[2]);
            }
        }
        if let Some(r) = block.take(b'R') {
            single.taper = self.length(b'R', r, site);
        }
        self.turning_cycles.single = Some(single);
        let (Some(x), Some(z)) = (single.x, single.z) else {
            return Err(missing_word(at, &name, "X and Z"));
        };
        self.note_no_compensation(&name, at, site);
        self.prepare_move(at, site)?;
        let y = start[1];
        match single.kind {
            SingleKind::Turn => {
                let feed = self.cutting(at)?;
                self.begin_expansion(Sides([
                    ([x + single.taper, y, start[2]], Speed::Rapid),
                    ([x, y, z], feed),
                    ([start[0], y, z], feed),
                    (start, Speed::Rapid),
                ]));
            }
            SingleKind::Face => {
                let feed = self.cutting(at)?;
                self.begin_expansion(Sides([
                    ([start[0], y, z + single.taper], Speed::Rapid),
                    ([x, y, z], feed),
                    ([x, y, start[2]], feed),
                    (start, Speed::Rapid),
                ]));
            }
            SingleKind::Thread => {
                let lead = self.lead(at, site)?;
                let angle = self.start_angle(block);
                self.begin_expansion(Pass {
                    begin: [x + single.taper, start[2]],
                    end: [x, z],
                    home: [start[0], start[2]],
                    lead,
                    angle,
                    chamfer: self.turning_cycles.thread.chamfer * lead,
                });
            }
        }
        Ok(())
    }
}
