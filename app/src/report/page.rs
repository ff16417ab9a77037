//! The report as one HTML file: verdict first, then what was found, then the numbers, then the pictures, then the proof.

use super::Page;
use super::plot::{Plot, Series, escape};
use super::recorded::{Recorded, Stream};
use crate::clock;
use crate::functions::{digits, symbol};
use asrun::{Report, ToleranceSource, Verdict, WorkingstepReport};
use std::fmt::Write;
use units::Timestamp;

/// The whole page.
pub fn html(page: &Page<'_>) -> String {
    let report = page.report;
    let simulated = if report.simulated { "SIMULATED " } else { "" };
    let subject = if page.program.is_empty() { &report.name } else { page.program };
    let title = format!("{simulated}run of {subject}");
    let mut out = String::with_capacity(1 << 16);
    head(&mut out, page, &title);
    findings(&mut out, report);
    table(&mut out, report);
    overview(&mut out, report);
    for w in &report.workingsteps {
        workingstep(&mut out, w);
    }
    overrides(&mut out, page);
    printed(&mut out, page);
    recordings(&mut out, page);
    functions(&mut out, page);
    proof(&mut out, page);
    frame(&title, &out)
}

/// A page of ours round a body: no script, nothing from outside.
pub fn frame(title: &str, body: &str) -> String {
    format!(
        "<!doctype html><html lang='en'><head><meta charset='utf-8'><meta name='viewport' content='width=device-width'>\
         <meta http-equiv='Content-Security-Policy' content=\"default-src 'none'; style-src 'unsafe-inline'\">\
         <title>{}</title><style>{STYLE}</style></head><body><main>{body}</main></body></html>\n",
        escape(title)
    )
}

fn head(out: &mut String, page: &Page<'_>, title: &str) {
    let report = page.report;
    let (icon, class, words) = match report.verdict {
        Verdict::Good => ("✓", "good", "good"),
        Verdict::OutOfTolerance => ("✗", "bad", "out of tolerance"),
        Verdict::Incomplete => ("◐", "bad", "incomplete"),
        Verdict::NotJudged => ("–", "none", "not judged"),
    };
    let _ = write!(
        out,
        "<header><h1>{}</h1><p class='verdict {class}'><b>{icon}</b> {words}</p></header>",
        escape(title)
    );
    if report.simulated {
        out.push_str("<p class='simulated'>SIMULATED: every number on this page comes from a simulated machine.</p>");
    }
    let times = |pick: fn(&WorkingstepReport) -> Option<f64>| -> String {
        let known: Vec<f64> = report.workingsteps.iter().filter_map(pick).collect();
        if known.is_empty() {
            "–".into()
        } else {
            format!("{:.1} s", known.iter().sum::<f64>())
        }
    };
    let tolerance = match report.tolerance_source {
        ToleranceSource::Path => "from the program's paths".to_owned(),
        ToleranceSource::Given => format!("{:.3} mm, given", report.tolerance_mm),
        ToleranceSource::Default => format!("{:.3} mm, the default", report.tolerance_mm),
    };
    out.push_str("<dl>");
    let mut fact = |name: &str, value: &str| {
        let _ = write!(out, "<div><dt>{name}</dt><dd>{}</dd></div>", escape(value));
    };
    fact("machine", page.machine);
    fact("started", &clock::utc(Timestamp(report.start_ns)));
    fact("ended", &clock::utc(Timestamp(report.end_ns)));
    if let Some(ended) = &page.ended {
        fact("how", ended);
    }
    fact("workingsteps planned", &times(|w| w.time_planned_s));
    fact("workingsteps real", &times(|w| w.time_real_s));
    fact("samples", &format!("{}, {} unmatched", report.samples, report.unmatched));
    fact("runs", &format!("{} feed, {} rapid", report.feed_runs, report.rapid_runs));
    fact("tolerance", &tolerance);
    if let Some(driven) = page.driven {
        let three = |v: [f64; 3]| v.map(|mm| format!("{mm:.4}")).join(", ");
        fact("driven over", &format!("{}, {} link", driven.controller, driven.link));
        fact(
            "following error X, Y, Z at most",
            &format!("{} mm", three(driven.following_error_max_mm)),
        );
        fact("its rms in motion", &format!("{} mm", three(driven.following_error_rms_mm)));
        fact("buffer in motion", &driven.buffer());
        fact("late ticks", &driven.late());
        fact("times the buffer ran empty", &driven.starvations.to_string());
        fact("the link", &driven.on_the_link());
    }
    if let Some(time) = page.course.and_then(|course| course.time) {
        let of = |percent: Option<f64>| percent.map_or_else(String::new, |p| format!(" ({p:+.1} %)"));
        fact("time", &format!("{:.1} s", time.real_s));
        let start = format!("{:.1} s{}", time.foreseen_s, of(time.real_against_foreseen_percent));
        fact("foreseen at the start", &start);
        if let Some(tenth) = time.foreseen_after_a_tenth_s {
            fact(
                "foreseen after a tenth",
                &format!("{tenth:.1} s{}", of(time.real_against_tenth_percent)),
            );
        }
    }
    out.push_str("</dl>");
}

