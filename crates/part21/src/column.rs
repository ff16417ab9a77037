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
            Column::Narrow(items) => gallop(&items[low..high], u32::try_from(value).ok()?),
            Column::Wide(items) => gallop(&items[low..high], value),
        };
        place.map(|place| place + low)
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

/// Finds `value` in a sorted slice: from where it would be if the values were spread evenly, in steps that double.
///
/// Identifiers mostly are, so that a look-up touches one or two lines of memory where halving a large file touches twenty.
fn gallop<T: Copy + Ord + Into<u64>>(items: &[T], value: T) -> Option<usize> {
    let (first, last) = (*items.first()?, *items.last()?);
    if value < first || value > last {
        return None;
    }
    let (from, whole) = (value.into() - first.into(), last.into() - first.into());
    let most = items.len() - 1;
    let guess = match whole {
        0 => 0,
        _ => (u128::from(from) * most as u128 / u128::from(whole)) as usize,
    };
    let (mut low, mut high) = (guess, guess);
    let mut step = 1;
    if items[guess] <= value {
        while high < most && items[high] < value {
            low = high;
            high = (high + step).min(most);
            step *= 2;
        }
    } else {
        while low > 0 && items[low] > value {
            high = low;
            low = low.saturating_sub(step);
            step *= 2;
        }
    }
    items[low..=high].binary_search(&value).ok().map(|place| place + low)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_is_found_wherever_it_stands_and_no_other_is() {
        let mut random = 1u64;
        let mut next = |below: u64| {
            random = random
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (random >> 33) % below
        };
        for count in [0usize, 1, 2, 3, 10, 1000] {
            for spread in [1u64, 2, 1000, 1 << 40] {
                let mut values: Vec<u64> = Vec::new();
                let mut value = next(50);
                for _ in 0..count {
                    value += 1 + next(spread) * next(spread).min(7);
                    values.push(value);
                }
                let mut column = Column::new();
                values.iter().for_each(|&value| column.push(value));
                for &value in values.iter().chain(&[0, 1, 77, u64::from(u32::MAX), u64::MAX]) {
                    for wanted in [value.saturating_sub(1), value, value.saturating_add(1)] {
                        assert_eq!(
                            column.find(wanted, 0, count),
                            values.binary_search(&wanted).ok(),
                            "{wanted} in {count}"
                        );
                    }
                }
            }
        }
    }
}
