//! Tools of the AIM.

use super::*;

pub(super) fn tool(aim: Aim, id: u64) -> Result<(Tool, Vec<Fault>), Fault> {
    let instance = aim.instance(id)?;
    let links = aim.links(id);
    let name = text(instance.argument(0)).into_owned();
    let mut faults = Vec::new();
    let mut tool = Tool {
        id,
        number: number_in(&name).or_else(|| number_in(&property_text(aim, &links, "tool position")?)),
        name,
        kind: text(instance.argument(1)).into_owned(),
        diameter: None,
        length: None,
        teeth: None,
        users: instance.argument(2).references().collect(),
    };
    for (_, representation, _) in links.properties.iter().filter(|property| property.0 == "tool body") {
        for &item in &aim.representation(*representation)?.items {
            let name = aim.item_name(item);
            let outcome = match name.as_str() {
                "effective cutting diameter" => aim
                    .measure_of(item, unit::LENGTH, &name)
                    .map(|mm| tool.diameter = Some(Millimetres(mm))),
                "overall assembly length" => aim
                    .measure_of(item, unit::LENGTH, &name)
                    .map(|mm| tool.length = Some(Millimetres(mm))),
                "number of effective teeth" => aim
                    .measure_of(item, unit::NUMBER, &name)
                    .map(|teeth| tool.teeth = Some(teeth)),
                _ => Ok(()),
            };
            faults.extend(outcome.err());
        }
    }
    Ok((tool, faults))
}

/// The number in `7`, `T07` or `Tool 7`.
fn number_in(text: &str) -> Option<ToolNumber> {
    let start = text.find(|c: char| c.is_ascii_digit())?;
    let digits: String = text[start..].chars().take_while(char::is_ascii_digit).collect();
    let behind = &text[start + digits.len()..];
    if behind.contains(|c: char| c.is_ascii_digit()) {
        return None; // `12 mm R0.5` is a description
    }
    digits.parse().ok().map(ToolNumber)
}
