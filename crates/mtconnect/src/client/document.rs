//! One answer of an agent: observations, a device model, or errors. Pulled through once, without a tree.
//!
//! Elements are known by their local names, so any version from 1.0 on and any prefix reads the same. A document is taken whole or not
//! at all: a broken one is fetched again.

use super::items::{Items, Said};
use crate::instant;
use crate::streams::{Category, Header, Source, Value, attribute, header_of};
use plan::{Diagnostic, Diagnostics};
use quick_xml::XmlVersion;
use quick_xml::events::{BytesStart, Event};
use units::Timestamp;

/// How well it is with what a condition watches.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// Nobody knows.
    Unavailable,
    /// Well.
    Normal,
    /// Not well, and the machine goes on.
    Warning,
    /// The machine needs help.
    Fault,
}

impl Level {
    /// The word of the standard.
    pub fn word(self) -> &'static str {
        match self {
            Level::Unavailable => "Unavailable",
            Level::Normal => "Normal",
            Level::Warning => "Warning",
            Level::Fault => "Fault",
        }
    }

    /// The level of that word, in any case.
    pub fn of(word: &str) -> Option<Level> {
        [Level::Unavailable, Level::Normal, Level::Warning, Level::Fault]
            .into_iter()
            .find(|level| level.word().eq_ignore_ascii_case(word))
    }
}

/// An observation as an agent told it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Told {
    /// The agent's number of it.
    pub sequence: u64,
    /// Which start of the agent it belongs to: the header's `instanceId`.
    pub instance: u64,
    /// When it was true.
    pub at: Timestamp,
    /// What was observed: a number of [`Items`].
    pub item: u32,
    /// Conditions only.
    pub level: Option<Level>,
    /// As written, without surrounding blanks; of a condition its message. Entries of data sets and tables stand as in SHDR:
    /// `a=1 b={x y}`, `G54={X=1 Y=2}`; a removed entry is its key alone.
    pub value: Value,
    /// Every other attribute, as `name="value"` separated by blanks: `nativeCode="12"`, `resetTriggered="DAY"`.
    pub attributes: String,
}

/// An error of an agent, in its own words.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AgentError {
    /// `OUT_OF_RANGE`, `INVALID_XPATH`.
    pub code: String,
    /// What the agent says about it.
    pub message: String,
}

/// A read answer.
#[derive(Clone, Debug, PartialEq)]
pub enum Document {
    /// Observations, in the order of the document.
    Streams(Header, Vec<Told>),
    /// A device model: the names of its devices.
    Devices(Header, Vec<String>),
    /// Errors instead of data.
    Errors(Header, Vec<AgentError>),
}

/// Why a text is no answer of an agent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum NotRead {
    /// Its root is another element, or it has none: what it is.
    OtherKind(String),
    /// Broken XML, or cut off.
    Broken(String),
}

impl std::fmt::Display for NotRead {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            NotRead::OtherKind(what) | NotRead::Broken(what) => f.write_str(what),
        }
    }
}

