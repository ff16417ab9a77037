//! A simulated connection: bytes on their way in both directions, late, held up, damaged, lost, all decided by a seed.

use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};
use std::collections::VecDeque;
use units::Tick;

/// One thing that goes wrong on the way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Damage {
    /// One bit is another.
    Bit,
    /// Some bytes are others.
    Bytes,
    /// A piece comes twice.
    Twice,
    /// Some bytes are missing.
    Missing,
    /// Two pieces that follow each other come in the other order.
    Swapped,
}

/// One direction of a connection.
#[derive(Clone, Debug)]
pub struct Way {
    /// Cycles that bytes are under way, at least and at most.
    pub delay: (u64, u64),
    dice: ChaCha8Rng,
    under_way: VecDeque<(Tick, Vec<u8>)>,
    held_until: Tick,
    last_arrival: Tick,
    damage: Option<Damage>,
    /// Pieces that were damaged.
    pub damaged: u64,
}

impl Way {
    /// A way with its delay and its dice.
    pub fn new(delay: (u64, u64), seed: u64) -> Self {
        Way {
            delay,
            dice: ChaCha8Rng::seed_from_u64(seed),
            under_way: VecDeque::new(),
            held_until: Tick(0),
            last_arrival: Tick(0),
            damage: None,
            damaged: 0,
        }
    }

    /// Bytes set out.
    pub fn send(&mut self, now: Tick, mut bytes: Vec<u8>) {
        if bytes.is_empty() {
            return;
        }
        if let Some(damage) = self.damage.take() {
            self.damaged += 1;
            bytes = self.damaged_bytes(bytes, damage);
        }
        let spread = self.delay.1.saturating_sub(self.delay.0) + 1;
        let delay = self.delay.0 + self.dice.next_u64() % spread;
        // A stream keeps its order.
        let at = Tick((now.0 + delay).max(self.last_arrival.0));
        self.last_arrival = at;
        self.under_way.push_back((at, bytes));
    }

    /// Bytes that have arrived.
    pub fn arrive(&mut self, now: Tick) -> Option<Vec<u8>> {
        let due = now >= self.held_until && self.under_way.front().is_some_and(|(at, _)| *at <= now);
        if due {
            self.under_way.pop_front().map(|(_, bytes)| bytes)
        } else {
            None
        }
    }

    /// Nothing arrives before then.
    pub fn hold_until(&mut self, until: Tick) {
        self.held_until = until;
    }

    /// The next bytes that set out are damaged.
    pub fn damage(&mut self, damage: Damage) {
        self.damage = Some(damage);
    }

    /// What is under way is lost.
    pub fn cut(&mut self) {
        self.under_way.clear();
        self.held_until = Tick(0);
    }

    fn up_to(&mut self, n: usize) -> usize {
        (self.dice.next_u64() % n.max(1) as u64) as usize
    }

    fn damaged_bytes(&mut self, mut bytes: Vec<u8>, damage: Damage) -> Vec<u8> {
        let at = self.up_to(bytes.len());
        let count = 1 + self.up_to((bytes.len() - at).min(40));
        match damage {
            Damage::Bit => bytes[at] ^= 1 << self.up_to(8),
            Damage::Bytes => {
                for byte in &mut bytes[at..at + count] {
                    *byte = self.dice.next_u64() as u8;
                }
            }
            Damage::Twice => {
                let piece = bytes[at..].to_vec();
                bytes.extend(piece);
            }
            Damage::Missing => drop(bytes.drain(at..at + count)),
            Damage::Swapped => {
                // At least a byte on either side; a single byte has nothing to change places with.
                let at = at.min(bytes.len().saturating_sub(2));
                let end = (at + 2 * count).min(bytes.len());
                let middle = (end - at) / 2;
                bytes[at..end].rotate_left(middle);
            }
        }
        bytes
    }
}
