//! From sums to figures.

use super::blocks::Blocks;
use super::measured::{
    Added, AoError, CandidateMeasured, Estimate, Flicker, Frames, FunctionError, LightMeasured,
    Measured, Place, ReferenceMeasured, Residual, ShadingError, SplitMeasured, Squared, Surface,
    VERSION, Worst, WorstPose, WorstSample, WorstVertex,
};
use super::measurement::{Group, Measurement};
use super::rows::Track;
use super::tally::{PairRow, PoseRow, Tally};
use super::{Candidate, Settings, Signal, Split, lights};
use crate::num::stats::Distribution;

/// The split that a headline speaks of, the most telling first.
const TELLING: [Split; 4] = [Split::Novel, Split::WithinClip, Split::Interpolated, Split::Training];
/// Bins of the residuals' histogram.
const BINS: usize = 81;
/// The part of the residuals that the histogram covers.
const COVERED: f64 = 0.99;

impl Measurement {
    /// The figures over everything added. Splits without poses are absent.
    #[must_use]
    pub fn finish(self) -> Measured {
        figures(&self)
    }
}

fn figures(measurement: &Measurement) -> Measured {
    let settings = &measurement.settings;
    let telling = if settings.on_trained { &TELLING[2..] } else { &TELLING[..] };
    let mut telling = telling.iter().chain(&TELLING).copied();
    let headline = telling.find(|split| measurement.groups.contains_key(split));
    let lights = match settings.signal {
        Signal::Transfer => lights(),
        Signal::Ao | Signal::Visibility => &[],
    };
    let lights = lights
        .iter()
        .map(|l| LightMeasured { name: l.name.to_owned(), description: l.description.to_owned() });
    let group = headline.and_then(|s| measurement.groups.get(&s).map(|g| (s, g)));
    Measured {
        version: VERSION,
        signal: settings.signal,
        order: settings.order.get(),
        channels: settings.channels,
        points: settings.points(),
        reference_rays: settings.reference_rays,
        frame_s: f64::from(settings.frame_s),
        model: settings.candidates[measurement.model].name.clone(),
        headline,
        lights: lights.collect(),
        splits: measurement
            .groups
            .iter()
            .map(|(&split, group)| View::new(measurement, group).split(split))
            .collect(),
        surface: group.map(|(split, group)| surface(measurement, split, group)),
    }
}

fn surface(measurement: &Measurement, split: Split, group: &Group) -> Surface {
    let view = View::new(measurement, group);
    let tally = view.tally(Track::Candidate(measurement.model));
    let poses = group.moments.len() as f64;
    Surface {
        split,
        vertex: measurement.settings.vertex_of_point.clone(),
        ao_mae: tally.point_ao.iter().map(|x| (x / poses) as f32).collect(),
    }
}

/// One split, with what its figures are made from.
#[derive(Debug)]
struct View<'a> {
    measurement: &'a Measurement,
    settings: &'a Settings,
    group: &'a Group,
    blocks: Blocks,
    /// Indices of all poses of the split, in the order of adding.
    all: Vec<usize>,
    /// The same by clip and time.
    sorted: Vec<usize>,
}

impl<'a> View<'a> {
    fn new(measurement: &'a Measurement, group: &'a Group) -> Self {
        let places: Vec<(usize, f32)> = group.moments.iter().map(|m| (m.clip, m.time_s)).collect();
        let all: Vec<usize> = (0..places.len()).collect();
        let mut sorted = all.clone();
        sorted.sort_by(|&a, &b| {
            places[a].0.cmp(&places[b].0).then(places[a].1.total_cmp(&places[b].1))
        });
        let blocks = Blocks::new(&places);
        Self { measurement, settings: &measurement.settings, group, blocks, all, sorted }
    }

