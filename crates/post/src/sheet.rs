//! The sheet that a program is written on: lines within the control's limits, what is in force as words, labels, variables, notices.

use crate::letters::{Letters, pieces};
use crate::number::Decimals;
use std::collections::BTreeMap;

/// What a program of a control looks like on paper.
#[derive(Clone, Copy, Debug)]
pub struct Paper {
    /// Lengths.
    pub lengths: Decimals,
    /// Feeds per minute and per revolution.
    pub feeds: [Decimals; 2],
    /// Spindle speeds.
    pub speeds: Decimals,
    /// Largest coordinate, mm.
    pub largest: f64,
    /// Behind each line.
    pub line_end: &'static str,
    /// Longest line, in characters.
    pub longest: usize,
    /// Longest piece of text in a comment.
    pub longest_comment: usize,
    /// What is before and behind a comment.
    pub comment: (&'static str, &'static str),
    /// Letters of comments and messages.
    pub letters: Letters,
    /// Around parts of expressions.
    pub brackets: (&'static str, &'static str),
    /// Every line begins with its number, from 0.
    pub numbered: bool,
    /// Largest number of a label.
    pub most_labels: u32,
}

/// Why something cannot be said on a control.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// A short name, stable for scripts.
    pub code: &'static str,
    /// What cannot be said, and why.
    pub message: String,
    /// What to do.
    pub remedy: &'static str,
}

impl Refusal {
    /// A refusal.
    pub fn new(code: &'static str, message: impl Into<String>, remedy: &'static str) -> Self {
        Refusal {
            code,
            message: message.into(),
            remedy,
        }
    }
}

/// What the control believes to be in force, as words that were written; `None` is written again.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Modal {
    /// G0, G1, ...
    pub motion: Option<&'static str>,
    /// G17, G18, G19.
    pub plane: Option<&'static str>,
    /// G94, G95.
    pub feed_mode: Option<&'static str>,
    /// F with its number.
    pub feed: Option<String>,
    /// Words that wait for the next move of the tool axis: `G43 H1`.
    pub length: Option<String>,
    /// A tool length is in force.
    pub length_on: bool,
    /// The tool in the spindle.
    pub tool: Option<u32>,
    /// A tolerance of the path is set.
    pub tolerance_on: bool,
    /// The program sets one somewhere: where ways meet it may be on.
    pub tolerances: bool,
}

impl Modal {
    /// Ways meet here: what depends on the way is written again. What a tool change sets is set by the program itself.
    pub fn forget(&mut self) {
        *self = Modal {
            length: self.length.take(),
            length_on: self.length_on,
            tool: self.tool,
            tolerance_on: self.tolerances,
            tolerances: self.tolerances,
            ..Modal::default()
        };
    }
}

/// A program being written.
pub struct Sheet<'s> {
    paper: Paper,
    out: &'s mut dyn FnMut(&str),
    /// X words are diameters.
    pub turning: bool,
    /// What is in force.
    pub modal: Modal,
    /// Open branches and loops, outer first.
    pub ways: Vec<Way>,
    /// Numbers that belong to what is under way, by a name of the control's own choice.
    pub notes: BTreeMap<String, Vec<u32>>,
    /// Texts that belong to them.
    pub texts: BTreeMap<String, Vec<String>>,
    variables: BTreeMap<String, u32>,
    labels: u32,
    alone: u32,
    lines: u64,
    notices: Vec<String>,
    unverified: Vec<String>,
    refused: Option<Refusal>,
}

/// An open branch or loop and the labels that belong to it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Way {
    /// Where the other branch or the loop's test begins.
    pub other: u32,
    /// Where the ways meet.
    pub end: u32,
    /// The other branch has begun.
    pub otherwise: bool,
}

impl Way {
    /// With the labels of its other part and of its end.
    pub fn between(other: u32, end: u32) -> Way {
        Way {
            other,
            end,
            otherwise: false,
        }
    }
}

impl<'s> Sheet<'s> {
    /// An empty sheet; `out` is given each line with its end.
    pub fn new(paper: Paper, turning: bool, out: &'s mut dyn FnMut(&str)) -> Self {
        Sheet {
            paper,
            out,
            turning,
            modal: Modal::default(),
            ways: Vec::new(),
            notes: BTreeMap::new(),
            texts: BTreeMap::new(),
            variables: BTreeMap::new(),
            labels: 0,
            alone: 0,
            lines: 0,
            notices: Vec::new(),
            unverified: Vec::new(),
            refused: None,
        }
    }