/// Which overrides were in force when, and how long the feed was held.
fn overrides(out: &mut String, page: &Page<'_>) {
    let Some(told) = page.course.map(|course| &course.overridden) else {
        return;
    };
    if told.overrides.is_empty() && told.holds == 0 {
        return;
    }
    out.push_str("<h2>Overrides and holds</h2>");
    if !told.overrides.is_empty() {
        out.push_str(
            "<div class='wide'><table><tr><th>from s</th><th>to s</th><th>feed %</th><th>rapid %</th><th>spindle %</th></tr>",
        );
        for o in &told.overrides {
            let _ = write!(
                out,
                "<tr><td>{:.3}</td><td>{:.3}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
                o.from_s, o.to_s, o.feed_percent, o.rapid_percent, o.spindle_percent
            );
        }
        out.push_str("</table></div>");
    }
    if told.holds > 0 {
        let times = if told.holds == 1 {
            "once".to_owned()
        } else {
            format!("{} times", told.holds)
        };
        let _ = write!(out, "<p>Feed held {times}, {:.1} s in all.</p>", told.held_s);
    }
}

fn findings(out: &mut String, report: &Report) {
    out.push_str("<h2>Findings</h2>");
    if report.findings.is_empty() {
        out.push_str("<p>Nothing that a person should know beyond the numbers.</p>");
        return;
    }
    out.push_str("<ul class='findings'>");
    for finding in &report.findings {
        let _ = write!(out, "<li>{}</li>", escape(finding));
    }
    out.push_str("</ul>");
}

fn printed(out: &mut String, page: &Page<'_>) {
    if page.printed.lines.is_empty() {
        return;
    }
    let lines = escape(&page.printed.lines.join("\n"));
    let _ = write!(
        out,
        "<h2>Printed by the program</h2><div class='wide'><pre>{lines}</pre></div>"
    );
}

/// Streams of recordings in the table of a page, and recordings with a picture; all of them are in its JSON.
const MOST_STREAMS: usize = 200;
const MOST_PICTURES: usize = 24;
/// Points of a line that are drawn as dots.
const MOST_DOTS: usize = 60;
/// Lines of one picture: more cannot be told apart by their colours.
const LINES: [[&str; 2]; 6] = [
    ["s1", "s1 dot"],
    ["s2", "s2 dot"],
    ["s3", "s3 dot"],
    ["s4", "s4 dot"],
    ["s5", "s5 dot"],
    ["s6", "s6 dot"],
];

