//! Dimensions with tolerances that a STEP-NC file states: what a person measures, within which limits, and which workingstep makes it.
//!
//! Read as AP242 stores them (ISO 10303-47): `DIMENSIONAL_SIZE` of one shape aspect or `DIMENSIONAL_LOCATION` between two, the nominal
//! value and limits in a `SHAPE_DIMENSION_REPRESENTATION`, deviations in a `PLUS_MINUS_TOLERANCE`. Every length is taken in its own unit,
//! because one file may hold both. What is not there stays `None`: nothing here is worked out from geometry, a fit is never looked up in
//! a table; geometric tolerances (flatness, position ...) are read with their zone, and no offset makes them.

use crate::aim::{Aim, Fault, text};
use crate::model::{ExecutableKind, Program};
use crate::unit::LENGTH;
use part21::{Instance, Value};
use plan::{Diagnostic, Diagnostics, Severity};
use std::collections::{BTreeMap, BTreeSet};
use units::{MM_PER_INCH, Millimetres, ToolNumber};

/// What a file says of sizes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Dimensions {
    /// Sizes and distances, in the order of the file.
    pub dimensions: Vec<StatedDimension>,
    /// Geometric tolerances, in the order of their instances.
    pub geometric: Vec<GeometricTolerance>,
    /// What could not be read.
    pub diagnostics: Vec<Diagnostic>,
}

/// One size or distance.
#[derive(Clone, Debug, PartialEq)]
pub struct StatedDimension {
    /// Its instance.
    pub id: u64,
    /// What kind of thing it measures.
    pub measures: Measures,
    /// The file's word for it: `diameter`, `linear distance`.
    pub word: String,
    /// The shape aspects it is of, instance and name: one for a size, two for a distance.
    pub aspects: Vec<(u64, String)>,
    /// Its nominal value.
    pub nominal: Option<Millimetres>,
    /// The unit it is stated in.
    pub unit: StatedUnit,
    /// By how much it may differ.
    pub limits: StatedLimits,
    /// The features it belongs to.
    pub features: Vec<Feature>,
    /// The enabled workingsteps of the plan that make these features.
    pub workingsteps: Vec<Maker>,
}

/// A geometric tolerance.
#[derive(Clone, Debug, PartialEq)]
pub struct GeometricTolerance {
    /// Its instance.
    pub id: u64,
    /// Its entity: `FLATNESS_TOLERANCE`.
    pub entity: String,
    /// Its name.
    pub name: String,
    /// The width of its zone.
    pub magnitude: Option<Millimetres>,
    /// The shape aspect that it is of: instance and name.
    pub aspect: Option<(u64, String)>,
}

/// What kind of thing a dimension measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Measures {
    /// The size of one shape aspect.
    Size,
    /// The distance between two.
    Distance,
    /// An angle: no length, so its nominal value and limits are not given here.
    Angle,
}

/// The unit of a nominal value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StatedUnit {
    /// Millimetres.
    Mm,
    /// Inches.
    Inch,
    /// Another length; told in millimetres.
    Other,
    /// There is no nominal value.
    Unknown,
}

/// By how much a dimension may differ.
#[derive(Clone, Debug, PartialEq)]
pub enum StatedLimits {
    /// The file gives none.
    None,
    /// Signed deviations from the nominal value.
    Deviations {
        /// Of the smallest good size.
        lower: Millimetres,
        /// Of the largest.
        upper: Millimetres,
    },
    /// A fit by its name (`H7`) without numbers.
    Fit(String),
}

/// A feature that a dimension belongs to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Feature {
    /// Its instance.
    pub id: u64,
    /// Its name for people.
    pub name: String,
    /// Its entity names, as in the file: `INSTANCED_FEATURE`, `ROUND_HOLE`.
    pub entities: Vec<String>,
}

/// A workingstep that makes a feature.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Maker {
    /// Its instance.
    pub workingstep: u64,
    /// Its name for people.
    pub name: String,
    /// The number of its tool.
    pub tool: Option<ToolNumber>,
    /// The identifier of its tool; empty when it has none.
    pub tool_name: String,
}

