//! MTConnectStreams documents: what an agent answers to `/current` and `/sample`.
//!
//! Elements are known by their local names, so any version and any prefix reads the same. A file may hold several documents one after
//! the other, also with the part headers of a multipart answer in between. Broken XML ends the reading with one error that says where;
//! what was read before is kept.

use crate::{instant, place::Places};
use plan::{Diagnostic, Diagnostics};
use quick_xml::XmlVersion;
use quick_xml::events::{BytesStart, Event};
use std::collections::BTreeMap;
use units::Timestamp;

/// A read document, or several.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Streams {
    /// One a document, in order.
    pub headers: Vec<Header>,
    /// Where observations come from: one entry for each component stream met.
    pub sources: Vec<Source>,
    /// In the order of the file.
    pub observations: Vec<Observation>,
    /// What was wrong, odd or left out.
    pub diagnostics: Diagnostics,
}

/// The agent's own words about an answer. Missing numbers are 0.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Header {
    /// When the answer was made.
    pub created: Option<Timestamp>,
    /// The agent's host.
    pub sender: String,
    /// Changes when the agent starts anew: sequence numbers of different instances have nothing to do with each other.
    pub instance: u64,
    /// The agent's version.
    pub version: String,
    /// Sequence to ask for next.
    pub next_sequence: u64,
    /// Oldest in the agent's buffer.
    pub first_sequence: u64,
    /// Newest in the agent's buffer.
    pub last_sequence: u64,
    /// How many observations the agent keeps.
    pub buffer_size: u64,
}

/// A component of a device.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Source {
    /// The device's name.
    pub device: String,
    /// The device's unique id.
    pub device_uuid: String,
    /// What kind of component: `Path`, `Linear`.
    pub component: String,
    /// Its name: `X`.
    pub name: String,
    /// Its id in the device model.
    pub id: String,
}

/// The three kinds of data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Category {
    /// Changes all the time.
    Sample,
    /// Changes now and then.
    Event,
    /// Well or not well.
    Condition,
}

/// One observation.
#[derive(Clone, Debug, PartialEq)]
pub struct Observation {
    /// The agent's number; rises with time within one instance. 0 when the file has none.
    pub sequence: u64,
    /// Which start of the agent it belongs to: rises by one each time the header's instance changes.
    pub instance: u32,
    /// When it was true.
    pub at: Timestamp,
    /// Sample, event or condition.
    pub category: Category,
    /// What was observed: the element's name for samples and events (`PathPosition`), the `type` attribute for conditions.
    pub kind: String,
    /// `ACTUAL`, `COMMANDED`; empty when the file does not say.
    pub sub_type: String,
    /// Id of the data item in the device model.
    pub item: String,
    /// Name of the data item; may be empty.
    pub name: String,
    /// Where from: index into [`Streams::sources`].
    pub source: usize,
    /// What it was.
    pub value: Value,
    /// 1-based line and column in the file.
    pub place: (u32, u32),
}

/// What was observed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Value {
    /// Nobody knows.
    Unavailable,
    /// As written, without surrounding blanks. A condition's level stands first: `Fault axis limit`. Entries of a data set are
    /// `key=value`, separated by blanks.
    Text(String),
}

/// Reads one or several MTConnectStreams documents. `file` is what the diagnostics call it.
pub fn read_streams(bytes: &[u8], file: &str) -> Streams {
    let mut reader = Reader {
        file,
        places: Places::new(bytes),
        streams: Streams::default(),
        known_sources: BTreeMap::new(),
        instance: 0,
    };
    // What is not UTF-8 ends the reading; what stands before it is read.
    let (text, rest) = match std::str::from_utf8(bytes) {
        Ok(text) => (text, None),
        Err(error) => {
            let valid = std::str::from_utf8(&bytes[..error.valid_up_to()]).expect("valid up to here");
            (valid, Some(error.valid_up_to()))
        }
    };
    if bytes.iter().all(u8::is_ascii_whitespace) {
        reader.note(
            Diagnostic::error("empty-file", "the file is empty: an MTConnectStreams document was expected"),
            0,
        );
        return reader.streams;
    }
    for (start, end) in documents(text) {
        reader.document(text, start, end, rest.is_some() && end == text.len());
    }
    if let Some(offset) = rest {
        reader.note(
            Diagnostic::error("not-utf8", "a byte that is not UTF-8 stands here; reading ends before it")
                .remedy("save the recording as UTF-8, or look whether it is damaged"),
            offset,
        );
    }
    reader.streams
}

