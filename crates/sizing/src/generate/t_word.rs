//! Named variables and the macro that every T word calls.

use super::layout::Layout;
use super::{
    ANOTHER_JOB, INTERRUPTED, MacroProgram, STEP_TOO_LARGE, SetupEnd, T_WORD_MACRO, T_WORD_WORKER, TOO_BIG, TOO_SMALL, comment,
    in_unit, largest_steps, number, printed, steps_per_unit, unit_check, unit_code,
};
use crate::control::Control;
use crate::{Dimension, Job};
use std::fmt::Write;

/// The set-up program of a job: run once before it.
pub(super) fn setup(job: &Job, dimensions: &[Dimension], layout: &Layout, control: &Control, end: SetupEnd) -> MacroProgram {
    let mut out = String::new();
    let mut line = |text: String| {
        out.push_str(&text);
        out.push('\n');
    };
    let (table, unit) = (&layout.table, job.unit);
    line(format!("O{:04}(SIZING SET-UP {})", job.number, comment(&job.name)));
    line("(RUN ONCE BEFORE THE JOB. IT CLEARS ENTRIES AND COUNTERS)".into());
    for (k, d) in (1..).zip(dimensions) {
        line(format!(
            "({} MEASURED IN #{}, {} OFFSET {})",
            comment(&layout.names[&(layout.entry + k)]),
            layout.entry + k,
            comment(&d.column.to_string()),
            d.offset
        ));
    }
    line(format!(
        "(THE PART PROGRAM SAYS #{}={} AT ITS HEAD)",
        control.job_variable, job.number
    ));
    let mut check = String::new();
    unit_check(&mut check, &unit_code(unit).to_string(), 1);
    check.lines().for_each(|l| line(l.to_owned()));
    line(format!("N1 #{}=#0 (NO JOB WHILE THIS RUNS)", layout.job));
    for (variable, name) in &layout.names {
        line(format!("SETVN {variable}[{name}]"));
    }
    for (k, d) in (1..).zip(dimensions) {
        let gain = steps_per_unit(d) / d.response.size_per_register();
        let register = control.register_of(d).expect("looked at before anything is generated");
        let key = control.called_by(d);
        line(format!("({})", comment(&d.name)));
        line(format!("#{}=#0", layout.entry + k));
        line(format!("#{}={key}", table.offset + k));
        line(format!("#{}={}", table.target + k, number(in_unit(unit, d.target))));
        line(format!("#{}={}", table.low + k, number(in_unit(unit, d.window.0))));
        line(format!("#{}={}", table.high + k, number(in_unit(unit, d.window.1))));
        line(format!("#{}={}", table.gain + k, number(gain)));
        line(format!("#{}={}", table.largest + k, number(largest_steps(d))));
        line(format!("#{}={}", table.base + k, i64::from(register) - i64::from(key)));
        line(format!("#{}=0", layout.count + k));
    }
    line(format!("#{}={}", table.dimensions, dimensions.len()));
    line(format!(
        "#{}={}",
        table.steps_per_unit,
        number(steps_per_unit(&dimensions[0]))
    ));
    line(format!("#{}={}", table.unit, unit_code(unit)));
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

/// O9000 and its worker: the same for every job of a control.
pub(super) fn macros(layout: &Layout, control: &Control) -> Vec<MacroProgram> {
    // A T word calls O9000 as a subprogram, with the local variables of the program: G65 gives the worker its own.
    let index = format!(
        "O{T_WORD_MACRO}(SIZING, CALLED BY EVERY T WORD, PARAMETER 6001.5)\nG65 P{T_WORD_WORKER} T#149\nT#149 (INDEX, ONCE)\nM99\n"
    );
    let Layout {
        job,
        entry,
        taken,
        count,
        table,
        ..
    } = layout;
    let mut out = String::new();
    let mut line = |text: &str| {
        out.push_str(text);
        out.push('\n');
    };
    line(&format!("O{T_WORD_WORKER}(SIZING WORKER, CALLED BY O{T_WORD_MACRO})"));
    line("(#1 OFFSET OR TOOL, #2 DIMENSION, #3 ENTRY, #4 STEPS, #5 REGISTER, #6 BEFORE, #7 CHANGE)");
    line("(#8 COUNT, #9 SIZE OF THE REGISTER, #10 HOW MANY, #11 ONE IS NOT ENTERED)");
    line(match control.mill {
        true => "#1=ROUND[#20] (TOOL)",
        false => "#1=ROUND[#20]-FIX[[ROUND[#20]+0.5]/100]*100 (LAST TWO DIGITS)",
    });
    // The lines that pass by a size of another register than that of the dimension in `of`.
    let others = |of: &str, next: u32| {
        let (offset, base) = (table.offset, table.base);
        format!("IF[#[{offset}+#9]NE#[{offset}+{of}]]GOTO{next}\nIF[#[{base}+#9]NE#[{base}+{of}]]GOTO{next}")
    };
    line("IF[#1EQ0]GOTO99");
    line(&format!("IF[#{}EQ#0]GOTO99 (NO SET-UP)", table.dimensions));
    line(&format!("IF[#{taken}EQ0]GOTO1"));
    line("#9=1");
    line(&format!("N20 IF[#9GT#{}]GOTO22 (CLEAR WHAT IS LEFT OF IT)", table.dimensions));
    line(&others(&format!("#{taken}"), 21));
    line(&format!("#[{entry}+#9]=#0"));
    line("N21 #9=#9+1");
    line("GOTO20");
    line(&format!("N22 #{taken}=0"));
    line(&format!("#3000={INTERRUPTED}(LAST ENTRY CUT OFF, MEASURE)"));
    line("N1 #2=1");
    line(&format!("N2 IF[#2GT#{}]GOTO99", table.dimensions));
    line(&format!("IF[#[{}+#2]NE#1]GOTO15", table.offset));
    line(&format!("#3=#[{entry}+#2]"));
    line("IF[#3EQ#0]GOTO15 (VACANT IS NOT EQ 0)");
    line("IF[#3EQ0]GOTO15");
    line(&format!("IF[#{}EQ#{job}]GOTO3", control.job_variable));
    line(&format!("#3000={ANOTHER_JOB}(SET-UP OF ANOTHER JOB)"));
    let mut check = String::new();
    unit_check(&mut check, &format!("#{}", table.unit), 4);
    line(&format!("N3 {}", check.trim_end()));
    line("N4 #4=0");
    line("#10=0");
    line("#11=0");
    line("#9=1");
    line(&format!("N8 IF[#9GT#{}]GOTO12", table.dimensions));
    line(&others("#2", 11));
    line("#10=#10+1");
    line(&format!("#3=#[{entry}+#9]"));
    line("IF[#3EQ#0]GOTO10");
    line("IF[#3EQ0]GOTO10");
    line(&format!("IF[#3GT#[{}+#9]]GOTO5", table.low));
    line(&format!("#3000={TOO_SMALL}(DIMENSION ENTERED TOO SMALL)"));
    line(&format!("N5 IF[#3LT#[{}+#9]]GOTO6", table.high));
    line(&format!("#3000={TOO_BIG}(DIMENSION ENTERED TOO BIG)"));
    line(&format!("N6 #4=#4+[#[{}+#9]-#3]*#[{}+#9]", table.target, table.gain));
    line("GOTO11");
    line("N10 #11=1");
    line("N11 #9=#9+1");
    line("GOTO8");
    line("N12 IF[#11EQ1]GOTO15 (ANOTHER SIZE OF THE REGISTER IS NOT ENTERED YET)");
    line("#4=ROUND[ROUND[#4/#10*1000]/1000] (THE MEAN, NEVER THE SUM)");
    line(&format!("IF[ABS[#4]LE#[{}+#2]]GOTO7", table.largest));
    line(&format!("#3000={STEP_TOO_LARGE}(STEP TOO LARGE, ASK SETTER)"));
    line("N7 G53 (WAIT UNTIL ALL MOVES ARE DONE)");
    line(&format!("#3=#[{entry}+#2]"));
    line(&format!("#{taken}=#2"));
    line("#9=1");
    line(&format!("N13 IF[#9GT#{}]GOTO16", table.dimensions));
    line(&others("#2", 14));
    line(&format!("#[{entry}+#9]=#0 (TAKEN, BEFORE THE OFFSET IS WRITTEN)"));
    line(&format!("#[{count}+#9]=#[{count}+#9]+1"));
    line("N14 #9=#9+1");
    line("GOTO13");
    line(&format!("N16 #5=#[{}+#2]+#1", table.base));
    line("#6=#[#5]");
    line(&format!("#7=#4/#{}", table.steps_per_unit));
    line("#[#5]=#6+#7");
    line(&format!("#{taken}=0"));
    if control.prints {
        line(&format!("#8=#[{count}+#2]"));
        line("POPEN");
        let called = if control.mill { "TOOL#1" } else { "OFS#1" };
        line(&printed(&format!("#{job}"), "#2", called, "#3", "#6", "#7", "#8"));
        line("PCLOS");
    }
    line("N15 #2=#2+1");
    line("GOTO2");
    line("N99 M99");
    vec![
        MacroProgram {
            number: T_WORD_MACRO,
            text: index,
        },
        MacroProgram {
            number: T_WORD_WORKER,
            text: out,
        },
    ]
}

/// The line at the head of a part program that says which job it is.
pub fn job_line(control: &Control, job: u32) -> String {
    let mut out = String::new();
    let _ = write!(out, "#{}={job} (JOB, FOR SIZING)", control.job_variable);
    out
}
