//! Small changes to a program that leave the rest of the file as it is: [`ProgramEdits`].
//!
//! Property instances and representations are often shared. A change for one owner never touches what another uses: it makes new
//! instances and redirects the one link that is the owner's own. What is the owner's alone is changed where it stands, byte by byte, and
//! a change that is taken back gives the bytes from before: the header keeps its time stamp, and what an earlier change has added to the
//! end of the file goes again.
//!
//! Read on: `places` for moving and putting between, `feeds` for feeds, `owners` for what goes when a part is deleted.

mod classes;
mod feeds;
mod owners;
mod places;

use crate::function_form::FunctionForm;
use crate::model::{ExecutableKind, Program};
use crate::select::{Part, Spot};
use owners::Removal;
use part21::text::encode;
use part21::{EditError, Edits, Saved};
use places::SEQUENCE;
use std::collections::BTreeMap;

pub use places::Target;

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

/// What can be put between the executables of a workplan.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Insert {
    /// An extended NC function with this text: `trace:1 ...`.
    Function(String),
    /// A text for the operator.
    Message(String),
    /// The machine waits for cycle start.
    ProgramStop,
    /// The same, when the optional-stop switch is on.
    OptionalStop,
    /// An empty workplan of this name, to move things into.
    Workplan(String),
}

impl Insert {
    /// What a person writes: `message: TEXT`, `program stop`, `optional stop`, `workplan: NAME`; anything else is the text of an
    /// extended function.
    pub fn from_text(text: &str) -> Insert {
        if let Some(message) = text.strip_prefix("message:") {
            return Insert::Message(message.trim().to_string());
        }
        if let Some(name) = text.strip_prefix("workplan:") {
            return Insert::Workplan(name.trim().to_string());
        }
        match text.trim() {
            "program stop" => Insert::ProgramStop,
            "optional stop" => Insert::OptionalStop,
            _ => Insert::Function(text.to_string()),
        }
    }
}

/// Changes to a program, not yet written.
///
/// Each change is made against the file as it was read; for a change that builds on another one, save and read in between.
pub struct ProgramEdits<'p> {
    program: &'p Program,
    edits: Edits<'p>,
    /// Technologies with a new feed, by the old one and the feed's bits.
    technologies: BTreeMap<(u64, u64), u64>,
    /// The context of representations without units, when one had to be made.
    context: Option<u64>,
    functions: FunctionForm,
    notices: Vec<String>,
}

impl<'p> ProgramEdits<'p> {
    /// No changes.
    pub fn new(program: &'p Program) -> Self {
        Self {
            program,
            edits: Edits::new(program.file()),
            technologies: BTreeMap::new(),
            context: None,
            functions: FunctionForm::default(),
            notices: Vec::new(),
        }
    }

    /// Functions that are inserted from here on are written in this form.
    pub fn write_functions(&mut self, form: FunctionForm) {
        self.functions = form;
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
        if self
            .program
            .executable(id)
            .is_some_and(|executable| executable.enabled == enabled)
        {
            return Ok(());
        }
        let word = if enabled { "enabled" } else { "disabled" };
        let aim = self.program.aim();
        let links = aim.links(id);
        let Some((_, representation, property)) = links.properties.iter().find(|property| property.0 == "enabled") else {
            let representation = self.describe(word)?;
            return self.property(id, "enabled", representation);
        };
        // What an earlier change has added goes again: absent is enabled.
        let mut whole = Removal::new(aim);
        whole.take_out(*property);
        whole.settle();
        if enabled && whole.is_newest() {
            return self.remove(&whole);
        }
        let Some((link, _)) = aim.users_by(*property, "ACTION_PROPERTY_REPRESENTATION", 2).next() else {
            return Ok(());
        };
        let mut without = Removal::new(aim);
        without.unlink(link, *representation);
        without.settle();
        let items = aim
            .representation(*representation)
            .map(|found| found.items)
            .unwrap_or_default();
        let alone = without.takes(*representation) && items.iter().all(|&item| without.takes(item));
        if alone && !without.is_newest() {
            if let [item] = items[..]
                && aim.keyword(item) == "DESCRIPTIVE_REPRESENTATION_ITEM"
            {
                return self.set(item, 1, &encode(word));
            }
        } else if let Some(other) = self.saying(word, *representation) {
            self.set(link, 3, &format!("#{other}"))?;
            return if alone { self.remove(&without) } else { Ok(()) };
        }
        let other = self.describe(word)?;
        self.set(link, 3, &format!("#{other}"))
    }

    /// Gives a part another name.
    ///
    /// # Errors
    /// When the instance is not one of those with a name first.
    pub fn rename(&mut self, part: Part, name: &str) -> Result<(), ChangeError> {
        let id = part.id();
        let old = self.program.aim().instance(id).ok();
        if old.is_some_and(|old| old.argument(0).text() == Some(name)) {
            return Ok(());
        }
        self.set(id, 0, &encode(name))
    }

    /// Takes a part out of its place, and out of the file when nobody else refers to it: with its properties, toolpaths, technologies
    /// and tools as far as they are its alone. Shapes and features stay.
    ///
    /// # Errors
    /// When it has no place, or its place must not be empty.
    pub fn delete(&mut self, from: impl Into<Spot>) -> Result<(), ChangeError> {
        let spot = from.into();
        let place = self.place(spot)?;
        let around = self.program.executable(place.parent).map(|around| &around.kind);
        if let Some(ExecutableKind::If { .. } | ExecutableKind::While { .. }) = around {
            return unfit(spot.part, "what an if or while statement does", "delete the statement itself");
        }
        let mut removal = Removal::new(self.program.aim());
        removal.take_out(place.relationship);
        removal.settle();
        let id = spot.part.id();
        match removal.holder(id).filter(|_| !removal.takes(id)) {
            Some(0) => self.notices.push(format!(
                "#{id} is no longer executed here and stays in the file: an anchor names it for other files"
            )),
            Some(user) => self.notices.push(format!(
                "#{id} is no longer executed here and stays in the file: #{user} ({}) refers to it",
                self.program.aim().keyword(user)
            )),
            None => {}
        }
        self.remove(&removal)?;
        let left = self.in_order(place.parent, place.keyword).len() - 1;
        let least = match around {
            Some(ExecutableKind::Selective(_) | ExecutableKind::Parallel(_) | ExecutableKind::NonSequential(_)) => 2,
            _ => 1,
        };
        if left < least {
            self.notices.push(format!(
                "#{} has {left} left in it; ISO 10303-238 asks for at least {least}",
                place.parent
            ));
        }
        Ok(())
    }

