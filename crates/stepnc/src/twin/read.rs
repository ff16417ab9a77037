//! The runs that a file tells of, as [`super::append`] and others write them.

use super::{DEVIATION_MAX, DEVIATION_P95, DEVIATION_RMS, DEVIATION_SAMPLES, MEAN_SPEED, TwinRun};
use crate::aim::{Aim, Links};
use crate::date;
use crate::model::{Executable, ExecutableKind, Program, Toolpath, ToolpathKind, TwinFacts};
use crate::unit;
use plan::executed::{AsExecuted, Deviation, ExecutedPoint, ExecutedToolpath, ExecutedWorkingstep, PathKind, ResultValue};
use units::{Millimetres, MmPerSec, Point, Seconds, Timestamp};

pub(super) struct Reader<'r> {
    pub(super) program: &'r Program,
    pub(super) plan: &'r Program,
}

impl Reader<'_> {
    pub(super) fn runs(&self) -> Vec<TwinRun> {
        let mut runs = Vec::new();
        // A twin is a project of its own, or a workplan inside its plan.
        for project in self.program.projects() {
            let mut roots = Vec::new();
            let mut below_twins = std::collections::BTreeSet::new();
            self.program.walk(project.main_workplan, &mut |executable, _| {
                if executable.twin.is_none() {
                    return;
                }
                if !below_twins.contains(&executable.id) && matches!(executable.kind, ExecutableKind::Workplan(_)) {
                    roots.push(executable.id);
                }
                below_twins.extend(executable.children());
            });
            runs.extend(roots.into_iter().filter_map(|root| self.run(root, &project.name)));
        }
        runs
    }

    fn run(&self, root: u64, project: &str) -> Option<TwinRun> {
        let main = self.program.executable(root)?;
        let facts = main.twin.as_ref()?;
        let source = facts.source.clone().unwrap_or_default();
        let mut run = AsExecuted {
            name: main
                .name
                .rsplit(" / ")
                .next()
                .filter(|name| *name != main.name)
                .unwrap_or(project)
                .to_string(),
            simulated: source.contains("SIMULATED"),
            source,
            start: facts.start.unwrap_or_default(),
            end: facts.end.or(facts.start).unwrap_or_default(),
            worktime: facts.worktime.unwrap_or_default(),
            exception: facts.exception.clone(),
            plan: self.in_plan(facts.plan),
            workingsteps: Vec::new(),
        };
        let within = vec![(main.name.clone(), run.plan)];
        self.collect(main, &within, &mut Vec::new(), &mut run.workingsteps);
        Some(TwinRun {
            run,
            entity: root,
            external_plan: facts
                .plan
                .and_then(|plan| self.program.file().external(plan))
                .map(str::to_string),
        })
    }

    /// The identifier that a link has in the plan: directly, or by the anchor that a REFERENCE entry names.
    fn in_plan(&self, link: Option<u64>) -> Option<u64> {
        let link = link?;
        let Some(uri) = self.program.file().external(link) else {
            return Some(link);
        };
        let (_, name) = uri.split_once('#')?;
        let anchor = self.plan.file().anchors().iter().find(|anchor| anchor.name == name)?;
        anchor.value.reference()
    }

    fn collect(
        &self,
        around: &Executable,
        within: &[(String, Option<u64>)],
        above: &mut Vec<u64>,
        out: &mut Vec<ExecutedWorkingstep>,
    ) {
        if above.contains(&around.id) || above.len() > 100 {
            return;
        }
        above.push(around.id);
        for child in around.children() {
            let Some(child) = self.program.executable(child) else {
                continue;
            };
            match &child.kind {
                ExecutableKind::Workingstep { .. } => out.extend(self.workingstep(child, within)),
                _ => {
                    let plan = child.twin.as_ref().and_then(|twin| self.in_plan(twin.plan));
                    let mut inner = within.to_vec();
                    inner.push((child.name.clone(), plan));
                    self.collect(child, &inner, above, out);
                }
            }
        }
        above.pop();
    }

    fn workingstep(&self, step: &Executable, within: &[(String, Option<u64>)]) -> Option<ExecutedWorkingstep> {
        let facts = step.twin.clone().unwrap_or(TwinFacts {
            start: None,
            end: None,
            plan: None,
            source: None,
            worktime: None,
            exception: None,
        });
        let operation_of = |program: &'_ Program, executable: &Executable| match executable.kind {
            ExecutableKind::Workingstep { operation, .. } => operation.and_then(|id| program.operation(id).cloned()),
            _ => None,
        };
        let plan = self.in_plan(facts.plan);
        let planned = plan.and_then(|id| self.plan.executable(id));
        let planned_operation = planned.and_then(|planned| operation_of(self.plan, planned));
        let mut unmatched: Vec<Toolpath> = planned_operation
            .iter()
            .flat_map(|operation| &operation.toolpaths)
            .map(|&id| self.plan.toolpath(id))
            .collect();
        let operation = operation_of(self.program, step);
        let start = facts.start.unwrap_or_default();
        let end = facts.end.unwrap_or(start);
        let mut toolpaths = Vec::new();
        let mut dated = false;
        for &id in operation.iter().flat_map(|operation| &operation.toolpaths) {
            let path = self.program.toolpath(id);
            dated |= path
                .twin
                .as_ref()
                .is_some_and(|twin| twin.start.is_some() || twin.end.is_some());
            let link = path.twin.as_ref().and_then(|twin| self.in_plan(twin.plan));
            let place = match link {
                Some(link) => unmatched.iter().position(|planned| planned.id == link),
                None => unmatched.iter().position(|planned| planned.name == path.name),
            };
            let plan = link.or(place.map(|place| unmatched[place].id));
            if let Some(place) = place {
                unmatched.remove(place);
            }
            toolpaths.push(self.toolpath(&path, plan, start, end));
        }
        if !dated {
            one_after_the_other(&mut toolpaths, start, end);
        }
        let (deviation, _, mut results) = self.results(step.id, end);
        let planned_time = take(&mut results, "planned time").map(Seconds);
        let written_tool = take(&mut results, "tool number").map(|number| units::ToolNumber(number as u32));
        let own_tool = operation.and_then(|operation| self.program.tool_of(operation.id)?.number);
        let planned_tool = planned_operation.and_then(|operation| self.plan.tool_of(operation.id)?.number);
        Some(ExecutedWorkingstep {
            name: step.name.strip_suffix(" as executed").unwrap_or(&step.name).to_string(),
            plan,
            within: within.to_vec(),
            start,
            end,
            worktime: facts.worktime.unwrap_or_default(),
            planned: planned_time,
            exception: facts.exception,
            tool: written_tool.or(own_tool).or(planned_tool),
            deviation,
            toolpaths,
            results,
        })
    }

    fn toolpath(&self, path: &Toolpath, plan: Option<u64>, around_start: Timestamp, around_end: Timestamp) -> ExecutedToolpath {
        let dates = path.twin.as_ref();
        let start = dates.and_then(|twin| twin.start).unwrap_or(around_start);
        let end = dates.and_then(|twin| twin.end).unwrap_or(around_end);
        let mut places: Vec<(f64, Point<units::Setup>)> = Vec::new();
        let mut length = 0.0;
        // A curve that cannot be read to its end gives its points up to there.
        let pieces = self.program.pieces(path).into_iter().flatten();
        for piece in pieces.map_while(Result::ok) {
            let whole = piece.length();
            piece.flatten(0.001, 10_000, |u, place| {
                if u > 0.0 || places.is_empty() {
                    places.push((length + u * whole, place));
                }
            });
            length += whole;
        }
        if places.is_empty() {
            places.extend(self.only_place(path).map(|place| (0.0, place)));
        }
        let duration = end.since(start);
        let points = places
            .into_iter()
            .map(|(along, position)| ExecutedPoint {
                at: if length > 0.0 {
                    start + duration * (along / length)
                } else {
                    start
                },
                position,
            })
            .collect();
        let (deviation, speed, _) = self.results(path.id, end);
        let timed = dates.is_some_and(|twin| twin.start.is_some() && twin.end.is_some()) && duration.0 > 0.0;
        let speed = speed.unwrap_or(if timed { length / duration.0 } else { 0.0 });
        ExecutedToolpath {
            name: path.name.clone(),
            plan,
            kind: match path.kind {
                ToolpathKind::Rapid => PathKind::Rapid,
                ToolpathKind::Feed => PathKind::Feed,
                ToolpathKind::Dwell => PathKind::Dwell,
            },
            start,
            end,
            points,
            speed: MmPerSec(speed),
            deviation,
        }
    }

    /// The place of a toolpath of a single sample: its polyline has no length.
    fn only_place(&self, path: &Toolpath) -> Option<Point<units::Setup>> {
        let (_, curve) = path.curve?;
        let units = self.program.units_of(path).ok()?;
        let aim = self.program.aim();
        if aim.keyword(curve) != "POLYLINE" {
            return None;
        }
        let first = aim.instance(curve).ok()?.argument(1).references().next()?;
        crate::curve::point(aim, first, units.millimetres).ok()
    }

    /// The dated process properties of an object: deviation, mean speed, and all others.
    fn results(&self, owner: u64, end: Timestamp) -> (Option<Deviation>, Option<f64>, Vec<ResultValue>) {
        let aim = self.program.aim();
        let links: Links = aim.links(owner);
        let mut results = Vec::new();
        for (name, representation, property) in &links.properties {
            if aim.keyword(*property) != "MACHINING_PROCESS_PROPERTY" {
                continue;
            }
            let Ok(representation) = aim.representation(*representation) else {
                continue;
            };
            let Some(&item) = representation.items.first() else { continue };
            let Ok(measure) = aim.measure(item) else { continue };
            let quality = aim
                .instance(*property)
                .map(|instance| crate::aim::text(instance.argument(1)).into_owned())
                .unwrap_or_default();
            let dates = aim.links(*property).dates;
            let at = dates
                .iter()
                .find(|(role, _)| role == "property date")
                .and_then(|(_, id)| date::read(aim, *id));
            results.push(ResultValue {
                name: name.clone(),
                value: measure.value,
                unit: unit_name(aim, item, measure.dimension),
                quality,
                at: at.unwrap_or(end),
            });
        }
        let deviation = take(&mut results, DEVIATION_MAX).map(|max| Deviation {
            max: Millimetres(max),
            // Files of others may give the largest only: then it bounds the other two.
            p95: Millimetres(take(&mut results, DEVIATION_P95).unwrap_or(max)),
            rms: Millimetres(take(&mut results, DEVIATION_RMS).unwrap_or(max)),
            samples: take(&mut results, DEVIATION_SAMPLES).unwrap_or(0.0) as u64,
        });
        let speed = take(&mut results, MEAN_SPEED);
        (deviation, speed, results)
    }
}

