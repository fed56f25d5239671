//! How the model is shown, as people and links say it: names, metres in world coordinates, degrees. One compact JSON object that
//! leaves out what is as usual; the page keeps it in the address, `kilwa render --display` reads it.
//!
//! [`Display::options`] converts it to the renderer's options, in lattice units. Reading refuses what is not finite or out of
//! range, with a sentence that names the field.

use crate::camera::Bounds;
use crate::filled::CHANNELS;
use crate::options::{Background, Light, Mode, RenderOptions, Scale};
use crate::section::{Clip, ClipState, half_space};
use glam::DVec3;
use kilwa_geometry::Lattice;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Why a description of the display was refused.
#[derive(Debug, Error)]
pub enum DisplayError {
    /// It is no JSON of this shape.
    #[error("these are not valid display settings: {0}")]
    Json(#[from] serde_json::Error),
    /// A value that cannot be.
    #[error("{field}: {rule}")]
    Value {
        /// Its name.
        field: &'static str,
        /// What it has to be.
        rule: &'static str,
    },
}

/// The raking light, degrees.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "camelCase")]
pub struct LightAngles {
    /// Where it comes from: degrees from north, clockwise; or from the top of the picture.
    pub azimuth: f64,
    /// Degrees above the horizon, or above the plane of the picture.
    pub elevation: f64,
    /// It turns with the view.
    #[serde(default, skip_serializing_if = "is_default")]
    pub with_view: bool,
}

impl Default for LightAngles {
    fn default() -> Self {
        Self { azimuth: 315.0, elevation: 20.0, with_view: false }
    }
}

pub use kilwa_measure::clip::{WorldBox as SectionBox, WorldPlane as Plane};

/// How the model is shown.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "camelCase", default)]
#[expect(clippy::struct_excessive_bools, reason = "each is a switch of the display")]
pub struct Display {
    /// Name of the mode ([`Mode::ALL`]).
    #[serde(skip_serializing_if = "is_colour")]
    pub mode: String,
    /// The raking light.
    #[serde(skip_serializing_if = "is_default")]
    pub light: LightAngles,
    /// Modes of light shine on the scan's colours instead of a neutral surface.
    #[serde(skip_serializing_if = "is_default")]
    pub on_colour: bool,
    /// Lamp at the eye on colours, 0 to 1.
    #[serde(skip_serializing_if = "is_usual_shading")]
    pub shading: f64,
    /// Strength of curvature and eye-dome lighting, 0 to 1.
    #[serde(skip_serializing_if = "is_usual_strength")]
    pub strength: f64,
    /// Radius of eye-dome lighting, CSS pixels, 1 to 8.
    #[serde(skip_serializing_if = "is_usual_radius")]
    pub radius: f64,
    /// Size of what curvature shows, metres; usually a share of the model's size.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub feature: Option<f64>,
    /// The plane that `distance` counts from; usually the horizontal one through the lowest point.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub plane: Option<Plane>,
    /// Where the colours of height and distance begin and end, metres; usually what the model has.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub range: Option<[f64; 2]>,
    /// Name of the scalar channel; usually confidence or quality, else the first.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub channel: Option<String>,
    /// Where the scalar's colours begin and end; usually the channel's own range.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub channel_range: Option<[f64; 2]>,
    /// Hide the surface that a merge filled ([`crate::filled`]).
    #[serde(skip_serializing_if = "is_default")]
    pub hide_filled: bool,
    /// Mark the inside of the surface.
    #[serde(skip_serializing_if = "is_true")]
    pub back_faces: bool,
    /// `auto` (by the theme), `light`, `dark`, `white`, `black`, `transparent`, or a colour such as `#ffffff`.
    #[serde(skip_serializing_if = "is_auto")]
    pub background: String,
    /// Levels fade into each other; `null` as the system asks for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fade: Option<bool>,
    /// Cuts away the side that its normal points to.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clip_plane: Option<Plane>,
    /// Cuts away what lies outside (or inside).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clip_box: Option<SectionBox>,
    /// Draw a line where the surface is cut.
    #[serde(skip_serializing_if = "is_true")]
    pub outline: bool,
}

impl Default for Display {
    fn default() -> Self {
        Self {
            mode: "colour".to_owned(),
            light: LightAngles::default(),
            on_colour: false,
            shading: 0.35,
            strength: 0.5,
            radius: 3.0,
            feature: None,
            plane: None,
            range: None,
            channel: None,
            channel_range: None,
            hide_filled: false,
            back_faces: true,
            background: "auto".to_owned(),
            fade: None,
            clip_plane: None,
            clip_box: None,
            outline: true,
        }
    }
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}
fn is_colour(mode: &str) -> bool {
    mode == "colour"
}
fn is_auto(background: &str) -> bool {
    background == "auto"
}
#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde hands references")]
fn is_true(value: &bool) -> bool {
    *value
}
#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde hands references")]
fn is_usual_shading(value: &f64) -> bool {
    *value == 0.35
}
#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde hands references")]
fn is_usual_strength(value: &f64) -> bool {
    *value == 0.5
}
#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde hands references")]
fn is_usual_radius(value: &f64) -> bool {
    *value == 3.0
}

/// Largest coordinate that is taken, metres: beyond it no reference system has places.
const FAR: f64 = 1e9;

impl Display {
    /// Read the JSON form.
    ///
    /// # Errors
    /// [`DisplayError`].
    pub fn from_json(text: &str) -> Result<Self, DisplayError> {
        let display: Self = serde_json::from_str(text)?;
        display.check()?;
        Ok(display)
    }