fn recordings(out: &mut String, page: &Page<'_>) {
    if page.recorded.is_empty() {
        return;
    }
    out.push_str(
        "<h2>Recorded by the program</h2><div class='wide'><table><thead><tr><th class='text'>recording</th><th>run</th>\
         <th class='text'>stream</th><th>values</th><th>unavailable</th><th>min</th><th>mean</th><th>max</th>\
         <th class='text'>unit</th><th class='text'>quality</th></tr></thead><tbody>",
    );
    let streams = || page.recorded.iter().flat_map(|r| r.streams.iter().map(move |s| (r, s)));
    let number = |v: Option<f64>| v.map_or_else(|| "–".to_owned(), digits);
    for (recorded, stream) in streams().take(MOST_STREAMS) {
        let _ = write!(
            out,
            "<tr><td class='text'>{}</td><td>{}</td><td class='text'>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td>\
             <td class='text'>{}</td><td class='text'>{}</td></tr>",
            escape(&recorded.recording),
            recorded.run,
            escape(&stream.stream),
            stream.values,
            stream.unavailable,
            number(stream.min),
            number(stream.mean),
            number(stream.max),
            escape(symbol(&stream.unit)),
            escape(&stream.quality)
        );
    }
    out.push_str("</tbody></table></div>");
    let more = streams().count().saturating_sub(MOST_STREAMS);
    if more > 0 {
        let _ = write!(out, "<p>and {more} more: see report.json</p>");
    }
    for (recorded, streams) in page.recorded.iter().flat_map(pictures).take(MOST_PICTURES) {
        let unit = symbol(&streams[0].unit);
        let title = format!("{} of {}, run {}", streams[0].stream, recorded.recording, recorded.run);
        let series = streams.iter().zip(LINES).map(|(stream, [line, dot])| {
            let pieces = stream.course.pieces();
            let dots = pieces.iter().map(Vec::len).sum::<usize>() <= MOST_DOTS;
            Series {
                name: &stream.stream,
                class: if dots { dot } else { line },
                // Few values are moments, and nobody knows what was between them.
                pieces: if dots {
                    pieces.into_iter().flatten().map(|point| vec![point]).collect()
                } else {
                    pieces
                },
                fits: true,
            }
        });
        let plot = Plot {
            title: &title,
            x_label: "time since the start, s",
            y_label: unit,
            series: series.collect(),
            same_scale: false,
            from_zero: false,
        };
        let _ = write!(out, "<section><h3>{}, run {}</h3>", escape(&recorded.recording), recorded.run);
        figure(out, "", &plot);
        out.push_str("</section>");
    }
}

/// What of a recording stands in one picture: streams of one unit that are a course, as many as can be told apart.
fn pictures(recorded: &Recorded) -> Vec<(&Recorded, Vec<&Stream>)> {
    let mut by_unit: Vec<(&str, Vec<&Stream>)> = Vec::new();
    for stream in recorded.streams.iter().filter(|stream| stream.course.is_a_course()) {
        match by_unit
            .iter_mut()
            .find(|(unit, there)| *unit == stream.unit && there.len() < LINES.len())
        {
            Some((_, there)) => there.push(stream),
            None => by_unit.push((&stream.unit, vec![stream])),
        }
    }
    by_unit.into_iter().map(|(_, streams)| (recorded, streams)).collect()
}

/// Records of functions that a page shows; all of them are in its JSON and in the log.
const MOST_FUNCTIONS: usize = 500;

fn functions(out: &mut String, page: &Page<'_>) {
    let all = &page.printed.functions;
    if all.is_empty() {
        return;
    }
    out.push_str("<h2>Functions of the program</h2><div class='wide'><table><tr><th>s</th><th class='text'>function</th><th class='text'>record</th></tr>");
    for told in all.iter().take(MOST_FUNCTIONS) {
        let _ = write!(
            out,
            "<tr><td>{:.3}</td><td class='text'>{}</td><td class='text'>{}</td></tr>",
            told.t_s,
            escape(&told.function),
            escape(&told.text)
        );
    }
    out.push_str("</table></div>");
    if all.len() > MOST_FUNCTIONS {
        let _ = write!(out, "<p>and {} more: see report.json</p>", all.len() - MOST_FUNCTIONS);
    }
}

