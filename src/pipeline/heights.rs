//! Pictures of height fields, still or moving: visibility by horizons, shaded by the same operators as
//! characters.

use glam::{DQuat, Quat, Vec3};
use rayon::prelude::*;

use super::finish::Finish;
use super::gloss::{Gloss, GlossPoints, upright};
use super::still::{StillError, exposure};
use crate::render::{Picture, Tone};
use crate::rig::to_tangent_frame;
use crate::sh::{MAX_COEFFICIENTS, Order};
use crate::shade::{HeightField, HorizonShadows, MOST_AZIMUTHS, MOST_LOBES, ShLight};

/// The most frames.
pub const MOST_HEIGHT_FRAMES: usize = 1000;

/// The most samples of a side.
const MOST_SIDE: usize = 4096;

/// Places at which horizons are traced for the error.
const PLACES: usize = 64;

/// Fields, and how they are seen: from straight above, a pixel for each sample. Columns go along +X and
/// rows along −Z of the light's frame, so that the first row is at the bottom of the picture.
#[derive(Debug, Clone)]
pub struct Heights<'a> {
    /// Columns and rows.
    pub size: [usize; 2],
    /// Metres between neighbours.
    pub cell_m: f32,
    /// `[frame][row][column]`, metres.
    pub heights: &'a [f32],
    /// Bands of visibility and light.
    pub order: Order,
    /// Wedges of the horizon.
    pub azimuths: usize,
    /// +Y is up.
    pub light: &'a ShLight,
    /// What the ground reflects by; a grain runs along the rows.
    pub finish: Finish,
    /// Terms of the reflectance's operator.
    pub terms: usize,
    /// Zonal lobes that stand for the light, 1 to 8.
    pub lobes: usize,
    /// How light is brought within the screen's range.
    pub tone: Tone,
    /// Stops of brightness; at 0 the brightest open white surface is white.
    pub exposure_stops: f32,
}

/// The pictures and what is to be said of them.
#[derive(Debug, Clone)]
pub struct HeightPictures {
    /// One for each frame.
    pub pictures: Vec<Picture>,
    /// What values were multiplied with.
    pub exposure: f32,
    /// Mean and largest distance of the first frame's visibility from that by traced horizons, over some
    /// samples, in units of open sky.
    pub error: [f32; 2],
    /// Seconds that visibility took in a frame, on all threads.
    pub visibility_s: f64,
}

/// Shades fields.
///
/// # Errors
/// [`StillError::Setting`]; [`StillError::Field`] of heights that are none.
pub fn heights(settings: &Heights<'_>) -> Result<HeightPictures, StillError> {
    check(settings)?;
    let Heights { size: [width, height], cell_m, order, .. } = *settings;
    let reflector = settings.finish.operator("heights", order, settings.terms)?;
    let turn: fn(Vec3) -> Quat = if settings.finish.is_isotropic() { upright } else { along_rows };
    // +Y of the light is +Z of the field, −Z its +Y.
    let light = settings.light.resized(order);
    let upright = DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2);
    let gloss = Gloss::of(&light.rotated(upright), reflector, settings.lobes);
    let exposure = exposure(Some(&light), settings.exposure_stops);
    let shadows = HorizonShadows::new(order, settings.azimuths);
    let frames = settings.heights.chunks_exact(width * height);
    let first = frames.clone().next().unwrap_or_default();
    let mut field = HeightField::new(width, height, cell_m, first)?;
    let error = error(&field, &shadows, order);
    let (mut pictures, mut seconds) = (Vec::new(), 0.0);
    for frame in frames {
        field.set_heights(frame)?;
        let start = std::time::Instant::now();
        let visibility = visibility(&field, &shadows, order.coefficients());
        seconds += start.elapsed().as_secs_f64();
        let look = (exposure, settings.tone);
        pictures.push(picture((&field, &visibility), &gloss, turn, look));
    }
    let visibility_s = seconds / pictures.len() as f64;
    Ok(HeightPictures { pictures, exposure, error, visibility_s })
}

fn check(settings: &Heights<'_>) -> Result<(), StillError> {
    let setting = |what, found: String, range| Err(StillError::Setting { what, found, range });
    let [width, height] = settings.size;
    let side = 1..=MOST_SIDE;
    if !(side.contains(&width) && side.contains(&height)) {
        return setting("the field", format!("{width} × {height}"), "1 to 4096 samples a side");
    }
    let samples = width * height;
    let frames = settings.heights.len() / samples;
    if !settings.heights.len().is_multiple_of(samples)
        || !(1..=MOST_HEIGHT_FRAMES).contains(&frames)
    {
        let found = format!("{} heights for {width} × {height}", settings.heights.len());
        return setting("the field", found, "1 to 1000 whole frames");
    }
    if !(4..=MOST_AZIMUTHS).contains(&settings.azimuths) {
        return setting("azimuths", settings.azimuths.to_string(), "4 to 256");
    }
    if !(1..=MOST_LOBES).contains(&settings.lobes) {
        return setting("lobes", settings.lobes.to_string(), "1 to 8");
    }
    let stops = settings.exposure_stops;
    if stops.is_nan() || stops.abs() > 30.0 {
        return setting("the exposure", stops.to_string(), "-30 to 30 stops");
    }
    Ok(())
}

/// `[row][column][coefficient]`.
fn visibility(field: &HeightField, shadows: &HorizonShadows, count: usize) -> Vec<f32> {
    let [width, height] = field.size();
    let mut out = vec![0.0; count * width * height];
    out.par_chunks_mut(count * width).enumerate().for_each(|(row, out)| {
        shadows.visibility_row(field, row, out);
    });
    out
}

