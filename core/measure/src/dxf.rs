//! Drawings as DXF, release 2010 (AC1024), ASCII, metres: what CAD programs read. Source: Autodesk, "AutoCAD 2010 DXF Reference".
//!
//! Written are the tables, blocks and objects that the format demands, light-weight polylines (flat, with an elevation), points and
//! polylines in space for saved measurements, and lines and texts for scale bar and dimensions, each on a layer of its own.

use crate::drawing::{Drawing, short};
use crate::saved::{Document, Measurement};
use glam::{DVec2, DVec3};
use kilwa_geometry::LengthUnit;
use std::fmt::Write;

/// Layer of saved measurements.
const MEASURED: &str = "MEASUREMENTS";
/// Layer of overall dimensions, scale bar and title.
const NOTES: &str = "DIMENSIONS";

/// Writes pairs of group code and value, and counts handles.
struct Writer {
    text: String,
    handle: u32,
}

/// Handles of what others refer to.
const MODEL: &str = "1F";
const PAPER: &str = "1B";

impl Writer {
    fn pair(&mut self, code: u32, value: impl std::fmt::Display) {
        let _ = writeln!(self.text, "{code:>3}\n{value}");
    }

    fn pairs(&mut self, pairs: &[(u32, &str)]) {
        for (code, value) in pairs {
            self.pair(*code, value);
        }
    }

    fn number(&mut self, code: u32, x: f64) {
        // The shortest text that reads back as the same double; DXF wants a decimal point.
        self.pair(code, format_args!("{x:?}"));
    }

    fn point(&mut self, p: DVec3) {
        for (code, x) in [10, 20, 30].into_iter().zip(p.to_array()) {
            self.number(code, x);
        }
    }

    fn next(&mut self) -> String {
        self.handle += 1;
        format!("{:X}", self.handle)
    }

    fn table(&mut self, name: &str, handle: &str, count: usize) {
        self.pairs(&[(0, "TABLE"), (2, name), (5, handle), (330, "0"), (100, "AcDbSymbolTable")]);
        self.pair(70, count);
    }

    fn record(&mut self, kind: &str, table: &str, class: &str, name: &str) {
        let handle = self.next();
        self.record_with(kind, &handle, table, class, name);
    }

    fn record_with(&mut self, kind: &str, handle: &str, table: &str, class: &str, name: &str) {
        self.pairs(&[(0, kind), (5, handle), (330, table), (100, "AcDbSymbolTableRecord"), (100, class), (2, name)]);
    }

    fn entity(&mut self, kind: &str, class: &str, layer: &str) {
        let handle = self.next();
        self.pairs(&[(0, kind), (5, &handle), (330, MODEL), (100, "AcDbEntity"), (8, layer), (100, class)]);
    }
}

impl Drawing {
    /// The drawing as DXF, or `None` where it has no line.
    pub fn to_dxf(&self) -> Option<String> {
        let (low, high) = self.bounds()?;
        Some(file(&[&self.layer_name(), NOTES], low.extend(0.0), high.extend(0.0), |w| {
            self.entities(w, low, high);
        }))
    }

