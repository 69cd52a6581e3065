//! How much a triangle's interpolated transfer may be wrong: what decides the order of splitting.

use glam::Vec3;

/// An estimate of a triangle's interpolation error from the transfer at its vertices (Křivánek,
/// Pattanaik and Žára 2004), or from what its last split found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ErrorMeasure {
    /// Equation 2, Σ ‖t₁ − t₂‖ / ‖t₁ + t₂‖ over the edges: the contrast, whatever the brightness.
    Contrast,
    /// Equation 3, Σ ‖t₁ − t₂‖ over the edges.
    Distance,
    /// Equation 4, the same over 1 + a·∠(n₁, n₁ + n₂ + n₃): less where normals diverge. As printed it
    /// depends on which vertex is the first; the largest angle of the three is taken unless
    /// `printed`.
    Curvature {
        /// The constant a, per radian.
        a: f32,
        /// Whether the first vertex alone counts.
        printed: bool,
        /// Whether it is multiplied by the root of the triangle's area, which the paper leaves out: the
        /// square is then what a jump within the triangle adds to the L² error.
        by_area: bool,
    },
    /// An estimate of the square of the L² error that the interpolation makes, 8A/45 Σ s²: A the area, s
    /// what each edge's middle lacks of the mean of its ends ([`Surplus`]), baked for the input and foretold
    /// for what comes of a split. The products of different edges are left out: where all three lack the
    /// same it is half of the integral, where they cancel more than that.
    Surplus,
    /// The same with every edge's middle baked, one split ahead: three times the rays, and nothing
    /// between the corners of a triangle is overlooked.
    Midpoint,
    /// The share of the input's triangle: all are split alike, to compare with.
    Uniform,
}

/// What the middles of a triangle's sides lack of the mean of their ends: measured where they were
/// baked, foretold where they were not.
///
/// A half of a side whose ends differ by the share σ of the way t₁ → t_m → t₂ is foretold s·σ² (the
/// square over both for a smooth function, where σ = ½; the whole for a step that falls into this
/// half); a side between two middles takes over that of the side that it is parallel to, by the
/// same square.
pub type Surplus = [f32; 3];

/// The transfer, and the normal, at one vertex in one view.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen<'a> {
    pub(super) transfer: &'a [f32],
    pub(super) normal: Vec3,
}

impl ErrorMeasure {
    /// Whether it looks at the middles of edges.
    pub(super) fn sees_middles(self) -> bool {
        matches!(self, Self::Surplus | Self::Midpoint)
    }

    /// Whether the estimate is multiplied by the root of the area.
    pub(super) fn is_by_area(self) -> bool {
        matches!(self, Self::Curvature { by_area: true, .. })
    }

    /// The estimate in one view, whatever the area; the last three are told apart from views.
    pub(super) fn of(&self, corners: [Seen<'_>; 3]) -> f32 {
        let [a, b, c] = corners;
        let sides = [[a, b], [b, c], [c, a]];
        let along = || sides.iter().map(|[p, q]| distance(p.transfer, q.transfer)).sum::<f32>();
        match *self {
            Self::Contrast => sides.iter().map(|[p, q]| contrast(p.transfer, q.transfer)).sum(),
            Self::Distance | Self::Surplus | Self::Midpoint | Self::Uniform => along(),
            Self::Curvature { a: weight, printed, .. } => {
                let mean = a.normal + b.normal + c.normal;
                let angle = |seen: Seen<'_>| {
                    let lengths = seen.normal.length() * mean.length();
                    let cosine = if lengths > 0.0 { seen.normal.dot(mean) / lengths } else { 1.0 };
                    cosine.clamp(-1.0, 1.0).acos()
                };
                let rest = if printed { 0.0 } else { angle(b).max(angle(c)) };
                along() / (1.0 + weight * angle(a).max(rest))
            }
        }
    }
}

/// ‖p − q‖.
pub(super) fn distance(p: &[f32], q: &[f32]) -> f32 {
    p.iter().zip(q).map(|(p, q)| (p - q).powi(2)).sum::<f32>().sqrt()
}

/// ‖p − q‖ / ‖p + q‖; 0 where nothing reaches either.
fn contrast(p: &[f32], q: &[f32]) -> f32 {
    let sum = p.iter().zip(q).map(|(p, q)| (p + q).powi(2)).sum::<f32>().sqrt();
    if sum > 0.0 { distance(p, q) / sum } else { 0.0 }
}

/// ‖m − (p + q) / 2‖.
pub(super) fn lack(middle: &[f32], p: &[f32], q: &[f32]) -> f32 {
    let square = |((m, p), q): ((&f32, &f32), &f32)| (m - (p + q) / 2.0).powi(2);
    middle.iter().zip(p).zip(q).map(square).sum::<f32>().sqrt()
}

