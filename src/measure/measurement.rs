//! The stream: one pose in, sums kept, nothing else.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::probes::Probes;
use super::rows::{self, Coefficients, Rows, Track};
use super::tally::Tally;
use super::{Case, Error, Kind, Settings, Split};

/// Consecutive frames are at most this many frames apart.
const CONSECUTIVE: f32 = 1.5;

/// A measurement under way.
///
/// Memory does not grow with the poses but for a few numbers each: two poses' coefficients and
/// probes, one number per point and split, two distributions per candidate and split.
#[derive(Debug)]
pub struct Measurement {
    pub(super) settings: Settings,
    pub(super) probes: Probes,
    /// Index of the model among the candidates.
    pub(super) model: usize,
    /// Index of the candidate that differences in precision are taken to.
    pub(super) exact: usize,
    pub(super) tracks: Vec<Track>,
    /// Clip names in order of appearance.
    pub(super) clips: Vec<String>,
    pub(super) groups: BTreeMap<Split, Group>,
    previous: Option<Previous>,
}

/// When a pose is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Moment {
    /// Index in the data set.
    pub(super) pose: usize,
    /// Index into the measurement's clips.
    pub(super) clip: usize,
    pub(super) time_s: f32,
}

/// What is kept of one split.
#[derive(Debug)]
pub(super) struct Group {
    pub(super) moments: Vec<Moment>,
    /// For every pair of frames the pose, an index into `moments`, that it is counted with.
    pub(super) pairs: Vec<usize>,
    /// Parallel to the measurement's tracks.
    pub(super) tallies: Vec<Tally>,
}

/// The frame before, whole.
#[derive(Debug)]
struct Previous {
    clip: usize,
    time_s: f32,
    split: Split,
    reference1: Vec<f32>,
    reference2: Vec<f32>,
    candidates: Vec<Vec<f32>>,
    rows: Vec<Rows>,
}

impl Measurement {
    /// A measurement of nothing yet.
    ///
    /// # Errors
    /// [`Error::Layout`] for settings that describe no signal, [`Error::Model`] unless exactly one
    /// candidate is the model and all names differ.
    pub fn new(settings: Settings) -> Result<Self, Error> {
        let model = settings.checked_model()?;
        let mut tracks = vec![Track::Reference, Track::Noise];
        tracks.extend((0..settings.candidates.len()).map(Track::Candidate));
        let exact = settings.exact.unwrap_or(model);
        let stored = |i: &usize| {
            *i != exact && matches!(settings.candidates[*i].kind, Kind::Model | Kind::Precision)
        };
        let added = (0..settings.candidates.len()).filter(stored);
        tracks.extend(added.map(|i| Track::Added(i, exact)));
        Ok(Self {
            probes: Probes::new(settings.signal, settings.order),
            settings,
            model,
            exact,
            tracks,
            clips: Vec::new(),
            groups: BTreeMap::new(),
            previous: None,
        })
    }

    /// Adds one pose. Nothing is added where an error is returned.
    ///
    /// # Errors
    /// [`Error::Length`], [`Error::NotFinite`], [`Error::Normal`], [`Error::Candidates`] for a
    /// case that does not fit the settings.
    pub fn add(&mut self, case: &Case<'_>) -> Result<(), Error> {
        case.check(&self.settings)?;
        let moment = Moment { pose: case.pose, clip: self.clip(case.clip), time_s: case.time_s };
        let now: Vec<&[f32]> = case.candidates.iter().map(|c| c.1).collect();
        let now = Coefficients {
            reference1: case.reference1,
            reference2: case.reference2,
            candidates: &now,
        };
        let previous = self.previous.take().filter(|p| self.consecutive(p, moment));
        let before: Vec<&[f32]> =
            previous.iter().flat_map(|p| p.candidates.iter().map(Vec::as_slice)).collect();
        let before = previous.as_ref().map(|p| Coefficients {
            reference1: &p.reference1,
            reference2: &p.reference2,
            candidates: &before,
        });
        let rows = rows::evaluate(&self.probes, &self.tracks, now, before, case.normals);
        self.tally(case.split, moment, &rows, now);
        if let Some(previous) = &previous {
            self.tally_pair(previous, case.split, &rows);
        }
        self.previous = Some(Previous {
            clip: moment.clip,
            time_s: moment.time_s,
            split: case.split,
            reference1: case.reference1.to_vec(),
            reference2: case.reference2.to_vec(),
            candidates: case.candidates.iter().map(|c| c.1.to_vec()).collect(),
            rows,
        });
        Ok(())
    }

    /// How many poses were added.
    #[must_use]
    pub fn poses(&self) -> usize {
        self.groups.values().map(|g| g.moments.len()).sum()
    }

    /// The index of a clip's name, new ones at the end.
    fn clip(&mut self, name: &str) -> usize {
        self.clips.iter().position(|c| c == name).unwrap_or_else(|| {
            self.clips.push(name.to_owned());
            self.clips.len() - 1
        })
    }

    fn consecutive(&self, previous: &Previous, now: Moment) -> bool {
        let step = now.time_s - previous.time_s;
        previous.clip == now.clip && step > 0.0 && step <= CONSECUTIVE * self.settings.frame_s
    }

    fn tally(&mut self, split: Split, moment: Moment, rows: &[Rows], now: Coefficients<'_>) {
        let (points, tracks) = (self.settings.points(), &self.tracks);
        let group = self.groups.entry(split).or_insert_with(|| Group {
            moments: Vec::new(),
            pairs: Vec::new(),
            tallies: tracks.iter().map(|&t| Tally::new(t, points)).collect(),
        });
        group.tallies.par_iter_mut().zip(rows).for_each(|(tally, rows)| tally.add(rows, now));
        group.moments.push(moment);
    }

    /// A step between frames of one split counts there; one into or out of an interpolated frame
    /// counts as interpolated; others, such as from training into held-out time, nowhere.
    fn tally_pair(&mut self, previous: &Previous, split: Split, rows: &[Rows]) {
        let either = [previous.split, split];
        let counted = if previous.split == split {
            split
        } else if either.contains(&Split::Interpolated) {
            Split::Interpolated
        } else {
            return;
        };
        let count = self.probes.coefficients();
        let Some(group) = self.groups.get_mut(&counted) else { return };
        group.pairs.push(group.moments.len() - 1);
        let both = rows.iter().zip(&previous.rows);
        for (tally, (now, before)) in group.tallies.iter_mut().zip(both) {
            tally.add_pair(now, before, count);
        }
    }
}
