//! Features of the AIM as named data: what a workingstep makes, with the dimensions that hang on it.

use super::*;

/// Relationships between a feature and the profiles, paths and other parts that give it its shape.
const PARTS: [&str; 3] = [
    "SHAPE_DEFINING_RELATIONSHIP",
    "FEATURE_COMPONENT_RELATIONSHIP",
    "SHAPE_ASPECT_RELATIONSHIP",
];
/// A feature has profiles, a profile has elements.
const DEEPEST: u32 = 2;
/// Values of one feature, at most: beyond that nobody reads them.
const MOST_VALUES: usize = 200;

/// The features behind a workingstep's MACHINING_FEATURE_PROCESS instances.
pub(super) fn features_of(aim: Aim, links: &Links) -> Vec<u64> {
    let mut found: Vec<u64> = Vec::new();
    for keyword in [
        "MACHINING_FEATURE_RELATIONSHIP",
        "MACHINING_FEATURE_SEQUENCE_RELATIONSHIP",
        "MACHINING_FINAL_FEATURE_RELATIONSHIP",
    ] {
        for process in links.in_sequence(keyword) {
            let processes = aim.users_by(process, "PROPERTY_PROCESS", 2).map(|(id, _)| id);
            let features = processes
                .flat_map(|process| aim.users_by(process, "PROCESS_PROPERTY_ASSOCIATION", 2))
                .filter_map(|(_, association)| association.argument(3).reference());
            for feature in features {
                if !found.contains(&feature) {
                    found.push(feature);
                }
            }
        }
    }
    found
}

/// A feature with its data.
pub(super) fn feature(aim: Aim, id: u64) -> Result<Feature, Fault> {
    let instance = aim.instance(id)?;
    // The entities of a complex instance that every feature has say nothing.
    let plain = [
        "CHARACTERIZED_OBJECT",
        "FEATURE_DEFINITION",
        "SHAPE_ASPECT",
        "INSTANCED_FEATURE",
    ];
    let mut kinds: Vec<String> = instance.records().iter().map(|record| record.keyword.to_string()).collect();
    if kinds.iter().any(|kind| !plain.contains(&kind.as_str())) {
        kinds.retain(|kind| !plain.contains(&kind.as_str()));
    }
    let named = ["SHAPE_ASPECT", "CHARACTERIZED_OBJECT"].map(|part| instance.part(part).and_then(|part| part.first()).map(text));
    let name = match &instance {
        Instance::Simple(record) => record.arguments.first().map(text).unwrap_or_default().into_owned(),
        Instance::Complex(_) => named
            .into_iter()
            .flatten()
            .find(|name| !name.is_empty())
            .unwrap_or_default()
            .into_owned(),
    };
    let mut values = Vec::new();
    collect(aim, id, "", 0, &mut values);
    Ok(Feature { id, name, kinds, values })
}

/// The parameters of a shape aspect, and of its parts.
fn collect(aim: Aim, aspect: u64, prefix: &str, depth: u32, values: &mut Vec<NamedValue>) {
    for keyword in ["PRODUCT_DEFINITION_SHAPE", "PROPERTY_DEFINITION"] {
        for (property, _) in aim.users_by(aspect, keyword, 2) {
            for chain in ["SHAPE_DEFINITION_REPRESENTATION", "PROPERTY_DEFINITION_REPRESENTATION"] {
                for (_, link) in aim.users_by(property, chain, 0) {
                    let representation = link.argument(1).reference().and_then(|id| aim.representation(id).ok());
                    for mut value in representation.map(|found| aim.named_values("", &found)).unwrap_or_default() {
                        if values.len() >= MOST_VALUES {
                            return;
                        }
                        if !prefix.is_empty() {
                            value.name = format!("{prefix}: {}", value.name);
                        }
                        values.push(value);
                    }
                }
            }
        }
    }
    if depth >= DEEPEST {
        return;
    }
    for keyword in PARTS {
        for end in [2, 3] {
            for (_, relation) in aim.users_by(aspect, keyword, end) {
                // Writers differ in which end the feature is; going back up is harmless only where nothing new is found.
                let Some(part) = relation.argument(5 - end).reference() else {
                    continue;
                };
                let usage = text(relation.argument(0)).into_owned();
                if values.len() < MOST_VALUES && !aim.is(part, "INSTANCED_FEATURE") && (depth == 0 || end == 3) {
                    collect(aim, part, &usage, depth + 1, values);
                }
            }
        }
    }
}
