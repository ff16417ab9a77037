//! Work offsets, tool offsets, and the system variables that show them.
//!
//! The law everywhere: a change of offset moves no axis. The gauge point stays where it is in the machine, and the place of the tip is
//! counted anew: `tip = gauge - tool offset - origin of the frame`.

mod setting;

use crate::block::Block;
use crate::fault::{Fault, Outcome, Site};
use crate::interpreter::{Interpreter, missing_word};
use crate::profile::Side;
use plan::{FrameChange, Missing, Severity, StepKind, ToolOffset};
use std::collections::BTreeMap;
use units::{Machine, Setup, ToolNumber, Transform, Vector};

/// Which work offset.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum WorkKey {
    /// Added to all others.
    External,
    /// G54 to G59 as 1 to 6.
    Standard(u8),
    /// G54.1 P.
    More(u16),
}

impl WorkKey {
    /// Its name in the tables.
    pub(crate) fn name(self) -> String {
        match self {
            WorkKey::External => "EXT".to_owned(),
            WorkKey::Standard(n) => format!("G{}", 53 + u16::from(n)),
            WorkKey::More(p) => format!("G54.1 P{p}"),
        }
    }

    /// The offset and the axis (from 0) that a system variable shows.
    pub(crate) fn of_variable(number: u32) -> Option<(WorkKey, usize)> {
        let (key, index) = match number {
            5201..=5220 => (WorkKey::External, number - 5201),
            5221..=5340 => (WorkKey::Standard(((number - 5221) / 20 + 1) as u8), (number - 5221) % 20),
            7001..=7960 => (WorkKey::More(((number - 7001) / 20 + 1) as u16), (number - 7001) % 20),
            14_001..=20_000 => (WorkKey::More(((number - 14_001) / 20 + 1) as u16), (number - 14_001) % 20),
            _ => return None,
        };
        Some((key, index as usize))
    }
}

/// The frame in force, by its parts; all in the machine frame, mm.
#[derive(Clone, Debug)]
pub(crate) struct WorkFrame {
    pub key: WorkKey,
    /// Of the work offset and the external one.
    pub base: [f64; 3],
    /// G52.
    pub local: [f64; 3],
    /// G92, G50.
    pub shift: [f64; 3],
    pub assumed: bool,
    /// Nothing may move in it: it is missing in the tables and nothing may be assumed.
    pub forbidden: bool,
    /// It was said that it is assumed.
    noted: bool,
    /// Offsets that the tables lack, with the axes that the program itself has set.
    set_by_program: BTreeMap<WorkKey, [bool; 3]>,
}

impl Default for WorkFrame {
    fn default() -> Self {
        WorkFrame {
            key: WorkKey::Standard(1),
            base: [0.0; 3],
            local: [0.0; 3],
            shift: [0.0; 3],
            assumed: false,
            forbidden: false,
            noted: false,
            set_by_program: BTreeMap::new(),
        }
    }
}

impl WorkFrame {
    /// The set-up's origin in the machine.
    pub(crate) fn origin(&self) -> [f64; 3] {
        std::array::from_fn(|k| self.base[k] + self.local[k] + self.shift[k])
    }

    fn name(&self) -> String {
        let mut name = self.key.name();
        for (part, word) in [(self.local, " G52"), (self.shift, " G92")] {
            if part != [0.0; 3] {
                name.push_str(word);
            }
        }
        name
    }
}

impl Interpreter {
    // ---- frames

    /// The gauge point in the machine.
    pub(crate) fn gauge(&self) -> [f64; 3] {
        let (origin, offset) = (self.frame.origin(), self.offset.total().xyz);
        std::array::from_fn(|k| origin[k] + self.tip[k] + offset[k])
    }

    /// Counts the tip anew from a gauge point that has not moved.
    fn place_tip(&mut self, gauge: [f64; 3]) {
        let (origin, offset) = (self.frame.origin(), self.offset.total().xyz);
        self.tip = std::array::from_fn(|k| gauge[k] - origin[k] - offset[k]);
    }

    /// Puts the tip where axis `axis` of the gauge point has come to.
    pub(crate) fn place_axis(&mut self, axis: usize, gauge: f64) {
        self.tip[axis] = gauge - self.frame.origin()[axis] - self.offset.total().xyz[axis];
    }

