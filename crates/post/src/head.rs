//! What the head of a program tells the person who loads it.

use crate::control::Control;
use crate::posting::{Known, Options};

/// Lines of the head behind the program's name.
pub(crate) fn text(control: &dyn Control, known: &Known, options: &Options) -> Vec<String> {
    let mut lines = vec![format!("POSTED BY TOOLMARK FOR {}", control.about())];
    if !options.source.is_empty() {
        lines.push(format!("FROM {}", options.source));
    }
    lines.push("PATHS ARE OF THE TOOL'S CENTRE OR TIP: NO RADIUS COMPENSATION".to_owned());
    lines.extend(options.head.iter().cloned());
    for (number, name) in &known.tools {
        lines.push(format!("TOOL T{number} {name}").trim_end().to_owned());
    }
    for (words, meaning) in &known.work_offsets {
        if words != meaning {
            lines.push(format!("WORK OFFSET {words} IS {meaning}"));
        }
    }
    for (number, name) in known.variables.iter().enumerate() {
        if let Ok(variable) = control.variable(u32::try_from(number).unwrap_or(u32::MAX)) {
            lines.push(format!("VARIABLE {variable} IS {name}"));
        }
    }
    for row in &known.functions {
        let count = if row.count > 1 {
            format!(" {} TIMES", row.count)
        } else {
            String::new()
        };
        let verify = if row.verified { "" } else { ", VERIFY AT COMMISSIONING" };
        lines.push(format!(
            "FUNCTION {}{count}: {}{verify}: {}",
            row.name,
            row.grade.word().to_uppercase(),
            row.reason
        ));
    }
    lines.extend(known.notices.iter().map(|notice| format!("NOTE {notice}")));
    lines.extend(known.verify.iter().map(|form| format!("VERIFY AT COMMISSIONING: {form}")));
    lines
}
