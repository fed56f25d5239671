//! The ground truth of the photographs, as TOML.

use super::PhotoOptions;
use super::colmap::Model;
use super::session::Session;
use crate::scans::truth::rows;
use std::fmt::Write as _;

/// Counts of a picture's pixels.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Counts {
    pub(super) pixels: u64,
    pub(super) surface: u64,
    pub(super) people: u64,
}

/// `truth/photos.toml`.
pub(super) fn photos(options: &PhotoOptions, session: &Session, model: &Model, counts: &[Counts]) -> String {
    let mut text = String::from("# The ground truth of simulated photographs (kilwa synth photos). No real place.\n");
    let mut line = |what: std::fmt::Arguments<'_>| {
        let _ = text.write_fmt(what);
        text.push('\n');
    };
    line(format_args!("seed = {}\nunits = \"metre\"\nnoise = {:?}", options.seed, options.noise));
    let frame = model.frame.inverse();
    line(format_args!("\n# Takes coordinates of photos/sparse to those of the survey: scale · rotation · p + shift"));
    line(format_args!("[survey_from_sparse]\nscale = {:?}\nrotation = {}", frame.scale, rows(&frame.rotation)));
    line(format_args!("shift = [{:?}, {:?}, {:?}]", frame.shift.x, frame.shift.y, frame.shift.z));
    for (k, (photo, counts)) in session.photos().iter().zip(counts).enumerate() {
        let (width, height) = photo.size();
        let p = photo.position;
        let folder = super::write::folder(photo.carrier);
        line(format_args!("\n[[photo]]\nname = \"{}\"\nfile = \"{folder}/{}.jpg\"", photo.name, photo.name));
        line(format_args!("carrier = \"{}\"\nwidth = {width}\nheight = {height}", photo.carrier.name()));
        line(format_args!("# site_from_camera"));
        line(format_args!("position = [{:.9}, {:.9}, {:.9}]\nrotation = {}", p.x, p.y, p.z, rows(&photo.rotation)));
        let exposure = &photo.exposure;
        let [red, green, blue] = exposure.white_balance;
        let [a, b, c] = exposure.vignette;
        line(format_args!("ev = {:?}\nwhite_balance = [{red:?}, {green:?}, {blue:?}]", exposure.ev));
        line(format_args!("vignette = [{a:?}, {b:?}, {c:?}]"));
        let (azimuth, elevation) = photo.sun;
        line(format_args!("hour = {:.4}", photo.hour));
        line(format_args!(
            "sun_azimuth_degrees = {:.4}\nsun_elevation_degrees = {:.4}",
            azimuth.to_degrees().rem_euclid(360.0),
            elevation.to_degrees()
        ));
        if let Some(given) = model.given.get(k) {
            let turned = given.rotation.transpose() * photo.rotation;
            let angle =
                libm::acos((0.5 * (turned.x_axis.x + turned.y_axis.y + turned.z_axis.z - 1.0)).clamp(-1.0, 1.0));
            line(format_args!("pose_error_px = {:.3}", given.error));
            line(format_args!("pose_error_m = {:.6}", given.position.distance(photo.position)));
            line(format_args!("pose_error_degrees = {:.6}", angle.to_degrees()));
        }
        line(format_args!("surface_pixels = {}\npeople_pixels = {}", counts.surface, counts.people));
    }
    text
}