    pub(crate) fn first_frame(&mut self) {
        let key = WorkKey::Standard(1);
        let known = self.tables.work_offsets.get(&key.name()).copied();
        self.frame.assumed = known.is_none();
        self.frame.forbidden = match known {
            None => self.tables.missing == Missing::Fail,
            Some(offset) => !offset.is_shift(),
        };
        let gauge = self.gauge();
        self.frame.base = self.base_of(key);
        self.place_tip(gauge);
        self.say_frame();
    }

    /// Origin of an offset with the external one added.
    fn base_of(&self, key: WorkKey) -> [f64; 3] {
        let of = |key: WorkKey| self.tables.work_offsets.get(&key.name()).map_or([0.0; 3], |t| t.origin);
        let (own, external) = (of(key), of(WorkKey::External));
        std::array::from_fn(|k| own[k] + external[k])
    }

    fn say_frame(&mut self) {
        self.emit(StepKind::Frame(FrameChange {
            name: self.frame.name(),
            machine_from_setup: Transform::<Machine, Setup>::shift(self.frame.origin()),
            assumed: self.frame.assumed,
        }));
    }

    /// Changes parts of the frame; the machine stands still.
    fn change_frame(&mut self, change: impl FnOnce(&mut WorkFrame)) {
        self.interrupt_compensation();
        let gauge = self.gauge();
        let before = (self.frame.origin(), self.frame.key, self.frame.assumed);
        change(&mut self.frame);
        if before == (self.frame.origin(), self.frame.key, self.frame.assumed) {
            return;
        }
        self.place_tip(gauge);
        self.say_frame();
    }

    /// True when an offset is in the tables, or all its axes were set by the program.
    pub(crate) fn is_known(&self, key: WorkKey) -> bool {
        match self.frame.set_by_program.get(&key) {
            Some(axes) => self.profile.variable_axes.iter().all(|a| axes[*a]),
            None => self.tables.work_offsets.contains_key(&key.name()),
        }
    }

    /// G54 to G59, G54.1 P.
    pub(crate) fn select_work_offset(&mut self, key: WorkKey, at: usize, site: Site<'_>) -> Outcome<()> {
        let known = self.is_known(key);
        if !known {
            self.missing(
                "missing-work-offset",
                site,
                at,
                &format!("work offset {}", key.name()),
                "the machine's zero",
            )?;
        }
        for used in [key, WorkKey::External] {
            let turned = self.tables.work_offsets.get(&used.name()).is_some_and(|t| !t.is_shift());
            if turned {
                return Err(Fault::new(
                    at,
                    0,
                    "turned-frame",
                    format!("work offset {} is turned: G-code work offsets are shifts here", used.name()),
                    "enter it as a shift",
                ));
            }
        }
        let base = self.base_of(key);
        self.frame.noted = true;
        self.change_frame(|f| {
            (f.key, f.base, f.assumed, f.forbidden) = (key, base, !known, false);
        });
        Ok(())
    }

    /// Before the first move in a frame that was only taken for granted.
    pub(crate) fn check_frame(&mut self, at: usize, site: Site<'_>) -> Outcome<()> {
        if self.frame.forbidden {
            self.select_work_offset(self.frame.key, at, site)?;
        } else if self.frame.assumed && !self.frame.noted {
            self.frame.noted = true;
            let what = format!("work offset {}", self.frame.key.name());
            self.missing("missing-work-offset", site, at, &what, "the machine's zero")?;
        }
        Ok(())
    }

    /// Writes one axis of a work offset in the reader's copy; the frame follows when it is in force.
    pub(crate) fn write_work_offset(&mut self, key: WorkKey, axis: usize, origin: f64) {
        let name = key.name();
        let before = self.tables.work_offsets.get(&name).map_or(0.0, |t| t.origin[axis]);
        if !self.tables.work_offsets.contains_key(&name) {
            self.frame.set_by_program.insert(key, [false; 3]);
        }
        if let Some(axes) = self.frame.set_by_program.get_mut(&key) {
            axes[axis] = true;
        }
        let register = plan::Register::WorkOffset {
            name: name.clone(),
            axis,
        };
        self.tables.work_offsets.entry(name).or_insert(Transform::IDENTITY).origin[axis] = origin;
        self.tell_register(register, before, origin);
    }