/// Entities of dimensions; their subtypes are leaves of their own.
const SIZES: [&str; 3] = ["DIMENSIONAL_SIZE", "DIMENSIONAL_SIZE_WITH_PATH", "ANGULAR_SIZE"];
const DISTANCES: [&str; 4] = [
    "DIMENSIONAL_LOCATION",
    "DIRECTED_DIMENSIONAL_LOCATION",
    "DIMENSIONAL_LOCATION_WITH_PATH",
    "ANGULAR_LOCATION",
];
/// Relationships that lead from a part of a feature (related) to what it is a part of (relating).
const PART_OF: [&str; 5] = [
    "SHAPE_ASPECT_RELATIONSHIP",
    "SHAPE_DEFINING_RELATIONSHIP",
    "FEATURE_COMPONENT_RELATIONSHIP",
    "SHAPE_ASPECT_ASSOCIATIVITY",
    "SHAPE_ASPECT_DERIVING_RELATIONSHIP",
];
/// A feature has parts of parts, not more.
const DEEPEST: usize = 8;

/// Reads all dimensions of a program's file.
pub fn dimensions(program: &Program) -> Dimensions {
    let reader = Reader {
        aim: Aim::new(program.file()),
        makers: makers(program),
    };
    let mut diagnostics = Diagnostics::new();
    let mut ids = BTreeSet::new();
    for keyword in SIZES.iter().chain(&DISTANCES) {
        ids.extend(program.file().by_keyword(keyword).map(|row| program.file().id(row)));
    }
    let dimensions = ids.into_iter().filter_map(|id| match reader.dimension(id) {
        Ok(read) => Some(read),
        Err(fault) => {
            program.note(&mut diagnostics, Severity::Warning, &fault);
            None
        }
    });
    let dimensions = dimensions.collect();
    Dimensions {
        dimensions,
        geometric: geometric(&reader),
        diagnostics: diagnostics.as_slice().to_vec(),
    }
}

struct Reader<'p> {
    aim: Aim<'p>,
    /// The workingsteps that make a feature.
    makers: BTreeMap<u64, Vec<Maker>>,
}

