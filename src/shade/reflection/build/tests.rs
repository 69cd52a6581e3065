use std::f64::consts::{PI, TAU};

use super::project::elevations;
use super::*;
use crate::sh::{evaluate_f64, zonal};
use crate::shade::Brdf;

fn order(bands: u8) -> Order {
    Order::new(bands).unwrap()
}

/// A reflectance that is treated as if it had no symmetry.
struct Plain(Brdf);

impl Reflectance for Plain {
    fn reflect(&self, incoming: [f64; 3], outgoing: [f64; 3]) -> [f64; 3] {
        self.0.reflect(incoming, outgoing)
    }

    fn is_isotropic(&self) -> bool {
        false
    }
}

fn one(n: Order) -> Vec<f64> {
    let mut out = vec![0.0; n.coefficients()];
    out[0] = (4.0 * PI).sqrt();
    out
}

fn views() -> Vec<[f64; 3]> {
    let angles = [(0.0, 0.0), (0.3, 1.0), (0.8, 2.0), (1.2, -2.5), (1.5, 0.4)];
    angles.map(|(t, p): (f64, f64)| [t.sin() * p.cos(), t.sin() * p.sin(), t.cos()]).to_vec()
}

/// Directions over the upper hemisphere (and the lower one, turned over) with solid angles.
fn sphere(nodes: usize) -> Vec<([f64; 3], f64)> {
    let step = TAU / (2 * nodes) as f64;
    elevations(nodes)
        .into_iter()
        .flat_map(|[sin, cos, weight]| {
            (0..2 * nodes).flat_map(move |k| {
                let (s, c) = (step * (k as f64 + 0.5)).sin_cos();
                [cos, -cos].map(|z| ([sin * c, sin * s, z], weight * step))
            })
        })
        .collect()
}

/// One term of a Lambert operator turns open visibility into exactly the transfer of an open
/// point, from wherever it is seen: albedo · unshadowed, to 1e-6.
#[test]
fn a_lambert_operator_is_transfer_where_nothing_occludes() {
    for bands in [2, 4, 6] {
        let n = order(bands);
        let lambert = Brdf::Lambert { albedo: [0.6, 0.3, 0.9] };
        let factored = &factor(&lambert, n, 16).unwrap()[0];
        let operator = factored.operator(1);
        assert_eq!((operator.terms(), operator.order()), (1, n));
        let expected = zonal::clamped_cosine(n);
        let mut transfer = vec![0.0; n.coefficients()];
        for view in views() {
            operator.transfer(&one(n), view, &mut transfer);
            for (i, t) in transfer.iter().enumerate() {
                let l = i.isqrt();
                let zonal = if i == l * (l + 1) { 0.6 * expected[l] / PI } else { 0.0 };
                assert!((t - zonal).abs() < 1e-6, "order {bands}, {i}: {t} {zonal}");
            }
        }
    }
}

/// Where something occludes, a Lambert operator approaches transfer as the order of visibility rises: a
/// point of a floor beside a sphere that fills 40° around a direction 50° from the normal, whose
/// visibility is known in closed form; transfer by a slow integral, over the bands that all orders have.
#[test]
fn a_lambert_operator_approaches_transfer_where_something_occludes() {
    let lambert = Brdf::Lambert { albedo: [1.0; 3] };
    let (sin, cos) = 50_f64.to_radians().sin_cos();
    let (towards, half_angle) = ([sin, 0.0, cos], 40_f64.to_radians());
    let (mut expected, mut y) = ([0.0; 9], [0.0; 9]);
    for (w, area) in sphere(64).into_iter().filter(|(w, _)| w[2] > 0.0) {
        let along: f64 = w.iter().zip(towards).map(|(a, b)| a * b).sum();
        if along < half_angle.cos() {
            evaluate_f64(order(3), w, &mut y);
            expected.iter_mut().zip(y).for_each(|(sum, y)| *sum += area * w[2] * y / PI);
        }
    }
    let apart = |bands: u8| {
        let n = order(bands);
        let mut visible = vec![0.0; n.coefficients()];
        zonal::rotate_f64(n, &zonal::cap(n, half_angle), towards, &mut visible);
        visible.iter_mut().for_each(|v| *v = -*v);
        visible[0] += (4.0 * PI).sqrt();
        let mut found = vec![0.0; n.coefficients()];
        let operator = factor(&lambert, n, 12).unwrap()[0].operator(1);
        operator.transfer(&visible, [0.0, 0.0, 1.0], &mut found);
        let squares = found.iter().zip(&expected).map(|(a, b)| (a - b).powi(2));
        (squares.sum::<f64>() / expected.iter().map(|x| x * x).sum::<f64>()).sqrt()
    };
    let off = [3, 4, 6, 8].map(apart);
    for (off, expected) in off.into_iter().zip([0.098, 0.018, 0.0026, 0.0019]) {
        assert!((off / expected - 1.0).abs() < 0.1, "{off} {expected}");
    }
}

