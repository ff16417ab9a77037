//! Small vector pictures for the report: axes with round numbers, lines, and a legend. No script, no outside file.

use std::fmt::Write;

/// One line of a picture.
pub struct Series<'a> {
    /// Its name in the legend.
    pub name: &'a str,
    /// Its class in the report's style sheet, which gives the colour: `plan`, `run`, `limit` ...
    pub class: &'a str,
    /// Pieces of connected points, in the units of the axes.
    pub pieces: Vec<Vec<[f64; 2]>>,
    /// The picture is made so large that this fits; what does not count is cut off at its edge.
    pub fits: bool,
}

/// A picture with two axes.
pub struct Plot<'a> {
    /// What it shows, for people who cannot see it.
    pub title: &'a str,
    /// Label of the horizontal axis, with its unit.
    pub x_label: &'a str,
    /// Label of the vertical axis, with its unit.
    pub y_label: &'a str,
    /// The lines, drawn in this order.
    pub series: Vec<Series<'a>>,
    /// One unit is as long in both directions: a view of the part.
    pub same_scale: bool,
    /// The vertical axis begins at 0.
    pub from_zero: bool,
}

const WIDTH: f64 = 720.0;
const LEFT: f64 = 64.0;
const RIGHT: f64 = 16.0;
const TOP: f64 = 12.0;
const BOTTOM: f64 = 44.0;

impl Plot<'_> {
    /// The picture as an SVG element; empty when there is nothing to draw.
    pub fn svg(&self) -> String {
        let Some((mut low, mut high)) = self.bounds() else {
            return String::new();
        };
        if self.from_zero {
            low[1] = low[1].min(0.0);
        }
        let mut height: f64 = 260.0;
        for k in 0..2 {
            if high[k] - low[k] < 1e-9 {
                low[k] -= 0.5;
                high[k] += 0.5;
            } else {
                let margin = 0.04 * (high[k] - low[k]);
                high[k] += margin;
                if k == 0 || !self.from_zero {
                    low[k] -= margin;
                }
            }
        }
        let inner_width = WIDTH - LEFT - RIGHT;
        if self.same_scale {
            let aspect = (high[1] - low[1]) / (high[0] - low[0]);
            height = (inner_width * aspect).clamp(160.0, 460.0) + TOP + BOTTOM;
            // The direction with room to spare is widened, so that one millimetre is the same both ways.
            let inner_height = height - TOP - BOTTOM;
            let scale = ((high[0] - low[0]) / inner_width).max((high[1] - low[1]) / inner_height);
            for (k, room) in [inner_width, inner_height].into_iter().enumerate() {
                let spare = (room * scale - (high[k] - low[k])) / 2.0;
                low[k] -= spare;
                high[k] += spare;
            }
        }
        let inner_height = height - TOP - BOTTOM;
        let x = |v: f64| LEFT + (v - low[0]) / (high[0] - low[0]) * inner_width;
        let y = |v: f64| TOP + (high[1] - v) / (high[1] - low[1]) * inner_height;

        let mut svg = format!(
            "<svg viewBox='0 0 {WIDTH} {height:.0}' role='img' aria-label='{}'>",
            escape(self.title)
        );
        for tick in ticks(low[0], high[0], 8) {
            let at = x(tick.value);
            let _ = write!(svg, "<path class='grid' d='M{at:.1} {TOP}V{:.1}'/>", height - BOTTOM);
            let _ = write!(
                svg,
                "<text x='{at:.1}' y='{:.1}' text-anchor='middle'>{}</text>",
                height - BOTTOM + 16.0,
                tick.label
            );
        }
        for tick in ticks(low[1], high[1], 6) {
            let at = y(tick.value);
            let _ = write!(svg, "<path class='grid' d='M{LEFT} {at:.1}H{:.1}'/>", WIDTH - RIGHT);
            let _ = write!(
                svg,
                "<text x='{:.1}' y='{:.1}' text-anchor='end'>{}</text>",
                LEFT - 6.0,
                at + 4.0,
                tick.label
            );
        }
        let _ = write!(
            svg,
            "<text x='{:.0}' y='{:.0}' text-anchor='middle'>{}</text>",
            LEFT + inner_width / 2.0,
            height - 8.0,
            escape(self.x_label)
        );
        let _ = write!(
            svg,
            "<text transform='translate(14 {:.0}) rotate(-90)' text-anchor='middle'>{}</text>",
            TOP + inner_height / 2.0,
            escape(self.y_label)
        );
        let _ = write!(
            svg,
            "<svg x='{LEFT}' y='{TOP}' width='{inner_width:.1}' height='{inner_height:.1}' \
             viewBox='{LEFT} {TOP} {inner_width:.1} {inner_height:.1}'>"
        );
        for series in &self.series {
            let mut d = String::new();
            for piece in series.pieces.iter().filter(|p| !p.is_empty()) {
                for (i, p) in piece.iter().enumerate() {
                    let _ = write!(d, "{}{:.1} {:.1}", if i == 0 { 'M' } else { 'L' }, x(p[0]), y(p[1]));
                }
                if piece.len() == 1 {
                    // A line without length is a dot where its ends are round.
                    d.push_str("h0");
                }
            }
            if !d.is_empty() {
                let _ = write!(svg, "<path class='{}' d='{d}'/>", series.class);
            }
        }
        svg.push_str("</svg></svg>");
        let named: Vec<_> = self
            .series
            .iter()
            .filter(|s| !s.name.is_empty() && s.pieces.iter().any(|p| !p.is_empty()))
            .collect();
        if !named.is_empty() {
            svg.push_str("<p class='legend'>");
            for s in named {
                let _ = write!(
                    svg,
                    "<span><svg class='key' viewBox='0 0 24 8'><path class='{}' d='M0 4H24'/></svg>{}</span>",
                    s.class,
                    escape(s.name)
                );
            }
            svg.push_str("</p>");
        }
        svg
    }

    fn bounds(&self) -> Option<([f64; 2], [f64; 2])> {
        let any_fits = self.series.iter().any(|s| s.fits && s.pieces.iter().any(|p| !p.is_empty()));
        let mut points = self
            .series
            .iter()
            .filter(|s| s.fits || !any_fits)
            .flat_map(|s| s.pieces.iter().flatten())
            .filter(|p| p[0].is_finite() && p[1].is_finite());
        let first = *points.next()?;
        Some(points.fold((first, first), |(low, high), p| {
            ([low[0].min(p[0]), low[1].min(p[1])], [high[0].max(p[0]), high[1].max(p[1])])
        }))
    }
}

