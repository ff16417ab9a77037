//! The published text protocol: lines that end in `@` towards the machine, whole lines from it.
//!
//! | towards the machine | |
//! |---|---|
//! | `A@` | automatic mode |
//! | `JX@` `JY@` `JZ@` | jog mode on that axis; it moves nothing |
//! | `M1@` `M0@` | machining begins, ends |
//! | `P1@` `P0@` | an operation begins, with or without coolant |
//! | `S150@` | spindle, 0..=255, clockwise; 255 is its full speed |
//! | `F150@` | jog feed, 0..=255 |
//! | `T1 34@` | tool number, its length in whole mm |
//! | `H@` | go home |
//! | `10 45334 0 34623 -3 54934@` | speed and position of X, Y, Z: -255..=255 of full speed, 1000 pulses in a mm; one line for each ms |
//! | `#@` | the operation ends: coolant off |
//!
//! | from the machine | |
//! |---|---|
//! | `E1` `E0` | emergency stop begins, is over |
//! | `A` `JX` `JY` `JZ` | the mode that is in force |
//! | `45334 34623 54934` | where the axes stand, once each time the joystick stops |
//! | `H` | home was reached |
//!
//! Between `P` and `#` lines are movements, and those that begin with `T` or `S` are still commands; any other letter is an error there.
//! Outside, movements are errors. White space before a line, between numbers and behind the last does not matter, anywhere else
//! it is an error; so a line feed after `@` does no harm. A line has 64 bytes at most.

use core::fmt::Write as _;
use units::Axis;

/// Pulses in a millimetre.
pub const PULSES_PER_MM: f64 = 1000.0;
/// The number for full speed.
pub const FULL: i16 = 255;
/// Bytes of a line at most, without its end.
pub const LINE: usize = 64;

/// A line towards the machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Line {
    /// `A`
    Automatic,
    /// `JX`, `JY`, `JZ`
    Jog(Axis),
    /// `M1`
    MachiningBegins,
    /// `M0`
    MachiningEnds,
    /// `P1`, `P0`
    OperationBegins {
        /// Coolant on.
        coolant: bool,
    },
    /// `S150`
    Spindle(u8),
    /// `F150`
    JogFeed(u8),
    /// `T1 34`
    Tool {
        /// Its number.
        number: u32,
        /// Its length, mm.
        length: u32,
    },
    /// `H`
    Home,
    /// Six numbers: X, Y, Z.
    Movement([Movement; 3]),
    /// `#`
    OperationEnds,
}

/// One axis of a movement line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Movement {
    /// -255..=255 of the axis's full speed.
    pub speed: i16,
    /// Pulses.
    pub position: i32,
}

/// A line from the machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Told {
    /// `E1`, `E0`
    EmergencyStop(bool),
    /// `A`
    Automatic,
    /// `JX`, `JY`, `JZ`
    Jog(Axis),
    /// Where the axes stand, pulses.
    Position([i32; 3]),
    /// `H`
    Home,
}

/// A line as bytes.
#[derive(Clone, Copy)]
pub struct Text {
    bytes: [u8; LINE + 1],
    length: usize,
}

impl Text {
    const fn new() -> Self {
        Text {
            bytes: [0; LINE + 1],
            length: 0,
        }
    }

    /// The bytes, with the end of the line.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes[..self.length]
    }
}

impl core::fmt::Write for Text {
    fn write_str(&mut self, text: &str) -> core::fmt::Result {
        let place = self
            .bytes
            .get_mut(self.length..self.length + text.len())
            .ok_or(core::fmt::Error)?;
        place.copy_from_slice(text.as_bytes());
        self.length += text.len();
        Ok(())
    }
}

impl Line {
    /// The line as it is sent, `@` included.
    pub fn text(&self) -> Text {
        let mut to = Text::new();
        let written = match self {
            Line::Automatic => write!(to, "A@"),
            Line::Jog(axis) => write!(to, "J{axis}@"),
            Line::MachiningBegins => write!(to, "M1@"),
            Line::MachiningEnds => write!(to, "M0@"),
            Line::OperationBegins { coolant } => write!(to, "P{}@", u8::from(*coolant)),
            Line::Spindle(speed) => write!(to, "S{speed}@"),
            Line::JogFeed(speed) => write!(to, "F{speed}@"),
            Line::Tool { number, length } => write!(to, "T{number} {length}@"),
            Line::Home => write!(to, "H@"),
            Line::Movement([x, y, z]) => write!(
                to,
                "{} {} {} {} {} {}@",
                x.speed, x.position, y.speed, y.position, z.speed, z.position
            ),
            Line::OperationEnds => write!(to, "#@"),
        };
        // The longest is a movement: 3 * (4 + 1 + 11 + 1) = 51 bytes.
        debug_assert!(written.is_ok());
        to
    }
}

