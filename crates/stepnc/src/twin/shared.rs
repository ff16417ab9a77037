//! What all as-executed models of a file share: units, the machine's context, a workpiece, a feature.

use super::*;

/// Instances that everything new refers to.
pub(super) struct Shared {
    /// Name of the plan's project.
    pub(super) name: String,
    pub(super) product_context: u64,
    pub(super) definition_context: u64,
    pub(super) no_units: u64,
    pub(super) millimetre: u64,
    pub(super) second: u64,
    pub(super) dimensionless: u64,
    /// A geometric context in millimetres, once it is needed.
    pub(super) context: Option<u64>,
    pub(super) workpiece: u64,
    /// The feature process of workingsteps without a planned one.
    pub(super) feature_process: u64,
    pub(super) required: u64,
    pub(super) rapid: u64,
}

impl Shared {
    pub(super) fn of_file(program: &Program, main: &Executable, sink: &mut dyn Sink) -> Result<Self, WriteError> {
        let aim = program.aim();
        let first = |keyword: &str| aim.file.by_keyword(keyword).next().map(|row| aim.file.id(row));
        let project = program
            .projects()
            .iter()
            .find(|project| project.main_workplan == main.id)
            .or(program.plan());
        let name = project.map_or_else(|| main.name.clone(), |project| project.name.clone());
        let application = match first("APPLICATION_CONTEXT") {
            Some(id) => id,
            None => sink.add("APPLICATION_CONTEXT('Application protocol for the exchange of CNC data')")?,
        };
        let product_context = match first("PRODUCT_CONTEXT") {
            Some(id) => id,
            None => sink.add(&format!("PRODUCT_CONTEXT('CNC Machining',#{application},'manufacturing')"))?,
        };
        let definition_context = match first("PRODUCT_DEFINITION_CONTEXT") {
            Some(id) => id,
            None => sink.add(&format!(
                "PRODUCT_DEFINITION_CONTEXT('CNC Machining',#{application},'manufacturing')"
            ))?,
        };
        let unit_of = |keyword: &str, dimension: unit::Dimension| {
            let mut rows = aim.file.by_keyword(keyword);
            let wanted = unit::Unit { factor: 1.0, dimension };
            rows.find(|&row| aim.unit(aim.file.id(row)) == Ok(wanted))
                .map(|row| aim.file.id(row))
        };
        let millimetre = match unit_of("LENGTH_UNIT", unit::LENGTH) {
            Some(id) => id,
            None => sink.add(MILLIMETRE)?,
        };
        let second = match unit_of("TIME_UNIT", unit::TIME) {
            Some(id) => id,
            None => sink.add(SECOND)?,
        };
        let mut plain_contexts = aim
            .file
            .by_keyword("REPRESENTATION_CONTEXT")
            .filter(|&row| aim.file.keyword(row) == "REPRESENTATION_CONTEXT");
        let no_units = match plain_contexts.next() {
            Some(row) => aim.file.id(row),
            None => sink.add(NO_UNITS)?,
        };
        let in_millimetres =
            |(id, units): &(u64, unit::ContextUnits)| units.millimetres == 1.0 && aim.is(*id, "GEOMETRIC_REPRESENTATION_CONTEXT");
        let context = program.contexts().find(in_millimetres).map(|(id, _)| id);
        let dimensionless = sink.add(DIMENSIONLESS)?;
        let workpiece = aim
            .file
            .by_keyword("MACHINING_PROJECT_WORKPIECE_RELATIONSHIP")
            .find_map(|row| aim.parsed(row).ok()?.argument(4).reference());
        let workpiece = match workpiece {
            Some(id) => id,
            None => make_workpiece(sink, &name, product_context, definition_context)?,
        };
        let feature_process = match first("MACHINING_FEATURE_PROCESS") {
            Some(id) => id,
            None => make_feature(sink, workpiece)?,
        };
        let ids = [
            product_context,
            definition_context,
            no_units,
            millimetre,
            second,
            dimensionless,
            workpiece,
            feature_process,
        ];
        Self::complete(sink, name, context, ids)
    }