/// A reflectance has as many terms as any of its colours, and an operator of more than that has those;
/// the three colours of one have the same number.
#[test]
fn terms_above_the_rank_are_left_out() {
    let factored = factor(&Brdf::Lambert { albedo: [0.6, 0.0, 0.9] }, order(4), 12).unwrap();
    assert_eq!(factored.each_ref().map(Factored::rank), [1; 3]);
    assert_eq!(factored.each_ref().map(|colour| colour.operator(8).terms()), [1; 3]);
    assert_eq!(factored[0].most_terms(), 16);
    let mixed = Brdf::Phong { diffuse: [0.5; 3], specular: [0.0, 0.4, 0.0], exponent: 9.0 };
    let apart = Factoring { colours: Colours::Apart, ..Factoring::default() };
    let factored = factor_by(&mixed, order(3), 16, apart).unwrap();
    let ranks = factored.each_ref().map(Factored::rank);
    assert!(ranks[0] > 1 && ranks == [ranks[0]; 3], "{ranks:?}");
    let cut = |colour: usize| factored[colour].error(1) - factored[colour].band_limit();
    assert!(cut(0) < 1e-6 && cut(1) > 0.05, "{} {}", cut(0), cut(1));
}

/// Between light and visibility nothing is lost: the radiance is the integral of the light's bands
/// times the visibility's bands times albedo/π and the cosine, integrated slowly.
#[test]
fn light_and_visibility_meet_without_loss() {
    let n = order(3);
    let operator = factor(&Brdf::Lambert { albedo: [0.5; 3] }, n, 16).unwrap()[1].operator(9);
    let light: Vec<f64> = (0..9).map(|i| (f64::from(i) * 1.3).cos()).collect();
    let visibility: Vec<f64> = (0..9).map(|i| (f64::from(i) * 0.7).sin()).collect();
    let (mut y, mut expected) = ([0.0; 9], 0.0);
    for (w, area) in sphere(12) {
        evaluate_f64(n, w, &mut y);
        let value = |c: &[f64]| c.iter().zip(&y).map(|(c, y)| c * y).sum::<f64>();
        expected += area * value(&light) * value(&visibility) * 0.5 / PI * w[2].max(0.0);
    }
    let mut transfer = [0.0; 9];
    for view in views() {
        operator.transfer(&visibility, view, &mut transfer);
        let found: f64 = transfer.iter().zip(&light).map(|(t, l)| t * l).sum();
        // The clamped cosine has bands beyond the five that three times three can see, which the
        // product of light and visibility does not have: nothing is cut.
        assert!((found - expected).abs() < 1e-6, "{found} {expected}");
    }
}

/// The white furnace: under light 1 from everywhere with nothing in the way, the radiance towards
/// the viewer is what plain integration of f cos gives, closer with more bands.
#[test]
fn the_white_furnace_gives_back_the_albedo() {
    let half = [0.5; 3];
    for (brdf, tolerance) in [
        (Brdf::Lambert { albedo: half }, 1e-6),
        (Brdf::Phong { diffuse: half, specular: half, exponent: 8.0 }, 0.01),
        (Brdf::Ggx { normal_reflectance: half, alpha: [0.5; 2] }, 0.02),
        (Brdf::AshikhminShirley { diffuse: half, specular: half, exponents: [6.0; 2] }, 0.01),
    ] {
        let n = order(5);
        let factored = &factor(&brdf, n, 24).unwrap()[0];
        let operator = factored.operator(factored.most_terms());
        let mut transfer = vec![0.0; n.coefficients()];
        for view in views() {
            operator.transfer(&one(n), view, &mut transfer);
            let found = transfer[0] * (4.0 * PI).sqrt();
            let lit = sphere(48).into_iter();
            let expected: f64 =
                lit.map(|(w, area)| area * w[2].max(0.0) * brdf.reflect(w, view)[0]).sum();
            let off = (found - expected).abs() * view[2];
            assert!(off < tolerance, "{brdf:?}, {view:?}: {found} {expected}");
        }
    }
}

