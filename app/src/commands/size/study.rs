//! `toolmark size study`: a hundred parts on the simulated lathe while the tool wears, with sizing and without.
//!
//! Every part is a whole run of the machine: program, planner, servo loop, plant; the gauge reads what the true tool tip left behind. The
//! sizes go through the same job, checks and ledger as a person's. SIMULATED.

use super::args::StudyArgs;
use crate::cli::Common;
use crate::commands::{Done, print_json};
use crate::failure::{Exit, Failure};
use crate::progress::Progress;
use crate::report::page::frame;
use crate::report::plot::{Plot, Series};
use crate::{clock, files, say, shop};
use cell::sim::measure::{Feature, Gauge, Part};
use cell::{Ended, Fault, Operator, World, WorldConfig};
use gcode::{GcodeProgram, Options};
use ledger::Chain;
use motion::Trajectory;
use plan::{MemorySource, NoOtherFiles};
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};
use serde_json::json;
use sizing::{Dimension, Entry, Job, Present, Unit};
use std::collections::BTreeMap;
use std::fmt::Write;
use store::MachineFile;
use store::machine_file::MachineKind;
use units::{Millimetres, Seconds, Timestamp, ToolNumber};

/// The job of the study, as a person would write it: 39.950 to 39.975, aimed at where scatter leaves room below and wear uses the rest.
const JOB: &str = "name = \"STUDY\"\nnumber = 40\nunit = \"mm\"\n[[dimension]]\nname = \"SEAT D40\"\nkind = \"outside diameter\"\n\
                   nominal = 40\ntolerance = [-0.050, -0.025]\n\
                   target = 39.959\ntool = 3\nevery = 5\n";
/// The diameter that the program asks for; the job's own target.
const PROGRAMMED: f64 = 39.959;
const PROGRAM: &str = "%\nO40(SEAT D40)\nG21 G18 G40 G99\nG50 S3000\nT0303\nG97 S2400 M3\nG0 X42. Z1.\nX39.959\nG1 Z-6. F0.3\nU1.\nG0 Z1.\nM5\nM30\n%\n";
/// Wear on the diameter for each part: it uses up what is left of the tolerance by part 40.
const WEAR_PER_PART: f64 = 0.00055;
/// Scatter of the process from part to part, rms on the diameter: a twentieth of the tolerance. The gauge's comes on top.
const PROCESS_SCATTER: f64 = 0.00125;
const GAUGE_SCATTER: f64 = 0.0005;
/// The part whose size is mistyped, with two digits exchanged.
const MISTYPED: u32 = 45;

/// One part.
struct Made {
    part: u32,
    true_mm: f64,
    measured_mm: Option<f64>,
    offset_mm: f64,
}

/// A hundred parts with one seed.
struct Course {
    seed: u64,
    made: Vec<Made>,
    /// What the mistyped entry was answered.
    refused: Vec<String>,
}

impl Course {
    fn out_of_tolerance(&self, dimension: &Dimension) -> Vec<u32> {
        let out = |m: &&Made| m.true_mm < dimension.low.0 || m.true_mm > dimension.high.0;
        self.made.iter().filter(out).map(|m| m.part).collect()
    }
}

/// Runs the command.
pub(super) fn study(args: &StudyArgs, common: &Common) -> Done {
    let machine = MachineFile::simulated(MachineKind::Lathe);
    let job = Job::parse(JOB, "the study's job", &super::axes_of(&machine)).map_err(|e| Failure::unreadable_diagnostic(&e))?;
    let dimension = &job.dimensions[0];
    assert!(
        (dimension.target.0 - PROGRAMMED).abs() < 1e-9,
        "the study's program is written for the job's target"
    );
    let start = clock::start_time(common.start.as_deref())?;
    let mut progress = Progress::new("studying");
    let mut courses = Vec::new();
    for seed in (common.seed..).take(args.seeds as usize) {
        for sized in [true, false] {
            progress.at(|| format!("seed {seed}, {} sizing", if sized { "with" } else { "without" }));
            courses.push((sized, course(seed, sized, args.parts, &machine, dimension, start)?));
        }
    }
    let with = |sized: bool| courses.iter().filter(move |(s, _)| *s == sized).map(|(_, c)| c);
    let good = with(true).all(|c| c.out_of_tolerance(dimension).is_empty());
    let worn_out = with(false).all(|c| c.out_of_tolerance(dimension).first().is_some_and(|first| *first <= 40));
    let refused = with(true).all(|c| args.parts < MISTYPED || c.refused.len() == 1);
    let verdict = good && (worn_out || args.parts < 40) && refused;

    std::fs::create_dir_all(&args.out).map_err(|e| Failure::writing(&args.out, e))?;
    files::write(&args.out.join("study.html"), page(&courses, dimension, verdict).as_bytes())?;
    let told: Vec<_> = courses
        .iter()
        .map(|(sized, c)| {
            json!({
                "seed": c.seed,
                "sizing": sized,
                "parts": c.made.len(),
                "out_of_tolerance": c.out_of_tolerance(dimension),
                "refused": c.refused,
                "true_mm": c.made.iter().map(|m| m.true_mm).collect::<Vec<_>>(),
                "measured_mm": c.made.iter().map(|m| m.measured_mm).collect::<Vec<_>>(),
                "offset_mm": c.made.iter().map(|m| m.offset_mm).collect::<Vec<_>>(),
            })
        })
        .collect();
    let answer = json!({
        "simulated": true,
        "verdict": if verdict { "good" } else { "out of tolerance" },
        "low_mm": dimension.low.0,
        "high_mm": dimension.high.0,
        "target_mm": dimension.target.0,
        "courses": told,
    });
    let text = serde_json::to_string_pretty(&answer).expect("numbers are JSON");
    files::write(&args.out.join("study.json"), text.as_bytes())?;
    if common.json {
        print_json(&answer)?;
    } else {
        say("SIMULATED: every number comes from a simulated lathe");
        for (sized, c) in &courses {
            say(&course_words(*sized, c, dimension));
        }
        say(&format!("report: {}", args.out.join("study.html").display()));
    }
    Ok(if verdict { Exit::Good } else { Exit::Negative })
}

