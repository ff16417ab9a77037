//! One as-executed model, entity by entity: workplans, workingsteps and toolpaths as they were executed.

use super::*;

pub(super) struct Writer<'w> {
    pub(super) sink: &'w mut dyn Sink,
    pub(super) program: Option<&'w Program>,
    pub(super) shared: Shared,
    /// Moments that are written already, by nanosecond.
    pub(super) dates: BTreeMap<i64, u64>,
    pub(super) roles: BTreeMap<&'static str, u64>,
    /// The offset of all times that are written: none.
    pub(super) utc: Option<u64>,
    /// Units of results that are neither lengths nor times.
    pub(super) units: BTreeMap<String, u64>,
    pub(super) new_file: bool,
    /// What other files' parts are called in this one, by their identifiers there.
    pub(super) anchored: BTreeMap<u64, u64>,
    /// Toolpaths without points.
    pub(super) left_out: u64,
    pub(super) options: &'w TwinOptions,
}

/// A workplan of the twin that is being filled.
pub(super) struct OpenPlan {
    /// The planned workplan, or a name.
    pub(super) key: (String, Option<u64>),
    pub(super) id: u64,
    pub(super) children: u32,
    pub(super) facts: Span,
}

/// When and how long.
#[derive(Clone, Copy)]
pub(super) struct Span {
    pub(super) start: Timestamp,
    pub(super) end: Timestamp,
    pub(super) worktime: Seconds,
}