/// Byte ranges of the documents in a file: each begins with its XML declaration, or there is one without.
fn documents(text: &str) -> Vec<(usize, usize)> {
    let mut starts: Vec<usize> = text.match_indices("<?xml ").map(|(at, _)| at).collect();
    if starts.is_empty() {
        starts.push(text.find('<').unwrap_or(0));
    }
    let ends = starts[1..].iter().copied().chain(std::iter::once(text.len()));
    starts.iter().copied().zip(ends).collect()
}

struct Reader<'a> {
    file: &'a str,
    places: Places<'a>,
    streams: Streams,
    known_sources: BTreeMap<(String, String, String), usize>,
    instance: u32,
}

/// Where in a document we are.
#[derive(Default)]
struct Open {
    /// Open elements.
    depth: usize,
    root_seen: bool,
    source: Source,
    source_index: usize,
    /// Depth and kind of the open `Samples`, `Events` or `Condition`.
    category: Option<(usize, Category)>,
    /// The observation being read and the depth of its element.
    observation: Option<(usize, Observation)>,
    text: String,
    /// The error being read and the depth of its element.
    error: Option<(usize, String)>,
}

impl Reader<'_> {
    fn note(&mut self, found: Diagnostic, offset: usize) {
        let (line, column) = self.places.of(offset);
        self.streams.diagnostics.add(found.in_file(self.file).at_line(line, column));
    }

    fn document(&mut self, text: &str, start: usize, end: usize, cut: bool) {
        let mut xml = quick_xml::Reader::from_str(&text[start..end]);
        let mut open = Open::default();
        loop {
            let at = start + xml.buffer_position() as usize;
            match xml.read_event() {
                Ok(Event::Start(element)) => {
                    open.depth += 1;
                    if !self.begin(&element, at, &mut open) {
                        return;
                    }
                }
                Ok(Event::Empty(element)) => {
                    open.depth += 1;
                    if !self.begin(&element, at, &mut open) {
                        return;
                    }
                    self.end(&mut open);
                }
                Ok(Event::End(_)) => {
                    self.end(&mut open);
                    if open.depth == 0 {
                        return; // what follows the root are part headers of a multipart answer
                    }
                }
                Ok(Event::Text(piece)) => open.text.push_str(&piece.xml10_content()),
                Ok(Event::CData(piece)) => open.text.push_str(&piece.xml10_content()),
                Ok(Event::GeneralRef(reference)) => match reference.resolve_char_ref() {
                    Ok(Some(c)) => open.text.push(c),
                    _ => open.text.push_str(match &*reference {
                        "lt" => "<",
                        "gt" => ">",
                        "amp" => "&",
                        "apos" => "'",
                        "quot" => "\"",
                        _ => "\u{FFFD}",
                    }),
                },
                Ok(Event::Eof) => {
                    if open.depth > 0 && !cut {
                        let depth = open.depth;
                        self.note(
                            Diagnostic::error(
                                "truncated",
                                format!("the document ends here with {depth} elements still open; what stands before was read"),
                            )
                            .remedy("fetch it again: the file was cut off"),
                            end,
                        );
                    } else if !open.root_seen {
                        self.note(Diagnostic::error("not-xml", "no XML element was found"), start);
                    }
                    return;
                }
                Ok(_) => {}
                Err(error) => {
                    if !cut {
                        let offset = start + xml.error_position() as usize;
                        self.note(
                            Diagnostic::error("broken-xml", format!("{error}; what stands before was read"))
                                .remedy("fetch the document again, or mend it here"),
                            offset,
                        );
                    }
                    return;
                }
            }
        }
    }

    /// An element begins; false when the rest of the document is of no use.
    fn begin(&mut self, element: &BytesStart<'_>, at: usize, open: &mut Open) -> bool {
        let local = element.local_name();
        let name: &str = local.as_ref();
        if !open.root_seen {
            open.root_seen = true;
            let what = match name {
                "MTConnectStreams" | "MTConnectError" => return true,
                "MTConnectDevices" => "this is a device model (MTConnectDevices): it holds no recorded values",
                "MTConnectAssets" => "this is a document of assets (MTConnectAssets): it holds no recorded values",
                _ => {
                    let found = format!("the root element is <{name}>; <MTConnectStreams> was expected");
                    self.note(
                        Diagnostic::error("not-streams", found).remedy("give a recording, the answer to /sample or /current"),
                        at,
                    );
                    return false;
                }
            };
            self.note(
                Diagnostic::error("not-streams", what).remedy("give the answer to /sample or /current"),
                at,
            );
            return false;
        }
        if let Some((_, observation)) = &open.observation {
            // Inside an observation: an entry of a data set or a table.
            let key = attribute(element, "key");
            if observation.category != Category::Condition && !key.is_empty() {
                if !open.text.is_empty() {
                    open.text.push(' ');
                }
                open.text.push_str(&key);
                open.text.push('=');
            }
            return true;
        }
        if let Some((depth, category)) = open.category {
            if open.depth == depth + 1 {
                self.observation(element, name, category, at, open);
            }
            return true;
        }
        match name {
            "Header" => self.header(element, at),
            "DeviceStream" => {
                open.source = Source {
                    device: attribute(element, "name"),
                    device_uuid: attribute(element, "uuid"),
                    ..Source::default()
                };
            }
            "ComponentStream" => {
                open.source.component = attribute(element, "component");
                open.source.name = attribute(element, "name");
                open.source.id = attribute(element, "componentId");
            }
            "Samples" => self.begin_category(Category::Sample, open),
            "Events" => self.begin_category(Category::Event, open),
            "Condition" | "Conditions" => self.begin_category(Category::Condition, open),
            "Error" => {
                open.text.clear();
                open.error = Some((open.depth, attribute(element, "errorCode")));
            }
            _ => {}
        }
        true
    }

    fn begin_category(&mut self, category: Category, open: &mut Open) {
        let key = (
            open.source.device_uuid.clone(),
            open.source.device.clone(),
            open.source.id.clone(),
        );
        let next = self.streams.sources.len();
        open.source_index = *self.known_sources.entry(key).or_insert(next);
        if open.source_index == next {
            self.streams.sources.push(open.source.clone());
        }
        open.category = Some((open.depth, category));
    }

    fn end(&mut self, open: &mut Open) {
        if open.observation.as_ref().is_some_and(|(depth, _)| *depth == open.depth) {
            let (_, mut observation) = open.observation.take().expect("just seen");
            let text = open.text.trim();
            observation.value = match (observation.category, &observation.value) {
                (Category::Condition, Value::Text(level)) if !text.is_empty() => Value::Text(format!("{level} {text}")),
                (Category::Condition, _) => observation.value,
                (_, _) if text == "UNAVAILABLE" => Value::Unavailable,
                (_, _) => Value::Text(text.to_owned()),
            };
            self.streams.observations.push(observation);
        } else if open.category.is_some_and(|(depth, _)| depth == open.depth) {
            open.category = None;
        } else if open.error.as_ref().is_some_and(|(depth, _)| *depth == open.depth) {
            let (_, code) = open.error.take().expect("just seen");
            let message = format!(
                "the agent answered with an error instead of data: {code}: {}",
                open.text.trim()
            );
            self.streams
                .diagnostics
                .add(Diagnostic::error("agent-error", message).in_file(self.file));
        }
        open.depth = open.depth.saturating_sub(1);
    }

    fn header(&mut self, element: &BytesStart<'_>, at: usize) {
        let header = header_of(element);
        if let Some(before) = self.streams.headers.last()
            && before.instance != header.instance
        {
            self.instance += 1;
            let message = "the agent was started anew in between: its sequence numbers begin again";
            self.note(Diagnostic::remark("new-instance", message), at);
        }
        self.streams.headers.push(header);
    }

    fn observation(&mut self, element: &BytesStart<'_>, name: &str, category: Category, at: usize, open: &mut Open) {
        let mut found = Observation {
            sequence: 0,
            instance: self.instance,
            at: Timestamp(0),
            category,
            kind: name.to_owned(),
            sub_type: String::new(),
            item: String::new(),
            name: String::new(),
            source: open.source_index,
            value: Value::Unavailable,
            place: self.places.of(at),
        };
        let mut time = None;
        let mut condition_type = String::new();
        for attribute in element.attributes().with_checks(false) {
            let Ok(attribute) = attribute else { continue };
            let Ok(value) = attribute.normalized_value(XmlVersion::Implicit1_0) else {
                continue;
            };
            match attribute.key.local_name().as_ref() {
                "sequence" => found.sequence = value.trim().parse().unwrap_or(0),
                "timestamp" => time = Some(value.into_owned()),
                "dataItemId" => found.item = value.into_owned(),
                "name" => found.name = value.into_owned(),
                "subType" => found.sub_type = value.into_owned(),
                "type" => condition_type = value.into_owned(),
                _ => {}
            }
        }
        open.text.clear();
        if category == Category::Condition {
            found.kind = condition_type;
            if name != "Unavailable" {
                found.value = Value::Text(name.to_owned());
            }
        }
        match time.as_deref().map(instant::parse) {
            Some(Some(instant)) => {
                found.at = instant;
                if found.sequence == 0 {
                    let message = format!("<{name}> has no sequence number; it stays where the file has it");
                    self.note(Diagnostic::remark("no-sequence", message), at);
                }
                open.observation = Some((open.depth, found));
            }
            Some(None) => {
                let text = time.unwrap_or_default();
                let message = format!("<{name}> has the timestamp \"{text}\", which is no RFC 3339 date; it was left out");
                self.note(Diagnostic::warning("bad-timestamp", message), at);
            }
            None => {
                let message = format!("<{name}> has no timestamp; it was left out");
                self.note(Diagnostic::warning("no-timestamp", message), at);
            }
        }
    }
}