fn course_words(sized: bool, c: &Course, dimension: &Dimension) -> String {
    let out = c.out_of_tolerance(dimension);
    let sizes = || c.made.iter().map(|m| m.true_mm);
    format!(
        "seed {} {} sizing: {} parts from {:.4} to {:.4} mm, {}{}",
        c.seed,
        if sized { "with" } else { "without" },
        c.made.len(),
        sizes().fold(f64::MAX, f64::min),
        sizes().fold(f64::MIN, f64::max),
        match out.first() {
            None => "all in tolerance".to_owned(),
            Some(first) => format!("{} out of tolerance from part {first} on", out.len()),
        },
        c.refused
            .first()
            .map_or(String::new(), |r| format!("; mistyped entry refused: {r}"))
    )
}

fn course(
    seed: u64,
    sized: bool,
    parts: u32,
    machine: &MachineFile,
    dimension: &Dimension,
    start: Timestamp,
) -> Result<Course, Failure> {
    let mut dice = ChaCha8Rng::seed_from_u64(seed ^ 0x7369_7a65);
    let mut gauge = Gauge::new(Millimetres(GAUGE_SCATTER), seed);
    let mut registers: BTreeMap<String, f64> = BTreeMap::from([(dimension.register.clone(), 0.0)]);
    let mut chain = Chain::default();
    let mut course = Course {
        seed,
        made: Vec::new(),
        refused: Vec::new(),
    };
    for part in 1..=parts {
        let diameter = WEAR_PER_PART * f64::from(part) + PROCESS_SCATTER * bell(&mut dice);
        let at = start + Seconds(60.0 * f64::from(part));
        let piece = turn(machine, &registers, Millimetres(diameter / 2.0), seed, at)?;
        let reading = piece
            .measure(&mut gauge)
            .ok_or_else(|| Failure::negative("error: nothing was cut where the seat is measured"))?;
        let measured = part % dimension.every == 0;
        course.made.push(Made {
            part,
            true_mm: reading.true_value.0,
            measured_mm: measured.then_some(reading.value.0),
            offset_mm: registers[&dimension.register],
        });
        if !(sized && measured) {
            continue;
        }
        let shown = format!("{:.3}", reading.value.0);
        // A person exchanges two digits once, is refused, looks again and types it right.
        let slips = (part == MISTYPED).then(|| exchanged(&shown));
        for (k, text) in slips.into_iter().chain([shown.clone()]).enumerate() {
            let entry = Entry {
                text,
                unit: Unit::Mm,
                who: "the study".to_owned(),
                level: 5,
                remark: String::new(),
                when: at + Seconds(10.0 + 10.0 * k as f64),
            };
            let present = Present {
                register: registers.get(&dimension.register).copied(),
                ..Present::default()
            };
            match sizing::enter(dimension, &entry, &present) {
                Ok(correction) => {
                    if let Some(request) = &correction.request {
                        ledger::change(&mut registers, &mut chain, request)
                            .map_err(|e| Failure::negative(format_args!("error: {e}")))?;
                    }
                }
                Err(refused) => course.refused.push(refused.to_string()),
            }
        }
    }
    Ok(course)
}

/// The same number with its first decimal digit moved to the end: 39.956 becomes 39.569.
fn exchanged(text: &str) -> String {
    let point = text.find('.').map_or(text.len(), |at| at + 1);
    let (head, tail) = text.split_at(point);
    let mut digits: Vec<char> = tail.chars().collect();
    if !digits.is_empty() {
        digits.rotate_left(1);
    }
    head.to_owned() + &digits.into_iter().collect::<String>()
}