impl Told {
    /// The line as it is sent, line feed included.
    pub fn text(&self) -> Text {
        let mut to = Text::new();
        let written = match self {
            Told::EmergencyStop(on) => writeln!(to, "E{}", u8::from(*on)),
            Told::Automatic => writeln!(to, "A"),
            Told::Jog(axis) => writeln!(to, "J{axis}"),
            Told::Position([x, y, z]) => writeln!(to, "{x} {y} {z}"),
            Told::Home => writeln!(to, "H"),
        };
        debug_assert!(written.is_ok());
        to
    }
}

/// A line that is none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineError {
    /// Which line of the connection, from 1.
    pub line: u64,
    /// Where in it, from 1.
    pub column: usize,
    /// Where in the connection, bytes from its start.
    pub offset: u64,
    /// What is wrong there.
    pub fault: LineFault,
}

/// What can be wrong with a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineFault {
    /// It does not end.
    TooLong,
    /// Nothing stands in it.
    Empty,
    /// No line begins with this byte.
    Unknown(u8),
    /// Something else has to stand here.
    Expected(&'static str),
    /// A number outside its range.
    Range(&'static str),
    /// A movement line outside an operation.
    MovementOutside,
    /// Between `P` and `#` only movements, `T`, `S` and `#` may stand.
    NotInOperation,
    /// `#` without `P`.
    NoOperation,
}

impl core::fmt::Display for LineError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "line {}, column {}: ", self.line, self.column)?;
        match self.fault {
            LineFault::TooLong => write!(f, "no line is longer than {LINE} bytes: its end is missing"),
            LineFault::Empty => write!(f, "the line is empty"),
            LineFault::Unknown(byte) => write!(f, "no line begins with '{}'", byte.escape_ascii()),
            LineFault::Expected(what) => write!(f, "{what} was expected"),
            LineFault::Range(what) => write!(f, "{what} was expected"),
            LineFault::MovementOutside => write!(f, "a movement outside an operation: send P1 or P0 before"),
            LineFault::NotInOperation => write!(
                f,
                "between P and # only movements, T, S and # may stand: end the operation with # before"
            ),
            LineFault::NoOperation => write!(f, "# without an operation: send P1 or P0 before"),
        }
    }
}
impl core::error::Error for LineError {}

/// Bytes of one direction put together to lines.
#[derive(Clone, Debug)]
struct Assembly {
    bytes: [u8; LINE],
    length: usize,
    /// Of the connection: bytes so far, and lines so far.
    offset: u64,
    lines: u64,
    /// Of the line in the making.
    begins: u64,
    too_long: bool,
}

impl Assembly {
    const fn new() -> Self {
        Assembly {
            bytes: [0; LINE],
            length: 0,
            offset: 0,
            lines: 0,
            begins: 0,
            too_long: false,
        }
    }

    /// Takes a byte; true when a line is whole. `\r` and white space before a line are left out.
    fn take(&mut self, byte: u8, end: u8) -> bool {
        if self.length == 0 && !self.too_long && byte != end && byte.is_ascii_whitespace() {
            self.offset += 1;
            self.begins = self.offset;
            return false;
        }
        self.offset += 1;
        if byte == end {
            self.lines += 1;
            return true;
        }
        match self.bytes.get_mut(self.length) {
            Some(place) => {
                *place = byte;
                self.length += 1;
            }
            None => self.too_long = true,
        }
        false
    }

    fn error(&self, column: usize, fault: LineFault) -> LineError {
        LineError {
            line: self.lines,
            column: column + 1,
            offset: self.begins + column as u64,
            fault,
        }
    }

    fn clear(&mut self) {
        (self.length, self.too_long) = (0, false);
        self.begins = self.offset;
    }
}

