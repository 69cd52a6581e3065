//! What the triangles of a scene reflect: material, texture and vertex colour.

use std::sync::Arc;

/// Reflectances above this are lowered to it, so that light between surfaces dies away.
pub const MOST_ALBEDO: f32 = 0.98;

/// How much of the light that meets it each triangle reflects diffusely, by colour (linear red,
/// green, blue).
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Surface {
    /// All materials.
    pub materials: Vec<Material>,
    /// Triangle → material.
    pub material: Vec<u32>,
    /// Texture coordinates of each triangle's corners; empty where no material has a texture.
    pub uv: Vec<[[f32; 2]; 3]>,
    /// Linear colours of each triangle's corners, which multiply the material's; empty where there
    /// are none.
    pub colour: Vec<[[f32; 3]; 3]>,
    /// What vertex colours say of alpha at each triangle's corners; empty where they say nothing.
    pub alpha: Vec<[f32; 3]>,
}

/// What alpha does to rays.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Alpha {
    /// Nothing: the material blocks.
    #[default]
    Opaque,
    /// It blocks where alpha is at least this.
    Mask(f32),
    /// It blocks the share alpha of all rays.
    Blend,
}

/// What a material reflects.
#[derive(Debug, Clone, PartialEq)]
pub struct Material {
    /// Linear red, green, blue; from 0 to 1.
    pub factor: [f32; 3],
    /// Multiplies the factor.
    pub texture: Option<Arc<Texture>>,
    /// What alpha does.
    pub alpha: Alpha,
    /// Multiplies the texture's alpha; 0 to 1.
    pub opacity: f32,
    /// Whether it is seen from behind too.
    pub double_sided: bool,
}

impl Default for Material {
    fn default() -> Self {
        let (alpha, opacity, double_sided) = (Alpha::Opaque, 1.0, false);
        Self { factor: [1.0; 3], texture: None, alpha, opacity, double_sided }
    }
}

/// How a texture goes on beyond 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Wrap {
    /// Its edge.
    Clamp,
    /// Itself, turned around each time.
    Mirror,
    /// Itself.
    #[default]
    Repeat,
}

/// A picture with how it goes on beyond its edges.
#[derive(Debug, Clone, PartialEq)]
pub struct Texture {
    /// Textures of many materials may share one.
    pub picture: Arc<Picture>,
    /// Along u and v.
    pub wrap: [Wrap; 2],
}

/// A decoded picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Texels.
    pub width: u32,
    /// Texels.
    pub height: u32,
    /// Row by row from the top, sRGB.
    pub texels: Vec<[u8; 3]>,
    /// Alpha of each texel; empty where all are opaque.
    pub alpha: Vec<u8>,
}

impl Picture {
    /// What it takes of memory.
    pub(super) fn bytes(&self) -> u64 {
        3 * self.texels.len() as u64 + self.alpha.len() as u64
    }
}

impl Surface {
    /// A surface of one colour for so many triangles.
    #[must_use]
    pub fn plain(albedo: [f32; 3], triangles: usize) -> Self {
        let materials = vec![Material { factor: albedo, ..Material::default() }];
        Self { materials, material: vec![0; triangles], ..Self::default() }
    }

    /// Whether red, green and blue are the same everywhere.
    #[must_use]
    pub fn is_grey(&self) -> bool {
        let grey = |[r, g, b]: [f32; 3]| r == g && g == b;
        let used = |index: usize| self.material.contains(&(index as u32));
        let plain = |material: &Material| {
            let texels = material.texture.iter().flat_map(|texture| &texture.picture.texels);
            grey(material.factor) && texels.into_iter().all(|[r, g, b]| r == g && g == b)
        };
        let mut materials = self.materials.iter().enumerate();
        materials.all(|(index, material)| plain(material) || !used(index))
            && self.colour.iter().flatten().all(|&colour| grey(colour))
    }

