//! LAS and LAZ (ASPRS, "LAS Specification 1.4"), by the crates `las` and `laz`. They have no grid and no scanner: the position must be given.
//!
//! Colours have 16 bits; many programs write 8 into them. So a file with colours is read twice: if no value exceeds 255, they are taken as they are.

mod bounds;
mod layered;

use super::{Frame, Head, Input, too_far};
use crate::ScanError;
use crate::spool::Layout;
use glam::DVec3;
use kilwa_formats::read::{Place, ReadError};
use kilwa_pack::plural::counted;
use kilwa_scan_core::{Grid, Kind, Pose, Rays, Sample, State};
use las::{PointData, Reader};
use std::cell::Cell;
use std::io::{BufReader, Seek};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Once;

/// Points decoded at a time, at most, and their bytes.
const BATCH: u64 = 16_384;
const BATCH_BYTES: u64 = 4 << 20;

pub(super) fn read(input: &mut Input<'_>) -> Result<(), ScanError> {
    if input.options.station.is_none() {
        return Err(ScanError::NoStation { file: input.path.to_owned() });
    }
    let mut points = open(input)?;
    let header = points.header().clone();
    let count = header.number_of_points();
    let format = *header.point_format();
    let least = u64::from(format.len());
    let held = if format.is_compressed { u64::MAX } else { input.total / least.max(1) };
    if count == 0 {
        return Err(ScanError::Nothing { file: input.path.to_owned(), what: "it holds no points".to_owned() });
    }
    if count > held || count > u64::from(u32::MAX) {
        let found = format!("{} in the header", counted(count, "point", "points"));
        let most = held.min(u64::from(u32::MAX));
        return Err(ScanError::malformed(
            input.path,
            Place::Byte(0),
            found,
            format!("at most {most}; the file is truncated, or must be split"),
        ));
    }
    let frame = Frame::unplaced(input.options, input.options.units.metres());
    let pose = Some(frame.pose(Pose::default()));
    let head = Head { pose, crs: crs(&header), is_position_given: true, samples: Some(count), ..Head::default() };
    if !input.sink.begin(&head)? {
        return Ok(());
    }
    let shift = if format.has_color { color_shift(input, count)? } else { 0 };
    let mut done = 0;
    batches(&mut points, count, input.path, &mut |points, from| {
        let mut colors = points.rgb();
        let positions = points.x().zip(points.y()).zip(points.z());
        for (((position, intensity), number), k) in
            positions.zip(points.intensity()).zip(points.return_number()).zip(0..)
        {
            let ((x, y), z) = position;
            // In LAZ, points have no byte of their own.
            let at = || if format.is_compressed { from } else { from + least * (done + k) };
            let far = |metres| too_far(input.path, Place::Byte(at()), metres);
            let position = frame.place(DVec3::new(x, y, z)).map_err(far)?;
            let color = colors.as_mut().and_then(Iterator::next);
            let state = State::new(Kind::Measured, color.is_some(), number);
            let color = color.map_or([0; 3], |(r, g, b)| [r, g, b].map(|v| (v >> shift) as u8));
            input.sink.push(&Sample { position, intensity: f32::from(intensity), color, state })?;
        }
        done += points.len() as u64;
        input.sink.progress((done as f64 / count as f64 * input.total as f64) as u64)
    })?;
    let layout =
        Layout { grid: Grid::by_columns(1, count as u32), is_grid: false, rays: Rays::Central, origin: frame.origin };
    input.sink.end(layout)?;
    input.sink.progress(input.total)
}

/// The points of an open file.
enum Points {
    /// Those that `las` reads, and the byte where they begin.
    Plain(Reader, u64),
    Layered(Box<layered::Layered>),
}

impl Points {
    fn header(&self) -> &las::Header {
        match self {
            Self::Plain(reader, _) => reader.header(),
            Self::Layered(reader) => reader.header(),
        }
    }

    /// The next points, at most `count`.
    fn read(&mut self, count: u64) -> las::Result<PointData> {
        match self {
            Self::Plain(reader, _) => reader.read_points(count),
            Self::Layered(reader) => reader.read_points(count),
        }
    }

    /// The first byte of the points, or of their chunk.
    fn at(&self) -> u64 {
        match self {
            Self::Plain(_, at) => *at,
            Self::Layered(reader) => reader.at(),
        }
    }
}

