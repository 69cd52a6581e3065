//! The simplest point that meets a target.

use serde::{Deserialize, Serialize};

use super::Point;

/// How many standard errors a point must stay below the largest error: one chance in twenty that
/// it lies above, were the errors normal.
const MARGIN: f64 = 1.645;

/// Figures that are estimated from some of the points may be off by this share.
const DOUBT: f64 = 0.03;

/// Errors that differ by less than this share are alike: the simpler model is better.
const ALIKE: f64 = 0.01;

/// Times that are estimated may be off by this share.
const TIME_DOUBT: f64 = 0.3;

/// What a model must be; whatever is absent does not matter.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Target {
    /// Root mean square of a coefficient's error, on the split that counts.
    pub max_error: Option<f64>,
    /// Bytes of the blob.
    pub max_bytes: Option<u64>,
    /// Microseconds of one evaluation.
    pub max_us: Option<f64>,
    /// Seconds of the fit.
    pub max_fit_s: Option<f64>,
}

/// What was chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Choice {
    /// This point meets the target; the simplest that does.
    Met(usize),
    /// None does; this one comes closest.
    Missed(usize),
}

/// Where a model's mean square error comes from; they need not sum to its whole.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Shares {
    /// What the noise of the training data leaves in the model: its variance times the parameters that
    /// the fit takes from them, over the training poses. For neurons their number is an estimate.
    pub noise: f64,
    /// What the model could not say of the poses that it saw.
    pub bias: f64,
    /// What it gets wrong beyond that in poses that it did not see.
    pub coverage: f64,
}

/// What would help most.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Remedy {
    /// Bake with more rays.
    MoreRays,
    /// Bake more motion.
    MorePoses,
    /// Allow more bytes or time, or another family.
    RicherModel,
}

impl Target {
    /// Whether anything is asked for.
    #[must_use]
    pub fn is_any(&self) -> bool {
        self.max_error.is_some()
            || self.max_bytes.is_some()
            || self.max_us.is_some()
            || self.max_fit_s.is_some()
    }

    /// Whether a point costs no more than it may.
    pub(crate) fn affords(&self, point: &Point) -> bool {
        self.max_bytes.is_none_or(|most| point.bytes <= most) && self.affords_times(point)
    }

    /// The same of its times alone.
    pub(crate) fn affords_times(&self, point: &Point) -> bool {
        self.max_us.is_none_or(|most| point.evaluate_us <= most)
            && self.max_fit_s.is_none_or(|most| point.fit_s <= most)
    }

    /// With bounds so much wider as the costs may be off that are estimated from some of the points.
    pub(crate) fn roughly(&self) -> Self {
        let wider = |most: f64| most * (1.0 + TIME_DOUBT);
        Self {
            max_bytes: self.max_bytes.map(|most| (most as f64 * (1.0 + DOUBT)) as u64),
            max_us: self.max_us.map(wider),
            max_fit_s: self.max_fit_s.map(wider),
            ..*self
        }
    }

    /// With an error so much larger as one may be off that is estimated from some of the points.
    pub(crate) fn perhaps(&self) -> Self {
        Self { max_error: self.max_error.map(|most| most * (1.0 + DOUBT)), ..*self }
    }

    /// By how much its costs exceed what they may be: the worst ratio, at least 1.
    fn excess(&self, point: &Point) -> f64 {
        let ratio = |cost: f64, most: Option<f64>| most.map_or(1.0, |most| cost / most);
        ratio(point.bytes as f64, self.max_bytes.map(|bytes| bytes as f64))
            .max(ratio(point.evaluate_us, self.max_us))
            .max(ratio(point.fit_s, self.max_fit_s))
            .max(1.0)
    }
}

/// Whether estimates leave a doubt about a choice: its figures are close to what the target bounds.
#[must_use]
pub fn is_doubtful(choice: &Point, split: &str, target: &Target) -> bool {
    let Some((largest, _)) = errors(choice, split) else { return true };
    let near = |value: f64, bound: f64, share: f64| (value / bound - 1.0).abs() < share;
    let Target { max_error, max_bytes, max_us, max_fit_s } = *target;
    max_error.is_some_and(|most| near(largest, most, DOUBT))
        || max_bytes.is_some_and(|most| near(choice.bytes as f64, most as f64, DOUBT))
        || max_us.is_some_and(|most| near(choice.evaluate_us, most, TIME_DOUBT))
        || max_fit_s.is_some_and(|most| near(choice.fit_s, most, TIME_DOUBT))
}