    pub(super) fn new_file(sink: &mut dyn Sink, name: &str) -> Result<Self, WriteError> {
        let application = sink.add("APPLICATION_CONTEXT('Application protocol for the exchange of CNC data')")?;
        sink.add(&format!(
            "APPLICATION_PROTOCOL_DEFINITION('international standard','model_based_integrated_manufacturing_schema',2022,#{application})"
        ))?;
        let product_context = sink.add(&format!("PRODUCT_CONTEXT('CNC Machining',#{application},'manufacturing')"))?;
        let definition_context = sink.add(&format!(
            "PRODUCT_DEFINITION_CONTEXT('CNC Machining',#{application},'manufacturing')"
        ))?;
        let millimetre = sink.add(MILLIMETRE)?;
        let second = sink.add(SECOND)?;
        let dimensionless = sink.add(DIMENSIONLESS)?;
        let no_units = sink.add(NO_UNITS)?;
        let workpiece = make_workpiece(sink, name, product_context, definition_context)?;
        let feature_process = make_feature(sink, workpiece)?;
        let ids = [
            product_context,
            definition_context,
            no_units,
            millimetre,
            second,
            dimensionless,
            workpiece,
            feature_process,
        ];
        Self::complete(sink, name.to_string(), None, ids)
    }

    pub(super) fn complete(sink: &mut dyn Sink, name: String, context: Option<u64>, ids: [u64; 8]) -> Result<Self, WriteError> {
        let [
            product_context,
            definition_context,
            no_units,
            millimetre,
            second,
            dimensionless,
            workpiece,
            feature_process,
        ] = ids;
        let required = sink.add("DESCRIPTIVE_REPRESENTATION_ITEM('','required')")?;
        let required = sink.add(&format!("REPRESENTATION('',(#{required}),#{no_units})"))?;
        let rapid = sink.add("DESCRIPTIVE_REPRESENTATION_ITEM('','rapid')")?;
        let rapid = sink.add(&format!(
            "MACHINING_TOOLPATH_SPEED_PROFILE_REPRESENTATION('',(#{rapid}),#{no_units})"
        ))?;
        Ok(Self {
            name,
            product_context,
            definition_context,
            no_units,
            millimetre,
            second,
            dimensionless,
            context,
            workpiece,
            feature_process,
            required,
            rapid,
        })
    }
}

const MILLIMETRE: &str = "(LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.))";
const SECOND: &str = "(NAMED_UNIT(*) SI_UNIT($,.SECOND.) TIME_UNIT())";
const NO_UNITS: &str = "REPRESENTATION_CONTEXT('','units not necessary')";
const DIMENSIONLESS: &str = "DIMENSIONAL_EXPONENTS(0.,0.,0.,0.,0.,0.,0.)";

pub(super) fn geometric_context(sink: &mut dyn Sink, millimetre: u64) -> Result<u64, EditError> {
    let radian = sink.add("(NAMED_UNIT(*) PLANE_ANGLE_UNIT() SI_UNIT($,.RADIAN.))")?;
    let steradian = sink.add("(NAMED_UNIT(*) SI_UNIT($,.STERADIAN.) SOLID_ANGLE_UNIT())")?;
    let uncertainty = sink.add(&format!(
        "UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-6),#{millimetre},'DISTANCE_ACCURACY_VALUE','maximum distance between coincident points')"
    ))?;
    sink.add(&format!(
        "(GEOMETRIC_REPRESENTATION_CONTEXT(3) GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT((#{uncertainty})) \
         GLOBAL_UNIT_ASSIGNED_CONTEXT((#{millimetre},#{radian},#{steradian})) REPRESENTATION_CONTEXT('ID1','3D'))"
    ))
}

pub(super) fn make_workpiece(
    sink: &mut dyn Sink,
    name: &str,
    product_context: u64,
    definition_context: u64,
) -> Result<u64, EditError> {
    let name = encode(name);
    let product = sink.add(&format!("PRODUCT({name},{name},$,(#{product_context}))"))?;
    let formation = sink.add(&format!("PRODUCT_DEFINITION_FORMATION('1','',#{product})"))?;
    sink.add(&format!("PRODUCT_DEFINITION('','',#{formation},#{definition_context})"))
}

/// The feature of workingsteps that only have toolpaths.
pub(super) fn make_feature(sink: &mut dyn Sink, workpiece: u64) -> Result<u64, EditError> {
    let shape = sink.add(&format!("PRODUCT_DEFINITION_SHAPE('','',#{workpiece})"))?;
    let feature = sink.add(&format!(
        "INSTANCED_FEATURE('toolpath feature','toolpath','','toolpath',#{shape},.F.)"
    ))?;
    let process = sink.add("MACHINING_FEATURE_PROCESS('','machining','','')")?;
    let property = sink.add(&format!("PROPERTY_PROCESS('machining','machining',#{process},'')"))?;
    sink.add(&format!(
        "PROCESS_PROPERTY_ASSOCIATION('','machining',#{property},#{feature})"
    ))?;
    Ok(process)
}
