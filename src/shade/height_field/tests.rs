use super::*;

fn order(bands: u8) -> Order {
    Order::new(bands).unwrap()
}

fn open() -> f32 {
    (2.0 * TAU).sqrt()
}

/// Level ground and a single sample block nothing, at their edges too; a slope that ends in level
/// ground is blocked by that ground alone, between the tangent plane and the horizontal.
#[test]
fn planes_are_open() {
    let slope: Vec<f32> = (0..64).map(|i| (i % 8) as f32 * 0.5 - (i / 8) as f32 * 0.25).collect();
    let shadows = HorizonShadows::new(order(4), 32);
    let mut v = [0.0; 16];
    shadows.visibility(&HeightField::new(1, 1, 1.0, &[3.0]).unwrap(), 0, 0, &mut v);
    assert!((v[0] - open()).abs() < 1e-5, "{v:?}");
    shadows.visibility(&HeightField::new(8, 8, 1.0, &slope).unwrap(), 4, 4, &mut v);
    // Half of the lune between a plane of slope √(½² + ¼²) and the level, at most.
    let lune = (0.3125_f32.sqrt().atan() / TAU) * open();
    assert!(v[0] < open() - 0.5 * lune && v[0] > open() - 1.05 * lune, "{v:?} {lune}");
    shadows.visibility(&HeightField::new(8, 8, 1.0, &[2.0; 64]).unwrap(), 0, 7, &mut v);
    assert!((v[0] - open()).abs() < 1e-5 && v[1..].iter().all(|x| x.abs() < 1e-5), "{v:?}");
}

/// Before a long wall of height h at distance d the share of the sphere that is blocked is the
/// lune between the ground and the wall's top, atan(h/d)/2π of the sphere.
#[test]
fn a_wall_has_its_closed_form() {
    let (size, wall) = (256, 4.0_f32);
    let heights: Vec<f32> =
        (0..size * size).map(|i| if i % size >= size / 2 + 4 { wall } else { 0.0 }).collect();
    let field = HeightField::new(size, size, 1.0, &heights).unwrap();
    let shadows = HorizonShadows::new(order(2), 128);
    let mut v = [0.0; 4];
    shadows.visibility(&field, size / 2, size / 2, &mut v);
    // The first high sample is 4 away, and heights rise over the sample before it.
    let blocked = f64::from(1.0 - v[0] / open());
    let exact = |d: f64| (f64::from(wall) / d).atan() / std::f64::consts::TAU;
    assert!((exact(5.2)..exact(3.2)).contains(&blocked), "{blocked} {}", exact(4.0));
    // The dark side is +X: the visible light leans to −X.
    assert!(v[3] < -0.05, "{v:?}");
}

/// Against horizons that are looked for at every half sample to the edge, over bumpy ground:
/// the visibility is near theirs, integrated slowly.
#[test]
fn bumps_agree_with_traced_horizons() {
    let size = 48;
    let bump = |i: usize| {
        let (x, y) = ((i % size) as f32, (i / size) as f32);
        3.0 * (x * 0.31).sin() * (y * 0.23).cos() + 1.5 * (x * 0.11 + y * 0.17).sin()
    };
    let heights: Vec<f32> = (0..size * size).map(bump).collect();
    let field = HeightField::new(size, size, 1.0, &heights).unwrap();
    let n = order(3);
    let shadows = HorizonShadows::new(n, 32);
    let (mut found, mut apart) = ([0.0; 9], Vec::new());
    for (column, row) in [(10, 12), (24, 24), (33, 20), (17, 38), (40, 9)] {
        shadows.visibility(&field, column, row, &mut found);
        let expected = traced(&field, n, column, row);
        let off: f64 = found.iter().zip(&expected).map(|(a, b)| (f64::from(*a) - b).powi(2)).sum();
        apart.push(off.sqrt() / f64::from(open()));
    }
    let mean = apart.iter().sum::<f64>() / apart.len() as f64;
    assert!(mean < 0.05, "{apart:?}");
}

fn traced(field: &HeightField, order: Order, column: usize, row: usize) -> Vec<f64> {
    let mut out = vec![0.0; order.coefficients()];
    let mut y = vec![0.0; order.coefficients()];
    out[0] = f64::from(open());
    let (turns, here) = (96, field.at(0, column as f32, row as f32));
    let [sx, sy] = field.slope(column, row);
    for k in 0..turns {
        let (sin, cos) = (TAU * k as f32 / turns as f32).sin_cos();
        let horizon = (1..200)
            .map(|step| {
                let d = step as f32 * 0.5;
                let there = field.at(0, column as f32 + d * cos, row as f32 + d * sin);
                (there - here) / d
            })
            .fold(f32::NEG_INFINITY, f32::max);
        let tangent = sx * cos + sy * sin;
        if horizon <= tangent {
            continue;
        }
        let [low, high] = [tangent, horizon].map(|s| f64::from(s / (1.0 + s * s).sqrt()));
        for (x, weight) in gauss_legendre(12) {
            let z = f64::midpoint(low, high) + (high - low) / 2.0 * x;
            let r = (1.0 - z * z).sqrt();
            evaluate_f64(order, [r * f64::from(cos), r * f64::from(sin), z], &mut y);
            let share = weight * (high - low) / 2.0 * f64::from(TAU) / turns as f64;
            out.iter_mut().zip(&y).for_each(|(out, y)| *out -= share * y);
        }
    }
    out
}

