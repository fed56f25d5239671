//! Paper, and how a drawing of so many millimetres fits it.

use super::SheetError;
use super::layout::Frame;

/// Margin around the frame, mm.
pub const MARGIN: f64 = 10.0;
/// Space inside the frame for grid labels, mm.
pub const LABELS: f64 = 8.0;
/// Height of the strip with scale bar, north arrow and title block, mm.
pub const STRIP: f64 = 30.0;
/// The strip needs as much width, mm.
const STRIP_WIDTH: f64 = 170.0;

/// Sizes of ISO 216, landscape, mm.
const ISO: [(&str, [f64; 2]); 5] = [
    ("A4", [297.0, 210.0]),
    ("A3", [420.0, 297.0]),
    ("A2", [594.0, 420.0]),
    ("A1", [841.0, 594.0]),
    ("A0", [1189.0, 841.0]),
];

/// What `--paper` says.
#[derive(Debug, Clone, PartialEq)]
pub enum Paper {
    /// A size of ISO 216, turned as the drawing is.
    Iso([f64; 2]),
    /// Width and height, mm.
    Custom([f64; 2]),
    /// As large as the drawing.
    Fit,
}

impl Paper {
    /// By name, or two lengths.
    ///
    /// # Errors
    /// [`SheetError::NoPaper`], which says what is wanted.
    pub fn parse(text: &str) -> Result<Self, SheetError> {
        if text.eq_ignore_ascii_case("fit") {
            return Ok(Self::Fit);
        }
        if let Some((_, size)) = ISO.iter().find(|(name, _)| name.eq_ignore_ascii_case(text)) {
            return Ok(Self::Iso(*size));
        }
        let parts = text.trim_end_matches("mm").split_once(['x', 'X', '×']);
        let size = parts.and_then(|(w, h)| Some([w.trim().parse::<f64>().ok()?, h.trim().parse::<f64>().ok()?]));
        match size {
            Some(size) if size.iter().all(|x| x.is_finite() && (20.0..=50_000.0).contains(x)) => Ok(Self::Custom(size)),
            _ => Err(SheetError::NoPaper),
        }
    }
}

/// The paper and the frame in it for content of so many millimetres.
///
/// # Errors
/// [`SheetError::TooLarge`], with a scale that would fit.
pub fn choose(
    asked: Option<&Paper>,
    content: [f64; 2],
    bare: bool,
    scale: f64,
) -> Result<([f64; 2], Frame), SheetError> {
    let room = |paper: [f64; 2]| -> [f64; 2] {
        if bare {
            return paper;
        }
        [paper[0] - 2.0 * (MARGIN + LABELS), paper[1] - 2.0 * (MARGIN + LABELS) - STRIP]
    };
    let holds = |paper: [f64; 2]| {
        let r = room(paper);
        content[0] <= r[0] + 1e-9 && content[1] <= r[1] + 1e-9
    };
    let turned = |[w, h]: [f64; 2]| if holds([w, h]) { Some([w, h]) } else { Some([h, w]).filter(|p| holds(*p)) };
    let paper = match asked {
        Some(Paper::Custom(size)) => Some(*size).filter(|p| holds(*p)),
        Some(Paper::Iso(size)) => turned(*size),
        Some(Paper::Fit) if bare => Some(content.map(|x| x.max(1.0))),
        Some(Paper::Fit) => {
            let width = (content[0] + 2.0 * (MARGIN + LABELS)).max(STRIP_WIDTH + 2.0 * MARGIN);
            Some([width, content[1] + 2.0 * (MARGIN + LABELS) + STRIP])
        }
        None => ISO.iter().find_map(|(_, size)| turned(*size)),
    };
    let Some(paper) = paper else {
        let smaller =
            [1.0, 2.0, 5.0, 10.0, 20.0, 25.0, 50.0, 100.0, 200.0, 250.0, 500.0, 1000.0, 2000.0, 5000.0, 10_000.0];
        let largest = match asked {
            Some(Paper::Custom(size) | Paper::Iso(size)) => *size,
            _ => ISO[4].1,
        };
        let fits = |s: &f64| {
            let c = content.map(|x| x * scale / s);
            let r = room(largest);
            (c[0] <= r[0] && c[1] <= r[1])
                || (c[0] <= room([largest[1], largest[0]])[0] && c[1] <= room([largest[1], largest[0]])[1])
        };
        let fits = smaller.into_iter().find(|s| *s > scale && fits(s));
        return Err(SheetError::TooLarge { scale, width: content[0], height: content[1], fits });
    };
    let frame = if bare {
        Frame { left: 0.0, top: 0.0, width: paper[0], height: paper[1] }
    } else {
        Frame { left: MARGIN, top: MARGIN, width: paper[0] - 2.0 * MARGIN, height: paper[1] - 2.0 * MARGIN - STRIP }
    };
    Ok((paper, frame))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_smallest_paper_that_fits_is_chosen_and_a_drawing_too_large_is_refused_with_a_hint() {
        assert_eq!(choose(None, [200.0, 100.0], false, 50.0).unwrap().0, [297.0, 210.0]);
        assert_eq!(choose(None, [100.0, 210.0], false, 50.0).unwrap().0, [210.0, 297.0]);
        let message = choose(None, [3000.0, 100.0], false, 50.0).unwrap_err().to_string();
        assert!(message.contains("1:200 would fit"), "{message}");
        let (paper, frame) = choose(Some(&Paper::Fit), [3000.0, 100.0], false, 50.0).unwrap();
        assert!(paper[0] > 3000.0 && frame.width > 3000.0);
        assert_eq!(choose(Some(&Paper::Fit), [30.0, 20.0], true, 50.0).unwrap().0, [30.0, 20.0]);
    }

    #[test]
    fn paper_is_given_by_name_or_by_size() {
        assert_eq!(Paper::parse("a3"), Ok(Paper::Iso([420.0, 297.0])));
        assert_eq!(Paper::parse("900x600mm"), Ok(Paper::Custom([900.0, 600.0])));
        assert_eq!(Paper::parse("fit"), Ok(Paper::Fit));
        assert!(Paper::parse("B5").is_err() && Paper::parse("0x10").is_err());
    }
}
