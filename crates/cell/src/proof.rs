//! The proof that generated macros do what `sizing` says: both run over the same entries, and every difference is told.
//!
//! The macros run on the interpreter that reads all our programs; the law is `sizing::enter`. Held against each other after each entry:
//! the alarm, the register, the entry that is cleared, the counter, the tool in the turret, and every other variable that the set-up
//! wrote, which must be as it was.

mod entries;

use entries::{by_law, grid, mean_by_law, near_target};
use gcode::interpretation::{AlarmKind, MachineKind};
use gcode::{Interpretation, Setup, interpret};
use serde_json::json;
use sizing::control::Control;
use sizing::generate::{self, Generated, Method, call, t_word};
use sizing::{Correction, Dimension, Entry, EntryError, Others, Present, Role, Unit};
use std::collections::{BTreeMap, BTreeSet};
use units::Timestamp;

/// What a proof came to.
#[derive(Clone, Debug, PartialEq)]
pub struct Proof {
    /// Entries that were tried, by dimension.
    pub entries: Vec<(String, usize)>,
    /// How they ended: applied, refused by which alarm, nothing entered, nothing to change.
    pub ended: BTreeMap<String, usize>,
    /// The set-up, a program of another job, a power loss between any two blocks.
    pub situations: Vec<String>,
    /// What was not as it should be; at most the first twenty.
    pub differences: Vec<String>,
    /// How many there were.
    pub different: usize,
}

/// A run of the generated programs is started with these.
type Variables = BTreeMap<u32, Option<f64>>;

/// Holds the generated programs against the law with at least `least` entries, spread evenly over the dimensions.
pub fn prove(generated: &Generated, control: &Control, least: usize) -> Proof {
    let mut proof = Proof {
        entries: Vec::new(),
        ended: BTreeMap::new(),
        situations: Vec::new(),
        differences: Vec::new(),
        different: 0,
    };
    let bench = Bench { generated, control };
    let Some(ready) = bench.set_up(&mut proof) else {
        return proof;
    };
    let each = least.div_ceil(generated.dimensions.len());
    for (k, dimension) in (1..).zip(&generated.dimensions) {
        let entries = grid(dimension, each, generated.method);
        proof.entries.push((dimension.name.clone(), entries.len()));
        if dimension.role == Role::Mean {
            continue; // with the others of its register, below
        }
        for (n, typed) in entries.iter().enumerate() {
            // Three states of the register: new, corrected, and corrected the other way.
            let before = [0.0, -0.012, 0.007][n % 3];
            bench.one(&mut proof, &ready, k, dimension, typed.as_deref(), before);
        }
    }
    for first in 0..generated.dimensions.len() {
        bench.mean(&mut proof, &ready, first);
    }
    bench.another_job(&mut proof, &ready);
    bench.power_loss(&mut proof, &ready);
    proof
}

impl Proof {
    /// True when nothing differs.
    pub fn holds(&self) -> bool {
        self.different == 0
    }
    /// How many entries were tried.
    pub fn total(&self) -> usize {
        self.entries.iter().map(|(_, n)| n).sum()
    }
    /// For people: what is printed and written beside the programs.
    pub fn text(&self) -> String {
        let mut out = format!(
            "Proof by simulation: {} entries on the macro interpreter against the law of sizing, {} differences.\n",
            self.total(),
            self.different
        );
        for (name, n) in &self.entries {
            out.push_str(&format!("  {name}: {n} entries\n"));
        }
        for (how, n) in &self.ended {
            out.push_str(&format!("  {n} {how}\n"));
        }
        for situation in &self.situations {
            out.push_str(&format!("  {situation}\n"));
        }
        for difference in &self.differences {
            out.push_str(&format!("  DIFFERENCE: {difference}\n"));
        }
        out
    }
    /// For programs.
    pub fn json(&self) -> serde_json::Value {
        json!({
            "entries": self.total(),
            "dimensions": self.entries.iter().map(|(name, n)| json!({ "name": name, "entries": n })).collect::<Vec<_>>(),
            "ended": self.ended,
            "situations": self.situations,
            "different": self.different,
            "differences": self.differences,
        })
    }
    fn differs(&mut self, what: String) {
        self.different += 1;
        if self.differences.len() < 20 {
            self.differences.push(what);
        }
    }
    fn count(&mut self, how: &str) {
        *self.ended.entry(how.to_owned()).or_default() += 1;
    }
}

