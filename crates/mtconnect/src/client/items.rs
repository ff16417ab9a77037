//! What is observed: the data items that documents have spoken of, each once, so that an observation is small.

use crate::streams::{Category, Source};
use std::collections::BTreeMap;

/// A data item, as observations show it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Item {
    /// Device and component.
    pub source: Source,
    /// Its id in the device model.
    pub id: String,
    /// Its name; may be empty.
    pub name: String,
    /// The element's name for samples and events (`PathPosition`), the type for conditions.
    pub kind: String,
    /// `ACTUAL`, `COMMANDED`; empty when the agent does not say.
    pub sub_type: String,
    /// Sample, event or condition.
    pub category: Category,
}

/// The data items met so far; an observation names one by its number.
#[derive(Clone, Debug, Default)]
pub struct Items {
    items: Vec<Item>,
    /// By device (unique id, name), component id and item id; the newest description of each.
    known: BTreeMap<Source, BTreeMap<String, u32>>,
}

/// What one element says about its data item.
pub(crate) struct Said<'a> {
    pub(crate) source: &'a Source,
    pub(crate) id: &'a str,
    pub(crate) name: &'a str,
    pub(crate) kind: &'a str,
    pub(crate) sub_type: &'a str,
    pub(crate) category: Category,
}

impl Said<'_> {
    fn is(&self, item: &Item) -> bool {
        item.id == self.id
            && item.kind == self.kind
            && item.name == self.name
            && item.sub_type == self.sub_type
            && item.category == self.category
            && item.source == *self.source
    }
}

impl Items {
    /// The item of that number.
    pub fn get(&self, number: u32) -> &Item {
        &self.items[number as usize]
    }

    /// All of them, in the order they were met.
    pub fn all(&self) -> &[Item] {
        &self.items
    }

    /// The number of an item; `guess` is the last one, which it often is again.
    pub(crate) fn number_of(&mut self, said: &Said<'_>, guess: Option<u32>) -> u32 {
        if let Some(guess) = guess
            && said.is(&self.items[guess as usize])
        {
            return guess;
        }
        let of_source = match self.known.get_mut(said.source) {
            Some(found) => found,
            None => self.known.entry(said.source.clone()).or_default(),
        };
        if let Some(number) = of_source.get(said.id)
            && said.is(&self.items[*number as usize])
        {
            return *number;
        }
        // New, or described anew: the agent was started with another device model.
        let number = u32::try_from(self.items.len()).expect("a device model has fewer than four thousand million items");
        of_source.insert(said.id.to_owned(), number);
        self.items.push(Item {
            source: said.source.clone(),
            id: said.id.to_owned(),
            name: said.name.to_owned(),
            kind: said.kind.to_owned(),
            sub_type: said.sub_type.to_owned(),
            category: said.category,
        });
        number
    }
}