/// Narrow lobes and those of a grain give back what they take: averaged over views, the furnace of an
/// operator is the albedo, 1 for mirrors and less where facets hide one another (slow sums of the
/// closed forms: 0.937 and 0.855).
#[test]
fn narrow_lobes_give_back_their_albedo() {
    let white = [1.0; 3];
    let ggx = |alpha| Brdf::Ggx { normal_reflectance: white, alpha };
    let (diffuse, specular, exponents) = ([0.0; 3], white, [100.0, 10_000.0]);
    for (brdf, nodes, expected) in [
        (ggx([0.02; 2]), 32, 0.993),
        (ggx([0.01; 2]), 32, 0.997),
        (ggx([0.05, 0.2]), 14, 0.937),
        (Brdf::AshikhminShirley { diffuse, specular, exponents }, 14, 0.855),
    ] {
        let n = order(4);
        let factored = &factor(&brdf, n, nodes).unwrap()[0];
        let operator = factored.operator(factored.most_terms());
        let mut transfer = vec![0.0; n.coefficients()];
        let (mut mean, mut area) = (0.0, 0.0);
        for (view, weight) in sphere(12).into_iter().filter(|(view, _)| view[2] > 0.0) {
            operator.transfer(&one(n), view, &mut transfer);
            mean += weight * transfer[0] * (4.0 * PI).sqrt();
            area += weight;
        }
        let found = mean / area;
        assert!((found - expected).abs() < 6e-3, "{brdf:?}: {found} {expected}");
    }
}

/// The stated error is that of the factored reflectance, integrated over all pairs of directions;
/// it falls with terms and with bands.
#[test]
fn errors_are_those_of_the_factors() {
    let brdf = Brdf::Phong { diffuse: [0.3; 3], specular: [0.5; 3], exponent: 6.0 };
    let factored = &factor(&brdf, order(4), 24).unwrap()[2];
    let curve: Vec<f64> = (0..=factored.most_terms()).map(|k| factored.error(k)).collect();
    assert!((curve[0] - 1.0).abs() < 1e-12 && curve.windows(2).all(|p| p[1] <= p[0]), "{curve:?}");
    let finer = &factor(&brdf, order(5), 24).unwrap()[2];
    assert!(finer.error(finer.most_terms()) < curve[curve.len() - 1]);
    let terms = 4;
    let directions = sphere(20);
    let (mut y, mut all, mut apart) = (vec![0.0; 49], 0.0, 0.0);
    let factors = |table: &[f64], n: Order, w: [f64; 3], y: &mut [f64]| -> Vec<f64> {
        evaluate_f64(n, w, y);
        let rows = table.chunks_exact(n.coefficients()).take(terms);
        rows.map(|row| row.iter().zip(&*y).map(|(a, b)| a * b).sum()).collect()
    };
    let (light, view) = (&factored.light, &factored.view);
    let incoming: Vec<Vec<f64>> =
        directions.iter().map(|(w, _)| factors(light, order(7), *w, &mut y)).collect();
    for (o, view_area) in directions.iter().filter(|(o, _)| o[2] > 0.0) {
        let w = factors(view, order(4), *o, &mut y);
        for ((i, area), u) in directions.iter().zip(&incoming) {
            let f = brdf.reflect(*i, *o)[2] * i[2].max(0.0);
            let sum: f64 = u.iter().zip(&w).map(|(u, w)| u * w).sum();
            all += area * view_area * f * f;
            apart += area * view_area * (f - sum).powi(2);
        }
    }
    let measured = (apart / all).sqrt();
    assert!((measured - curve[terms]).abs() < 1e-3, "{measured} {}", curve[terms]);
}