/// Reads one document. `from` is what diagnostics call it.
///
/// # Errors
/// It is broken, or no answer of an agent.
pub fn read_document(text: &str, from: &str, items: &mut Items, diagnostics: &mut Diagnostics) -> Result<Document, NotRead> {
    let text = text.trim_start_matches('\u{FEFF}');
    let mut reader = Reader {
        from,
        items,
        diagnostics,
        root: None,
        header: Header::default(),
        told: Vec::new(),
        devices: Vec::new(),
        errors: Vec::new(),
        source: Source::default(),
        category: None,
        open: None,
        entries: String::new(),
        entry: Entry::default(),
        cell: String::new(),
        error: None,
        text: String::new(),
        depth: 0,
        last_item: None,
    };
    let mut xml = quick_xml::Reader::from_str(text);
    loop {
        match xml.read_event() {
            Ok(Event::Start(element)) => {
                reader.depth += 1;
                reader.begin(&element)?;
            }
            Ok(Event::Empty(element)) => {
                reader.depth += 1;
                reader.begin(&element)?;
                reader.end();
            }
            Ok(Event::End(_)) => {
                reader.end();
                if reader.depth == 0 {
                    break;
                }
            }
            // Only texts of observations and errors matter: blanks between elements do not.
            Ok(Event::Text(piece)) if reader.listens() => reader.text.push_str(&piece.xml10_content()),
            Ok(Event::CData(piece)) if reader.listens() => reader.text.push_str(&piece.xml10_content()),
            Ok(Event::GeneralRef(reference)) if reader.listens() => match reference.resolve_char_ref() {
                Ok(Some(c)) => reader.text.push(c),
                _ => reader.text.push_str(match &*reference {
                    "lt" => "<",
                    "gt" => ">",
                    "amp" => "&",
                    "apos" => "'",
                    "quot" => "\"",
                    _ => "\u{FFFD}",
                }),
            },
            Ok(Event::Eof) => {
                return Err(match reader.root {
                    Some(_) => NotRead::Broken("the document ends before its root element does".to_owned()),
                    None => NotRead::OtherKind("it is no XML document".to_owned()),
                });
            }
            Ok(_) => {}
            Err(error) => {
                let at = text.len().min(xml.error_position() as usize);
                let line = text.as_bytes()[..at].iter().filter(|b| **b == b'\n').count() + 1;
                let message = format!("line {line}: {error}");
                return Err(match reader.root {
                    Some(_) => NotRead::Broken(message),
                    None => NotRead::OtherKind(message),
                });
            }
        }
    }
    let header = reader.header;
    match reader.root {
        Some(Root::Streams) => Ok(Document::Streams(header, reader.told)),
        Some(Root::Devices) => Ok(Document::Devices(header, reader.devices)),
        Some(Root::Errors) => Ok(Document::Errors(header, reader.errors)),
        None => Err(NotRead::OtherKind("it is no XML document".to_owned())),
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Root {
    Streams,
    Devices,
    Errors,
}

struct Reader<'a> {
    from: &'a str,
    items: &'a mut Items,
    diagnostics: &'a mut Diagnostics,
    root: Option<Root>,
    header: Header,
    told: Vec<Told>,
    devices: Vec<String>,
    errors: Vec<AgentError>,
    source: Source,
    /// Depth and kind of the open `Samples`, `Events` or `Condition`.
    category: Option<(usize, Category)>,
    /// Depth of the open observation; it is the last of `told`.
    open: Option<usize>,
    entries: String,
    entry: Entry,
    cell: String,
    error: Option<OpenError>,
    text: String,
    depth: usize,
    last_item: Option<u32>,
}

impl Reader<'_> {
    fn listens(&self) -> bool {
        self.open.is_some() || self.error.is_some()
    }

    fn begin(&mut self, element: &BytesStart<'_>) -> Result<(), NotRead> {
        let local = element.local_name();
        let name: &str = local.as_ref();
        let Some(root) = self.root else {
            self.root = Some(match name {
                "MTConnectStreams" => Root::Streams,
                "MTConnectDevices" => Root::Devices,
                "MTConnectError" => Root::Errors,
                _ => return Err(NotRead::OtherKind(format!("its root element is <{name}>"))),
            });
            return Ok(());
        };
        if let Some(open) = self.open {
            self.entry(element, name, open);
            return Ok(());
        }
        if let Some((depth, category)) = self.category {
            if self.depth == depth + 1 {
                self.observation(element, name, category);
            }
            return Ok(());
        }
        if let Some(error) = &mut self.error {
            if self.depth == error.depth + 1 {
                error.child = name.to_owned();
            }
            self.text.clear();
            return Ok(());
        }
        match (root, name) {
            (_, "Header") => self.header = header_of(element),
            (Root::Streams, "DeviceStream") => {
                self.source = Source {
                    device: attribute(element, "name"),
                    device_uuid: attribute(element, "uuid"),
                    ..Source::default()
                };
            }
            (Root::Streams, "ComponentStream") => {
                self.source.component = attribute(element, "component");
                self.source.name = attribute(element, "name");
                self.source.id = attribute(element, "componentId");
                self.last_item = None;
            }
            (Root::Streams, "Samples") => self.category = Some((self.depth, Category::Sample)),
            (Root::Streams, "Events") => self.category = Some((self.depth, Category::Event)),
            (Root::Streams, "Condition" | "Conditions") => self.category = Some((self.depth, Category::Condition)),
            (Root::Devices, "Device" | "Agent") if self.depth == 3 => self.devices.push(attribute(element, "name")),
            (Root::Errors, "Errors") => {}
            (Root::Errors, _) => {
                self.text.clear();
                self.error = Some(OpenError {
                    depth: self.depth,
                    code: attribute(element, "errorCode"),
                    message: String::new(),
                    child: String::new(),
                });
            }
            _ => {}
        }
        Ok(())
    }

    fn end(&mut self) {
        if let Some(open) = self.open {
            match self.depth - open {
                0 => self.close_observation(),
                1 => self.close_entry(),
                2 => self.close_cell(),
                _ => {}
            }
        } else if self.category.is_some_and(|(depth, _)| depth == self.depth) {
            self.category = None;
        } else if let Some(error) = &mut self.error {
            let text = self.text.trim();
            if error.depth == self.depth {
                let message = if error.message.is_empty() { text } else { &error.message };
                self.errors.push(AgentError {
                    code: error.code.clone(),
                    message: message.to_owned(),
                });
                self.error = None;
            } else if error.child == "ErrorMessage" {
                error.message = text.to_owned();
                self.text.clear();
            } else {
                self.text.clear();
            }
        }
        self.depth = self.depth.saturating_sub(1);
    }

    fn close_observation(&mut self) {
        self.open = None;
        let Some(told) = self.told.last_mut() else { return };
        let text = self.text.trim();
        told.value = match told.level {
            Some(Level::Unavailable) => Value::Unavailable,
            None if !self.entries.is_empty() => Value::Text(std::mem::take(&mut self.entries)),
            None if text == "UNAVAILABLE" => Value::Unavailable,
            _ => Value::Text(text.to_owned()),
        };
    }

    /// An entry of a data set or a table, or a cell of a table, begins.
    fn entry(&mut self, element: &BytesStart<'_>, name: &str, open: usize) {
        let key = attribute(element, "key");
        match (self.depth - open, name) {
            (1, "Entry") => {
                self.entry = Entry {
                    key,
                    removed: attribute(element, "removed") == "true",
                    cells: String::new(),
                };
            }
            (2, "Cell") => self.cell = key,
            _ => return,
        }
        self.text.clear();
    }

    fn close_cell(&mut self) {
        let cell = std::mem::take(&mut self.cell);
        append_entry(&mut self.entry.cells, &cell, &braced(self.text.trim()));
        self.text.clear();
    }

    fn close_entry(&mut self) {
        let entry = std::mem::take(&mut self.entry);
        if entry.removed {
            append_entry(&mut self.entries, &entry.key, "");
            self.entries.pop(); // the equals sign
        } else if entry.cells.is_empty() {
            append_entry(&mut self.entries, &entry.key, &braced(self.text.trim()));
        } else {
            append_entry(&mut self.entries, &entry.key, &format!("{{{}}}", entry.cells));
        }
        self.text.clear();
    }

    fn observation(&mut self, element: &BytesStart<'_>, name: &str, category: Category) {
        let mut told = Told {
            sequence: 0,
            instance: self.header.instance,
            at: Timestamp(0),
            item: 0,
            level: None,
            value: Value::Unavailable,
            attributes: String::new(),
        };
        let mut time = None;
        let (mut id, mut item_name, mut sub_type, mut kind): (Text<'_>, Text<'_>, Text<'_>, Text<'_>) = Default::default();
        for attribute in element.attributes().with_checks(false).flatten() {
            let Ok(value) = attribute.normalized_value(XmlVersion::Implicit1_0) else {
                continue;
            };
            match attribute.key.local_name().as_ref() {
                "sequence" => told.sequence = value.trim().parse().unwrap_or(0),
                "timestamp" => time = Some(value),
                "dataItemId" => id = value,
                "name" => item_name = value,
                "subType" => sub_type = value,
                "type" if category == Category::Condition => kind = value,
                other => {
                    if !told.attributes.is_empty() {
                        told.attributes.push(' ');
                    }
                    told.attributes.push_str(other);
                    told.attributes.push_str("=\"");
                    told.attributes.push_str(&value.replace('"', "&quot;"));
                    told.attributes.push('"');
                }
            }
        }
        if category == Category::Condition {
            told.level = Level::of(name);
            if told.level.is_none() {
                let message = format!("<{name}> is no level of a condition; it was left out");
                return self.note(Diagnostic::warning("bad-level", message));
            }
        }
        let at = time.as_deref().and_then(instant::parse);
        let (Some(at), true) = (at, told.sequence > 0) else {
            let message = format!(
                "<{name}> with the timestamp \"{}\" and sequence {} cannot be put in order; it was left out",
                time.as_deref().unwrap_or_default(),
                told.sequence
            );
            return self.note(Diagnostic::warning("bad-observation", message));
        };
        told.at = at;
        let said = Said {
            source: &self.source,
            id: &id,
            name: &item_name,
            kind: if category == Category::Condition { &kind } else { name },
            sub_type: &sub_type,
            category,
        };
        told.item = self.items.number_of(&said, self.last_item);
        self.last_item = Some(told.item);
        self.text.clear();
        self.entries.clear();
        self.open = Some(self.depth);
        self.told.push(told);
    }

    fn note(&mut self, found: Diagnostic) {
        self.diagnostics.add(found.in_file(self.from));
    }
}

