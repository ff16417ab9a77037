//! The plain text form: `x y z dt_seconds sequence`, one row a position.
//!
//! `dt` is the time since the row before; the first row's is 0. `UNAVAILABLE dt sequence` says that nothing is known. Ours begins with
//! one line that gives unit, frame and start; readers accept its absence, and so do we:
//!
//! ```text
//! # toolmark recording units=mm frame=machine start=2015-12-21T16:06:36.655Z source=agent 192.168.1.5
//! 97.003 -64.005 57.228 0 60949
//! 93.259 -68.583 22.606 0.108 60950
//! UNAVAILABLE 0.2 60951
//! # gap instance=1450384768 from_sequence=60952 to_sequence=60990 cause=overrun
//! # instance=1450400000 item=mill Mp1LPathPos
//! ```
//!
//! Two kinds of lines may stand between the rows: `# instance=` says that the sequence numbers after it are those of another start of
//! the agent, and from which item the positions are; `# gap` says that numbers are missing.

use crate::instant;
use crate::track::{LengthUnit, Row, StatedFrame, Track, TrackPoint, number, track_of};
use plan::{Diagnostic, Diagnostics};
use units::Timestamp;

/// What our own first line begins with.
pub const HEAD: &str = "# toolmark recording ";

/// Writes the text form, one line at a time, so that the shell can flush each.
#[derive(Clone, Debug, Default)]
pub struct TextWriter {
    last: Option<Timestamp>,
}

impl TextWriter {
    /// A writer and the first line, with its newline.
    pub fn begin(frame: Option<StatedFrame>, start: Timestamp, source: &str) -> (Self, String) {
        let frame = match frame {
            Some(StatedFrame::Machine) => "machine",
            Some(StatedFrame::Setup) => "setup",
            None => "unknown",
        };
        let source: String = source.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
        let line = format!(
            "{HEAD}units=mm frame={frame} start={} source={source}\n",
            instant::format(start)
        );
        (TextWriter { last: Some(start) }, line)
    }

    /// A writer that goes on after a row of that time.
    pub fn resume(last: Timestamp) -> Self {
        TextWriter { last: Some(last) }
    }

    /// The line that says which start of the agent the next rows belong to, and which item they are of.
    pub fn instance(instance: u64, item: &str) -> String {
        let item: String = item.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
        format!("# instance={instance} item={item}\n")
    }

    /// The line that says what is missing.
    pub fn gap(gap: &crate::client::gap::Gap) -> String {
        let to = gap.to_sequence.map_or("unknown".to_owned(), |to| to.to_string());
        let time = |name: &str, at: Option<Timestamp>| at.map_or(String::new(), |at| format!(" {name}={}", instant::format(at)));
        format!(
            "# gap instance={} from_sequence={} to_sequence={to} cause={}{}{}\n",
            gap.instance,
            gap.from_sequence,
            gap.cause.word(),
            time("from", gap.from),
            time("to", gap.to),
        )
    }

    /// The line of a point, with its newline. Coordinates and times come back to the last bit.
    pub fn point(&mut self, point: &TrackPoint) -> String {
        let [x, y, z] = point.position;
        format!("{x} {y} {z} {} {}\n", self.elapsed(point.at), point.sequence)
    }

    /// The line that says that nothing is known, with its newline.
    pub fn unavailable(&mut self, at: Timestamp, sequence: u64) -> String {
        format!("UNAVAILABLE {} {sequence}\n", self.elapsed(at))
    }

    /// Time since the row before as an exact decimal.
    fn elapsed(&mut self, at: Timestamp) -> String {
        let nanoseconds = i128::from(at.0) - i128::from(self.last.replace(at).unwrap_or(at).0);
        let (sign, size) = (if nanoseconds < 0 { "-" } else { "" }, nanoseconds.unsigned_abs());
        let text = format!("{sign}{}.{:09}", size / 1_000_000_000, size % 1_000_000_000);
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    }
}

