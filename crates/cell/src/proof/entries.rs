//! Entries that a proof tries, and what the law says of them.

use super::*;

/// What the law says, in the control's unit. A vacant entry and 0 are the control's words for nothing entered.
pub(super) fn by_law(dimension: &Dimension, typed: Option<&str>, before: f64) -> Expected {
    let Some(text) = typed.filter(|t| is_entered(t)) else {
        return Expected::Nothing;
    };
    expected(dimension, entered(dimension, text, before, Others::default()))
}

/// The same of sizes that move one register by their mean: each is entered in turn, and the last one moves it.
pub(super) fn mean_by_law(mates: &[&Dimension], typed: &[Option<&str>], before: f64) -> Expected {
    let given: Vec<(&Dimension, &str)> = mates
        .iter()
        .zip(typed)
        .filter_map(|(d, t)| t.filter(|t| is_entered(t)).map(|t| (*d, t)))
        .collect();
    let mut asked = Vec::new();
    let mut last = Expected::Nothing;
    for (n, (dimension, text)) in given.iter().enumerate() {
        let is_last = n + 1 == mates.len();
        let others = Others {
            asked: asked.clone(),
            missing: if is_last { Vec::new() } else { vec!["another".to_owned()] },
        };
        match entered(dimension, text, before, others) {
            Ok(correction) if is_last => last = expected(dimension, Ok(correction)),
            Ok(correction) => asked.push(sizing::correction::asked(dimension, correction.measured)),
            refused => return expected(dimension, refused),
        }
    }
    last
}

fn is_entered(text: &str) -> bool {
    text.parse() != Ok(0.0)
}

fn entered(dimension: &Dimension, text: &str, before: f64, others: Others) -> Result<Correction, EntryError> {
    let entry = Entry {
        text: text.to_owned(),
        unit: dimension.unit,
        who: "the proof".to_owned(),
        // A control knows no levels: nobody may make a large step there.
        level: 10,
        remark: String::new(),
        when: Timestamp(0),
    };
    let present = Present {
        register: Some(dimension.unit.length(before).0),
        others,
        ..Present::default()
    };
    sizing::enter(dimension, &entry, &present)
}

fn expected(dimension: &Dimension, result: Result<Correction, EntryError>) -> Expected {
    match result {
        Ok(correction) => Expected::Change(generate::in_unit(dimension.unit, units::Millimetres(correction.change))),
        Err(EntryError::TooSmall { .. }) => Expected::Alarm(generate::TOO_SMALL),
        Err(EntryError::TooBig { .. }) => Expected::Alarm(generate::TOO_BIG),
        Err(EntryError::StepTooLarge { .. }) => Expected::Alarm(generate::STEP_TOO_LARGE),
        // Any other refusal is none that a macro has: it would be a difference.
        Err(_) => Expected::Alarm(0),
    }
}

/// A size as a person types it, or as it stands in an offset.
fn typed_as(dimension: &Dimension, number: f64, method: Method) -> String {
    let digits = match dimension.unit {
        Unit::Mm => 5,
        Unit::Inch => 6,
    };
    match method {
        Method::TWord => format!("{number:.digits$}"),
        // An offset holds whole steps, and no more than three digits before the point in mm, two in inches.
        Method::G65 => {
            let most = if dimension.unit == Unit::Mm { 999.0 } else { 99.0 };
            let steps = generate::steps_per_unit(dimension);
            format!("{:.digits$}", libm::round(number.clamp(-most, most) * steps) / steps)
        }
    }
}

/// Entries about the target that are used, with half steps and nothing entered among them.
pub(super) fn near_target(dimension: &Dimension, method: Method) -> Vec<Option<String>> {
    let unit = |length| generate::in_unit(dimension.unit, length);
    let (target, step) = (unit(dimension.target), unit(dimension.increment));
    let mut all: Vec<_> = [
        -9.0, -4.5, -3.0, -2.0, -1.5, -1.0, -0.5, -0.3, 0.0, 0.4, 0.5, 1.0, 2.5, 3.0, 6.0, 11.0,
    ]
    .map(|k| Some(typed_as(dimension, target + k * step, method)))
    .into();
    all.push(None);
    all
}

/// Entries to try, as decimal text in the dimension's unit; `None` is vacant. Not less than `least`: the edges first, then the window and
/// its surroundings evenly.
pub(super) fn grid(dimension: &Dimension, least: usize, method: Method) -> Vec<Option<String>> {
    let unit = |length| generate::in_unit(dimension.unit, length);
    let text = |number: f64| Some(typed_as(dimension, number, method));
    let (from, to) = (unit(dimension.window.0), unit(dimension.window.1));
    let fine = unit(dimension.increment) / 10.0;
    let mut all = vec![None, text(0.0)];
    let reach = unit(dimension.largest_step) * dimension.response.size_per_register().abs();
    let target = unit(dimension.target);
    let edges = [
        from,
        to,
        unit(dimension.low),
        unit(dimension.high),
        target,
        target + reach,
        target - reach,
        unit(dimension.nominal),
    ];
    for edge in edges {
        // A tenth of a step on either side, half a step and whole steps.
        all.extend([-20.0, -10.0, -5.0, -4.0, -1.0, 0.0, 1.0, 4.0, 5.0, 10.0, 20.0].map(|k| text(edge + k * fine)));
    }
    let absurd = [
        1e-4,
        1.0,
        999.999,
        99_999.0,
        -target,
        -1.0,
        target * 25.4,
        target / 25.4,
        target * 10.0,
        target / 10.0,
        target + 1.0,
    ];
    all.extend(absurd.map(text));
    let margin = (to - from) * 0.1;
    let rest = least.saturating_sub(all.len()).max(1);
    let step = (to - from + 2.0 * margin) / rest as f64;
    all.extend((0..rest).map(|k| text(from - margin + (k as f64 + 0.5) * step)));
    all
}
