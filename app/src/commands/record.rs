//! `toolmark record`: what an MTConnect agent tells, into a file or the data directory, never more than a moment behind.

use super::{Done, print_json};
use crate::cli::{Common, RecordArgs};
use crate::failure::{Exit, Failure};
use crate::people::Acting;
use crate::recorder::Sink;
use crate::recorder::observations::ObservationsSink;
use crate::recorder::session::{self, Ended};
use crate::recorder::store::{StoreSink, Wanted};
use crate::recorder::text::TextSink;
use crate::{clock, program, say, shop};
use ledger::Action;
use mtconnect::client::gap::Gap;
use mtconnect::client::query::Query;
use mtconnect::client::session::Client;
use plan::{Diagnostic, Severity};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;
use store::{JobId, Recorded};

/// Runs the command.
///
/// # Errors
/// The address or the query is wrong, there is no agent, or the file cannot be written.
pub fn record(args: &RecordArgs, common: &Common) -> Done {
    let mut query = Query::parse(&args.url).map_err(Failure::usage)?;
    let milliseconds = |ms: Option<u64>| ms.map(Duration::from_millis);
    query.path = args.path.clone().or(query.path);
    query.from = args.from.or(query.from);
    query.count = args.count.or(query.count);
    query.interval = milliseconds(args.interval).or(query.interval);
    query.heartbeat = milliseconds(args.heartbeat).or(query.heartbeat);
    let duration = match args.duration {
        None => None,
        Some(seconds) => Some(
            Duration::try_from_secs_f64(seconds)
                .ok()
                .filter(|d| !d.is_zero())
                .ok_or_else(|| Failure::usage(format_args!("--duration {seconds}: a number of seconds above 0 was expected")))?,
        ),
    };
    let stop = super::stopped_by_signals()?;
    let source = format!("agent {}{}", query.authority(), query.device);
    let host = (query.host.clone(), query.port);
    let Some(out) = &args.out else {
        return into_data_directory(query, &source, duration, &stop, args, common);
    };
    let (mut text, mut observations);
    let sink: &mut dyn Sink = match ending_of(out) {
        "txt" => {
            text = TextSink::open(out, &source)?;
            &mut text
        }
        "parquet" => {
            observations = ObservationsSink::open(out, &source)?;
            &mut observations
        }
        _ => {
            return Err(Failure::usage(format_args!(
                "{}: the ending says what is written: .txt for positions, .parquet for every observation",
                out.display()
            )));
        }
    };
    let client = Client::new(query, sink.kept());
    let ended = session::record(client, (&host.0, host.1), sink, duration, &stop)?;
    let lost = "the last observations are not in the file; make space and record again into the same file";
    report(&ended, sink, &source, &Place::File(out), lost, common)
}

/// Where it was recorded to.
enum Place<'a> {
    File(&'a Path),
    Job(Option<JobId>, Vec<PathBuf>),
}

fn into_data_directory(
    query: Query,
    source: &str,
    duration: Option<Duration>,
    stop: &Arc<AtomicBool>,
    args: &RecordArgs,
    common: &Common,
) -> Done {
    let machine = program::machine_for(&common.machine, false)?;
    let mut directory = shop::data_directory(common)?;
    let start = clock::start_time(common.start.as_deref())?;
    let acting = Acting::of(&directory, common)?;
    acting.must(Action::Record, &mut directory, start)?;
    shop::retain(&mut directory, &machine, start)?;
    let wanted = Wanted {
        of: Recorded {
            source: source.to_owned(),
            items: query.path.clone().unwrap_or_default(),
        },
        device: Some(query.device.trim_matches('/').to_owned()).filter(|device| !device.is_empty()),
        who: shop::operator(common),
        machine,
        rows_of_a_file: args.file_rows,
    };
    let mut sink = StoreSink::open(directory, wanted)?;
    if let Some((job, reached)) = sink.from() {
        shop::notice(&format!(
            "{source} was recorded by job {job} up to sequence {} of instance {}: it goes on there",
            reached.next.saturating_sub(1),
            reached.instance
        ));
    }
    let host = (query.host.clone(), query.port);
    let client = Client::new(query, sink.kept());
    let ended = session::record(client, (&host.0, host.1), &mut sink, duration, stop);
    let ended = match ended {
        Ok(ended) => ended,
        Err(failure) => {
            sink.fail();
            return Err(failure);
        }
    };
    let place = Place::Job(sink.job(), sink.files().to_vec());
    let lost = "what was acknowledged is in the data directory; make space, and the next toolmark record of the same agent goes on behind it";
    report(&ended, &sink, source, &place, lost, common)
}

fn ending_of(path: &Path) -> &str {
    path.extension().and_then(|e| e.to_str()).unwrap_or_default()
}

fn report(ended: &Ended, sink: &dyn Sink, source: &str, place: &Place<'_>, lost: &str, common: &Common) -> Done {
    let (counters, tally) = (&ended.counters, sink.tally());
    let odd: Vec<&Diagnostic> = ended.diagnostics.iter().chain(sink.remarks()).collect();
    for found in odd.iter().filter(|d| d.severity != Severity::Remark) {
        eprintln!("{found}");
    }
    if common.json {
        let (file, job, files) = match place {
            Place::File(out) => (Some(out.display().to_string()), None, None),
            Place::Job(job, files) => (None, job.map(|job| job.0), Some(files)),
        };
        print_json(&json!({
            "source": source,
            "file": file,
            "job": job,
            "files": files,
            "observations": tally.observations,
            "bytes": tally.bytes,
            "first_sequence": tally.first_sequence,
            "last_sequence": tally.last_sequence,
            "instance_ids": tally.instances,
            "gaps": tally.gaps.iter().map(gap_json).collect::<Vec<_>>(),
            "reconnects": counters.reconnects,
            "cuts": counters.cuts,
            "doubles": counters.doubles,
            "documents": counters.documents,
            "heartbeats": counters.heartbeats,
            "bytes_received": counters.bytes,
            "disk_refusals": ended.disk_refusals,
            "ended": ended.because,
            "findings": odd.iter().map(ToString::to_string).collect::<Vec<_>>(),
        }))?;
    } else {
        say(&format!(
            "{} observations from {source}, sequence {} to {}, {} bytes, {} reconnects",
            tally.observations,
            number(tally.first_sequence),
            number(tally.last_sequence),
            tally.bytes,
            counters.reconnects
        ));
        for gap in &tally.gaps {
            say(&format!(
                "gap: sequence {} to {} of instance {} could not be had ({})",
                gap.from_sequence,
                gap.to_sequence.map_or("unknown".to_owned(), |to| to.to_string()),
                gap.instance,
                gap.cause.word()
            ));
        }
        match place {
            Place::File(out) => say(&format!("file: {}", out.display())),
            Place::Job(None, _) => say("the agent told nothing new: there is no job"),
            Place::Job(Some(job), files) => {
                say(&format!("job {job}: toolmark trace show {job}"));
                files.iter().for_each(|file| say(&format!("file: {}", file.display())));
            }
        }
    }
    match &ended.unwritten {
        None => Ok(Exit::Good),
        Some(why) => Err(Failure::machine(format_args!("{why}: {lost}"))),
    }
}

fn number(sequence: Option<u64>) -> String {
    sequence.map_or("-".to_owned(), |s| s.to_string())
}

fn gap_json(gap: &Gap) -> Value {
    json!({
        "instance_id": gap.instance,
        "from_sequence": gap.from_sequence,
        "to_sequence": gap.to_sequence,
        "cause": gap.cause.word(),
        "from": gap.from.map(clock::utc),
        "to": gap.to.map(clock::utc),
    })
}