    /// Layer names have no spaces or signs here, and never the name of the layer for notes.
    fn layer_name(&self) -> String {
        let name: String =
            self.layer.chars().map(|c| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' }).collect();
        if name.is_empty() || name == "0" || name == NOTES { "LINES".to_owned() } else { name }
    }

    fn entities(&self, w: &mut Writer, low: DVec2, high: DVec2) {
        let layer = self.layer_name();
        for line in self.lines.iter().filter(|l| l.points.len() > 1) {
            w.entity("LWPOLYLINE", "AcDbPolyline", &layer);
            w.pair(90, line.points.len());
            w.pair(70, u32::from(line.closed));
            if let Some(z) = line.elevation {
                w.number(38, z);
            }
            for p in &line.points {
                w.number(10, p[0]);
                w.number(20, p[1]);
            }
        }
        // One millimetre of paper in metres of the drawing.
        let mm = self.scale / 1000.0;
        let (y, x) = (low[1] - 6.0 * mm, low[0] - 6.0 * mm);
        segment(w, DVec2::new(low.x, y), DVec2::new(high.x, y));
        segment(w, DVec2::new(x, low.y), DVec2::new(x, high.y));
        for at in [low.x, high.x] {
            segment(w, DVec2::new(at, y - mm), DVec2::new(at, y + mm));
        }
        for at in [low[1], high[1]] {
            segment(w, DVec2::new(x - mm, at), DVec2::new(x + mm, at));
        }
        let size = (high - low).to_array().map(|d| format!("{} m", short(d, 3)));
        text(w, DVec3::new(f64::midpoint(low.x, high.x), y - 5.0 * mm, 0.0), 3.0 * mm, 0.0, &size[0]);
        text(w, DVec3::new(x - 2.0 * mm, f64::midpoint(low.y, high.y), 0.0), 3.0 * mm, 90.0, &size[1]);
        let (bar, y) = (self.scale_bar(), y - 14.0 * mm);
        segment(w, DVec2::new(low.x, y), DVec2::new(low.x + bar, y));
        for k in [0.0, 0.5, 1.0] {
            let at = DVec2::new(low.x + bar * k, y);
            segment(w, at, DVec2::new(at.x, y + 2.0 * mm));
        }
        text(w, DVec3::new(low.x, y - 4.5 * mm, 0.0), 3.0 * mm, 0.0, "0");
        text(w, DVec3::new(low.x + bar, y - 4.5 * mm, 0.0), 3.0 * mm, 0.0, &format!("{} m", short(bar, 3)));
        let title = format!("{}   1:{}", self.title, short(self.scale, 3));
        for (i, words) in std::iter::once(&title).chain(&self.notes).enumerate() {
            text(w, DVec3::new(low.x, y - (11.0 + 4.5 * i as f64) * mm, 0.0), 3.0 * mm, 0.0, words);
        }
    }
}

impl Document {
    /// The measurements as points and lines in space, world coordinates, each with its name and first value beside it.
    pub fn to_dxf(&self) -> String {
        let points = self.measurements.iter().flat_map(|m| &m.task.world);
        let (low, high) = points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), p| (a.min(*p), b.max(*p)));
        let (low, high) = if low[0] <= high[0] { (low, high) } else { (DVec3::ZERO, DVec3::ZERO) };
        let size = (high - low).max_element().max(0.01) * 0.02;
        file(&[MEASURED, NOTES], low, high, |w| {
            for m in &self.measurements {
                measured(w, m, size);
            }
        })
    }
}

/// One measurement: a point, or a line in space, and its label.
fn measured(w: &mut Writer, m: &Measurement, size: f64) {
    let points = &m.task.world;
    let Some(first) = points.first() else { return };
    if points.len() == 1 {
        w.entity("POINT", "AcDbPoint", MEASURED);
        w.point(*first);
    } else {
        let handle = w.next();
        w.pairs(&[(0, "POLYLINE"), (5, &handle), (330, MODEL), (100, "AcDbEntity"), (8, MEASURED)]);
        w.pairs(&[(100, "AcDb3dPolyline"), (66, "1"), (10, "0.0"), (20, "0.0"), (30, "0.0")]);
        w.pair(70, if m.task.tool.is_closed() { 9 } else { 8 });
        for p in points {
            let vertex = w.next();
            w.pairs(&[(0, "VERTEX"), (5, &vertex), (330, &handle), (100, "AcDbEntity"), (8, MEASURED)]);
            w.pairs(&[(100, "AcDbVertex"), (100, "AcDb3dPolylineVertex")]);
            w.point(*p);
            w.pair(70, 32);
        }
        let end = w.next();
        w.pairs(&[(0, "SEQEND"), (5, &end), (330, &handle), (100, "AcDbEntity"), (8, MEASURED)]);
    }
    let value = m.readings.first().map_or(String::new(), |r| r.text(LengthUnit::Metre));
    text(w, *first, size, 0.0, format!("{} {value}", m.name).trim_end());
}

