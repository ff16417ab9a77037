//! A bounded queue in place: its size is a constant, and full is an answer.

/// First in, first out, at most `N` items, without an allocator.
///
/// One side owns it. Where two threads meet, the shell's lock-free queue hands items over and the realtime side drains it into this one,
/// which it can look into: stopping on the path needs to see what comes.
#[derive(Clone, Debug)]
pub struct Ring<T, const N: usize> {
    items: [Option<T>; N],
    first: usize,
    length: usize,
}

impl<T, const N: usize> Default for Ring<T, N> {
    fn default() -> Self {
        Ring::new()
    }
}

impl<T, const N: usize> Ring<T, N> {
    /// An empty one.
    pub const fn new() -> Self {
        Ring {
            items: [const { None }; N],
            first: 0,
            length: 0,
        }
    }

    /// Adds an item at the end.
    ///
    /// # Errors
    /// Gives the item back when there is no place: the caller keeps it.
    pub fn push(&mut self, item: T) -> Result<(), T> {
        if self.length == N {
            return Err(item);
        }
        self.items[Self::wrap(self.first + self.length)] = Some(item);
        self.length += 1;
        Ok(())
    }

    /// Takes the oldest item.
    pub fn pop(&mut self) -> Option<T> {
        if self.length == 0 {
            return None;
        }
        let item = self.items[self.first].take();
        self.first = Self::wrap(self.first + 1);
        self.length -= 1;
        item
    }

    /// Takes the newest item.
    pub fn pop_back(&mut self) -> Option<T> {
        let last = self.length.checked_sub(1)?;
        let item = self.items[Self::wrap(self.first + last)].take();
        self.length = last;
        item
    }

    /// The oldest item, left in place.
    pub fn front(&self) -> Option<&T> {
        self.get(0)
    }

    /// The item that `index` others stand before.
    pub fn get(&self, index: usize) -> Option<&T> {
        (index < self.length).then(|| self.items[Self::wrap(self.first + index)].as_ref())?
    }

    /// How many items there are.
    pub fn len(&self) -> usize {
        self.length
    }

    /// True when there is nothing in it.
    pub fn is_empty(&self) -> bool {
        self.length == 0
    }

    /// How many more it takes.
    pub fn free(&self) -> usize {
        N - self.length
    }

    /// Throws everything away and says how much that was.
    pub fn clear(&mut self) -> usize {
        let lost = self.length;
        while self.pop().is_some() {}
        lost
    }

    /// An index below 2 N, brought below N.
    const fn wrap(index: usize) -> usize {
        if index >= N { index - N } else { index }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::collections::VecDeque;

    #[test]
    fn full_is_an_answer_and_the_item_comes_back() {
        let mut ring = Ring::<u8, 2>::new();
        assert_eq!(ring.push(1), Ok(()));
        assert_eq!(ring.push(2), Ok(()));
        assert_eq!(ring.push(3), Err(3));
        assert_eq!((ring.pop(), ring.free()), (Some(1), 1));
    }

    #[test]
    fn it_behaves_like_an_unbounded_queue_that_is_never_overfilled() {
        let (mut ring, mut model) = (Ring::<u32, 7>::new(), VecDeque::new());
        let mut state = 1u32;
        for k in 0..10_000 {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            if state >> 28 == 0 {
                assert_eq!(ring.pop_back(), model.pop_back());
            } else if state >> 31 == 0 {
                let taken = ring.push(k).is_ok();
                assert_eq!(taken, model.len() < 7);
                if taken {
                    model.push_back(k);
                }
            } else {
                assert_eq!(ring.pop(), model.pop_front());
            }
            assert_eq!((ring.len(), ring.front()), (model.len(), model.front()));
            assert_eq!(ring.get(3), model.get(3));
        }
    }

    #[test]
    fn a_ring_without_places_is_always_full() {
        let mut ring = Ring::<u8, 0>::new();
        assert_eq!((ring.push(1), ring.pop(), ring.get(0)), (Err(1), None, None));
    }
}
