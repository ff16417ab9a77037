//! The one type in which the house says that something about an input is wrong, odd or assumed.

use serde::Serialize;
use std::fmt;

/// How much a remark matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// Worth knowing; nothing has to be done.
    Remark,
    /// Something was assumed or is doubtful; a person should look.
    Warning,
    /// The program cannot be run as it is.
    Error,
}

/// One kind of finding about an input, with the place where it was met first.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Diagnostic {
    /// A short name of the kind, stable for scripts: `arc-radius`, `missing-tool`.
    pub code: &'static str,
    /// How much it matters.
    pub severity: Severity,
    /// What was found and what was expected, in one sentence.
    pub message: String,
    /// The file as its reader was told its name; empty when there is no file.
    pub file: String,
    /// 1-based line of the first place; 0 when unknown.
    pub line: u32,
    /// 1-based column, in characters; 0 when unknown.
    pub column: u32,
    /// The STEP instance, when there is one.
    pub entity: Option<u64>,
    /// How many times this kind was met.
    pub count: u32,
    /// What the person can do about it; empty when the message says it.
    pub remedy: String,
}

impl Diagnostic {
    /// A finding without a place yet; the `at_…` and `in_…` methods add it.
    pub fn new(severity: Severity, code: &'static str, message: impl Into<String>) -> Self {
        Diagnostic {
            code,
            severity,
            message: message.into(),
            file: String::new(),
            line: 0,
            column: 0,
            entity: None,
            count: 1,
            remedy: String::new(),
        }
    }
    /// The same, as an error.
    pub fn error(code: &'static str, message: impl Into<String>) -> Self {
        Self::new(Severity::Error, code, message)
    }
    /// The same, as a warning.
    pub fn warning(code: &'static str, message: impl Into<String>) -> Self {
        Self::new(Severity::Warning, code, message)
    }
    /// The same, as a remark.
    pub fn remark(code: &'static str, message: impl Into<String>) -> Self {
        Self::new(Severity::Remark, code, message)
    }
    /// Adds the file.
    pub fn in_file(mut self, file: impl Into<String>) -> Self {
        self.file = file.into();
        self
    }
    /// Adds line and column, both from 1.
    pub fn at_line(mut self, line: u32, column: u32) -> Self {
        (self.line, self.column) = (line, column);
        self
    }
    /// Adds the STEP instance.
    pub fn at_entity(mut self, entity: u64) -> Self {
        self.entity = Some(entity);
        self
    }
    /// Adds what to do.
    pub fn remedy(mut self, remedy: impl Into<String>) -> Self {
        self.remedy = remedy.into();
        self
    }
}

impl fmt::Display for Diagnostic {
    /// `error: plate.stpnc:12:3: #45: message (4 times); remedy`, without the parts that are unknown.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let severity = match self.severity {
            Severity::Remark => "remark",
            Severity::Warning => "warning",
            Severity::Error => "error",
        };
        write!(f, "{severity}: ")?;
        if !self.file.is_empty() {
            write!(f, "{}", self.file)?;
            if self.line > 0 {
                write!(f, ":{}:{}", self.line, self.column)?;
            }
            write!(f, ": ")?;
        } else if self.line > 0 {
            write!(f, "line {}, column {}: ", self.line, self.column)?;
        }
        if let Some(id) = self.entity {
            write!(f, "#{id}: ")?;
        }
        write!(f, "{}", self.message)?;
        if self.count > 1 {
            write!(f, " ({} times)", self.count)?;
        }
        if !self.remedy.is_empty() {
            write!(f, "; {}", self.remedy)?;
        }
        Ok(())
    }
}

/// Findings of one reader: one entry a kind, with a count, in the order in which the kinds were first met.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Diagnostics(Vec<Diagnostic>);

impl Diagnostics {
    /// Nothing found yet.
    pub const fn new() -> Self {
        Diagnostics(Vec::new())
    }
    /// Adds a finding, or counts it when its kind was met before. The first place is kept; the worst severity wins.
    pub fn add(&mut self, found: Diagnostic) {
        match self.0.iter_mut().find(|d| d.code == found.code) {
            Some(known) => {
                known.count = known.count.saturating_add(found.count);
                known.severity = known.severity.max(found.severity);
            }
            None => self.0.push(found),
        }
    }
    /// Counts one more of a kind that was met before, without making its text again; false when the kind is new.
    pub fn count_again(&mut self, code: &str) -> bool {
        match self.0.iter_mut().find(|d| d.code == code) {
            Some(known) => {
                known.count = known.count.saturating_add(1);
                true
            }
            None => false,
        }
    }
    /// All kinds found.
    pub fn as_slice(&self) -> &[Diagnostic] {
        &self.0
    }
    /// True when something was found that forbids a run.
    pub fn has_errors(&self) -> bool {
        self.0.iter().any(|d| d.severity == Severity::Error)
    }
}

/// The program cannot go on: what the control would show in red.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Alarm {
    /// The control's alarm number where one exists (Fanuc PS 112, macro 3000+n); 0 otherwise.
    pub number: u32,
    /// What, where, and what to do.
    pub diagnostic: Diagnostic,
}

impl From<Diagnostic> for Alarm {
    fn from(diagnostic: Diagnostic) -> Self {
        Alarm { number: 0, diagnostic }
    }
}
impl fmt::Display for Alarm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.number > 0 {
            write!(f, "alarm {}: ", self.number)?;
        }
        write!(f, "{}", self.diagnostic)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kind_is_reported_once_with_its_count_and_first_place() {
        let mut all = Diagnostics::new();
        all.add(
            Diagnostic::warning("odd", "odd thing")
                .in_file("a.nc")
                .at_line(3, 7)
                .remedy("look"),
        );
        all.add(Diagnostic::warning("odd", "odd thing").in_file("a.nc").at_line(9, 1));
        assert_eq!(all.as_slice()[0].to_string(), "warning: a.nc:3:7: odd thing (2 times); look");
    }
}
