//! ISO 10303-21: the index, every instance, and saving without a change.

use part21::{Edits, File};

/// Reads a file, parses all of it, and writes it back.
pub fn run(bytes: &[u8]) {
    let Ok(file) = File::read(bytes.to_vec()) else { return };
    for row in file.rows() {
        let _ = file.instance(row);
        file.users(row);
    }
    // Counts lines from the beginning: once is enough.
    if let Some(row) = file.rows().next_back() {
        file.position(file.offset(row));
    }
    file.schemas();
    if let Ok(saved) = Edits::new(&file).save() {
        assert_eq!(saved.bytes, bytes, "nothing was edited");
    }
}