/// Sum of twelve uniform numbers less its mean: rms 1.
fn bell(dice: &mut ChaCha8Rng) -> f64 {
    let sum: f64 = (0..12).map(|_| (dice.next_u64() >> 11) as f64 / (1u64 << 53) as f64).sum();
    sum - 6.0
}

/// Turns one part on the simulated lathe with a worn tool.
fn turn(
    machine: &MachineFile,
    registers: &BTreeMap<String, f64>,
    radial: Millimetres,
    seed: u64,
    start: Timestamp,
) -> Result<Part, Failure> {
    let tables = store::registers::tables(machine, registers).map_err(shop::failure)?;
    let faults = vec![Fault::ToolWear {
        tool: ToolNumber(3),
        radial,
    }];
    let profile = gcode::profile::by_name("fanuc-lathe").expect("it is built in");
    let source = Box::new(MemorySource(PROGRAM.as_bytes().to_vec()));
    let position = tables.position;
    let program = GcodeProgram::open(source, "seat.nc", profile, Box::new(NoOtherFiles), tables, Options::default())
        .map_err(|e| Failure::from(&*e))?;
    let config = WorldConfig {
        seed,
        start,
        machine: shop::parameters(machine),
        machine_name: machine.name.clone(),
        position,
        faults: faults.clone(),
        operator: Operator {
            optional_stop: false,
            cycle_start_after: Some(1000),
        },
        ..WorldConfig::default()
    };
    let trajectory = Trajectory::new(Box::new(program), position, shop::limits(machine));
    let mut part = Part::new(
        Feature::TurnedDiameter {
            z_from: Millimetres(-5.0),
            z_to: Millimetres(-1.0),
        },
        &faults,
    );
    let outcome = World::new(config, trajectory)
        .map_err(|e| Failure::unreadable(format_args!("{}: {e}", machine.name)))?
        .run(&mut part);
    match outcome.ended {
        Ended::Completed => Ok(part),
        other => Err(Failure::negative(format_args!("error: the study's part: {}", other.text()))),
    }
}

fn page(courses: &[(bool, Course)], dimension: &Dimension, verdict: bool) -> String {
    let (class, words) = if verdict {
        ("good", "✓ good")
    } else {
        ("bad", "✗ out of tolerance")
    };
    let mut body = format!(
        "<header><h1>SIMULATED study of sizing</h1><p class='verdict {class}'>{words}</p></header>\
         <p class='simulated'>SIMULATED: every number on this page comes from a simulated lathe.</p>\
         <p>A diameter of {:.3} to {:.3} mm, aimed at {:.3}. The tool wears {:.2} µm on the diameter with each part; process and gauge \
         scatter by {:.2} and {:.2} µm rms. Every {}th part is measured and its size entered; one entry is mistyped.</p>",
        dimension.low.0,
        dimension.high.0,
        dimension.target.0,
        WEAR_PER_PART * 1e3,
        PROCESS_SCATTER * 1e3,
        GAUGE_SCATTER * 1e3,
        dimension.every
    );
    let mut seeds: Vec<u64> = courses.iter().map(|(_, c)| c.seed).collect();
    seeds.dedup();
    for seed in seeds {
        let _ = write!(body, "<h2>Seed {seed}</h2><ul class='findings'>");
        let these = || courses.iter().filter(move |(_, c)| c.seed == seed);
        for (sized, c) in these() {
            let _ = write!(
                body,
                "<li>{}</li>",
                crate::report::plot::escape(&course_words(*sized, c, dimension))
            );
        }
        body.push_str("</ul>");
        let line = |sized: bool| -> Vec<[f64; 2]> {
            let course = these().find(|(s, _)| *s == sized);
            course.map_or(Vec::new(), |(_, c)| {
                c.made.iter().map(|m| [f64::from(m.part), m.true_mm]).collect()
            })
        };
        let last = these().map(|(_, c)| c.made.len()).max().unwrap_or(1) as f64;
        let limit = |at: f64| vec![[1.0, at], [last, at]];
        let series = |name, class, pieces| Series {
            name,
            class,
            pieces,
            fits: true,
        };
        let plot = Plot {
            title: "Diameter of each part, with and without sizing",
            x_label: "part",
            y_label: "diameter, mm",
            series: vec![
                series("without sizing", "plan", vec![line(false)]),
                series("with sizing", "run", vec![line(true)]),
                series("limits", "limit", vec![limit(dimension.low.0), limit(dimension.high.0)]),
            ],
            same_scale: false,
            from_zero: false,
        };
        body.push_str(&plot.svg());
    }
    frame("SIMULATED study of sizing", &body)
}
