//! HTTP answers with all their framings, and the parts of a multipart body.

use mtconnect::client::http::{HttpEvent, ResponseReader};
use mtconnect::client::multipart::{PartReader, boundary_of};

/// The same bytes in pieces of three sizes give the same head, parts and end.
pub fn run(bytes: &[u8]) {
    let whole = read(bytes, bytes.len().max(1));
    for size in [1, 7] {
        assert_eq!(read(bytes, size), whole, "in pieces of {size}");
    }
}

fn read(bytes: &[u8], size: usize) -> Vec<String> {
    const LONGEST: usize = 1 << 16;
    let mut http = ResponseReader::default();
    let (mut parts, mut body, mut seen) = (None, Vec::new(), Vec::new());
    for mut piece in bytes.chunks(size) {
        loop {
            match http.next(&mut piece) {
                Ok(None) => break,
                // The words of an error may show as many bytes as have come.
                Err(_) => {
                    seen.push("no HTTP".to_owned());
                    return seen;
                }
                Ok(Some(HttpEvent::Head(head))) => {
                    parts = boundary_of(&head.content_type).map(|b| PartReader::new(&b, LONGEST));
                    seen.push(format!("{head:?}"));
                }
                Ok(Some(HttpEvent::End)) => seen.push(format!("end of {}", std::mem::take(&mut body).len())),
                Ok(Some(HttpEvent::Body(piece))) => {
                    let Some(parts) = &mut parts else {
                        body.extend_from_slice(piece);
                        continue;
                    };
                    parts.receive(piece);
                    loop {
                        match parts.next_part() {
                            Ok(Some(part)) => seen.push(format!("{part:?}")),
                            Ok(None) => break,
                            Err(_) => {
                                seen.push("no part".to_owned());
                                return seen;
                            }
                        }
                    }
                }
            }
        }
    }
    seen
}