/// The largest error that a point may have in truth, and the error itself.
pub(crate) fn errors(point: &Point, split: &str) -> Option<(f64, f64)> {
    let error = point.errors.get(split)?;
    let square = error.rms * error.rms;
    let margin = error.mean_square_error.map_or(0.0, |deviation| MARGIN * deviation);
    Some(((square + margin).sqrt(), error.rms))
}

/// The simplest point that meets the target: of those whose costs are within bounds and whose
/// error stays below the largest beyond its own uncertainty, the one of fewest bytes, then fewest
/// microseconds. Without a largest error, the affordable point of least error, or a simpler one whose
/// error is alike.
///
/// `None` where no point was measured on the split.
#[must_use]
pub fn decide(points: &[Point], split: &str, target: &Target) -> Option<Choice> {
    let measured: Vec<(usize, (f64, f64))> = points
        .iter()
        .enumerate()
        .filter_map(|(i, point)| Some((i, errors(point, split)?)))
        .collect();
    let least = |of: &dyn Fn(usize, (f64, f64)) -> (f64, f64, f64), among: &[usize]| {
        let candidates = measured.iter().filter(|(i, _)| among.contains(i));
        let key = |&&(i, e): &&(usize, (f64, f64))| of(i, e);
        candidates
            .min_by(|a, b| key(a).partial_cmp(&key(b)).unwrap_or(std::cmp::Ordering::Equal))
            .map(|(i, _)| *i)
    };
    let all: Vec<usize> = measured.iter().map(|(i, _)| *i).collect();
    let affordable: Vec<usize> =
        all.iter().copied().filter(|&i| target.affords(&points[i])).collect();
    let cost = |i: usize| (points[i].bytes as f64, points[i].evaluate_us);
    if affordable.is_empty() {
        let closest = least(&|i, e| (target.excess(&points[i]), e.1, cost(i).0), &all)?;
        return Some(Choice::Missed(closest));
    }
    let Some(most) = target.max_error else {
        let error = |i: &usize| errors(&points[*i], split).map_or(f64::NAN, |(_, error)| error);
        let best = least(&|i, e| (e.1, cost(i).0, cost(i).1), &affordable)?;
        let most = (1.0 + ALIKE) * error(&best);
        let alike: Vec<usize> = affordable.into_iter().filter(|i| error(i) <= most).collect();
        return least(&|i, e| (cost(i).0, e.1, cost(i).1), &alike).map(Choice::Met);
    };
    let sound = |i: &usize| measured.iter().any(|(j, e)| j == i && e.0 <= most);
    let meeting: Vec<usize> = affordable.iter().copied().filter(sound).collect();
    match least(&|i, _| (cost(i).0, cost(i).1, 0.0), &meeting) {
        Some(simplest) => Some(Choice::Met(simplest)),
        None => least(&|i, e| (e.1, cost(i).0, cost(i).1), &affordable).map(Choice::Missed),
    }
}

impl Shares {
    /// What would take most of the error away.
    #[must_use]
    pub fn remedy(&self) -> Remedy {
        if self.noise >= self.bias && self.noise >= self.coverage {
            Remedy::MoreRays
        } else if self.coverage >= self.bias {
            Remedy::MorePoses
        } else {
            Remedy::RicherModel
        }
    }
}

