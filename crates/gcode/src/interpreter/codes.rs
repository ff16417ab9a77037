//! G and M codes of a block: which take effect at once, which before the move, which behind it.

use super::*;

impl Interpreter {
    /// Takes the block's G codes: modal ones are in force at once, others are handed on.
    pub(super) fn read_codes(&mut self, block: &mut Block, site: Site<'_>) -> Outcome<Said> {
        let mut said = Said::default();
        let mut groups = 0_u32;
        let mut index = 0;
        while let Some(code) = block.g(index) {
            index += 1;
            let at = code.at;
            let Some(meaning) = self.meaning(code.code) else {
                return Err(Fault::new(
                    at,
                    10,
                    "unknown-g",
                    format!("the {} control knows no {}", self.profile.name, g_name(code.code)),
                    "take it out, or choose another dialect",
                ));
            };
            if let Some(group) = meaning.group() {
                if groups >> group & 1 == 1 {
                    return Err(Fault::new(
                        at,
                        0,
                        "g-group",
                        format!("{} contradicts another code of its group in this block", g_name(code.code)),
                        "keep one of them, or make two blocks",
                    ));
                }
                groups |= 1 << group;
            }
            match meaning {
                G::Motion(motion) => {
                    self.motion = motion;
                    self.motion_said = true;
                    self.cycle = None;
                    self.turning_cycles.single = None;
                    said.motion = true;
                }
                G::Plane(plane) => self.plane = plane,
                G::Incremental(on) => self.incremental = on,
                G::AbsoluteCentres(on) => self.absolute_centres = on,
                G::Feed(mode) => {
                    if self.feed_mode != mode {
                        self.feed = None; // an F of another kind means another thing
                    }
                    self.feed_mode = mode;
                }
                G::Inches(on) => {
                    self.inches = on;
                    self.units_said = true;
                }
                G::Side(side) => said.side = Some((side, at)),
                G::Length(sign) => said.length = Some((sign, at)),
                G::Drill(kind) => {
                    said.drill = true;
                    self.begin_cycle(kind, code.code / 10, false);
                }
                G::SideDrill(kind) => {
                    said.drill = true;
                    self.begin_cycle(kind, code.code / 10, true);
                }
                G::Single(kind) => {
                    self.cycle = None;
                    self.motion_said = true;
                    if self.turning_cycles.single.is_none_or(|s| s.kind != kind) {
                        self.turning_cycles.single = Some(Single::new(kind));
                    }
                }
                G::DrillEnd => self.cycle = None,
                G::ReturnToR(on) => self.return_to_r = on,
                G::Work(number) => {
                    self.only_unshaped(code.code, at)?;
                    said.work = Some((WorkKey::Standard(number), at));
                }
                G::MoreWork => {
                    let Some(p) = block.take(b'P') else {
                        return Err(missing_word(at, "G54.1", "P"));
                    };
                    said.work = Some((WorkKey::More(Self::whole(p, 'P', 300)?.max(1) as u16), at));
                }
                G::Path(mode) => said.path = Some((mode, at)),
                G::SurfaceSpeed(on) => said.surface = Some(on),
                G::Polar(on) => self.set_polar(on),
                G::RotationOff => self.end_rotation(),
                G::Once(Once::ExactStop) => said.exact_stop = true,
                G::Once(once) => {
                    if matches!(
                        once,
                        Once::Home | Once::SecondReference | Once::SetPosition | Once::LocalShift
                    ) {
                        self.only_unshaped(code.code, at)?;
                    }
                    said.once = Some((once, at));
                }
                G::Harmless(why) => {
                    block.use_all_but(b"XYZUWIJKFSTHD");
                    self.note(Severity::Remark, "accepted", site, at, || {
                        (
                            format!("{} ({why}) is accepted and changes nothing here", g_name(code.code)),
                            String::new(),
                        )
                    });
                }
                G::NotYet(what) => return Err(Fault::not_there_yet(at, what)),
            }
        }
        // A motion code and a cycle in one block: the cycle is what the axis words are for, the code stays for afterwards.
        if said.motion && said.drill {
            said.motion = false;
        }
        Ok(said)
    }

