//! The macro that is called by G65 before the turret index; sizes are typed into a secondary offset.

use super::layout::Layout;
use super::{
    ANOTHER_JOB, G65_WORKER, INTERRUPTED, MacroProgram, STEP_TOO_LARGE, SetupEnd, TOO_BIG, TOO_SMALL, comment, in_unit,
    largest_steps, number, printed, steps_per_unit, unit_check, unit_code,
};
use crate::control::Control;
use crate::{Dimension, Job};
use std::collections::BTreeMap;

/// The number of the offset that the size of a dimension is typed into: `secondary` above its own, and as much more for each size before
/// it that moves the same register by a mean.
pub fn entry_offset(dimensions: &[Dimension], index: usize, control: &Control) -> u32 {
    let register = &dimensions[index].register;
    let before = dimensions[..index].iter().filter(|d| d.register == *register).count() as u32;
    dimensions[index].offset + control.secondary * (before + 1)
}

/// The system variable of that.
pub fn entry_variable(dimensions: &[Dimension], index: usize, control: &Control) -> u32 {
    let base = control
        .base_of(dimensions[index].column)
        .expect("looked at before anything is generated");
    base + entry_offset(dimensions, index, control)
}

/// The variables that this method uses, with their names.
pub fn names(layout: &Layout, dimensions: usize) -> BTreeMap<u32, String> {
    let counts = 1 + layout.count..=layout.count + dimensions as u32;
    let used = |n: &u32| *n == layout.job || *n == layout.taken || counts.contains(n);
    let all = layout.names.iter().filter(|(n, _)| used(n));
    let mut names: BTreeMap<u32, String> = all.map(|(n, name)| (*n, name.clone())).collect();
    for k in 1..=dimensions as u32 {
        names.insert(layout.asked() + k, format!("ASK{k}"));
        names.insert(layout.place() + k, format!("AT{k}"));
    }
    names
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
    for (index, d) in dimensions.iter().enumerate() {
        line(format!(
            "({} IS TYPED INTO {} OF OFFSET {} FOR OFFSET {})",
            comment(&d.name),
            comment(&d.column.to_string()),
            entry_offset(dimensions, index, control),
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
    for k in 1..=dimensions.len() as u32 {
        let place = entry_variable(dimensions, k as usize - 1, control);
        line(format!("#{place}=0"));
        line(format!("#{}=#0", layout.asked() + k));
        line(format!("#{}={place}", layout.place() + k));
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

/// The call of dimension `k` (from 1): T offset, D target, S and B window, A register of offset 0, E place of the entry, F steps of the
/// register for one unit of size, Q largest steps, J job, K how many sizes move the register by their mean, M the first of them, C
/// dimension, R steps in one unit, H unit. Every number has its point: without one a control may read least increments.
pub fn call(k: usize, dimensions: &[Dimension], job: u32, control: &Control) -> String {
    let dimension = &dimensions[k - 1];
    let unit = dimension.unit;
    let base = control
        .base_of(dimension.column)
        .expect("looked at before anything is generated");
    let steps = steps_per_unit(dimension);
    let shares = |d: &&Dimension| d.register == dimension.register;
    let first = dimensions.iter().position(|d| shares(&d)).map_or(k, |index| index + 1);
    format!(
        "G65 P{G65_WORKER} T{}. D{} S{} B{} A{base}. E{}. F{} Q{} J{job}. K{}. M{first}. C{k}. R{} H{}.",
        dimension.offset,
        number(in_unit(unit, dimension.target)),
        number(in_unit(unit, dimension.window.0)),
        number(in_unit(unit, dimension.window.1)),
        entry_variable(dimensions, k - 1, control),
        number(steps / dimension.response.size_per_register()),
        number(largest_steps(dimension)),
        dimensions.iter().filter(shares).count(),
        number(steps),
        unit_code(unit),
    )
}

/// O8002: the same for every job.
pub(super) fn worker(layout: &Layout, control: &Control) -> MacroProgram {
    let Layout { job, taken, count, .. } = layout;
    let (asked, place) = (layout.asked(), layout.place());
    let mut out = String::new();
    let mut line = |text: &str| {
        out.push_str(text);
        out.push('\n');
    };
    line(&format!("O{G65_WORKER}(SIZING, CALLED BY G65 BEFORE THE TURRET INDEX)"));
    line("(#27 ENTRY, #28 STEPS, #29 SIZE, #30 REGISTER, #31 BEFORE, #32 CHANGE, #33 COUNT)");
    line(&format!("IF[#{job}EQ#5]GOTO1"));
    line(&format!("#3000={ANOTHER_JOB}(SET-UP OF ANOTHER JOB)"));
    line(&format!("N1 IF[#{taken}EQ0]GOTO2"));
    line(&format!("#28=FIX[#{taken}/100]"));
    line(&format!("#29=#{taken}-#28*100"));
    line("N20 IF[#29GT#28]GOTO21 (CLEAR WHAT IS LEFT OF IT)");
    line(&format!("#[#[{place}+#29]]=0"));
    line(&format!("#[{asked}+#29]=#0"));
    line("#29=#29+1");
    line("GOTO20");
    line(&format!("N21 #{taken}=0"));
    line(&format!("#3000={INTERRUPTED}(LAST ENTRY CUT OFF, MEASURE)"));
    line("N2 #30=#1+#20");
    line(&format!("#[{place}+#3]=#8"));
    line(&format!("#[{asked}+#3]=#0"));
    line("#27=#[#8]");
    line("IF[#27EQ#0]GOTO99 (VACANT IS NOT EQ 0)");
    line("IF[#27EQ0]GOTO99");
    let mut check = String::new();
    unit_check(&mut check, "#11", 4);
    check.lines().for_each(&mut line);
    line("N4 IF[#27GT#19]GOTO5");
    line(&format!("#3000={TOO_SMALL}(DIMENSION ENTERED TOO SMALL)"));
    line("N5 IF[#27LT#2]GOTO6");
    line(&format!("#3000={TOO_BIG}(DIMENSION ENTERED TOO BIG)"));
    line(&format!("N6 #[{asked}+#3]=[#7-#27]*#9"));
    line("IF[#3LT[#13+#6-1]]GOTO99 (THE LAST SIZE OF THE REGISTER DECIDES)");
    line("#28=0");
    line("#29=#13");
    line("N8 IF[#29GT#3]GOTO9");
    line(&format!("IF[#[{asked}+#29]EQ#0]GOTO99 (ANOTHER IS NOT ENTERED YET)"));
    line(&format!("#28=#28+#[{asked}+#29]"));
    line("#29=#29+1");
    line("GOTO8");
    line("N9 #28=ROUND[ROUND[#28/#6*1000]/1000] (THE MEAN, NEVER THE SUM)");
    line("IF[ABS[#28]LE#17]GOTO7");
    line(&format!("#3000={STEP_TOO_LARGE}(STEP TOO LARGE, ASK SETTER)"));
    line("N7 G53 (WAIT UNTIL ALL MOVES ARE DONE)");
    line(&format!("#{taken}=#3*100+#13"));
    line("#29=#13");
    line("N10 IF[#29GT#3]GOTO11");
    line(&format!("#[#[{place}+#29]]=0 (TAKEN, BEFORE THE OFFSET IS WRITTEN)"));
    line(&format!("#[{asked}+#29]=#0"));
    line(&format!("#33=#[{count}+#29]+1"));
    line(&format!("#[{count}+#29]=#33"));
    line("#29=#29+1");
    line("GOTO10");
    line("N11 #31=#[#30]");
    line("#32=#28/#18");
    line("#[#30]=#31+#32");
    line(&format!("#{taken}=0"));
    if control.prints {
        line("POPEN");
        line(&printed(&format!("#{job}"), "#3", "OFS#20", "#27", "#31", "#32", "#33"));
        line("PCLOS");
    }
    line("N99 M99");
    MacroProgram {
        number: G65_WORKER,
        text: out,
    }
}