fn table(out: &mut String, report: &Report) {
    if report.workingsteps.is_empty() {
        return;
    }
    out.push_str(
        "<h2>Workingsteps</h2><p>Distance of the tool tip from the planned path over feed moves, in mm, tool and wear offsets taken \
         out; judged on p95.</p><div class='wide'><table><thead><tr><th>workingstep</th><th>planned s</th><th>real s</th><th>p95</th>\
         <th>max</th><th>rms</th><th>allowed</th><th>verdict</th><th class='text'>offsets taken out</th></tr></thead><tbody>",
    );
    let number = |v: Option<f64>, digits: usize| v.map_or_else(|| "–".to_owned(), |v| format!("{v:.digits$}"));
    for w in &report.workingsteps {
        let (class, icon) = match w.verdict {
            Verdict::Good => ("good", "✓"),
            Verdict::OutOfTolerance | Verdict::Incomplete => ("bad", "✗"),
            Verdict::NotJudged => ("none", "–"),
        };
        let allowed = match w.tolerance_source {
            ToleranceSource::Path => format!("{:.3}", w.tolerance_mm),
            ToleranceSource::Given => format!("{:.3} given", w.tolerance_mm),
            ToleranceSource::Default => format!("{:.3} default", w.tolerance_mm),
        };
        let _ = write!(
            out,
            "<tr><th>{}</th><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{allowed}</td>\
             <td class='{class}'>{icon} {}</td><td class='text'>{}</td></tr>",
            escape(&w.name),
            number(w.time_planned_s, 1),
            number(w.time_real_s, 1),
            number(w.dev_p95_mm, 4),
            number(w.dev_max_mm, 4),
            number(w.dev_rms_mm, 4),
            w.verdict.word(),
            escape(&w.offsets)
        );
    }
    out.push_str("</tbody></table></div>");
}

/// Deviation and speed over the whole run.
fn overview(out: &mut String, report: &Report) {
    let collect = |pick: fn(&WorkingstepReport) -> &Vec<[f64; 2]>| -> Vec<Vec<[f64; 2]>> {
        report.workingsteps.iter().map(|w| pick(w).clone()).collect()
    };
    let deviation = collect(|w| &w.plot.deviation);
    let speed = collect(|w| &w.plot.speed);
    let limits: Vec<Vec<[f64; 2]>> = report
        .workingsteps
        .iter()
        .filter_map(|w| {
            let first = w.plot.deviation.first()?[0];
            let last = w.plot.deviation.last()?[0];
            Some(vec![[first, w.tolerance_mm], [last, w.tolerance_mm]])
        })
        .collect();
    let plot = Plot {
        title: "Deviation from the plan over time",
        x_label: "time, s",
        y_label: "deviation, mm",
        series: vec![
            Series {
                name: "allowed",
                class: "limit",
                pieces: limits,
                fits: true,
            },
            Series {
                name: "deviation of feed moves",
                class: "run",
                pieces: deviation,
                fits: true,
            },
        ],
        same_scale: false,
        from_zero: true,
    };
    figure(out, "Deviation over the run", &plot);
    let plot = Plot {
        title: "Speed over time",
        x_label: "time, s",
        y_label: "path speed, mm/s",
        series: vec![Series {
            name: "",
            class: "run",
            pieces: speed,
            fits: true,
        }],
        same_scale: false,
        from_zero: true,
    };
    figure(out, "Speed over the run", &plot);
}

