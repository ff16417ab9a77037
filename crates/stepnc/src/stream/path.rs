//! One toolpath after the other: what must be in force, the link to its start, its pieces.

use super::conditions::{others, path_mode};
use super::setting::{feed, spindle_state};
use super::*;

impl Walker<'_> {
    /// Says everything that must be in force for a toolpath, the link to its start, and its beginning.
    pub(super) fn open(&mut self, operation: &Operation, toolpath: Toolpath) -> Result<(), Fault> {
        let program = self.program;
        let id = toolpath.id;
        if let Some(fault) = toolpath.faults.first() {
            return Err(fault.clone());
        }
        let refuse = |code, message: String, remedy| Err(Fault::new(id, code, message, remedy));
        if toolpath.kind != ToolpathKind::Dwell {
            if toolpath.description == "cutter contact trajectory" {
                return refuse(
                    "cutter-contact",
                    format!("toolpath '{}' gives contact points and not the tool tip", toolpath.name),
                    "export cutter location trajectories",
                );
            }
            if toolpath.description == "axis trajectory" {
                return refuse(
                    "axis-trajectory",
                    format!("toolpath '{}' moves single axes, which is not supported yet", toolpath.name),
                    "export cutter location trajectories",
                );
            }
            if toolpath.tilted {
                return refuse(
                    "tool-axis",
                    format!(
                        "toolpath '{}' tilts the tool, which this three-axis stream cannot",
                        toolpath.name
                    ),
                    "export the path with the tool axis along Z",
                );
            }
        }
        if toolpath.kind != ToolpathKind::Dwell && toolpath.is_connection() {
            // It says that the tool goes to the next path and not how: the link does, over the security plane where it says so.
            if toolpath.description == "connect security plane" {
                self.run.clearance = self.security_plane();
            }
            return Ok(());
        }
        let technology = toolpath
            .technology
            .or(operation.technology)
            .and_then(|id| program.technology(id));
        let tool = program.tool_of(operation.id);
        let (frame, found) = self.frame()?;
        let another = self.another_setup(id, &frame.name);
        if another || self.run.frame != Some(frame.machine_from_setup) {
            if let Some((severity, fault)) = found {
                program.note(&mut self.run.diagnostics, severity, &fault);
            }
            self.run.frame = Some(frame.machine_from_setup);
            self.run.setup = Some(frame.name.clone());
            self.say(id, StepKind::Frame(frame.clone()));
        }
        if let Some(technology) = technology {
            if let Some(fault) = technology.faults.first() {
                return Err(fault.clone());
            }
            if let Some(spindle) = technology.spindle {
                if let SpindleSetting::Surface { limit: None, .. } = spindle
                    && operation.turns()
                {
                    let limit = self.options.spindle_limit;
                    let message = format!(
                        "a surface speed has no maximum rotational speed: {} rev/min is assumed",
                        limit.0
                    );
                    let remedy = "give the technology a maximum rotational speed";
                    program.note(
                        &mut self.run.diagnostics,
                        Severity::Warning,
                        &Fault::new(id, "surface-speed", message, remedy),
                    );
                }
                let spindle = spindle_state(id, spindle, tool, operation, self.options.spindle_limit)?;
                if self.run.spindle != Some(spindle) {
                    self.run.spindle = Some(spindle);
                    self.say(id, StepKind::Spindle(spindle));
                }
            }
        }
        let functions = toolpath
            .functions
            .or(operation.functions)
            .and_then(|id| program.functions(id));
        if let Some(functions) = functions
            && self.run.coolant != Some(functions.coolant)
        {
            self.run.coolant = Some(functions.coolant);
            self.say(id, StepKind::Coolant(functions.coolant));
        }
        self.offset_for(id, functions)?;
        let path_mode = path_mode(&toolpath, functions);
        if self.run.path_mode != Some(path_mode) && toolpath.kind != ToolpathKind::Dwell {
            self.run.path_mode = Some(path_mode);
            self.say(id, StepKind::PathMode(path_mode));
        }
        let properties = others(functions);
        for line in plan::line::along(&properties) {
            self.forget_written(line);
        }
        let others = (!properties.is_empty()).then(|| {
            StepKind::NcFunction(RawNcFunction {
                kind: "other functions".into(),
                name: toolpath.name.clone(),
                text: String::new(),
                condition: None,
                properties,
            })
        });
        if toolpath.kind == ToolpathKind::Dwell {
            let time = match toolpath.dwell {
                Some(Dwell::Time(time)) => time,
                Some(Dwell::Revolutions(turns)) => {
                    let speed = self.run.spindle.unwrap_or_default().revolutions(Millimetres::ZERO);
                    if speed.0 <= 0.0 {
                        return refuse(
                            "dwell",
                            "a dwell counts revolutions and the spindle stands".into(),
                            "give the dwell as a time",
                        );
                    }
                    Seconds(turns / speed.0 * 60.0)
                }
                None => {
                    return refuse(
                        "dwell",
                        format!("feedstop '{}' has no dwell time", toolpath.name),
                        "give it one",
                    );
                }
            };
            self.begin(Level::Toolpath, id, &toolpath.name, None);
            self.run
                .queue
                .extend(others.map(|kind| (entity_origin(id), Said::Step(kind))));
            self.say(id, StepKind::Dwell(time));
            self.say(id, StepKind::End(Level::Toolpath));
            return Ok(());
        }
        let speed = match toolpath.kind {
            ToolpathKind::Rapid => Speed::Rapid,
            _ => Speed::Feed(feed(id, &toolpath, technology.and_then(|technology| technology.feed), tool)?),
        };
        let profile = match &toolpath.profile {
            None => None,
            Some(profile) => {
                let mut length = 0.0;
                for piece in program.pieces(&toolpath)? {
                    length += piece.map_err(|fault| placed(fault, id))?.length();
                }
                Some((profile.clone(), length))
            }
        };
        let mut pieces = program.pieces(&toolpath)?;
        let mut first = pieces.next().transpose().map_err(|fault| placed(fault, id))?;
        if let Some(first) = &mut first {
            // A mill lifts the tool off along Z, a lathe along X.
            let retract_axis = if operation.turns() { 0 } else { 2 };
            self.link(id, frame.machine_from_setup, first, speed, retract_axis);
        }
        self.begin(Level::Toolpath, id, &toolpath.name, toolpath.maximum_deviation);
        self.run
            .queue
            .extend(others.map(|kind| (entity_origin(id), Said::Step(kind))));
        let mut open = OpenPath {
            pieces: pieces.into_state(),
            speed,
            profile,
            travelled: 0.0,
            toolpath,
        };
        if let Some(first) = first {
            self.go(&mut open, first);
        }
        self.run.tasks.push(Task::Path(Box::new(open)));
        Ok(())
    }

    /// The height of the nearest security plane, where paths are not turned or moved against the set-up that it is written in.
    fn security_plane(&self) -> Option<Millimetres> {
        let program = self.program;
        let around: Vec<&Executable> = self.run.scopes.iter().filter_map(|&id| program.executable(id)).collect();
        if around.iter().any(|executable| executable.orientation.is_some()) {
            return None;
        }
        around.iter().rev().find_map(|executable| {
            let of_setup = executable.setup.as_ref().and_then(|setup| setup.security_plane);
            executable.security_plane.or(of_setup)
        })
    }

    /// Moves from where the tip is to where a path begins: rapid, out along the retract axis to the farther of the two, across, in.
    ///
    /// A gap within the rounding of the file is no link: a line begins where the tip is, any other piece is reached at its own speed.
    fn link(
        &mut self,
        id: u64,
        machine_from_setup: Transform<Machine, Setup>,
        first: &mut Path<Setup>,
        speed: Speed,
        retract_axis: usize,
    ) {
        let tip = machine_from_setup.inverse() * (self.run.gauge - self.run.offset.total());
        let start = first.start();
        if self.run.place != TipPlace::Known {
            self.lift(id);
            self.come_down(id, start, retract_axis);
            self.run.gauge = machine_from_setup * start + self.run.offset.total();
            return;
        }
        let gap = tip.distance(start);
        if gap <= 1e-6 {
            return;
        }
        if gap <= ROUNDING
            && let Path::Line { from, .. } = first
        {
            *from = tip;
            return;
        }
        let mut clear = tip.xyz[retract_axis].max(start.xyz[retract_axis]);
        if let Some(height) = self.run.clearance.take().filter(|_| retract_axis == 2) {
            clear = clear.max(height.0);
        }
        let above = |place: Point<Setup>| {
            let mut place = place;
            place.xyz[retract_axis] = clear;
            place
        };
        let (speed, corners) = match gap <= ROUNDING {
            true => (speed, [tip, tip, start]),
            false => (Speed::Rapid, [above(tip), above(start), start]),
        };
        let mut from = tip;
        for to in corners {
            if from.distance(to) > 1e-9 {
                self.say(
                    id,
                    StepKind::Move(Move {
                        path: Path::Line { from, to },
                        speed,
                        profile: None,
                        derived: true,
                    }),
                );
                from = to;
            }
        }
        self.run.gauge = machine_from_setup * start + self.run.offset.total();
    }

    pub(super) fn travel(&mut self, mut open: OpenPath) -> Result<(), Fault> {
        let id = open.toolpath.id;
        let mut pieces = Pieces::resume(self.program.aim(), open.pieces);
        let piece = pieces.next();
        open.pieces = pieces.into_state();
        match piece {
            None => self.say(id, StepKind::End(Level::Toolpath)),
            Some(Err(fault)) => return Err(placed(fault, id)),
            Some(Ok(piece)) => {
                self.go(&mut open, piece);
                self.run.tasks.push(Task::Path(Box::new(open)));
            }
        }
        Ok(())
    }

    fn go(&mut self, open: &mut OpenPath, path: Path<Setup>) {
        let profile = open.profile.as_ref().map(|(profile, total)| {
            let length = path.length();
            let from = if *total > 0.0 { open.travelled / total } else { 0.0 };
            open.travelled += length;
            let to = if *total > 0.0 { open.travelled / total } else { 1.0 };
            part_of(profile, from, to)
        });
        if let Some(frame) = self.run.frame {
            self.run.gauge = frame * path.end() + self.run.offset.total();
        }
        self.say(
            open.toolpath.id,
            StepKind::Move(Move {
                path,
                speed: open.speed,
                profile,
                derived: false,
            }),
        );
    }
}

/// Gaps between paths up to this come from rounded coordinates (four decimals in inches), mm.
const ROUNDING: f64 = 0.0026;

fn entity_origin(id: u64) -> Origin {
    Origin {
        file: FileId(0),
        place: Place::Entity(id),
    }
}

fn placed(mut fault: Fault, toolpath: u64) -> Fault {
    if fault.entity == 0 {
        fault.entity = toolpath;
    }
    fault
}

/// The part of a profile between two fractions of the whole path, spread over 0 to 1.
fn part_of(profile: &SpeedProfile, from: f64, to: f64) -> SpeedProfile {
    let width = to - from;
    let mut points = vec![(0.0, profile.factor(from))];
    if width > 0.0 {
        let inside = profile.points.iter().filter(|point| point.0 > from && point.0 < to);
        points.extend(inside.map(|point| ((point.0 - from) / width, point.1)));
    }
    points.push((1.0, profile.factor(to)));
    SpeedProfile { points }
}