    pub(super) fn meaning(&self, code: u16) -> Option<G> {
        let codes = self.profile.g;
        codes.binary_search_by_key(&code, |(c, _)| *c).ok().map(|i| codes[i].1)
    }

    pub(super) fn check_letters(&self, block: &Block) -> Outcome<()> {
        match block.outside(self.known_letters) {
            None => Ok(()),
            Some((letter, word)) => Err(Fault::new(
                word.at,
                9,
                "unknown-letter",
                format!("the {} control knows no word {letter}", self.profile.name),
                "take it out, or choose another dialect",
            )),
        }
    }

    pub(super) fn m_meaning(&self, m: Code) -> Outcome<M> {
        let codes = self.profile.m;
        match codes.binary_search_by_key(&m.code, |(c, _)| *c) {
            Ok(i) => Ok(codes[i].1),
            Err(_) if m.code == 97 && self.macros.local_subprograms => Ok(M::LocalCall),
            Err(_) if matches!(m.code, 96 | 97) && self.macros.fanuc_ranges => Err(Fault::new(
                m.at,
                113,
                "not-available",
                format!(
                    "M{}: interruption macros are not available, parameter 6003.7 (MUS) is 0",
                    m.code
                ),
                "set 6003.7, or call the macro where it is needed, by G65",
            )),
            Err(_) => Err(Fault::new(
                m.at,
                0,
                "unknown-m",
                format!("the {} control knows no M{}", self.profile.name, m.code),
                "take it out, or choose another dialect",
            )),
        }
    }

    pub(super) fn before_motion(&mut self, m: Code, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        self.last_m = m.code;
        let was = self.coolant;
        match self.m_meaning(m)? {
            M::Mist => self.set_coolant(CoolantState { mist: true, ..was }),
            M::Flood => self.set_coolant(CoolantState { flood: true, ..was }),
            M::ThroughCoolant => self.set_coolant(CoolantState { through: true, ..was }),
            M::CoolantOff => self.set_coolant(CoolantState::default()),
            M::ToolChange if !self.profile.tool_change_after_motion => self.change_tool(m.at, block, site)?,
            M::Harmless(why) => {
                block.use_all_but(b"XYZUWIJKFSTHD");
                self.note(Severity::Remark, "accepted", site, m.at, || {
                    (
                        format!("M{} ({why}) is accepted and changes nothing here", m.code),
                        String::new(),
                    )
                });
            }
            M::Call | M::Return | M::LocalCall => block.use_all_but(b"XYZUWIJKFSTHD"),
            _ => {}
        }
        Ok(())
    }

    pub(super) fn after_motion(&mut self, m_codes: &[Code], block: &mut Block, site: Site<'_>) -> Outcome<Flow> {
        let mut flow = Flow::NextBlock;
        for m in m_codes {
            match self.m_meaning(*m)? {
                M::ToolChange if self.profile.tool_change_after_motion => self.change_tool(m.at, block, site)?,
                M::Stop => {
                    self.moved_since_stop = false;
                    self.emit(StepKind::Stop(StopKind::Program));
                }
                M::OptionalStop => self.push(Item::Ask(self.origin, Question::OptionalStop)),
                M::End => {
                    self.finish();
                    flow = Flow::End;
                }
                M::Call => flow = self.call(m.at, block)?,
                M::LocalCall => {
                    let Some(p) = block.take(b'P') else {
                        return Err(missing_word(m.at, "M97", "P, the sequence number to go on from,"));
                    };
                    let times = block.take(b'L').map(|l| Self::whole(l, 'L', 9999)).transpose()?;
                    flow = Flow::LocalCall {
                        block: Self::whole(p, 'P', 99_999)?,
                        times: times.unwrap_or(1),
                        at: m.at,
                    };
                }
                M::Return => {
                    let to = block.take(b'P').map(|p| Self::whole(p, 'P', 99_999)).transpose()?;
                    flow = Flow::Return { to, at: m.at };
                }
                _ => {}
            }
        }
        Ok(flow)
    }

