//! How fast STEP files are indexed and STEP-NC files become their tree, and in how much memory.
//!
//! `cargo bench -p bench --bench step`. The file of 100 MB is made here: workingsteps with the tool, the technology and the properties
//! that CAM systems write, and toolpaths of a few hundred points. Each row runs in a process of its own, because the highest resident
//! memory is one of the figures. `ruststep` parses the first part of the same file; it keeps every parameter as a value, which is what
//! it is for, and needs more memory than a part. A budget that is missed makes the exit code 1.

#![allow(
    clippy::disallowed_methods,
    clippy::disallowed_types,
    reason = "a bench reads the clock, writes files and runs itself"
)]

use std::fmt::Write as _;
use std::path::Path;
use std::process::{Command, ExitCode};
use std::time::Instant;

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

/// Bytes of the large file.
const LARGE: usize = 100_000_000;
/// Bytes of the part that the peer parses too.
const PART: usize = 10_000_000;
/// Runs of each row; the fastest counts, because other work on the machine only adds.
const RUNS: usize = 5;

/// What a row measured.
#[derive(Clone, Copy)]
struct Figures {
    seconds: f64,
    /// Highest resident memory of the process, bytes.
    resident: f64,
}

/// STEP-NC text of about `length` bytes: as many workingsteps as fit.
fn program(length: usize) -> String {
    let mut text = String::with_capacity(length + 100_000);
    text.push_str(
        "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION(('bench'),'2;1');\nFILE_NAME('bench.stpnc','2026-11-22T00:00:00Z',(''),(''),'','','');\n\
         FILE_SCHEMA(('MODEL_BASED_INTEGRATED_MANUFACTURING_SCHEMA'));\nENDSEC;\nDATA;\n\
         #1=(LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.));\n#2=(NAMED_UNIT(*) SI_UNIT($,.SECOND.) TIME_UNIT());\n\
         #3=DERIVED_UNIT_ELEMENT(#1,1.);\n#4=DERIVED_UNIT_ELEMENT(#2,-1.);\n#5=DERIVED_UNIT((#3,#4));\n\
         #6=DIMENSIONAL_EXPONENTS(0.,0.,0.,0.,0.,0.,0.);\n#7=CONTEXT_DEPENDENT_UNIT(#6,'revolution');\n#8=DERIVED_UNIT_ELEMENT(#7,1.);\n\
         #9=DERIVED_UNIT((#8,#4));\n\
         #10=(GEOMETRIC_REPRESENTATION_CONTEXT(3) GLOBAL_UNIT_ASSIGNED_CONTEXT((#1)) REPRESENTATION_CONTEXT('','3D'));\n\
         #11=REPRESENTATION_CONTEXT('','units not necessary');\n#12=MACHINING_WORKPLAN('main','','','');\n\
         #13=ACTION_RESOURCE_TYPE('milling cutting tool');\n",
    );
    let mut id = 100u64;
    let mut next = || {
        id += 1;
        id
    };
    let mut operations = Vec::new();
    let mut step = 0u32;
    while text.len() < length {
        step += 1;
        let (ws, op, tech, link, of) = (next(), next(), next(), next(), next());
        let mut line = |body: std::fmt::Arguments| {
            let _ = writeln!(text, "{body};");
        };
        line(format_args!("#{ws}=MACHINING_WORKINGSTEP('WS {step}','machining','','')"));
        line(format_args!(
            "#{op}=FREEFORM_MILLING_OPERATION('OP {step}','finishing','','')"
        ));
        line(format_args!("#{tech}=MACHINING_TECHNOLOGY('','milling','','')"));
        line(format_args!(
            "#{link}=MACHINING_PROCESS_SEQUENCE_RELATIONSHIP('','',#12,#{ws},{step}.)"
        ));
        line(format_args!(
            "#{of}=MACHINING_OPERATION_RELATIONSHIP('','machining',#{ws},#{op})"
        ));
        line(format_args!(
            "#{}=MACHINING_TECHNOLOGY_RELATIONSHIP('','',#{op},#{tech})",
            next()
        ));
        for (name, entity, item, unit, value) in [
            ("feedrate", "MACHINING_FEED_SPEED_REPRESENTATION", "feed speed", 5, "12.5"),
            (
                "spindle",
                "MACHINING_SPINDLE_SPEED_REPRESENTATION",
                "rotational speed",
                9,
                "-100.",
            ),
        ] {
            let (p, l, r, i) = (next(), next(), next(), next());
            line(format_args!("#{p}=ACTION_PROPERTY('{name}','',#{tech})"));
            line(format_args!("#{l}=ACTION_PROPERTY_REPRESENTATION('','',#{p},#{r})"));
            line(format_args!("#{r}={entity}('{item}',(#{i}),#11)"));
            line(format_args!(
                "#{i}=MEASURE_REPRESENTATION_ITEM('{item}',NUMERIC_MEASURE({value}),#{unit})"
            ));
        }
        operations.push(op);
        for path in 1..=4u32 {
            let (tp, order, p, l, r, curve) = (next(), next(), next(), next(), next(), next());
            line(format_args!(
                "#{tp}=MACHINING_TOOLPATH('path {path}','cutter location trajectory','','')"
            ));
            line(format_args!(
                "#{order}=MACHINING_TOOLPATH_SEQUENCE_RELATIONSHIP('','',#{op},#{tp},{path}.)"
            ));
            line(format_args!("#{p}=ACTION_PROPERTY('basic curve','',#{tp})"));
            line(format_args!("#{l}=ACTION_PROPERTY_REPRESENTATION('','',#{p},#{r})"));
            line(format_args!("#{r}=REPRESENTATION('',(#{curve}),#10)"));
            let points: Vec<u64> = (0..300).map(|_| next()).collect();
            let list: Vec<String> = points.iter().map(|point| format!("#{point}")).collect();
            line(format_args!("#{curve}=POLYLINE('',({}))", list.join(",")));
            for (n, point) in points.iter().enumerate() {
                let (x, y) = (0.1 * n as f64, f64::from(step % 1000) * 0.25);
                let z = 0.0137 * ((n * 7 + step as usize * 3) % 911) as f64;
                line(format_args!("#{point}=CARTESIAN_POINT('',({x:.4},{y:.4},{z:.4}))"));
            }
        }
    }
    let tool = next();
    let users: Vec<String> = operations.iter().map(|operation| format!("#{operation}")).collect();
    let _ = writeln!(text, "#{tool}=MACHINING_TOOL('1','endmill',({}),#13);", users.join(","));
    text.push_str("ENDSEC;\nEND-ISO-10303-21;\n");
    text
}

