//! Answers of an agent: streams, device models, errors.

use mtconnect::client::document::{Document, read_document};
use mtconnect::client::items::Items;
use plan::Diagnostics;

/// Reads one document; every observation names an item that is known.
pub fn run(bytes: &[u8]) {
    let (mut items, mut diagnostics) = (Items::default(), Diagnostics::new());
    let text = String::from_utf8_lossy(bytes);
    if let Ok(Document::Streams(_, told)) = read_document(&text, "f", &mut items, &mut diagnostics) {
        for t in told {
            assert!(t.sequence > 0);
            items.get(t.item);
        }
    }
}