impl Reader<'_> {
    fn dimension(&self, id: u64) -> Result<StatedDimension, Fault> {
        let instance = self.aim.instance(id)?;
        let is = |keyword: &str| self.aim.is(id, keyword);
        let (word, aspects) = match SIZES.iter().find_map(|keyword| of_size(&instance, keyword)) {
            Some(size) => size,
            None => DISTANCES
                .iter()
                .find_map(|keyword| of_distance(&instance, keyword))
                .unwrap_or_default(),
        };
        let measures = if is("ANGULAR_SIZE") || is("ANGULAR_LOCATION") {
            Measures::Angle
        } else if SIZES.iter().any(|keyword| is(keyword)) {
            Measures::Size
        } else {
            Measures::Distance
        };
        let stated = match measures {
            Measures::Angle => Stated::default(),
            _ => self.stated(id)?,
        };
        let features = self.features(&aspects);
        let mut workingsteps: Vec<Maker> = Vec::new();
        for maker in features.iter().filter_map(|f| self.makers.get(&f.id)).flatten() {
            if !workingsteps.contains(maker) {
                workingsteps.push(maker.clone());
            }
        }
        let limits = match measures {
            Measures::Angle => StatedLimits::None,
            _ => self.limits(id, &stated)?,
        };
        Ok(StatedDimension {
            id,
            measures,
            word,
            aspects: aspects.into_iter().map(|id| (id, self.name_of(id))).collect(),
            nominal: stated.nominal.map(Millimetres),
            unit: stated.unit.unwrap_or(StatedUnit::Unknown),
            limits,
            features,
            workingsteps,
        })
    }

    /// The values of its representation.
    fn stated(&self, dimension: u64) -> Result<Stated, Fault> {
        let mut stated = Stated::default();
        let links: Vec<u64> = self
            .aim
            .users_by(dimension, "DIMENSIONAL_CHARACTERISTIC_REPRESENTATION", 0)
            .filter_map(|(_, link)| link.argument(1).reference())
            .collect();
        for representation in links {
            let representation = self.aim.representation(representation)?;
            let alone = representation.items.len() == 1;
            for item in representation.items {
                let name = self.aim.item_name(item).to_lowercase();
                let place = match name.as_str() {
                    "nominal value" => &mut stated.nominal,
                    "upper limit" => &mut stated.largest,
                    "lower limit" => &mut stated.smallest,
                    _ if alone => &mut stated.nominal,
                    // Texts, and values of kinds that carry no limit.
                    _ => continue,
                };
                *place = Some(self.aim.measure_of(item, LENGTH, "a dimension")?);
                if name == "nominal value" || stated.unit.is_none() {
                    stated.unit = Some(self.unit_of(item)?);
                }
            }
        }
        Ok(stated)
    }

    fn unit_of(&self, item: u64) -> Result<StatedUnit, Fault> {
        let factor = self.aim.unit_of_measure(item)?.factor;
        let near = |other: f64| (factor - other).abs() < 1e-9 * other;
        Ok(if near(1.0) {
            StatedUnit::Mm
        } else if near(MM_PER_INCH) {
            StatedUnit::Inch
        } else {
            StatedUnit::Other
        })
    }

    fn limits(&self, dimension: u64, stated: &Stated) -> Result<StatedLimits, Fault> {
        let mut fit = None;
        let tolerances: Vec<(u64, Option<u64>)> = self
            .aim
            .users_by(dimension, "PLUS_MINUS_TOLERANCE", 1)
            .map(|(id, tolerance)| (id, tolerance.argument(0).reference()))
            .collect();
        for (tolerance, range) in tolerances {
            let unclear = || {
                Fault::new(
                    tolerance,
                    "tolerance-range",
                    "the range of this tolerance is neither two bounds nor a fit",
                    "give it a TOLERANCE_VALUE or LIMITS_AND_FITS",
                )
            };
            let range = range.ok_or_else(unclear)?;
            let instance = self.aim.instance(range)?;
            if let Some([lower, upper]) = instance.part("TOLERANCE_VALUE") {
                let bound = |value: &Value<'_>| {
                    let item = value.reference().ok_or_else(unclear)?;
                    self.aim.measure_of(item, LENGTH, "the bound of a tolerance")
                };
                let (lower, upper) = (bound(lower)?, bound(upper)?);
                if lower > upper {
                    return Err(Fault::new(
                        range,
                        "tolerance-order",
                        format!("the lower bound {lower} mm is above the upper one {upper} mm"),
                        "exchange them",
                    ));
                }
                return Ok(StatedLimits::Deviations {
                    lower: Millimetres(lower),
                    upper: Millimetres(upper),
                });
            }
            let Some(words) = instance.part("LIMITS_AND_FITS") else {
                return Err(unclear());
            };
            let word = |n: usize| words.get(n).map(text).unwrap_or_default();
            fit = Some(format!("{}{}", word(0), word(2)));
        }
        // Limits as numbers: sizes, not deviations.
        Ok(match (stated.nominal, stated.smallest, stated.largest, fit) {
            (Some(nominal), Some(smallest), Some(largest), _) => StatedLimits::Deviations {
                lower: Millimetres(smallest - nominal),
                upper: Millimetres(largest - nominal),
            },
            (.., Some(fit)) => StatedLimits::Fit(fit),
            _ => StatedLimits::None,
        })
    }

    /// The features that shape aspects are, or are parts of.
    fn features(&self, aspects: &[u64]) -> Vec<Feature> {
        let mut seen: BTreeSet<u64> = aspects.iter().copied().collect();
        let mut level: Vec<u64> = aspects.to_vec();
        let mut features = Vec::new();
        for _ in 0..DEEPEST {
            let mut above = Vec::new();
            for id in std::mem::take(&mut level) {
                if self.aim.is(id, "INSTANCED_FEATURE") || self.makers.contains_key(&id) {
                    features.push(self.feature(id));
                }
                above.extend(PART_OF.iter().flat_map(|keyword| {
                    let users = self.aim.users_by(id, keyword, 3);
                    users.filter_map(|(_, relation)| relation.argument(2).reference())
                }));
                above.extend(self.owner_of_shape(id));
            }
            level = above.into_iter().filter(|id| seen.insert(*id)).collect();
        }
        features
    }

    /// A shape aspect may belong to the shape of a feature instead of the workpiece's.
    fn owner_of_shape(&self, aspect: u64) -> Option<u64> {
        let instance = self.aim.instance(aspect).ok()?;
        let arguments = instance.part("SHAPE_ASPECT").or_else(|| match &instance {
            Instance::Simple(record) => Some(&record.arguments),
            Instance::Complex(_) => None,
        })?;
        let shape = arguments.get(2)?.reference()?;
        let shape = self.aim.instance(shape).ok()?;
        let owner = shape.part("PRODUCT_DEFINITION_SHAPE")?.get(2)?.reference()?;
        (self.aim.is(owner, "INSTANCED_FEATURE") || self.makers.contains_key(&owner)).then_some(owner)
    }

    fn feature(&self, id: u64) -> Feature {
        let entities = self.aim.instance(id).map_or_else(
            |_| Vec::new(),
            |instance| instance.records().iter().map(|record| record.keyword.to_string()).collect(),
        );
        Feature {
            id,
            name: self.name_of(id),
            entities,
        }
    }

    /// The name of a shape aspect.
    fn name_of(&self, id: u64) -> String {
        let Ok(instance) = self.aim.instance(id) else {
            return String::new();
        };
        let arguments = match &instance {
            Instance::Simple(record) => record.arguments.first(),
            Instance::Complex(_) => instance.part("SHAPE_ASPECT").and_then(<[Value<'_>]>::first),
        };
        arguments.map(text).unwrap_or_default().into_owned()
    }
}

/// Lengths of a representation, mm.
#[derive(Default)]
struct Stated {
    nominal: Option<f64>,
    smallest: Option<f64>,
    largest: Option<f64>,
    unit: Option<StatedUnit>,
}

/// Word and shape aspect of a size.
fn of_size(instance: &Instance<'_>, keyword: &str) -> Option<(String, Vec<u64>)> {
    let part = instance.part(keyword).filter(|arguments| arguments.len() >= 2)?;
    Some((text(&part[1]).into_owned(), part[0].reference().into_iter().collect()))
}

/// Word and shape aspects of a distance.
fn of_distance(instance: &Instance<'_>, keyword: &str) -> Option<(String, Vec<u64>)> {
    let own = instance.part(keyword)?;
    let part = if own.len() >= 4 {
        own
    } else {
        instance
            .part("SHAPE_ASPECT_RELATIONSHIP")
            .filter(|arguments| arguments.len() >= 4)?
    };
    let aspects = part[2..4].iter().filter_map(Value::reference);
    Some((text(&part[0]).into_owned(), aspects.collect()))
}

/// The enabled workingsteps of the plan, by the feature that they make.
fn makers(program: &Program) -> BTreeMap<u64, Vec<Maker>> {
    let mut makers: BTreeMap<u64, Vec<Maker>> = BTreeMap::new();
    let Some(plan) = program.plan() else {
        return makers;
    };
    program.walk(plan.main_workplan, &mut |executable, enabled| {
        let ExecutableKind::Workingstep { operation, .. } = &executable.kind else {
            return;
        };
        if !enabled {
            return;
        }
        let tool = operation.and_then(|id| program.tool_of(id));
        let maker = Maker {
            workingstep: executable.id,
            name: executable.name.clone(),
            tool: tool.and_then(|t| t.number),
            tool_name: tool.map(|t| t.name.clone()).unwrap_or_default(),
        };
        for &feature in &executable.features {
            makers.entry(feature).or_default().push(maker.clone());
        }
    });
    makers
}

/// Geometric tolerances; one whose magnitude cannot be read has none.
fn geometric(reader: &Reader) -> Vec<GeometricTolerance> {
    let file = reader.aim.file;
    let is_geometric = |keyword: &str| keyword.ends_with("_TOLERANCE") && keyword != "PLUS_MINUS_TOLERANCE";
    let mut found = Vec::new();
    // The keyword of a complex instance holds all its parts; only the parsed one tells which.
    for row in file.by_name(|keyword| keyword.contains("_TOLERANCE")) {
        let Ok(instance) = file.instance(row) else { continue };
        let mut kinds = instance
            .records()
            .iter()
            .map(|r| &r.keyword)
            .filter(|keyword| is_geometric(keyword));
        let Some(first) = kinds.next() else { continue };
        let entity = std::iter::once(first)
            .chain(kinds)
            .find(|keyword| *keyword != "GEOMETRIC_TOLERANCE");
        let entity = entity.unwrap_or(first).to_string();
        // Name, description, magnitude, aspect.
        let attributes = reader.aim.attributes(&instance, "GEOMETRIC_TOLERANCE");
        let reference = |n: usize| attributes.get(n).and_then(Value::reference);
        let magnitude = reference(2).and_then(|item| reader.aim.measure_of(item, LENGTH, "a tolerance").ok());
        found.push(GeometricTolerance {
            id: file.id(row),
            entity,
            name: attributes.first().map(text).unwrap_or_default().into_owned(),
            magnitude: magnitude.map(Millimetres),
            aspect: reference(3).map(|id| (id, reader.name_of(id))),
        });
    }
    found
}
