//! `toolmark size job FILE.stpnc`: a job file proposed from the dimensions and tolerances of a STEP-NC file.

use super::args::JobArgs;
use crate::cli::Common;
use crate::commands::{Done, print_json};
use crate::failure::{Exit, Failure};
use crate::program::{Program, is_part21};
use crate::{files, say};
use serde_json::json;
use sizing::proposal::{Proposal, Proposed, Stated};
use sizing::{Kind, Unit};
use std::io::Read;
use std::path::Path;
use stepnc::dimensions::{Dimensions, Measures, StatedDimension, StatedLimits, StatedUnit, dimensions};

/// Opens the file when it is a Part 21 file.
pub(super) fn step_file(path: &Path) -> Result<Option<Program>, Failure> {
    let mut head = Vec::new();
    // A file that cannot be read is named by who reads it as a job.
    let read = std::fs::File::open(path).and_then(|file| file.take(4096).read_to_end(&mut head));
    if read.is_err() || !is_part21(&head) {
        return Ok(None);
    }
    Program::open(path, None, None).map(Some)
}

/// Proposes the job.
pub(super) fn propose(program: &Program, args: &JobArgs, common: &Common) -> Done {
    let step_nc = program.step_nc().expect("it was opened as a Part 21 file");
    if step_nc.is_iso_14649() {
        return Err(Failure::unreadable(format_args!(
            "{} is an ISO 14649 file (ARM): its dimensions are not read; export it as ISO 10303-238 (AIM)",
            program.name
        )));
    }
    let found = dimensions(step_nc);
    for diagnostic in &found.diagnostics {
        eprintln!("{diagnostic}");
    }
    let proposal = proposal(program, &found, args.number);
    if proposal.dimensions.is_empty() {
        let reasons: String = proposal.left_out.iter().map(|what| format!("; left out: {what}")).collect();
        return Err(Failure::negative(format_args!(
            "{} states no size with a tolerance that an offset could keep{reasons}",
            program.name
        )));
    }
    let written = proposal.written();
    if let Some(path) = &args.out {
        files::write(path, written.text.as_bytes())?;
    }
    if common.json {
        print_json(&json!({
            "proposal": written.text,
            "complete": written.is_complete(),
            "open": written.open,
            "dimensions": proposal.dimensions.len(),
            "left_out": proposal.left_out,
            "file": args.out,
        }))?;
    } else if let Some(path) = &args.out {
        told(path, &proposal, &written);
    } else {
        say(written.text.trim_end());
    }
    Ok(Exit::Good)
}

fn told(path: &Path, proposal: &Proposal, written: &Proposed) {
    say(&format!("{}: {} sizes proposed", path.display(), proposal.dimensions.len()));
    written.open.iter().for_each(|open| say(&format!("  open: {open}")));
    proposal.left_out.iter().for_each(|what| say(&format!("  left out: {what}")));
    say(&format!(
        "fill in what is open, look at the rest, then: toolmark size job {}",
        path.display()
    ));
}

fn proposal(program: &Program, found: &Dimensions, number: Option<u32>) -> Proposal {
    let step_nc = program.step_nc().expect("it was opened as a Part 21 file");
    let mut left_out = Vec::new();
    let mut stated = Vec::new();
    for dimension in &found.dimensions {
        match of_dimension(dimension) {
            Ok(size) => stated.push((size, dimension.unit)),
            Err(why) => left_out.push(format!("{}: {why}", source(dimension))),
        }
    }
    left_out.extend(
        found
            .geometric
            .iter()
            .map(|t| format!("#{} {:?} ({}): no offset makes it", t.id, t.name, t.entity)),
    );
    left_out.extend(found.diagnostics.iter().map(ToString::to_string));
    let inches = !stated.is_empty() && stated.iter().all(|(_, unit)| *unit == StatedUnit::Inch);
    Proposal {
        source: program.name.clone(),
        name: step_nc
            .plan()
            .map_or_else(|| program.name.clone(), |project| project.name.clone()),
        number,
        unit: if inches { Unit::Inch } else { Unit::Mm },
        dimensions: stated.into_iter().map(|(size, _)| size).collect(),
        left_out,
    }
}