    /// After writes: the frame in force counted anew.
    pub(crate) fn follow_work_offsets(&mut self) {
        let key = self.frame.key;
        let (base, known) = (self.base_of(key), self.is_known(key));
        self.change_frame(|f| {
            f.base = base;
            if known {
                (f.assumed, f.forbidden) = (false, false);
            }
        });
    }

    /// G52: shifts all work offsets.
    pub(crate) fn local_shift(&mut self, at: usize, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        let mut local = self.frame.local;
        let mut any = false;
        for word in self.profile.axes {
            let Some(w) = block.take(word.letter) else { continue };
            local[word.axis] = self.length(word.letter, w, site) * word.factor;
            any = true;
        }
        if !any {
            return Err(missing_word(at, "G52", "an axis word"));
        }
        self.change_frame(|f| f.local = local);
        Ok(())
    }

    /// G92, G50: the place where the tip is gets these coordinates.
    pub(crate) fn set_position(&mut self, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        let mut shift = self.frame.shift;
        for word in self.profile.axes {
            let Some(w) = block.take(word.letter) else { continue };
            let value = self.length(word.letter, w, site) * word.factor;
            if word.incremental == Some(true) {
                // U and W change the name of the place by that much.
                shift[word.axis] -= value;
            } else {
                shift[word.axis] += self.tip[word.axis] - value;
            }
        }
        self.change_frame(|f| f.shift = shift);
        Ok(())
    }

    /// G92.1.
    pub(crate) fn clear_position(&mut self) {
        self.change_frame(|f| f.shift = [0.0; 3]);
    }

    // ---- tool offsets

    fn set_tool_offset(&mut self, offset: ToolOffset) {
        if offset == self.offset {
            return;
        }
        self.interrupt_compensation();
        let (gauge, before) = (self.gauge(), self.tip);
        self.offset = offset;
        self.place_tip(gauge);
        for (axis, carried) in self.carried.iter_mut().enumerate() {
            *carried += before[axis] - self.tip[axis];
        }
        self.emit(StepKind::ToolOffset(offset));
    }

    /// G43, G44, G49, and H alone while one of the first two is in force.
    pub(crate) fn set_length_offset(&mut self, block: &mut Block, said: Option<(i8, usize)>, site: Site<'_>) -> Outcome<()> {
        let h = block.take(b'H');
        let at = h.map(|h| h.at).or(said.map(|(_, at)| at)).unwrap_or(0);
        if let Some(h) = h {
            self.h = Self::whole(h, 'H', 999)?;
        } else if matches!(said, Some((1 | -1, _))) && self.profile.length_of_the_tool {
            self.h = self.tool.unwrap_or(0);
        }
        match said {
            Some((sign, _)) => self.length_sign = sign,
            None if h.is_some() && self.length_sign != 0 => {}
            None => return Ok(()),
        }
        if self.length_sign == 0 || self.h == 0 {
            self.set_tool_offset(ToolOffset::NONE);
            return Ok(());
        }
        let entry = self.tables.tools.get(&ToolNumber(self.h)).cloned();
        if entry.is_none() {
            let what = format!("tool length H{}", self.h);
            self.missing("missing-tool-length", site, at, &what, "length 0")?;
        }
        let assumed = entry.is_none();
        let entry = entry.unwrap_or_default();
        let sign = f64::from(self.length_sign);
        let along = |v: Vector<Machine>| Vector::new(0.0, 0.0, v.xyz[2] * sign);
        self.set_tool_offset(ToolOffset {
            number: self.h,
            geometry: along(entry.geometry.0),
            wear: along(entry.wear.0),
            assumed,
        });
        Ok(())
    }

    /// The offset of a lathe's T word; 0 is none. It moves no axis, whatever parameter 5002.6 LWM says of the T block: the next move
    /// with absolute words ends at the same place either way.
    pub(crate) fn select_turning_offset(&mut self, number: u32, at: usize, site: Site<'_>) -> Outcome<()> {
        if number == 0 {
            self.set_tool_offset(ToolOffset::NONE);
            return self.follow_radius(None);
        }
        let assumed = !self.tables.tools.contains_key(&ToolNumber(number));
        if assumed {
            self.missing("missing-tool-offset", site, at, &format!("tool offset {number}"), "zero")?;
        }
        let offset = self.turning_offset(number);
        self.set_tool_offset(ToolOffset { assumed, ..offset });
        self.follow_radius(None)
    }