fn open(input: &Input<'_>) -> Result<Points, ScanError> {
    let cannot = |source| ReadError::Open { file: input.path.to_owned(), source };
    let mut file = kilwa_files::plain_file::open(input.path).map_err(cannot)?;
    let layers = bounds::layers(&mut file, input.total).map_err(|bounds::Excess { at, found, expected }| {
        ScanError::malformed(input.path, Place::Byte(at), found, expected)
    })?;
    let at = bounds::number(&mut file, 96, 4).unwrap_or(0);
    file.rewind().map_err(cannot)?;
    let opened = survived(|| match layers {
        Some(layers) => {
            layered::Layered::new(file, input.total, layers).map(|reader| Points::Layered(Box::new(reader)))
        }
        None => Reader::new(BufReader::with_capacity(1 << 20, file)).map(|reader| Points::Plain(reader, at)),
    });
    opened.map_err(|e| damaged(input.path, 0, 0, &e))
}

thread_local! {
    /// Whether this thread is in a call whose panics are errors.
    static IS_SURVIVING: Cell<bool> = const { Cell::new(false) };
}

/// What a call of the crates gives: on some damaged files they panic (`las` 0.11.2, by arithmetic on the header), which is an error here, and
/// nothing is printed.
fn survived<T>(call: impl FnOnce() -> las::Result<T>) -> Result<T, String> {
    static QUIET: Once = Once::new();
    QUIET.call_once(|| {
        let before = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            if !IS_SURVIVING.get() {
                before(panic);
            }
        }));
    });
    IS_SURVIVING.set(true);
    let result = catch_unwind(AssertUnwindSafe(call));
    IS_SURVIVING.set(false);
    match result {
        // Errors of the system are wrapped by name.
        Ok(result) => result.map_err(|e| e.to_string().trim_start_matches("IoError: ").to_owned()),
        Err(_) => Err("numbers that contradict each other".to_owned()),
    }
}

fn damaged(path: &Path, at: u64, point: u64, e: &str) -> ScanError {
    let place = if point == 0 { "its header or its first points".to_owned() } else { format!("after point {point}") };
    ScanError::malformed(
        path,
        Place::Byte(at),
        format!("{e} ({place})"),
        "a valid LAS or LAZ file; it is truncated or damaged: copy or export it again",
    )
}

/// Decode all points in batches, and visit each batch with the first byte of its points, or of their chunk.
fn batches(
    points: &mut Points,
    count: u64,
    path: &Path,
    visit: &mut dyn FnMut(&PointData, u64) -> Result<(), ScanError>,
) -> Result<(), ScanError> {
    let mut done = 0;
    let batch = (BATCH_BYTES / u64::from(points.header().point_format().len()).max(1)).clamp(1, BATCH);
    while done < count {
        let read = survived(|| points.read(batch.min(count - done)));
        let read = read.map_err(|e| {
            let at = if let Points::Layered(reader) = points { reader.at() } else { 0 };
            damaged(path, at, done, &e)
        })?;
        if read.is_empty() {
            let found = format!("the end of the file after {}", counted(done, "point", "points"));
            return Err(ScanError::malformed(path, Place::Byte(0), found, format!("{count}, as the header announces")));
        }
        done += read.len() as u64;
        visit(&read, points.at())?;
    }
    // Layers have no checksum; a wrong length shows only here.
    if let Points::Layered(reader) = points
        && reader.begun() != count
    {
        let found = format!("chunks of {} in all", counted(reader.begun(), "point", "points"));
        let expected = format!("{count}, as the header states; the file is damaged: copy or export it again");
        return Err(ScanError::malformed(path, Place::Byte(reader.at()), found, expected));
    }
    Ok(())
}

/// By how many bits colours must be shifted to have 8.
fn color_shift(input: &Input<'_>, count: u64) -> Result<u32, ScanError> {
    let mut largest = 0;
    let mut points = open(input)?;
    batches(&mut points, count, input.path, &mut |points, _| {
        for (r, g, b) in points.rgb().into_iter().flatten() {
            largest = largest.max(r).max(g).max(b);
        }
        Ok(())
    })?;
    Ok(if largest > 255 { 8 } else { 0 })
}

/// The coordinate reference system: WKT as it stands, or the EPSG code of GeoTIFF keys.
fn crs(header: &las::Header) -> Option<String> {
    if let Some(wkt) = header.get_wkt_crs_bytes() {
        let text = String::from_utf8_lossy(wkt).trim_matches(['\0', ' ', '\n']).to_owned();
        return Some(text).filter(|text| !text.is_empty());
    }
    let keys = header.get_geotiff_crs().ok().flatten()?;
    let code = keys.get_projected_crs_geo_key_value().or_else(|| keys.get_geodetic_crs_geo_key_value())?;
    // 32767 stands for "user-defined".
    (code != 0 && code != 32_767).then(|| format!("EPSG:{code}"))
}
