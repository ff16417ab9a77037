//! Recordings through FIFO variables and synchronized actions in the servo cycle, in the forms of the reference.

use super::*;
use crate::functions::of_a_frame;
use trace::functions::CoordinateFrame;
use trace::sensor::{Meaning, meaning};

/// FIFO variables there are.
const FIFOS: u32 = 10;

/// How many there are is set by the machine builder, and few or none by default.
const KEPT: &str = "actions and recordings keep values in $AC_MARKER (MD28256), $AC_PARAM (MD28254) and $AC_TIMER (MD28258): let there be \
                    as many as the program uses";

/// The next marker that nothing uses.
fn marker(sheet: &mut Sheet<'_>) -> u32 {
    let all = sheet.notes.entry("markers".to_owned()).or_default();
    let next = u32::try_from(all.len()).unwrap_or(u32::MAX) + 1;
    all.push(next);
    next
}

fn value_in_cycle(sensor: &Sensor, control: &dyn Control, turning: bool) -> Result<Source, Verdict> {
    match control.reading(&sensor.stream(), turning) {
        Reading::Value(source) if source.realtime => Ok(source),
        Reading::Value(_) => Err(Verdict::external(format!("{sensor} is not in the servo cycle: {BESIDE}"))),
        Reading::Outside(by) => Err(Verdict::external(format!("{sensor}: {by}"))),
        Reading::Nothing(why) => Err(Verdict::refused(format!("{sensor}: {why}"))),
    }
}

pub(super) fn start_recording(recording: &Recording, control: &dyn Control, sheet: &mut Sheet<'_>) -> Result<Verdict, Refusal> {
    let sensors = streams_of(recording)?;
    if recording.statistic != Statistic::Last {
        return Ok(Verdict::external(format!(
            "a FIFO keeps values, not minimum, maximum or means: {BESIDE}"
        )));
    }
    let mut sources = Vec::new();
    for sensor in &sensors {
        match value_in_cycle(sensor, control, sheet.turning) {
            Ok(source) => sources.push(source),
            Err(verdict) => return Ok(verdict),
        }
    }
    let factor = match &recording.sampling {
        Sampling::ByCycle(factor) => Some(*factor),
        Sampling::ByTime(_) => None,
        Sampling::ByDistance(_) | Sampling::ByPoints { .. } | Sampling::ByCount(_) => {
            return Ok(Verdict::external(format!("samples by distance, points or count: {BESIDE}")));
        }
    };
    let used = sheet.notes.entry("fifos".to_owned()).or_default();
    let free: Vec<u32> = (1..=FIFOS).filter(|fifo| !used.contains(fifo)).take(sources.len()).collect();
    if free.len() < sources.len() {
        return Ok(Verdict::external(format!(
            "{} values and {} FIFO variables are free: {BESIDE}",
            sources.len(),
            free.len()
        )));
    }
    used.extend(&free);
    let recordings = sheet.notes.entry("recordings".to_owned()).or_default();
    recordings.push(0);
    let first = 99 + 2 * u32::try_from(recordings.len()).unwrap_or(50);
    if first > 198 {
        return Ok(Verdict::external(format!("more than 50 recordings in one program: {BESIDE}")));
    }
    let pushes: Vec<String> = free
        .iter()
        .zip(&sources)
        .map(|(fifo, source)| format!("$AC_FIFO{fifo}[0]={}", source.text))
        .collect();
    let resets: Vec<String> = free.iter().map(|fifo| format!("$AC_FIFO{fifo}[4]=0")).collect();
    let mut ids = vec![first];
    let verified = sources.iter().all(|source| source.verified);
    match (&recording.sampling, factor) {
        (_, Some(1)) => {
            sheet.words(&resets);
            sheet.line(&format!("ID={first} DO {}", pushes.join(" ")));
        }
        (_, Some(factor)) => {
            let marker = marker(sheet);
            // One less than the factor, so that the first sample falls in the first cycle.
            sheet.line(&format!("{} $AC_MARKER[{marker}]={}", resets.join(" "), factor - 1));
            sheet.line(&format!("ID={first} DO $AC_MARKER[{marker}]=$AC_MARKER[{marker}]+1"));
            sheet.line(&format!(
                "ID={} WHENEVER $AC_MARKER[{marker}]>={factor} DO {} $AC_MARKER[{marker}]=0",
                first + 1,
                pushes.join(" ")
            ));
            ids.push(first + 1);
        }
        (Sampling::ByTime(interval), _) => {
            let timers = sheet.notes.entry("timers".to_owned()).or_default();
            timers.push(0);
            let timer = 3 + u32::try_from(timers.len()).unwrap_or(u32::MAX);
            let interval = sheet.number(interval.0, NUMBERS)?;
            sheet.line(&format!("{} $AC_TIMER[{timer}]={interval}", resets.join(" ")));
            sheet.line(&format!(
                "ID={first} WHENEVER $AC_TIMER[{timer}]>={interval} DO {} $AC_TIMER[{timer}]=0",
                pushes.join(" ")
            ));
        }
        _ => {}
    }
    if factor != Some(1) {
        sheet.notice(KEPT);
    }
    let id = recording.id.0.to_ascii_lowercase();
    sheet.notes.insert(format!("recording ids {id}"), ids);
    sheet.notes.insert(format!("recording fifos {id}"), free);
    sheet.notice("recordings need FIFO variables: MD28260 (number) and MD28264 (length); what a FIFO cannot hold is lost");
    let units: Vec<String> = sensors
        .iter()
        .zip(&sources)
        .filter(|(_, source)| source.factor != 1.0)
        .map(|(sensor, source)| format!("{sensor} in the control's unit, times {}", source.factor))
        .collect();
    let mut reason = "as long as the FIFO holds; read out at its stop".to_owned();
    if let Some(most) = recording.max_samples {
        reason += &format!("; let MD28264 be {most} or more");
    }
    if !units.is_empty() {
        reason += &format!("; {}", units.join(", "));
    }
    Ok(Verdict::native(verified, reason))
}

