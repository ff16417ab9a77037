//! Tools of the AIM: their bodies, edges and places in the magazine.

use super::*;

pub(super) fn tool(aim: Aim, id: u64) -> Result<(Tool, Vec<Fault>), Fault> {
    let instance = aim.instance(id)?;
    let attributes = aim.attributes(&instance, "ACTION_RESOURCE");
    let name = attributes.first().map(text).unwrap_or_default().into_owned();
    let mut faults = Vec::new();
    let mut tool = Tool {
        id,
        number: None,
        kind: attributes.get(1).map(text).unwrap_or_default().into_owned(),
        diameter: None,
        length: None,
        teeth: None,
        users: attributes
            .get(2)
            .map(|users| users.references().collect())
            .unwrap_or_default(),
        values: Vec::new(),
        name,
    };
    let mut collect = |owner: u64, prefix: &str, tool: &mut Tool| -> Result<(), Fault> {
        for (property, representation, _) in aim.links(owner).properties {
            let representation = aim.representation(representation)?;
            let property = match (property.as_str(), prefix) {
                ("tool body", "") => "",
                (property, _) => property,
            };
            if property.is_empty() {
                faults.extend(body(aim, &representation.items, tool));
            }
            for mut value in aim.named_values(property, &representation) {
                if !prefix.is_empty() {
                    value.name = format!("{prefix}: {}", value.name);
                }
                tool.values.push(value);
            }
        }
        Ok(())
    };
    collect(id, "", &mut tool)?;
    let mut edges = 0;
    for (_, relation) in aim.users_by(id, "ACTION_RESOURCE_RELATIONSHIP", 2) {
        if let Some(edge) = relation.argument(3).reference() {
            edges += 1;
            collect(edge, &format!("cutting edge {edges}"), &mut tool)?;
        }
    }
    for usage in usages(aim, id) {
        collect(usage, "usage", &mut tool)?;
    }
    tool.number = number_in(&tool.name).or_else(|| {
        let position = tool.values.iter().find(|value| value.name.ends_with("tool position"))?;
        match &position.value {
            Quantity::Text { text } => number_in(text),
            Quantity::Measure { value, .. } if *value >= 0.0 && value.fract() == 0.0 => number_in(&format!("{value}")),
            _ => None,
        }
    });
    Ok((tool, faults))
}

/// The magazine places and mountings of a tool (MACHINING_TOOL_USAGE).
fn usages(aim: Aim, tool: u64) -> Vec<u64> {
    let mut found = Vec::new();
    for &row in aim.file.inverse(tool) {
        if !aim.file.is(row, "REQUIREMENT_FOR_ACTION_RESOURCE") {
            continue;
        }
        let Ok(requirement) = aim.parsed(row) else { continue };
        if requirement.argument(4).references().any(|resource| resource == tool) {
            let operations = requirement.argument(3).references();
            found.extend(operations.filter(|&user| aim.is(user, "MACHINING_TOOL_USAGE")));
        }
    }
    found
}

/// Takes what a program needs of a tool from the items of its body; the answer is what could not be read.
fn body(aim: Aim, items: &[u64], tool: &mut Tool) -> Vec<Fault> {
    let mut faults = Vec::new();
    for &item in items {
        let name = aim.item_name(item);
        let length = |into: &mut Option<Millimetres>| {
            aim.measure_of(item, unit::LENGTH, &name)
                .map(|mm| *into = Some(Millimetres(mm)))
        };
        let outcome = match name.as_str() {
            "effective cutting diameter" => length(&mut tool.diameter),
            "overall assembly length" => length(&mut tool.length),
            // A count is a number in a unit that the file made up; some write it without one.
            "number of effective teeth" => {
                let count = aim.named_item(String::new(), item, None).and_then(|value| value.number());
                tool.teeth = count.filter(|count| *count > 0.0);
                match count {
                    Some(_) => Ok(()),
                    None => Err(Fault::new(
                        item,
                        "measure",
                        "a number of teeth is no number",
                        "correct the tool",
                    )),
                }
            }
            _ => Ok(()),
        };
        faults.extend(outcome.err());
    }
    faults
}
