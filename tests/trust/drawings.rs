//! Drawings are true to scale, also where other programs (Pillow, PDFium) open them.

use super::check_bound;
use super::opinions::python;
use super::phantoms::phantom;
use crate::support::{fails, json, text};

const MEASURE: &str = "
import sys, json
from PIL import Image, TiffImagePlugin
import pypdfium2
Image.MAX_IMAGE_PIXELS = None
def dark(im, row):
    line = im.crop((0, row, im.width, row + 1)).tobytes()
    r = [sum(line[3 * x:3 * x + 3]) for x in range(im.width)]
    xs = [x for x, v in enumerate(r) if v < 3 * 200]
    return [min(xs), max(xs) + 1] if xs else None
out = {}
bare = Image.open(sys.argv[1]).convert('RGB')
out['bare'] = [bare.width, bare.height]
out['cube'] = dark(bare, bare.height // 2)
png = Image.open(sys.argv[2]); out['dpi'] = png.info['dpi'][0]; png = png.convert('RGB')
mm = 150 / 25.4
out['bar'] = dark(png.crop((int(12 * mm), 0, int(80 * mm), png.height)), int(round((png.height / mm - 10 - 30 + 9 + 0.1) * mm)))
tif = Image.open(sys.argv[3])
out['same'] = tif.convert('RGB').tobytes() == png.tobytes()
out['scale'] = list(tif.tag_v2[33550]); out['tie'] = list(tif.tag_v2[33922]); out['keys'] = list(tif.tag_v2[34735])
page = pypdfium2.PdfDocument(sys.argv[4])[0]
out['page_mm'] = [x / 72 * 25.4 for x in page.get_size()]
pdf = page.render(scale=150 / 72).to_pil().convert('RGB')
out['pdf_bar'] = dark(pdf.crop((int(12 * mm), 0, int(80 * mm), pdf.height)), int(round((pdf.height / mm - 10 - 30 + 9 + 0.15) * mm)))
out['words'] = page.get_textpage().get_text_range()
print(json.dumps(out))
";

#[test]
fn drawings_are_to_scale_on_paper() {
    let p = phantom("cube", "utm");
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let plan = |out: &str, more: &[&str]| {
        let out = path(out);
        let fixed = ["render", text(&p.pack), "--view", "plan", "--scale", "1:10", "--dpi", "150", "-o", text(&out)];
        json(&[&fixed[..], &["--software", "--shading", "0"], more].concat())
    };
    let bare = plan("bare.png", &["--paper", "fit", "--bare"]);
    plan("sheet.png", &["--title", "Cube (1 m)"]);
    plan("sheet.tif", &["--title", "Cube (1 m)"]);
    let pdf = plan("sheet.pdf", &["--title", "Cube (1 m)"]);
    let pixel = bare["metres_per_pixel"].as_f64().unwrap();
    assert!((pixel - 0.0254 / 150.0 * 10.0).abs() < 1e-15);
    let world = std::fs::read_to_string(path("bare.pgw")).unwrap();
    let lines: Vec<f64> = world.lines().map(|l| l.parse().unwrap()).collect();
    // The cube's corner is at the phantom's position; the first pixel's middle half a pixel inside of the sheet's corner.
    let off = (lines[4] - p.at[0] - pixel * 0.5).abs().max((lines[5] - (p.at[1] + 1.0) + pixel * 0.5).abs());
    check_bound("world file of a plan at UTM coordinates, pixels", 1.0, off / pixel);
    let sheet = path("sheet.png");
    let Some(seen) =
        python(MEASURE, &[text(&path("bare.png")), text(&sheet), text(&path("sheet.tif")), text(&path("sheet.pdf"))])
    else {
        return;
    };
    let span = |k: &str| seen[k][1].as_f64().unwrap() - seen[k][0].as_f64().unwrap();
    check_bound("cube of 1 m in a plan 1:10 at 150 dpi, pixels from 590.55", 1.0, (span("cube") - 1.0 / pixel).abs());
    // 0.5 m at 1:10 are 50 mm of paper.
    let bar = 50.0 / 25.4 * 150.0;
    check_bound("scale bar of the PNG, pixels from its length", 0.5 + 1e-9, (span("bar") - bar).abs());
    check_bound(
        "scale bar of the PDF as PDFium draws it at 150 dpi, pixels from its length",
        1.5,
        (span("pdf_bar") - bar).abs(),
    );
    assert!((seen["dpi"].as_f64().unwrap() - 150.0).abs() < 0.1);
    assert_eq!(seen["same"], true, "PNG and TIFF hold the same pixels");
    check_bound("size of a pixel in the GeoTIFF, m", 1e-15, (seen["scale"][0].as_f64().unwrap() - pixel).abs());
    assert!(seen["tie"][3].as_f64().unwrap() < p.at[0] && seen["tie"][4].as_f64().unwrap() > p.at[1] + 1.0);
    let paper = pdf["paper_mm"][0].as_f64().unwrap();
    check_bound("width of the PDF's page, mm", 0.01, (seen["page_mm"][0].as_f64().unwrap() - paper).abs());
    let words = seen["words"].as_str().unwrap();
    assert!(words.contains("Cube (1 m)") && words.contains("1:10") && words.contains("Plan"), "{words}");
}

#[test]
fn impossible_drawings_are_refused_with_a_possible_alternative() {
    let p = phantom("cube", "origin");
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("x.png");
    let say = |more: &[&str]| fails(&[&["render", text(&p.pack), "-o", text(&out), "--software"], more].concat());
    assert!(say(&["--scale", "1:10", "--view", "iso"]).contains("no scale"));
    let large = say(&["--scale", "1:1", "--view", "plan", "--paper", "A4"]);
    assert!(large.contains("1000 x 1000 mm") && large.contains("1:10 would fit"), "{large}");
    let format = ["render", text(&p.pack), "-o", "x.jpg", "--scale", "1:10", "--view", "plan", "--software"];
    assert!(fails(&format).contains("must be .png, .pdf or .tif"));
    assert!(!out.exists());
}
