//! The table of entity names of one file: each different name once, instances carry its number.
//!
//! A complex instance `(A() B(..))` has the name `A B`, so that the usual unit and measure combinations cost one number as well.

/// Number of the name that stands for "the table was full".
pub(crate) const UNKNOWN: u16 = 0;

#[derive(Clone, Debug)]
pub(crate) struct Keywords {
    names: Vec<String>,
    /// Open addressing, `u16::MAX` is free; its size is a power of two.
    slots: Vec<u16>,
    last: u16,
}

impl Keywords {
    pub(crate) fn new() -> Self {
        Self {
            names: vec![String::new()],
            slots: vec![u16::MAX; 1024],
            last: UNKNOWN,
        }
    }

    /// The number of `name`, which is upper-cased; `UNKNOWN` when a file has more than 65 000 different names.
    pub(crate) fn number_of(&mut self, name: &[u8]) -> u16 {
        if self.names[usize::from(self.last)].as_bytes() == name {
            return self.last; // runs of the same entity are the rule
        }
        let mut slot = self.slot_of(name);
        if self.slots[slot] == u16::MAX {
            if self.names.len() >= 65_000 {
                return UNKNOWN;
            }
            let upper = String::from_utf8_lossy(name).to_ascii_uppercase();
            self.names.push(upper);
            if self.names.len() * 2 > self.slots.len() {
                self.grow();
                slot = self.slot_of(name);
            }
            self.slots[slot] = (self.names.len() - 1) as u16;
        }
        self.last = self.slots[slot];
        self.last
    }

    /// The slot that holds `name`, or the free one where it belongs.
    fn slot_of(&self, name: &[u8]) -> usize {
        let mask = self.slots.len() - 1;
        let mut slot = hash(name) as usize & mask;
        loop {
            let number = self.slots[slot];
            if number == u16::MAX || self.names[usize::from(number)].as_bytes().eq_ignore_ascii_case(name) {
                return slot;
            }
            slot = (slot + 1) & mask;
        }
    }

    fn grow(&mut self) {
        let size = self.slots.len() * 2;
        self.slots = vec![u16::MAX; size];
        // The newest name is not in a slot yet: the caller puts it there.
        for number in 1..self.names.len() - 1 {
            let slot = self.slot_of(self.names[number].as_bytes());
            self.slots[slot] = number as u16;
        }
    }

    pub(crate) fn name(&self, number: u16) -> &str {
        &self.names[usize::from(number)]
    }

    /// For each number: is its name wanted?
    pub(crate) fn wanted(&self, is_wanted: impl Fn(&str) -> bool) -> Vec<bool> {
        self.names.iter().map(|name| is_wanted(name)).collect()
    }
}

/// True when `name` is `entry` or one of the blank-separated parts of it.
pub(crate) fn holds(entry: &str, name: &str) -> bool {
    !name.is_empty() && (entry == name || (entry.len() > name.len() && entry.split(' ').any(|part| part == name)))
}

/// FNV-1a over upper-cased bytes: short keys, no seed, the same everywhere.
fn hash(name: &[u8]) -> u32 {
    name.iter().fold(0x811c_9dc5, |hash, byte| {
        (hash ^ u32::from(byte.to_ascii_uppercase())).wrapping_mul(0x0100_0193)
    })
}
