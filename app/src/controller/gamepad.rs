//! A gamepad as the control pad: events of the Linux input layer, read from `/dev/input/event*` without any library.
//!
//! | on the gamepad | on the control pad |
//! |---|---|
//! | left stick, up and down | joystick |
//! | cross left, up, right | mode selector at jog X, Y, Z; down is automatic |
//! | left shoulder button | dead-man: nothing is jogged without it |
//! | right trigger | jog feed: not pressed is a tenth, pressed is full |
//! | both middle buttons together | emergency stop, as a stop asked by software; the circuit with a real button is the hardware's |
//!
//! A pad that is unplugged, or whose events stop making sense, is no pad: whatever was jogged stops.

use machine::pad::{ControlPad, Mode, PadState};
use std::fs::File;
use std::io::{ErrorKind, Read};
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use units::Tick;

/// Bytes of one event on a 64-bit system: two of 8 for the time, then type, code and value.
const EVENT: usize = 24;
/// O_NONBLOCK of Linux: the servo cycle never waits for a person.
const NONBLOCK: i32 = 0o4000;
/// Events that are looked at in one cycle at most.
const MOST: usize = 16;
/// The middle of a stick is not exactly its middle: less than this share is nothing.
const PLAY: f64 = 0.08;

// Types and codes of linux/input-event-codes.h.
const EV_SYN: u16 = 0;
const EV_KEY: u16 = 1;
const EV_ABS: u16 = 3;
const SYN_DROPPED: u16 = 3;
const ABS_Y: u16 = 0x01;
const ABS_RZ: u16 = 0x05;
const ABS_HAT0X: u16 = 0x10;
const ABS_HAT0Y: u16 = 0x11;
const BTN_TL: u16 = 0x136;
const BTN_SELECT: u16 = 0x13a;
const BTN_START: u16 = 0x13b;

/// The range of an axis of the pad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Value at one end.
    pub lowest: i32,
    /// At the other.
    pub highest: i32,
}

/// What events come to.
#[derive(Clone, Debug)]
pub struct Decoder {
    stick: Range,
    trigger: Range,
    /// Bytes of an event that is not whole.
    partial: [u8; EVENT],
    length: usize,
    /// As of the last report of the pad.
    state: PadState,
    /// Being changed by the events of the next one.
    next: PadState,
    middle: [bool; 2],
    /// Events were lost: what is pressed is not known until the pad reports again, and until then nothing is.
    lost: bool,
}

impl Decoder {
    /// A pad whose sticks and triggers have these ranges.
    pub fn new(stick: Range, trigger: Range) -> Decoder {
        let lying = PadState {
            feed: feed(0.0),
            ..PadState::default()
        };
        Decoder {
            stick,
            trigger,
            partial: [0; EVENT],
            length: 0,
            state: lying,
            next: lying,
            middle: [false; 2],
            lost: false,
        }
    }

    /// Takes bytes, however they were split.
    pub fn take(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.partial[self.length] = byte;
            self.length += 1;
            if self.length == EVENT {
                self.length = 0;
                let [.., a, b, c, d, v0, v1, v2, v3] = self.partial;
                let (kind, code) = (u16::from_ne_bytes([a, b]), u16::from_ne_bytes([c, d]));
                self.event(kind, code, i32::from_ne_bytes([v0, v1, v2, v3]));
            }
        }
    }

    /// What the pad shows.
    pub fn state(&self) -> PadState {
        self.state
    }

    fn event(&mut self, kind: u16, code: u16, value: i32) {
        match (kind, code) {
            (EV_SYN, SYN_DROPPED) => {
                self.lost = true;
                (self.next.joystick, self.next.dead_man) = (0.0, false);
            }
            // A report is whole; the one that ends a loss belongs to it.
            (EV_SYN, 0) => {
                if self.lost {
                    (self.next.joystick, self.next.dead_man) = (0.0, false);
                    self.lost = false;
                }
                self.state = self.next;
            }
            // Up is the small end.
            (EV_ABS, ABS_Y) => {
                let share = 1.0 - 2.0 * part(self.stick, value);
                self.next.joystick = if share.abs() < PLAY { 0.0 } else { share };
            }
            (EV_ABS, ABS_RZ) => self.next.feed = feed(part(self.trigger, value)),
            (EV_ABS, ABS_HAT0X) if value < 0 => self.next.selector = Mode::Jog { axis: 0 },
            (EV_ABS, ABS_HAT0X) if value > 0 => self.next.selector = Mode::Jog { axis: 2 },
            (EV_ABS, ABS_HAT0Y) if value < 0 => self.next.selector = Mode::Jog { axis: 1 },
            (EV_ABS, ABS_HAT0Y) if value > 0 => self.next.selector = Mode::Auto,
            (EV_KEY, BTN_TL) => self.next.dead_man = value != 0,
            (EV_KEY, BTN_SELECT) => self.middle_button(0, value != 0),
            (EV_KEY, BTN_START) => self.middle_button(1, value != 0),
            _ => {}
        }
    }

    fn middle_button(&mut self, which: usize, pressed: bool) {
        self.middle[which] = pressed;
        self.next.emergency_stop = self.middle == [true; 2];
    }
}

/// 0 to 1 over a range.
fn part(range: Range, value: i32) -> f64 {
    let width = f64::from(range.highest) - f64::from(range.lowest);
    if width <= 0.0 {
        return 0.5;
    }
    ((f64::from(value) - f64::from(range.lowest)) / width).clamp(0.0, 1.0)
}

fn feed(pressed: f64) -> u8 {
    (255.0 * (0.1 + 0.9 * pressed)).round() as u8
}