/// Reads the text form. `unit` and `frame` are what the caller knows; the first line is believed before them.
pub(crate) fn read_text(
    text: &str,
    unit: Option<LengthUnit>,
    frame: Option<StatedFrame>,
    file: &str,
    diagnostics: &mut Diagnostics,
) -> Track {
    let mut head = Head {
        unit,
        frame,
        start: None,
        source: String::new(),
    };
    let mut rows = Vec::new();
    let mut elapsed: i128 = 0;
    let mut seen = false;
    let (mut instance, mut instance_said, mut lost) = (0u32, None, false);
    let mut note = |found: Diagnostic, line: usize| diagnostics.add(found.in_file(file).at_line(line as u32 + 1, 1));
    for (line, content) in text.lines().enumerate() {
        let content = content.trim_start_matches('\u{FEFF}').trim();
        if content.is_empty() {
            continue;
        }
        if let Some(comment) = content.strip_prefix('#') {
            if !seen {
                for found in head.read(comment) {
                    note(found, line);
                }
            }
            seen = true;
            let comment = comment.trim_start();
            lost |= comment.starts_with("gap ");
            if let Some(said) = comment.strip_prefix("instance=") {
                let said = said.split_whitespace().next().unwrap_or_default();
                instance += u32::from(instance_said.is_some_and(|before| before != said));
                instance_said = Some(said);
            }
            continue;
        }
        seen = true;
        let Some((dt, sequence, position)) = row(content) else {
            let shown: String = content.chars().take(60).collect();
            let message = format!(
                "\"{shown}\" is no row: `x y z dt_seconds sequence` or `UNAVAILABLE dt_seconds sequence` was expected; it was left out"
            );
            note(Diagnostic::warning("bad-row", message), line);
            continue;
        };
        elapsed += dt;
        let at = head.start.map_or(0, |start| start.0);
        let Ok(at) = i64::try_from(i128::from(at) + elapsed) else {
            note(
                Diagnostic::warning("bad-row", "the times add up to more than 292 years; the row was left out"),
                line,
            );
            elapsed -= dt;
            continue;
        };
        rows.push(Row {
            at: Timestamp(at),
            sequence,
            instance,
            position,
            lost: std::mem::take(&mut lost),
        });
    }
    if head.start.is_none() && !rows.is_empty() {
        let message = "the recording does not say when it began: its times count from 1970-01-01T00:00:00Z";
        diagnostics.add(Diagnostic::remark("no-start", message).in_file(file));
    }
    let mut track = track_of(rows, head.unit, file, diagnostics);
    track.frame = head.frame;
    track.start_stated = head.start.is_some();
    track.source = head.source;
    track
}

/// A row: the time since the one before in nanoseconds, the sequence number, and the place in the recording's unit; `None` there when
/// nothing is known. `None` for a line that is no row.
pub fn row(line: &str) -> Option<(i128, u64, Option<[f64; 3]>)> {
    let mut words = line.split_whitespace();
    let mut next = || words.next();
    let first = next()?;
    let position = if first == "UNAVAILABLE" {
        None
    } else {
        Some([number(first)?, number(next()?)?, number(next()?)?])
    };
    let (dt, sequence) = (nanoseconds(next()?)?, next()?.parse().ok()?);
    next().is_none().then_some((dt, sequence, position))
}

struct Head {
    unit: Option<LengthUnit>,
    frame: Option<StatedFrame>,
    start: Option<Timestamp>,
    source: String,
}

impl Head {
    fn read(&mut self, line: &str) -> Vec<Diagnostic> {
        let mut found = Vec::new();
        let (words, source) = line.split_once("source=").unwrap_or((line, ""));
        self.source = source.trim().to_owned();
        for word in words.split_whitespace() {
            let Some((name, value)) = word.split_once('=') else { continue };
            let known = match (name, value) {
                ("units", "mm") => {
                    self.unit = Some(LengthUnit::Millimetre);
                    true
                }
                ("units", "inch" | "in") => {
                    self.unit = Some(LengthUnit::Inch);
                    true
                }
                ("frame", "machine") => {
                    self.frame = Some(StatedFrame::Machine);
                    true
                }
                ("frame", "setup") => {
                    self.frame = Some(StatedFrame::Setup);
                    true
                }
                ("frame", "unknown") => true,
                ("start", date) => {
                    self.start = instant::parse(date);
                    self.start.is_some()
                }
                ("units" | "frame", _) => false,
                _ => true,
            };
            if !known {
                let message =
                    format!("{name}={value} is not known here: units=mm|inch, frame=machine|setup|unknown and start=DATE are");
                found.push(Diagnostic::error("bad-head", message));
            }
        }
        found
    }
}

