//! Colours in the attribute bytes of binary facets. There are two conventions, both with five bits a channel:
//!
//! * VisCAM and SolidView: bit 15 set says that there is a colour; blue in bits 0 to 4, green in 5 to 9, red in 10 to 14.
//! * Materialise Magics: the header has "COLOR=" and four bytes, the colour of the object; a facet whose bit 15 is *not*
//!   set has a colour of its own, red in bits 0 to 4, green in 5 to 9, blue in 10 to 14. Opacity is not kept.
//!
//! Some programs write the header of Magics and leave all attributes zero, which would be a black object: where every
//! attribute is zero, the colour of the object counts.

/// How attribute bytes are understood.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Colors {
    /// VisCAM and SolidView.
    VisCam,
    /// Materialise Magics, with the colour of the object.
    Magics([u8; 3]),
    /// Every facet has the colour of the object.
    Object([u8; 3]),
}

impl Colors {
    /// As the free text at the beginning of the file says.
    pub(super) fn of_header(header: &[u8]) -> Self {
        let key = b"COLOR=";
        let at = header.windows(key.len()).position(|w| w == key).map(|at| at + key.len());
        match at.and_then(|at| header.get(at..at + 4)) {
            Some(&[r, g, b, _]) => Self::Magics([r, g, b]),
            _ => Self::VisCam,
        }
    }

    /// The colour of a facet with these attribute bytes.
    pub(super) fn of_facet(self, attribute: u16) -> Option<[u8; 3]> {
        let low_first = [0, 5, 10].map(|shift| eight_bits(attribute >> shift & 31));
        let marked = attribute & 0x8000 != 0;
        match self {
            Self::VisCam => marked.then(|| [low_first[2], low_first[1], low_first[0]]),
            Self::Magics(object) if marked => Some(object),
            Self::Magics(_) => Some(low_first),
            Self::Object(object) => Some(object),
        }
    }
}

/// Five bits as eight: 0 stays 0 and 31 becomes 255.
fn eight_bits(five: u16) -> u8 {
    ((five * 255 + 15) / 31) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn viscam_stores_red_in_the_high_bits_and_magics_in_the_low_bits() {
        let red_high = 0x8000 | 31 << 10;
        assert_eq!(Colors::VisCam.of_facet(red_high), Some([255, 0, 0]));
        assert_eq!(Colors::VisCam.of_facet(31 << 10), None, "bit 15 says whether there is a colour");
        let magics = Colors::of_header(b"COLOR=\x01\x02\x03\xff,MATERIAL=");
        assert_eq!(magics, Colors::Magics([1, 2, 3]));
        assert_eq!(magics.of_facet(31), Some([255, 0, 0]));
        assert_eq!(magics.of_facet(0x8000), Some([1, 2, 3]));
    }

    #[test]
    fn a_truncated_colour_in_the_header_is_ignored() {
        assert_eq!(Colors::of_header(b"COLOR=\x01\x02"), Colors::VisCam);
    }
}
