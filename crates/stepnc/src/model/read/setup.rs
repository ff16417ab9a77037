//! Frames of the AIM: set-ups, orientations, security planes, and where the workpiece lies.

use super::*;

/// The placement in a representation: the item named `orientation`, else the first; with its units.
pub(super) fn placed(program: &Program, representation: u64) -> Result<Option<PathTransform>, Fault> {
    let aim = program.aim();
    let representation = aim.representation(representation)?;
    let mut placements: Vec<u64> = representation
        .items
        .iter()
        .copied()
        .filter(|&item| curve::is_placement(aim, item))
        .collect();
    placements.sort_by_key(|&item| aim.item_name(item) != "orientation");
    let Some(&item) = placements.first() else { return Ok(None) };
    let units = context(program, &representation)?;
    curve::placement(aim, item, units.millimetres).map(Some)
}

fn context(program: &Program, representation: &crate::aim::Representation) -> Result<ContextUnits, Fault> {
    let id = representation.context.unwrap_or(representation.id);
    match program.contexts.get(&id) {
        Some(units) => units.clone(),
        None => program.aim().context_units(id),
    }
}

pub(super) fn plane_height(program: &Program, representation: u64) -> Result<Option<Millimetres>, Fault> {
    let aim = program.aim();
    let representation = aim.representation(representation)?;
    let Some(&plane) = representation.items.iter().find(|&&item| aim.keyword(item) == "PLANE") else {
        return Ok(None);
    };
    let units = context(program, &representation)?;
    let plane = aim.instance(plane)?;
    let Some(position) = plane.argument(1).reference() else {
        return Ok(None);
    };
    let frame = curve::placement(aim, position, units.millimetres)?;
    Ok(Some(Millimetres(frame.origin[2])))
}

pub(super) fn read_setup(program: &Program, process: u64) -> Result<Option<Setup>, Fault> {
    let aim = program.aim();
    let definition = aim
        .users_by(process, "PROCESS_PRODUCT_ASSOCIATION", 3)
        .find_map(|(_, association)| association.argument(2).reference());
    let Some(definition) = definition else { return Ok(None) };
    let formation = aim.instance(definition)?.argument(2).reference();
    let product = formation.and_then(|formation| aim.instance(formation).ok()?.argument(2).reference());
    let name = product.and_then(|product| aim.instance(product).ok());
    let name = name.map(|product| text(product.argument(0)).into_owned()).unwrap_or_default();

    let mut machine_from_setup = None;
    for (shape, instance) in aim.users_by(definition, "PRODUCT_DEFINITION_SHAPE", 2) {
        if text(instance.argument(0)) != "orientation" {
            continue;
        }
        for (_, link) in aim.users_by(shape, "SHAPE_DEFINITION_REPRESENTATION", 0) {
            if let Some(representation) = link.argument(1).reference()
                && let Some(frame) = placed(program, representation)?
            {
                machine_from_setup = Some(retarget(&frame));
            }
        }
    }
    let mut security_plane = None;
    for (property, instance) in aim.users_by(definition, "PROPERTY_DEFINITION", 2) {
        if text(instance.argument(0)) != "security plane" {
            continue;
        }
        for (_, link) in aim.users_by(property, "PROPERTY_DEFINITION_REPRESENTATION", 0) {
            if let Some(representation) = link.argument(1).reference() {
                security_plane = plane_height(program, representation)?.or(security_plane);
            }
        }
    }
    Ok(Some(Setup {
        id: definition,
        name,
        machine_from_setup,
        setup_from_part: workpiece_placement(program, definition),
        security_plane,
        fixture: fixture(aim, definition),
    }))
}

/// The fixture that the product definition of a set-up uses.
fn fixture(aim: Aim, setup: u64) -> Option<Fixture> {
    let processes = aim
        .users_by(setup, "PROCESS_PRODUCT_ASSOCIATION", 2)
        .filter_map(|(_, association)| aim.instance(association.argument(3).reference()?).ok());
    let mut usages = processes
        .filter(|process| text(process.argument(0)) == "fixture usage")
        .filter_map(|process| process.argument(2).reference());
    let id = usages.next()?;
    let usage = aim.instance(id).ok()?;
    let attributes = aim.attributes(&usage, "ACTION_METHOD");
    Some(Fixture {
        id,
        name: attributes.first().map(text).unwrap_or_default().into_owned(),
        values: values_of(aim, &aim.links(id), &[]),
    })
}

/// The same numbers read as a transform into the machine.
fn retarget<T: units::Frame, S: units::Frame>(frame: &Transform<units::Setup, units::Setup>) -> Transform<T, S> {
    let mut out = Transform::IDENTITY;
    out.rotation = frame.rotation;
    out.origin = frame.origin;
    out
}

/// Where the workpiece lies in the set-up: item 1 is a frame in the workpiece, item 2 where that frame is in the set-up.
fn workpiece_placement(program: &Program, setup: u64) -> Option<Transform<units::Setup, Part>> {
    let aim = program.aim();
    let (relation, _) = aim.users_by(setup, "MACHINING_SETUP_WORKPIECE_RELATIONSHIP", 3).next()?;
    let (shape, _) = aim.users_by(relation, "PRODUCT_DEFINITION_SHAPE", 2).next()?;
    let (_, link) = aim.users_by(shape, "CONTEXT_DEPENDENT_SHAPE_REPRESENTATION", 1).next()?;
    let relationship = aim.instance(link.argument(0).reference()?).ok()?;
    let transformation = relationship
        .part("REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION")?
        .first()?
        .reference()?;
    let shapes = relationship.part("REPRESENTATION_RELATIONSHIP")?;
    let units_of = |n: usize| {
        let representation = aim.representation(shapes.get(n)?.reference()?).ok()?;
        context(program, &representation).ok()
    };
    let (part_units, setup_units) = (units_of(2)?, units_of(3)?);
    let transformation = aim.instance(transformation).ok()?;
    let in_part = curve::placement(aim, transformation.argument(2).reference()?, part_units.millimetres).ok()?;
    let in_setup = curve::placement(aim, transformation.argument(3).reference()?, setup_units.millimetres).ok()?;
    Some(retarget(&(in_setup * in_part.inverse())))
}
