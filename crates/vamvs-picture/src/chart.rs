//! Curves in a diagram, as SVG.

use std::fmt::Write;

use crate::template::escaped;

/// Width and height of the whole, and of its margins: left, right, top, bottom.
const SIZE: [f64; 2] = [720.0, 280.0];
const MARGIN: [f64; 4] = [52.0, 12.0, 28.0, 38.0];
/// Colours of curves, in turn.
const COLOURS: [&str; 6] = ["#1f77b4", "#ff7f0e", "#2ca02c", "#d62728", "#9467bd", "#8c564b"];

/// A diagram of curves with axes from 0.
#[derive(Clone, Debug, PartialEq)]
pub struct Chart<'a> {
    /// What it shows.
    pub title: &'a str,
    /// What is along the horizontal axis, and its end.
    pub across: (&'a str, f64),
    /// The end of the vertical axis; larger values are drawn there.
    pub top: f64,
    /// The curves.
    pub curves: Vec<Curve>,
}

/// A curve.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// What it is.
    pub name: String,
    /// Its points from left to right; points with a number that is not finite are left out.
    pub points: Vec<[f64; 2]>,
}

impl Chart<'_> {
    /// The diagram as an SVG element.
    #[must_use]
    pub fn svg(&self) -> String {
        let [width, height] = SIZE;
        let title = escaped(self.title);
        let mut svg = format!("<svg viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"{title}\">");
        self.axes(&mut svg).expect("a string can be written");
        for (index, curve) in self.curves.iter().enumerate() {
            self.curve(&mut svg, index, curve).expect("a string can be written");
        }
        svg + "</svg>"
    }

    /// Where a point is drawn.
    fn place(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [left, right, above, below] = MARGIN;
        [
            left + (x / self.across.1).clamp(0.0, 1.0) * (SIZE[0] - left - right),
            SIZE[1] - below - (y / self.top).clamp(0.0, 1.0) * (SIZE[1] - above - below),
        ]
    }

    fn axes(&self, svg: &mut String) -> std::fmt::Result {
        let (what, end) = (escaped(self.across.0), self.across.1);
        for share in [0.0, 0.25, 0.5, 0.75, 1.0] {
            let ([left, y], [right, _]) = (self.place([0.0, share * self.top]), self.place([end, 0.0]));
            write!(svg, "<path d=\"M{left} {y:.1}H{right}\" stroke=\"#8884\"/>")?;
            let value = label(share * self.top);
            write!(
                svg,
                "<text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{value}</text>",
                left - 6.0,
                y + 4.0
            )?;
            let ([x, _], y) = (self.place([share * end, 0.0]), SIZE[1] - 22.0);
            let value = label(share * end);
            write!(svg, "<text x=\"{x:.1}\" y=\"{y}\" text-anchor=\"middle\">{value}</text>")?;
        }
        write!(
            svg,
            "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{what}</text>",
            SIZE[0] / 2.0,
            SIZE[1] - 5.0
        )
    }

    fn curve(&self, svg: &mut String, index: usize, curve: &Curve) -> std::fmt::Result {
        let colour = COLOURS[index % COLOURS.len()];
        let drawn = curve.points.iter().filter(|point| point.iter().all(|value| value.is_finite()));
        write!(svg, "<polyline fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.5\" points=\"")?;
        for [x, y] in drawn.map(|&point| self.place(point)) {
            write!(svg, "{x:.1},{y:.1} ")?;
        }
        let (left, name) = (MARGIN[0] + 130.0 * index as f64, escaped(&curve.name));
        write!(svg, "\"/><text x=\"{left}\" y=\"16\" style=\"fill:{colour}\">{name}</text>")
    }
}

/// A number at an axis, with three significant digits.
fn label(value: f64) -> String {
    let decimals = (2.0 - value.abs().log10().floor()).clamp(0.0, 6.0);
    let text = format!("{value:.0$}", if value == 0.0 { 0 } else { decimals as usize });
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_where_the_axes_say() {
        let curve = Curve { name: "a<b".to_owned(), points: vec![[0.0, 0.0], [2.0, 4.0], [1.0, f64::NAN]] };
        let chart = Chart { title: "t", across: ("steps", 2.0), top: 4.0, curves: vec![curve] };
        assert_eq!(chart.place([0.0, 0.0]), [52.0, 242.0]);
        assert_eq!(chart.place([2.0, 9.0]), [708.0, 28.0]);
        assert_eq!(chart.place([1.0, 2.0]), [380.0, 135.0]);
        let svg = chart.svg();
        assert!(svg.contains("points=\"52.0,242.0 708.0,28.0 \""), "{svg}");
        assert!(svg.contains("a&lt;b") && !svg.contains("NaN"));
    }

    #[test]
    fn labels_have_three_digits() {
        let labels = [0.0, 0.25, 0.001_234, 12.5, 4000.0, 0.1 + 0.2].map(label);
        assert_eq!(labels, ["0", "0.25", "0.00123", "12.5", "4000", "0.3"]);
    }
}