    fn tally(&self, track: Track) -> &'a Tally {
        let at = self.measurement.tracks.iter().position(|&t| t == track);
        &self.group.tallies[at.expect("every track of a candidate is followed")]
    }

    fn split(&self, split: Split) -> SplitMeasured {
        let mut clips: Vec<usize> =
            self.sorted.iter().map(|&i| self.group.moments[i].clip).collect();
        clips.dedup();
        SplitMeasured {
            split,
            clips: clips.iter().map(|&c| self.measurement.clips[c].clone()).collect(),
            poses: self.all.len(),
            frame_pairs: self.group.pairs.len(),
            block_method: self.blocks.method,
            blocks: self.blocks.count,
            reference: self.reference(),
            candidates: (0..self.settings.candidates.len()).map(|i| self.candidate(i)).collect(),
            frames: self.frames(&clips),
        }
    }

    fn frames(&self, clips: &[usize]) -> Frames {
        let noise = self.tally(Track::Noise);
        let mut frames = Frames::default();
        for &i in &self.sorted {
            let moment = self.group.moments[i];
            frames.pose.push(moment.pose);
            frames.clip.push(clips.iter().position(|&c| c == moment.clip).unwrap_or(0));
            frames.time_s.push(f64::from(moment.time_s));
            frames.ao_noise_mae.push(noise.poses[i].ao_mae);
        }
        frames
    }

    fn reference(&self) -> ReferenceMeasured {
        let (signal, noise) = (self.tally(Track::Reference), self.tally(Track::Noise));
        let mean = |tally: &Tally, f: fn(&PoseRow) -> f64| self.mean(tally, f).value;
        let change = |f: fn(&PairRow) -> f64| self.pair_mean(signal, f).and_then(|e| root(e.value));
        ReferenceMeasured {
            ao_mean: mean(signal, |p| p.ao_bias),
            ao_noise_mae: mean(noise, |p| p.ao_mae),
            ao_noise_rms: mean(noise, |p| p.ao_mse).sqrt(),
            coefficient_noise_rms: mean(noise, |p| p.mse).sqrt(),
            coefficient_rms: root(mean(signal, |p| p.mse)),
            hemisphere_energy: self.directional().then(|| mean(signal, |p| p.hemisphere)),
            ao_change_rms: change(|p| p.ao_mse),
            coefficient_change_rms: change(|p| p.mse),
        }
    }

    fn candidate(&self, index: usize) -> CandidateMeasured {
        let Candidate { name, kind } = self.settings.candidates[index].clone();
        let tally = self.tally(Track::Candidate(index));
        CandidateMeasured {
            name,
            kind,
            ao: AoError {
                mean_absolute: self.mean(tally, |p| p.ao_mae),
                p99: tally.ao.magnitude_quantile(0.99).unwrap_or(0.0),
                mean_signed: self.mean(tally, |p| p.ao_bias),
                squared: self.squared(tally, |p| p.ao_mse),
            },
            coefficients: self.squared(tally, |p| p.mse),
            function: self.directional().then(|| self.function(tally)),
            shading: self.shading(tally),
            flicker: self.flicker(tally),
            residual: residual(&tally.residual, self.mean(tally, |p| p.bias), {
                self.mean(tally, |p| p.mse).value
            }),
            worst: self.worst(tally),
            added: self.added(index),
            frame_ao_mae: self.sorted.iter().map(|&i| tally.poses[i].ao_mae).collect(),
            frame_mean_square: self.sorted.iter().map(|&i| tally.poses[i].mse).collect(),
        }
    }

    fn directional(&self) -> bool {
        self.measurement.probes.is_directional()
    }

    /// The mean over poses of one quantity.
    fn mean(&self, tally: &Tally, quantity: impl Fn(&PoseRow) -> f64) -> Estimate {
        let series: Vec<f64> = tally.poses.iter().map(quantity).collect();
        let estimate = self.blocks.estimate(&self.all, &series);
        estimate.expect("a split that exists has poses")
    }

    /// The mean over pairs of frames; `None` without pairs.
    fn pair_mean(&self, tally: &Tally, quantity: impl Fn(&PairRow) -> f64) -> Option<Estimate> {
        let series: Vec<f64> = tally.pairs.iter().map(quantity).collect();
        self.blocks.estimate(&self.group.pairs, &series)
    }

    /// A mean square, beside the same quantity of the references' noise.
    fn squared(&self, tally: &Tally, quantity: impl Fn(&PoseRow) -> f64) -> Squared {
        let noise = self.mean(self.tally(Track::Noise), &quantity).value;
        squared(self.mean(tally, &quantity), noise)
    }

    fn function(&self, tally: &Tally) -> FunctionError {
        let hemisphere = self.squared(tally, |p| p.hemisphere);
        let energy = self.mean(self.tally(Track::Reference), |p| p.hemisphere).value;
        let count = self.measurement.probes.coefficients() as f64;
        FunctionError {
            hemisphere,
            hemisphere_relative: ratio(hemisphere.rms, root(energy)),
            sphere: self.squared(tally, |p| p.mse * count),
        }
    }

    fn shading(&self, tally: &Tally) -> Vec<ShadingError> {
        let lights = lights();
        (0..self.measurement.probes.count() - 1)
            .map(|k| {
                let error = self.squared(tally, |p| p.lights[k]);
                let size = self.mean(self.tally(Track::Reference), |p| p.lights[k]).value;
                ShadingError {
                    light: lights[k].name.to_owned(),
                    squared: error,
                    relative_rms: ratio(error.rms, root(size)),
                    psnr_db: error.rms.filter(|&e| e > 0.0).map(|e| -20.0 * e.log10()),
                }
            })
            .collect()
    }

    fn flicker(&self, tally: &Tally) -> Option<Flicker> {
        let noise = self.tally(Track::Noise);
        let of = |quantity: fn(&PairRow) -> f64| {
            let noise = self.pair_mean(noise, quantity)?.value;
            Some(squared(self.pair_mean(tally, quantity)?, noise))
        };
        let lit = self.measurement.probes.count() > 1;
        Some(Flicker {
            ao: of(|p| p.ao_mse)?,
            coefficients: of(|p| p.mse)?,
            shading: if lit { of(|p| p.shading_mse) } else { None },
        })
    }

    /// What storing a candidate less precisely adds.
    fn added(&self, index: usize) -> Option<Added> {
        let exact = self.measurement.exact;
        let track = Track::Added(index, exact);
        let tally = self.measurement.tracks.contains(&track).then(|| self.tally(track))?;
        let mse = |i| self.mean(self.tally(Track::Candidate(i)), |p| p.mse).value;
        let (with, without) = (mse(index), mse(exact));
        Some(Added {
            coefficient_rms: self.mean(tally, |p| p.mse).value.sqrt(),
            ao_mae: self.mean(tally, |p| p.ao_mae).value,
            ao_max: tally.ao.magnitude_quantile(1.0).unwrap_or(0.0),
            mean_square_growth: (without > 0.0).then(|| (with - without) / without),
        })
    }

    fn worst(&self, tally: &Tally) -> Option<Worst> {
        let moments = &self.group.moments;
        let pose = largest(tally.poses.iter().map(|p| p.ao_mae))?;
        let point = largest(tally.point_ao.iter().copied())?;
        let sample = tally.worst?;
        let clip = |i: usize| self.measurement.clips[moments[i].clip].clone();
        Some(Worst {
            pose: WorstPose {
                pose: moments[pose].pose,
                clip: clip(pose),
                time_s: f64::from(moments[pose].time_s),
                ao_mae: tally.poses[pose].ao_mae,
            },
            vertex: WorstVertex {
                place: self.place(point),
                ao_mae: tally.point_ao[point] / moments.len() as f64,
            },
            sample: WorstSample {
                pose: moments[sample.place].pose,
                clip: clip(sample.place),
                time_s: f64::from(moments[sample.place].time_s),
                place: self.place(sample.point),
                ao_error: sample.error,
            },
        })
    }

    /// A point's vertex by part.
    fn place(&self, point: usize) -> Place {
        let vertex = self.settings.vertex_of_point[point];
        let part = self.settings.parts.iter().find(|p| p.vertices.contains(&(vertex as usize)));
        Place {
            vertex,
            part: part.map_or_else(String::new, |p| p.name.clone()),
            vertex_in_part: part.map_or(vertex, |p| vertex - p.vertices.start as u32),
        }
    }
}

