//! A posed mesh that can be looked at, and what its surface shows.

use glam::{Mat3, Quat, Vec3};
use rayon::prelude::*;

use super::Camera;
use crate::num::directions::{Density, Directions};
use crate::num::random::hash;
use crate::rig::to_tangent_frame;
use crate::sh::{MAX_COEFFICIENTS, Order, evaluate, zonal};
use crate::shade::{Reflectance, ShLight};
use crate::trace::{Device, Error, Hit, Rays, Scene, words_of};

/// Sets of directions that neighbouring pixels choose from.
const SETS: usize = 128;

/// The offset of a ray's start in least heights of its triangle.
const OFFSET_IN_HEIGHTS: f32 = 1e-4;

/// The same in spacings of floating-point numbers at the largest coordinate.
const OFFSET_IN_SPACINGS: f32 = 16.0;

/// What shines on the surface.
#[derive(Debug, Clone, PartialEq)]
pub enum Light {
    /// Ambient occlusion: one colour, the share of the cosine-weighted hemisphere that is open.
    Ambient,
    /// An environment; what a white Lambertian surface reflects of it.
    Environment(ShLight),
}

/// Values over a picture: sums over the samples of each pixel that meet the surface.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Mean of the values that a pixel sees; 0 where it sees none.
    pub values: Vec<[f32; 3]>,
    /// The share of a pixel that the surface covers.
    pub coverage: Vec<f32>,
}

/// A mesh in one pose, ready to be traced.
#[derive(Debug)]
pub struct Stage<'a> {
    scene: Scene,
    positions: &'a [Vec3],
    normals: &'a [Vec3],
    tangents: Option<&'a [Vec3]>,
    triangles: &'a [[u32; 3]],
    /// Metres beyond which nothing blocks.
    far: f32,
}

/// A place on the surface.
struct Site {
    corners: [usize; 3],
    weights: [f32; 3],
}

impl Site {
    fn new(triangles: &[[u32; 3]], hit: &Hit) -> Self {
        let corners = triangles[hit.triangle as usize].map(|corner| corner as usize);
        Self { corners, weights: [1.0 - hit.u - hit.v, hit.u, hit.v] }
    }

    fn mix(&self, values: [Vec3; 3]) -> Vec3 {
        let [a, b, c] = self.weights;
        values[0] * a + values[1] * b + values[2] * c
    }
}

impl<'a> Stage<'a> {
    /// Builds the tracer's structure. Positions in metres, normals unit, one per vertex;
    /// `max_distance_m` beyond which nothing blocks.
    ///
    /// # Errors
    /// What the tracer objects to, such as positions that are not finite.
    ///
    /// # Panics
    /// If there are not as many normals as positions.
    pub fn new(
        device: &Device,
        positions: &'a [Vec3],
        normals: &'a [Vec3],
        triangles: &'a [[u32; 3]],
        max_distance_m: Option<f32>,
    ) -> Result<Self, Error> {
        assert_eq!(positions.len(), normals.len(), "positions and normals");
        let scene = Scene::build(device, positions, triangles)?;
        let far = max_distance_m.unwrap_or(f32::INFINITY);
        Ok(Self { scene, positions, normals, tangents: None, triangles, far })
    }

    /// With unit tangents at the vertices, for reflectances that have a grain; any will do without.
    ///
    /// # Panics
    /// If there are not as many as positions.
    #[must_use]
    pub fn with_tangents(mut self, tangents: &'a [Vec3]) -> Self {
        assert_eq!(tangents.len(), self.positions.len(), "positions and tangents");
        self.tangents = Some(tangents);
        self
    }

