//! Byte offsets to line and column, counted when a diagnostic needs them.

use std::cell::OnceCell;

/// A text whose lines are found once, at the first question.
pub(crate) struct Places<'a> {
    bytes: &'a [u8],
    line_starts: OnceCell<Vec<usize>>,
}

impl<'a> Places<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Places {
            bytes,
            line_starts: OnceCell::new(),
        }
    }

    /// 1-based line and column, the column in characters.
    pub(crate) fn of(&self, offset: usize) -> (u32, u32) {
        let offset = offset.min(self.bytes.len());
        let starts = self.line_starts.get_or_init(|| {
            let after = self
                .bytes
                .iter()
                .enumerate()
                .filter(|(_, b)| **b == b'\n')
                .map(|(i, _)| i + 1);
            std::iter::once(0).chain(after).collect()
        });
        let line = starts.partition_point(|start| *start <= offset);
        let start = starts[line - 1];
        // Continuation bytes of UTF-8 do not begin a character.
        let characters = self.bytes[start..offset].iter().filter(|b| **b & 0xC0 != 0x80).count();
        (line as u32, characters as u32 + 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_count_characters_and_lines_count_from_one() {
        let places = Places::new("ab\nüx\n".as_bytes());
        assert_eq!(places.of(0), (1, 1));
        assert_eq!(places.of(2), (1, 3));
        assert_eq!(places.of(5), (2, 2));
        assert_eq!(places.of(99), (3, 1));
    }
}
