//! Small changes to a program that leave the rest of the file as it is: [`ProgramEdits`].
//!
//! Property instances and representations are often shared. A change for one owner never touches what another uses: it makes new
//! instances and redirects the one link that is the owner's own.

use crate::date::Civil;
use crate::model::{ExecutableKind, Program, ToolpathKind};
use crate::select::Part;
use part21::text::{encode, real};
use part21::{EditError, Edits, Saved, Value};
use std::collections::BTreeMap;
use units::{MmPerSec, Timestamp};

/// Why a part of a program cannot be changed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ChangeError {
    /// The file's text cannot be changed so.
    #[error(transparent)]
    Edit(#[from] EditError),
    /// The part is of another kind.
    #[error("#{id} is {what}: {instead}")]
    Unfit {
        /// The part.
        id: u64,
        /// What it is.
        what: &'static str,
        /// What to do.
        instead: &'static str,
    },
}

/// Changes to a program, not yet written.
pub struct ProgramEdits<'p> {
    program: &'p Program,
    edits: Edits<'p>,
    /// Technologies with a new feed, by the old one and the feed's bits.
    technologies: BTreeMap<(u64, u64), u64>,
}

const SEQUENCE: &str = "MACHINING_PROCESS_SEQUENCE_RELATIONSHIP";
const TOOLPATHS: &str = "MACHINING_TOOLPATH_SEQUENCE_RELATIONSHIP";
const TECHNOLOGY: &str = "MACHINING_TECHNOLOGY_RELATIONSHIP";

/// The link that puts a part at its place.
struct Place {
    relationship: u64,
    keyword: &'static str,
    parent: u64,
    sequence: f64,
}

impl<'p> ProgramEdits<'p> {
    /// No changes.
    pub fn new(program: &'p Program) -> Self {
        Self {
            program,
            edits: Edits::new(program.file()),
            technologies: BTreeMap::new(),
        }
    }

    /// Enables or disables an executable.
    ///
    /// # Errors
    /// For a toolpath.
    pub fn enable(&mut self, part: Part, enabled: bool) -> Result<(), ChangeError> {
        let Part::Executable(id) = part else {
            return unfit(
                part,
                "a toolpath, which cannot be disabled",
                "disable its workingstep, or delete it",
            );
        };
        let links = self.program.aim().links(id);
        let property = links.properties.iter().find(|property| property.0 == "enabled");
        if property.is_none() && enabled {
            return Ok(());
        }
        let word = if enabled { "enabled" } else { "disabled" };
        let representation = self.describe(word)?;
        match property {
            Some((_, _, property)) => self.redirect(*property, representation),
            None => self.property(id, "enabled", representation),
        }
    }

    /// Gives a part another name.
    ///
    /// # Errors
    /// When the instance is not one of those with a name first.
    pub fn rename(&mut self, part: Part, name: &str) -> Result<(), ChangeError> {
        let id = part.id();
        let name = Value::String(name.to_string().into());
        self.rewrite(id, &[(0, name)])
    }

    /// Takes a part out of its place. The part itself stays in the file, executed by nobody.
    ///
    /// # Errors
    /// When it has no place in a workplan or operation.
    pub fn delete(&mut self, part: Part) -> Result<(), ChangeError> {
        let place = self.place(part)?;
        if let Some(row) = self.program.file().row(place.relationship) {
            self.edits.delete(row);
        }
        Ok(())
    }

    /// Puts a part before another one of its kind.
    ///
    /// # Errors
    /// When one of them has no place in a workplan or operation, or they are of different kinds.
    pub fn move_before(&mut self, part: Part, other: Part) -> Result<(), ChangeError> {
        let (from, to) = (self.place(part)?, self.place(other)?);
        if from.keyword != to.keyword {
            return unfit(
                part,
                "of another kind than its new neighbour",
                "move workingsteps among workingsteps, toolpaths among toolpaths",
            );
        }
        let sequence = self.before(&to);
        let changes = [(2, Value::Reference(to.parent)), (4, Value::Real(sequence))];
        self.rewrite(from.relationship, &changes)
    }

