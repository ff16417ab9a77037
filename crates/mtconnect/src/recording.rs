//! One entry for every form of recording: tells them apart by their first bytes.

use crate::shdr::{looks_like, read_shdr};
use crate::streams::{Streams, read_streams};
use crate::text::read_text;
use crate::track::{LengthUnit, StatedFrame, Track, of_streams};
use plan::{Diagnostic, Diagnostics};

/// What the caller knows about a recording that the recording may not say.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ReadOptions {
    /// The unit of its numbers. Overrides the standard's millimetres for a streams document; the text form's own first line is
    /// believed before it.
    pub unit: Option<LengthUnit>,
    /// The frame of its numbers; the text form's own first line is believed before it.
    pub frame: Option<StatedFrame>,
    /// Take positions from this data item (id or name) or SHDR key.
    pub item: Option<String>,
    /// Take positions from this device (name or uuid).
    pub device: Option<String>,
}

/// The forms.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// MTConnectStreams XML.
    Streams,
    /// An adapter's log.
    Shdr,
    /// `x y z dt_seconds sequence`.
    Text,
}

/// A read recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// Its form.
    pub form: Form,
    /// Its places.
    pub track: Track,
    /// What was wrong, odd, assumed or left out. With errors in it the track is what could be read all the same.
    pub diagnostics: Diagnostics,
}

/// Reads a recording of any form. `file` is what the diagnostics call it.
pub fn read(bytes: &[u8], file: &str, options: &ReadOptions) -> Reading {
    let mut diagnostics = Diagnostics::new();
    let form = form_of(bytes);
    let mut track = match form {
        Form::Streams => {
            let streams = read_streams(bytes, file);
            for found in streams.diagnostics.as_slice() {
                diagnostics.add(found.clone());
            }
            let (item, device) = (options.item.as_deref(), options.device.as_deref());
            of_streams(&streams, item, device, options.unit, file, &mut diagnostics)
        }
        Form::Shdr | Form::Text => {
            let text = plain_text(bytes, file, &mut diagnostics);
            if text.trim().is_empty() && !diagnostics.has_errors() {
                diagnostics.add(Diagnostic::error("empty-file", "the file is empty: a recording was expected").in_file(file));
                Track::default()
            } else if diagnostics.has_errors() && text.is_empty() {
                Track::default()
            } else if form == Form::Shdr {
                read_shdr(text, options.item.as_deref(), options.unit, file, &mut diagnostics)
            } else {
                read_text(text, options.unit, options.frame, file, &mut diagnostics)
            }
        }
    };
    track.frame = track.frame.or(options.frame);
    Reading {
        form,
        track,
        diagnostics,
    }
}

/// The places of observations that were read elsewhere: from a table. They are chosen as from a streams document.
pub fn of_observations(streams: &Streams, file: &str, options: &ReadOptions) -> Reading {
    let mut diagnostics = streams.diagnostics.clone();
    let (item, device) = (options.item.as_deref(), options.device.as_deref());
    let mut track = of_streams(streams, item, device, options.unit, file, &mut diagnostics);
    track.frame = track.frame.or(options.frame);
    Reading {
        form: Form::Streams,
        track,
        diagnostics,
    }
}

fn form_of(bytes: &[u8]) -> Form {
    let head = String::from_utf8_lossy(&bytes[..bytes.len().min(4096)]);
    let head = head.trim_start_matches('\u{FEFF}').trim_start();
    if head.starts_with('<') || (head.starts_with("--") && head.contains("<?xml")) {
        Form::Streams
    } else if head
        .lines()
        .find(|l| !l.trim().is_empty() && !l.starts_with('*'))
        .is_some_and(looks_like)
    {
        Form::Shdr
    } else {
        Form::Text
    }
}

