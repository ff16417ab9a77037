//! What stands around the paths: technologies, workplans and set-ups, written when all of the program is known.

use super::*;

impl Writer<'_> {
    pub(super) fn finish(mut self) -> Result<Written, ConvertError> {
        self.close_step();
        self.tell_tool();
        if self.children.is_empty() {
            return Err(ConvertError::Empty);
        }
        if !self.registers.is_empty() {
            let names: Vec<String> = std::mem::take(&mut self.registers).into_iter().collect();
            self.notices.insert(format!(
                "the program writes registers of the machine ({}); STEP-NC has none: they are left out, and moves are as they made them",
                names.join(", ")
            ));
        }
        self.technologies();
        self.workplans();
        let tools = std::mem::take(&mut self.tools);
        let used = || tools.iter().filter(|tool| !tool.users.is_empty());
        for tool in used() {
            tool.write(&mut self.sheet, self.options.turning, &self.options.tables);
        }
        let options = self.options;
        Ok(Written {
            tools: used().count() as u32,
            bytes: self.sheet.into_file(
                &format!("made from {}", options.made_from),
                &options.name,
                options.written,
                &options.author,
                &options.writer,
            ),
            workingsteps: self.workingsteps,
            toolpaths: self.toolpaths,
            notices: self.notices.into_iter().collect(),
        })
    }

    /// Technologies come last: a rapid path before the first cut is told the feed of that cut.
    pub(super) fn technologies(&mut self) {
        let links = std::mem::take(&mut self.technology_links);
        let mut resolved: Vec<(u64, Technology)> = Vec::with_capacity(links.len());
        let mut next = None;
        for &(owner, technology) in links.iter().rev() {
            next = technology.feed.or(next);
            let feed = technology.feed.or(next);
            resolved.push((owner, Technology { feed, ..technology }));
        }
        resolved.reverse();
        let mut before = None;
        let mut known: BTreeMap<Technology, u64> = BTreeMap::new();
        for (owner, mut technology) in resolved {
            technology.feed = technology.feed.or(before);
            before = technology.feed;
            // Without a single feed in the whole program there is none to tell.
            if technology.feed.is_none() && technology.spindle == SpindleKey::Stopped {
                continue;
            }
            let id = match known.get(&technology) {
                Some(&id) => id,
                None => {
                    let id = self.write_technology(technology);
                    known.insert(technology, id);
                    id
                }
            };
            self.sheet
                .add(format!("MACHINING_TECHNOLOGY_RELATIONSHIP('','',#{owner},#{id})"));
        }
    }

    pub(super) fn write_technology(&mut self, technology: Technology) -> u64 {
        let turning = self.options.turning;
        let sheet = &mut self.sheet;
        let (per_unit, no_units) = (sheet.millimetres_per_unit(), sheet.no_units);
        let kind = if turning { "turning" } else { "milling" };
        let id = sheet.add(format!("MACHINING_TECHNOLOGY('','{kind}','','')"));
        let feed = technology.feed.unwrap_or(FeedKey {
            per_revolution: false,
            synchronized: false,
            value: 0,
        });
        let value = f64::from_bits(feed.value) / per_unit;
        let (name, item) = if feed.per_revolution {
            let name = "feed per revolution";
            (name, sheet.speed_item(name, value, SpeedUnit::LengthPerRevolution))
        } else {
            let name = "feed speed";
            (name, sheet.speed_item(name, value * 60.0, SpeedUnit::LengthPerMinute))
        };
        let representation = sheet.add(format!("MACHINING_FEED_SPEED_REPRESENTATION('{name}',(#{item}),#{no_units})"));
        sheet.property(id, "feedrate", representation);
        let (name, items) = match technology.spindle {
            SpindleKey::Stopped => (
                "spindle speed",
                vec![("rotational speed", 0.0, SpeedUnit::RevolutionsPerMinute)],
            ),
            SpindleKey::Revolutions(n) => (
                "spindle speed",
                vec![("rotational speed", f64::from_bits(n), SpeedUnit::RevolutionsPerMinute)],
            ),
            SpindleKey::Surface(speed, limit) => (
                "cutting speed",
                vec![
                    ("surface speed", f64::from_bits(speed) * 0.06, SpeedUnit::MetresPerMinute),
                    (
                        "maximum rotational speed",
                        f64::from_bits(limit),
                        SpeedUnit::RevolutionsPerMinute,
                    ),
                ],
            ),
        };
        let items: Vec<String> = items
            .into_iter()
            .map(|(name, value, unit)| format!("#{}", sheet.speed_item(name, value, unit)))
            .collect();
        let representation = sheet.add(format!(
            "MACHINING_SPINDLE_SPEED_REPRESENTATION('{name}',({}),#{no_units})",
            items.join(",")
        ));
        sheet.property(id, "spindle", representation);
        if feed.synchronized {
            let synchronized = sheet.says("synchronized");
            let name = if turning {
                "synchronize spindle with z feed"
            } else {
                "synchronize spindle with feed"
            };
            sheet.property(id, name, synchronized);
        }
        id
    }

    /// One workplan with the set-up, or one for each run of executables in the same set-up.
    pub(super) fn workplans(&mut self) {
        let children = std::mem::take(&mut self.children);
        let bases = std::mem::take(&mut self.bases);
        let main = self
            .sheet
            .add(format!("MACHINING_WORKPLAN({},'','','')", encode(&self.options.name)));
        let setups: Vec<u64> = bases.iter().map(|base| self.setup(base)).collect();
        let only = children.iter().all(|(base, _)| *base == children[0].0);
        if only {
            self.begins(main, setups[children[0].0]);
            self.sequence(main, children.iter().map(|(_, child)| *child));
        } else {
            let mut plans = Vec::new();
            for run in children.chunk_by(|a, b| a.0 == b.0) {
                let base = run[0].0;
                let name = encode(&bases[base].name);
                let plan = self.sheet.add(format!("MACHINING_WORKPLAN({name},'','','')"));
                self.begins(plan, setups[base]);
                self.sequence(plan, run.iter().map(|(_, child)| *child));
                plans.push(plan);
            }
            self.sequence(main, plans.into_iter());
        }
        let (product_context, definition_context, workpiece) =
            (self.sheet.product_context, self.sheet.definition_context, self.workpiece);
        let name = encode(&self.options.name);
        let sheet = &mut self.sheet;
        let project = sheet.add(format!("MACHINING_PROJECT({name},{name},$,(#{product_context}))"));
        let formation = sheet.add(format!("PRODUCT_DEFINITION_FORMATION('1','',#{project})"));
        let definition = sheet.add(format!("PRODUCT_DEFINITION('','',#{formation},#{definition_context})"));
        let process = sheet.add(format!("PRODUCT_DEFINITION_PROCESS('machining','',#{main},'')"));
        sheet.add(format!("PROCESS_PRODUCT_ASSOCIATION('','',#{definition},#{process})"));
        sheet.add(format!(
            "MACHINING_PROJECT_WORKPIECE_RELATIONSHIP('','workpiece','',#{definition},#{workpiece})"
        ));
    }

    pub(super) fn sequence(&mut self, plan: u64, children: impl Iterator<Item = u64>) {
        for (n, child) in children.enumerate() {
            self.sheet.add(format!(
                "MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#{plan},#{child},{}.)",
                n + 1
            ));
        }
    }

    pub(super) fn begins(&mut self, plan: u64, setup: u64) {
        let process = self.sheet.add(format!("PRODUCT_DEFINITION_PROCESS('setup','',#{plan},'')"));
        self.sheet
            .add(format!("PROCESS_PRODUCT_ASSOCIATION('','',#{setup},#{process})"));
    }

    pub(super) fn setup(&mut self, base: &Base) -> u64 {
        let (product_context, definition_context, context) =
            (self.sheet.product_context, self.sheet.definition_context, self.sheet.context);
        let (workpiece, workpiece_shape, workpiece_origin) = (self.workpiece, self.workpiece_shape, self.workpiece_origin);
        let sheet = &mut self.sheet;
        let name = encode(if base.name.is_empty() { "set-up" } else { &base.name });
        let product = sheet.add(format!("MACHINING_SETUP({name},{name},$,(#{product_context}))"));
        let formation = sheet.add(format!("PRODUCT_DEFINITION_FORMATION('1','',#{product})"));
        let setup = sheet.add(format!("PRODUCT_DEFINITION('','',#{formation},#{definition_context})"));
        let height = if base.highest.is_finite() { base.highest } else { 0.0 };
        let placement = sheet.placement("", [0.0, 0.0, height], [0.0, 0.0, 1.0], Some([1.0, 0.0, 0.0]));
        let plane = sheet.add(format!("PLANE('',#{placement})"));
        let representation = sheet.add(format!("REPRESENTATION('',(#{plane}),#{context})"));
        let property = sheet.add(format!("PROPERTY_DEFINITION('security plane','',#{setup})"));
        sheet.add(format!("PROPERTY_DEFINITION_REPRESENTATION(#{property},#{representation})"));
        // An assumed offset is nobody's: the next machine has its own.
        let place = if base.assumed {
            Transform::IDENTITY
        } else {
            base.machine_from_setup
        };
        let origin = sheet.frame("orientation", &place);
        let there = sheet.frame("workpiece", &Transform::<Setup, Setup>::IDENTITY);
        let shape_representation = sheet.add(format!("SHAPE_REPRESENTATION('',(#{origin},#{there}),#{context})"));
        if !base.assumed {
            let shape = sheet.add(format!("PRODUCT_DEFINITION_SHAPE('orientation','',#{setup})"));
            sheet.add(format!("SHAPE_DEFINITION_REPRESENTATION(#{shape},#{shape_representation})"));
        }
        let relation = sheet.add(format!(
            "MACHINING_SETUP_WORKPIECE_RELATIONSHIP('','workpiece setup','',#{setup},#{workpiece})"
        ));
        let shape = sheet.add(format!("PRODUCT_DEFINITION_SHAPE('','',#{relation})"));
        let transformation = sheet.add(format!("ITEM_DEFINED_TRANSFORMATION('','',#{workpiece_origin},#{there})"));
        let relationship = sheet.add(format!(
            "(REPRESENTATION_RELATIONSHIP('','',#{workpiece_shape},#{shape_representation}) \
             REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION(#{transformation}) SHAPE_REPRESENTATION_RELATIONSHIP())"
        ));
        sheet.add(format!("CONTEXT_DEPENDENT_SHAPE_REPRESENTATION(#{relationship},#{shape})"));
        setup
    }
}
