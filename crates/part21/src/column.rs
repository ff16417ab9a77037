//! A growing column of whole numbers that takes four bytes each until one of them needs eight.
//!
//! Identifiers and offsets fit four bytes in nearly every file; the index of a large file would be half again as big without this.

#[derive(Clone, Debug)]
pub(crate) enum Column {
    Narrow(Vec<u32>),
    Wide(Vec<u64>),
}

impl Column {
    pub(crate) fn new() -> Self {
        Column::Narrow(Vec::new())
    }

    pub(crate) fn push(&mut self, value: u64) {
        match (self, u32::try_from(value)) {
            (Column::Narrow(items), Ok(small)) => items.push(small),
            (Column::Wide(items), _) => items.push(value),
            (column, Err(_)) => {
                let Column::Narrow(items) = column else { return };
                let mut wide: Vec<u64> = items.iter().map(|&item| u64::from(item)).collect();
                wide.push(value);
                *column = Column::Wide(wide);
            }
        }
    }

    pub(crate) fn len(&self) -> usize {
        match self {
            Column::Narrow(items) => items.len(),
            Column::Wide(items) => items.len(),
        }
    }

    /// The value at `index`, which must be below `len`.
    pub(crate) fn get(&self, index: usize) -> u64 {
        match self {
            Column::Narrow(items) => u64::from(items[index]),
            Column::Wide(items) => items[index],
        }
    }

    /// The place of `value` between `low` and `high` (exclusive) of a sorted column.
    pub(crate) fn find(&self, value: u64, low: usize, high: usize) -> Option<usize> {
        let place = match self {
            Column::Narrow(items) => items[low..high].binary_search(&u32::try_from(value).ok()?),
            Column::Wide(items) => items[low..high].binary_search(&value),
        };
        place.ok().map(|place| place + low)
    }

    /// The same values in another order: `order[new] = old`.
    pub(crate) fn reordered(self, order: &[u32]) -> Self {
        match self {
            Column::Narrow(items) => Column::Narrow(order.iter().map(|&old| items[old as usize]).collect()),
            Column::Wide(items) => Column::Wide(order.iter().map(|&old| items[old as usize]).collect()),
        }
    }

    pub(crate) fn shrink(&mut self) {
        match self {
            Column::Narrow(items) => items.shrink_to_fit(),
            Column::Wide(items) => items.shrink_to_fit(),
        }
    }
}