/// Reads lines towards the machine from bytes however they were split.
#[derive(Clone, Debug)]
pub struct LineReader {
    assembly: Assembly,
    in_operation: bool,
}

impl Default for LineReader {
    fn default() -> Self {
        LineReader::new()
    }
}

impl LineReader {
    /// At the start of a connection.
    pub const fn new() -> Self {
        LineReader {
            assembly: Assembly::new(),
            in_operation: false,
        }
    }

    /// Takes a byte; gives a line when it is whole.
    pub fn take(&mut self, byte: u8) -> Option<Result<Line, LineError>> {
        if self.assembly.take(byte, b'@') {
            let read = self.line();
            self.assembly.clear();
            return Some(read);
        }
        None
    }

    /// True between `P` and `#`.
    pub fn in_operation(&self) -> bool {
        self.in_operation
    }

    /// Bytes of a line that has not ended.
    pub fn pending(&self) -> usize {
        self.assembly.length
    }

    fn line(&mut self) -> Result<Line, LineError> {
        let a = &self.assembly;
        if a.too_long {
            return Err(a.error(LINE, LineFault::TooLong));
        }
        let read = read_line(&a.bytes[..a.length]).map_err(|(column, fault)| a.error(column, fault))?;
        let misplaced = match (read, self.in_operation) {
            (Line::Movement(_) | Line::Tool { .. } | Line::Spindle(_) | Line::OperationEnds, true) => None,
            (_, true) => Some(LineFault::NotInOperation),
            (Line::Movement(_), false) => Some(LineFault::MovementOutside),
            (Line::OperationEnds, false) => Some(LineFault::NoOperation),
            (_, false) => None,
        };
        if let Some(fault) = misplaced {
            return Err(a.error(0, fault));
        }
        match read {
            Line::OperationBegins { .. } => self.in_operation = true,
            Line::OperationEnds => self.in_operation = false,
            _ => {}
        }
        Ok(read)
    }
}

/// Reads lines from the machine.
#[derive(Clone, Debug)]
pub struct ToldReader {
    assembly: Assembly,
}

impl Default for ToldReader {
    fn default() -> Self {
        ToldReader::new()
    }
}

impl ToldReader {
    /// At the start of a connection.
    pub const fn new() -> Self {
        ToldReader {
            assembly: Assembly::new(),
        }
    }

    /// Takes a byte; gives a line when it is whole. A carriage return before the line feed does no harm.
    pub fn take(&mut self, byte: u8) -> Option<Result<Told, LineError>> {
        if !self.assembly.take(byte, b'\n') {
            return None;
        }
        let a = &self.assembly;
        let line = a.bytes[..a.length].trim_ascii_end();
        let read = if a.too_long {
            Err(a.error(LINE, LineFault::TooLong))
        } else {
            read_told(line).map_err(|(column, fault)| a.error(column, fault))
        };
        self.assembly.clear();
        Some(read)
    }
}

type Misread = (usize, LineFault);

fn read_line(line: &[u8]) -> Result<Line, Misread> {
    let (&letter, rest) = line.split_first().ok_or((0, LineFault::Empty))?;
    let nothing_more = |read| match rest {
        [] => Ok(read),
        _ => Err((1, LineFault::Expected("'@'"))),
    };
    match letter {
        b'A' => nothing_more(Line::Automatic),
        b'H' => nothing_more(Line::Home),
        b'#' => nothing_more(Line::OperationEnds),
        b'J' => Ok(Line::Jog(axis(rest)?)),
        b'M' => Ok(if switch(rest)? {
            Line::MachiningBegins
        } else {
            Line::MachiningEnds
        }),
        b'P' => Ok(Line::OperationBegins { coolant: switch(rest)? }),
        b'S' => byte(line).map(Line::Spindle),
        b'F' => byte(line).map(Line::JogFeed),
        b'T' => {
            let mut numbers = Numbers { line, at: 1 };
            if !line.get(1).is_some_and(u8::is_ascii_digit) {
                return Err((1, LineFault::Expected("a tool number")));
            }
            let number = numbers.next(0, i64::from(u32::MAX), "a tool number")?;
            let length = numbers.next(0, 9999, "a tool length of 0 to 9999 mm")?;
            numbers.end()?;
            Ok(Line::Tool {
                number: number as u32,
                length: length as u32,
            })
        }
        b'-' | b'+' | b'0'..=b'9' => {
            let mut numbers = Numbers { line, at: 0 };
            let mut axes = [Movement::default(); 3];
            for axis in &mut axes {
                axis.speed = numbers.next(-255, 255, "a speed of -255 to 255")? as i16;
                axis.position = numbers.next(i64::from(i32::MIN), i64::from(i32::MAX), "a position in pulses")? as i32;
            }
            numbers.end()?;
            Ok(Line::Movement(axes))
        }
        other => Err((0, LineFault::Unknown(other))),
    }
}

