//! Integers in few bytes: blocks of 32 numbers, each block as wide as its largest.
//!
//! What a roll-up keeps is small once it is told relative to its neighbours (a maximum is a few quanta above the first reading), and
//! noise does not compress further; this packs and unpacks at memory speed and needs no compressor's header on a stream of ten numbers.

/// Numbers of one block.
const BLOCK: usize = 32;

/// Appends `numbers`; how many they are is to be told elsewhere.
pub(super) fn put(out: &mut Vec<u8>, numbers: impl IntoIterator<Item = u64>) {
    let mut numbers = numbers.into_iter();
    let mut block = Vec::with_capacity(BLOCK);
    loop {
        block.clear();
        block.extend(numbers.by_ref().take(BLOCK));
        if block.is_empty() {
            return;
        }
        let width = 64 - block.iter().fold(0, |all, n| all | n).leading_zeros();
        out.push(width as u8);
        let (mut held, mut bits) = (0u128, 0u32);
        for number in &block {
            held |= u128::from(*number) << bits;
            bits += width;
            while bits >= 8 {
                out.push(held as u8);
                held >>= 8;
                bits -= 8;
            }
        }
        if bits > 0 {
            out.push(held as u8);
        }
    }
}

/// Takes `count` numbers off the front of `bytes`; `None` when they are not there.
pub(super) fn take(bytes: &mut &[u8], count: usize) -> Option<Vec<u64>> {
    // A block of 32 numbers takes a byte at least: a count that cannot be is refused before memory is taken for it.
    if count.div_ceil(BLOCK) > bytes.len() {
        return None;
    }
    let mut numbers = Vec::with_capacity(count);
    while numbers.len() < count {
        let in_block = BLOCK.min(count - numbers.len());
        let (&width, rest) = bytes.split_first()?;
        let width = u32::from(width);
        if width > 64 {
            return None;
        }
        let packed = rest.get(..(in_block * width as usize).div_ceil(8))?;
        *bytes = &rest[packed.len()..];
        let mask = if width == 64 { u64::MAX } else { (1 << width) - 1 };
        let (mut held, mut bits, mut next) = (0u128, 0u32, packed.iter());
        for _ in 0..in_block {
            while bits < width {
                held |= u128::from(*next.next()?) << bits;
                bits += 8;
            }
            numbers.push(held as u64 & mask);
            held >>= width;
            bits -= width;
        }
    }
    Some(numbers)
}

/// A signed number as an unsigned one, small where it is small: 0, -1, 1, -2 ... become 0, 1, 2, 3 ...
pub(super) fn unsigned(number: i64) -> u64 {
    ((number << 1) ^ (number >> 63)) as u64
}

/// The way back.
pub(super) fn signed(number: u64) -> i64 {
    (number >> 1) as i64 ^ -((number & 1) as i64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn any_numbers_come_back(numbers in proptest::collection::vec(prop_oneof![0u64..4, any::<u64>()], 0..200), behind in any::<u8>()) {
            let mut bytes = Vec::new();
            put(&mut bytes, numbers.iter().copied());
            let whole = bytes.len();
            bytes.push(behind);
            let mut rest = &bytes[..];
            prop_assert_eq!(take(&mut rest, numbers.len()), Some(numbers.clone()));
            prop_assert_eq!(rest, &[behind]);
            if whole > 0 {
                prop_assert_eq!(take(&mut &bytes[..whole - 1], numbers.len()), None);
            }
        }

        #[test]
        fn signs_come_back(number in any::<i64>()) {
            prop_assert_eq!(signed(unsigned(number)), number);
        }
    }
}