/// The first index of the largest number.
fn largest(numbers: impl Iterator<Item = f64>) -> Option<usize> {
    let mut best: Option<(usize, f64)> = None;
    for (i, x) in numbers.enumerate() {
        if best.is_none_or(|(_, y)| x > y) {
            best = Some((i, x));
        }
    }
    best.map(|(i, _)| i)
}

fn root(x: f64) -> Option<f64> {
    (x >= 0.0).then(|| x.sqrt())
}

fn ratio(a: Option<f64>, b: Option<f64>) -> Option<f64> {
    Some(a? / b.filter(|&b| b > 0.0)?)
}

fn squared(estimate: Estimate, noise_mean_square: f64) -> Squared {
    Squared {
        mean_square: estimate.value,
        standard_error: estimate.standard_error,
        rms: root(estimate.value),
        below_noise: estimate.value < noise_mean_square,
    }
}

/// Mean, variance and shape. `mean_square` is in cross form, the distribution holds the noise.
fn residual(distribution: &Distribution, mean: Estimate, mean_square: f64) -> Residual {
    let tail = (1.0 - COVERED) / 2.0;
    let reach = |fraction| distribution.quantile(fraction).unwrap_or(0.0).abs();
    // Symmetric about zero, so that a bias shows. A model without any error still gets bins.
    let half = reach(tail).max(reach(1.0 - tail)).max(1e-9);
    let width = 2.0 * half / BINS as f64;
    let end = |bin: usize| -half + width * bin as f64;
    let cumulative: Vec<f64> = (0..=BINS).map(|b| distribution.cumulative(end(b))).collect();
    Residual {
        mean,
        variance: (mean_square - mean.value * mean.value).max(0.0),
        variance_with_noise: distribution.variance().unwrap_or(0.0),
        histogram_low: -half,
        histogram_width: width,
        histogram: cumulative.windows(2).map(|w| w[1] - w[0]).collect(),
        cumulative: cumulative[1..].to_vec(),
    }
}
