//! Moves become paths: what two of them must have in common to be one, and what is told of each.

use super::*;

impl Writer<'_> {
    pub(super) fn go(&mut self, go: Move) -> Result<(), ConvertError> {
        if !go.path.is_sound() {
            return Err(ConvertError::NotFinite(self.title.clone()));
        }
        let rapid = go.speed == Speed::Rapid;
        let feed = match go.speed {
            Speed::Rapid => None,
            Speed::Feed(feed) => self.feed(feed, &go.path),
        };
        if go.profile.is_some() {
            self.notices
                .insert("a multiplier of the feed along a move is left out".to_string());
        }
        let mut path = go.path;
        // A line begins where the last move really ended, as the planner has it too.
        let tip = self.tip();
        if let Path::Line { from, .. } = &mut path
            && from.distance(tip) <= ROUNDING
        {
            *from = tip;
        }
        self.gauge = self.machine_from_setup() * path.end() + self.offset.total();
        if path.length() <= NO_LENGTH {
            return Ok(());
        }
        let exact_stop = self.path_mode == PathMode::ExactStop;
        self.add_piece(path, rapid, feed, exact_stop);
        Ok(())
    }

    /// A move to a place of the machine is a rapid path to where that is in the set-up.
    pub(super) fn machine_move(&mut self, to: [Option<Millimetres>; 3]) -> Result<(), ConvertError> {
        let from = self.tip();
        for (axis, target) in to.into_iter().enumerate() {
            if let Some(target) = target {
                self.gauge.xyz[axis] = target.0;
            }
        }
        let path = Path::Line { from, to: self.tip() };
        if !path.is_sound() {
            return Err(ConvertError::NotFinite(self.title.clone()));
        }
        if path.length() > NO_LENGTH {
            self.close_path();
            self.add_piece(path, true, None, true);
            self.close_path();
        }
        Ok(())
    }

    pub(super) fn feed(&self, feed: Feed, path: &Path<Setup>) -> Option<FeedKey> {
        let (value, per_revolution, synchronized) = match feed {
            Feed::PerTime(speed) => (speed.0, false, false),
            Feed::WholeMove(time) => (path.length() / time.0, false, false),
            Feed::PerRevolution(length) => (length.0, true, false),
            Feed::Thread(thread) => (thread.advance.0, true, true),
        };
        // The standard knows a feed for each revolution in turning only; elsewhere the spindle's own speed makes a speed of it.
        let (value, per_revolution) = match self.spindle {
            SpindleState::Clockwise(SpindleMode::Revolutions(n))
            | SpindleState::Counterclockwise(SpindleMode::Revolutions(n))
                if per_revolution && !self.options.turning =>
            {
                (value * n.0 / 60.0, false)
            }
            _ => (value, per_revolution),
        };
        (value.is_finite() && value > 0.0).then_some(FeedKey {
            per_revolution,
            synchronized,
            value: value.to_bits(),
        })
    }

    pub(super) fn technology(&self, feed: Option<FeedKey>) -> Technology {
        let signed = |clockwise: bool, value: f64| if clockwise { -value } else { value }.to_bits();
        let of = |clockwise: bool, mode: SpindleMode| match mode {
            SpindleMode::Revolutions(n) => SpindleKey::Revolutions(signed(clockwise, n.0)),
            SpindleMode::Surface { speed, limit } => SpindleKey::Surface(signed(clockwise, speed.0), limit.0.to_bits()),
        };
        let spindle = match self.spindle {
            SpindleState::Stopped | SpindleState::Oriented => SpindleKey::Stopped,
            SpindleState::Clockwise(mode) => of(true, mode),
            SpindleState::Counterclockwise(mode) => of(false, mode),
        };
        Technology { feed, spindle }
    }

    pub(super) fn conditions(&self, exact_stop: bool) -> Functions {
        let mut others = Vec::new();
        if exact_stop {
            others.push((EXACT_STOP, "on".to_string()));
        }
        // Without a tool that is said as well: the stream asks for one otherwise.
        let own = self.tool.map(|tool| self.tools[tool].number.0);
        if Some(self.offset.number) != own {
            let number = match self.offset.number {
                0 => "off".to_string(),
                number => number.to_string(),
            };
            others.push((TOOL_OFFSET, number));
        }
        Functions {
            outlets: [self.coolant.flood, self.coolant.mist, self.coolant.through],
            oriented: self.spindle == SpindleState::Oriented,
            others,
        }
    }

    pub(super) fn add_piece(&mut self, piece: Path<Setup>, rapid: bool, feed: Option<FeedKey>, exact_stop: bool) {
        self.open_step();
        let along_tool = |piece: &Path<Setup>| matches!(piece, Path::Line { from, to } if (to.xyz[0] - from.xyz[0]).abs() + (to.xyz[1] - from.xyz[1]).abs() < 1e-9);
        if curve::is_flattened(&piece) {
            self.notices.insert(
                "a helix that does not stand on the XY plane has no curve in STEP-NC: chords within 0.0005 mm stand for it"
                    .to_string(),
            );
        }
        let base = self.base();
        if rapid {
            self.bases[base].highest = self.bases[base].highest.max(piece.start().xyz[2]).max(piece.end().xyz[2]);
        }
        let key = PathKey {
            rapid,
            technology: self.technology(feed),
            functions: self.conditions(exact_stop),
            maximum_deviation: match self.path_mode {
                PathMode::ExactStop | PathMode::Tolerance(None) => None,
                // Half of what a path allows is the planner's.
                PathMode::Tolerance(Some(tolerance)) => Some(tolerance.0 * 2.0),
                PathMode::ExactPath => Some(EXACT_PATH * 2.0),
            },
        };
        if let Some(step) = &mut self.step
            && !rapid
        {
            step.drills &= along_tool(&piece);
        }
        match &mut self.path {
            Some(open) if open.key == key => open.pieces.push(piece),
            _ => {
                self.close_path();
                self.path = Some(OpenPath {
                    key,
                    pieces: vec![piece],
                });
            }
        }
    }

    pub(super) fn close_path(&mut self) {
        let Some(open) = self.path.take() else { return };
        let Some(step) = &mut self.step else { return };
        let name = if open.key.rapid {
            step.rapids += 1;
            format!("rapid {}", step.rapids)
        } else {
            step.feeds += 1;
            format!("cut {}", step.feeds)
        };
        let sheet = &mut self.sheet;
        let curve = curve::curve(sheet, &open.pieces);
        let id = sheet.add(format!("MACHINING_TOOLPATH('{name}','cutter location trajectory','','')"));
        let context = sheet.context;
        let representation = sheet.add(format!("REPRESENTATION('',(#{curve}),#{context})"));
        sheet.property(id, "basic curve", representation);
        let required = sheet.says("required");
        sheet.property(id, "priority", required);
        if open.key.rapid {
            let rapid = sheet.rapid();
            sheet.property(id, "speed profile", rapid);
        }
        if let Some(deviation) = open.key.maximum_deviation {
            let item = sheet.length_item("path maximum deviation", Millimetres(deviation));
            let no_units = sheet.no_units;
            let representation = sheet.add(format!("REPRESENTATION('',(#{item}),#{no_units})"));
            sheet.property(id, "path maximum deviation", representation);
        }
        self.told(id, open.key.technology, open.key.functions);
    }

    /// A path that stands still.
    pub(super) fn dwell(&mut self, time: Seconds) {
        self.close_path();
        self.open_step();
        let Some(step) = &mut self.step else { return };
        step.dwells += 1;
        let name = format!("dwell {}", step.dwells);
        let sheet = &mut self.sheet;
        let id = sheet.add(format!("MACHINING_TOOLPATH('{name}','feedstop','','')"));
        let item = sheet.time_item("dwell time", time);
        let no_units = sheet.no_units;
        let representation = sheet.add(format!(
            "MACHINING_DWELL_TIME_REPRESENTATION('dwell time',(#{item}),#{no_units})"
        ));
        sheet.property(id, "dwell", representation);
        let required = sheet.says("required");
        sheet.property(id, "priority", required);
        let (technology, functions) = (self.technology(None), self.conditions(false));
        self.told(id, technology, functions);
    }

    pub(super) fn told(&mut self, id: u64, technology: Technology, functions: Functions) {
        self.toolpaths += 1;
        self.last = Some((technology, functions.clone()));
        if let Some(step) = &mut self.step {
            step.paths.push((id, technology, functions));
        }
    }

    // ---- structure
}