/// The error has its parts told apart: what no term mends is the limit of the bands, the light's
/// bands alone hold more than light and view together, and under a light of these bands the error is
/// smaller than over all directions. The part that the light's bands hold is that of its slow integral.
#[test]
fn errors_are_told_apart() {
    let n = order(3);
    for brdf in [
        Brdf::Phong { diffuse: [0.3; 3], specular: [0.5; 3], exponent: 20.0 },
        Brdf::Ggx { normal_reflectance: [0.5; 3], alpha: [0.4, 0.7] },
    ] {
        let factored = &factor(&brdf, n, 20).unwrap()[0];
        let limit = factored.band_limit();
        assert!((limit - factored.error(9)).abs() < 1e-15 && limit > 0.05, "{limit}");
        assert!(factored.error(2) > limit && factored.lit_error(2) < factored.error(2));
        assert!(factored.lit < factored.energy && factored.lit_error(9) > 0.0);
        let directions = sphere(20);
        let (mut y, mut lit) = (vec![0.0; 25], 0.0);
        for (o, view_area) in directions.iter().filter(|(o, _)| o[2] > 0.0) {
            let mut sums = [0.0; 25];
            for (i, area) in directions.iter().filter(|(i, _)| i[2] > 0.0) {
                evaluate_f64(order(5), *i, &mut y);
                let f = area * brdf.reflect(*i, *o)[0] * i[2];
                sums.iter_mut().zip(&y).for_each(|(sum, y)| *sum += f * y);
            }
            lit += view_area * sums.iter().map(|x| x * x).sum::<f64>();
        }
        // The even sum is off by some thousandths itself.
        assert!((factored.lit / lit - 1.0).abs() < 5e-3, "{} {lit}", factored.lit);
    }
}

const MATRIX: Factoring = Factoring { cosine: Cosine::Matrix, colours: Colours::Together };

/// Colours that share their light factors have the same matrices; their errors, told for each, are
/// those of the factors, and together no larger than with the factors of any one colour. With all
/// the terms that there are nothing but the bands' own limit is left, which is that of colours apart.
#[test]
fn colours_share_their_light_factors() {
    let n = order(3);
    let brdf = Brdf::Ggx { normal_reflectance: [0.95, 0.6, 0.2], alpha: [0.5; 2] };
    let apart = Factoring { colours: Colours::Apart, ..Factoring::default() };
    let (together, apart) =
        (factor(&brdf, n, 24).unwrap(), factor_by(&brdf, n, 24, apart).unwrap());
    let operators = together.each_ref().map(|colour| colour.operator(4));
    assert!(operators[1..].iter().all(|o| o.matrices() == operators[0].matrices()));
    assert!(operators[0].view() != operators[2].view());
    for (together, apart) in together.iter().zip(&apart) {
        assert!((together.band_limit() - apart.band_limit()).abs() < 1e-9);
        for k in 1..9 {
            let [a, b] = [together, apart].map(|f| f.error(k));
            // Fresnel's tint changes the factors little.
            assert!(a > b - 1e-12 && a < b + 0.03, "{k} terms: {a} {b}");
        }
    }
    // The stated error against slow integration, of the blue colour, which differs most.
    let (diffuse, specular) = ([0.3, 0.5, 0.1], [0.5, 0.2, 0.4]);
    let brdf = Brdf::Phong { diffuse, specular, exponent: 6.0 };
    let (blue, terms) = (&factor(&brdf, n, 24).unwrap()[2], 4);
    let (mut y, mut all, mut off) = (vec![0.0; 25], 0.0, 0.0);
    let directions = sphere(20);
    let above: Vec<_> = directions.iter().filter(|(o, _)| o[2] > 0.0).collect();
    let mut values = |table: &[f64], of: Order, w: [f64; 3]| -> Vec<f64> {
        evaluate_f64(of, w, &mut y);
        let rows = table.chunks_exact(of.coefficients()).take(terms);
        rows.map(|row| row.iter().zip(&y).map(|(a, b)| a * b).sum()).collect()
    };
    let incoming: Vec<Vec<f64>> =
        directions.iter().map(|(w, _)| values(&blue.light, order(5), *w)).collect();
    for (o, view_area) in above {
        let w = values(&blue.view, n, *o);
        for ((i, area), u) in directions.iter().zip(&incoming) {
            let f = brdf.reflect(*i, *o)[2] * i[2].max(0.0);
            let sum: f64 = u.iter().zip(&w).map(|(u, w)| u * w).sum();
            all += area * view_area * f * f;
            off += area * view_area * (f - sum).powi(2);
        }
    }
    let measured = (off / all).sqrt();
    assert!((measured - blue.error(terms)).abs() < 1e-3, "{measured} {}", blue.error(terms));
}