fn workingstep(out: &mut String, w: &WorkingstepReport) {
    let seen_from = view(w);
    let lines = |lines: &[asrun::PlotLine], kind: &str| -> Vec<Vec<[f64; 2]>> {
        lines
            .iter()
            .filter(|l| l.kind == kind)
            .map(|l| l.points.iter().map(|p| [p[seen_from.0], p[seen_from.1]]).collect())
            .collect()
    };
    let axes = ["X, mm", "Y, mm", "Z, mm"];
    let mut series = vec![
        Series {
            name: "planned rapid",
            class: "plan rapid",
            pieces: lines(&w.plot.plan, "rapid"),
            fits: false,
        },
        Series {
            name: "planned feed",
            class: "plan",
            pieces: lines(&w.plot.plan, "feed"),
            fits: true,
        },
        Series {
            name: "run rapid",
            class: "run rapid",
            pieces: lines(&w.plot.executed, "rapid"),
            fits: false,
        },
        Series {
            name: "run feed",
            class: "run",
            pieces: lines(&w.plot.executed, "feed"),
            fits: true,
        },
    ];
    series.retain(|s| !s.pieces.is_empty());
    let plot = Plot {
        title: &format!("Planned and executed path of {}", w.name),
        x_label: axes[seen_from.0],
        y_label: axes[seen_from.1],
        series,
        same_scale: true,
        from_zero: false,
    };
    if plot.svg().is_empty() {
        return;
    }
    let _ = write!(out, "<section><h2>{}</h2>", escape(&w.name));
    if let Some(worst) = &w.worst {
        let [x, y, z] = worst.place;
        let _ = write!(
            out,
            "<p>Furthest off: {:.4} mm on ‘{}’ at X {x:.3} Y {y:.3} Z {z:.3}, {:.1} s after the first sample.</p>",
            worst.dev_mm,
            escape(&worst.toolpath),
            worst.time_s
        );
    }
    if let Some(shift) = &w.shift {
        let [x, y, z] = shift.vector_mm;
        let _ = write!(
            out,
            "<p>A shift of X {x:+.4} Y {y:+.4} Z {z:+.4} mm explains it: p95 {:.4} mm with it, {:.4} mm without.</p>",
            shift.p95_before_mm, shift.p95_after_mm
        );
    }
    figure(out, "", &plot);
    out.push_str("</section>");
}

/// The two axes along which the feed path is largest: from above for most milling, X over Z for turning.
fn view(w: &WorkingstepReport) -> (usize, usize) {
    let mut low = [f64::INFINITY; 3];
    let mut high = [f64::NEG_INFINITY; 3];
    let feeds = w.plot.plan.iter().chain(&w.plot.executed).filter(|l| l.kind == "feed");
    for p in feeds.flat_map(|l| &l.points) {
        for k in 0..3 {
            low[k] = low[k].min(p[k]);
            high[k] = high[k].max(p[k]);
        }
    }
    let size: [f64; 3] = std::array::from_fn(|k| (high[k] - low[k]).max(0.0));
    if size[0] > 1e-6 && size[1] > 1e-6 {
        (0, 1)
    } else if size[1] <= 1e-6 {
        // Turning, or drilling in one hole: along Z to the right, X up, as a lathe is drawn.
        if size[0] > 1e-6 && size[2] > size[0] { (2, 0) } else { (0, 2) }
    } else {
        (1, 2)
    }
}

fn figure(out: &mut String, caption: &str, plot: &Plot<'_>) {
    let svg = plot.svg();
    if !svg.is_empty() {
        let heading = if caption.is_empty() {
            String::new()
        } else {
            format!("<h2>{caption}</h2>")
        };
        let _ = write!(out, "{heading}<figure>{svg}</figure>");
    }
}

fn proof(out: &mut String, page: &Page<'_>) {
    let s = &page.report.settings;
    out.push_str("<h2>How this was made</h2><table class='proof'>");
    let mut row = |name: &str, value: &str| {
        let _ = write!(
            out,
            "<tr><th>{}</th><td class='text'>{}</td></tr>",
            escape(name),
            escape(value)
        );
    };
    row("source of the record", &page.report.source);
    row("matching", s.matching);
    row("frame of the record", &format!("{} ({})", s.frame, s.frame_quality));
    if let Some([x, y, z]) = s.shift_mm {
        row(
            "shift laid on the record",
            &format!("X {x:+.4} Y {y:+.4} Z {z:+.4} mm (estimated)"),
        );
    }
    row("time between samples", &format!("{:.1} ms (median)", s.interval_s * 1000.0));
    row("noise seen in the record", &format!("{:.4} mm", s.noise_mm));
    if let Some(threshold) = s.threshold_mm_s {
        row(
            "faster than this is rapid",
            &format!("{threshold:.2} mm/s (derived from the record)"),
        );
    }
    if let Some(separation) = s.separation {
        row("how clearly feed and rapid are apart", &format!("{separation:.3} of 1"));
    }
    for (name, value) in &page.provenance {
        row(name, value);
    }
    out.push_str("</table>");
}