    /// Puts a part before another one of its kind.
    ///
    /// # Errors
    /// As for [`ProgramEdits::move_to`].
    pub fn move_before(&mut self, part: impl Into<Spot>, other: impl Into<Spot>) -> Result<(), ChangeError> {
        self.move_to(part.into(), Target::Before(other.into()))
    }

    /// Puts an extended NC function with this text (`trace:1 ...`) before an executable; the answer is the function's instance.
    ///
    /// # Errors
    /// As for [`ProgramEdits::insert`].
    pub fn insert_function(&mut self, part: impl Into<Spot>, name: &str, text: &str) -> Result<u64, ChangeError> {
        self.insert(Target::Before(part.into()), name, &Insert::Function(text.to_string()))
    }

    /// Puts something new between executables; the answer is its instance.
    ///
    /// # Errors
    /// When the target has no place in a workplan: functions never stand between toolpaths.
    pub fn insert(&mut self, at: Target, name: &str, what: &Insert) -> Result<u64, ChangeError> {
        if let Target::Before(Spot {
            part: part @ Part::Toolpath(_),
            ..
        }) = at
        {
            return unfit(
                part,
                "a toolpath; functions stand between workingsteps only",
                "insert before its workingstep",
            );
        }
        let (parent, before) = self.target(Part::Executable(0), at)?;
        let sequence = self.number_before(parent, SEQUENCE, before)?;
        let (kind, texts) = match what {
            Insert::Function(text) => (self.functions.kind(), Some((self.functions.property(), text))),
            Insert::Message(text) => ("display message", Some(("message text", text))),
            Insert::ProgramStop => ("program stop", None),
            Insert::OptionalStop => ("optional stop", None),
            Insert::Workplan(_) => ("", None),
        };
        let id = match what {
            Insert::Workplan(name) => self.edits.append(&format!("MACHINING_WORKPLAN({},'','','')", encode(name)))?,
            _ => self
                .edits
                .append(&format!("MACHINING_NC_FUNCTION({},'{kind}','','')", encode(name)))?,
        };
        if let Some((property, text)) = texts {
            let representation = self.describe(text)?;
            self.property(id, property, representation)?;
        }
        self.edits.append(&format!("{SEQUENCE}('','',#{parent},#{id},{sequence})"))?;
        Ok(id)
    }

    /// True when saving would give other bytes.
    pub fn is_changed(&self) -> bool {
        self.edits.is_changed()
    }

    /// The bytes with the changes; without changes the very bytes that were read. The header stays as it is, so that what was changed
    /// and changed back is the same file.
    ///
    /// # Errors
    /// When there are new instances and the file has no end of its data.
    pub fn save(self) -> Result<Saved, ChangeError> {
        let mut saved = self.edits.save()?;
        saved.notices.splice(0..0, self.notices);
        Ok(saved)
    }

    /// A representation that says a word, and is no other part's alone.
    fn saying(&self, word: &str, but: u64) -> Option<u64> {
        let aim = self.program.aim();
        aim.file.by_keyword("REPRESENTATION").map(|row| aim.file.id(row)).find(|&id| {
            let Ok(found) = aim.representation(id) else { return false };
            id != but
                && aim.keyword(id) == "REPRESENTATION"
                && matches!(found.items[..], [item] if aim.keyword(item) == "DESCRIPTIVE_REPRESENTATION_ITEM"
                    && aim.description(item).as_deref() == Some(word))
        })
    }

    fn describe(&mut self, text: &str) -> Result<u64, ChangeError> {
        let item = self
            .edits
            .append(&format!("DESCRIPTIVE_REPRESENTATION_ITEM('',{})", encode(text)))?;
        let context = self.context()?;
        Ok(self.edits.append(&format!("REPRESENTATION('',(#{item}),#{context})"))?)
    }

    /// The context of representations without units: the file's, or a new one.
    fn context(&mut self) -> Result<u64, ChangeError> {
        let file = self.program.file();
        let known = file
            .by_keyword("REPRESENTATION_CONTEXT")
            .find(|&row| file.keyword(row) == "REPRESENTATION_CONTEXT")
            .map(|row| file.id(row));
        let id = match known.or(self.context) {
            Some(id) => id,
            None => self.edits.append("REPRESENTATION_CONTEXT('','units not necessary')")?,
        };
        self.context = Some(id);
        Ok(id)
    }

    fn property(&mut self, owner: u64, name: &str, representation: u64) -> Result<(), ChangeError> {
        let property = self.edits.append(&format!("ACTION_PROPERTY({},'',#{owner})", encode(name)))?;
        self.edits.append(&format!(
            "ACTION_PROPERTY_REPRESENTATION('','',#{property},#{representation})"
        ))?;
        Ok(())
    }
}

fn unfit<T>(part: Part, what: &'static str, instead: &'static str) -> Result<T, ChangeError> {
    Err(ChangeError::Unfit {
        id: part.id(),
        what,
        instead,
    })
}