    /// The reflectance at a place of a triangle, `u` and `v` the weights of its second and third
    /// corner; from 0 to [`MOST_ALBEDO`], 0 for triangles that the surface does not have.
    #[must_use]
    pub fn albedo(&self, triangle: usize, u: f32, v: f32) -> [f32; 3] {
        let Some(&material) = self.material.get(triangle) else { return [0.0; 3] };
        let material = &self.materials[material as usize];
        let mix = |a: f32, b: f32, c: f32| a + u * (b - a) + v * (c - a);
        let mut albedo = material.factor;
        if let (Some(texture), Some([a, b, c])) = (&material.texture, self.uv.get(triangle)) {
            let texel = texture.at([0, 1].map(|i| mix(a[i], b[i], c[i])));
            albedo = [0, 1, 2].map(|i| albedo[i] * texel[i]);
        }
        if let Some([a, b, c]) = self.colour.get(triangle) {
            albedo = [0, 1, 2].map(|i| albedo[i] * mix(a[i], b[i], c[i]));
        }
        albedo.map(|value| value.clamp(0.0, MOST_ALBEDO))
    }

    /// Which share of the rays that meet a place of a triangle it blocks, from 0 to 1; all of them
    /// for triangles that the surface does not have.
    #[must_use]
    pub fn coverage(&self, triangle: usize, u: f32, v: f32) -> f32 {
        let Some(&material) = self.material.get(triangle) else { return 1.0 };
        let material = &self.materials[material as usize];
        let mix = |a: f32, b: f32, c: f32| a + u * (b - a) + v * (c - a);
        let mut alpha = material.opacity;
        if let (Some(texture), Some([a, b, c])) = (&material.texture, self.uv.get(triangle)) {
            alpha *= texture.alpha_at([0, 1].map(|i| mix(a[i], b[i], c[i])));
        }
        if let Some(&[a, b, c]) = self.alpha.get(triangle) {
            alpha *= mix(a, b, c);
        }
        match material.alpha {
            Alpha::Opaque => 1.0,
            Alpha::Mask(cutoff) => f32::from(u8::from(alpha >= cutoff)),
            Alpha::Blend => alpha.clamp(0.0, 1.0),
        }
    }

    /// The material of a triangle, if it has one.
    #[must_use]
    pub fn of(&self, triangle: usize) -> Option<&Material> {
        self.material.get(triangle).map(|&material| &self.materials[material as usize])
    }

    /// One surface after another, each with how many triangles it is of; those that are not known are solid
    /// from both sides.
    #[must_use]
    pub fn join(parts: &[(Option<&Self>, usize)]) -> Self {
        let solid = Material { double_sided: true, ..Material::default() };
        let mut joined = Self { materials: vec![solid], ..Self::default() };
        let held = |list: fn(&Self) -> bool| parts.iter().any(|(part, _)| part.is_some_and(list));
        let uv = held(|part| !part.uv.is_empty());
        let colour = held(|part| !part.colour.is_empty());
        let alpha = held(|part| !part.alpha.is_empty());
        for &(part, triangles) in parts {
            let first = joined.materials.len() as u32;
            let all = joined.material.len() + triangles;
            if let Some(part) = part {
                joined.materials.extend(part.materials.iter().cloned());
                joined.material.extend(part.material.iter().map(|&material| first + material));
                joined.uv.extend(&part.uv);
                joined.colour.extend(&part.colour);
                joined.alpha.extend(&part.alpha);
            }
            joined.material.resize(all, 0);
            joined.uv.resize(if uv { all } else { 0 }, [[0.0; 2]; 3]);
            joined.colour.resize(if colour { all } else { 0 }, [[1.0; 3]; 3]);
            joined.alpha.resize(if alpha { all } else { 0 }, [1.0; 3]);
        }
        joined
    }