const STYLE: &str = "\
:root{color-scheme:light dark;--ink:#1a1d21;--dim:#5c6670;--paper:#fff;--line:#d9dee3;--plan:#9aa4ae;--run:#0b63ce;--good:#12703a;--bad:#b3261e;--warn:#8a5a00}\
@media(prefers-color-scheme:dark){:root{--ink:#e6e9ec;--dim:#9aa4ae;--paper:#15181c;--line:#30363d;--plan:#66707a;--run:#6aa9ff;--good:#5bd38a;--bad:#ff8a80;--warn:#ffc66b}}\
body{margin:0;background:var(--paper);color:var(--ink);font:15px/1.5 system-ui,sans-serif}\
main{max-width:820px;margin:0 auto;padding:24px 16px 64px}\
header{display:flex;justify-content:space-between;align-items:baseline;gap:16px;flex-wrap:wrap}\
h1{font-size:22px;margin:0;overflow-wrap:anywhere}h2{font-size:17px;margin:32px 0 8px}h3{font-size:15px;margin:20px 0 4px}\
.verdict{margin:0;padding:4px 14px;border:2px solid;border-radius:6px;font-weight:600}\
.good{color:var(--good)}.bad{color:var(--bad)}.none{color:var(--dim)}td.good,td.none{white-space:nowrap}\
.simulated{border-left:4px solid var(--warn);padding:4px 12px;color:var(--warn);font-weight:600}\
dl{display:grid;grid-template-columns:repeat(auto-fill,minmax(230px,1fr));gap:4px 24px;margin:16px 0}\
dt{color:var(--dim);font-size:13px}dd{margin:0;font-variant-numeric:tabular-nums}\
.findings{padding-left:20px}.findings li{margin:4px 0}\
.wide{overflow-x:auto}table{border-collapse:collapse;width:100%;font-variant-numeric:tabular-nums;font-size:14px}\
th,td{padding:4px 8px;border-bottom:1px solid var(--line);text-align:right;vertical-align:top}\
th:first-child,td.text,th.text{text-align:left}thead th{color:var(--dim);font-weight:500}\
tbody th{font-weight:500}.proof td{overflow-wrap:anywhere;font-size:13px}.proof th{color:var(--dim);white-space:nowrap}\
figure{margin:0}svg{width:100%;height:auto;display:block}svg text{fill:var(--dim);font-size:12px}\
svg path{fill:none;stroke-width:1.6;stroke-linejoin:round}svg .grid{stroke:var(--line);stroke-width:1}\
.plan{stroke:var(--plan);stroke-width:4!important}.run{stroke:var(--run)}.limit{stroke:var(--bad);stroke-dasharray:6 4}\
.dot{stroke-width:5;stroke-linecap:round}.s1{stroke:var(--run)}.s2{stroke:#c2570c}.s3{stroke:#0f8a6d}.s4{stroke:#8b5cf6}.s5{stroke:#b8860b}.s6{stroke:#d6336c}\
.rapid{stroke-dasharray:3 4;opacity:.7}.plan.rapid{stroke-width:1.4!important}\
.legend{display:flex;gap:20px;flex-wrap:wrap;font-size:13px;color:var(--dim);margin:4px 0 0 64px}.legend span{display:flex;align-items:center;gap:6px}\
svg.key{width:24px;height:8px}@media print{main{max-width:none}}";
