//! Named data: what a file says of operations, features, tools and people, by the file's own words.
//!
//! A program runs without it; a person reads it, and what is not understood is still shown. Numbers have their unit taken out of the
//! file's and put into one of a few ([`Quantity::Measure`]).

use crate::aim::{Aim, Representation};
use crate::unit::{self, Dimension};
use part21::{Instance, Value};
use plan::inspection::{NamedValue, Quantity};

/// The value of a measure in one of the units of [`Quantity::Measure`]: the factor from ours, and the word.
pub(crate) fn unit_word(dimension: Dimension) -> (f64, &'static str) {
    match dimension {
        unit::LENGTH => (1.0, "mm"),
        unit::TIME => (1.0, "s"),
        unit::ANGLE => (180.0 / std::f64::consts::PI, "deg"),
        unit::SPEED => (1.0, "mm/s"),
        unit::PER_REVOLUTION => (1.0, "mm/rev"),
        unit::REVOLUTIONS => (1.0, "rev"),
        [0, -1, 0, 1] | [0, -1, 0, 0] => (60.0, "rev/min"),
        [2, 0, 0, 0] => (1.0, "mm2"),
        [3, 0, 0, 0] => (1.0, "mm3"),
        _ => (1.0, ""),
    }
}

impl Aim<'_> {
    /// What a property says: one value for each item of its representation.
    pub(crate) fn named_values(self, property: &str, representation: &Representation) -> Vec<NamedValue> {
        let millimetres = representation
            .context
            .and_then(|context| self.context_units(context).ok())
            .map(|units| units.millimetres);
        let several = representation.items.len() > 1;
        let named = |&item: &u64| {
            let own = self.item_name(item);
            let name = match (property, own.as_str()) {
                ("", own) => own.to_owned(),
                (property, "") => property.to_owned(),
                (property, own) if own == property || !several => property.to_owned(),
                (property, own) => format!("{property}: {own}"),
            };
            self.named_item(name, item, millimetres)
        };
        representation.items.iter().filter_map(named).collect()
    }

    /// An item as a value; geometry that is more than a place is told by its entity.
    pub(crate) fn named_item(self, name: String, item: u64, millimetres: Option<f64>) -> Option<NamedValue> {
        let keyword = self.keyword(item);
        if let Some(millimetres) = millimetres {
            let point = match keyword {
                "CARTESIAN_POINT" => Some(item),
                "AXIS2_PLACEMENT_3D" => self.instance(item).ok()?.argument(1).reference(),
                "PLANE" => {
                    let position = self.instance(item).ok()?.argument(1).reference()?;
                    self.instance(position).ok()?.argument(1).reference()
                }
                _ => None,
            };
            if let Some(place) = point.and_then(|point| crate::curve::point(self, point, millimetres).ok()) {
                return Some(NamedValue::new(name, Quantity::Place { place_mm: place.xyz }));
            }
        }
        if let Ok(measure) = self.measure(item) {
            let (factor, word) = unit_word(measure.dimension);
            let mut value = NamedValue::measure(name, measure.value * factor, word);
            self.limits(item, &mut value, factor);
            return Some(value);
        }
        let instance = self.instance(item).ok()?;
        // Numbers without a unit, and texts.
        let arguments = instance.records().iter().flat_map(|record| &record.arguments);
        let number = arguments.clone().find_map(|value| match value {
            Value::Typed(..) | Value::Integer(_) | Value::Real(_) => value.number(),
            _ => None,
        });
        if let Some(number) = number {
            return Some(NamedValue::measure(name, number, ""));
        }
        match self
            .description(item)
            .filter(|_| instance.part("DESCRIPTIVE_REPRESENTATION_ITEM").is_some())
        {
            Some(text) => Some(NamedValue::text(name, text)),
            None => Some(NamedValue::text(name, format!("#{item} {}", keyword.to_lowercase()))),
        }
    }

    /// The limits among the qualifiers of a value.
    fn limits(self, item: u64, value: &mut NamedValue, factor: f64) {
        let Ok(instance) = self.instance(item) else { return };
        if !matches!(instance, Instance::Complex(_)) {
            return;
        }
        let Some(qualifiers) = instance.part("QUALIFIED_REPRESENTATION_ITEM").and_then(<[Value]>::first) else {
            return;
        };
        let scale = self.unit_of_measure(item).map_or(1.0, |unit| unit.factor) * factor;
        let nominal = value.number().unwrap_or_default();
        for qualifier in qualifiers.references() {
            let Ok(qualifier) = self.instance(qualifier) else { continue };
            if let Some(arguments) = qualifier.part("STANDARD_UNCERTAINTY") {
                // Both are sizes of a deviation: 80 with 0.1 and 0.1 is 79.9 to 80.1 (ISO 10303-238, 5.2.2.4.2).
                let size = arguments
                    .iter()
                    .rev()
                    .find_map(Value::number)
                    .map(|number| (number * scale).abs());
                match arguments.first().and_then(Value::text) {
                    Some("upper limit") => value.upper_limit = size.map(|size| nominal + size),
                    Some("lower limit") => value.lower_limit = size.map(|size| nominal - size),
                    _ => {}
                }
            } else if let Some(arguments) = qualifier.part("TYPE_QUALIFIER") {
                match arguments.first().and_then(Value::text) {
                    Some("maximum") => value.upper_limit = Some(nominal),
                    Some("minimum") => value.lower_limit = Some(nominal),
                    _ => {}
                }
            }
        }
    }
}