    /// Geometry and wear of a lathe's offset; the geometry is that of the station where the control is set so (parameter 5002.1 LGN).
    fn turning_offset(&self, number: u32) -> ToolOffset {
        let of = |number: u32| self.tables.tools.get(&ToolNumber(number)).cloned().unwrap_or_default();
        let geometry = match self.options.geometry_by_station {
            true => self.tool.unwrap_or(number),
            false => number,
        };
        ToolOffset {
            number,
            geometry: of(geometry).geometry.0,
            wear: of(number).wear.0,
            assumed: false,
        }
    }

    /// G40, G41, G42, and on a mill D: what the moves from here on are offset by.
    pub(crate) fn set_side(&mut self, block: &mut Block, said: Option<(Side, usize)>, site: Site<'_>) -> Outcome<()> {
        let d = if self.profile.turning { None } else { block.take(b'D') };
        if let Some(d) = d {
            self.d = Self::whole(d, 'D', 999)?;
        }
        let at = match (said, d) {
            (Some((side, at)), _) => {
                self.side = side;
                at
            }
            (None, Some(d)) if self.side != Side::On => d.at,
            _ => return self.compensation.check_plane(self.plane),
        };
        if self.side != Side::On {
            self.compensation.check_plane(self.plane)?;
        }
        self.follow_radius(Some((at, site)))
    }

    /// Takes the radius of the offset in force for compensation; `said` where a missing one is told.
    fn follow_radius(&mut self, said: Option<(usize, Site<'_>)>) -> Outcome<()> {
        let side = self.side;
        let number = if self.profile.turning { self.offset.number } else { self.d };
        if side == Side::On || number == 0 && !self.profile.turning {
            self.compensation.ask(Side::On, 0.0, 0, self.plane);
            return Ok(());
        }
        // The radius register is the operator's: a tool's own diameter says nothing about whether the program was written for the
        // contour or for the centre of the tool, so it is not taken for the register.
        let entry = self.tables.tools.get(&ToolNumber(number)).cloned();
        if let (None, Some((at, site)), false) = (&entry, said, self.profile.turning) {
            self.missing("missing-tool-radius", site, at, &format!("tool radius D{number}"), "radius 0")?;
        }
        let entry = entry.unwrap_or_default();
        let radius = entry.radius.0 + entry.radius_wear.0;
        let tip = if self.profile.turning { entry.tip_direction } else { 0 };
        let radius = if self.shaping.turns_round(self.plane) {
            -radius
        } else {
            radius
        };
        self.compensation.ask(side, radius, tip, self.plane);
        let (0.0, Some((at, site))) = (radius, said) else {
            return Ok(());
        };
        if self.profile.turning {
            self.note(Severity::Warning, "nose-radius-zero", site, at, || {
                (
                    "the tables hold no nose radius: 0 is assumed, the programmed contour is the path of the tip".to_owned(),
                    "tapers and arcs will be off by up to the nose radius".to_owned(),
                )
            });
        } else {
            self.note(Severity::Remark, "cutter-compensation-zero", site, at, || {
                (
                    "cutter compensation with radius 0: the programmed path is the path".to_owned(),
                    String::new(),
                )
            });
        }
        Ok(())
    }

    /// After a write to a tool's registers: the offset in force counted anew.
    pub(crate) fn follow_tool_offset(&mut self, number: u32) -> Outcome<()> {
        let now = self.offset;
        if self.profile.turning {
            if now.number != 0 {
                let offset = self.turning_offset(now.number);
                self.set_tool_offset(ToolOffset {
                    assumed: false,
                    ..offset
                });
            }
        } else if now.number == number
            && let Some(entry) = self.tables.tools.get(&ToolNumber(number))
        {
            let sign = f64::from(self.length_sign);
            let along = |v: Vector<Machine>| Vector::new(0.0, 0.0, v.xyz[2] * sign);
            let offset = ToolOffset {
                number,
                geometry: along(entry.geometry.0),
                wear: along(entry.wear.0),
                assumed: false,
            };
            self.set_tool_offset(offset);
        }
        self.follow_radius(None)
    }
}