    /// The JSON form, without what is as usual.
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).unwrap_or_default()
    }

    /// Whether everything in it can be.
    ///
    /// # Errors
    /// [`DisplayError::Value`].
    pub fn check(&self) -> Result<(), DisplayError> {
        let need = |holds: bool, field, rule| if holds { Ok(()) } else { Err(DisplayError::Value { field, rule }) };
        let share = |x: f64| (0.0..=1.0).contains(&x);
        need(Mode::from_name(&self.mode).is_some(), "mode", "no mode is called so")?;
        need(background(&self.background, false).is_some(), "background", "no background is called so")?;
        need(self.light.azimuth.is_finite(), "light.azimuth", "degrees from north")?;
        need((-90.0..=90.0).contains(&self.light.elevation), "light.elevation", "from -90 to 90 degrees")?;
        need(share(self.shading), "shading", "from 0 to 1")?;
        need(share(self.strength), "strength", "from 0 to 1")?;
        need((1.0..=8.0).contains(&self.radius), "radius", "from 1 to 8 pixels")?;
        need(self.feature.is_none_or(|f| f > 0.0 && f < FAR), "feature", "metres, greater than 0")?;
        let rising = |r: Option<[f64; 2]>| r.is_none_or(|[a, b]| a.is_finite() && b.is_finite() && a < b);
        need(rising(self.range), "range", "two metres, the first smaller than the second")?;
        need(rising(self.channel_range), "channelRange", "two numbers, the first smaller than the second")?;
        let rule = "a normal that is not zero and a point, in metres";
        need(self.plane.as_ref().is_none_or(is_plane), "plane", rule)?;
        need(self.clip_plane.as_ref().is_none_or(is_plane), "clipPlane", rule)?;
        let rule = "a center and a size greater than 0, in metres, and a turn in degrees";
        need(self.clip_box.as_ref().is_none_or(is_box), "clipBox", rule)
    }

    /// The mode.
    pub fn mode(&self) -> Mode {
        Mode::from_name(&self.mode).unwrap_or_default()
    }

    /// The plane of the mode's scale, unit normal: height counts from 0 of the reference system.
    pub fn scale_plane(&self, bounds: &Bounds) -> Plane {
        let level = |z| Plane { normal: DVec3::Z, point: bounds.center().with_z(z) };
        match (self.mode(), self.plane) {
            (Mode::Distance, Some(plane)) => Plane { normal: unit(plane.normal), ..plane },
            (Mode::Distance, None) => level(bounds.min.z),
            _ => level(0.0),
        }
    }

    /// Where the colours of height and distance begin and end, metres from [`Display::scale_plane`].
    pub fn scale_range(&self, bounds: &Bounds) -> [f64; 2] {
        self.range.unwrap_or_else(|| {
            let plane = self.scale_plane(bounds);
            let distance = |p: DVec3| plane.normal.dot(p - plane.point);
            let (low, high) = bounds
                .corners()
                .map(distance)
                .iter()
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), d| (a.min(*d), b.max(*d)));
            if low < high { [low, high] } else { [low, low + 1e-3] }
        })
    }

    /// Size of what curvature shows, metres.
    pub fn feature_size(&self, bounds: &Bounds) -> f64 {
        self.feature.unwrap_or(bounds.radius() / 150.0)
    }

    /// The renderer's options, in lattice units. `dark` is the theme that `auto` follows, `pixel_ratio` the pixels of the picture per
    /// CSS pixel; `channel` the range of the scalar that is shown.
    pub fn options(
        &self,
        lattice: &Lattice,
        bounds: &Bounds,
        dark: bool,
        pixel_ratio: f64,
        channel: Option<[f64; 2]>,
    ) -> RenderOptions {
        let step = lattice.step();
        let plane = self.scale_plane(bounds);
        let [low, high] = self.scale_range(bounds);
        let share = |value: f64| {
            channel.map_or(0.0, |[min, max]| if max > min { (value - min) / (max - min) } else { 0.0 }) as f32
        };
        RenderOptions {
            mode: self.mode(),
            shading: self.shading as f32,
            on_color: self.on_colour,
            light: Light {
                azimuth: self.light.azimuth.to_radians(),
                elevation: self.light.elevation.to_radians(),
                with_view: self.light.with_view,
            },
            strength: self.strength as f32,
            radius: (self.radius * pixel_ratio).clamp(1.0, 32.0) as f32,
            feature: self.feature_size(bounds) / step,
            scale: Scale {
                normal: plane.normal,
                offset: half_space(&plane, lattice).offset,
                range: [low / step, high / step],
            },
            scalar_range: self.channel_range.map_or([0.0, 1.0], |r| r.map(share)),
            clip: self.clip(lattice),
            outline: if self.outline { (1.5 * pixel_ratio) as f32 } else { 0.0 },
            mark_back_faces: self.back_faces,
            background: background(&self.background, dark).unwrap_or(Background::LIMESTONE),
            tile: None,
            #[cfg(any(feature = "webgl", not(target_arch = "wasm32")))]
            frustum: None,
        }
    }

    /// The cut, in lattice units.
    pub fn clip(&self, lattice: &Lattice) -> Clip {
        ClipState { clip_plane: self.clip_plane, clip_box: self.clip_box }.in_steps(lattice)
    }

    /// Number of the channel that the mode `scalar` shows, of these names.
    pub fn channel_index(&self, names: &[&str]) -> Option<usize> {
        let asked = self.channel.as_deref().and_then(|c| names.iter().position(|n| *n == c));
        let named = || names.iter().position(|n| ["confidence", "quality"].iter().any(|w| n.eq_ignore_ascii_case(w)));
        asked.or_else(named).or(if names.is_empty() { None } else { Some(0) })
    }

    /// Number of the channel, of these names, by which triangles are hidden; `None` where all are shown.
    pub fn hidden_by(&self, channels: &[kilwa_pack::ScalarChannel]) -> Option<usize> {
        channels.iter().position(|c| CHANNELS.contains(&c.name.as_str())).filter(|_| self.hide_filled)
    }
}

