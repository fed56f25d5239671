//! Traces of a location in files: its numbers in the forms of text and binary formats. Independent of the search in the program,
//! so that each checks the other.
//!
//! A file is looked at as it is, and as far as it is compressed or encoded, as what is in it: packs chunk by chunk, previews vertex by vertex,
//! pictures with their compressed chunks, text with the encodings of addresses and HTML taken off.

use kilwa_pack::{Reader, SliceSource};
use std::collections::HashMap;
use std::io::Read as _;

/// The location of a model, and what reveals it.
pub(crate) struct Traces {
    /// Eastings and northings, metres.
    pub(crate) map: Vec<f64>,
    /// Latitudes and longitudes, degrees.
    pub(crate) degrees: Vec<f64>,
    /// Words, in lower case: codes, hashes, names of files.
    pub(crate) words: Vec<String>,
}

impl Traces {
    /// What a file reveals of the location; `name` gives its format.
    pub(crate) fn found(&self, name: &str, bytes: &[u8]) -> Option<String> {
        let ending = name.rsplit('.').next().unwrap_or_default();
        let inside = match ending {
            "kilwa" => self.in_pack(bytes),
            "glb" => self.in_preview(bytes),
            // Among megabytes of pixels four bytes are some number by chance.
            "png" => png_parts(bytes).iter().find_map(|part| self.in_text(part)),
            "pgw" => String::from_utf8_lossy(bytes).lines().find_map(|l| {
                let v = l.trim().parse::<f64>().ok()?;
                self.map.iter().any(|x| (v - x).abs() < 1000.0).then(|| format!("the number {v}"))
            }),
            _ => None,
        };
        inside.or_else(|| self.in_text(bytes)).or_else(|| self.in_numbers(bytes))
    }

    /// Numbers as digits that text may have, lower-case words.
    fn forms(&self) -> Vec<String> {
        let mut all = self.words.clone();
        for x in &self.map {
            let whole = format!("{}", x.abs().trunc());
            all.push(whole.clone());
            // Without false easting and northing.
            for less in [5e5, 1e7] {
                let rest = (x.abs() - less).abs().trunc();
                if rest >= 10_000.0 && rest < x.abs() {
                    all.push(format!(" {rest}"));
                }
            }
            all.push(format!("{:.3}", x.abs() / 1000.0));
            all.push(format!("{:.0}", (x.abs() / 0.3048).trunc()));
        }
        for d in &self.degrees {
            let d = d.abs();
            // Cut off and rounded; what has more digits begins with one of them.
            let cut = (d * 1e4).trunc() / 1e4;
            for digits in [format!("{cut:.4}"), format!("{d:.4}"), format!("{d:.3}")] {
                let enough = digits.len() >= 6;
                all.extend([digits.replace('.', ","), digits].into_iter().filter(|_| enough));
            }
            let (whole, minutes, seconds) = (d.trunc(), (d * 60.0 % 60.0).trunc(), (d * 3600.0 % 60.0).trunc());
            for form in [
                format!("{whole}°{minutes:02}"),
                format!("{whole}° {minutes:02}"),
                format!("{whole}d{minutes:02}"),
                format!("{whole}:{minutes:02}:{seconds:02}"),
                format!("{whole:02}{minutes:02}{seconds:02}s"),
                format!("{whole:03}{minutes:02}{seconds:02}e"),
                format!("{whole} deg {minutes}"),
            ] {
                all.push(form);
            }
        }
        all
    }

    fn in_text(&self, bytes: &[u8]) -> Option<String> {
        let forms = self.forms();
        let as_is = bytes.to_ascii_lowercase();
        let mut variants = vec![as_is.clone()];
        if std::str::from_utf8(bytes).is_ok() {
            let text = String::from_utf8_lossy(&as_is).into_owned();
            let decoded = text.replace("%2e", ".").replace("%2c", ",").replace("%20", " ").replace("%c2%b0", "°");
            let plain =
                decoded.replace("&deg;", "°").replace("&#176;", "°").replace(['\u{202f}', '\u{a0}', '\u{2009}'], " ");
            let joined: String = plain.chars().filter(|c| !" ,'_".contains(*c)).collect();
            let pointless: String = plain.chars().filter(|c| !".,".contains(*c)).collect();
            variants.extend([plain.into_bytes(), joined.into_bytes(), pointless.into_bytes()]);
        }
        // By their first four bytes: there are many forms and megabytes of text.
        let mut starts: HashMap<&[u8], Vec<&str>> = HashMap::new();
        for form in &forms {
            starts.entry(&form.as_bytes()[..4]).or_default().push(form);
        }
        for (i, text) in variants.iter().enumerate() {
            for (at, start) in text.windows(4).enumerate() {
                for form in starts.get(start).into_iter().flatten().filter(|f| text[at..].starts_with(f.as_bytes())) {
                    // Not in the middle of a hash or of a longer number; where separators are gone, words are beside.
                    let is_digit = |b: &u8| if i == 0 { b.is_ascii_hexdigit() } else { b.is_ascii_digit() };
                    let beside = |at: Option<usize>| at.and_then(|at| text.get(at)).is_some_and(is_digit);
                    let is_number = form.bytes().all(|b| b.is_ascii_digit() || b == b'.' || b == b',');
                    let goes_on = !form.contains(['.', ',']) && beside(Some(at + form.len()));
                    if !is_number || !(beside(at.checked_sub(1)) || goes_on) {
                        return Some(format!("the text {form:?}"));
                    }
                }
            }
        }
        None
    }