    /// The rotation into the tangent frame of a place.
    fn frame(&self, site: &Site, normal: Vec3) -> Mat3 {
        let along = self.tangents.and_then(|tangents| {
            let mixed = site.mix(site.corners.map(|corner| tangents[corner]));
            (mixed - normal * mixed.dot(normal)).try_normalize()
        });
        let turn = match along {
            Some(tangent) => to_tangent_frame(normal, tangent),
            None => Quat::from_rotation_arc(normal, Vec3::Z),
        };
        Mat3::from_quat(turn)
    }

    /// Values at the vertices as the camera sees them, blended over each triangle: `values` holds
    /// one or three colours for each vertex. A pixel takes `samples` · `samples` looks.
    ///
    /// # Panics
    /// If `values` is not that long, or `samples` is 0.
    #[must_use]
    pub fn show(&self, camera: &Camera, samples: u32, values: &[f32]) -> Image {
        let colours = values.len() / self.positions.len().max(1);
        assert!(
            matches!(colours, 1 | 3) && values.len() == colours * self.positions.len(),
            "{} values for {} vertices",
            values.len(),
            self.positions.len()
        );
        let vertex = |v: usize, c: usize| values[v * colours + c.min(colours - 1)];
        self.image(camera, samples, |site, _| {
            std::array::from_fn(|c| {
                (0..3).map(|i| site.weights[i] * vertex(site.corners[i], c)).sum()
            })
        })
    }

    /// The shading itself, by `rays` rays (rounded up to an even number) from every sample of
    /// every pixel, with the blended normal: (1/π) ∫ V L (n·ω)₊ dω for a light L, as its bands tell
    /// it. What nothing blocks is known; the rays tell what is taken away.
    ///
    /// # Panics
    /// If `samples` is 0.
    #[must_use]
    pub fn truth(&self, camera: &Camera, samples: u32, rays: u32, light: &Light) -> Image {
        let half = rays.max(2).div_ceil(2) as usize;
        let directions = Directions::new(Density::Cosine, SETS, half, 1);
        let shader = Shader::new(light);
        self.image(camera, samples, |site, key| {
            let (origin, normal) = self.start(site);
            shader.shade(self, &directions, origin, normal, key)
        })
    }

    /// Radiance towards the camera of a surface with an isotropic reflectance, by rays as in
    /// [`Self::truth`], with nothing known beforehand: ∫ V L f (n·ω)₊ dω.
    ///
    /// # Panics
    /// If `samples` is 0.
    #[must_use]
    pub fn reflected(
        &self,
        camera: &Camera,
        (samples, rays): (u32, u32),
        light: &ShLight,
        brdf: &impl Reflectance,
    ) -> Image {
        let half = rays.max(2).div_ceil(2) as usize;
        let directions = Directions::new(Density::Cosine, SETS, half, 1);
        let order = light.order();
        let radiance: Vec<[f32; 3]> = (0..order.coefficients())
            .map(|i| light.coefficient(i).map(|value| value as f32))
            .collect();
        self.image(camera, samples, |site, key| {
            let (origin, normal) = self.start(site);
            let frame = self.frame(site, normal);
            let local = |d: Vec3| (frame * d).as_dvec3().normalize_or_zero().to_array();
            let outgoing = local((camera.eye() - origin).normalize_or_zero());
            let (world, blocked) = self.cast(&directions, origin, normal, key);
            let mut sum = [0.0; 3];
            let open = (0..world.len()).filter(|&i| !is_set(&blocked, i));
            for direction in open.map(|i| world[i]) {
                let incoming = at(order, &radiance, direction);
                let f = brdf.reflect(local(direction), outgoing);
                let share = std::f32::consts::PI / world.len() as f32;
                for (sum, (l, f)) in sum.iter_mut().zip(incoming.iter().zip(f)) {
                    *sum += share * l * f as f32;
                }
            }
            sum
        })
    }