/// A field that gets other heights is the field of those heights, at every size; heights that are
/// none leave it as it was. Horizons that are looked for at every half sample agree with it.
#[test]
fn fields_move() {
    for (width, height) in [(1, 1), (7, 5), (16, 3), (9, 16)] {
        let heights = |phase: f32| -> Vec<f32> {
            (0..width * height).map(|i| (i as f32 * 0.7 + phase).sin()).collect()
        };
        let mut field = HeightField::new(width, height, 0.5, &heights(0.0)).unwrap();
        field.set_heights(&heights(1.0)).unwrap();
        assert_eq!(field, HeightField::new(width, height, 0.5, &heights(1.0)).unwrap());
        assert!(field.set_heights(&vec![f32::NAN; width * height]).is_err());
        assert!(field.set_heights(&[0.0; 2]).is_err());
        assert_eq!(field, HeightField::new(width, height, 0.5, &heights(1.0)).unwrap());
    }
    let bumps: Vec<f32> =
        (0..1024).map(|i| (i as f32 * 0.3).sin() + (i as f32 / 90.0).cos()).collect();
    let field = HeightField::new(32, 32, 1.0, &bumps).unwrap();
    let shadows = HorizonShadows::new(order(3), 32);
    let (mut found, mut slow) = ([0.0; 9], [0.0; 9]);
    shadows.visibility(&field, 16, 11, &mut found);
    shadows.visibility_traced(&field, 16, 11, 0.5, &mut slow);
    let off: f32 = found.iter().zip(&slow).map(|(a, b)| (a - b).powi(2)).sum();
    assert!(off.sqrt() < 0.08 * open(), "{found:?} {slow:?}");
}

/// All samples of a row at once are as each alone, for fields of every shape.
#[test]
fn rows_are_their_samples() {
    for (width, height) in [(1, 1), (2, 1), (1, 7), (33, 20), (64, 5)] {
        let heights: Vec<f32> = (0..width * height)
            .map(|i| 2.0 * (i as f32 * 0.61).sin() + (i / width) as f32)
            .collect();
        let field = HeightField::new(width, height, 0.7, &heights).unwrap();
        let shadows = HorizonShadows::new(order(4), 16);
        for row in [0, height / 2, height - 1] {
            let mut all = vec![0.0; 16 * width];
            shadows.visibility_row(&field, row, &mut all);
            for (column, found) in all.chunks_exact(16).enumerate() {
                let mut alone = [0.0; 16];
                shadows.visibility(&field, column, row, &mut alone);
                let off = found.iter().zip(&alone).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                assert!(off < 1e-4, "{width} × {height} at {column}, {row}: {off}");
            }
        }
    }
}

/// NaN, sizes that do not fit and cells without length are refused with the numbers.
#[test]
fn bad_fields_are_refused() {
    let refused = |width, height, cell, heights: &[f32], word: &str| {
        let message = HeightField::new(width, height, cell, heights).unwrap_err().to_string();
        assert!(message.contains(word), "{message}");
    };
    refused(2, 1, 1.0, &[0.0, f32::NAN], "1 of them");
    refused(2, 2, 1.0, &[0.0; 3], "2 × 2");
    refused(0, 0, 1.0, &[], "0 × 0");
    refused(1, 1, 0.0, &[0.0], "0 m");
    refused(usize::MAX, 2, 1.0, &[0.0], "heights");
}

/// Heights and distances at their bounds have horizons of finite numbers; beyond them they are refused,
/// for their slopes have no squares in f32.
#[test]
fn huge_heights_are_bounded() {
    for (height, cell) in [(3e38, 1.0), (-3e38, 1.0), (1.1e9, 1.0), (1.0, 1e-30), (1.0, 1e20)] {
        let told = HeightField::new(2, 1, cell, &[0.0, height]).unwrap_err().to_string();
        assert!(told.contains("±1,000,000,000 m") && told.contains("0.000001"), "{told}");
    }
    let steep = [-1e9, 1e9, -1e9, 1e9, 1e9, -1e9];
    let mut field = HeightField::new(3, 2, 1e-6, &steep).unwrap();
    assert!(field.set_heights(&[3e38; 6]).is_err());
    let shadows = HorizonShadows::new(Order::new(4).unwrap(), 16);
    let mut row = vec![0.0; 3 * 16];
    shadows.visibility_row(&field, 1, &mut row);
    assert!(row.iter().all(|x| x.is_finite()), "{row:?}");
    assert!((0..3).all(|column| field.normal(column, 1).is_normalized()));
}