pub(super) fn stop_recording(id: &str, sheet: &mut Sheet<'_>) -> Option<Verdict> {
    let id = id.to_ascii_lowercase();
    let ids = sheet.notes.remove(&format!("recording ids {id}"))?;
    let fifos = sheet.notes.remove(&format!("recording fifos {id}")).unwrap_or_default();
    cancel(&ids, sheet);
    if let Some(used) = sheet.notes.get_mut("fifos") {
        used.retain(|fifo| !fifos.contains(fifo));
    }
    let first = fifos.first().copied().unwrap_or(1);
    let values: Vec<String> = fifos.iter().map(|fifo| format!("<<$AC_FIFO{fifo}[0]")).collect();
    sheet.line("STOPRE");
    sheet.line(&format!("WHILE $AC_FIFO{first}[4]>0"));
    sheet.line(&format!(
        "WRITE(TM_ERROR,\"TM_LOG\",\"RECORDING {} \"{})",
        sheet.short(&id, 40),
        values.join("<<\" \"")
    ));
    sheet.line("STOPRE");
    sheet.line("ENDWHILE");
    Some(Verdict::native(
        false,
        "taken out of the servo cycle, then written to the log; the motion waits for it",
    ))
}

fn cancel(ids: &[u32], sheet: &mut Sheet<'_>) {
    let ids: Vec<String> = ids.iter().map(u32::to_string).collect();
    sheet.line(&format!("CANCEL({})", ids.join(",")));
    sheet.verify("CANCEL");
}

