//! A new file being written: [`Sheet`] takes instances and knows the units, contexts and chains that every STEP-NC file needs.

use crate::date::Civil;
use part21::text::{encode, real};
use std::collections::BTreeMap;
use units::{MM_PER_INCH, Millimetres, Point, Seconds, Setup, Timestamp, Transform, Vector};

/// Instances of a new file, and what they share.
pub(super) struct Sheet {
    text: String,
    next_id: u64,
    /// Millimetres in one unit of the file's lengths.
    length_unit: f64,
    pub(super) product_context: u64,
    pub(super) definition_context: u64,
    pub(super) length: u64,
    second: u64,
    minute: u64,
    dimensionless: u64,
    revolution: u64,
    /// Of geometry.
    pub(super) context: u64,
    /// Of everything else.
    pub(super) no_units: u64,
    /// Instances that say a word, units by name, directions by their numbers.
    words: BTreeMap<String, u64>,
    units: BTreeMap<&'static str, u64>,
    /// Variables of expressions, by their entity and name.
    pub(super) variables: BTreeMap<(&'static str, String), u64>,
    directions: BTreeMap<[u64; 3], u64>,
}

impl Sheet {
    pub(super) fn new(inches: bool) -> Self {
        let mut sheet = Sheet {
            text: String::new(),
            next_id: 10,
            length_unit: if inches { MM_PER_INCH } else { 1.0 },
            product_context: 0,
            definition_context: 0,
            length: 0,
            second: 0,
            minute: 0,
            dimensionless: 0,
            revolution: 0,
            context: 0,
            no_units: 0,
            words: BTreeMap::new(),
            units: BTreeMap::new(),
            variables: BTreeMap::new(),
            directions: BTreeMap::new(),
        };
        let application = sheet.add("APPLICATION_CONTEXT('Application protocol for the exchange of CNC data')");
        sheet.add(format!(
            "APPLICATION_PROTOCOL_DEFINITION('international standard','model_based_integrated_manufacturing_schema',2022,#{application})"
        ));
        sheet.product_context = sheet.add(format!("PRODUCT_CONTEXT('CNC Machining',#{application},'manufacturing')"));
        sheet.definition_context = sheet.add(format!(
            "PRODUCT_DEFINITION_CONTEXT('CNC Machining',#{application},'manufacturing')"
        ));
        let millimetre = sheet.add("(LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.))");
        sheet.second = sheet.add("(NAMED_UNIT(*) SI_UNIT($,.SECOND.) TIME_UNIT())");
        let time_exponents = sheet.add("DIMENSIONAL_EXPONENTS(0.,0.,1.,0.,0.,0.,0.)");
        let second = sheet.second;
        let sixty = sheet.add(format!("TIME_MEASURE_WITH_UNIT(TIME_MEASURE(60.),#{second})"));
        sheet.minute = sheet.add(format!(
            "(CONVERSION_BASED_UNIT('minute',#{sixty}) NAMED_UNIT(#{time_exponents}) TIME_UNIT())"
        ));
        let radian = sheet.add("(NAMED_UNIT(*) PLANE_ANGLE_UNIT() SI_UNIT($,.RADIAN.))");
        let steradian = sheet.add("(NAMED_UNIT(*) SI_UNIT($,.STERADIAN.) SOLID_ANGLE_UNIT())");
        sheet.dimensionless = sheet.add("DIMENSIONAL_EXPONENTS(0.,0.,0.,0.,0.,0.,0.)");
        let dimensionless = sheet.dimensionless;
        sheet.revolution = sheet.add(format!("CONTEXT_DEPENDENT_UNIT(#{dimensionless},'revolution')"));
        sheet.length = if inches {
            let exponents = sheet.add("DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.)");
            let inch = sheet.add(format!("LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4),#{millimetre})"));
            sheet.add(format!(
                "(CONVERSION_BASED_UNIT('inch',#{inch}) LENGTH_UNIT() NAMED_UNIT(#{exponents}))"
            ))
        } else {
            millimetre
        };
        let length = sheet.length;
        let uncertainty = sheet.add(format!(
            "UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-6),#{length},'DISTANCE_ACCURACY_VALUE','maximum distance between coincident points')"
        ));
        sheet.context = sheet.add(format!(
            "(GEOMETRIC_REPRESENTATION_CONTEXT(3) GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT((#{uncertainty})) \
             GLOBAL_UNIT_ASSIGNED_CONTEXT((#{length},#{radian},#{steradian})) REPRESENTATION_CONTEXT('ID1','3D'))"
        ));
        sheet.no_units = sheet.add("REPRESENTATION_CONTEXT('','units not necessary')");
        sheet
    }

