//! Which photographs a model is coloured from, and which are left out.

use anyhow::{Context as _, bail, ensure};
use kilwa_scan::colour::Input;
use kilwa_scan::photos::{self, Missing, Options, PhotoRecord, PhotoSet, Source};
use kilwa_scan::survey::Survey;
use std::path::Path;

/// The photographs of a folder or a survey.
pub(super) struct Photographs {
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
        let found = Self::of(&set);
        ensure!(
            !found.inputs.is_empty(),
            "none of {} photographs has a file, a camera and a pose; `kilwa scans photos list` shows what is missing",
            set.photos.len()
        );
        Ok(found)
    }

    fn of(set: &PhotoSet) -> Self {
        let mut photographs = Self { inputs: Vec::new(), left_out: Vec::new() };
        for photo in &set.photos {
            match input(photo) {
                Ok(input) => photographs.inputs.push(input),
                Err(why) => photographs.left_out.push((photo.name.clone(), why)),
            }
        }
        photographs
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
    Ok(Input { name: photo.name.clone(), path, mask: photo.mask.clone(), camera, exposure: exposure(photo) })
}

/// Light per exposure, in stops.
fn exposure(photo: &PhotoRecord) -> Option<f64> {
    let exposure = &photo.picture.as_ref()?.exposure;
    let (time, number, iso) = (exposure.time?, exposure.f_number?, exposure.iso?);
    let light = time * f64::from(iso) / (number * number);
    (light.is_finite() && light > 0.0).then(|| light.log2())
}