fn read_told(line: &[u8]) -> Result<Told, Misread> {
    let (&letter, rest) = line.split_first().ok_or((0, LineFault::Empty))?;
    match letter {
        b'E' => switch(rest).map(Told::EmergencyStop),
        b'J' => axis(rest).map(Told::Jog),
        b'A' | b'H' if !rest.is_empty() => Err((1, LineFault::Expected("the end of the line"))),
        b'A' => Ok(Told::Automatic),
        b'H' => Ok(Told::Home),
        b'-' | b'+' | b'0'..=b'9' => {
            let mut numbers = Numbers { line, at: 0 };
            let mut position = [0; 3];
            for axis in &mut position {
                *axis = numbers.next(i64::from(i32::MIN), i64::from(i32::MAX), "a position in pulses")? as i32;
            }
            numbers.end()?;
            Ok(Told::Position(position))
        }
        other => Err((0, LineFault::Unknown(other))),
    }
}

fn switch(rest: &[u8]) -> Result<bool, Misread> {
    match rest {
        b"0" => Ok(false),
        b"1" => Ok(true),
        _ => Err((1, LineFault::Expected("0 or 1"))),
    }
}

fn axis(rest: &[u8]) -> Result<Axis, Misread> {
    match rest {
        b"X" => Ok(Axis::X),
        b"Y" => Ok(Axis::Y),
        b"Z" => Ok(Axis::Z),
        _ => Err((1, LineFault::Expected("X, Y or Z"))),
    }
}

/// The number behind the letter, 0..=255.
fn byte(line: &[u8]) -> Result<u8, Misread> {
    if !line.get(1).is_some_and(u8::is_ascii_digit) {
        return Err((1, LineFault::Expected("a number of 0 to 255")));
    }
    let mut numbers = Numbers { line, at: 1 };
    let number = numbers.next(0, 255, "a number of 0 to 255")?;
    numbers.end()?;
    Ok(number as u8)
}

/// Whole numbers with white space between them.
struct Numbers<'a> {
    line: &'a [u8],
    at: usize,
}

impl Numbers<'_> {
    fn next(&mut self, lowest: i64, highest: i64, what: &'static str) -> Result<i64, Misread> {
        while self.line.get(self.at).is_some_and(u8::is_ascii_whitespace) {
            self.at += 1;
        }
        let begins = self.at;
        let negative = self.line.get(self.at) == Some(&b'-');
        if matches!(self.line.get(self.at), Some(b'-' | b'+')) {
            self.at += 1;
        }
        let mut number = 0i64;
        let digits = self.at;
        while let Some(digit) = self.line.get(self.at).filter(|b| b.is_ascii_digit()) {
            // Beyond any range it stays there; a line is short, so it cannot overflow before.
            number = (number * 10 + i64::from(digit - b'0')).min(i64::from(u32::MAX) + 1);
            self.at += 1;
        }
        if self.at == digits {
            return Err((self.at, LineFault::Expected(what)));
        }
        // A number ends where white space or the line ends.
        if self.line.get(self.at).is_some_and(|b| !b.is_ascii_whitespace()) {
            return Err((self.at, LineFault::Expected("white space or the end of the line")));
        }
        let number = if negative { -number } else { number };
        if (lowest..=highest).contains(&number) {
            Ok(number)
        } else {
            Err((begins, LineFault::Range(what)))
        }
    }

    fn end(&mut self) -> Result<(), Misread> {
        while self.line.get(self.at).is_some_and(u8::is_ascii_whitespace) {
            self.at += 1;
        }
        match self.line.get(self.at) {
            None => Ok(()),
            Some(_) => Err((self.at, LineFault::Expected("the end of the line"))),
        }
    }
}