    /// The whole file.
    pub(super) fn into_file(self, description: &str, name: &str, written: Timestamp, author: &str, writer: &str) -> Vec<u8> {
        format!(
            "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION(({}),'2;1');\nFILE_NAME({},{},({}),(''),{},{},'');\n\
             FILE_SCHEMA(('MODEL_BASED_INTEGRATED_MANUFACTURING_SCHEMA'));\nENDSEC;\nDATA;\n{}ENDSEC;\nEND-ISO-10303-21;\n",
            encode(description),
            encode(name),
            encode(&Civil::of(written).rfc_3339()),
            encode(author),
            encode(writer),
            encode(writer),
            self.text
        )
        .into_bytes()
    }

    /// Adds an instance; the answer is its identifier.
    pub(super) fn add(&mut self, body: impl AsRef<str>) -> u64 {
        let id = self.reserve();
        self.put(id, body);
        id
    }

    /// An identifier for something that is written later, by [`Sheet::put`].
    pub(super) fn reserve(&mut self) -> u64 {
        self.next_id += 1;
        self.next_id - 1
    }

    pub(super) fn put(&mut self, id: u64, body: impl AsRef<str>) {
        use std::fmt::Write;
        // Writing into a String cannot fail.
        let _ = writeln!(self.text, "#{id}={};", body.as_ref());
    }

    /// A number of the file's length unit that reads back to the same double wherever that can be: the planner rounds corners by
    /// comparing lengths, and a digit of noise may decide.
    pub(super) fn number(&self, millimetres: f64) -> String {
        let c = millimetres / self.length_unit;
        // Without the noise of dividing, when the shorter number means the same length.
        let shorter = libm::round(c * 1e10) / 1e10;
        let c = if shorter * self.length_unit == millimetres {
            shorter
        } else {
            c
        };
        real(if c == 0.0 { 0.0 } else { c })
    }

    pub(super) fn millimetres_per_unit(&self) -> f64 {
        self.length_unit
    }

    pub(super) fn point(&mut self, entity: &str, point: Point<Setup>) -> u64 {
        let [x, y, z] = point.xyz.map(|c| self.number(c));
        self.add(format!("{entity}('',({x},{y},{z}))"))
    }

    pub(super) fn direction(&mut self, direction: [f64; 3]) -> u64 {
        let clean = direction.map(|c| if c == 0.0 { 0.0 } else { c });
        let key = clean.map(f64::to_bits);
        if let Some(&id) = self.directions.get(&key) {
            return id;
        }
        let [x, y, z] = clean.map(real);
        let id = self.add(format!("DIRECTION('',({x},{y},{z}))"));
        self.directions.insert(key, id);
        id
    }

    pub(super) fn placement(&mut self, name: &str, origin: [f64; 3], axis: [f64; 3], reference: Option<[f64; 3]>) -> u64 {
        let origin = self.point("CARTESIAN_POINT", Point::from_xyz(origin));
        let axis = self.direction(axis);
        let reference = reference.map_or("$".to_string(), |reference| format!("#{}", self.direction(reference)));
        self.add(format!("AXIS2_PLACEMENT_3D({},#{origin},#{axis},{reference})", encode(name)))
    }

    /// A frame as a placement: where its origin, Z and X are.
    pub(super) fn frame<T: units::Frame, S: units::Frame>(&mut self, name: &str, frame: &Transform<T, S>) -> u64 {
        let (axis, reference) = (*frame * Vector::<S>::Z, *frame * Vector::<S>::X);
        self.placement(name, frame.origin, axis.xyz, Some(reference.xyz))
    }

    /// Hangs a representation on its owner.
    pub(super) fn property(&mut self, owner: u64, name: &str, representation: u64) -> u64 {
        let property = self.add(format!("ACTION_PROPERTY('{name}','',#{owner})"));
        self.add(format!("ACTION_PROPERTY_REPRESENTATION('','',#{property},#{representation})"));
        property
    }

    /// A representation that says a text; one for each text.
    pub(super) fn says(&mut self, text: &str) -> u64 {
        if let Some(&id) = self.words.get(text) {
            return id;
        }
        let item = self.add(format!("DESCRIPTIVE_REPRESENTATION_ITEM('',{})", encode(text)));
        let no_units = self.no_units;
        let id = self.add(format!("REPRESENTATION('',(#{item}),#{no_units})"));
        self.words.insert(text.to_string(), id);
        id
    }