fn is_plane(plane: &Plane) -> bool {
    let length = plane.normal.length_squared();
    length.is_finite() && length > 1e-18 && plane.point.abs().cmple(DVec3::splat(FAR)).all()
}

fn is_box(b: &SectionBox) -> bool {
    let sizes = b.size.cmpgt(DVec3::ZERO).all() && b.size.cmple(DVec3::splat(FAR)).all();
    sizes && b.center.abs().cmple(DVec3::splat(FAR)).all() && b.turn.is_finite()
}

fn unit(v: DVec3) -> DVec3 {
    v / v.length()
}

/// A background by name.
pub fn background(name: &str, dark: bool) -> Option<Background> {
    Some(match name {
        "auto" if dark => Background::BASALT,
        "auto" | "light" | "limestone" => Background::LIMESTONE,
        "dark" | "basalt" => Background::BASALT,
        "white" => Background::Flat([255; 3]),
        "black" => Background::Flat([0; 3]),
        "transparent" => Background::Transparent,
        _ => {
            let hex = name.strip_prefix('#').unwrap_or(name);
            let is_hex = hex.len() == 6 && hex.bytes().all(|b| b.is_ascii_hexdigit());
            let [_, r, g, b] = u32::from_str_radix(hex, 16).ok().filter(|_| is_hex)?.to_be_bytes();
            Background::Flat([r, g, b])
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOUNDS: Bounds = Bounds { min: DVec3::new(0.0, 0.0, 2.0), max: DVec3::new(30.0, 20.0, 12.0) };

    #[test]
    fn default_settings_are_omitted_and_all_others_round_trip() {
        assert_eq!(Display::default().to_json(), "{}");
        assert_eq!(Display::from_json("{}").unwrap(), Display::default());
        let display = Display {
            mode: "raking".to_owned(),
            light: LightAngles { azimuth: 40.0, elevation: 7.5, with_view: true },
            on_colour: true,
            clip_plane: Some(Plane { normal: DVec3::new(0.0, 0.0, 2.0), point: DVec3::new(1.0, 2.0, 3.0) }),
            clip_box: Some(SectionBox { center: DVec3::ONE, size: DVec3::splat(2.0), turn: 30.0, remove_inside: true }),
            range: Some([1.0, 2.5]),
            fade: Some(false),
            ..Display::default()
        };
        assert_eq!(Display::from_json(&display.to_json()).unwrap(), display);
    }

    #[test]
    fn invalid_settings_are_refused_by_name() {
        for (text, name) in [
            (r#"{"mode":"pretty"}"#, "mode"),
            (r#"{"shading":2}"#, "shading"),
            (r#"{"range":[3,3]}"#, "range"),
            (r#"{"clipPlane":{"normal":[0,0,0],"point":[0,0,0]}}"#, "clipPlane"),
            (r#"{"clipPlane":{"normal":[0,0,1e200],"point":[0,0,0]}}"#, "clipPlane"),
            (r#"{"clipBox":{"center":[0,0,0],"size":[1,0,1]}}"#, "clipBox"),
            (r#"{"background":"plaid"}"#, "background"),
            (r#"{"light":{"azimuth":0,"elevation":91}}"#, "light.elevation"),
            (r#"{"colour":1}"#, "unknown field"),
            ("[1", "not valid display settings"),
        ] {
            let error = Display::from_json(text).unwrap_err().to_string();
            assert!(error.contains(name), "{text}: {error}");
        }
    }

    #[test]
    fn scales_span_the_model_by_default() {
        let of = |json: &str| {
            let d = Display::from_json(json).unwrap();
            (d.scale_plane(&BOUNDS), d.scale_range(&BOUNDS))
        };
        assert_eq!(of(r#"{"mode":"height"}"#).1, [2.0, 12.0], "heights are those of the reference system");
        assert_eq!(of(r#"{"mode":"distance"}"#).1, [0.0, 10.0]);
        let east = r#"{"mode":"distance","plane":{"normal":[-4,0,0],"point":[30,0,0]}}"#;
        assert_eq!(of(east), (Plane { normal: DVec3::NEG_X, point: DVec3::new(30.0, 0.0, 0.0) }, [0.0, 30.0]));
        assert_eq!(of(r#"{"mode":"height","range":[3,4]}"#).1, [3.0, 4.0]);
    }

    #[test]
    fn the_requested_channel_is_shown_or_confidence_or_the_first() {
        let names = ["intensity", "Confidence"];
        assert_eq!(Display::default().channel_index(&names), Some(1));
        let asked = Display { channel: Some("intensity".to_owned()), ..Display::default() };
        assert_eq!(asked.channel_index(&names), Some(0));
        assert_eq!(Display::default().channel_index(&["x"]), Some(0));
        assert_eq!(Display::default().channel_index(&[]), None);
    }
}