    /// How the control's programs look.
    pub fn paper(&self) -> &Paper {
        &self.paper
    }

    /// Writes a line. A line that is longer than the control reads is refused at the end of the statement.
    pub fn line(&mut self, text: &str) {
        let numbered = if self.paper.numbered {
            format!("{} ", self.lines)
        } else {
            String::new()
        };
        let line = format!("{numbered}{text}");
        if line.len() > self.paper.longest && self.refused.is_none() {
            self.refused = Some(Refusal::new(
                "line-too-long",
                format!(
                    "a line of {} characters, and the control reads {}: {}...",
                    line.len(),
                    self.paper.longest,
                    &line[..line.len().min(60)]
                ),
                "use shorter names, or fewer axes or sensors in one function",
            ));
        }
        (self.out)(&format!("{line}{}", self.paper.line_end));
        self.lines += 1;
    }

    /// Writes words in one line, nothing when there are none.
    pub fn words(&mut self, words: &[String]) {
        let words: Vec<&str> = words.iter().map(String::as_str).filter(|word| !word.is_empty()).collect();
        if !words.is_empty() {
            self.line(&words.join(" "));
        }
    }

    /// Writes text as comments, as many lines as it takes.
    pub fn comment(&mut self, text: &str) {
        let text = self.paper.letters.write(text);
        let (open, close) = self.paper.comment;
        for piece in pieces(&text, self.paper.longest_comment) {
            self.line(&format!("{open}{piece}{close}"));
        }
    }

    /// Text in the control's letters, at most so long.
    pub fn short(&self, text: &str, most: usize) -> String {
        let text = self.paper.letters.write(text);
        let end = text.len().min(most);
        text[..end].trim_end().to_owned()
    }

    /// A length as a word's number.
    ///
    /// # Errors
    /// It is no number that the control reads.
    pub fn length(&self, value: f64) -> Result<String, Refusal> {
        self.number(value, self.paper.lengths)
    }

    /// Any other number.
    ///
    /// # Errors
    /// It is no number that the control reads.
    pub fn number(&self, value: f64, decimals: Decimals) -> Result<String, Refusal> {
        decimals.write(value).filter(|_| value.abs() <= 1e12).ok_or_else(|| {
            Refusal::new(
                "number",
                format!("{value} is no number that a control reads"),
                "correct the program",
            )
        })
    }

    /// Says something about the program as a whole, once.
    pub fn notice(&mut self, text: impl Into<String>) {
        let text = text.into();
        if !self.notices.contains(&text) {
            self.notices.push(text);
        }
    }

    /// A form of words that no manual was at hand for, once.
    pub fn verify(&mut self, text: impl Into<String>) {
        let text = text.into();
        if !self.unverified.contains(&text) {
            self.unverified.push(text);
        }
    }

    /// The number that stands for a variable of the program, counted from 0 in the order of their first use.
    pub fn variable(&mut self, name: &str) -> u32 {
        let next = u32::try_from(self.variables.len()).unwrap_or(u32::MAX);
        *self.variables.entry(name.to_owned()).or_insert(next)
    }

    /// The variables of the program and their numbers.
    pub fn variables(&self) -> &BTreeMap<String, u32> {
        &self.variables
    }

    /// A new label.
    pub fn label(&mut self) -> u32 {
        self.labels += 1;
        if self.labels > self.paper.most_labels && self.refused.is_none() {
            self.refused = Some(Refusal::new(
                "too-many-labels",
                format!("more than {} branches and checks", self.paper.most_labels),
                "let checks stand farther apart",
            ));
        }
        self.labels
    }

    /// A number that nothing else on this sheet has: a synchronized action, a marker, a timer.
    pub fn own_number(&mut self) -> u32 {
        self.alone += 1;
        self.alone
    }

    /// Lines written so far.
    pub fn lines(&self) -> u64 {
        self.lines
    }

    /// What was said about the program as a whole, and what has to be verified.
    pub fn remarks(&self) -> (&[String], &[String]) {
        (&self.notices, &self.unverified)
    }

    /// What a line was refused for.
    ///
    /// # Errors
    /// A line was too long, or labels ran out.
    pub fn checked(&mut self) -> Result<(), Refusal> {
        self.refused.take().map_or(Ok(()), Err)
    }
}
