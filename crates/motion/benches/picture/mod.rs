//! A picture of plans: for each, path speed, and acceleration and jerk of each axis over time, with their limits, as SVG.
//!
//! A column of the picture is many cycles, so that of acceleration and jerk it shows everything between the least and the most.

use std::fmt::Write;

/// Width of what is drawn over time, heights of the three strips, and the gap between them, in pixels.
const WIDTH: usize = 560;
const HEIGHTS: [f64; 3] = [64.0, 64.0, 64.0];
const GAP: f64 = 8.0;

/// A panel with its text around it.
const PANEL: (usize, usize) = (690, 306);
const HEAD: usize = 112;

const AXES: [(&str, &str); 3] = [("X", "#0b62b8"), ("Y", "#d9730d"), ("Z", "#2e8b57")];
const INK: &str = "#1f2933";
const FAINT: &str = "#7b8794";

/// What a panel shows.
pub struct Panel<'a> {
    /// In bold, and what stands behind it.
    pub title: &'a str,
    pub remark: &'a str,
    pub good: bool,
    /// A place each millisecond, mm.
    pub places: &'a [[f64; 3]],
    /// Row and column.
    pub at: (usize, usize),
    /// Programmed feed, mm/s.
    pub feed: f64,
    /// Of each axis: mm/s, mm/s^2, mm/s^3.
    pub limits: [f64; 3],
}

/// Panels in two columns.
#[derive(Default)]
pub struct Picture {
    drawn: String,
    rows: usize,
}