/// Toolpaths without dates of their own share the time of their workingstep by length, in their order.
fn one_after_the_other(toolpaths: &mut [ExecutedToolpath], start: Timestamp, end: Timestamp) {
    let step = |pair: &[ExecutedPoint]| pair[0].position.distance(pair[1].position);
    let length = |path: &ExecutedToolpath| path.points.windows(2).map(step).sum::<f64>();
    let whole: f64 = toolpaths.iter().map(length).sum();
    if !(whole > 0.0 && whole.is_finite()) {
        return;
    }
    let duration = end.since(start);
    let mut along = 0.0;
    for path in toolpaths {
        path.start = start + duration * (along / whole);
        let mut last: Option<Point<units::Setup>> = None;
        for point in &mut path.points {
            along += last.map_or(0.0, |last| last.distance(point.position));
            last = Some(point.position);
            point.at = start + duration * (along / whole);
        }
        path.end = start + duration * (along / whole);
    }
}

fn take(results: &mut Vec<ResultValue>, name: &str) -> Option<f64> {
    let place = results.iter().position(|result| result.name == name)?;
    Some(results.remove(place).value)
}

/// The unit of a result as its value was converted, or the name of a unit that depends on its context.
fn unit_name(aim: Aim, item: u64, dimension: unit::Dimension) -> String {
    match dimension {
        unit::LENGTH => return "mm".into(),
        unit::TIME => return "s".into(),
        unit::SPEED => return "mm/s".into(),
        unit::ANGLE => return "rad".into(),
        _ => {}
    }
    let Ok(instance) = aim.instance(item) else {
        return String::new();
    };
    let unit = instance
        .records()
        .iter()
        .flat_map(|record| &record.arguments)
        .rev()
        .find_map(part21::Value::reference);
    unit.and_then(|unit| aim.description(unit)).unwrap_or_default()
}