    /// Rays over the hemisphere of a place, by cosine: where they go and which of them are blocked.
    fn cast(
        &self,
        directions: &Directions,
        origin: Vec3,
        normal: Vec3,
        key: u64,
    ) -> (Vec<Vec3>, Vec<u64>) {
        let set = directions.set((key % SETS as u64) as usize);
        let turn = (key >> 32) as f32 / 4_294_967_296.0 * std::f32::consts::TAU;
        let (a, b) = normal.any_orthonormal_pair();
        let (sin, cos) = turn.sin_cos();
        let (tangent, bitangent) = (a * cos + b * sin, b * cos - a * sin);
        let world: Vec<Vec3> = (0..set.x.len())
            .map(|i| tangent * set.x[i] + bitangent * set.y[i] + normal * set.z[i])
            .collect();
        let [x, y, z] = by_axis(&world);
        let rays = Rays { origin, x: &x, y: &y, z: &z, near: 0.0, far: self.far };
        let mut blocked = vec![0_u64; words_of(world.len())];
        self.scene.occluded(&rays, &mut blocked);
        (world, blocked)
    }

    /// Averages what `value` says over a grid of samples in each pixel; it is also given a number
    /// that tells samples apart.
    fn image(
        &self,
        camera: &Camera,
        samples: u32,
        value: impl Fn(&Site, u64) -> [f32; 3] + Sync,
    ) -> Image {
        let [width, height] = camera.size();
        let rows: Vec<Vec<([f32; 3], f32)>> = (0..height)
            .into_par_iter()
            .map(|row| {
                let hits = self.look(camera, samples, row);
                let pixel = |(column, hits): (usize, &[Option<Hit>])| {
                    self.pixel([column as u64, u64::from(row)], hits, &value)
                };
                hits.chunks_exact((samples * samples) as usize).enumerate().map(pixel).collect()
            })
            .collect();
        let (values, coverage) = rows.into_iter().flatten().unzip();
        Image { size: [width, height], values, coverage }
    }

    /// What the samples of a row of pixels see, pixel by pixel.
    fn look(&self, camera: &Camera, samples: u32, row: u32) -> Vec<Option<Hit>> {
        let [width, _] = camera.size();
        let part = |sample: u32| (sample as f32 + 0.5) / samples as f32;
        let directions: Vec<Vec3> = (0..width)
            .flat_map(|column| (0..samples * samples).map(move |sample| (column, sample)))
            .map(|(column, sample)| {
                let (x, y) = (part(sample % samples), part(sample / samples));
                camera.direction(column as f32 + x, row as f32 + y)
            })
            .collect();
        let [x, y, z] = by_axis(&directions);
        let (near, far) = (0.0, f32::INFINITY);
        let rays = Rays { origin: camera.eye(), x: &x, y: &y, z: &z, near, far };
        let mut hits = vec![None; directions.len()];
        self.scene.nearest(&rays, &mut hits);
        hits
    }

    /// The mean of what the samples of a pixel see, and how many of them see anything.
    fn pixel(
        &self,
        [column, row]: [u64; 2],
        hits: &[Option<Hit>],
        value: &impl Fn(&Site, u64) -> [f32; 3],
    ) -> ([f32; 3], f32) {
        let (mut sum, mut covered) = ([0.0; 3], 0.0);
        for (sample, hit) in hits.iter().enumerate() {
            let Some(hit) = hit else { continue };
            let seen = value(&Site::new(self.triangles, hit), hash(&[column, row, sample as u64]));
            sum.iter_mut().zip(seen).for_each(|(sum, seen)| *sum += seen);
            covered += 1.0;
        }
        if covered == 0.0 {
            return ([0.0; 3], 0.0);
        }
        (sum.map(|s| s / covered), covered / hits.len() as f32)
    }

