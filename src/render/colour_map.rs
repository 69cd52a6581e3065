//! A perceptually uniform colour map: equal steps look equally large.

use std::sync::LazyLock;

/// What the curve runs through, in sRGB bytes: the anchors of the well-known viridis, dark violet
/// to yellow. It is readable in grey and by most colour-blind eyes, since lightness rises all along.
const ANCHORS: [[u8; 3]; 5] =
    [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];

/// Colours in the table.
const STEPS: usize = 256;

/// Points of the curve that its length is measured by.
const FINE: usize = 4096;

static TABLE: LazyLock<Vec<[f32; 3]>> = LazyLock::new(table);

/// The colour of a value from 0 to 1, linear sRGB; values outside are clamped, NaN is black.
#[must_use]
pub fn colour(value: f32) -> [f32; 3] {
    if value.is_nan() {
        return [0.0; 3];
    }
    TABLE[(value.clamp(0.0, 1.0) * (STEPS - 1) as f32).round() as usize]
}

/// A smooth curve through the anchors in OKLab (Ottosson 2020), cut into steps of equal length:
/// distances there are close to perceived ones.
fn table() -> Vec<[f32; 3]> {
    let anchors = ANCHORS.map(|bytes| to_oklab(bytes.map(|b| from_srgb(f64::from(b) / 255.0))));
    let fine: Vec<[f64; 3]> =
        (0..=FINE).map(|i| curve(&anchors, 4.0 * i as f64 / FINE as f64)).collect();
    let mut lengths = vec![0.0];
    for pair in fine.windows(2) {
        lengths.push(lengths[lengths.len() - 1] + distance(pair[0], pair[1]));
    }
    let total = lengths[FINE];
    (0..STEPS)
        .map(|step| {
            let wanted = total * step as f64 / (STEPS - 1) as f64;
            let at = lengths.partition_point(|length| *length < wanted).min(FINE);
            from_oklab(fine[at]).map(|c| c.clamp(0.0, 1.0) as f32)
        })
        .collect()
}

/// Catmull–Rom through the anchors, t from 0 to 4; the ends are continued straight.
fn curve(anchors: &[[f64; 3]; 5], t: f64) -> [f64; 3] {
    let piece = (t.floor() as usize).min(3);
    let f = t - piece as f64;
    let point = |i: isize, axis: usize| match i {
        -1 => 2.0 * anchors[0][axis] - anchors[1][axis],
        5 => 2.0 * anchors[4][axis] - anchors[3][axis],
        _ => anchors[i as usize][axis],
    };
    std::array::from_fn(|axis| {
        let [a, b, c, d] = [-1, 0, 1, 2].map(|offset| point(piece as isize + offset, axis));
        let (square, cube) = (f * f, f * f * f);
        0.5 * (2.0 * b
            + (c - a) * f
            + (2.0 * a - 5.0 * b + 4.0 * c - d) * square
            + (3.0 * b - a - 3.0 * c + d) * cube)
    })
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

fn from_srgb(value: f64) -> f64 {
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

fn to_oklab([r, g, b]: [f64; 3]) -> [f64; 3] {
    let l = (0.412_221_470_8 * r + 0.536_332_536_3 * g + 0.051_445_992_9 * b).cbrt();
    let m = (0.211_903_498_2 * r + 0.680_699_545_1 * g + 0.107_396_956_6 * b).cbrt();
    let s = (0.088_302_461_9 * r + 0.281_718_837_6 * g + 0.629_978_700_5 * b).cbrt();
    [
        0.210_454_255_3 * l + 0.793_617_785_0 * m - 0.004_072_046_8 * s,
        1.977_998_495_1 * l - 2.428_592_205_0 * m + 0.450_593_709_9 * s,
        0.025_904_037_1 * l + 0.782_771_766_2 * m - 0.808_675_766_0 * s,
    ]
}

fn from_oklab([lightness, a, b]: [f64; 3]) -> [f64; 3] {
    let l = (lightness + 0.396_337_777_4 * a + 0.215_803_757_3 * b).powi(3);
    let m = (lightness - 0.105_561_345_8 * a - 0.063_854_172_8 * b).powi(3);
    let s = (lightness - 0.089_484_177_5 * a - 1.291_485_548_0 * b).powi(3);
    [
        4.076_741_662_1 * l - 3.307_711_591_3 * m + 0.230_969_929_2 * s,
        -1.268_438_004_6 * l + 2.609_757_401_1 * m - 0.341_319_396_5 * s,
        -0.004_196_086_3 * l - 0.703_418_614_7 * m + 1.707_614_701_0 * s,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Steps are equal to 10 % in OKLab, lightness rises all the way, and no colour had to be cut
    /// to fit the screen by more than a byte.
    #[test]
    fn steps_look_equal() {
        let lab: Vec<[f64; 3]> = TABLE.iter().map(|c| to_oklab(c.map(f64::from))).collect();
        let steps: Vec<f64> = lab.windows(2).map(|pair| distance(pair[0], pair[1])).collect();
        let mean = steps.iter().sum::<f64>() / steps.len() as f64;
        for (i, step) in steps.iter().enumerate() {
            assert!((step / mean - 1.0).abs() < 0.1, "step {i}: {step} of {mean}");
        }
        assert!(lab.windows(2).all(|pair| pair[1][0] > pair[0][0]));
        let anchors = ANCHORS.map(|b| to_oklab(b.map(|b| from_srgb(f64::from(b) / 255.0))));
        for i in 0..=400 {
            let free = from_oklab(curve(&anchors, f64::from(i) / 100.0));
            assert!(free.iter().all(|c| (-0.004..=1.004).contains(c)), "{free:?}");
        }
    }

    /// The ends are the first and last anchor; what is outside stays there.
    #[test]
    fn ends_are_the_anchors() {
        let linear = |bytes: [u8; 3]| bytes.map(|b| from_srgb(f64::from(b) / 255.0) as f32);
        for (value, anchor) in [(0.0, 0), (-3.0, 0), (1.0, 4), (7.0, 4)] {
            let expected = linear(ANCHORS[anchor]);
            assert!(colour(value).iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-3));
        }
        assert_eq!(colour(f32::NAN), [0.0; 3]);
    }
}