/// Seconds as a decimal to whole nanoseconds, without the rounding of binary fractions.
fn nanoseconds(text: &str) -> Option<i128> {
    let (sign, digits) = match text.strip_prefix('-') {
        Some(rest) => (-1, rest),
        None => (1, text),
    };
    let (whole, fraction) = digits.split_once('.').unwrap_or((digits, ""));
    let plain = |part: &str| part.bytes().all(|b| b.is_ascii_digit());
    if plain(whole) && plain(fraction) && whole.len() + fraction.len() > 0 && whole.len() <= 11 {
        let whole: i128 = if whole.is_empty() { 0 } else { whole.parse().ok()? };
        let mut nanos: i128 = 0;
        for k in 0..9 {
            nanos = nanos * 10 + fraction.as_bytes().get(k).map_or(0, |b| i128::from(b - b'0'));
        }
        return Some(sign * (whole * 1_000_000_000 + nanos));
    }
    // `1e-3` and the like.
    number(text).filter(|s| s.abs() < 1e11).map(|s| (s * 1e9).round() as i128)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn read(text: &str) -> (Track, Diagnostics) {
        let mut diagnostics = Diagnostics::new();
        (read_text(text, None, None, "a.txt", &mut diagnostics), diagnostics)
    }

    #[test]
    fn the_published_form_without_a_first_line_is_read() {
        let (track, diagnostics) =
            read("UNAVAILABLE 0 27\n-355.578 -54.624 115.682 113.5839848 100\n-355.578 -54.624 238.364 0.307 105\n");
        assert_eq!(track.points.len(), 2);
        assert_eq!(track.points[1].at, Timestamp(113_890_984_800));
        assert_eq!(track.points[1].sequence, 105);
        assert_eq!(track.gaps[0].cause, crate::GapCause::Unavailable);
        assert!(!track.start_stated && !track.unit_stated);
        assert_eq!(diagnostics.as_slice()[0].code, "no-start");
    }

    #[test]
    fn the_first_line_gives_unit_frame_start_and_source() {
        let (track, diagnostics) =
            read("# units=inch frame=setup start=2020-01-01T00:00:00Z source=SIMULATED mill, seed 1\n1 2 3 0 1\n");
        assert_eq!(track.points[0].position, [25.4, 50.8, 76.199_999_999_999_99]);
        assert_eq!(track.frame, Some(StatedFrame::Setup));
        assert_eq!(instant::format(track.points[0].at), "2020-01-01T00:00:00Z");
        assert_eq!(track.source, "SIMULATED mill, seed 1");
        assert!(diagnostics.as_slice().is_empty());
    }

    #[test]
    fn a_row_that_is_none_is_counted_with_its_line() {
        let (track, diagnostics) = read("1 2 3 0 1\n1 2 3\nnan 2 3 0 4\n4 5 6 0.1 5\n");
        assert_eq!(track.points.len(), 2);
        let bad = &diagnostics.as_slice()[0];
        assert_eq!((bad.code, bad.line, bad.count), ("bad-row", 2, 2));
    }

    #[test]
    fn an_unknown_unit_is_an_error() {
        let (_, diagnostics) = read("# units=furlong\n1 2 3 0 1\n");
        assert!(diagnostics.has_errors());
        assert_eq!(diagnostics.as_slice()[0].line, 1);
    }

    #[test]
    fn inches_beyond_the_largest_number_of_millimetres_are_no_position() {
        let (track, diagnostics) = read("# units=inch\n1e308 2 3 0 1\n1 2 3 0.1 2\n");
        assert_eq!(track.points.len(), 1);
        assert!(
            diagnostics.as_slice().iter().any(|d| d.code == "bad-position"),
            "{diagnostics:?}"
        );
    }

    proptest! {
        #[test]
        fn what_is_written_is_read_back_to_the_last_bit(
            rows in prop::collection::vec((prop::array::uniform3(-1e6..1e6f64), 0i64..20_000_000_000), 1..50),
            start in 0i64..4_000_000_000_000_000_000,
        ) {
            let mut at = start;
            let points: Vec<TrackPoint> = rows.iter().enumerate().map(|(k, (position, dt))| {
                at += if k == 0 { 0 } else { *dt };
                TrackPoint { at: Timestamp(at), position: *position, sequence: k as u64 + 1 }
            }).collect();
            let (mut writer, mut text) = TextWriter::begin(Some(StatedFrame::Machine), Timestamp(start), "test");
            for point in &points {
                text += &writer.point(point);
            }
            let (track, diagnostics) = read(&text);
            prop_assert_eq!(track.points, points);
            prop_assert!(!diagnostics.has_errors());
        }

        #[test]
        fn no_text_breaks_the_reader(text in ".{0,200}") {
            read(&text);
        }
    }
}
