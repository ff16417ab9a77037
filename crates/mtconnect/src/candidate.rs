//! Which data items make places together, and which of several is taken.

use crate::streams::Source;

/// A set of data items that make places together.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Candidate {
    pub(crate) device: String,
    pub(crate) axes: bool,
    pub(crate) sub_type: String,
    /// The data item; for axes, what is the same in their items' names.
    pub(crate) item: String,
}

impl Candidate {
    /// Actual before unsaid before commanded; a whole place before single axes.
    pub(crate) fn rank(&self) -> (u8, bool) {
        let sub_type = match self.sub_type.as_str() {
            "ACTUAL" => 3,
            "" => 2,
            "COMMANDED" => 1,
            _ => 0,
        };
        (sub_type, !self.axes)
    }
}

impl std::fmt::Display for Candidate {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} {}", self.device, self.item)?;
        if !self.sub_type.is_empty() {
            write!(f, " ({})", self.sub_type)?;
        }
        Ok(())
    }
}

/// What tells whose position an observation is.
pub(crate) struct Named<'a> {
    pub(crate) kind: &'a str,
    pub(crate) sub_type: &'a str,
    pub(crate) id: &'a str,
    pub(crate) name: &'a str,
    pub(crate) source: &'a Source,
}

/// The candidate that a position belongs to; `None` for a position that is no axis of a place.
pub(crate) fn candidate_of(o: &Named<'_>) -> Option<Candidate> {
    let axes = o.kind == "Position";
    let item = if axes {
        let axis = axis_of(o)?;
        // `Xabs`, `Yabs`, `Zabs` belong together, and not with `Xmach`: what is left of the name without its axis letter.
        let name = if o.name.is_empty() { o.id } else { o.name };
        let letter = ["X", "Y", "Z"][axis];
        let rest: String = match name.find(letter).or_else(|| name.find(&letter.to_lowercase())) {
            Some(at) => format!("{}*{}", &name[..at], &name[at + 1..]),
            None => "*".to_owned(),
        };
        rest
    } else {
        o.id.to_owned()
    };
    Some(Candidate {
        device: o.source.device.clone(),
        axes,
        sub_type: o.sub_type.to_owned(),
        item,
    })
}

/// Which axis an axis position is of: by the name of its component.
pub(crate) fn axis_of(o: &Named<'_>) -> Option<usize> {
    if o.source.component != "Linear" {
        return None;
    }
    let name = o.source.name.trim();
    let letter = if name.is_empty() { &o.source.id } else { name };
    ["X", "Y", "Z"].iter().position(|axis| letter.eq_ignore_ascii_case(axis))
}