    /// Doubles, floats and integers in both byte orders: metres, millimetres, degrees, radians, ten-millionths of a degree.
    fn in_numbers(&self, bytes: &[u8]) -> Option<String> {
        let mut wide = Vec::new();
        for x in &self.map {
            wide.push((*x, 0.01));
        }
        for d in &self.degrees {
            wide.extend([(*d, 1e-6), (d.to_radians(), 1e-8)]);
        }
        for w in bytes.windows(8) {
            let w: [u8; 8] = w.try_into().unwrap();
            // Few eight bytes are a number of this size.
            let values = [f64::from_le_bytes(w), f64::from_be_bytes(w)].into_iter();
            for value in values.filter(|v| (1e-3..1e8).contains(&v.abs())) {
                if let Some((x, _)) = wide.iter().find(|(x, near)| (value - x).abs() < *near) {
                    return Some(format!("a double of {x}"));
                }
            }
        }
        let mut integers: Vec<i64> =
            self.map.iter().flat_map(|x| [x.trunc() as i64, (x * 1000.0).round() as i64]).collect();
        integers.extend(self.degrees.iter().map(|d| (d * 1e7).round() as i64));
        let mut patterns: Vec<(Vec<u8>, String)> = Vec::new();
        for i in integers {
            patterns.push((i.to_le_bytes().to_vec(), format!("an integer of {i}")));
            patterns.push((i.to_be_bytes().to_vec(), format!("an integer of {i}")));
            if let Ok(short) = i32::try_from(i) {
                patterns.push((short.to_le_bytes().to_vec(), format!("an integer of {i}")));
                patterns.push((short.to_be_bytes().to_vec(), format!("an integer of {i}")));
            }
        }
        for x in self.map.iter().chain(&self.degrees) {
            let single = *x as f32;
            for near in [single.next_down(), single, single.next_up()] {
                patterns.push((near.to_le_bytes().to_vec(), format!("a float of {x}")));
                patterns.push((near.to_be_bytes().to_vec(), format!("a float of {x}")));
            }
        }
        let mut starts: HashMap<&[u8], Vec<&(Vec<u8>, String)>> = HashMap::new();
        // Integers of eight bytes begin, or end, with zeros.
        for pattern in &patterns {
            starts.entry(&pattern.0[..4]).or_default().push(pattern);
        }
        for (at, start) in bytes.windows(4).enumerate() {
            let of = starts.get(start).into_iter().flatten();
            if let Some((_, what)) = of.into_iter().find(|(p, _)| bytes[at..].starts_with(p)) {
                return Some(what.clone());
            }
        }
        None
    }

    /// Decoded: metadata, lattice, every vertex and every value of every channel.
    fn in_pack(&self, bytes: &[u8]) -> Option<String> {
        let pack = Reader::open(SliceSource(bytes)).expect("a sound pack");
        let metadata = serde_json::to_string(pack.metadata()).unwrap();
        if let Some(what) = self.in_text(metadata.as_bytes()) {
            return Some(format!("{what} in the metadata"));
        }
        let near = |v: f64| {
            self.map.iter().any(|x| (v - x).abs() < 1000.0)
                || self.map.iter().any(|x| (v * 0.3048 - x).abs() < 1000.0 || (v * 1000.0 - x).abs() < 1000.0)
                || self.degrees.iter().any(|d| (v - d).abs() < 0.001)
        };
        let lattice = pack.header().lattice;
        for index in 0..pack.entries().len() as u32 {
            let mesh = pack.chunk(index).expect("sound").mesh;
            for p in &mesh.positions {
                let world = lattice.world_from_lattice(*p);
                if (0..2).any(|k| self.map.iter().any(|x| (world[k] - x).abs() < 1000.0)) {
                    return Some(format!("a vertex at {world:?}"));
                }
            }
            for (channel, values) in pack.metadata().scalars.iter().zip(&mesh.scalars) {
                if let Some(v) = values.iter().find(|v| near(f64::from(**v))) {
                    return Some(format!("{v} in the channel {}", channel.name));
                }
            }
        }
        None
    }

    /// Decoded: every float of the binary chunk.
    fn in_preview(&self, bytes: &[u8]) -> Option<String> {
        let json = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        let value: serde_json::Value = serde_json::from_slice(&bytes[20..20 + json]).unwrap();
        let text = value.to_string();
        let floats = bytes[28 + json..].chunks_exact(4).map(|b| f64::from(f32::from_le_bytes(b.try_into().unwrap())));
        let large = floats.into_iter().find(|v| self.map.iter().any(|x| (v - x).abs() < 100.0));
        self.in_text(text.as_bytes()).or_else(|| large.map(|v| format!("the float {v}")))
    }
}

/// The compressed parts of a PNG, decompressed: its pixels and its texts.
fn png_parts(bytes: &[u8]) -> Vec<Vec<u8>> {
    let (mut at, mut pixels, mut parts) = (8, Vec::new(), Vec::new());
    let inflated = |data: &[u8]| {
        let mut out = Vec::new();
        drop(flate2::read::ZlibDecoder::new(data).read_to_end(&mut out));
        out
    };
    while at + 12 <= bytes.len() {
        let length = u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        let (kind, data) = (&bytes[at + 4..at + 8], &bytes[at + 8..at + 8 + length]);
        match kind {
            b"IDAT" => pixels.extend_from_slice(data),
            // Keyword, zero, method, text; any place where it may begin.
            b"zTXt" | b"iCCP" | b"iTXt" => {
                parts.extend((0..data.len().min(90)).map(|from| inflated(&data[from..])).filter(|p| !p.is_empty()));
            }
            _ => {}
        }
        at += 12 + length;
    }
    parts.push(inflated(&pixels));
    parts
}
