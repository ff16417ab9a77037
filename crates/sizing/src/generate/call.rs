//! The macro that is called by G65 before the turret index; sizes are typed into a secondary offset.

use super::layout::Layout;
use super::{
    ANOTHER_JOB, G65_WORKER, INTERRUPTED, MacroProgram, STEP_TOO_LARGE, SetupEnd, TOO_BIG, TOO_SMALL, comment, in_unit,
    largest_steps, number, printed, steps_per_unit, unit_check, unit_code,
};
use crate::control::Control;
use crate::{Dimension, Job};
use std::collections::BTreeMap;

/// The system variable that a size of this dimension is typed into.
pub fn entry_variable(dimension: &Dimension, control: &Control) -> u32 {
    let base = control
        .base_of(dimension.column)
        .expect("looked at before anything is generated");
    base + dimension.offset + control.secondary
}

/// The variables that this method uses, with their names.
pub fn names(layout: &Layout, dimensions: usize) -> BTreeMap<u32, String> {
    let counts = 1 + layout.count..=layout.count + dimensions as u32;
    let used = |n: &u32| *n == layout.job || *n == layout.taken || counts.contains(n);
    let all = layout.names.iter().filter(|(n, _)| used(n));
    all.map(|(n, name)| (*n, name.clone())).collect()
}

/// The set-up program of a job: clears the secondary offsets, which may hold another job's sizes, and says whose they are now.
pub(super) fn setup(job: &Job, dimensions: &[Dimension], layout: &Layout, control: &Control, end: SetupEnd) -> MacroProgram {
    let mut out = String::new();
    let mut line = |text: String| {
        out.push_str(&text);
        out.push('\n');
    };
    line(format!("O{:04}(SIZING SET-UP {})", job.number, comment(&job.name)));
    line("(RUN ONCE BEFORE THE JOB. IT CLEARS ENTRIES AND COUNTERS)".into());
    for d in dimensions {
        line(format!(
            "({} IS TYPED INTO {} OF OFFSET {} FOR OFFSET {})",
            comment(&d.name),
            comment(&d.column.to_string()),
            d.offset + control.secondary,
            d.offset
        ));
    }
    let mut check = String::new();
    unit_check(&mut check, &unit_code(job.unit).to_string(), 1);
    check.lines().for_each(|l| line(l.to_owned()));
    line(format!("N1 #{}=#0 (NO JOB WHILE THIS RUNS)", layout.job));
    for (variable, name) in &names(layout, dimensions.len()) {
        line(format!("SETVN {variable}[{name}]"));
    }
    for (k, d) in (1..).zip(dimensions) {
        line(format!("#{}=0", entry_variable(d, control)));
        line(format!("#{}=0", layout.count + k));
    }
    line(format!("#{}=0", layout.taken));
    line(format!("#{}={} (THE SET-UP IS WHOLE)", layout.job, job.number));
    line(match end {
        SetupEnd::M30 => "M30".into(),
        SetupEnd::M99 => "M99".into(),
    });
    MacroProgram {
        number: job.number,
        text: out,
    }
}

/// The call of dimension `k` (from 1): T offset, D target, S and B window, A register of offset 0, F steps of the register for one unit of
/// size, Q largest steps, J job, C dimension, R steps in one unit, H unit. Every number has its point: without one a control may read
/// least increments.
pub fn call(k: usize, dimension: &Dimension, job: u32, control: &Control) -> String {
    let unit = dimension.unit;
    let base = control
        .base_of(dimension.column)
        .expect("looked at before anything is generated");
    let steps = steps_per_unit(dimension);
    format!(
        "G65 P{G65_WORKER} T{}. D{} S{} B{} A{base}. F{} Q{} J{job}. C{k}. R{} H{}.",
        dimension.offset,
        number(in_unit(unit, dimension.target)),
        number(in_unit(unit, dimension.window.0)),
        number(in_unit(unit, dimension.window.1)),
        number(steps / dimension.response.size_per_register()),
        number(largest_steps(dimension)),
        number(steps),
        unit_code(unit),
    )
}

/// O8002: the same for every job.
pub(super) fn worker(layout: &Layout, control: &Control) -> MacroProgram {
    let Layout { job, taken, count, .. } = layout;
    let mut out = String::new();
    let mut line = |text: &str| {
        out.push_str(text);
        out.push('\n');
    };
    line(&format!("O{G65_WORKER}(SIZING, CALLED BY G65 BEFORE THE TURRET INDEX)"));
    line("(#27 ENTRY, #28 STEPS, #29 ITS PLACE, #30 REGISTER, #31 BEFORE, #32 CHANGE, #33 COUNT)");
    line(&format!("IF[#{job}EQ#5]GOTO1"));
    line(&format!("#3000={ANOTHER_JOB}(SET-UP OF ANOTHER JOB)"));
    line(&format!("N1 IF[#{taken}EQ0]GOTO2"));
    line(&format!("#{taken}=0"));
    line(&format!("#3000={INTERRUPTED}(LAST ENTRY CUT OFF, MEASURE)"));
    line("N2 #30=#1+#20");
    line(&format!("#29=#30+{}", control.secondary));
    line("#27=#[#29]");
    line("IF[#27EQ#0]GOTO99 (VACANT IS NOT EQ 0)");
    line("IF[#27EQ0]GOTO99");
    let mut check = String::new();
    unit_check(&mut check, "#11", 4);
    check.lines().for_each(&mut line);
    line("N4 IF[#27GT#19]GOTO5");
    line(&format!("#3000={TOO_SMALL}(DIMENSION ENTERED TOO SMALL)"));
    line("N5 IF[#27LT#2]GOTO6");
    line(&format!("#3000={TOO_BIG}(DIMENSION ENTERED TOO BIG)"));
    line("N6 #28=ROUND[ROUND[[#7-#27]*#9*1000]/1000]");
    line("IF[ABS[#28]LE#17]GOTO7");
    line(&format!("#3000={STEP_TOO_LARGE}(STEP TOO LARGE, ASK SETTER)"));
    line("N7 G53 (WAIT UNTIL ALL MOVES ARE DONE)");
    line(&format!("#{taken}=#3"));
    line("#[#29]=0 (TAKEN, BEFORE THE OFFSET IS WRITTEN)");
    line("#31=#[#30]");
    line("#32=#28/#18");
    line("#[#30]=#31+#32");
    line(&format!("#33=#[{count}+#3]+1"));
    line(&format!("#[{count}+#3]=#33"));
    line(&format!("#{taken}=0"));
    if control.prints {
        line("POPEN");
        line(&printed(&format!("#{job}"), "#3", "#20", "#27", "#31", "#32", "#33"));
        line("PCLOS");
    }
    line("N99 M99");
    MacroProgram {
        number: G65_WORKER,
        text: out,
    }
}
