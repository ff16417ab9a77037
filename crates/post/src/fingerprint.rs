//! What a program does, in a few numbers: to tell whether it does the same on two machines that stand at different places.
//!
//! Places are added up and not hashed: their last bits differ when frames are taken in and out, and a coordinate that lies between two
//! increments is rounded one way or the other by them.

use plan::{Move, Path};
use std::fmt::{Debug, Write};
use units::Setup;

/// Sums and a hash over a program.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Fingerprint {
    hash: u64,
    sums: [f64; 4],
    count: u64,
}

impl Fingerprint {
    /// Takes in where a move goes; axes that it does not move stand where the machine has left them.
    pub(crate) fn travel(&mut self, go: &Move, path: &Path<Setup>) {
        let (start, end) = (path.start(), path.end());
        for k in 0..3 {
            if (end.xyz[k] - start.xyz[k]).abs() > 1e-6 {
                self.add(k, end.xyz[k]);
            }
        }
        if let Path::Arc(arc) = path {
            for k in (0..3).filter(|k| arc.normal.xyz[*k].abs() < 0.5) {
                self.add(k, arc.centre.xyz[k]);
            }
            self.number(arc.sweep.0);
        }
        if let plan::Speed::Feed(plan::Feed::PerTime(speed)) = go.speed {
            self.number(speed.0);
        }
    }

    /// Takes in a number.
    pub(crate) fn number(&mut self, value: f64) {
        self.add(3, value);
    }

    /// Takes in what is said exactly.
    pub(crate) fn word(&mut self, word: &dyn Debug) {
        struct Hashing(u64);
        impl Write for Hashing {
            fn write_str(&mut self, text: &str) -> std::fmt::Result {
                for byte in text.bytes() {
                    self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
                }
                Ok(())
            }
        }
        let mut hashing = Hashing(self.hash ^ 0xcbf2_9ce4_8422_2325);
        let _ = write!(hashing, "{word:?}");
        self.hash = hashing.0;
    }

    /// The same but for rounding.
    pub(crate) fn is_like(&self, other: &Fingerprint) -> bool {
        // A program that depends on the machine is off by millimetres at one place or more.
        let allowed = 1e-3 + 1e-8 * self.count as f64;
        let near = |(a, b): (&f64, &f64)| (a - b).abs() <= allowed || a.to_bits() == b.to_bits();
        self.hash == other.hash && self.count == other.count && self.sums.iter().zip(&other.sums).all(near)
    }

    fn add(&mut self, sum: usize, value: f64) {
        self.count += 1;
        // Weights between 1 and 2, so that moves that change places with each other are seen.
        let weight = 1.0 + (self.count.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40) as f64 / (1_u64 << 24) as f64;
        self.sums[sum] += weight * value;
    }
}