    /// The surface of these triangles alone.
    #[must_use]
    pub fn select(&self, triangles: impl Iterator<Item = usize> + Clone) -> Self {
        Self {
            materials: self.materials.clone(),
            material: triangles.clone().map(|i| self.material[i]).collect(),
            uv: triangles.clone().filter_map(|i| self.uv.get(i)).copied().collect(),
            colour: triangles.clone().filter_map(|i| self.colour.get(i)).copied().collect(),
            alpha: triangles.filter_map(|i| self.alpha.get(i)).copied().collect(),
        }
    }
}

impl Texture {
    /// The linear colour at texture coordinates, interpolated between the four nearest texels.
    #[must_use]
    pub fn at(&self, uv: [f32; 2]) -> [f32; 3] {
        let texels = &self.picture.texels;
        if texels.is_empty() {
            return [1.0; 3];
        }
        self.mix(uv, |texel| texels[texel].map(linear)).unwrap_or([1.0; 3])
    }

    /// Alpha at texture coordinates, likewise.
    #[must_use]
    pub fn alpha_at(&self, uv: [f32; 2]) -> f32 {
        let alpha = &self.picture.alpha;
        if alpha.is_empty() {
            return 1.0;
        }
        let mixed = self.mix(uv, |texel| [f32::from(alpha[texel]) / 255.0]);
        mixed.map_or(1.0, |[alpha]| alpha)
    }

    /// Between the four nearest texels; `None` where the coordinates are not finite.
    fn mix<const N: usize>(
        &self,
        uv: [f32; 2],
        value: impl Fn(usize) -> [f32; N],
    ) -> Option<[f32; N]> {
        if !(uv[0].is_finite() && uv[1].is_finite()) {
            return None;
        }
        let Picture { width, height, .. } = *self.picture;
        let [(x0, x1, tx), (y0, y1, ty)] =
            [(uv[0], width, self.wrap[0]), (uv[1], height, self.wrap[1])]
                .map(|(at, count, wrap)| neighbours(at, count, wrap));
        let texel = |x: u32, y: u32| value((y as usize) * width as usize + x as usize);
        let (a, b, c, d) = (texel(x0, y0), texel(x1, y0), texel(x0, y1), texel(x1, y1));
        Some(std::array::from_fn(|i| {
            let (top, bottom) = (a[i] + tx * (b[i] - a[i]), c[i] + tx * (d[i] - c[i]));
            top + ty * (bottom - top)
        }))
    }
}

/// The two texels about a coordinate, and how far it is towards the second.
fn neighbours(at: f32, count: u32, wrap: Wrap) -> (u32, u32, f32) {
    let position = f64::from(at) * f64::from(count) - 0.5;
    let first = position.floor();
    let fraction = (position - first) as f32;
    // Saturating: far beyond any texture the fraction is 0 as well.
    let first = first as i64;
    let fold = |index: i64| {
        let n = i64::from(count);
        let folded = match wrap {
            Wrap::Clamp => index.clamp(0, n - 1),
            Wrap::Repeat => index.rem_euclid(n),
            Wrap::Mirror => {
                let place = index.rem_euclid(2 * n);
                if place < n { place } else { 2 * n - 1 - place }
            }
        };
        folded as u32
    };
    (fold(first), fold(first.saturating_add(1)), fraction)
}