/// What the law says of an entry.
enum Expected {
    Nothing,
    Change(f64),
    Alarm(u32),
}

struct Bench<'a> {
    generated: &'a Generated,
    control: &'a Control,
}

impl Bench<'_> {
    fn setup(&self, vars: Variables) -> Setup {
        Setup {
            machine: match self.control.mill {
                true => MachineKind::Mill,
                false => MachineKind::Lathe,
            },
            units: match self.generated.unit {
                Unit::Mm => gcode::interpretation::Unit::Mm,
                Unit::Inch => gcode::interpretation::Unit::Inch,
            },
            params: {
                let own = self.control.parameters.iter();
                let mut all: BTreeMap<String, f64> = own.map(|(n, v)| (n.clone(), *v as f64)).collect();
                all.insert(
                    "6001.5".to_owned(),
                    f64::from(u8::from(self.generated.method == Method::TWord)),
                );
                all
            },
            vars,
            control: Some(self.control.dialect.clone()),
            ..Setup::default()
        }
    }

    /// Runs the set-up program; the variables that it leaves.
    fn set_up(&self, proof: &mut Proof) -> Option<Variables> {
        let generated = self.generated;
        let registers = self.registers();
        let text = generated.setup.text.replace("M99", "M30");
        let run = interpret(&text, &self.setup(registers.iter().map(|r| (*r, Some(0.0))).collect()));
        if let Some(alarm) = &run.alarm {
            let fault = run
                .fault
                .as_ref()
                .map(|f| format!("{} (line {})", f.text, f.line))
                .unwrap_or_default();
            proof.differs(format!("the set-up program stops with alarm {}: {fault}", alarm.number));
            return None;
        }
        let layout = &generated.layout;
        if run.vars.get(&layout.job).copied().flatten() != Some(f64::from(generated.job)) {
            proof.differs(format!(
                "the set-up program does not leave job {} in #{}",
                generated.job, layout.job
            ));
        }
        if run.names != layout.names {
            proof.differs("the set-up program does not give the names of its variables".to_owned());
        }
        let ours = |n: &u32| (self.control.kept[0]..=self.control.kept[1]).contains(n) || registers.contains(n);
        let ready: Variables = run.vars.into_iter().filter(|(n, _)| ours(n)).collect();
        let outside: Vec<u32> = ready
            .keys()
            .copied()
            .filter(|n| !registers.contains(n) && !layout.names.contains_key(n))
            .collect();
        if !outside.is_empty() {
            proof.differs(format!(
                "the set-up program writes variables that are not its own: {outside:?}"
            ));
        }
        proof.situations.push(format!(
            "the set-up program runs to its end and names {} variables",
            layout.names.len()
        ));
        Some(ready)
    }

    /// The offset registers that a run may touch, and those that it must not: all columns of every offset in the job.
    fn registers(&self) -> BTreeSet<u32> {
        let mut all = BTreeSet::new();
        let (control, dimensions) = (self.control, &self.generated.dimensions);
        for (index, dimension) in dimensions.iter().enumerate() {
            let bases = [control.wear_x, control.wear_y, control.wear_z, control.wear_radius];
            for base in bases.into_iter().flatten() {
                all.insert(base + dimension.offset);
                if self.generated.method == Method::G65 {
                    all.insert(base + call::entry_offset(dimensions, index, control));
                }
            }
        }
        all
    }

    fn entry_variable(&self, k: u32) -> u32 {
        match self.generated.method {
            Method::TWord => self.generated.layout.entry + k,
            Method::G65 => call::entry_variable(&self.generated.dimensions, k as usize - 1, self.control),
        }
    }

    fn register(&self, dimension: &Dimension) -> u32 {
        self.control.register_of(dimension).unwrap_or_default()
    }

    /// The T word that calls for a dimension. On a lathe its station is another than the offset's number, where two digits allow it: the
    /// offset is what counts.
    fn tool(&self, dimension: &Dimension) -> u32 {
        match self.control.mill {
            true => dimension.tool.0,
            false => (dimension.tool.0 + 1) % 100 * 100 + dimension.offset,
        }
    }

    /// Variables that a run may leave as it likes.
    fn is_scratch(&self, number: u32) -> bool {
        let (layout, count) = (&self.generated.layout, self.generated.dimensions.len() as u32);
        let within = |field: u32| (field + 1..=field + count).contains(&number);
        self.generated.method == Method::G65 && (within(layout.asked()) || within(layout.place()))
    }

    /// A part program that does nothing but call the tool of a dimension, with the macros behind it.
    fn program(&self, dimension: &Dimension, job: u32) -> String {
        let tool = format!("T{:04}", self.tool(dimension));
        let mut text = String::from("O7999\n");
        match self.generated.method {
            Method::TWord => text.push_str(&t_word::job_line(self.control, job)),
            Method::G65 => {
                let all = &self.generated.dimensions;
                let called = |d: &Dimension| self.control.called_by(d) == self.control.called_by(dimension);
                for (k, _) in (1..).zip(all).filter(|(_, d)| called(d)) {
                    text.push_str(&call::call(k, all, job, self.control));
                    text.push('\n');
                }
            }
        }
        text.push_str(&format!("\n{tool}\nM30\n"));
        self.generated.macros.iter().for_each(|m| text.push_str(&m.text));
        text
    }

    fn run(&self, dimension: &Dimension, job: u32, vars: Variables) -> Interpretation {
        interpret(&self.program(dimension, job), &self.setup(vars))
    }

    /// One entry, on the macros and by the law.
    fn one(&self, proof: &mut Proof, ready: &Variables, k: u32, dimension: &Dimension, typed: Option<&str>, before: f64) {
        let (entry, register) = (self.entry_variable(k), self.register(dimension));
        let mut vars = ready.clone();
        vars.insert(register, Some(before));
        let value = typed.map(|t| t.parse::<f64>().expect("the grid holds numbers"));
        vars.insert(entry, value);
        let expected = by_law(dimension, typed, before);
        let run = self.run(dimension, self.generated.job, vars.clone());
        let what = |problem: String| {
            format!(
                "{} entered as {} with {before} in the register: {problem}",
                dimension.name,
                typed.unwrap_or("nothing")
            )
        };
        let alarm = run.alarm.as_ref().map(|a| (a.kind, a.number));
        let change = match expected {
            Expected::Alarm(number) => {
                proof.count(&format!("refused by alarm {number}"));
                if alarm != Some((AlarmKind::Macro, number)) {
                    proof.differs(what(format!("alarm {number} is due, {} came", told(&run))));
                    return;
                }
                None
            }
            Expected::Nothing | Expected::Change(_) if alarm.is_some() => {
                proof.differs(what(format!("no alarm is due, {} came", told(&run))));
                return;
            }
            Expected::Nothing => {
                proof.count("with nothing entered");
                None
            }
            Expected::Change(change) => {
                proof.count(if change == 0.0 { "on target" } else { "applied" });
                Some(change)
            }
        };
        let turret = self.tool(dimension);
        if alarm.is_none() && run.tool != Some(turret) {
            proof.differs(what(format!("the turret was told {:?}, not {turret}", run.tool)));
        }
        // What must stand there now: as it was, but for what a used entry changes.
        let mut after = vars;
        if let Some(change) = change {
            after.insert(register, Some(before + change));
            after.insert(entry, (self.generated.method == Method::G65).then_some(0.0));
            let count = after.entry(self.generated.layout.count + k).or_default();
            *count = Some(count.unwrap_or(0.0) + 1.0);
        }
        self.compare(proof, dimension, &run, &after, &what);
    }

    /// Every variable of the set-up and every register, as they must stand.
    fn compare(
        &self,
        proof: &mut Proof,
        dimension: &Dimension,
        run: &Interpretation,
        after: &Variables,
        what: &dyn Fn(String) -> String,
    ) {
        let step = 1.0 / generate::steps_per_unit(dimension);
        for (number, value) in after.iter().filter(|(n, _)| !self.is_scratch(**n)) {
            let found = run.vars.get(number).copied().flatten();
            let same = match (value, found) {
                (Some(a), Some(b)) => (a - b).abs() < step * 1e-3,
                (a, b) => a.is_none() == b.is_none(),
            };
            if !same {
                proof.differs(what(format!("#{number} is {}, not {}", shown(found), shown(*value))));
            }
        }
    }

    /// Sizes that move one register by their mean: all their entries together, some missing, some refused. Told once, at the first.
    fn mean(&self, proof: &mut Proof, ready: &Variables, first: usize) {
        let all = &self.generated.dimensions;
        let dimension = &all[first];
        let mates: Vec<usize> = (0..all.len()).filter(|k| all[*k].register == dimension.register).collect();
        if dimension.role != Role::Mean || mates[0] != first {
            return;
        }
        let least = proof
            .entries
            .iter()
            .filter(|(name, _)| mates.iter().any(|k| all[*k].name == *name));
        let least: usize = least.map(|(_, n)| n).sum();
        let method = self.generated.method;
        let grids: Vec<_> = mates.iter().map(|k| grid(&all[*k], least, method)).collect();
        let near: Vec<_> = mates.iter().map(|k| near_target(&all[*k], method)).collect();
        for n in 0..least {
            // One goes through everything, the others stay where they can be used; now and then all go through everything. Strides that
            // share no factor bring each value together with each other.
            let typed: Vec<Option<&str>> = (0..mates.len())
                .map(|m| match n % 10 == 9 || n % mates.len() == m {
                    true => grids[m][n * [1, 13, 29, 31][m % 4] % grids[m].len()].as_deref(),
                    false => near[m][(n * 7 + m) % near[m].len()].as_deref(),
                })
                .collect();
            self.one_mean(proof, ready, &mates, &typed, [0.0, -0.012, 0.007][n % 3]);
        }
        let names: Vec<&str> = mates.iter().map(|k| all[*k].name.as_str()).collect();
        proof.situations.push(format!(
            "{} move one register by their mean: it waits until all are entered, and moves once",
            names.join(" and ")
        ));
    }

    /// Entries of sizes that share a register, on the macros and by the law.
    fn one_mean(&self, proof: &mut Proof, ready: &Variables, mates: &[usize], typed: &[Option<&str>], before: f64) {
        let all = &self.generated.dimensions;
        let dimension = &all[mates[0]];
        let register = self.register(dimension);
        let mut vars = ready.clone();
        vars.insert(register, Some(before));
        for (k, text) in mates.iter().zip(typed) {
            let value = text.map(|t| t.parse::<f64>().expect("the grid holds numbers"));
            vars.insert(self.entry_variable(*k as u32 + 1), value);
        }
        let run = self.run(dimension, self.generated.job, vars.clone());
        let what = |problem: String| {
            let entered: Vec<String> = mates
                .iter()
                .zip(typed)
                .map(|(k, t)| format!("{} as {}", all[*k].name, t.unwrap_or("nothing")))
                .collect();
            format!("{} with {before} in the register: {problem}", entered.join(", "))
        };
        let expected = mean_by_law(&mates.iter().map(|k| &all[*k]).collect::<Vec<_>>(), typed, before);
        let alarm = run.alarm.as_ref().map(|a| (a.kind, a.number));
        let mut after = vars;
        match expected {
            Expected::Alarm(number) => {
                proof.count(&format!("refused by alarm {number}"));
                if alarm != Some((AlarmKind::Macro, number)) {
                    proof.differs(what(format!("alarm {number} is due, {} came", told(&run))));
                    return;
                }
            }
            Expected::Nothing | Expected::Change(_) if alarm.is_some() => {
                proof.differs(what(format!("no alarm is due, {} came", told(&run))));
                return;
            }
            Expected::Nothing => proof.count("waiting for the other size of the register"),
            Expected::Change(change) => {
                proof.count(if change == 0.0 { "on target" } else { "applied" });
                after.insert(register, Some(before + change));
                for k in mates {
                    let k = *k as u32 + 1;
                    after.insert(self.entry_variable(k), (self.generated.method == Method::G65).then_some(0.0));
                    let count = after.entry(self.generated.layout.count + k).or_default();
                    *count = Some(count.unwrap_or(0.0) + 1.0);
                }
            }
        }
        let turret = self.tool(dimension);
        if alarm.is_none() && run.tool != Some(turret) {
            proof.differs(what(format!("the turret was told {:?}, not {turret}", run.tool)));
        }
        self.compare(proof, dimension, &run, &after, &what);
    }

    /// A part program that is not of the job, or does not say of which, with an entry waiting.
    fn another_job(&self, proof: &mut Proof, ready: &Variables) {
        let other = if self.generated.job == 1 { 2 } else { 1 };
        for (k, dimension) in (1..).zip(&self.generated.dimensions) {
            let mut vars = ready.clone();
            let (entry, register) = (self.entry_variable(k), self.register(dimension));
            vars.insert(entry, Some(generate::in_unit(dimension.unit, dimension.target)));
            let run = self.run(dimension, other, vars);
            let alarm = run.alarm.as_ref().map(|a| a.number);
            if alarm != Some(generate::ANOTHER_JOB) || run.vars.get(&register).copied().flatten() != Some(0.0) {
                proof.differs(format!(
                    "{}: a program of job {other} is not stopped, {} came",
                    dimension.name,
                    told(&run)
                ));
            }
        }
        proof.situations.push(format!(
            "a program of another job stops with alarm {} and changes nothing",
            generate::ANOTHER_JOB
        ));
    }

    /// The power goes behind each block of the macro in turn; then the program is started again.
    fn power_loss(&self, proof: &mut Proof, ready: &Variables) {
        let mut points = 0;
        for (k, dimension) in (1..).zip(&self.generated.dimensions) {
            let register = self.register(dimension);
            let mut vars = ready.clone();
            for (m, mate) in (1..).zip(&self.generated.dimensions) {
                if m == k || dimension.role == Role::Mean && mate.register == dimension.register {
                    let size = mate.target + mate.increment * (3.0 * mate.response.size_per_register());
                    vars.insert(self.entry_variable(m), Some(generate::in_unit(mate.unit, size)));
                }
            }
            let whole = self.program(dimension, self.generated.job);
            let lines: Vec<&str> = whole.lines().collect();
            for cut in 0..lines.len() {
                if lines[cut].starts_with('O') {
                    continue;
                }
                // A control without power does nothing more: here it is a macro alarm with a number of its own.
                let mut text = lines[..cut].join("\n");
                text.push_str("\n#3000=199\n");
                text.push_str(&lines[cut..].join("\n"));
                let lost = interpret(&text, &self.setup(vars.clone()));
                if lost.alarm.as_ref().map(|a| a.number) != Some(199) {
                    continue; // the run does not come past here
                }
                points += 1;
                let mut left: Variables = vars.clone();
                for (number, value) in &mut left {
                    *value = lost.vars.get(number).copied().flatten();
                }
                // After an alarm that tells of it the operator starts again.
                let mut end = interpret(&whole, &self.setup(left.clone()));
                if end.alarm.as_ref().map(|a| a.number) == Some(generate::INTERRUPTED) {
                    for (number, value) in &mut left {
                        *value = end.vars.get(number).copied().flatten();
                    }
                    end = interpret(&whole, &self.setup(left));
                }
                let found = end.vars.get(&register).copied().flatten().unwrap_or(0.0) * generate::steps_per_unit(dimension);
                let once = (found + 3.0).abs() < 1e-3;
                if end.alarm.is_some() || !(once || found.abs() < 1e-3) {
                    proof.differs(format!(
                        "{}: power lost before `{}` leaves the register at {found} steps, {}",
                        dimension.name,
                        lines[cut],
                        told(&end)
                    ));
                }
            }
        }
        if points < 10 {
            proof.differs(format!(
                "only {points} places for a power loss were met: the macros were not run"
            ));
        }
        proof.situations.push(format!(
            "power lost at {points} places of the macros: an entry is applied once or not at all"
        ));
    }
}

fn told(run: &Interpretation) -> String {
    match (&run.alarm, &run.fault) {
        (Some(alarm), Some(fault)) => format!("alarm {} ({}, line {})", alarm.number, fault.text, fault.line),
        (Some(alarm), None) => format!("alarm {}", alarm.number),
        (None, _) => "no alarm".to_owned(),
    }
}

fn shown(value: Option<f64>) -> String {
    value.map_or("vacant".to_owned(), |v| v.to_string())
}
