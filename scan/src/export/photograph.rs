//! The photographs of stations, inside an E57 file.

use super::Request;
use super::e57::{character_data, guid, transform};
use crate::ScanError;
use crate::photos::{PictureFormat, picture_size};
use crate::survey::{Camera, Photograph};
use e57::{
    CylindricalImageProperties, E57Writer, ImageFormat, ImageWriter, PinholeImageProperties, SphericalImageProperties,
    VisualReferenceImageProperties,
};
use kilwa_files::plain_file;
use kilwa_formats::read::{Place, ReadError};
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom, Write};
use std::path::Path;

/// The width of a pixel, metres. Only its ratio to the focal length means anything; a power of two does not change the digits of that.
const PIXEL: f64 = 1.0 / 262_144.0;

/// The photographs of the stations, each with the place of its station among them.
fn chosen<'a>(request: &'a Request<'_>) -> impl Iterator<Item = (usize, &'a Photograph)> {
    request.survey.photographs.iter().filter_map(|photograph| {
        let place = request.stations.iter().position(|station| photograph.station.as_ref() == Some(&station.name));
        place.map(|place| (place, photograph))
    })
}

/// Find out before anything is written whether all of them can be read.
pub(super) fn check(request: &Request<'_>) -> Result<(), ScanError> {
    for (_, photograph) in chosen(request) {
        Picture::open(&request.folder.join(&photograph.file))?;
    }
    Ok(())
}

/// Write the photographs of the stations, whose GUIDs are `guids`; returns how many there were.
pub(super) fn photographs<F: Read + Write + Seek>(
    request: &Request<'_>,
    guids: &[String],
    writer: &mut E57Writer<F>,
    failed: &dyn Fn(e57::Error) -> ScanError,
) -> Result<u64, ScanError> {
    let mut count = 0;
    for (station, photograph) in chosen(request) {
        let path = request.folder.join(&photograph.file);
        let mut picture = Picture::open(&path)?;
        let own = guid("photograph", &[guids[station].as_bytes(), photograph.file.as_bytes()]);
        let mut image = writer.add_image(&own).map_err(failed)?;
        image.set_pointcloud_guid(&guids[station]);
        if let Some(name) = path.file_stem() {
            image.set_name(&character_data(&name.to_string_lossy()));
        }
        if let Some(pose) = photograph.pose {
            image.set_transform(transform(pose));
        }
        picture.add(photograph, &mut image).map_err(failed)?;
        image.finalize().map_err(failed)?;
        count += 1;
    }
    Ok(count)
}

/// A file of a picture.
struct Picture {
    file: BufReader<File>,
    format: ImageFormat,
    size: [u32; 2],
}

impl Picture {
    fn open(path: &Path) -> Result<Self, ScanError> {
        let cannot = |source| ReadError::Open { file: path.to_owned(), source };
        let mut file = BufReader::new(plain_file::open(path).map_err(cannot)?);
        let Some((format, size)) = picture_size(&mut file).map_err(cannot)? else {
            let found = "neither the header of a JPEG file nor that of a PNG file";
            return Err(ScanError::malformed(path, Place::Byte(0), found, "a photograph that E57 can hold"));
        };
        file.seek(SeekFrom::Start(0)).map_err(cannot)?;
        let format = match format {
            PictureFormat::Jpeg => ImageFormat::Jpeg,
            PictureFormat::Png => ImageFormat::Png,
        };
        Ok(Self { file, format, size })
    }

    fn add<F: Read + Write + Seek>(
        &mut self,
        photograph: &Photograph,
        image: &mut ImageWriter<'_, F>,
    ) -> e57::Result<()> {
        let (format, file) = (self.format.clone(), &mut self.file);
        match photograph.camera {
            Some(Camera::Pinhole { size: [width, height], focal, center: [principal_x, principal_y] }) => {
                let focal_length = focal[0] * PIXEL;
                let (pixel_width, pixel_height) = (PIXEL, focal_length / focal[1]);
                let properties = PinholeImageProperties {
                    width,
                    height,
                    focal_length,
                    pixel_width,
                    pixel_height,
                    principal_x,
                    principal_y,
                };
                image.add_pinhole(format, file, properties, None)
            }
            Some(Camera::Spherical { size: [width, height], pixel: [pixel_width, pixel_height] }) => {
                let properties = SphericalImageProperties { width, height, pixel_width, pixel_height };
                image.add_spherical(format, file, properties, None)
            }
            Some(Camera::Cylindrical { size: [width, height], radius, center, pixel: [pixel_width, pixel_height] }) => {
                let principal_y = center;
                let properties =
                    CylindricalImageProperties { width, height, radius, principal_y, pixel_width, pixel_height };
                image.add_cylindrical(format, file, properties, None)
            }
            None => {
                let [width, height] = self.size;
                image.add_visual_reference(format, file, VisualReferenceImageProperties { width, height }, None)
            }
        }
    }
}
