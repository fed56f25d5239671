//! Material libraries (MTL): the diffuse colour (`Kd`) and picture (`map_Kd`) of each material.
//!
//! Input: the lines of the library. All other statements are passed over: they say how a surface shines, not which
//! colour it has. What cannot be understood is counted with its line, and the rest is read.

use super::lines::{Lines, number, numbers, word};
use crate::Diagnostics;
use crate::read::ReadError;
use crate::read::texture::Wrap;
use glam::DVec2;
use std::collections::{BTreeMap, HashMap};
use std::path::Path;
use std::sync::Arc;

/// A picture on a surface.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Map {
    /// As the library names it.
    pub(super) name: String,
    /// The library, and the line of it that names the picture.
    pub(super) library: Arc<Path>,
    pub(super) line: u64,
    /// What texture coordinates are multiplied by, and what is added then.
    pub(super) scale: DVec2,
    pub(super) offset: DVec2,
    pub(super) wrap: Wrap,
}

/// What a material says of colour.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Material {
    /// 8-bit sRGB.
    pub(super) color: Option<[u8; 3]>,
    pub(super) map: Option<Map>,
}

/// Bytes of a name that are kept.
pub(super) const LONGEST_NAME: usize = 4096;
/// Bytes that the names of pictures take together, at most.
const PICTURE_NAMES: usize = 16 << 20;

/// Read the `used` materials of a library; of two of one name the first stays.
pub(super) fn read(
    lines: &mut Lines<'_, '_>,
    library: &Path,
    used: &BTreeMap<String, u64>,
    materials: &mut HashMap<String, Material>,
    diagnostics: &mut Diagnostics,
) -> Result<(), ReadError> {
    let library: Arc<Path> = library.into();
    let mut names: usize = materials.values().filter_map(|m| m.map.as_ref()).map(|map| map.name.len()).sum();
    let mut current: Option<(String, Material)> = None;
    let mut keep = |material: Option<(String, Material)>| {
        if let Some((name, material)) = material
            && used.contains_key(&name)
        {
            materials.entry(name).or_insert(material);
        }
    };
    loop {
        let line_number = lines.next_number();
        let Some(line) = lines.next()? else { break };
        let (keyword, rest) = word(line);
        let understood = match keyword {
            b"newmtl" => {
                keep(current.take());
                current = Some((text(&rest[..rest.len().min(LONGEST_NAME)]), Material::default()));
                true
            }
            b"Kd" => match (&mut current, color(rest)) {
                (Some((_, material)), Some(color)) => {
                    material.color = Some(color);
                    true
                }
                _ => false,
            },
            b"map_Kd" => match (&mut current, map(rest, &library, line_number)) {
                (Some((name, material)), Some(map)) if names < PICTURE_NAMES => {
                    names += if used.contains_key(name) { map.name.len() } else { 0 };
                    material.map = Some(map);
                    true
                }
                _ => false,
            },
            _ => true,
        };
        if !understood {
            let place = || format!("{}, line {line_number}", library.display());
            diagnostics.add("colours of materials that cannot be understood", place);
        }
    }
    keep(current);
    Ok(())
}

/// The words of a name, as text.
pub(super) fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes.trim_ascii()).into_owned()
}

/// `Kd r [g b]`: one number is all three. `Kd spectral …` and `Kd xyz …` are not understood.
fn color(rest: &[u8]) -> Option<[u8; 3]> {
    let (mut rgb, n) = numbers::<3>(rest).ok()?;
    if n == 0 || rgb.iter().any(|v| !v.is_finite()) {
        return None;
    }
    if n < 3 {
        rgb = [rgb[0]; 3];
    }
    Some(rgb.map(|v| (v * 255.0).round().clamp(0.0, 255.0) as u8))
}

/// `map_Kd [options] name`: the name may hold spaces.
fn map(mut rest: &[u8], library: &Arc<Path>, line: u64) -> Option<Map> {
    let mut map = Map {
        name: String::new(),
        library: Arc::clone(library),
        line,
        scale: DVec2::ONE,
        offset: DVec2::ZERO,
        wrap: Wrap::Repeat,
    };
    loop {
        let (option, after) = word(rest);
        let (min, max) = match option {
            b"-blendu" | b"-blendv" | b"-cc" | b"-clamp" | b"-texres" | b"-imfchan" | b"-bm" | b"-boost" | b"-type" => {
                (1, 1)
            }
            b"-mm" => (2, 2),
            b"-o" | b"-s" | b"-t" => (1, 3),
            _ => break,
        };
        let mut values = Vec::new();
        rest = after;
        while values.len() < max {
            let (value, after) = word(rest);
            // The last word is the name, though it be a number.
            let is_last = after.trim_ascii().is_empty();
            if value.is_empty() || is_last || (values.len() >= min && number(value).is_none()) {
                break;
            }
            values.push(value);
            rest = after;
        }
        let first_two = |default: f64| {
            let at = |i: usize| values.get(i).and_then(|v| number(v)).filter(|v| v.is_finite()).unwrap_or(default);
            DVec2::new(at(0), at(1))
        };
        match option {
            b"-s" => map.scale = first_two(1.0),
            b"-o" => map.offset = first_two(0.0),
            b"-clamp" if values.first() == Some(&&b"on"[..]) => map.wrap = Wrap::Clamp,
            _ => {}
        }
    }
    map.name = text(&rest[..rest.len().min(LONGEST_NAME)]);
    (!map.name.is_empty()).then_some(map)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_before_an_image_name_are_parsed_and_the_name_may_contain_spaces() {
        let library: Arc<Path> = Path::new("a.mtl").into();
        let map = |line: &[u8]| map(line, &library, 1);
        let name = |line: &str| map(line.as_bytes()).unwrap();
        assert_eq!(name(" wall north.jpg ").name, "wall north.jpg");
        assert_eq!(name("-blendu on -mm 0 1 -bm 0.2 a b.png").name, "a b.png");
        let m = name("-s 2 3 1 -o 0.5 -clamp on 7.png");
        assert_eq!((m.scale, m.offset, m.wrap), (DVec2::new(2.0, 3.0), DVec2::new(0.5, 0.0), Wrap::Clamp));
        assert_eq!(m.name, "7.png");
        assert_eq!(name("-s 1 1 1 12").name, "12", "a name may look like a number");
        assert_eq!(map(b"  "), None);
    }

    #[test]
    fn a_single_colour_number_is_a_grey() {
        assert_eq!(color(b"0.5"), Some([128; 3]));
        assert_eq!(color(b"1 0 2"), Some([255, 0, 255]));
        assert_eq!(color(b"xyz 1 2 3"), None);
    }
}
