//! G10: offsets set by the program.

use super::*;

impl Interpreter {
    /// G10.
    pub(crate) fn set_offset(&mut self, at: usize, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        let l = match block.take(b'L') {
            None if self.profile.turning => return self.set_turning_offset(at, block, site),
            None if self.profile.external_offset => 11, // of the oldest controls
            None => return Err(missing_word(at, "G10", "L")),
            Some(l) => Self::whole(l, 'L', 99)?,
        };
        if matches!(l, 1 | 10..=13) && !self.profile.turning && self.profile.external_offset {
            return self.set_milling_offset(l, at, block, site);
        }
        if l != 2 && !(l == 20 && self.profile.external_offset) {
            return Err(Fault::not_there_yet(at, &format!("G10 L{l}")));
        }
        if let Some(r) = block.look(b'R') {
            return Err(Fault::not_there_yet(r.at, "R of G10, a turned work offset,"));
        }
        let Some(p) = block.take(b'P') else {
            return Err(missing_word(at, "G10", "P"));
        };
        let number = Self::whole(p, 'P', 300)?;
        let key = match (l, number) {
            (2, 0) if self.profile.external_offset => WorkKey::External,
            (2, 0) => self.frame.key,
            (2, 1..=6) => WorkKey::Standard(number as u8),
            (20, 1..=300) => WorkKey::More(number as u16),
            _ => {
                return Err(Fault::new(
                    p.at,
                    0,
                    "word-range",
                    format!("there is no work offset P{number}"),
                    "P is 1 to 6, for G54 to G59",
                ));
            }
        };
        for word in self.profile.axes {
            let Some(w) = block.take(word.letter) else { continue };
            let value = self.length(word.letter, w, site) * word.factor;
            let old = self.tables.work_offsets.get(&key.name()).map_or(0.0, |t| t.origin[word.axis]);
            let adds = word.incremental.unwrap_or(self.incremental && self.profile.offsets_add);
            self.write_work_offset(key, word.axis, if adds { old + value } else { value });
        }
        self.follow_work_offsets();
        Ok(())
    }

    /// G10 L10 to L13 of a mill: length geometry and wear, radius geometry and wear. L1 is L11 (older controls).
    pub(super) fn set_milling_offset(&mut self, l: u32, at: usize, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        let (Some(p), Some(r)) = (block.take(b'P'), block.take(b'R')) else {
            return Err(missing_word(at, "G10", "P, the offset's number, and R, its value"));
        };
        let number = Self::whole(p, 'P', 999)?;
        if number == 0 {
            return Err(Fault::new(
                p.at,
                0,
                "word-range",
                "there is no tool offset 0",
                "write P1 or more",
            ));
        }
        let value = self.length(b'R', r, site);
        let adds = self.incremental;
        let limits = match l {
            10 | 12 => [self.largest_offset(); 2],
            _ => [self.largest_wear(), self.largest_wear_step()],
        };
        if adds {
            self.check_offset(value / self.unit(), limits[1], r.at)?;
        }
        let entry = self.tables.tools.entry(ToolNumber(number)).or_default();
        let was = entry.clone();
        let place = match l {
            10 => &mut entry.geometry.0.xyz[2],
            1 | 11 => &mut entry.wear.0.xyz[2],
            12 => &mut entry.radius.0,
            _ => &mut entry.radius_wear.0,
        };
        *place = if adds { *place + value } else { value };
        let now = *place;
        if let Err(fault) = self.check_offset(now / self.unit(), limits[0], r.at) {
            self.tables.tools.insert(ToolNumber(number), was);
            return Err(fault);
        }
        self.tell_tool(number, &was);
        self.follow_tool_offset(number)
    }

    /// G10 P of a lathe: P n is the wear of offset n, P 10000 + n its geometry, P0 the work shift. X Z R set, U W C add; Q is the
    /// direction of the tip.
    pub(super) fn set_turning_offset(&mut self, at: usize, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        let Some(p) = block.take(b'P') else {
            return Err(missing_word(at, "G10", "P, the offset's number"));
        };
        let number = Self::whole(p, 'P', 10_999)?;
        let mut values = [None; 2];
        for word in self.profile.axes {
            if let Some(w) = block.take(word.letter) {
                let factor = match number {
                    0 => word.factor,
                    _ => self.offset_factor(word.axis),
                };
                let value = self.length(word.letter, w, site) * factor;
                values[usize::from(word.axis == 2)] = Some((value, word.incremental == Some(true)));
            }
        }
        let mut radius = None;
        for (letter, adds) in [(b'R', false), (b'C', true)] {
            if let Some(w) = block.take(letter) {
                radius = Some((self.length(letter, w, site), adds));
            }
        }
        let tip = block.take(b'Q').map(|q| Self::whole(q, 'Q', 9)).transpose()?;
        let change = |place: &mut f64, value: Option<(f64, bool)>| {
            if let Some((value, adds)) = value {
                *place = if adds { *place + value } else { value };
            }
        };
        if number == 0 {
            for (axis, value) in [(0, values[0]), (2, values[1])] {
                let mut origin = self
                    .tables
                    .work_offsets
                    .get(&WorkKey::External.name())
                    .map_or(0.0, |t| t.origin[axis]);
                if value.is_some() {
                    change(&mut origin, value);
                    self.write_work_offset(WorkKey::External, axis, origin);
                }
            }
            self.follow_work_offsets();
            return Ok(());
        }
        let (offset, geometry) = (number % 10_000, number >= 10_000);
        let limits = match geometry {
            true => [self.largest_offset(); 2],
            false => [self.largest_wear(), self.largest_wear_step()],
        };
        if offset == 0 {
            return Err(Fault::new(
                p.at,
                0,
                "word-range",
                "there is no tool offset 0",
                "write P10001 or more",
            ));
        }
        // Each entry as it will be, before any of them is made.
        let (unit, along) = (self.unit(), |axis: usize| self.offset_factor(axis));
        let old = self.tables.tools.get(&ToolNumber(offset)).cloned().unwrap_or_default();
        let (old_xyz, old_nose) = match geometry {
            true => (old.geometry.0.xyz, old.radius.0),
            false => (old.wear.0.xyz, old.radius_wear.0),
        };
        let entries = [
            (values[0], old_xyz[0], along(0)),
            (values[1], old_xyz[2], along(2)),
            (radius, old_nose, 1.0),
        ];
        for (value, old, factor) in entries {
            let Some((value, adds)) = value else { continue };
            let shown = |mm: f64| mm / factor / unit;
            if adds {
                self.check_offset(shown(value), limits[1], p.at)?;
            }
            self.check_offset(shown(if adds { old + value } else { value }), limits[0], p.at)?;
        }
        let entry = self.tables.tools.entry(ToolNumber(offset)).or_default();
        let was = entry.clone();
        let xyz = if geometry {
            &mut entry.geometry.0.xyz
        } else {
            &mut entry.wear.0.xyz
        };
        change(&mut xyz[0], values[0]);
        change(&mut xyz[2], values[1]);
        let nose = if geometry {
            &mut entry.radius.0
        } else {
            &mut entry.radius_wear.0
        };
        change(nose, radius);
        if let Some(tip) = tip {
            entry.tip_direction = tip as u8;
        }
        self.tell_tool(offset, &was);
        self.follow_tool_offset(offset)
    }
}