/// The rotation that takes a normal to +Z and +X in its plane to +X.
fn along_rows(normal: Vec3) -> Quat {
    let along = (Vec3::X - normal * normal.x).normalize_or(normal.any_orthonormal_vector());
    to_tangent_frame(normal, along)
}

/// A frame from above, its last row at the top.
fn picture(
    (field, visibility): (&HeightField, &[f32]),
    gloss: &Gloss,
    turn: fn(Vec3) -> Quat,
    (exposure, tone): (f32, Tone),
) -> Picture {
    let [width, height] = field.size();
    let count = visibility.len() / (width * height);
    let mut picture = Picture::new(width, height, [0.0; 3]);
    let rows =
        picture.pixels_mut().par_chunks_mut(width).rev().zip(visibility.par_chunks(count * width));
    rows.enumerate().for_each(|(row, (pixels, visibility))| {
        let to_local: Vec<Quat> =
            (0..width).map(|column| turn(field.normal(column, row))).collect();
        let positions = vec![Vec3::ZERO; width];
        let (positions, to_local) = (&positions[..], &to_local[..]);
        let (is_local, eye) = (false, Vec3::Z);
        let lit = gloss.shade(GlossPoints { visibility, is_local, positions, to_local, eye });
        for (pixel, lit) in pixels.iter_mut().zip(lit) {
            *pixel = lit.map(|value| tone.apply(exposure * value));
        }
    });
    picture
}

/// Mean and largest distance from traced horizons.
fn error(field: &HeightField, shadows: &HorizonShadows, order: Order) -> [f32; 2] {
    let traced = HorizonShadows::new(order, MOST_AZIMUTHS);
    let [width, height] = field.size();
    let places = PLACES.min(width * height);
    let open = (4.0 * std::f32::consts::PI).sqrt();
    let one = |k: usize| -> f32 {
        let at = k * (width * height) / places + (k * 7919) % (width * height / places).max(1);
        let (column, row) = (at % width, at / width % height);
        let (mut quick, mut slow) = ([0.0; MAX_COEFFICIENTS], [0.0; MAX_COEFFICIENTS]);
        shadows.visibility(field, column, row, &mut quick);
        traced.visibility_traced(field, column, row, 0.5, &mut slow);
        quick.iter().zip(&slow).map(|(a, b)| (a - b).powi(2)).sum::<f32>().sqrt() / open
    };
    let all: Vec<f32> = (0..places).into_par_iter().map(one).collect();
    [all.iter().sum::<f32>() / places as f32, all.iter().copied().fold(0.0, f32::max)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shade::Brdf;

    /// Level ground is evenly lit by what an open surface reflects; before a wall, under a light from
    /// beyond it, the ground is darker than far from it; a moving field has a picture for each frame.
    #[test]
    fn walls_cast_shadows() {
        let order = Order::new(4).expect("order");
        let light = ShLight::cone(order, [1.0, 0.7, 0.0], 0.5, [2.0; 3]).expect("light");
        let (size, count) = ([24, 10], 240);
        let level = vec![1.0; count];
        let wall: Vec<f32> = (0..count).map(|i| if i % 24 >= 18 { 6.0 } else { 1.0 }).collect();
        let both = [level, wall].concat();
        let settings = Heights {
            size,
            cell_m: 1.0,
            heights: &both,
            order,
            azimuths: 32,
            light: &light,
            finish: Brdf::Lambert { albedo: [1.0; 3] }.into(),
            terms: 4,
            lobes: 3,
            tone: Tone::Linear,
            exposure_stops: -1.0,
        };
        let made = heights(&settings).expect("shaded");
        assert_eq!(made.pictures.len(), 2);
        let pixel = |frame: usize, column: usize| made.pictures[frame].pixels()[5 * 24 + column][1];
        let even = pixel(0, 3);
        assert!(even > 0.1 && (0..24).all(|c| (pixel(0, c) - even).abs() < 1e-4), "{even}");
        assert!(pixel(1, 15) < 0.7 * even && pixel(1, 15) < 0.8 * pixel(1, 1), "{}", pixel(1, 15));
        assert!(made.error[0] <= made.error[1] && made.error[1] < 1e-5, "{:?}", made.error);
        let refused = |settings: Heights<'_>, word: &str| {
            let told = heights(&settings).expect_err(word).to_string();
            assert!(told.contains(word), "{told}");
        };
        refused(Heights { size: [0, 10], ..settings.clone() }, "1 to 4096");
        refused(Heights { size: [7, 10], ..settings.clone() }, "whole frames");
        refused(Heights { azimuths: 3, ..settings.clone() }, "4 to 256");
        refused(Heights { cell_m: f32::NAN, ..settings.clone() }, "NaN m apart");
        let ggx = |alpha| Brdf::Ggx { normal_reflectance: [0.9; 3], alpha };
        let shaded = |finish: Finish| {
            let made = heights(&Heights { finish, ..settings.clone() }).expect("shaded");
            made.pictures[1].pixels().to_vec()
        };
        let (along, across) = (shaded(ggx([0.2, 0.7]).into()), shaded(ggx([0.7, 0.2]).into()));
        assert_ne!(along, across, "a grain has no direction");
        // An operator that was made before shades as the reflectance does.
        let made = Finish::from(ggx([0.4; 2])).operator("gold.binary", order, 4).expect("made");
        let read = Finish::from_bytes(&made.to_bytes().expect("bytes")).expect("read");
        assert_eq!(shaded(read), shaded(ggx([0.4; 2]).into()));
        refused(Heights { terms: 17, ..settings.clone() }, "1 to 16 terms");
        refused(Heights { exposure_stops: f32::NAN, ..settings.clone() }, "exposure");
        let hole = vec![f32::NAN; count];
        refused(Heights { heights: &hole, ..settings.clone() }, "not finite");
    }
}
