//! Units as the file defines them: factors are computed from the numbers, never from a name.
//!
//! Everything is brought to millimetres, seconds, radians and revolutions. A unit that cannot be followed to one of these is a
//! [`Fault`], never a silent factor of 1.

use crate::aim::{Aim, Fault};
use part21::{Instance, Value};

/// Exponents of length, time, angle and revolution.
pub(crate) type Dimension = [i32; 4];

pub(crate) const NUMBER: Dimension = [0, 0, 0, 0];
pub(crate) const LENGTH: Dimension = [1, 0, 0, 0];
pub(crate) const TIME: Dimension = [0, 1, 0, 0];
pub(crate) const ANGLE: Dimension = [0, 0, 1, 0];
pub(crate) const SPEED: Dimension = [1, -1, 0, 0];
pub(crate) const PER_REVOLUTION: Dimension = [1, 0, 0, -1];
pub(crate) const REVOLUTIONS: Dimension = [0, 0, 0, 1];

/// A unit: multiply a number in it by `factor` to get millimetres, seconds, radians, revolutions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Unit {
    pub(crate) factor: f64,
    pub(crate) dimension: Dimension,
}

/// A number with its unit taken out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Measure {
    pub(crate) value: f64,
    pub(crate) dimension: Dimension,
}

/// The units of a geometric context.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ContextUnits {
    /// Millimetres in one unit of a coordinate.
    pub(crate) millimetres: f64,
    /// Radians in one unit of an angle, when the context says it.
    pub(crate) radians: Option<f64>,
}

const DEEPEST: u32 = 16;

/// A unit that is made of others takes so many levels of [`DEEPEST`], and so many others at most: reading it stays short, however
/// often units of units refer to each other.
const DERIVED_LEVELS: u32 = 4;
const MOST_ELEMENTS: usize = 8;