impl Writer<'_> {
    pub(super) fn add(&mut self, body: impl AsRef<str>) -> Result<u64, EditError> {
        self.sink.add(body.as_ref())
    }

    /// Writes the executables of a run; the answer is its main workplan.
    pub(super) fn run(&mut self, run: &AsExecuted, main: Option<&Executable>) -> Result<u64, WriteError> {
        let source = match run.simulated && !run.source.contains("SIMULATED") {
            true => format!("SIMULATED: {}", run.source),
            false => run.source.clone(),
        };
        let name = match main {
            Some(main) => format!("{} / {}", main.name, run.name),
            None => run.name.clone(),
        };
        let machine = match &self.options.machine {
            Some((id, description)) => Some(self.add(format!(
                "MACHINING_MACHINE_USAGE({},{},'','')",
                encode(id),
                encode(description)
            ))?),
            None => None,
        };
        let id = self.add(format!("MACHINING_WORKPLAN({},'','','')", encode(&name)))?;
        let whole = Span {
            start: run.start,
            end: run.end,
            worktime: run.worktime,
        };
        // In a file of its own the run says by its number in the other file what it is a run of.
        let whole_plan = main.map(|main| main.id).or(run.plan.filter(|_| !self.anchored.is_empty()));
        let mut open = vec![OpenPlan {
            key: (name, whole_plan),
            id,
            children: 0,
            facts: whole,
        }];
        let mut tools: BTreeMap<u32, Vec<u64>> = BTreeMap::new();
        for workingstep in &run.workingsteps {
            self.arrange(&mut open, workingstep, &source)?;
            let (step, operation) = self.workingstep(workingstep, &source)?;
            if let Some(tool) = workingstep.tool {
                tools.entry(tool.0).or_default().push(operation);
            }
            if let Some(machine) = machine {
                self.add(format!("MACHINING_USAGE_RELATIONSHIP('','',#{step},#{machine})"))?;
            }
            if let Some(around) = open.last_mut() {
                around.children += 1;
                let (plan, place) = (around.id, around.children);
                self.add(format!(
                    "MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#{plan},#{step},{place}.)"
                ))?;
            }
        }
        while open.len() > 1 {
            self.close(&mut open, &source)?;
        }
        self.facts(id, whole, whole_plan, &source, run.exception.as_deref())?;
        if let Some(machine) = machine {
            self.add(format!("MACHINING_USAGE_RELATIONSHIP('','',#{id},#{machine})"))?;
        }
        if self.new_file {
            self.tools(&tools)?;
        }
        Ok(id)
    }

    /// Opens and closes workplans so that the innermost is the one around `workingstep`.
    pub(super) fn arrange(
        &mut self,
        open: &mut Vec<OpenPlan>,
        workingstep: &ExecutedWorkingstep,
        source: &str,
    ) -> Result<(), WriteError> {
        let main = open.first().and_then(|main| main.key.1);
        // The main workplan itself may be named as the outermost, or left out.
        let within = match workingstep.within.split_first() {
            Some((outermost, rest)) if main.is_some() && outermost.1 == main => rest,
            _ => &workingstep.within[..],
        };
        let same = open[1..]
            .iter()
            .zip(within)
            .take_while(|(plan, key)| plan.key == **key)
            .count();
        while open.len() > same + 1 {
            self.close(open, source)?;
        }
        for key in &within[same..] {
            let id = self.add(format!("MACHINING_WORKPLAN({},'','','')", encode(&key.0)))?;
            if let Some(around) = open.last_mut() {
                around.children += 1;
                let (plan, place) = (around.id, around.children);
                self.add(format!(
                    "MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#{plan},#{id},{place}.)"
                ))?;
            }
            open.push(OpenPlan {
                key: key.clone(),
                id,
                children: 0,
                facts: Span {
                    start: workingstep.start,
                    end: workingstep.end,
                    worktime: Seconds::ZERO,
                },
            });
        }
        for plan in &mut open[1..] {
            plan.facts.start = plan.facts.start.min(workingstep.start);
            plan.facts.end = plan.facts.end.max(workingstep.end);
            plan.facts.worktime += workingstep.worktime;
        }
        Ok(())
    }

    pub(super) fn close(&mut self, open: &mut Vec<OpenPlan>, source: &str) -> Result<(), WriteError> {
        if let Some(plan) = open.pop() {
            if let (Some(program), Some(entity)) = (self.program, plan.key.1) {
                planned(program, &plan.key.0, entity)?;
            }
            self.facts(plan.id, plan.facts, plan.key.1, source, None)?;
        }
        Ok(())
    }

    /// Writes one workingstep; the answer is it and its operation.
    pub(super) fn workingstep(&mut self, step: &ExecutedWorkingstep, source: &str) -> Result<(u64, u64), WriteError> {
        let plan = match (self.program, step.plan) {
            (Some(program), Some(entity)) => Some(planned(program, &step.name, entity)?),
            _ => None,
        };
        let planned_operation = plan.and_then(|plan| match plan.kind {
            ExecutableKind::Workingstep { operation, .. } => self.program?.operation(operation?),
            _ => None,
        });
        // An operation has four texts; others (probing, complex ones) carry more and are not copied.
        let plain = planned_operation.filter(|operation| {
            let count = self.program.and_then(|program| program.aim().instance(operation.id).ok());
            count.is_some_and(|instance| instance.records().len() == 1 && instance.records()[0].arguments.len() == 4)
        });
        let (kind, variant) = plain.map_or(("FREEFORM_MILLING_OPERATION", "finishing"), |operation| {
            (&operation.kind, &operation.variant)
        });
        let name = format!("{} as executed", step.name);
        let mut paths = Vec::new();
        for toolpath in &step.toolpaths {
            paths.extend(self.toolpath(toolpath)?);
        }
        let operation = self.add(format!("{kind}({},{},'','')", encode(&name), encode(variant)))?;
        for (place, path) in paths.iter().enumerate() {
            self.add(format!(
                "MACHINING_TOOLPATH_SEQUENCE_RELATIONSHIP('','',#{operation},#{path},{}.)",
                place + 1
            ))?;
        }
        let id = self.add(format!("MACHINING_WORKINGSTEP({},'machining','','')", encode(&name)))?;
        self.add(format!("MACHINING_OPERATION_RELATIONSHIP('','machining',#{id},#{operation})"))?;
        let feature = plan.and_then(|plan| self.program?.aim().links(plan.id).related("MACHINING_FEATURE_RELATIONSHIP"));
        let feature = feature.unwrap_or(self.shared.feature_process);
        self.add(format!("MACHINING_FEATURE_RELATIONSHIP('','machining',#{id},#{feature})"))?;
        let span = Span {
            start: step.start,
            end: step.end,
            worktime: step.worktime,
        };
        self.facts(id, span, step.plan, source, step.exception.as_deref())?;
        if let Some(deviation) = &step.deviation {
            self.deviation(id, deviation, step.end)?;
        }
        if let Some(time) = step.planned {
            self.result(id, "planned time", "derived", time.0, "s", step.end)?;
        }
        if let Some(tool) = step.tool
            && !self.new_file
        {
            let planned_tool = planned_operation.and_then(|operation| self.program?.tool_of(operation.id)?.number);
            if planned_tool != Some(tool) {
                self.result(id, "tool number", "measured", f64::from(tool.0), "tool", step.end)?;
            }
        }
        for result in &step.results {
            self.result(id, &result.name, &result.quality, result.value, &result.unit, result.at)?;
        }
        Ok((id, operation))
    }

    /// Writes one toolpath; `None` when it is no dwell and has no points.
    pub(super) fn toolpath(&mut self, path: &ExecutedToolpath) -> Result<Option<u64>, WriteError> {
        if path.points.is_empty() && path.kind != PathKind::Dwell {
            self.left_out += 1;
            return Ok(None);
        }
        if path.points.iter().any(|point| !point.position.is_finite()) {
            return Err(WriteError::NotFinite(path.name.clone()));
        }
        let plan = match (self.program, path.plan) {
            (Some(program), Some(id)) if program.file().row(id).is_some() => Some(program.toolpath(id)),
            (Some(program), Some(entity)) => {
                return Err(WriteError::NotInPlan {
                    name: path.name.clone(),
                    entity,
                    file: program.name().to_string(),
                });
            }
            _ => None,
        };
        let units = plan
            .as_ref()
            .and_then(|plan| Some((plan.context?, self.program?.units_of(plan).ok()?)));
        let (context, millimetres) = match units {
            Some((context, units)) => (context, units.millimetres),
            None => (self.millimetre_context()?, 1.0),
        };
        let description = if path.kind == PathKind::Dwell {
            "feedstop"
        } else {
            "cutter location trajectory"
        };
        let mut points = Vec::with_capacity(path.points.len().max(2));
        if path.kind != PathKind::Dwell {
            for point in &path.points {
                points.push(self.point(point.position, millimetres)?);
            }
            if let [only] = path.points.as_slice() {
                points.push(self.point(only.position, millimetres)?); // a polyline has two points
            }
        }
        let id = if points.is_empty() {
            self.add(format!("MACHINING_TOOLPATH({},'{description}','','')", encode(&path.name)))?
        } else {
            let list: Vec<String> = points.iter().map(|point| format!("#{point}")).collect();
            let curve = self.add(format!("POLYLINE('',({}))", list.join(",")))?;
            let id = self.add(format!("MACHINING_TOOLPATH({},'{description}','','')", encode(&path.name)))?;
            let representation = self.add(format!("REPRESENTATION('',(#{curve}),#{context})"))?;
            self.property(id, "basic curve", representation)?;
            id
        };
        let required = self.shared.required;
        self.property(id, "priority", required)?;
        if path.kind == PathKind::Rapid {
            let rapid = self.shared.rapid;
            self.property(id, "speed profile", rapid)?;
        }
        if path.kind == PathKind::Dwell {
            let item = self.time("dwell time", path.end.since(path.start).max(Seconds::ZERO))?;
            let no_units = self.shared.no_units;
            let representation = self.add(format!(
                "MACHINING_DWELL_TIME_REPRESENTATION('dwell time',(#{item}),#{no_units})"
            ))?;
            self.property(id, "dwell", representation)?;
        }
        self.date(id, "twin start", path.start)?;
        self.date(id, "twin end", path.end)?;
        if let Some(plan) = self.link(path.plan) {
            self.add(format!("MACHINING_TWIN_RELATIONSHIP('','',#{id},#{plan})"))?;
        }
        if path.kind == PathKind::Feed && path.speed.0 > 0.0 && path.speed.is_finite() {
            if self.new_file {
                self.technology(id, path.speed)?;
            } else {
                self.result(id, MEAN_SPEED, "derived", path.speed.0, "mm/s", path.end)?;
            }
        }
        if let Some(deviation) = &path.deviation {
            self.deviation(id, deviation, path.end)?;
        }
        Ok(Some(id))
    }

    pub(super) fn millimetre_context(&mut self) -> Result<u64, EditError> {
        let id = match self.shared.context {
            Some(id) => id,
            None => geometric_context(self.sink, self.shared.millimetre)?,
        };
        self.shared.context = Some(id);
        Ok(id)
    }

    pub(super) fn point(&mut self, point: Point<units::Setup>, millimetres: f64) -> Result<u64, EditError> {
        // Rounded to a nanometre of the file's unit: recorded positions are no finer, and the text stays readable.
        let number = |c: f64| {
            let c = libm::round(c / millimetres * 1e9) / 1e9;
            real(if c == 0.0 { 0.0 } else { c })
        };
        let [x, y, z] = point.xyz.map(number);
        self.add(format!("CARTESIAN_POINT('',({x},{y},{z}))"))
    }

    pub(super) fn technology(&mut self, path: u64, speed: MmPerSec) -> Result<(), EditError> {
        let unit = self.context_unit("mm/s")?;
        let technology = self.add("MACHINING_TECHNOLOGY('mean of the measured speed','milling','','')")?;
        let item = self.add(format!(
            "MEASURE_REPRESENTATION_ITEM('feed speed',NUMERIC_MEASURE({}),#{unit})",
            real(speed.0)
        ))?;
        let no_units = self.shared.no_units;
        let representation = self.add(format!(
            "MACHINING_FEED_SPEED_REPRESENTATION('feed speed',(#{item}),#{no_units})"
        ))?;
        self.property(technology, "feedrate", representation)?;
        self.add(format!("MACHINING_TECHNOLOGY_RELATIONSHIP('','',#{path},#{technology})"))?;
        Ok(())
    }

    pub(super) fn tools(&mut self, tools: &BTreeMap<u32, Vec<u64>>) -> Result<(), EditError> {
        for (number, users) in tools {
            let kind = self.add("ACTION_RESOURCE_TYPE('milling cutting tool')")?;
            let users: Vec<String> = users.iter().map(|user| format!("#{user}")).collect();
            self.add(format!(
                "MACHINING_TOOL('{number}','user defined milling tool',({}),#{kind})",
                users.join(",")
            ))?;
        }
        Ok(())
    }

    /// What a planned part is called in the file that is written.
    pub(super) fn link(&self, plan: Option<u64>) -> Option<u64> {
        if self.new_file {
            return self.anchored.get(&plan?).copied();
        }
        plan
    }

    /// What makes an executable a twin.
    pub(super) fn facts(
        &mut self,
        id: u64,
        span: Span,
        plan: Option<u64>,
        source: &str,
        exception: Option<&str>,
    ) -> Result<(), WriteError> {
        self.date(id, "twin start", span.start)?;
        self.date(id, "twin end", span.end)?;
        if let Some(plan) = self.link(plan) {
            self.add(format!("MACHINING_TWIN_RELATIONSHIP('','',#{id},#{plan})"))?;
        }
        self.describe(id, "twin source", source)?;
        let item = self.time("twin worktime", span.worktime)?;
        let representation = self.representation(item)?;
        self.property(id, "twin worktime", representation)?;
        if let Some(exception) = exception {
            self.describe(id, "twin exception", exception)?;
        }
        Ok(())
    }

    pub(super) fn project(&mut self, name: &str, main: u64) -> Result<(), WriteError> {
        let (name, product_context, definition_context) =
            (encode(name), self.shared.product_context, self.shared.definition_context);
        let project = self.add(format!("MACHINING_PROJECT({name},{name},$,(#{product_context}))"))?;
        let formation = self.add(format!("PRODUCT_DEFINITION_FORMATION('1','',#{project})"))?;
        let definition = self.add(format!("PRODUCT_DEFINITION('','',#{formation},#{definition_context})"))?;
        let process = self.add(format!("PRODUCT_DEFINITION_PROCESS('machining','',#{main},'')"))?;
        self.add(format!("PROCESS_PRODUCT_ASSOCIATION('','',#{definition},#{process})"))?;
        let workpiece = self.shared.workpiece;
        self.add(format!(
            "MACHINING_PROJECT_WORKPIECE_RELATIONSHIP('','workpiece','',#{definition},#{workpiece})"
        ))?;
        if let Some(operator) = &self.options.operator {
            let operator = encode(operator);
            let person = self.add(format!("PERSON({operator},{operator},$,$,$,$)"))?;
            let organization = self.add("ORGANIZATION($,'',$)")?;
            let both = self.add(format!("PERSON_AND_ORGANIZATION(#{person},#{organization})"))?;
            let role = self.add("PERSON_AND_ORGANIZATION_ROLE('operator')")?;
            self.add(format!(
                "APPLIED_PERSON_AND_ORGANIZATION_ASSIGNMENT(#{both},#{role},(#{definition}))"
            ))?;
        }
        Ok(())
    }

    pub(super) fn property(&mut self, owner: u64, name: &str, representation: u64) -> Result<u64, EditError> {
        let property = self.add(format!("ACTION_PROPERTY('{name}','',#{owner})"))?;
        self.add(format!("ACTION_PROPERTY_REPRESENTATION('','',#{property},#{representation})"))
    }

    pub(super) fn representation(&mut self, item: u64) -> Result<u64, EditError> {
        let no_units = self.shared.no_units;
        self.add(format!("REPRESENTATION('',(#{item}),#{no_units})"))
    }

    pub(super) fn describe(&mut self, owner: u64, name: &str, text: &str) -> Result<u64, EditError> {
        let item = self.add(format!("DESCRIPTIVE_REPRESENTATION_ITEM('',{})", encode(text)))?;
        let representation = self.representation(item)?;
        self.property(owner, name, representation)
    }

    pub(super) fn time(&mut self, name: &str, time: Seconds) -> Result<u64, EditError> {
        let (name, value, unit) = (encode(name), real(time.0), self.shared.second);
        self.add(format!(
            "(MEASURE_REPRESENTATION_ITEM() MEASURE_WITH_UNIT(TIME_MEASURE({value}),#{unit}) REPRESENTATION_ITEM({name}) TIME_MEASURE_WITH_UNIT())"
        ))
    }

    pub(super) fn length(&mut self, name: &str, length: Millimetres) -> Result<u64, EditError> {
        let (name, value, unit) = (encode(name), real(length.0), self.shared.millimetre);
        self.add(format!(
            "(LENGTH_MEASURE_WITH_UNIT() MEASURE_REPRESENTATION_ITEM() MEASURE_WITH_UNIT(LENGTH_MEASURE({value}),#{unit}) REPRESENTATION_ITEM({name}))"
        ))
    }

    /// A unit by its name; speeds are derived properly, anything else depends on its context.
    pub(super) fn context_unit(&mut self, name: &str) -> Result<u64, EditError> {
        if let Some(&id) = self.units.get(name) {
            return Ok(id);
        }
        let id = if name == "mm/s" {
            let (millimetre, second) = (self.shared.millimetre, self.shared.second);
            let above = self.add(format!("DERIVED_UNIT_ELEMENT(#{millimetre},1.)"))?;
            let below = self.add(format!("DERIVED_UNIT_ELEMENT(#{second},-1.)"))?;
            self.add(format!("DERIVED_UNIT((#{above},#{below}))"))?
        } else {
            let dimensionless = self.shared.dimensionless;
            self.add(format!("CONTEXT_DEPENDENT_UNIT(#{dimensionless},{})", encode(name)))?
        };
        self.units.insert(name.to_string(), id);
        Ok(id)
    }

    pub(super) fn deviation(&mut self, owner: u64, deviation: &Deviation, at: Timestamp) -> Result<(), EditError> {
        self.result(owner, DEVIATION_MAX, "derived", deviation.max.0, "mm", at)?;
        self.result(owner, DEVIATION_P95, "derived", deviation.p95.0, "mm", at)?;
        self.result(owner, DEVIATION_RMS, "derived", deviation.rms.0, "mm", at)?;
        self.result(owner, DEVIATION_SAMPLES, "measured", deviation.samples as f64, "count", at)
    }

    /// A dated process property with a number.
    pub(super) fn result(
        &mut self,
        owner: u64,
        name: &str,
        quality: &str,
        value: f64,
        unit: &str,
        at: Timestamp,
    ) -> Result<(), EditError> {
        let item = match unit {
            "mm" => self.length(name, Millimetres(value))?,
            "s" => self.time(name, Seconds(value))?,
            _ => {
                let id = self.context_unit(unit)?;
                let measure = if unit == "count" { "COUNT_MEASURE" } else { "NUMERIC_MEASURE" };
                self.add(format!(
                    "MEASURE_REPRESENTATION_ITEM({},{measure}({}),#{id})",
                    encode(name),
                    real(value)
                ))?
            }
        };
        let representation = self.representation(item)?;
        let property = self.add(format!(
            "MACHINING_PROCESS_PROPERTY({},{},#{owner})",
            encode(name),
            encode(quality)
        ))?;
        self.add(format!("ACTION_PROPERTY_REPRESENTATION('','',#{property},#{representation})"))?;
        self.date(property, "property date", at)
    }

    pub(super) fn date(&mut self, owner: u64, role: &'static str, at: Timestamp) -> Result<(), EditError> {
        let role = match self.roles.get(role) {
            Some(&id) => id,
            None => {
                let id = self.add(format!("DATE_TIME_ROLE('{role}')"))?;
                self.roles.insert(role, id);
                id
            }
        };
        let moment = match self.dates.get(&at.0) {
            Some(&id) => id,
            None => {
                let civil = Civil::of(at);
                let zone = match self.utc {
                    Some(id) => id,
                    None => self.add("COORDINATED_UNIVERSAL_TIME_OFFSET(0,$,.EXACT.)")?,
                };
                self.utc = Some(zone);
                let date = self.add(format!("CALENDAR_DATE({},{},{})", civil.year, civil.day, civil.month))?;
                let time = self.add(format!(
                    "LOCAL_TIME({},{},{},#{zone})",
                    civil.hour,
                    civil.minute,
                    civil.seconds()
                ))?;
                let id = self.add(format!("DATE_AND_TIME(#{date},#{time})"))?;
                self.dates.insert(at.0, id);
                id
            }
        };
        self.add(format!("APPLIED_DATE_AND_TIME_ASSIGNMENT(#{moment},#{role},(#{owner}))"))?;
        Ok(())
    }
}