/// A gamepad that is plugged in, or was.
pub struct Gamepad {
    file: Option<File>,
    decoder: Decoder,
}

impl Gamepad {
    /// Opens the device of a gamepad. Its sticks are taken to go from -32768 to 32767 and its triggers from 0 to 255 (Xbox: 1023 is taken as
    /// pressed at 255), as the kernel's drivers of common pads have them.
    ///
    /// # Errors
    /// There is no such device, or it may not be read.
    pub fn open(path: &Path) -> std::io::Result<Gamepad> {
        let file = File::options().read(true).custom_flags(NONBLOCK).open(path)?;
        let stick = Range {
            lowest: -32_768,
            highest: 32_767,
        };
        let trigger = Range { lowest: 0, highest: 255 };
        Ok(Gamepad {
            file: Some(file),
            decoder: Decoder::new(stick, trigger),
        })
    }
}

impl ControlPad for Gamepad {
    fn read(&mut self, _now: Tick) -> Option<PadState> {
        let mut bytes = [0; EVENT * MOST];
        match self.file.as_mut()?.read(&mut bytes) {
            Ok(0) => self.file = None,
            Ok(count) => self.decoder.take(&bytes[..count]),
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {}
            // Unplugged.
            Err(_) => self.file = None,
        }
        self.file.is_some().then(|| self.decoder.state())
    }
}

/// A pad, or none.
pub enum Pad {
    /// None.
    None,
    /// A gamepad. On the heap, because nobody moves it after the start.
    Gamepad(Box<Gamepad>),
}

impl ControlPad for Pad {
    fn read(&mut self, now: Tick) -> Option<PadState> {
        match self {
            Pad::None => None,
            Pad::Gamepad(gamepad) => gamepad.read(now),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn event(kind: u16, code: u16, value: i32) -> Vec<u8> {
        let time = [0x11; 16];
        [&time[..], &kind.to_ne_bytes(), &code.to_ne_bytes(), &value.to_ne_bytes()].concat()
    }

    fn decoder() -> Decoder {
        Decoder::new(
            Range {
                lowest: -32_768,
                highest: 32_767,
            },
            Range { lowest: 0, highest: 255 },
        )
    }

    /// A person jogs Y up with the dead-man held, and lets go.
    fn recorded() -> Vec<u8> {
        [
            event(EV_ABS, ABS_HAT0Y, -1),
            event(EV_SYN, 0, 0),
            event(EV_ABS, ABS_HAT0Y, 0),
            event(EV_KEY, BTN_TL, 1),
            event(EV_SYN, 0, 0),
            event(EV_ABS, ABS_Y, -32_768),
            event(EV_ABS, ABS_RZ, 255),
            event(EV_SYN, 0, 0),
            event(EV_ABS, ABS_Y, 900),
            event(EV_KEY, BTN_TL, 0),
            event(EV_SYN, 0, 0),
        ]
        .concat()
    }

    #[test]
    fn a_recorded_stream_is_read_alike_however_it_is_split() {
        for size in [1, 5, 24, 25, 1000] {
            let mut decoder = decoder();
            let mut seen = vec![decoder.state()];
            for bytes in recorded().chunks(size) {
                for byte in bytes {
                    decoder.take(&[*byte]);
                    if *seen.last().expect("the first") != decoder.state() {
                        seen.push(decoder.state());
                    }
                }
            }
            let jog_y = Mode::Jog { axis: 1 };
            assert_eq!(seen.len(), 5, "{seen:?}");
            assert_eq!((seen[1].selector, seen[1].dead_man), (jog_y, false));
            assert!(seen[2].dead_man && seen[2].joystick == 0.0);
            assert_eq!((seen[3].joystick, seen[3].feed), (1.0, 255));
            assert_eq!((seen[4].joystick, seen[4].dead_man, seen[4].selector), (0.0, false, jog_y));
        }
    }

    #[test]
    fn nothing_counts_before_its_report_is_whole_and_lost_events_let_go() {
        let mut decoder = decoder();
        decoder.take(&[event(EV_KEY, BTN_TL, 1), event(EV_ABS, ABS_Y, 32_767)].concat());
        assert_eq!((decoder.state().dead_man, decoder.state().joystick), (false, 0.0));
        decoder.take(&event(EV_SYN, 0, 0));
        assert_eq!((decoder.state().dead_man, decoder.state().joystick), (true, -1.0));
        decoder.take(
            &[
                event(EV_SYN, SYN_DROPPED, 0),
                event(EV_ABS, ABS_Y, -30_000),
                event(EV_SYN, 0, 0),
            ]
            .concat(),
        );
        assert_eq!((decoder.state().dead_man, decoder.state().joystick), (false, 0.0));
    }

    #[test]
    fn both_middle_buttons_are_the_stop() {
        let mut decoder = decoder();
        decoder.take(&[event(EV_KEY, BTN_SELECT, 1), event(EV_SYN, 0, 0)].concat());
        assert!(!decoder.state().emergency_stop);
        decoder.take(&[event(EV_KEY, BTN_START, 1), event(EV_SYN, 0, 0)].concat());
        assert!(decoder.state().emergency_stop);
    }

    #[test]
    fn a_device_that_ends_is_no_pad_any_more() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("event0");
        std::fs::write(&path, recorded()).expect("written");
        let mut pad = Gamepad::open(&path).expect("opens");
        assert!(pad.read(Tick(0)).is_some_and(|state| !state.dead_man));
        assert_eq!(pad.read(Tick(1)), None, "at the end of the file nothing more comes");
        assert_eq!(pad.read(Tick(2)), None);
    }
}