impl Remedy {
    /// As the end of a sentence that begins with "what would help most:".
    #[must_use]
    pub fn advice(self) -> &'static str {
        match self {
            Self::MoreRays => "more rays, for the model has learned the noise of the bake",
            Self::MorePoses => "more motion to train on, for it fails in poses that it never saw",
            Self::RicherModel => "a richer model, for it cannot even say what it has seen",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::choose::SplitError;

    fn point(bytes: u64, evaluate_us: f64, rms: f64, deviation: Option<f64>) -> Point {
        let error = SplitError { rms, mean_square_error: deviation, ..SplitError::default() };
        Point {
            name: format!("{bytes} {evaluate_us} {rms}"),
            family: String::new(),
            precision: String::new(),
            fit: serde_json::Value::Null,
            on: String::new(),
            bytes,
            tensor_bytes: bytes,
            mesh_percent: 0.0,
            evaluate_us,
            multiply_adds: 0,
            fit_s: 1.0,
            errors: [("novel".to_owned(), error)].into(),
        }
    }

    fn points() -> Vec<Point> {
        vec![
            point(100, 9.0, 0.10, None),
            point(400, 5.0, 0.05, None),
            point(400, 4.0, 0.05, None),
            point(900, 2.0, 0.02, None),
        ]
    }

    fn max_error(error: f64) -> Target {
        Target { max_error: Some(error), ..Target::default() }
    }

    /// The simplest point that is good enough, not the best one; time breaks ties of bytes.
    #[test]
    fn the_simplest_that_meets_is_taken() {
        assert_eq!(decide(&points(), "novel", &max_error(0.06)), Some(Choice::Met(2)));
        assert_eq!(decide(&points(), "novel", &max_error(0.2)), Some(Choice::Met(0)));
        assert_eq!(decide(&points(), "novel", &max_error(0.01)), Some(Choice::Missed(3)));
    }

    /// With costs alone the best that they allow; with both, and none, the closest is named.
    #[test]
    fn costs_bound_the_choice() {
        let bytes = Target { max_bytes: Some(500), ..Target::default() };
        assert_eq!(decide(&points(), "novel", &bytes), Some(Choice::Met(2)));
        let both = Target { max_error: Some(0.03), ..bytes };
        assert_eq!(decide(&points(), "novel", &both), Some(Choice::Missed(2)));
        let nothing = Target { max_bytes: Some(50), ..Target::default() };
        assert_eq!(decide(&points(), "novel", &nothing), Some(Choice::Missed(0)));
        assert_eq!(decide(&points(), "interpolated", &bytes), None);
        assert_eq!(decide(&[], "novel", &bytes), None);
    }

    /// A choice is in doubt where its figures are next to what the target bounds.
    #[test]
    fn close_figures_leave_a_doubt() {
        let choice = point(1000, 10.0, 0.05, None);
        let doubtful = |target: &Target| is_doubtful(&choice, "novel", target);
        let bytes = |most| Target { max_bytes: Some(most), ..Target::default() };
        assert!(!doubtful(&bytes(2000)) && doubtful(&bytes(1010)) && doubtful(&bytes(990)));
        assert!(!doubtful(&max_error(0.1)) && !doubtful(&max_error(0.01)));
        assert!(doubtful(&max_error(0.0505)) && doubtful(&max_error(0.0495)));
        let time = Target { max_us: Some(12.0), ..Target::default() };
        assert!(doubtful(&time), "times are guessed more coarsely");
        assert!(is_doubtful(&choice, "interpolated", &bytes(2000)), "not measured");
    }

    /// Of errors that are alike the simpler model is taken, of others the better one.
    #[test]
    fn alike_errors_leave_the_simpler() {
        let bytes = Target { max_bytes: Some(1000), ..Target::default() };
        let of = |simple: f64| {
            let points = [point(900, 1.0, 0.1, None), point(100, 9.0, simple, None)];
            decide(&points, "novel", &bytes)
        };
        assert_eq!(of(0.1009), Some(Choice::Met(1)));
        assert_eq!(of(0.1011), Some(Choice::Met(0)));
    }

    /// An error that is only perhaps small enough is not.
    #[test]
    fn uncertainty_counts_against_a_point() {
        let sure = point(900, 1.0, 0.04, Some(1e-6));
        let perhaps = point(100, 1.0, 0.049, Some(1e-3));
        let chosen = decide(&[perhaps, sure], "novel", &max_error(0.05));
        assert_eq!(chosen, Some(Choice::Met(1)));
    }

    /// The largest share names the remedy.
    #[test]
    fn the_remedy_is_for_the_largest_share() {
        let of = |noise, bias, coverage| Shares { noise, bias, coverage }.remedy();
        assert_eq!(of(3.0, 1.0, 2.0), Remedy::MoreRays);
        assert_eq!(of(0.0, 1.0, 2.0), Remedy::MorePoses);
        assert_eq!(of(0.0, 2.0, 1.0), Remedy::RicherModel);
    }
}