    /// The representation of a rapid path's speed.
    pub(super) fn rapid(&mut self) -> u64 {
        // The same word as a text would be another entity.
        const KEY: &str = "\u{0}rapid";
        if let Some(&id) = self.words.get(KEY) {
            return id;
        }
        let item = self.add("DESCRIPTIVE_REPRESENTATION_ITEM('','rapid')");
        let no_units = self.no_units;
        let id = self.add(format!(
            "MACHINING_TOOLPATH_SPEED_PROFILE_REPRESENTATION('',(#{item}),#{no_units})"
        ));
        self.words.insert(KEY.to_string(), id);
        id
    }

    /// A length as a representation item.
    pub(super) fn length_item(&mut self, name: &str, length: Millimetres) -> u64 {
        let (number, unit) = (self.number(length.0), self.length);
        self.add(format!(
            "(LENGTH_MEASURE_WITH_UNIT() MEASURE_REPRESENTATION_ITEM() MEASURE_WITH_UNIT(LENGTH_MEASURE({number}),#{unit}) \
             REPRESENTATION_ITEM({}))",
            encode(name)
        ))
    }

    /// A time as a representation item.
    pub(super) fn time_item(&mut self, name: &str, time: Seconds) -> u64 {
        let (number, unit) = (real(time.0), self.second);
        self.add(format!(
            "(MEASURE_REPRESENTATION_ITEM() MEASURE_WITH_UNIT(TIME_MEASURE({number}),#{unit}) REPRESENTATION_ITEM({}) \
             TIME_MEASURE_WITH_UNIT())",
            encode(name)
        ))
    }

    /// A count as a representation item.
    pub(super) fn count_item(&mut self, name: &str, count: f64) -> u64 {
        let unit = self.unit("count", |sheet| {
            let dimensionless = sheet.dimensionless;
            sheet.add(format!("CONTEXT_DEPENDENT_UNIT(#{dimensionless},'parts')"))
        });
        self.add(format!(
            "MEASURE_REPRESENTATION_ITEM({},COUNT_MEASURE({}),#{unit})",
            encode(name),
            real(count)
        ))
    }

    /// A speed or rotation as a representation item; `value` is in that unit.
    pub(super) fn speed_item(&mut self, name: &str, value: f64, unit: SpeedUnit) -> u64 {
        let unit = match unit {
            SpeedUnit::LengthPerMinute => self.unit("length/min", |sheet| {
                let (above, below) = (sheet.length, sheet.minute);
                sheet.quotient(above, below)
            }),
            SpeedUnit::LengthPerRevolution => self.unit("length/rev", |sheet| {
                let (above, below) = (sheet.length, sheet.revolution);
                sheet.quotient(above, below)
            }),
            SpeedUnit::RevolutionsPerMinute => self.unit("rev/min", |sheet| {
                let (above, below) = (sheet.revolution, sheet.minute);
                sheet.quotient(above, below)
            }),
            SpeedUnit::MetresPerMinute => self.unit("m/min", |sheet| {
                let metre = sheet.add("(LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT($,.METRE.))");
                let below = sheet.minute;
                sheet.quotient(metre, below)
            }),
        };
        self.add(format!(
            "MEASURE_REPRESENTATION_ITEM('{name}',NUMERIC_MEASURE({}),#{unit})",
            real(short(value))
        ))
    }

    fn quotient(&mut self, above: u64, below: u64) -> u64 {
        let above = self.add(format!("DERIVED_UNIT_ELEMENT(#{above},1.)"));
        let below = self.add(format!("DERIVED_UNIT_ELEMENT(#{below},-1.)"));
        self.add(format!("DERIVED_UNIT((#{above},#{below}))"))
    }

    fn unit(&mut self, name: &'static str, make: impl FnOnce(&mut Self) -> u64) -> u64 {
        if let Some(&id) = self.units.get(name) {
            return id;
        }
        let id = make(self);
        self.units.insert(name, id);
        id
    }
}

/// Units of speeds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum SpeedUnit {
    /// Of the file's length unit.
    LengthPerMinute,
    /// The same, for each turn of the spindle.
    LengthPerRevolution,
    RevolutionsPerMinute,
    MetresPerMinute,
}

/// Without the noise that changing units leaves in the last digits.
fn short(number: f64) -> f64 {
    format!("{number:.13e}").parse().unwrap_or(number)
}