pub(super) fn start_action(
    action: &SynchronizedAction,
    control: &dyn Control,
    sheet: &mut Sheet<'_>,
) -> Result<Verdict, Refusal> {
    let mut verified = true;
    let condition = match &action.condition {
        None => None,
        Some(condition) => match in_action(condition, control, sheet) {
            Ok((text, known)) => {
                verified &= known;
                Some(text)
            }
            Err(refusal) => return Ok(Verdict::external(format!("{}; {BESIDE}", refusal.message))),
        },
    };
    // What the actions read is kept in parameters and written out at the stop.
    let mut words = Vec::new();
    let mut kept = Vec::new();
    let mut events = Vec::new();
    let mut alarms = Vec::new();
    let parameter = sheet.notes.get("parameters").and_then(|p| p.last()).copied().unwrap_or(10);
    let mut next = parameter;
    for function in &action.actions {
        let found = match &function.call {
            Call::ReadSensorValue { sensor, axes } => streams(sensor, axes),
            Call::Get(measurement) if measurement.frame != CoordinateFrame::Machine => {
                return Ok(Verdict::external(format!("{}: {BESIDE}", of_a_frame(measurement.frame))));
            }
            Call::Get(measurement) => measurement.streams(),
            Call::SetAlarm(alarm) => {
                alarms.push(format!("SETAL({})", 65_000 + u32::from(alarm.id)));
                verified = false;
                continue;
            }
            Call::LogEvent { kind, text, values } if values.is_empty() => {
                events.push(format!("EVENT {kind} {}", text.clone().unwrap_or_default()));
                continue;
            }
            _ => {
                return Ok(Verdict::external(format!(
                    "{} as an action is nothing that a synchronized action of this control does: {BESIDE}",
                    function.name
                )));
            }
        };
        let found = found.map_err(|no| Refusal::new("sensor", no.message, "correct the sensor's name"))?;
        for sensor in found {
            match value_in_cycle(&sensor, control, sheet.turning) {
                Ok(source) => {
                    verified &= source.verified;
                    words.push(format!("$AC_PARAM[{next}]={}", source.text));
                    kept.push((sensor.to_string(), next));
                    next += 1;
                }
                Err(verdict) => return Ok(verdict),
            }
        }
    }
    let marker = marker(sheet);
    words.push(format!("$AC_MARKER[{marker}]=1"));
    words.extend(alarms);
    let number = match action.id.0.parse::<u32>() {
        // `07` is another id than `7`.
        Ok(number) if (1..=99).contains(&number) && number.to_string() == action.id.0 => number,
        _ => {
            let others = sheet.notes.entry("actions".to_owned()).or_default();
            others.push(0);
            199 + u32::try_from(others.len()).unwrap_or(50)
        }
    };
    if number > 255 {
        return Ok(Verdict::external(format!("more synchronized actions than 255: {BESIDE}")));
    }
    let frequency = match action.frequency {
        Frequency::None => "",
        Frequency::Whenever => "WHENEVER ",
        Frequency::From => "FROM ",
        Frequency::When => "WHEN ",
        Frequency::Every => "EVERY ",
    };
    let scope = if action.all_modes { "IDS" } else { "ID" };
    let condition = condition.map(|text| format!("{text} ")).unwrap_or_default();
    sheet.line(&format!("$AC_MARKER[{marker}]=0"));
    sheet.line(&format!("{scope}={number} {frequency}{condition}DO {}", words.join(" ")));
    sheet.notice(KEPT);
    sheet.notes.insert("parameters".to_owned(), vec![next]);
    let id = action.id.0.to_ascii_lowercase();
    sheet.notes.insert(format!("action {id}"), vec![number, marker]);
    sheet
        .notes
        .insert(format!("action parameters {id}"), kept.iter().map(|(_, n)| *n).collect());
    let logs = !events.is_empty();
    let texts: Vec<String> = kept.iter().map(|(name, _)| name.clone()).chain(events).collect();
    sheet.texts.insert(format!("action {id}"), texts);
    let mut reason = "in the servo cycle".to_owned();
    if !kept.is_empty() {
        reason += "; values of the last firing are kept and written out at its stop";
    }
    if logs {
        reason += "; what it logs is written once, at its stop";
    }
    if action.all_modes {
        reason += "; in all modes, to its stop or power-off";
    }
    Ok(Verdict::native(verified, reason))
}

/// What a part of a condition is to a synchronized action.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Seen {
    /// Numbers only.
    Number,
    /// Worked out when the block is read: variables of the program.
    Before,
    /// In every cycle.
    InCycle,
    /// A value that is read ahead, or both kinds in one expression.
    Never,
}

