//! Lines of a program on the link: bounded, so that whoever keeps them knows how much that can be.

use machine::link::{Reader, Wire, WireError, Writer};

/// Bytes of a line at most; what is longer is cut, and ends in three dots.
pub const LONGEST_LINE: usize = 1_000;

/// A line as it goes over the link.
pub(super) fn bounded(line: &str) -> String {
    const DOTS: &str = " ...";
    if line.len() <= LONGEST_LINE {
        return line.to_owned();
    }
    let mut end = LONGEST_LINE - DOTS.len();
    while !line.is_char_boundary(end) {
        end -= 1;
    }
    format!("{}{DOTS}", &line[..end])
}

/// Writes a line.
pub(super) fn write(line: &str, to: &mut Writer<'_>) {
    let line = bounded(line);
    // No longer than a thousand.
    (line.len() as u16).write(to);
    to.put(line.as_bytes());
}

/// Reads what [`write()`] wrote.
pub(super) fn read(from: &mut Reader<'_>) -> Result<String, WireError> {
    let length = usize::from(u16::read(from)?);
    if length > LONGEST_LINE {
        return Err(from.unknown("a line of at most 1000 bytes"));
    }
    let bytes = (0..length).map(|_| u8::read(from)).collect::<Result<Vec<u8>, _>>()?;
    String::from_utf8(bytes).map_err(|_| from.unknown("a line in UTF-8"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_comes_out_as_it_went_in_and_a_long_one_is_cut_where_a_letter_ends() {
        for (line, cut) in [
            (String::new(), false),
            ("Ω".repeat(500), false),
            (format!("a{}", "Ω".repeat(500)), true),
        ] {
            let mut bytes = [0; 2_000];
            let mut writer = Writer::new(&mut bytes);
            write(&line, &mut writer);
            let end = writer.finish().expect("room");
            let mut reader = Reader::new(&bytes[..end]);
            let found = read(&mut reader).expect("a line");
            assert_eq!(reader.end(), Ok(()));
            assert_eq!(found == line, !cut);
            assert!(found.len() <= LONGEST_LINE && found.ends_with(" ...") == cut, "{found}");
        }
        let too_long = 1_001u16.to_le_bytes();
        assert!(read(&mut Reader::new(&too_long)).is_err());
        assert!(read(&mut Reader::new(&[1, 0, 0xff])).is_err(), "no UTF-8");
        assert!(read(&mut Reader::new(&[2, 0, b'a'])).is_err(), "too short");
    }
}