struct AxisTick {
    value: f64,
    label: String,
}

/// Round numbers (1, 2 or 5 times a power of ten) between two values, at most `most` of them.
fn ticks(low: f64, high: f64, most: usize) -> Vec<AxisTick> {
    let rough = (high - low) / most as f64;
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .into_iter()
        .map(|m| m * power)
        .find(|s| *s >= rough)
        .unwrap_or(power * 10.0);
    let decimals = (-step.log10().floor()).clamp(0.0, 9.0) as usize;
    let first = (low / step).ceil() as i64;
    let last = (high / step).floor() as i64;
    (first..=last.min(first + 50))
        .map(|k| {
            let value = k as f64 * step;
            AxisTick {
                value,
                label: format!("{value:.decimals$}"),
            }
        })
        .collect()
}

/// Text for HTML.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_carry_round_numbers() {
        let labels = |low, high| ticks(low, high, 6).into_iter().map(|t| t.label).collect::<Vec<_>>().join(" ");
        assert_eq!(labels(-3.0, 103.0), "0 20 40 60 80 100");
        assert_eq!(labels(0.0, 0.012), "0.000 0.002 0.004 0.006 0.008 0.010 0.012");
    }

    #[test]
    fn a_name_with_markup_in_it_stays_a_name() {
        let plot = Plot {
            title: "<script>",
            x_label: "x",
            y_label: "y",
            series: vec![Series {
                name: "<b>",
                class: "run",
                pieces: vec![vec![[0.0, 0.0], [1.0, 1.0]]],
                fits: true,
            }],
            same_scale: true,
            from_zero: false,
        };
        let svg = plot.svg();
        assert!(!svg.contains("<script>") && !svg.contains("<b>"));
    }
}