/// A whole file round entities.
fn file(layers: &[&str], low: DVec3, high: DVec3, entities: impl FnOnce(&mut Writer)) -> String {
    let mut w = Writer { text: String::new(), handle: 0x100 };
    let mut body = Writer { text: String::new(), handle: 0x1000 };
    entities(&mut body);
    header(&mut w, low, high, body.handle + 1);
    tables(&mut w, layers);
    blocks(&mut w);
    w.pairs(&[(0, "SECTION"), (2, "ENTITIES")]);
    w.text.push_str(&body.text);
    w.pair(0, "ENDSEC");
    objects(&mut w);
    w.pair(0, "EOF");
    w.text
}

fn segment(w: &mut Writer, a: DVec2, b: DVec2) {
    w.entity("LINE", "AcDbLine", NOTES);
    w.point(a.extend(0.0));
    for (code, x) in [(11, b.x), (21, b.y), (31, 0.0)] {
        w.number(code, x);
    }
}

fn text(w: &mut Writer, at: DVec3, height: f64, degrees: f64, words: &str) {
    w.entity("TEXT", "AcDbText", NOTES);
    w.point(at);
    w.number(40, height);
    // A line break would end the value; signs beyond ASCII are written as \U+XXXX.
    let mut plain = String::new();
    for c in words.chars().filter(|c| !c.is_control()) {
        if c.is_ascii() {
            plain.push(c);
        } else {
            let mut units = [0; 2];
            for unit in c.encode_utf16(&mut units) {
                let _ = write!(plain, "\\U+{unit:04X}");
            }
        }
    }
    w.pair(1, plain);
    w.number(50, degrees);
    w.pair(100, "AcDbText");
}

fn header(w: &mut Writer, low: DVec3, high: DVec3, seed: u32) {
    w.pairs(&[(0, "SECTION"), (2, "HEADER"), (9, "$ACADVER"), (1, "AC1024"), (9, "$DWGCODEPAGE"), (3, "ANSI_1252")]);
    w.pair(9, "$HANDSEED");
    w.pair(5, format_args!("{seed:X}"));
    w.pairs(&[(9, "$INSUNITS"), (70, "6"), (9, "$MEASUREMENT"), (70, "1")]);
    for (name, p) in [("$EXTMIN", low), ("$EXTMAX", high)] {
        w.pair(9, name);
        w.point(p);
    }
    w.pairs(&[(0, "ENDSEC"), (0, "SECTION"), (2, "CLASSES"), (0, "ENDSEC")]);
}

fn tables(w: &mut Writer, layers: &[&str]) {
    w.pairs(&[(0, "SECTION"), (2, "TABLES")]);
    w.table("VPORT", "8", 1);
    w.record("VPORT", "8", "AcDbViewportTableRecord", "*Active");
    w.pair(70, 0);
    w.pair(0, "ENDTAB");
    w.table("LTYPE", "5", 3);
    for name in ["ByBlock", "ByLayer", "Continuous"] {
        w.record("LTYPE", "5", "AcDbLinetypeTableRecord", name);
        w.pairs(&[(70, "0"), (3, ""), (72, "65"), (73, "0"), (40, "0.0")]);
    }
    w.pair(0, "ENDTAB");
    w.table("LAYER", "2", layers.len() + 1);
    for (i, name) in std::iter::once(&"0").chain(layers).enumerate() {
        w.record("LAYER", "2", "AcDbLayerTableRecord", name);
        w.pair(70, 0);
        // White (black on paper), and grey for the notes.
        w.pair(62, if i == 2 { 8 } else { 7 });
        w.pairs(&[(6, "Continuous"), (370, "25")]);
    }
    w.pair(0, "ENDTAB");
    w.table("STYLE", "3", 1);
    w.record("STYLE", "3", "AcDbTextStyleTableRecord", "Standard");
    w.pairs(&[(70, "0"), (40, "0.0"), (41, "1.0"), (50, "0.0"), (71, "0"), (42, "0.2"), (3, "txt"), (4, "")]);
    w.pair(0, "ENDTAB");
    for (name, handle) in [("VIEW", "6"), ("UCS", "7")] {
        w.table(name, handle, 0);
        w.pair(0, "ENDTAB");
    }
    w.table("APPID", "9", 1);
    w.record("APPID", "9", "AcDbRegAppTableRecord", "ACAD");
    w.pair(70, 0);
    w.pair(0, "ENDTAB");
    w.table("DIMSTYLE", "A", 1);
    w.pair(100, "AcDbDimStyleTable");
    let handle = w.next();
    w.pairs(&[(0, "DIMSTYLE"), (105, &handle), (330, "A"), (100, "AcDbSymbolTableRecord")]);
    w.pairs(&[(100, "AcDbDimStyleTableRecord"), (2, "Standard"), (70, "0")]);
    w.pair(0, "ENDTAB");
    w.table("BLOCK_RECORD", "1", 2);
    w.record_with("BLOCK_RECORD", MODEL, "1", "AcDbBlockTableRecord", "*Model_Space");
    w.record_with("BLOCK_RECORD", PAPER, "1", "AcDbBlockTableRecord", "*Paper_Space");
    w.pairs(&[(0, "ENDTAB"), (0, "ENDSEC")]);
}