    /// Puts an extended NC function with this text (`trace:1 ...`) before an executable; the answer is the function's instance.
    ///
    /// # Errors
    /// When the executable has no place in a workplan: functions never stand between toolpaths.
    pub fn insert_function(&mut self, part: Part, name: &str, text: &str) -> Result<u64, ChangeError> {
        if let Part::Toolpath(_) = part {
            return unfit(
                part,
                "a toolpath; functions stand between workingsteps only",
                "insert before its workingstep",
            );
        }
        let place = self.place(part)?;
        let sequence = self.before(&place);
        let function = self
            .edits
            .append(&format!("MACHINING_NC_FUNCTION({},'extended function','','')", encode(name)))?;
        let representation = self.describe(text)?;
        self.property(function, "description", representation)?;
        self.edits
            .append(&format!("{SEQUENCE}('','',#{},#{function},{})", place.parent, real(sequence)))?;
        Ok(function)
    }

    /// Sets the feed of a toolpath, or of all feed paths of a workingstep.
    ///
    /// # Errors
    /// For anything else, and for rapid paths and dwells.
    pub fn set_feed(&mut self, part: Part, feed: MmPerSec) -> Result<(), ChangeError> {
        let program = self.program;
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
                self.feed_of(id, path.technology, path.technology.or(around), feed)
            }
            Part::Executable(id) => {
                let operation = program.executable(id).and_then(|executable| match executable.kind {
                    ExecutableKind::Workingstep { operation, .. } => program.operation(operation?),
                    _ => None,
                });
                let Some(operation) = operation else {
                    return unfit(part, "no workingstep with an operation", "choose a workingstep or a toolpath");
                };
                self.feed_of(operation.id, operation.technology, operation.technology, feed)?;
                for &path in &operation.toolpaths {
                    let path = program.toolpath(path);
                    if path.kind == ToolpathKind::Feed && path.technology.is_some() {
                        self.feed_of(path.id, path.technology, path.technology, feed)?;
                    }
                }
                Ok(())
            }
        }
    }

    /// True when saving would give other bytes.
    pub fn is_changed(&self) -> bool {
        self.edits.is_changed()
    }

    /// The bytes with the changes, the header's time stamp set to `written`; without changes the very bytes that were read.
    ///
    /// # Errors
    /// When there are new instances and the file has no end of its data.
    pub fn save(mut self, written: Timestamp) -> Result<Saved, ChangeError> {
        if self.edits.is_changed() {
            // A header without a time stamp stays without one.
            let _ = self.edits.set_header("FILE_NAME", 1, &encode(&Civil::of(written).rfc_3339()));
        }
        Ok(self.edits.save()?)
    }

    /// Gives `owner` a technology with this feed: everything else as in `like`.
    fn feed_of(&mut self, owner: u64, own: Option<u64>, like: Option<u64>, feed: MmPerSec) -> Result<(), ChangeError> {
        let key = (like.unwrap_or(0), feed.0.to_bits());
        let technology = match self.technologies.get(&key) {
            Some(&id) => id,
            None => {
                let id = self.technology(like, feed)?;
                self.technologies.insert(key, id);
                id
            }
        };
        let aim = self.program.aim();
        let relation = aim
            .links(owner)
            .relations
            .into_iter()
            .find(|relation| relation.keyword == TECHNOLOGY);
        match (own, relation) {
            (Some(_), Some(relation)) => self.rewrite(relation.id, &[(3, Value::Reference(technology))]),
            _ => {
                self.edits.append(&format!("{TECHNOLOGY}('','',#{owner},#{technology})"))?;
                Ok(())
            }
        }
    }

    fn technology(&mut self, like: Option<u64>, feed: MmPerSec) -> Result<u64, ChangeError> {
        let aim = self.program.aim();
        let description = like.and_then(|id| aim.instance(id).ok());
        let description = description.map_or("milling".to_string(), |old| crate::aim::text(old.argument(1)).into_owned());
        let id = self
            .edits
            .append(&format!("MACHINING_TECHNOLOGY('',{},'','')", encode(&description)))?;
        let kept = like.map(|like| aim.links(like).properties).unwrap_or_default();
        for (name, representation, _) in kept.into_iter().filter(|property| property.0 != "feedrate") {
            self.property(id, &name, representation)?;
        }
        // A unit of its own: whether the file's feeds are per minute or in inches does not matter then.
        let millimetre = self.edits.append("(LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.))")?;
        let second = self.edits.append("(NAMED_UNIT(*) SI_UNIT($,.SECOND.) TIME_UNIT())")?;
        let above = self.edits.append(&format!("DERIVED_UNIT_ELEMENT(#{millimetre},1.)"))?;
        let below = self.edits.append(&format!("DERIVED_UNIT_ELEMENT(#{second},-1.)"))?;
        let unit = self.edits.append(&format!("DERIVED_UNIT((#{above},#{below}))"))?;
        let item = self.edits.append(&format!(
            "MEASURE_REPRESENTATION_ITEM('feed speed',NUMERIC_MEASURE({}),#{unit})",
            real(feed.0)
        ))?;
        let context = self.edits.append("REPRESENTATION_CONTEXT('','units not necessary')")?;
        let representation = self.edits.append(&format!(
            "MACHINING_FEED_SPEED_REPRESENTATION('feed speed',(#{item}),#{context})"
        ))?;
        self.property(id, "feedrate", representation)?;
        Ok(id)
    }

    fn describe(&mut self, text: &str) -> Result<u64, ChangeError> {
        let item = self
            .edits
            .append(&format!("DESCRIPTIVE_REPRESENTATION_ITEM('',{})", encode(text)))?;
        let context = self.edits.append("REPRESENTATION_CONTEXT('','units not necessary')")?;
        Ok(self.edits.append(&format!("REPRESENTATION('',(#{item}),#{context})"))?)
    }

    fn property(&mut self, owner: u64, name: &str, representation: u64) -> Result<(), ChangeError> {
        let property = self.edits.append(&format!("ACTION_PROPERTY({},'',#{owner})", encode(name)))?;
        self.edits.append(&format!(
            "ACTION_PROPERTY_REPRESENTATION('','',#{property},#{representation})"
        ))?;
        Ok(())
    }

    /// Lets a property show another representation.
    fn redirect(&mut self, property: u64, representation: u64) -> Result<(), ChangeError> {
        let aim = self.program.aim();
        let links: Vec<u64> = aim
            .users_by(property, "ACTION_PROPERTY_REPRESENTATION", 2)
            .map(|(id, _)| id)
            .collect();
        for link in links {
            self.rewrite(link, &[(3, Value::Reference(representation))])?;
        }
        Ok(())
    }

    /// Writes an instance again with some parameters changed.
    fn rewrite(&mut self, id: u64, changes: &[(usize, Value<'_>)]) -> Result<(), ChangeError> {
        let unreadable = ChangeError::Unfit {
            id,
            what: "not a simple instance that can be read",
            instead: "repair the file first",
        };
        let Some(row) = self.program.file().row(id) else {
            return Err(unreadable);
        };
        let Ok(part21::Instance::Simple(mut record)) = self.program.file().instance(row) else {
            return Err(unreadable);
        };
        for (place, value) in changes {
            match record.arguments.get_mut(*place) {
                Some(argument) => *argument = value.clone(),
                None => return Err(unreadable),
            }
        }
        let arguments: Vec<String> = record.arguments.iter().map(Value::to_string).collect();
        self.edits
            .replace(row, &format!("{}({})", record.keyword, arguments.join(",")))?;
        Ok(())
    }

    fn place(&self, part: Part) -> Result<Place, ChangeError> {
        let keyword = match part {
            Part::Executable(_) => SEQUENCE,
            Part::Toolpath(_) => TOOLPATHS,
        };
        let file = self.program.file();
        let found = file.inverse(part.id()).iter().find_map(|&row| {
            if !file.is(row, keyword) {
                return None;
            }
            let relationship = file.instance(row).ok()?;
            (relationship.argument(3).reference() == Some(part.id())).then_some(())?;
            Some(Place {
                relationship: file.id(row),
                keyword,
                parent: relationship.argument(2).reference()?,
                sequence: relationship.argument(4).number()?,
            })
        });
        match found {
            Some(place) => Ok(place),
            None => unfit(
                part,
                "not in an ordered place of a workplan or operation",
                "choose a child of a workplan, or a toolpath",
            ),
        }
    }

    /// A sequence number between a place and the one before it.
    fn before(&self, place: &Place) -> f64 {
        let links = self.program.aim().links(place.parent);
        let numbers = links
            .relations
            .iter()
            .filter(|relation| relation.keyword == place.keyword)
            .filter_map(|relation| relation.sequence);
        let previous = numbers
            .filter(|number| *number < place.sequence)
            .fold(f64::NEG_INFINITY, f64::max);
        if previous.is_finite() {
            (previous + place.sequence) / 2.0
        } else {
            place.sequence - 1.0
        }
    }
}

fn unfit<T>(part: Part, what: &'static str, instead: &'static str) -> Result<T, ChangeError> {
    Err(ChangeError::Unfit {
        id: part.id(),
        what,
        instead,
    })
}