/// The header of an answer of any kind.
pub(crate) fn header_of(element: &BytesStart<'_>) -> Header {
    let number = |name| attribute(element, name).trim().parse().unwrap_or(0);
    Header {
        created: instant::parse(&attribute(element, "creationTime")),
        sender: attribute(element, "sender"),
        instance: number("instanceId"),
        version: attribute(element, "version"),
        next_sequence: number("nextSequence"),
        first_sequence: number("firstSequence"),
        last_sequence: number("lastSequence"),
        buffer_size: number("bufferSize"),
    }
}

pub(crate) fn attribute(element: &BytesStart<'_>, name: &str) -> String {
    element
        .attributes()
        .with_checks(false)
        .flatten()
        .find(|a| a.key.local_name().as_ref() == name)
        .and_then(|a| a.normalized_value(XmlVersion::Implicit1_0).ok().map(|v| v.into_owned()))
        .unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use expect_test::{Expect, expect};

    #[track_caller]
    fn check(xml: &str, expected: Expect) {
        let streams = read_streams(xml.as_bytes(), "a.xml");
        let mut seen = String::new();
        for o in &streams.observations {
            let value = match &o.value {
                Value::Unavailable => "UNAVAILABLE",
                Value::Text(text) => text,
            };
            let source = &streams.sources[o.source];
            seen += &format!(
                "{}.{} {} {} {} {} = {value}\n",
                source.component, source.name, o.sequence, o.item, o.kind, o.sub_type
            );
        }
        for d in streams.diagnostics.as_slice() {
            seen += &format!("{d}\n");
        }
        expected.assert_eq(&seen);
    }

    const PLAIN: &str = r#"<?xml version="1.0"?>
<MTConnectStreams xmlns="urn:mtconnect.org:MTConnectStreams:1.3"><Header instanceId="7" sender="me" nextSequence="9"/>
<Streams><DeviceStream name="mill" uuid="u1"><ComponentStream component="Linear" name="X" componentId="x">
<Samples><Position dataItemId="xp" subType="ACTUAL" sequence="5" timestamp="2020-01-01T00:00:00Z">1.5</Position>
<Position dataItemId="xp" sequence="6" timestamp="2020-01-01T00:00:01Z">UNAVAILABLE</Position></Samples>
<Events><Block dataItemId="b" sequence="7" timestamp="2020-01-01T00:00:01Z">G1 X&lt;3&#62; &amp; <![CDATA[<raw>]]></Block>
<VariableDataSet dataItemId="v" sequence="8" timestamp="2020-01-01T00:00:01Z"><Entry key="a">1</Entry><Entry key="b">2</Entry></VariableDataSet></Events>
<Condition><Fault type="POSITION" dataItemId="c" sequence="8" timestamp="2020-01-01T00:00:01Z">limit</Fault><Normal type="LOAD" dataItemId="d" sequence="9" timestamp="2020-01-01T00:00:01Z"/></Condition>
</ComponentStream></DeviceStream></Streams></MTConnectStreams>"#;

    #[test]
    fn samples_events_and_conditions_are_read_with_their_source() {
        check(
            PLAIN,
            expect![[r#"
                Linear.X 5 xp Position ACTUAL = 1.5
                Linear.X 6 xp Position  = UNAVAILABLE
                Linear.X 7 b Block  = G1 X<3> & <raw>
                Linear.X 8 v VariableDataSet  = a=1 b=2
                Linear.X 8 c POSITION  = Fault limit
                Linear.X 9 d LOAD  = Normal
            "#]],
        );
    }

    #[test]
    fn a_prefix_changes_nothing() {
        let prefixed = PLAIN
            .replace("</", "</m:")
            .replace('<', "<m:")
            .replace("<m:/m:", "</m:")
            .replace("<m:?", "<?")
            .replace("<m:!", "<!")
            .replace("[<m:raw>", "[<raw>")
            .replace("xmlns=", "xmlns:m=");
        assert_eq!(read_streams(prefixed.as_bytes(), "").observations.len(), 6);
        assert!(read_streams(prefixed.as_bytes(), "").diagnostics.as_slice().is_empty());
    }

    #[test]
    fn a_cut_file_keeps_what_was_read_and_says_where_it_ends() {
        let cut = PLAIN.find("<Block").expect("there") + 20;
        check(
            &PLAIN[..cut],
            expect![[r#"
                Linear.X 5 xp Position ACTUAL = 1.5
                Linear.X 6 xp Position  = UNAVAILABLE
                error: a.xml:6:9: syntax error: attribute value not closed: `"` not found before end of input; what stands before was read; fetch the document again, or mend it here
            "#]],
        );
    }

    #[test]
    fn crossed_tags_are_one_error_at_their_place() {
        let crossed = PLAIN.replace("</Samples>", "</Sample>");
        check(
            &crossed,
            expect![[r#"
                Linear.X 5 xp Position ACTUAL = 1.5
                Linear.X 6 xp Position  = UNAVAILABLE
                error: a.xml:5:95: ill-formed document: expected `</Samples>`, but `</Sample>` was found; what stands before was read; fetch the document again, or mend it here
            "#]],
        );
    }

    #[test]
    fn other_documents_are_named() {
        check(
            "<MTConnectDevices/>",
            expect![[r#"
                error: a.xml:1:1: this is a device model (MTConnectDevices): it holds no recorded values; give the answer to /sample or /current
            "#]],
        );
        check(
            "<MTConnectError><Errors><Error errorCode=\"NO_DEVICE\">no such device</Error></Errors></MTConnectError>",
            expect![[r#"
                error: a.xml: the agent answered with an error instead of data: NO_DEVICE: no such device
            "#]],
        );
        check(
            "<html><p>404</html>",
            expect![[r#"
                error: a.xml:1:1: the root element is <html>; <MTConnectStreams> was expected; give a recording, the answer to /sample or /current
            "#]],
        );
        check(
            "  \n",
            expect![[r#"
            error: a.xml:1:1: the file is empty: an MTConnectStreams document was expected
        "#]],
        );
    }

    #[test]
    fn a_multipart_recording_reads_as_one() {
        let two = format!(
            "--part\r\nContent-type: text/xml\r\n\r\n{PLAIN}\r\n--part\r\nContent-length: 3\r\n\r\n{PLAIN}\r\n--part--\r\n"
        );
        let streams = read_streams(two.as_bytes(), "a.xml");
        assert_eq!(streams.observations.len(), 12);
        assert_eq!(streams.headers.len(), 2);
        assert!(streams.diagnostics.as_slice().is_empty(), "{:?}", streams.diagnostics);
        assert_eq!(streams.sources.len(), 1);
    }

    #[test]
    fn bad_times_are_left_out_and_counted() {
        let bad = PLAIN.replace("2020-01-01T00:00:01Z", "soon");
        let streams = read_streams(bad.as_bytes(), "a.xml");
        assert_eq!(streams.observations.len(), 1);
        assert_eq!(streams.diagnostics.as_slice()[0].code, "bad-timestamp");
        assert_eq!(streams.diagnostics.as_slice()[0].count, 5);
    }
}