impl Picture {
    pub fn add(&mut self, panel: &Panel<'_>) {
        let (x, y) = (panel.at.1 * PANEL.0 + 78, panel.at.0 * PANEL.1 + HEAD);
        self.rows = self.rows.max(panel.at.0 + 1);
        let out = &mut self.drawn;
        let mark = if panel.good {
            ("#2e8b57", "within its budget")
        } else {
            ("#c0392b", "over its budget")
        };
        let _ = write!(
            out,
            "<g transform=\"translate({x},{y})\"><circle cx=\"5\" cy=\"-29\" r=\"5\" fill=\"{}\"><title>{}</title></circle><text x=\"17\" \
             y=\"-24\" font-size=\"15\" font-weight=\"600\" fill=\"{INK}\">{}</text><text x=\"17\" y=\"-8\" fill=\"{FAINT}\">{}</text>",
            mark.0, mark.1, panel.title, panel.remark
        );
        let n = panel.places.len();
        let difference = |k: usize, order: usize, axis: usize| {
            let p = |back: usize| panel.places[k.saturating_sub(back)][axis];
            match order {
                1 => (p(0) - p(1)) / 1e-3,
                2 => (p(0) - 2.0 * p(1) + p(2)) / 1e-6,
                _ => (p(0) - 3.0 * p(1) + 3.0 * p(2) - p(3)) / 1e-9,
            }
        };
        let cycles = |column: usize| column * n / WIDTH..((column + 1) * n / WIDTH).max(column * n / WIDTH + 1).min(n);
        let mut top = 0.0;
        // Speed along the path, from 0 up.
        let most = panel.feed * 1.12;
        let height = |v: f64, top: f64| top + HEIGHTS[0] * (1.0 - v / most);
        frame(out, top, HEIGHTS[0], ["speed", "mm/s"]);
        let speed = |k: usize| {
            (1..=3)
                .map(|axis| difference(k, 1, axis - 1))
                .map(|v| v * v)
                .sum::<f64>()
                .sqrt()
        };
        let mut line = String::new();
        for column in 0..WIDTH {
            let fastest = cycles(column).map(speed).fold(0.0, f64::max);
            let _ = write!(line, "{column},{:.1} ", height(fastest.min(most), top));
        }
        let base = top + HEIGHTS[0];
        let _ = write!(
            out,
            "<polygon points=\"0,{base} {line}{},{base}\" fill=\"#cbd5e0\" opacity=\"0.55\"/><polyline points=\"{line}\" fill=\"none\" \
             stroke=\"{INK}\" stroke-width=\"1.4\"/>",
            WIDTH - 1
        );
        limit(out, height(panel.feed, top), &format!("{:.0}", panel.feed));
        tick(out, base, "0");
        // Acceleration and jerk of each axis, to both sides.
        for (order, name, unit) in [(2, "acceleration", "m/s&#178;"), (3, "jerk", "m/s&#179;")] {
            top += HEIGHTS[order - 2] + GAP;
            let (tall, bound) = (HEIGHTS[order - 1], panel.limits[order - 1]);
            let middle = top + tall / 2.0;
            let height = |value: f64| middle - tall / 2.0 * (value / (1.15 * bound)).clamp(-1.0, 1.0);
            frame(out, top, tall, [name, unit]);
            for (axis, (_, colour)) in AXES.into_iter().enumerate() {
                let (mut upper, mut lower) = (String::new(), vec![]);
                let mut moves = false;
                for column in 0..WIDTH {
                    let values = cycles(column).map(|k| difference(k, order, axis));
                    let (least, most) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
                    moves |= most - least > 1e-3 * bound || most.abs() > 1e-3 * bound;
                    let _ = write!(upper, "{column},{:.1} ", height(most));
                    lower.push(format!("{column},{:.1} ", height(least)));
                }
                lower.reverse();
                if moves {
                    let _ = write!(
                        out,
                        "<polygon points=\"{upper}{}\" fill=\"{colour}\" fill-opacity=\"0.45\" stroke=\"{colour}\" stroke-width=\"0.7\" \
                         stroke-opacity=\"0.85\"/>",
                        lower.concat()
                    );
                }
            }
            for side in [1.0, -1.0] {
                limit(
                    out,
                    height(side * bound),
                    &format!("{}{:.0}", if side > 0.0 { "" } else { "&#8722;" }, bound / 1e3),
                );
            }
            tick(out, middle, "0");
        }
        // Seconds.
        let seconds = n as f64 * 1e-3;
        let bottom = top + HEIGHTS[2];
        let step = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0]
            .into_iter()
            .find(|step| seconds / step <= 10.0)
            .unwrap_or(10.0);
        for k in 0..=(seconds / step) as usize {
            let x = k as f64 * step / seconds * WIDTH as f64;
            let _ = write!(
                out,
                "<line x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"{bottom}\" y2=\"{}\" stroke=\"{FAINT}\"/><text x=\"{x:.1}\" y=\"{}\" \
                 text-anchor=\"middle\" fill=\"{FAINT}\">{}</text>",
                bottom + 4.0,
                bottom + 16.0,
                if step < 1.0 {
                    format!("{:.1}", k as f64 * step)
                } else {
                    format!("{:.0}", k as f64 * step)
                },
            );
        }
        let _ = write!(
            out,
            "<text x=\"{}\" y=\"{}\" fill=\"{FAINT}\">s</text></g>",
            WIDTH + 8,
            bottom + 16.0
        );
    }

    /// The whole as a file.
    pub fn svg(&self, title: &str, remark: &str) -> String {
        let (width, height) = (2 * PANEL.0, self.rows * PANEL.1 + HEAD - 36);
        let mut legend = String::new();
        for (k, (name, colour)) in AXES.into_iter().enumerate() {
            let x = width - 330 + k * 44;
            let _ = write!(
                legend,
                "<rect x=\"{x}\" y=\"22\" width=\"12\" height=\"12\" fill=\"{colour}\" opacity=\"0.7\"/><text x=\"{}\" y=\"33\">{name}</text>",
                x + 17
            );
        }
        let x = width - 190;
        let _ = write!(
            legend,
            "<line x1=\"{x}\" x2=\"{}\" y1=\"28\" y2=\"28\" stroke=\"#c0392b\" stroke-dasharray=\"5 4\"/><text x=\"{}\" y=\"33\">limit, feed</text>",
            x + 26,
            x + 32
        );
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" \
             font-family=\"Inter, Helvetica, Arial, sans-serif\" font-size=\"11\" fill=\"{INK}\"><rect width=\"100%\" height=\"100%\" \
             fill=\"white\"/><text x=\"24\" y=\"34\" font-size=\"19\" font-weight=\"600\">{title}</text><text x=\"24\" y=\"52\" \
             fill=\"{FAINT}\">{remark}</text>{legend}{}</svg>\n",
            self.drawn
        )
    }
}

fn frame(out: &mut String, top: f64, tall: f64, [name, unit]: [&str; 2]) {
    let middle = top + tall / 2.0;
    let _ = write!(
        out,
        "<rect y=\"{top}\" width=\"{WIDTH}\" height=\"{tall}\" fill=\"#f8fafc\" stroke=\"#e2e8f0\"/><text transform=\"translate(-50,{middle}) \
         rotate(-90)\" text-anchor=\"middle\" fill=\"{FAINT}\" font-size=\"10\">{name}</text><text transform=\"translate(-39,{middle}) \
         rotate(-90)\" text-anchor=\"middle\" fill=\"{FAINT}\" font-size=\"9\">{unit}</text>"
    );
}

fn limit(out: &mut String, y: f64, value: &str) {
    let _ = write!(
        out,
        "<line x1=\"0\" x2=\"{WIDTH}\" y1=\"{y:.1}\" y2=\"{y:.1}\" stroke=\"#c0392b\" stroke-width=\"0.8\" stroke-dasharray=\"5 4\"/>"
    );
    tick(out, y, value);
}

fn tick(out: &mut String, y: f64, value: &str) {
    let _ = write!(
        out,
        "<text x=\"-6\" y=\"{:.1}\" text-anchor=\"end\" fill=\"{FAINT}\" font-size=\"10\">{value}</text>",
        y + 3.5
    );
}