/// The bytes as text; a binary file is named as such, a few bad bytes end the text before them.
fn plain_text<'a>(bytes: &'a [u8], file: &str, diagnostics: &mut Diagnostics) -> &'a str {
    if bytes.starts_with(b"PAR1") {
        diagnostics.add(Diagnostic::error("not-a-recording", "this is a Parquet file, not a text recording").in_file(file));
        return "";
    }
    if bytes.iter().take(4096).any(|b| *b == 0) {
        diagnostics.add(
            Diagnostic::error("binary-file", "this is a binary file, not a recording")
                .in_file(file)
                .remedy("give MTConnect XML, an SHDR log, or the text form `x y z dt_seconds sequence`"),
        );
        return "";
    }
    match std::str::from_utf8(bytes) {
        Ok(text) => text,
        Err(error) => {
            let (line, column) = crate::place::Places::new(bytes).of(error.valid_up_to());
            diagnostics.add(
                Diagnostic::error("not-utf8", "a byte that is not UTF-8 stands here; reading ends before it")
                    .in_file(file)
                    .at_line(line, column),
            );
            std::str::from_utf8(&bytes[..error.valid_up_to()]).expect("valid up to here")
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::disallowed_methods, reason = "sample recordings are read from the shared folder")]
    use super::*;
    use proptest::prelude::*;

    fn sample(name: &str) -> Option<Vec<u8>> {
        let path = format!("{}/../../../shared/samples/mtconnect/{name}", env!("CARGO_MANIFEST_DIR"));
        let bytes = std::fs::read(&path).ok();
        if bytes.is_none() {
            println!("skipped: {path} is not here");
        }
        bytes
    }

    #[test]
    fn the_recorded_mill_has_all_its_places_in_order() {
        let Some(bytes) = sample("moldy_100ms.xml") else { return };
        let reading = read(&bytes, "moldy_100ms.xml", &ReadOptions::default());
        assert_eq!(reading.form, Form::Streams);
        assert_eq!(reading.diagnostics.as_slice(), []);
        assert_eq!(reading.track.points.len(), 11520);
        assert_eq!(reading.track.points[0].position, [97.003, -64.005, 57.228]);
        assert!(reading.track.gaps.is_empty());
    }

    #[test]
    fn the_recorders_text_with_its_bad_start_is_read_and_its_gaps_are_marked() {
        let Some(bytes) = sample("DATA_head.txt") else { return };
        let reading = read(&bytes, "DATA_head.txt", &ReadOptions::default());
        assert_eq!(reading.form, Form::Text);
        assert_eq!(reading.track.points.len(), 22);
        let seconds: Vec<f64> = reading.track.gaps.iter().map(|g| g.to.since(g.from).0.round()).collect();
        assert_eq!(seconds, [114.0, 9815.0]);
    }

    #[test]
    fn a_day_of_shdr_in_inches_is_read() {
        let Some(bytes) = sample("nist-sms/GFAgie01-20160513-20160514.txt") else {
            return;
        };
        let options = ReadOptions {
            unit: Some(LengthUnit::Inch),
            ..ReadOptions::default()
        };
        let reading = read(&bytes, "GFAgie01", &options);
        assert_eq!(reading.form, Form::Shdr);
        assert_eq!(reading.track.source, "path_pos");
        assert!(reading.track.points.len() > 14_000, "{}", reading.track.points.len());
        assert!((reading.track.points[0].position[0] + 17.85184 * 25.4).abs() < 1e-9);
    }

    #[test]
    fn other_files_are_named_with_one_error() {
        let code = |bytes: &[u8]| {
            let reading = read(bytes, "f", &ReadOptions::default());
            assert!(reading.diagnostics.has_errors());
            reading.diagnostics.as_slice()[0].code
        };
        assert_eq!(code(b""), "empty-file");
        assert_eq!(code(b"\x7fELF\0\0\0"), "binary-file");
        assert_eq!(code(b"PAR1xx"), "not-a-recording");
        assert_eq!(code(b"<svg/>"), "not-streams");
        assert_eq!(code(b"1 2 3 0 1\n\xff"), "not-utf8");
    }

    proptest! {
        #[test]
        fn no_bytes_break_the_reader(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            read(&bytes, "f", &ReadOptions::default());
        }

        #[test]
        fn a_document_cut_or_damaged_anywhere_is_read_without_a_panic(cut in 0usize..2000, damage in any::<u8>(), at in 0usize..2000) {
            let xml = "<?xml version=\"1.0\"?><MTConnectStreams><Header instanceId=\"1\"/><Streams><DeviceStream name=\"d\" uuid=\"u\"><ComponentStream component=\"Path\" componentId=\"c\"><Samples><PathPosition dataItemId=\"p\" sequence=\"1\" timestamp=\"2020-01-01T00:00:00Z\">1 2 3</PathPosition><PathPosition dataItemId=\"p\" sequence=\"2\" timestamp=\"2020-01-01T00:00:01Z\">1 2 4</PathPosition></Samples></ComponentStream></DeviceStream></Streams></MTConnectStreams>";
            let mut bytes = xml.as_bytes()[..cut.min(xml.len())].to_vec();
            let length = bytes.len();
            if length > 0 {
                bytes[at % length] = damage;
            }
            read(&bytes, "f", &ReadOptions::default());
        }
    }
}
