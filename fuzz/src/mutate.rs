//! Damage to bytes, from a seed: flipped bits, cuts, doubled and swapped stretches, words of the format, other files' pieces.

/// SplitMix64: small, seeded, the same everywhere. (Public domain, Sebastiano Vigna.)
pub struct Random(pub u64);

impl Random {
    /// The next number.
    pub fn next_number(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }
    /// A number below `end`; 0 when `end` is 0.
    pub fn below(&mut self, end: usize) -> usize {
        (self.next_number() % (end.max(1) as u64)) as usize
    }
    fn range(&mut self, length: usize) -> std::ops::Range<usize> {
        let start = self.below(length + 1);
        // Mostly short: long cuts leave nothing to read.
        let longest = (length - start).min(if self.below(4) == 0 { usize::MAX } else { 16 });
        start..start + self.below(longest + 1)
    }
}

/// Longest input: longer ones only cost time.
pub const LONGEST: usize = 1 << 18;

/// One damaged input, made of one of the `seeds` (there is one at least) and perhaps pieces of others.
pub fn damaged(random: &mut Random, seeds: &[Vec<u8>], words: &[Vec<u8>]) -> Vec<u8> {
    // The smaller of two: a small input tells as much in less time.
    let (one, other) = (&seeds[random.below(seeds.len())], &seeds[random.below(seeds.len())]);
    let mut bytes = if one.len() <= other.len() {
        one.clone()
    } else {
        other.clone()
    };
    for _ in 0..=random.below(6) {
        once(random, &mut bytes, seeds, words);
    }
    bytes.truncate(LONGEST);
    bytes
}

fn once(random: &mut Random, bytes: &mut Vec<u8>, seeds: &[Vec<u8>], words: &[Vec<u8>]) {
    let length = bytes.len();
    let at = random.below(length);
    match random.below(10) {
        0 if length > 0 => bytes[at] ^= 1 << random.below(8),
        1 if length > 0 => bytes[at] = random.next_number() as u8,
        2 => bytes.insert(at, random.next_number() as u8),
        3 => {
            bytes.drain(random.range(length));
        }
        4 => {
            let piece = bytes[random.range(length)].to_vec();
            bytes.splice(at..at, piece);
        }
        5 => bytes.truncate(at),
        6 => {
            // The beginning of this one and the end of another.
            let other = &seeds[random.below(seeds.len())];
            let from = random.below(other.len());
            bytes.truncate(at);
            bytes.extend_from_slice(&other[from..]);
        }
        7 if !words.is_empty() => {
            let word = words[random.below(words.len())].clone();
            bytes.splice(at..at, word);
        }
        8 if !words.is_empty() => {
            let word = words[random.below(words.len())].clone();
            let place = random.range(length);
            bytes.splice(place, word);
        }
        _ => {
            // A number becomes another one: readers count with them.
            const NUMBERS: [&str; 9] = [
                "0",
                "-1",
                "1e308",
                "18446744073709551615",
                "9223372036854775808",
                "4294967296",
                "NaN",
                "1e-320",
                "00",
            ];
            let Some(start) = (0..length).map(|k| (at + k) % length).find(|k| bytes[*k].is_ascii_digit()) else {
                return;
            };
            let end = (start..length).find(|k| !bytes[*k].is_ascii_digit()).unwrap_or(length);
            bytes.splice(start..end, NUMBERS[random.below(NUMBERS.len())].bytes());
        }
    }
}

/// The words of a dictionary file: one a line, `\n`, `\r`, `\\` and `\xHH` stand for bytes.
pub fn dictionary(text: &str) -> Vec<Vec<u8>> {
    text.lines().filter(|line| !line.is_empty()).map(unescaped).collect()
}

fn unescaped(line: &str) -> Vec<u8> {
    let mut out = Vec::new();
    let mut rest = line.as_bytes();
    while let [first, tail @ ..] = rest {
        rest = match (first, tail) {
            (b'\\', [b'n', tail @ ..]) => {
                out.push(b'\n');
                tail
            }
            (b'\\', [b'r', tail @ ..]) => {
                out.push(b'\r');
                tail
            }
            (b'\\', [b'x', high, low, tail @ ..]) => {
                let digits = [*high, *low];
                let byte = std::str::from_utf8(&digits).ok().and_then(|d| u8::from_str_radix(d, 16).ok());
                out.extend(byte);
                tail
            }
            (b'\\', [any, tail @ ..]) => {
                out.push(*any);
                tail
            }
            (any, tail) => {
                out.push(*any);
                tail
            }
        };
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_seed_gives_the_same_damage_and_others_another() {
        let seeds = [b"#1=POINT('a',(0.,1.5));".to_vec(), b"G1 X10 F20".to_vec()];
        let words = dictionary("abc\\n\n\\x00\\\\");
        assert_eq!(words, [b"abc\n".to_vec(), vec![0, b'\\']]);
        let run = |seed| {
            let mut random = Random(seed);
            (0..500).map(|_| damaged(&mut random, &seeds, &words)).collect::<Vec<_>>()
        };
        assert_eq!(run(1), run(1));
        assert_ne!(run(1), run(2));
        assert!(run(1).iter().any(|bytes| !seeds.contains(bytes)));
    }

    #[test]
    fn no_seeds_at_all_is_no_trouble() {
        let mut random = Random(1);
        for _ in 0..1000 {
            damaged(&mut random, &[Vec::new()], &[]);
        }
    }
}
