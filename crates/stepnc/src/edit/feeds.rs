//! Feeds: a number is changed where it stands when it is the owner's alone, else the owner gets a technology of its own.

use super::owners::Removal;
use super::places::TOOLPATHS;
use super::{ChangeError, ProgramEdits, unfit};
use crate::model::{ExecutableKind, FeedSetting, ToolpathKind};
use crate::select::Part;
use crate::unit;
use part21::Value;
use part21::text::{encode, real};
use units::MmPerSec;

const TECHNOLOGY: &str = "MACHINING_TECHNOLOGY_RELATIONSHIP";

impl ProgramEdits<'_> {
    /// Sets the feed of a toolpath, or the programmed feed of all feed paths of a workingstep (a path's own multiplier still counts).
    ///
    /// # Errors
    /// For anything else, for rapid paths and dwells, and for a feed that is not above 0.
    pub fn set_feed(&mut self, part: Part, feed: MmPerSec) -> Result<(), ChangeError> {
        let program = self.program;
        if !(feed.0 > 0.0 && feed.0.is_finite()) {
            return unfit(part, "not to be run with a feed of 0 or less", "give a feed above 0");
        }
        match part {
            Part::Toolpath(id) => {
                let path = program.toolpath(id);
                if path.kind != ToolpathKind::Feed {
                    return unfit(part, "a rapid path or a dwell, which has no feed", "choose a path that cuts");
                }
                let around = program.file().inverse(id).iter().find_map(|&row| {
                    let relationship = program.file().instance(row).ok()?;
                    let operation = relationship.argument(2).reference()?;
                    (program.file().is(row, TOOLPATHS))
                        .then(|| program.operation(operation)?.technology)
                        .flatten()
                });
                // A multiplier that is the same all along the path stays: the feed that comes out is the one that was asked for.
                let factor = path.profile.as_ref().and_then(|profile| {
                    let first = profile.points.first()?.1;
                    profile.points.iter().all(|point| point.1 == first).then_some(first)
                });
                let feed = factor.filter(|factor| *factor > 0.0).map_or(feed, |factor| feed / factor);
                self.feed_of(id, path.technology, around, feed)
            }
            Part::Executable(id) => {
                let operation = program.executable(id).and_then(|executable| match executable.kind {
                    ExecutableKind::Workingstep { operation, .. } => program.operation(operation?),
                    _ => None,
                });
                let Some(operation) = operation else {
                    return unfit(part, "no workingstep with an operation", "choose a workingstep or a toolpath");
                };
                let paths: Vec<_> = operation.toolpaths.iter().map(|&path| program.toolpath(path)).collect();
                let feeds = || paths.iter().filter(|path| path.kind == ToolpathKind::Feed);
                // The operation's own technology counts where a path has none.
                if operation.technology.is_some() || feeds().any(|path| path.technology.is_none()) {
                    self.feed_of(operation.id, operation.technology, None, feed)?;
                }
                for path in feeds() {
                    if path.technology.is_some_and(|own| Some(own) != operation.technology) {
                        self.feed_of(path.id, path.technology, operation.technology, feed)?;
                    } else if let Some(own) = path.technology {
                        self.feed_of(path.id, Some(own), None, feed)?;
                    }
                }
                Ok(())
            }
        }
    }

    /// Gives `owner` this feed; everything else as in its own technology, or in the one that it `inherits`.
    fn feed_of(&mut self, owner: u64, own: Option<u64>, inherits: Option<u64>, feed: MmPerSec) -> Result<(), ChangeError> {
        let program = self.program;
        let like = own.or(inherits);
        let known = like
            .and_then(|id| program.technology(id))
            .and_then(|technology| technology.feed);
        if matches!(known, Some(FeedSetting::PerTime(speed)) if (speed.0 - feed.0).abs() <= 1e-9 * feed.0) {
            return Ok(());
        }
        let relation = program
            .aim()
            .links(owner)
            .relations
            .into_iter()
            .find(|relation| relation.keyword == TECHNOLOGY);
        if let (Some(own), Some(relation)) = (own, &relation) {
            let mut without = Removal::new(program.aim());
            without.unlink(relation.id, own);
            without.settle();
            let alone = without.takes(own);
            // What an earlier change has made goes when what was there before fits again.
            let mut whole = Removal::new(program.aim());
            whole.take_out(relation.id);
            whole.settle();
            let fitting = self.fitting(own, inherits, feed);
            if whole.takes(own) && whole.is_newest() && fitting.is_some() && fitting == inherits {
                return self.remove(&whole);
            }
            if let Some(fitting) = fitting.filter(|_| without.is_newest() || !alone) {
                self.set(relation.id, 3, &format!("#{fitting}"))?;
                return if alone { self.remove(&without) } else { Ok(()) };
            }
            if alone && self.change_in_place(own, feed)? {
                return Ok(());
            }
            let technology = self.technology_like(like, feed)?;
            return self.set(relation.id, 3, &format!("#{technology}"));
        }
        let technology = self.technology_like(like, feed)?;
        self.edits.append(&format!("{TECHNOLOGY}('','',#{owner},#{technology})"))?;
        Ok(())
    }

    /// An existing technology that is like `own` but for this feed, the inherited one first.
    fn fitting(&self, own: u64, inherits: Option<u64>, feed: MmPerSec) -> Option<u64> {
        let program = self.program;
        let aim = program.aim();
        let traits = |id: u64| {
            let instance = aim.instance(id).ok()?;
            let texts = [0, 1].map(|n| crate::aim::text(instance.argument(n)).into_owned());
            let mut properties = aim.links(id).properties;
            properties.retain(|property| property.0 != "feedrate");
            let properties: Vec<(String, u64)> = properties.into_iter().map(|(name, value, _)| (name, value)).collect();
            Some((texts, properties))
        };
        let wanted = traits(own)?;
        let all = aim.file.by_keyword("MACHINING_TECHNOLOGY").map(|row| aim.file.id(row));
        inherits.into_iter().chain(all).find(|&id| {
            let has = program.technology(id).and_then(|technology| technology.feed);
            id != own
                && matches!(has, Some(FeedSetting::PerTime(speed)) if (speed.0 - feed.0).abs() <= 1e-9 * feed.0)
                && traits(id).as_ref() == Some(&wanted)
        })
    }

    /// Writes the number anew where it stands, in its own unit; false when it is shared, or no speed.
    fn change_in_place(&mut self, technology: u64, feed: MmPerSec) -> Result<bool, ChangeError> {
        let aim = self.program.aim();
        let links = aim.links(technology);
        let Some((_, representation, property)) = links.properties.iter().find(|property| property.0 == "feedrate") else {
            return Ok(false);
        };
        let only_user = |id: u64| aim.file.inverse(id).len() == 1;
        let Ok(found) = aim.representation(*representation) else {
            return Ok(false);
        };
        let [item] = found.items[..] else { return Ok(false) };
        let speed = aim.unit_of_measure(item).ok().filter(|unit| unit.dimension == unit::SPEED);
        let (Some(unit), true) = (speed, only_user(item) && only_user(found.id) && only_user(*property)) else {
            return Ok(false);
        };
        let (Some(row), Ok(instance)) = (aim.file.row(item), aim.instance(item)) else {
            return Ok(false);
        };
        let (part, arguments) = match &instance {
            part21::Instance::Simple(record) => (None, record.arguments.as_slice()),
            part21::Instance::Complex(_) => (
                Some("MEASURE_WITH_UNIT"),
                instance.part("MEASURE_WITH_UNIT").unwrap_or_default(),
            ),
        };
        let Some(place) = arguments.iter().position(|argument| argument.number().is_some()) else {
            return Ok(false);
        };
        let number = real(short(feed.0 / unit.factor));
        let literal = match &arguments[place] {
            Value::Typed(keyword, _) => format!("{keyword}({number})"),
            _ => number,
        };
        self.edits.set_parameter(row, part, place, &literal)?;
        Ok(true)
    }

    /// A technology with this feed and everything else as in `like`; one for each feed, however many want it.
    fn technology_like(&mut self, like: Option<u64>, feed: MmPerSec) -> Result<u64, ChangeError> {
        let key = (like.unwrap_or(0), feed.0.to_bits());
        if let Some(&id) = self.technologies.get(&key) {
            return Ok(id);
        }
        let aim = self.program.aim();
        let old = like.and_then(|id| aim.instance(id).ok());
        let texts = [(0, ""), (1, "milling")].map(|(n, otherwise)| {
            let text = old.as_ref().map(|old| crate::aim::text(old.argument(n)).into_owned());
            encode(&text.unwrap_or_else(|| otherwise.to_string()))
        });
        let kept = like.map(|like| aim.links(like).properties).unwrap_or_default();
        let old_item = kept
            .iter()
            .find(|property| property.0 == "feedrate")
            .and_then(|(_, representation, _)| {
                let representation = aim.representation(*representation).ok()?;
                Some((*representation.items.first()?, representation.context))
            });
        let unit = old_item.and_then(|(item, _)| {
            let unit = aim.unit_of_measure(item).ok().filter(|unit| unit.dimension == unit::SPEED)?;
            let values = aim.instance(item).ok()?;
            let values = values.records().iter().flat_map(|record| &record.arguments);
            Some((values.filter_map(Value::reference).next_back()?, unit.factor))
        });
        let id = self
            .edits
            .append(&format!("MACHINING_TECHNOLOGY({},{},'','')", texts[0], texts[1]))?;
        for (name, representation, _) in kept.iter().filter(|property| property.0 != "feedrate") {
            self.property(id, name, *representation)?;
        }
        let (unit, factor) = match unit {
            Some(unit) => unit,
            None => {
                // A unit of its own: which ones the file has does not matter then.
                let millimetre = self.edits.append("(LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.))")?;
                let second = self.edits.append("(NAMED_UNIT(*) SI_UNIT($,.SECOND.) TIME_UNIT())")?;
                let above = self.edits.append(&format!("DERIVED_UNIT_ELEMENT(#{millimetre},1.)"))?;
                let below = self.edits.append(&format!("DERIVED_UNIT_ELEMENT(#{second},-1.)"))?;
                (self.edits.append(&format!("DERIVED_UNIT((#{above},#{below}))"))?, 1.0)
            }
        };
        let item = self.edits.append(&format!(
            "MEASURE_REPRESENTATION_ITEM('feed speed',NUMERIC_MEASURE({}),#{unit})",
            real(short(feed.0 / factor))
        ))?;
        let context = match old_item.and_then(|(_, context)| context) {
            Some(context) => context,
            None => self.context()?,
        };
        let representation = self.edits.append(&format!(
            "MACHINING_FEED_SPEED_REPRESENTATION('feed speed',(#{item}),#{context})"
        ))?;
        self.property(id, "feedrate", representation)?;
        self.technologies.insert(key, id);
        Ok(id)
    }
}

/// Without the noise that changing units leaves in the last digits: 900 mm/min is `900.` again.
fn short(number: f64) -> f64 {
    format!("{number:.12e}").parse().unwrap_or(number)
}