/// With the cosine as a matrix of its own, a Lambert operator is exact with one term where nothing
/// occludes; a gloss has nearly the reflection of the other form, and comes nearer as the order rises.
#[test]
fn the_cosine_may_be_a_matrix() {
    let apart = |brdf: &Brdf, bands: u8| -> f64 {
        let n = order(bands);
        let count = n.coefficients();
        let inside = &factor(brdf, n, 24).unwrap()[0];
        let matrix = &factor_by(brdf, n, 24, MATRIX).unwrap()[0];
        let [inside, matrix] = [inside, matrix].map(|f| f.operator(count));
        let (mut a, mut b) = (vec![0.0; count], vec![0.0; count]);
        let (mut off, mut all) = (0.0, 0.0);
        for view in views() {
            inside.transfer(&one(n), view, &mut a);
            matrix.transfer(&one(n), view, &mut b);
            // The bands that both can hold.
            off += a.iter().zip(&b).take(9).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
            all += a.iter().take(9).map(|a| a * a).sum::<f64>();
        }
        (off / all).sqrt()
    };
    let lambert = Brdf::Lambert { albedo: [0.6; 3] };
    let factored = &factor_by(&lambert, order(4), 12, MATRIX).unwrap()[0];
    assert!(factored.error(1) < 1e-7, "{}", factored.error(1));
    assert!(apart(&lambert, 4) < 1e-7);
    let gloss = Brdf::Ggx { normal_reflectance: [0.5; 3], alpha: [0.6; 2] };
    let (coarse, fine) = (apart(&gloss, 3), apart(&gloss, 7));
    assert!(fine < 0.5 * coarse && fine < 0.05, "{coarse} {fine}");
}

/// The shorter way for isotropic reflectances gives the operator of the longer one.
#[test]
fn isotropy_is_a_short_cut_only() {
    let brdf = Brdf::Phong { diffuse: [0.3; 3], specular: [0.1, 0.5, 0.7], exponent: 3.0 };
    let n = order(3);
    let (short, long) = (factor(&brdf, n, 12).unwrap(), factor(&Plain(brdf), n, 12).unwrap());
    let visibility: Vec<f64> = (0..9).map(|i| (f64::from(i) * 0.7).sin()).collect();
    let (mut a, mut b) = ([0.0; 9], [0.0; 9]);
    for (short, long) in short.iter().zip(&long) {
        assert!((short.energy / long.energy - 1.0).abs() < 1e-3);
        for view in views() {
            short.operator(9).transfer(&visibility, view, &mut a);
            long.operator(9).transfer(&visibility, view, &mut b);
            assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-4), "{a:?} {b:?}");
        }
    }
}

/// A black reflectance has an operator that gives nothing, without NaN.
#[test]
fn black_surfaces_reflect_nothing() {
    let factored = &factor(&Brdf::Lambert { albedo: [0.0; 3] }, order(3), 8).unwrap()[0];
    assert_eq!(factored.error(3), 0.0);
    let mut transfer = [1.0; 9];
    factored.operator(2).transfer(&one(order(3)), [0.0, 0.0, 1.0], &mut transfer);
    assert!(transfer.iter().all(|t| *t == 0.0));
}

/// A mirror-like lobe under a narrow lamp is as wide as the bands can tell, and no wider: half of
/// the peak is reached within the width of the order's own narrowest lobe, which narrows as the
/// order rises.
#[test]
fn sharp_lobes_widen_to_the_order_and_no_further() {
    let brdf = Brdf::Ggx { normal_reflectance: [1.0; 3], alpha: [0.12; 2] };
    let mut widths = Vec::new();
    for bands in [3, 5] {
        let n = order(bands);
        let factored = &factor(&brdf, n, 40).unwrap()[0];
        let operator = factored.operator(factored.most_terms());
        let incoming = [0.6, 0.0, 0.8];
        let mut light = vec![0.0; n.coefficients()];
        evaluate_f64(n, incoming, &mut light);
        let mut transfer = vec![0.0; n.coefficients()];
        let mut radiance = |degrees: f64| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            operator.transfer(&one(n), [-sin, 0.0, cos], &mut transfer);
            transfer.iter().zip(&light).map(|(t, l)| t * l).sum::<f64>()
        };
        let (mut peak, mut at) = (0.0, 0.0);
        for degrees in 0..80 {
            let value = radiance(f64::from(degrees));
            if value > peak {
                (peak, at) = (value, f64::from(degrees));
            }
        }
        // The mirror direction is 36.9° from the normal.
        assert!((at - 36.9).abs() < 12.0, "order {bands}: the peak is at {at}°");
        let half = (0..90).map(f64::from).find(|d| radiance(at - d) < 0.5 * peak).unwrap();
        // A delta function of n bands falls to half at 2.215/n radians, where J₁(x)/x does.
        let limit = 1.25 * (2.215 / f64::from(bands)).to_degrees();
        assert!(half < limit, "order {bands}: {half}° of {limit}°");
        widths.push(half);
    }
    assert!(widths[1] < widths[0], "{widths:?}");
}