/// What the sides of the four children of a split lack, foretold; `corners` and `middles` are the
/// parent's transfer, sides as in [`Surplus`], children as
/// [`Tessellation::split`](super::Tessellation::split) gives them.
pub(super) fn foretell(
    corners: [&[f32]; 3],
    middles: [&[f32]; 3],
    surplus: Surplus,
) -> [Surplus; 4] {
    let half = |corner: usize, side: usize| {
        let (from, to) = (side, (side + 1) % 3);
        let here = distance(corners[corner], middles[side]);
        let way = distance(corners[from], middles[side]) + distance(middles[side], corners[to]);
        surplus[side] * square_share(here, way, 0.5)
    };
    // Parallel to `side` runs the line between the middles of the two others.
    let inner = |side: usize| {
        let here = distance(middles[(side + 1) % 3], middles[(side + 2) % 3]);
        let way = distance(corners[side], middles[side])
            + distance(middles[side], corners[(side + 1) % 3]);
        surplus[side] * square_share(here, way, 0.5)
    };
    [
        [half(0, 0), inner(1), half(0, 2)],
        [half(1, 1), inner(2), half(1, 0)],
        [half(2, 2), inner(0), half(2, 1)],
        [inner(2), inner(0), inner(1)],
    ]
}

/// (part / whole)², at most 1; `flat`² where there is no whole.
fn square_share(part: f32, whole: f32, flat: f32) -> f32 {
    if whole > 0.0 { (part / whole).min(1.0).powi(2) } else { flat * flat }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BRIGHT: [f32; 2] = [3.0, 4.0];
    const DARK: [f32; 2] = [0.0, 0.0];

    fn seen(transfer: &[f32], normal: Vec3) -> Seen<'_> {
        Seen { transfer, normal }
    }

    /// The measures by hand: a bright corner and two dark ones on a flat triangle, and on a bent one.
    #[test]
    fn the_published_measures() {
        let flat = [&BRIGHT[..], &DARK, &DARK].map(|transfer| seen(transfer, Vec3::Z));
        assert_eq!(ErrorMeasure::Distance.of(flat), 10.0);
        assert_eq!(ErrorMeasure::Contrast.of(flat), 2.0);
        let four = |printed| ErrorMeasure::Curvature { a: 2.0, printed, by_area: false };
        assert!((four(false).of(flat) - 10.0).abs() < 1e-5);
        let mut bent = flat;
        bent[1].normal = Vec3::X;
        // The mean is (1, 0, 2): acos(2/√5) from z, acos(1/√5) from x.
        let (small, large) = ((2.0 / 5.0_f32.sqrt()).acos(), (1.0 / 5.0_f32.sqrt()).acos());
        assert!((four(true).of(bent) - 10.0 / (1.0 + 2.0 * small)).abs() < 1e-5);
        assert!((four(false).of(bent) - 10.0 / (1.0 + 2.0 * large)).abs() < 1e-5);
        // The order of the corners matters to the printed form alone.
        bent.rotate_left(1);
        assert!((four(true).of(bent) - 10.0 / (1.0 + 2.0 * large)).abs() < 1e-5);
        assert!((four(false).of(bent) - 10.0 / (1.0 + 2.0 * large)).abs() < 1e-5);
    }

    /// A quadratic function is foretold exactly along the sides where its slope dominates, a step
    /// stays whole in its half and leaves the other.
    #[test]
    fn children_are_foretold() {
        // f = 10 x + x², so steep that its halves differ little: s = 1/4, then a quarter of that.
        let at = |x: f32| 10.0 * x + x * x;
        let corners = [[at(0.0)], [at(1.0)], [at(0.5)]];
        let middles = [[at(0.5)], [at(0.75)], [at(0.25)]];
        let surplus = [0.25, 0.0625, 0.0625];
        let corner = [0, 1, 2].map(|i| &corners[i][..]);
        let children = foretell(corner, [0, 1, 2].map(|i| &middles[i][..]), surplus);
        assert!((children[0][0] - 0.0625).abs() < 0.006, "{children:?}");
        assert!((children[3][1] - 0.0625).abs() < 0.006, "{children:?}");
        // A step between corner 0 and the middle of side 0.
        let (corners, middles) = ([[0.0], [1.0], [1.0]], [[1.0], [1.0], [1.0]]);
        let corner = [0, 1, 2].map(|i| &corners[i][..]);
        let children = foretell(corner, [0, 1, 2].map(|i| &middles[i][..]), [0.5, 0.0, 0.5]);
        assert_eq!((children[0][0], children[1][2]), (0.5, 0.0));
    }
}