impl Aim<'_> {
    pub(crate) fn unit(self, id: u64) -> Result<Unit, Fault> {
        self.unit_at(id, 0)
    }

    fn unit_at(self, id: u64, depth: u32) -> Result<Unit, Fault> {
        let unknown = |why: &str| {
            Fault::new(
                id,
                "unknown-unit",
                format!("the unit {} is not understood: {why}", self.keyword(id)),
                "define it by an SI unit or a conversion from one",
            )
        };
        if depth > DEEPEST {
            return Err(unknown("it is defined by itself"));
        }
        let instance = self.instance(id)?;
        let part = |name: &str| instance.part(name);
        if let Some(arguments) = part("CONVERSION_BASED_UNIT") {
            let measure = arguments
                .last()
                .and_then(Value::reference)
                .ok_or_else(|| unknown("it has no conversion factor"))?;
            let measure = self.measure_at(measure, depth + 1)?;
            return Ok(Unit {
                factor: measure.value,
                dimension: measure.dimension,
            });
        }
        if let Some(arguments) = part("CONTEXT_DEPENDENT_UNIT") {
            let name = arguments.iter().rev().find_map(Value::text).unwrap_or("").to_lowercase();
            let dimension = if name.starts_with("rev") { REVOLUTIONS } else { NUMBER };
            return Ok(Unit { factor: 1.0, dimension });
        }
        if let Some(arguments) = part("DERIVED_UNIT") {
            let elements = arguments.first().map_or(&[][..], Value::items);
            if elements.len() > MOST_ELEMENTS {
                return Err(unknown("it is made of more than eight others"));
            }
            let mut unit = Unit {
                factor: 1.0,
                dimension: NUMBER,
            };
            for element in elements.iter().filter_map(Value::reference) {
                let element = self.instance(element)?;
                let (Some(base), Some(exponent)) = (element.argument(0).reference(), element.argument(1).number()) else {
                    return Err(unknown("an element has no unit or no exponent"));
                };
                let whole = exponent as i32;
                if f64::from(whole) != exponent || whole.abs() > 8 {
                    return Err(unknown("an exponent is no small whole number"));
                }
                let base = self.unit_at(base, depth + DERIVED_LEVELS)?;
                for _ in 0..whole.abs() {
                    unit.factor = if whole > 0 {
                        unit.factor * base.factor
                    } else {
                        unit.factor / base.factor
                    };
                }
                for (sum, exponent) in unit.dimension.iter_mut().zip(base.dimension) {
                    *sum = sum.saturating_add(exponent.saturating_mul(whole));
                }
            }
            return sound(unit).ok_or_else(|| unknown("its factor is 0 or infinite"));
        }
        if let Some(arguments) = part("SI_UNIT") {
            // (prefix, name), or (dimensions, prefix, name) when the instance is simple.
            let [.., prefix, name] = arguments else {
                return Err(unknown("SI_UNIT needs a prefix and a name"));
            };
            let prefix = match prefix.enumeration() {
                None => 1.0,
                Some(prefix) => si_prefix(prefix).ok_or_else(|| unknown("the prefix is none of SI"))?,
            };
            let (factor, dimension) = match name.enumeration() {
                Some("METRE") => (1000.0, LENGTH),
                Some("SECOND") => (1.0, TIME),
                Some("RADIAN") => (1.0, ANGLE),
                Some("HERTZ") => (1.0, [0, -1, 0, 0]),
                Some("STERADIAN") => (1.0, NUMBER),
                _ => return Err(unknown("it is neither a length, a time nor an angle")),
            };
            let factor = if factor == 1000.0 && prefix == 1e-3 {
                1.0
            } else {
                factor * prefix
            };
            return Ok(Unit { factor, dimension });
        }
        if part("RATIO_UNIT").is_some() {
            return Ok(Unit {
                factor: 1.0,
                dimension: NUMBER,
            });
        }
        Err(unknown("it is neither an SI unit nor defined by one"))
    }

    /// The number of a measure item (simple or complex), with its unit taken out.
    pub(crate) fn measure(self, id: u64) -> Result<Measure, Fault> {
        self.measure_at(id, 0)
    }

    fn measure_at(self, id: u64, depth: u32) -> Result<Measure, Fault> {
        let (number, unit) = self.number_and_unit(id, depth)?;
        let value = number * unit.factor;
        if !value.is_finite() {
            return Err(self.bad_measure(id, "is no finite number"));
        }
        Ok(Measure {
            value,
            dimension: unit.dimension,
        })
    }

    /// The unit that a measure item is stated in.
    pub(crate) fn unit_of_measure(self, id: u64) -> Result<Unit, Fault> {
        self.number_and_unit(id, 0).map(|(_, unit)| unit)
    }

    fn number_and_unit(self, id: u64, depth: u32) -> Result<(f64, Unit), Fault> {
        let instance = self.instance(id)?;
        let number_and_unit = |arguments: &[Value]| {
            let value = arguments.iter().find_map(Value::number)?;
            Some((value, arguments.iter().rev().find_map(Value::reference)))
        };
        let found = match &instance {
            Instance::Complex(_) => instance.part("MEASURE_WITH_UNIT").and_then(number_and_unit),
            Instance::Simple(record) => number_and_unit(&record.arguments),
        };
        let (value, unit) = found.ok_or_else(|| self.bad_measure(id, "holds no number"))?;
        let unit = unit.ok_or_else(|| self.bad_measure(id, "has no unit"))?;
        Ok((value, self.unit_at(unit, depth + 1)?))
    }

    fn bad_measure(self, id: u64, what: &str) -> Fault {
        Fault::new(
            id,
            "measure",
            format!("{} {what}", self.keyword(id)),
            "give a number and its unit",
        )
    }

    /// A measure that must have one of the given dimensions.
    pub(crate) fn measure_of(self, id: u64, dimension: Dimension, what: &str) -> Result<f64, Fault> {
        let measure = self.measure(id)?;
        if measure.dimension != dimension {
            return Err(Fault::new(
                id,
                "unit-kind",
                format!("{what} has a unit of another kind"),
                "give it a unit of the right kind",
            ));
        }
        Ok(measure.value)
    }

    /// The units of a representation's context.
    pub(crate) fn context_units(self, context: u64) -> Result<ContextUnits, Fault> {
        let instance = self.instance(context)?;
        let units = instance
            .part("GLOBAL_UNIT_ASSIGNED_CONTEXT")
            .and_then(|arguments| arguments.iter().find(|argument| !argument.items().is_empty()));
        let (mut millimetres, mut radians, mut broken) = (None, None, None);
        for unit in units.map(Value::references).into_iter().flatten() {
            match self.unit(unit) {
                Ok(Unit {
                    factor,
                    dimension: LENGTH,
                }) => millimetres = millimetres.or(Some(factor)),
                Ok(Unit {
                    factor,
                    dimension: ANGLE,
                }) => radians = radians.or(Some(factor)),
                Ok(_) => {}
                Err(fault) => broken = broken.or(Some(fault)),
            }
        }
        match (millimetres, broken) {
            (Some(millimetres), _) => Ok(ContextUnits { millimetres, radians }),
            (None, Some(fault)) => Err(fault),
            (None, None) => Err(Fault::new(
                context,
                "no-length-unit",
                "coordinates stand in a context without a length unit",
                "give the context a length unit: millimetres and inches are told apart by nothing else",
            )),
        }
    }
}

fn sound(unit: Unit) -> Option<Unit> {
    (unit.factor.is_finite() && unit.factor != 0.0).then_some(unit)
}

fn si_prefix(name: &str) -> Option<f64> {
    Some(match name {
        "GIGA" => 1e9,
        "MEGA" => 1e6,
        "KILO" => 1e3,
        "HECTO" => 1e2,
        "DECA" => 1e1,
        "DECI" => 1e-1,
        "CENTI" => 1e-2,
        "MILLI" => 1e-3,
        "MICRO" => 1e-6,
        "NANO" => 1e-9,
        _ => return None,
    })
}
