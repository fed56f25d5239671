//! Which photographs a model is coloured from, and which are left out.

use anyhow::{Context as _, bail, ensure};
use kilwa_scan::colour::align::{self, Aligned, Start};
use kilwa_scan::colour::{Input, Model};
use kilwa_scan::photos::{self, Frame, Missing, Options, PhotoRecord, PhotoSet, Source};
use kilwa_scan::survey::Survey;
use std::path::Path;

/// The poses seem wrong if the reconstruction has at least `FEWEST_POINTS` points, and less than the share `NEAR` of them is near the model.
const FEWEST_POINTS: usize = 30;
const NEAR: f64 = 0.2;

/// The photographs of a folder or a survey.
pub(super) struct Photographs {
    set: PhotoSet,
    /// Those with file, camera and pose.
    pub(super) inputs: Vec<Input>,
    /// The names of the others, each with the reason.
    pub(super) left_out: Vec<(String, String)>,
}

impl Photographs {
    /// Those in a folder, or those of a survey.
    pub(super) fn find(folder: Option<&Path>, poses: Option<&Path>, survey: Option<&Path>) -> anyhow::Result<Self> {
        let opened = survey.map(Survey::open).transpose()?;
        let set = match (folder, survey.zip(opened.as_ref())) {
            (Some(folder), _) => {
                ensure!(folder.is_dir(), "{} is not a folder; give the folder of the photographs", folder.display());
                let stations = opened.as_ref().map(|survey| survey.stations.as_slice()).unwrap_or_default();
                let options = Options { poses, stations };
                photos::read(folder, &options).with_context(|| format!("the photographs of {}", folder.display()))?
            }
            (None, Some((path, survey))) => photos::of_survey(path, survey),
            (None, None) => bail!("no photographs: give their folder with --photos, or a survey before the model"),
        };
        ensure!(!set.photos.is_empty(), "no photographs were found; JPEG and PNG files are photographs");
        let found = Self::of(set);
        ensure!(
            !found.inputs.is_empty(),
            "0 of {} photographs have a file, a camera and a pose; `kilwa scans photos list` shows what is missing",
            found.set.photos.len()
        );
        Ok(found)
    }

    fn of(set: PhotoSet) -> Self {
        let (mut inputs, mut left_out) = (Vec::new(), Vec::new());
        for photo in &set.photos {
            match input(photo) {
                Ok(input) => inputs.push(input),
                Err(why) => left_out.push((photo.name.clone(), why)),
            }
        }
        Self { set, inputs, left_out }
    }

    /// Points of the reconstruction near the model and all of them, if so few are near that the poses seem to be in other coordinates.
    pub(super) fn doubt<S: kilwa_pack::Source + Sync>(
        &self,
        model: &Model<'_, S>,
    ) -> anyhow::Result<Option<[usize; 2]>> {
        if self.set.sparse_points.is_empty() {
            return Ok(None);
        }
        let (surface, spacing) = align::surface_of(model)?;
        let (near, all) = align::near_surface(&self.set, (&surface, spacing));
        Ok((all >= FEWEST_POINTS && (near as f64) < NEAR * all as f64).then_some([near, all]))
    }

    /// The photographs in the coordinates of the model, and how the frame of their reconstruction was found.
    pub(super) fn placed<S: kilwa_pack::Source + Sync>(
        &self,
        start: &Start,
        model: &Model<'_, S>,
    ) -> anyhow::Result<(Self, Aligned)> {
        let loose = |photo: &PhotoRecord| photo.camera_from_world.is_some() && photo.frame == Frame::Reconstruction;
        ensure!(
            self.set.photos.iter().any(loose),
            "no photograph has a pose in the frame of a reconstruction, so there is no frame to find"
        );
        let (surface, spacing) = align::surface_of(model)?;
        let aligned = align::frame(&self.set, start, Some((&surface, spacing)))?;
        if let Start::Given(..) = start {
            match &aligned.not_landed {
                Some(why) => bail!("the poses cannot be fitted to the model: {why}"),
                None => ensure!(
                    aligned.landed.is_some(),
                    "the poses cannot be fitted to the model, because the reconstruction has no points; give control points"
                ),
            }
        }
        let mut set = self.set.clone();
        aligned.apply(&mut set);
        Ok((Self::of(set), aligned))
    }
}

fn input(photo: &PhotoRecord) -> Result<Input, String> {
    if photo.missing.contains(&Missing::Disabled) {
        return Err(Missing::Disabled.to_string());
    }
    let missing = || {
        let reasons: Vec<String> = photo.missing.iter().map(ToString::to_string).collect();
        if reasons.is_empty() { "its camera or pose is unknown".to_owned() } else { reasons.join("; ") }
    };
    let camera = photo.posed().ok_or_else(missing)?;
    let path = match &photo.source {
        Source::File(path) => path.clone(),
        Source::Inside { file, .. } => {
            return Err(format!("it is inside {}; import the scan into a survey first", file.display()));
        }
        Source::Missing => return Err(missing()),
    };
    Ok(Input {
        name: photo.name.clone(),
        path,
        mask: photo.mask.clone(),
        camera,
        exposure: photo.picture.as_ref().and_then(|picture| picture.exposure.stops()),
    })
}