/// sRGB to linear (IEC 61966-2-1), from 0 to 1.
fn linear(byte: u8) -> f32 {
    static TABLE: std::sync::OnceLock<[f32; 256]> = std::sync::OnceLock::new();
    TABLE.get_or_init(|| {
        std::array::from_fn(|byte| {
            let s = byte as f64 / 255.0;
            let linear = if s <= 0.04045 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) };
            linear as f32
        })
    })[usize::from(byte)]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checker(wrap: Wrap) -> Texture {
        let texels = vec![[0; 3], [255; 3], [255; 3], [0; 3]];
        let picture = Arc::new(Picture { width: 2, height: 2, texels, alpha: vec![] });
        Texture { picture, wrap: [wrap; 2] }
    }

    /// Texel centres have their own colour, places between them the mean of linear light, and
    /// beyond the edge each way to wrap does what its name says.
    #[test]
    fn textures_interpolate_and_wrap() {
        for wrap in [Wrap::Clamp, Wrap::Mirror, Wrap::Repeat] {
            let texture = checker(wrap);
            assert_eq!(texture.at([0.25, 0.25]), [0.0; 3]);
            assert_eq!(texture.at([0.75, 0.25]), [1.0; 3]);
            assert_eq!(texture.at([0.5, 0.5]), [0.5; 3]);
            assert_eq!(texture.at([f32::NAN, 0.0]), [1.0; 3]);
            assert!(texture.at([1e30, -1e30]).iter().all(|c| (0.0..=1.0).contains(c)));
        }
        let beyond = [-0.25, 0.25];
        assert_eq!(checker(Wrap::Repeat).at(beyond), [1.0; 3]);
        assert_eq!(checker(Wrap::Mirror).at(beyond), [0.0; 3]);
        assert_eq!(checker(Wrap::Clamp).at(beyond), [0.0; 3]);
    }

    /// Factor, texture and vertex colours multiply; what is too bright is lowered; triangles that
    /// the surface does not have are black; one coloured vertex makes a surface coloured.
    #[test]
    fn albedo_is_a_product() {
        let mut surface = Surface::plain([0.5, 0.5, 0.5], 2);
        assert!(surface.is_grey());
        assert_eq!(surface.albedo(1, 0.2, 0.2), [0.5; 3]);
        assert_eq!(surface.albedo(2, 0.2, 0.2), [0.0; 3]);
        surface.materials[0].texture = Some(Arc::new(checker(Wrap::Repeat)));
        surface.uv = vec![[[0.75, 0.25]; 3]; 2];
        assert!(surface.is_grey());
        assert_eq!(surface.albedo(0, 0.2, 0.2), [0.5; 3]);
        surface.colour = vec![[[1.0; 3], [1.0; 3], [0.0, 1.0, 7.0]]; 2];
        assert!(!surface.is_grey());
        let albedo = surface.albedo(0, 0.0, 1.0);
        assert_eq!(albedo, [0.0, 0.5, MOST_ALBEDO]);
        assert_eq!(surface.select([1].into_iter()).material.len(), 1);
    }

    /// Opaque materials cover whatever alpha says; masks cut at their threshold, also between
    /// texels; blends cover the product of factor, texture and vertex colours; a triangle that the
    /// surface does not have is whole.
    #[test]
    fn coverage_follows_the_mode() {
        let mut surface = Surface::plain([0.5; 3], 2);
        let mut texture = checker(Wrap::Repeat);
        Arc::make_mut(&mut texture.picture).alpha = vec![0, 255, 255, 0];
        surface.materials[0].texture = Some(Arc::new(texture));
        surface.uv = vec![[[0.25, 0.25], [0.75, 0.25], [0.25, 0.75]]; 2];
        assert_eq!(surface.coverage(0, 0.0, 0.0), 1.0);
        surface.materials[0].alpha = Alpha::Mask(0.5);
        let at = |surface: &Surface| [0.0, 0.4, 0.6, 1.0].map(|u| surface.coverage(0, u, 0.0));
        assert_eq!(at(&surface), [0.0, 0.0, 1.0, 1.0]);
        surface.materials[0].alpha = Alpha::Blend;
        surface.materials[0].opacity = 0.5;
        let found = at(&surface);
        for (found, expected) in found.into_iter().zip([0.0, 0.2, 0.3, 0.5]) {
            assert!((found - expected).abs() < 1e-6, "{found} {expected}");
        }
        surface.alpha = vec![[1.0, 0.5, 1.0]; 2];
        assert_eq!(surface.coverage(1, 1.0, 0.0), 0.25);
        assert_eq!(surface.coverage(2, 1.0, 0.0), 1.0);
        assert_eq!(surface.select([1].into_iter()).coverage(0, 1.0, 0.0), 0.25);
    }
}
