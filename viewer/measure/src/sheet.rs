//! Drawings to scale, as the page asks for them ([`kilwa_measure::sheet`]).

use kilwa_measure::sheet::layout::{Layout, Title};
use kilwa_measure::sheet::paper::Paper;
use kilwa_measure::sheet::{Sheet, View, pdf};
use kilwa_pack::Index;
use serde::Deserialize;
use serde_json::{Value, json};

/// Widest part of a drawing and most rows of one, pixels.
const PART: [u32; 2] = [2048, 1024];

/// What the page asks for.
#[derive(Debug, Deserialize)]
struct Asked {
    view: String,
    scale: f64,
    dpi: u32,
    #[serde(default)]
    paper: Option<String>,
    #[serde(default)]
    bare: bool,
    title: String,
    /// Widest part that the graphics card draws, pixels.
    widest: u32,
}

/// A drawing: `size` in pixels, `paper` in mm, `pixelsPerMm`, `metresPerPixel`, `marks` (mm from the upper left corner), `pdf` (the same as operators, on a
/// page in points), `bands` of the picture from the top, each with its `top`, `rows` and `parts` (x, y, width, height in pixels, target, halfHeight in metres).
///
/// # Errors
/// A sentence, where the paper is too small or something cannot be.
pub fn sheet(index: &Index, asked: &str) -> Result<Value, String> {
    let asked: Asked = serde_json::from_str(asked).map_err(|e| e.to_string())?;
    if !(asked.scale.is_finite() && (0.01..=1e6).contains(&asked.scale)) {
        return Err("a scale such as 1:50 is wanted".to_owned());
    }
    if !(25..=2400).contains(&asked.dpi) {
        return Err("from 25 to 2400 dots per inch are possible".to_owned());
    }
    let view = View::from_name(&asked.view).ok_or("an oblique view has no scale")?;
    let paper = asked.paper.as_deref().map(Paper::parse).transpose()?;
    let m = index.metadata();
    let bounds = (m.bounds_min, m.bounds_max);
    let sheet =
        Sheet::new(view, bounds, (asked.scale, asked.dpi), paper.as_ref(), asked.bare).map_err(|e| e.to_string())?;
    let size = sheet.pixels().map_err(|e| e.to_string())?;
    let title = Title {
        name: asked.title,
        view,
        crs: m.crs.clone(),
        accuracy: m.capture_accuracy,
        identity: index.identity(),
        spacing: m.median_edge,
    };
    let layout = if asked.bare { Layout::default() } else { Layout::of(&sheet, &title) };
    let middle = std::array::from_fn(|i| f64::midpoint(m.bounds_min[i], m.bounds_max[i]));
    let [left, upper, right, lower] = sheet.window(size);
    let part = |at: [u32; 2], size: [u32; 2]| {
        let part = sheet.part(middle, at, size);
        json!({
            "x": at[0], "y": at[1], "width": size[0], "height": size[1],
            "target": part.target, "halfHeight": part.half_height,
        })
    };
    let wide = asked.widest.clamp(64, PART[0]);
    let bands: Vec<Value> = (0..size[1])
        .step_by(PART[1] as usize)
        .map(|top| {
            let rows = PART[1].min(size[1] - top);
            let (from, to) = (top.max(upper), (top + rows).min(lower));
            let across = (left..right).step_by(wide as usize).filter(|_| from < to);
            let parts: Vec<Value> = across.map(|x| part([x, from], [wide.min(right - x), to - from])).collect();
            json!({ "top": top, "rows": rows, "parts": parts })
        })
        .collect();
    Ok(json!({
        "size": size,
        "paper": sheet.paper,
        "pixelsPerMm": sheet.pixels_per_mm(),
        "metresPerPixel": sheet.metres_per_pixel(),
        "marks": layout.marks,
        "pdf": pdf::operators(&layout, sheet.paper[1] * pdf::POINTS),
        "bands": bands,
    }))
}