fn blocks(w: &mut Writer) {
    w.pairs(&[(0, "SECTION"), (2, "BLOCKS")]);
    for (owner, name) in [(MODEL, "*Model_Space"), (PAPER, "*Paper_Space")] {
        let handle = w.next();
        w.pairs(&[(0, "BLOCK"), (5, &handle), (330, owner), (100, "AcDbEntity"), (8, "0"), (100, "AcDbBlockBegin")]);
        w.pairs(&[(2, name), (70, "0"), (10, "0.0"), (20, "0.0"), (30, "0.0"), (3, name), (1, "")]);
        let handle = w.next();
        w.pairs(&[(0, "ENDBLK"), (5, &handle), (330, owner), (100, "AcDbEntity"), (8, "0"), (100, "AcDbBlockEnd")]);
    }
    w.pair(0, "ENDSEC");
}

fn objects(w: &mut Writer) {
    w.pairs(&[(0, "SECTION"), (2, "OBJECTS")]);
    w.pairs(&[
        (0, "DICTIONARY"),
        (5, "C"),
        (330, "0"),
        (100, "AcDbDictionary"),
        (281, "1"),
        (3, "ACAD_GROUP"),
        (350, "D"),
    ]);
    w.pairs(&[(0, "DICTIONARY"), (5, "D"), (330, "C"), (100, "AcDbDictionary"), (281, "1"), (0, "ENDSEC")]);
}

#[cfg(test)]
mod tests {
    use crate::drawing::tests::square;
    use glam::DVec2;
    use std::collections::BTreeSet;

    #[test]
    fn dxf_pairs_are_well_formed_handles_are_unique_and_coordinates_round_trip_exactly() {
        let mut drawing = square();
        drawing.lines[0].points[0] = DVec2::new(566_000.1 + 1e-9, 0.1 + 0.2);
        drawing.title = "Kilwa مسجد".to_owned();
        let dxf = drawing.to_dxf().unwrap();
        assert!(dxf.is_ascii());
        let lines: Vec<&str> = dxf.lines().collect();
        assert_eq!(lines.len() % 2, 0);
        let pairs: Vec<(u32, &str)> = lines.chunks(2).map(|p| (p[0].trim().parse().unwrap(), p[1])).collect();
        let mut handles = BTreeSet::new();
        for (code, value) in &pairs {
            if (*code == 5 || *code == 105) && *value != pairs[8].1 {
                assert!(handles.insert(*value), "handle {value} twice");
            }
        }
        let first = pairs.iter().position(|p| *p == (0, "LWPOLYLINE")).unwrap();
        let x = pairs[first..].iter().find(|p| p.0 == 10).unwrap().1;
        let y = pairs[first..].iter().find(|p| p.0 == 20).unwrap().1;
        assert_eq!(x.parse::<f64>().unwrap().to_bits(), (566_000.1f64 + 1e-9).to_bits());
        assert_eq!(y.parse::<f64>().unwrap().to_bits(), (0.1f64 + 0.2).to_bits());
        assert!(dxf.contains("\\U+0645"));
        assert_eq!(pairs.last(), Some(&(0, "EOF")));
    }
}