/// One row in this process; the answer goes to standard output.
fn row(name: &str, path: &Path) -> Outcome<()> {
    let bytes = std::fs::read(path)?;
    let length = bytes.len();
    let (seconds, said) = match name {
        "index" => {
            let started = Instant::now();
            let file = part21::File::read(bytes)?;
            let seconds = started.elapsed().as_secs_f64();
            assert!(file.problems().is_empty() && file.inverse(12).len() > 10);
            (seconds, file.len())
        }
        "tree" => {
            let started = Instant::now();
            let program = stepnc::Program::read("bench.stpnc", bytes)?;
            let tree = stepnc::inspect::inspect(&program);
            let seconds = started.elapsed().as_secs_f64();
            assert!(
                tree.problems.iter().all(|problem| problem.code == "no-project"),
                "{:?}",
                tree.problems
            );
            (seconds, tree.summary.toolpaths as usize)
        }
        "ruststep" => {
            let text = String::from_utf8(bytes)?;
            let started = Instant::now();
            let exchange = ruststep::parser::parse(&text)?;
            (started.elapsed().as_secs_f64(), exchange.data[0].entities.len())
        }
        _ => return Err(format!("there is no row {name}").into()),
    };
    println!("{seconds} {} {said} {length}", peak_resident()?);
    Ok(())
}

/// Highest resident memory of this process, bytes.
fn peak_resident() -> Outcome<f64> {
    let status = std::fs::read_to_string("/proc/self/status")?;
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:"))
        .ok_or("no VmHWM")?;
    let kib: f64 = line.split_whitespace().next().unwrap_or_default().parse()?;
    Ok(kib * 1024.0)
}

/// The fastest of some runs, each in its own process.
fn fastest(name: &str, path: &Path) -> Outcome<Figures> {
    let mut best: Option<Figures> = None;
    for _ in 0..RUNS {
        let output = Command::new(std::env::current_exe()?)
            .arg("row")
            .arg(name)
            .arg(path)
            .output()?;
        let said = String::from_utf8(output.stdout)?;
        let numbers: Vec<f64> = said.split_whitespace().filter_map(|word| word.parse().ok()).collect();
        let [seconds, resident, ..] = numbers[..] else {
            return Err(format!("{name} failed: {}", String::from_utf8_lossy(&output.stderr)).into());
        };
        if best.is_none_or(|best| seconds < best.seconds) {
            best = Some(Figures { seconds, resident });
        }
    }
    best.ok_or_else(|| "no run".into())
}

fn main() -> Outcome<ExitCode> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    if let [first, name, path] = &words[..]
        && first == "row"
    {
        row(name, Path::new(path))?;
        return Ok(ExitCode::SUCCESS);
    }
    let folder = tempfile::tempdir()?;
    let (large, part) = (folder.path().join("large.stpnc"), folder.path().join("part.stpnc"));
    std::fs::write(&large, program(LARGE))?;
    std::fs::write(&part, program(PART))?;
    let size = |path: &Path| std::fs::metadata(path).map(|data| data.len() as f64);
    let (large_size, part_size) = (size(&large)?, size(&part)?);

    println!("| what | budget | measured | |\n|---|---|---|---|");
    let mut kept = true;
    let mut print = |what: &str, budget: &str, measured: String, good: bool| {
        kept &= good;
        println!(
            "| {what} | {budget} | {measured} | {} |",
            if good { "kept" } else { "MISSED" }
        );
    };
    let index = fastest("index", &large)?;
    let rate = large_size / 1e6 / index.seconds;
    print(
        "index with inverse references, 100 MB",
        ">= 150 MB/s",
        format!("{rate:.0} MB/s"),
        rate >= 150.0,
    );
    let share = index.resident / large_size;
    print(
        "its highest resident memory, bytes of the file included",
        "<= 1.5 x",
        format!("{share:.2} x"),
        share <= 1.5,
    );
    let tree = fastest("tree", &large)?;
    print(
        "100 MB of STEP-NC to its tree, lengths of all paths included",
        "< 2 s",
        format!("{:.2} s", tree.seconds),
        tree.seconds < 2.0,
    );
    let tree_share = tree.resident / large_size;
    println!("| its highest resident memory | - | {tree_share:.2} x | |");
    let (ours, theirs) = (fastest("index", &part)?, fastest("ruststep", &part)?);
    println!(
        "| 10 MB: `ruststep` to its tree of values | - | {:.1} MB/s, {:.1} x the file; ours is {:.0} times as fast in {:.0} % of the memory | |",
        part_size / 1e6 / theirs.seconds,
        theirs.resident / part_size,
        theirs.seconds / ours.seconds,
        ours.resident / theirs.resident * 100.0
    );
    Ok(if kept { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