/// A dimension as a size of the job, or why it is none.
fn of_dimension(dimension: &StatedDimension) -> Result<Stated, String> {
    if dimension.measures == Measures::Angle {
        return Err("an angle is no size that an offset keeps".to_owned());
    }
    let nominal = dimension.nominal.ok_or("it has no nominal value")?;
    let deviations = match &dimension.limits {
        StatedLimits::None => return Err("it has no tolerance".to_owned()),
        StatedLimits::Fit(fit) => Err(format!("the file names the fit {fit} without numbers")),
        StatedLimits::Deviations { lower, upper } => Ok([*lower, *upper]),
    };
    let tools = dimension.workingsteps.iter();
    let tools = tools.filter_map(|maker| Some((maker.tool?.0, format!("'{}'", maker.name))));
    let aspect = dimension.aspects.first().map(|(_, name)| name.as_str()).unwrap_or_default();
    let words = [aspect, dimension.word.as_str()];
    Ok(Stated {
        name: words.into_iter().filter(|w| !w.is_empty()).collect::<Vec<_>>().join(" "),
        kind: kind_of(dimension)?,
        nominal,
        deviations,
        tools: tools.collect(),
        source: source(dimension),
    })
}

/// Features whose entity says where the material is.
const HOLES: [&str; 3] = ["ROUND_HOLE", "COUNTERBORE_HOLE", "SPOTFACE"];
const SHAFTS: [&str; 2] = ["OUTER_DIAMETER", "OUTER_DIAMETER_TO_SHOULDER"];

/// What a dimension is: only where its word and its feature leave no doubt.
fn kind_of(dimension: &StatedDimension) -> Result<Result<(Kind, String), Vec<Kind>>, String> {
    let word = dimension.word.to_lowercase();
    let feature = |names: &[&str]| {
        let entities = dimension.features.iter().flat_map(|f| &f.entities);
        entities.into_iter().find(|entity| names.contains(&entity.as_str())).cloned()
    };
    if word.contains("radius") {
        return Err("a radius is no kind of size that is entered here; state its diameter".to_owned());
    }
    if word.contains("diameter") {
        return Ok(match (feature(&HOLES), feature(&SHAFTS)) {
            (Some(hole), None) => Ok((Kind::InsideDiameter, format!("the feature is a {hole}"))),
            (None, Some(shaft)) => Ok((Kind::OutsideDiameter, format!("the feature is a {shaft}"))),
            _ => Err(vec![Kind::OutsideDiameter, Kind::InsideDiameter]),
        });
    }
    if word.contains("depth") {
        return Ok(Ok((Kind::Depth, format!("the file calls it {:?}", dimension.word))));
    }
    if word.contains("width") {
        return Ok(Err(vec![Kind::OutsideWidth, Kind::InsideWidth]));
    }
    Ok(Err(vec![Kind::Length, Kind::Depth, Kind::OutsideWidth, Kind::InsideWidth]))
}

/// Where a dimension comes from.
fn source(dimension: &StatedDimension) -> String {
    let of: Vec<String> = dimension.aspects.iter().map(|(id, name)| format!("#{id} {name:?}")).collect();
    let unit = match dimension.unit {
        StatedUnit::Mm => ", stated in mm",
        StatedUnit::Inch => ", stated in inches",
        StatedUnit::Other => ", stated in another unit of length, taken to mm",
        StatedUnit::Unknown => "",
    };
    let features: String = dimension
        .features
        .iter()
        .map(|f| format!(", feature #{} {:?}", f.id, f.name))
        .collect();
    let makers: String = dimension
        .workingsteps
        .iter()
        .map(|m| format!(", workingstep #{} {:?} with tool {:?}", m.workingstep, m.name, m.tool_name))
        .collect();
    format!(
        "#{} {:?} of {}{unit}{features}{makers}",
        dimension.id,
        dimension.word,
        of.join(" and ")
    )
}