type Text<'a> = std::borrow::Cow<'a, str>;

/// The open entry of a data set or a table.
#[derive(Default)]
struct Entry {
    key: String,
    removed: bool,
    cells: String,
}

/// The open error.
struct OpenError {
    depth: usize,
    code: String,
    /// Since 2.6 the element's name says what kind of error it is, and its message is a child.
    message: String,
    child: String,
}

fn append_entry(entries: &mut String, key: &str, value: &str) {
    if !entries.is_empty() {
        entries.push(' ');
    }
    entries.push_str(key);
    entries.push('=');
    entries.push_str(value);
}

/// A value with blanks stands in braces, as in SHDR.
fn braced(value: &str) -> Text<'_> {
    if value.contains(|c: char| c.is_whitespace() || c == '{' || c == '}') {
        format!("{{{value}}}").into()
    } else {
        value.into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use expect_test::{Expect, expect};

    fn read(text: &str) -> (Result<Document, NotRead>, Items, Diagnostics) {
        let (mut items, mut diagnostics) = (Items::default(), Diagnostics::new());
        let document = read_document(text, "agent", &mut items, &mut diagnostics);
        (document, items, diagnostics)
    }

    #[track_caller]
    fn check(content: &str, expected: Expect) {
        let text = format!(
            "<?xml version=\"1.0\"?><m:MTConnectStreams xmlns:m=\"u\"><m:Header instanceId=\"7\" nextSequence=\"9\" firstSequence=\"1\" lastSequence=\"8\" bufferSize=\"64\"/><m:Streams><m:DeviceStream name=\"d\" uuid=\"u\"><m:ComponentStream component=\"Path\" name=\"P\" componentId=\"c\">{content}</m:ComponentStream></m:DeviceStream></m:Streams></m:MTConnectStreams>"
        );
        let (document, items, diagnostics) = read(&text);
        let Ok(Document::Streams(header, told)) = document else {
            panic!("{document:?}")
        };
        assert_eq!((header.instance, header.next_sequence, header.buffer_size), (7, 9, 64));
        let mut seen = String::new();
        for t in &told {
            let item = items.get(t.item);
            let level = t.level.map_or("", Level::word);
            seen += &format!(
                "{} {} {} {level} {:?} [{}]\n",
                t.sequence, item.id, item.kind, t.value, t.attributes
            );
        }
        for found in diagnostics.as_slice() {
            seen += &format!("{found}\n");
        }
        expected.assert_eq(&seen);
    }

    #[test]
    fn samples_events_and_conditions_keep_all_that_the_agent_says() {
        check(
            "<Samples><PathPosition dataItemId=\"p\" sequence=\"1\" timestamp=\"2026-01-01T00:00:00Z\"> 1 2 3 </PathPosition><Load dataItemId=\"l\" sequence=\"2\" timestamp=\"2026-01-01T00:00:00Z\" statistic=\"AVERAGE\" duration=\"10\">UNAVAILABLE</Load></Samples><Events><Program dataItemId=\"e\" sequence=\"3\" timestamp=\"2026-01-01T00:00:00Z\">a&amp;b&#65;<![CDATA[<x>]]></Program></Events><Condition><Fault dataItemId=\"f\" sequence=\"4\" timestamp=\"2026-01-01T00:00:00Z\" type=\"SYSTEM\" nativeCode=\"12\" qualifier=\"HIGH\">axis &quot;X&quot;</Fault><Normal dataItemId=\"f\" sequence=\"5\" timestamp=\"2026-01-01T00:00:00Z\" type=\"SYSTEM\"/><Unavailable dataItemId=\"f\" sequence=\"6\" timestamp=\"2026-01-01T00:00:00Z\" type=\"SYSTEM\"/></Condition>",
            expect![[r#"
                1 p PathPosition  Text("1 2 3") []
                2 l Load  Unavailable [statistic="AVERAGE" duration="10"]
                3 e Program  Text("a&bA<x>") []
                4 f SYSTEM Fault Text("axis \"X\"") [nativeCode="12" qualifier="HIGH"]
                5 f SYSTEM Normal Text("") []
                6 f SYSTEM Unavailable Unavailable []
            "#]],
        );
    }

    #[test]
    fn data_sets_and_tables_stand_as_in_shdr() {
        check(
            "<Events><VariableDataSet dataItemId=\"v\" sequence=\"1\" timestamp=\"2026-01-01T00:00:00Z\" count=\"3\"><Entry key=\"a\">1</Entry> <Entry key=\"b\">x y</Entry><Entry key=\"c\" removed=\"true\"/></VariableDataSet><WorkOffsetTable dataItemId=\"w\" sequence=\"2\" timestamp=\"2026-01-01T00:00:00Z\" count=\"2\"><Entry key=\"G54\"><Cell key=\"X\">1</Cell><Cell key=\"Y\">2</Cell></Entry><Entry key=\"G55\"><Cell key=\"X\">3</Cell></Entry></WorkOffsetTable></Events>",
            expect![[r#"
                1 v VariableDataSet  Text("a=1 b={x y} c") [count="3"]
                2 w WorkOffsetTable  Text("G54={X=1 Y=2} G55={X=3}") [count="2"]
            "#]],
        );
    }

    #[test]
    fn what_cannot_be_put_in_order_is_left_out_and_said() {
        check(
            "<Samples><A dataItemId=\"p\" sequence=\"1\" timestamp=\"yesterday\">1</A><A dataItemId=\"p\" timestamp=\"2026-01-01T00:00:00Z\">1</A></Samples><Condition><Bad dataItemId=\"f\" sequence=\"5\" timestamp=\"2026-01-01T00:00:00Z\" type=\"SYSTEM\"/></Condition>",
            expect![[r#"
                warning: agent: <A> with the timestamp "yesterday" and sequence 1 cannot be put in order; it was left out (2 times)
                warning: agent: <Bad> is no level of a condition; it was left out
            "#]],
        );
    }

    #[test]
    fn errors_of_every_version_keep_code_and_words() {
        for text in [
            "<MTConnectError><Header instanceId=\"1\"/><Error errorCode=\"OUT_OF_RANGE\">too old</Error></MTConnectError>",
            "<MTConnectError><Header instanceId=\"1\"/><Errors><Error errorCode=\"OUT_OF_RANGE\">too old</Error></Errors></MTConnectError>",
            "<MTConnectError><Header instanceId=\"1\"/><Errors><OutOfRange errorCode=\"OUT_OF_RANGE\"><URI>/sample</URI><Request>MTConnectStreams</Request><ErrorMessage>too old</ErrorMessage><QueryParameter name=\"from\"><Value>1</Value></QueryParameter></OutOfRange></Errors></MTConnectError>",
        ] {
            let Ok(Document::Errors(header, errors)) = read(text).0 else {
                panic!("{text}")
            };
            let expected = AgentError {
                code: "OUT_OF_RANGE".to_owned(),
                message: "too old".to_owned(),
            };
            assert_eq!((header.instance, errors), (1, vec![expected]));
        }
    }

    #[test]
    fn device_models_name_their_devices_and_other_things_are_named() {
        let (document, _, _) = read(
            "<MTConnectDevices><Header instanceId=\"1\"/><Devices><Agent name=\"A\"/><Device name=\"VMC\"><Components/></Device></Devices></MTConnectDevices>",
        );
        let Ok(Document::Devices(_, names)) = document else {
            panic!("{document:?}")
        };
        assert_eq!(names, ["A", "VMC"]);
        assert!(matches!(read("<html></html>").0, Err(NotRead::OtherKind(what)) if what.contains("<html>")));
        assert!(matches!(read("{\"a\":1}").0, Err(NotRead::OtherKind(_))));
        assert!(matches!(read("<MTConnectStreams><Header/>").0, Err(NotRead::Broken(_))));
        assert!(matches!(read("<MTConnectStreams></Header>").0, Err(NotRead::Broken(what)) if what.starts_with("line 1")));
    }
}