    /// M98: `P1234`, `P1234 L3`, or count and number in one word, `P31234`.
    pub(super) fn call(&self, at: usize, block: &mut Block) -> Outcome<Flow> {
        let Some(p) = block.take(b'P') else {
            return Err(Fault::new(
                at,
                76,
                "word-missing",
                "M98 without P",
                "write the number of the subprogram: M98 P1234",
            ));
        };
        let number = Self::program_of(p)?;
        let repeats = block.take(b'L').map(|l| Self::whole(l, 'L', 9999)).transpose()?;
        let (program, times) = match repeats {
            Some(times) => (number, times),
            None if number > 9999 && !is_named(number) => (number % 10_000, number / 10_000),
            None => (number, 1),
        };
        Ok(Flow::Call { program, times, at })
    }

    pub(super) fn set_path_mode(&mut self, mode: PathMode, at: usize, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        let mode = match mode {
            PathMode::Tolerance(_) if self.profile.tolerance_word => match block.take(b'P') {
                Some(p) if p.value < 0.0 => {
                    return Err(Fault::new(at, 0, "word-range", "a tolerance cannot be negative", "correct P"));
                }
                Some(p) => PathMode::Tolerance(Some(Millimetres(self.length(b'P', p, site)))),
                None => PathMode::Tolerance(None),
            },
            other => other,
        };
        if mode != self.path_mode {
            self.path_mode = mode;
            self.emit(StepKind::PathMode(mode));
        }
        Ok(())
    }

    pub(super) fn once(&mut self, once: Once, at: usize, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        match once {
            Once::Rotate => self.begin_rotation(at, block, site),
            Once::Scale => self.begin_scale(at, block, site),
            Once::ScaleOff => {
                self.end_scale();
                Ok(())
            }
            Once::Mirror => self.begin_mirror(at, block, site),
            Once::MirrorOff => {
                self.end_mirror(block);
                Ok(())
            }
            Once::Dwell => self.dwell(at, block, site),
            Once::SetOffset => self.set_offset(at, block, site),
            Once::Home => self.home(at, [0.0; 3], block, site),
            Once::SecondReference => self.second_reference(at, block, site),
            Once::LocalShift => self.local_shift(at, block, site),
            Once::MachineCoordinates => self.machine_move(at, block, site),
            Once::SetPosition => self.set_position(block, site),
            Once::ClearPosition => {
                self.clear_position();
                Ok(())
            }
            Once::ExactStop => Ok(()), // handled with the move
            Once::Skip => self.skip(at, block, site),
            Once::Contour(cycle) => self.contour_cycle(cycle, at, block, site),
            Once::PeckColumns(deep) => self.peck_cycle(deep, at, block, site),
            Once::ThreadCycle => self.thread_cycle(at, block, site),
        }
    }

    pub(super) fn dwell(&mut self, at: usize, block: &mut Block, site: Site<'_>) -> Outcome<()> {
        let seconds = if let Some(p) = block.take(b'P') {
            if p.has_point && !self.profile.dwell_point_too {
                self.note(Severity::Warning, "dwell-point", site, p.at, || {
                    (
                        format!(
                            "P with a point is read as {} seconds; some controls read milliseconds or alarm",
                            p.value
                        ),
                        "write P without a point for milliseconds".to_owned(),
                    )
                });
            }
            p.value * self.dwell_factor(p)
        } else if let Some(x) = block.take(b'X').or_else(|| block.take(b'U')) {
            x.value
        } else {
            return Err(missing_word(at, "G4", "P"));
        };
        if seconds < 0.0 {
            return Err(Fault::new(
                at,
                0,
                "dwell-negative",
                "a dwell cannot be negative",
                "correct the time",
            ));
        }
        if seconds > 0.0 {
            self.emit(StepKind::Dwell(units::Seconds(seconds)));
        }
        Ok(())
    }

    /// Seconds for each unit of a dwell's P.
    pub(crate) fn dwell_factor(&self, p: Word) -> f64 {
        if p.has_point && !self.profile.dwell_point_too {
            1.0
        } else {
            self.profile.dwell_unit
        }
    }
}