    /// Where the rays of a place start, and its shading normal.
    ///
    /// Between vertices with smooth normals the facet lies below the surface that the normals mean,
    /// and its neighbours would shadow it: each corner's tangent plane lifts the start (Hanika 2021,
    /// "Hacking the shadow terminator").
    fn start(&self, site: &Site) -> (Vec3, Vec3) {
        let at = site.corners.map(|corner| self.positions[corner]);
        let normals = site.corners.map(|corner| self.normals[corner]);
        let across = (at[1] - at[0]).cross(at[2] - at[0]);
        let geometric = across.normalize_or_zero();
        let normal = site.mix(normals).try_normalize().unwrap_or(normals[0]);
        let side = if geometric.dot(normal) < 0.0 { -geometric } else { geometric };
        let flat = site.mix(at);
        let lift: [Vec3; 3] = std::array::from_fn(|i| {
            let below = (flat - at[i]).dot(normals[i]).min(0.0);
            -below * normals[i]
        });
        let edges = [at[1] - at[0], at[2] - at[1], at[0] - at[2]].map(Vec3::length);
        let longest = edges[0].max(edges[1]).max(edges[2]).max(f32::MIN_POSITIVE);
        let height = across.length() / longest;
        let spacing = flat.abs().max_element() * f32::EPSILON;
        let offset = (OFFSET_IN_HEIGHTS * height).max(OFFSET_IN_SPACINGS * spacing);
        (flat + site.mix(lift) + side * offset, normal)
    }
}

/// A light made ready for many points.
enum Shader {
    Ambient,
    Environment {
        order: Order,
        /// Radiance, `[coefficient][colour]`.
        radiance: Vec<[f32; 3]>,
        /// What an open surface reflects, by its normal.
        reflected: Vec<[f32; 3]>,
    },
}

impl Shader {
    fn new(light: &Light) -> Self {
        let Light::Environment(light) = light else { return Self::Ambient };
        let order = light.order();
        let unshadowed = zonal::unshadowed(order);
        let of = |i: usize| light.coefficient(i).map(|value| value as f32);
        let convolve = |i: usize| {
            let l = i.isqrt();
            let factor = (4.0 * std::f32::consts::PI / (2 * l + 1) as f32).sqrt() * unshadowed[l];
            of(i).map(|value| factor * value)
        };
        let count = order.coefficients();
        Self::Environment {
            order,
            radiance: (0..count).map(of).collect(),
            reflected: (0..count).map(convolve).collect(),
        }
    }

    fn shade(
        &self,
        stage: &Stage<'_>,
        directions: &Directions,
        origin: Vec3,
        normal: Vec3,
        key: u64,
    ) -> [f32; 3] {
        let (world, blocked) = stage.cast(directions, origin, normal, key);
        let share = 1.0 / world.len() as f32;
        match self {
            Self::Ambient => {
                let count: u32 = blocked.iter().map(|word| word.count_ones()).sum();
                [1.0 - count as f32 * share; 3]
            }
            Self::Environment { order, radiance, reflected } => {
                let mut seen = at(*order, reflected, normal);
                for (i, &direction) in world.iter().enumerate() {
                    if is_set(&blocked, i) {
                        let lost = at(*order, radiance, direction);
                        seen.iter_mut().zip(lost).for_each(|(seen, lost)| *seen -= share * lost);
                    }
                }
                seen
            }
        }
    }
}

fn is_set(bits: &[u64], i: usize) -> bool {
    bits[i / 64] >> (i % 64) & 1 == 1
}

fn by_axis(directions: &[Vec3]) -> [Vec<f32>; 3] {
    [0, 1, 2].map(|axis| directions.iter().map(|direction| direction[axis]).collect())
}

/// A function of three colours in a unit direction.
fn at(order: Order, coefficients: &[[f32; 3]], direction: Vec3) -> [f32; 3] {
    let mut y = [0.0; MAX_COEFFICIENTS];
    evaluate(order, direction, &mut y);
    let mut out = [0.0; 3];
    for (y, coefficient) in y.iter().zip(coefficients) {
        out.iter_mut().zip(coefficient).for_each(|(out, c)| *out += y * c);
    }
    out
}

#[cfg(test)]
mod tests;
