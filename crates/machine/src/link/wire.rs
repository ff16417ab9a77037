//! Fields as bytes: little-endian, every bit of a number as it is, so that what comes out equals what went in.
//!
//! A type is one line: `wire_struct!` and `wire_enum!` take it apart by name, so a new field or variant does not compile until it
//! stands in its line.

use units::{Millimetres, Rpm, StepId, Tick, ToolNumber, WorkingstepId};

/// Goes over the wire.
pub trait Wire: Sized {
    /// Writes all of it.
    fn write(&self, to: &mut Writer<'_>);

    /// Reads what [`Wire::write`] wrote.
    ///
    /// # Errors
    /// The bytes end too early, or hold a number that stands for nothing.
    fn read(from: &mut Reader<'_>) -> Result<Self, WireError>;
}

/// Bytes that are not what was expected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WireError {
    /// Where in the payload, bytes from its beginning.
    pub at: usize,
    /// What was to be read there.
    pub expected: &'static str,
}

impl core::fmt::Display for WireError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "byte {}: {} was expected", self.at, self.expected)
    }
}
impl core::error::Error for WireError {}

/// Writes into a buffer of fixed size.
#[derive(Debug)]
pub struct Writer<'a> {
    bytes: &'a mut [u8],
    at: usize,
    overflowed: bool,
}

impl<'a> Writer<'a> {
    /// Begins at the start of a buffer.
    pub fn new(bytes: &'a mut [u8]) -> Self {
        Writer {
            bytes,
            at: 0,
            overflowed: false,
        }
    }

    /// Appends bytes. Once something found no place, nothing does.
    pub fn put(&mut self, bytes: &[u8]) {
        match self.bytes.get_mut(self.at..self.at + bytes.len()) {
            Some(place) if !self.overflowed => {
                place.copy_from_slice(bytes);
                self.at += bytes.len();
            }
            _ => self.overflowed = true,
        }
    }

    /// How many bytes were written; `None` when they found no place.
    pub fn finish(self) -> Option<usize> {
        (!self.overflowed).then_some(self.at)
    }

    /// How many bytes were written so far.
    pub fn position(&self) -> usize {
        self.at
    }
}

/// Reads a payload from its beginning.
#[derive(Clone, Debug)]
pub struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    /// Begins at the start.
    pub fn new(bytes: &'a [u8]) -> Self {
        Reader { bytes, at: 0 }
    }

    /// The next `N` bytes.
    ///
    /// # Errors
    /// There are not so many.
    pub fn take<const N: usize>(&mut self, expected: &'static str) -> Result<[u8; N], WireError> {
        let found = self.bytes.get(self.at..).and_then(|rest| rest.first_chunk::<N>());
        let found = *found.ok_or(WireError { at: self.at, expected })?;
        self.at += N;
        Ok(found)
    }

    /// That nothing is left.
    ///
    /// # Errors
    /// Something is.
    pub fn end(&self) -> Result<(), WireError> {
        if self.at == self.bytes.len() {
            Ok(())
        } else {
            Err(self.error("the end of the frame"))
        }
    }

    /// An error at the byte that was read last.
    pub fn unknown(&self, expected: &'static str) -> WireError {
        WireError {
            at: self.at.saturating_sub(1),
            expected,
        }
    }

    /// An error at the next byte.
    pub fn error(&self, expected: &'static str) -> WireError {
        WireError { at: self.at, expected }
    }
}

macro_rules! wire_number {
    ($($type:ident $name:literal),*) => {$(
        impl Wire for $type {
            fn write(&self, to: &mut Writer<'_>) {
                to.put(&self.to_le_bytes());
            }
            fn read(from: &mut Reader<'_>) -> Result<Self, WireError> {
                from.take($name).map($type::from_le_bytes)
            }
        }
    )*};
}
wire_number!(u8 "a byte", u16 "two bytes", u32 "four bytes", u64 "eight bytes", f64 "a number of eight bytes");

impl Wire for bool {
    fn write(&self, to: &mut Writer<'_>) {
        to.put(&[u8::from(*self)]);
    }
    fn read(from: &mut Reader<'_>) -> Result<Self, WireError> {
        match u8::read(from)? {
            0 => Ok(false),
            1 => Ok(true),
            _ => Err(from.unknown("0 or 1")),
        }
    }
}

impl<T: Wire + Copy + Default, const N: usize> Wire for [T; N] {
    fn write(&self, to: &mut Writer<'_>) {
        self.iter().for_each(|item| item.write(to));
    }
    fn read(from: &mut Reader<'_>) -> Result<Self, WireError> {
        let mut items = [T::default(); N];
        for item in &mut items {
            *item = T::read(from)?;
        }
        Ok(items)
    }
}

impl<T: Wire> Wire for Option<T> {
    fn write(&self, to: &mut Writer<'_>) {
        self.is_some().write(to);
        if let Some(item) = self {
            item.write(to);
        }
    }
    fn read(from: &mut Reader<'_>) -> Result<Self, WireError> {
        Ok(if bool::read(from)? { Some(T::read(from)?) } else { None })
    }
}

macro_rules! wire_newtype {
    ($($type:ident),*) => {$(
        impl Wire for $type {
            fn write(&self, to: &mut Writer<'_>) {
                self.0.write(to);
            }
            fn read(from: &mut Reader<'_>) -> Result<Self, WireError> {
                Wire::read(from).map($type)
            }
        }
    )*};
}
wire_newtype!(Millimetres, Rpm, StepId, Tick, ToolNumber, WorkingstepId);

/// A struct, all of its fields in this order.
macro_rules! wire_struct {
    ($type:ident { $($field:ident),* $(,)? }) => {
        impl $crate::link::wire::Wire for $type {
            fn write(&self, to: &mut $crate::link::wire::Writer<'_>) {
                let $type { $($field),* } = self;
                $($crate::link::wire::Wire::write($field, to);)*
            }
            fn read(
                from: &mut $crate::link::wire::Reader<'_>,
            ) -> Result<Self, $crate::link::wire::WireError> {
                Ok($type { $($field: $crate::link::wire::Wire::read(from)?),* })
            }
        }
    };
}

/// An enum: a number for each variant, then its fields.
macro_rules! wire_enum {
    ($type:ident { $($number:literal = $variant:ident $(($($inner:ident),*))? $({ $($field:ident),* })?),* $(,)? }) => {
        impl $crate::link::wire::Wire for $type {
            fn write(&self, to: &mut $crate::link::wire::Writer<'_>) {
                match self {
                    $($type::$variant $(($($inner),*))? $({ $($field),* })? => {
                        to.put(&[$number]);
                        $($($crate::link::wire::Wire::write($inner, to);)*)?
                        $($($crate::link::wire::Wire::write($field, to);)*)?
                    })*
                }
            }
            fn read(
                from: &mut $crate::link::wire::Reader<'_>,
            ) -> Result<Self, $crate::link::wire::WireError> {
                match <u8 as $crate::link::wire::Wire>::read(from)? {
                    $($number => {
                        $($(let $inner = $crate::link::wire::Wire::read(from)?;)*)?
                        $($(let $field = $crate::link::wire::Wire::read(from)?;)*)?
                        Ok($type::$variant $(($($inner),*))? $({ $($field),* })?)
                    })*
                    _ => Err(from.unknown(concat!("the number of a ", stringify!($type)))),
                }
            }
        }
    };
}

pub(crate) use {wire_enum, wire_struct};
