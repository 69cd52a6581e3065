//! What is fed to a measurement: one pose at a time, with everything that stands for it.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::Error;
use crate::model::Signal;
use crate::rig::Part;
use crate::sh::Order;

/// Why a pose was kept from the fit, or not. Wire name in kebab case.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Split {
    /// Seen by the fit.
    Training,
    /// Every k-th frame of a training clip, held out.
    Interpolated,
    /// The last contiguous quarter of the only clip, held out.
    WithinClip,
    /// Of a clip that was held out whole.
    Novel,
}

impl Split {
    /// All splits, in the order of reports.
    pub const ALL: [Self; 4] = [Self::Training, Self::Interpolated, Self::WithinClip, Self::Novel];

    /// The wire name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Training => "training",
            Self::Interpolated => "interpolated",
            Self::WithinClip => "within-clip",
            Self::Novel => "novel",
        }
    }
}

impl From<crate::pose::Split> for Split {
    fn from(split: crate::pose::Split) -> Self {
        match split {
            crate::pose::Split::Training => Self::Training,
            crate::pose::Split::Novel => Self::Novel,
            crate::pose::Split::Interpolated => Self::Interpolated,
            crate::pose::Split::WithinClip => Self::WithinClip,
        }
    }
}

/// What a candidate is in the comparison. Wire name in kebab case.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// The model whose figures are the headline; exactly one.
    Model,
    /// What the model must beat: the mean over training poses.
    Baseline,
    /// The model stored at another precision; what storing it so adds is measured too.
    Precision,
    /// Another model on the same poses.
    Other,
}

/// One of the predictions compared on every pose.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Candidate {
    /// Unique among the candidates.
    pub name: String,
    /// Its part in the comparison.
    pub kind: Kind,
}

/// What all poses of a measurement share.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// What the coefficients mean.
    pub signal: Signal,
    /// SH order of the coefficients; 1 for `ao`.
    pub order: Order,
    /// 1, or 3 where the albedo is coloured.
    pub channels: usize,
    /// For every point a vertex that it stands for, in glTF order: so that a place has a name.
    pub vertex_of_point: Vec<u32>,
    /// The mesh's parts, whose names are given with a vertex; may be empty.
    pub parts: Vec<Part>,
    /// What is compared, in the order in which every [`Case`] brings it. The first precision or
    /// other candidate needs no special place; exactly one is [`Kind::Model`].
    pub candidates: Vec<Candidate>,
    /// Index of the most precise of the model and its other precisions, to which the others' differences are
    /// taken; the model when absent.
    pub exact: Option<usize>,
    /// Seconds between frames of a clip. Two poses of one clip at most 1.5 times this apart, fed
    /// one after the other, are consecutive frames for the flicker. 1/30 by default of the recipe.
    pub frame_s: f32,
    /// Whether the model is for the clips that it was trained on, so that the headline is of these.
    pub on_trained: bool,
    /// Rays per point of one reference, to be stated; `None` where unknown.
    pub reference_rays: Option<u32>,
}

impl Settings {
    /// Number of points.
    #[must_use]
    pub fn points(&self) -> usize {
        self.vertex_of_point.len()
    }

    /// Numbers of one pose: points × channels × coefficients.
    #[must_use]
    pub fn numbers(&self) -> usize {
        self.points() * self.channels * self.order.coefficients()
    }

    /// The index of the model among the candidates.
    pub(super) fn checked_model(&self) -> Result<usize, Error> {
        let order = self.order.bands();
        if self.points() == 0 || self.channels == 0 || (self.signal == Signal::Ao && order != 1) {
            let (points, channels) = (self.points(), self.channels);
            return Err(Error::Layout { points, channels, order, signal: self.signal.name() });
        }
        let models = self.candidates.iter().filter(|c| c.kind == Kind::Model).count();
        let names: Vec<String> = self.candidates.iter().map(|c| c.name.clone()).collect();
        let unique = names.iter().collect::<std::collections::BTreeSet<_>>().len() == names.len();
        match self.candidates.iter().position(|c| c.kind == Kind::Model) {
            Some(model) if models == 1 && unique => Ok(model),
            _ => Err(Error::Model { models, names }),
        }
    }
}

/// One pose: two references of different seeds and what each candidate predicts.
///
/// Coefficients are [point, channel, coefficient] in the root frame. Poses of a clip come in the
/// order of time, one after the other, where flicker is to be measured; otherwise any order does.
#[derive(Debug, Clone, Copy)]
pub struct Case<'a> {
    /// Index of the pose in its data set.
    pub pose: usize,
    /// Name of its clip; empty for a static pose.
    pub clip: &'a str,
    /// Seconds since the clip's start.
    pub time_s: f32,
    /// What the pose proves.
    pub split: Split,
    /// Unit shading normals `[point]`, root frame.
    pub normals: &'a [Vec3],
    /// A bake of many rays.
    pub reference1: &'a [f32],
    /// Another, whose rays are independent of the first's.
    pub reference2: &'a [f32],
    /// Name and coefficients, as many and in the order of [`Settings::candidates`].
    pub candidates: &'a [(&'a str, &'a [f32])],
}

impl Case<'_> {
    /// Checks lengths, names and finiteness against the layout.
    pub(super) fn check(&self, settings: &Settings) -> Result<(), Error> {
        let pose = self.pose;
        if !self.candidates.iter().map(|c| c.0).eq(settings.candidates.iter().map(|c| &c.name)) {
            return Err(Error::Candidates {
                pose,
                expected: settings.candidates.iter().map(|c| c.name.clone()).collect(),
                found: self.candidates.iter().map(|c| c.0.to_owned()).collect(),
            });
        }
        let references = [("reference 1", self.reference1), ("reference 2", self.reference2)];
        let stride = settings.channels * settings.order.coefficients();
        for (what, numbers) in references.iter().chain(self.candidates) {
            self.check_length(what, settings.numbers(), numbers.len())?;
            if let Some(at) = numbers.iter().position(|x| !x.is_finite()) {
                let (point, coefficient) = (at / stride, at % stride);
                let what = (*what).to_owned();
                return Err(Error::NotFinite { pose, what, point, coefficient });
            }
        }
        self.check_length("normals", settings.points(), self.normals.len())?;
        let unit = |n: &Vec3| (n.length_squared() - 1.0).abs() < 1e-2;
        if let Some(point) = self.normals.iter().position(|n| !unit(n)) {
            return Err(Error::Normal { pose, point, length: self.normals[point].length() });
        }
        Ok(())
    }

    fn check_length(&self, what: &str, expected: usize, found: usize) -> Result<(), Error> {
        let (pose, what) = (self.pose, what.to_owned());
        if expected == found {
            return Ok(());
        }
        Err(Error::Length { pose, what, expected, found })
    }
}
