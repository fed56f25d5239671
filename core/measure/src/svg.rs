//! Drawings as SVG 1.1, in millimetres of paper: printed at 100 % it is true to scale.

use crate::drawing::{Drawing, short};
use glam::DVec2;
use std::fmt::Write;

/// Margin around the drawing, mm.
const MARGIN: f64 = 15.0;
/// Space for the dimension lines, mm.
const DIMENSION: f64 = 10.0;

impl Drawing {
    /// The drawing as SVG, or `None` where it has no line.
    pub fn to_svg(&self) -> Option<String> {
        let (low, high) = self.bounds()?;
        let mm = 1000.0 / self.scale;
        let size = [(high[0] - low[0]) * mm, (high[1] - low[1]) * mm];
        let block = 22.0 + 4.0 * self.notes.len() as f64;
        let width = (size[0] + 2.0 * MARGIN + DIMENSION).max(120.0);
        let height = size[1] + 2.0 * MARGIN + DIMENSION + block;
        let at = |p: DVec2| DVec2::new(MARGIN + DIMENSION + (p.x - low.x) * mm, MARGIN + size[1] - (p.y - low.y) * mm);
        let mut out = String::new();
        let (w, h) = (short(width, 3), short(height, 3));
        out.push_str("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n");
        let _ = writeln!(
            out,
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{w}mm\" height=\"{h}mm\" viewBox=\"0 0 {w} {h}\">\n\
             <title>{}</title>\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n\
             <g id=\"{}\" fill=\"none\" stroke=\"#000\" stroke-width=\"0.25\" stroke-linejoin=\"round\">",
            escape(&self.title),
            escape(&self.layer)
        );
        for line in &self.lines {
            let points: Vec<String> =
                line.points.iter().map(|p| at(*p).to_array().map(|x| short(x, 4)).join(",")).collect();
            let tag = if line.closed { "polygon" } else { "polyline" };
            let of = line.elevation.map_or(String::new(), |z| format!(" data-elevation=\"{}\"", short(z, 6)));
            let _ = writeln!(out, "<{tag}{of} points=\"{}\"/>", points.join(" "));
        }
        out.push_str("</g>\n<g id=\"DIMENSIONS\" stroke=\"#555\" stroke-width=\"0.18\" font-family=\"sans-serif\" font-size=\"3\" fill=\"#333\">\n");
        dimensions(&mut out, at(low), at(high), high - low);
        self.block(&mut out, MARGIN + size[1] + DIMENSION + 8.0, mm);
        out.push_str("</g>\n</svg>\n");
        Some(out)
    }

    /// Scale bar, title and notes.
    fn block(&self, out: &mut String, y: f64, mm: f64) {
        let bar = self.scale_bar();
        let (x, width) = (MARGIN + DIMENSION, bar * mm);
        for (i, fill) in [(0.0, "#000"), (1.0, "#fff")] {
            let _ = writeln!(
                out,
                "<rect class=\"scale-bar\" x=\"{}\" y=\"{}\" width=\"{}\" height=\"2\" stroke=\"#000\" fill=\"{fill}\"/>",
                short(x + i * width * 0.5, 4),
                short(y, 3),
                short(width * 0.5, 4)
            );
        }
        let mut text = |dy: f64, dx: f64, words: &str| {
            let (x, y) = (short(x + dx, 3), short(y + dy, 3));
            let _ = writeln!(out, "<text stroke=\"none\" x=\"{x}\" y=\"{y}\">{}</text>", escape(words));
        };
        text(5.5, 0.0, "0");
        text(5.5, width, &format!("{} m", short(bar, 3)));
        text(11.0, 0.0, &format!("{}   1:{}", self.title, short(self.scale, 3)));
        for (i, note) in self.notes.iter().enumerate() {
            text(15.5 + 4.0 * i as f64, 0.0, note);
        }
    }
}

/// Overall width below and height at the left.
fn dimensions(out: &mut String, low: DVec2, high: DVec2, metres: DVec2) {
    let (y, x) = (low[1] + DIMENSION * 0.6, low[0] - DIMENSION * 0.6);
    let line = |out: &mut String, a: DVec2, b: DVec2| {
        let [x1, y1, x2, y2] = [a[0], a[1], b[0], b[1]].map(|v| short(v, 3));
        let _ = writeln!(out, "<line x1=\"{x1}\" y1=\"{y1}\" x2=\"{x2}\" y2=\"{y2}\"/>");
    };
    line(out, DVec2::new(low.x, y), DVec2::new(high.x, y));
    line(out, DVec2::new(x, low.y), DVec2::new(x, high.y));
    for end in [low.x, high.x] {
        line(out, DVec2::new(end, y - 1.5), DVec2::new(end, y + 1.5));
    }
    for end in [low.y, high.y] {
        line(out, DVec2::new(x - 1.5, end), DVec2::new(x + 1.5, end));
    }
    let middle = ((low + high) * 0.5).to_array().map(|v| short(v, 3));
    let _ = writeln!(
        out,
        "<text stroke=\"none\" text-anchor=\"middle\" x=\"{}\" y=\"{}\">{} m</text>",
        middle[0],
        short(y + 4.0, 3),
        short(metres[0], 3)
    );
    let (tx, ty) = (short(x - 2.0, 3), &middle[1]);
    let _ = writeln!(
        out,
        "<text stroke=\"none\" text-anchor=\"middle\" transform=\"translate({tx} {ty}) rotate(-90)\">{} m</text>",
        short(metres[1], 3)
    );
}

fn escape(text: &str) -> String {
    // XML 1.0 has no way to write most control characters.
    let printable: String = text.chars().filter(|c| !c.is_control() || *c == '\n').collect();
    printable.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use crate::drawing::tests::square;
    use glam::DVec2;

    #[test]
    fn ten_metres_at_1_to_50_are_200_millimetres_and_names_are_escaped() {
        let svg = square().to_svg().unwrap();
        assert!(svg.contains("Gate &lt;west&gt; &amp; tower"));
        let polygon = svg.lines().find(|l| l.starts_with("<polygon")).unwrap();
        let points: Vec<DVec2> = polygon
            .split('"')
            .nth(1)
            .unwrap()
            .split(' ')
            .map(|p| {
                let (x, y) = p.split_once(',').unwrap();
                DVec2::new(x.parse().unwrap(), y.parse().unwrap())
            })
            .collect();
        assert!((points[1][0] - points[0][0] - 200.0).abs() < 1e-3, "{points:?}");
        assert!((points[0][1] - points[2][1] - 60.0).abs() < 1e-3, "y is up: {points:?}");
        assert!(svg.contains("data-elevation=\"6\"") && svg.contains(">10 m<") && svg.contains(">3 m<"));
        assert_eq!(svg.matches("class=\"scale-bar\"").count(), 2);
    }
}