/// A condition of the servo cycle. It compares values of the cycle with each other, or with an expression that is worked out when the block
/// is read (PGA 04.00, p. 10-344); the value of the cycle stands on the left.
fn in_action(condition: &Expression, control: &dyn Control, sheet: &mut Sheet<'_>) -> Result<(String, bool), Refusal> {
    let bracketed = |side: &Expression, (text, verified): (String, bool)| match side {
        Expression::Binary(..) => (format!("({text})"), verified),
        _ => (text, verified),
    };
    match condition {
        Expression::Binary(operator @ (Operator::And | Operator::Or | Operator::Xor), left, right) => {
            let word = OPERATORS
                .iter()
                .find(|(known, _)| known == operator)
                .map_or("", |(_, word)| *word);
            let first = bracketed(left, in_action(left, control, sheet)?);
            let second = bracketed(right, in_action(right, control, sheet)?);
            Ok((format!("{}{word}{}", first.0, second.0), first.1 && second.1))
        }
        Expression::Not(inner) => {
            let (text, verified) = in_action(inner, control, sheet)?;
            Ok((format!("NOT ({text})"), verified))
        }
        Expression::Binary(operator, left, right) => match (seen(left, control, sheet)?, seen(right, control, sheet)?) {
            (Seen::InCycle, Seen::Before) => {
                let first = bracketed(left, spell(left, &IN_ACTION, control, sheet)?);
                let second = bracketed(right, spell(right, &STYLE, control, sheet)?);
                let word = OPERATORS
                    .iter()
                    .find(|(known, _)| known == operator)
                    .map_or("", |(_, word)| *word);
                Ok((format!("{}{word}{}", first.0, second.0), first.1 && second.1))
            }
            (Seen::Before | Seen::Number, Seen::InCycle) => {
                let turned = match operator {
                    Operator::Less => Operator::Greater,
                    Operator::LessOrEqual => Operator::GreaterOrEqual,
                    Operator::Greater => Operator::Less,
                    Operator::GreaterOrEqual => Operator::LessOrEqual,
                    same => *same,
                };
                in_action(&Expression::Binary(turned, right.clone(), left.clone()), control, sheet)
            }
            (Seen::InCycle | Seen::Number, Seen::InCycle | Seen::Number) => spell(condition, &IN_ACTION, control, sheet),
            _ => Err(not_in_the_cycle()),
        },
        other => match seen(other, control, sheet)? {
            Seen::InCycle | Seen::Number => spell(other, &IN_ACTION, control, sheet),
            _ => Err(not_in_the_cycle()),
        },
    }
}

fn not_in_the_cycle() -> Refusal {
    Refusal::new(
        "condition",
        "the condition has a value that is not in the servo cycle",
        "use values of the servo cycle",
    )
}

fn seen(expression: &Expression, control: &dyn Control, sheet: &mut Sheet<'_>) -> Result<Seen, Refusal> {
    Ok(match expression {
        Expression::Number(..) | Expression::Truth(_) => Seen::Number,
        Expression::Name(name) => {
            // What the program itself sets comes first, as where it is spelled.
            let of_the_program = sheet.variables().contains_key(name) || meaning(name) == Meaning::Unknown;
            match source_of(name, control, sheet)? {
                source if source.realtime => Seen::InCycle,
                _ if of_the_program => Seen::Before,
                _ => Seen::Never,
            }
        }
        Expression::Not(inner) | Expression::Negate(inner) => seen(inner, control, sheet)?,
        Expression::Binary(_, left, right) => match (seen(left, control, sheet)?, seen(right, control, sheet)?) {
            (Seen::Number, other) | (other, Seen::Number) => other,
            (left, right) if left == right => left,
            _ => Seen::Never,
        },
    })
}

pub(super) fn stop_action(id: &str, sheet: &mut Sheet<'_>) -> Option<Verdict> {
    let id = id.to_ascii_lowercase();
    let numbers = sheet.notes.remove(&format!("action {id}"))?;
    let [number, marker] = numbers.as_slice() else { return None };
    let (number, marker) = (*number, *marker);
    let parameters = sheet.notes.remove(&format!("action parameters {id}")).unwrap_or_default();
    let texts = sheet.texts.remove(&format!("action {id}")).unwrap_or_default();
    cancel(&[number], sheet);
    sheet.line("STOPRE");
    sheet.line(&format!("IF $AC_MARKER[{marker}]==1"));
    for (place, text) in texts.iter().enumerate() {
        let text = sheet.short(text, 100);
        match parameters.get(place) {
            Some(parameter) => sheet.line(&format!("WRITE(TM_ERROR,\"TM_LOG\",\"{text}=\"<<$AC_PARAM[{parameter}])")),
            None => sheet.line(&format!("WRITE(TM_ERROR,\"TM_LOG\",\"{text}\")")),
        }
    }
    sheet.line(&format!("$AC_MARKER[{marker}]=0"));
    sheet.line("ENDIF");
    Some(Verdict::native(
        false,
        "taken out of the servo cycle; what it kept is written to the log; the motion waits for it",
    ))
}
