//! The rest pose seen from the front and from behind, coloured by each vertex's mean error: drawn
//! by a small rasteriser into rows of equal colour, so that a picture is a few thousand strokes.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use glam::{Vec2, Vec3};

use super::input::RestMesh;
use super::svg;
use super::text::{escape, number};
use crate::measure::Surface;
use crate::num::stats;

/// Rows of the larger side of a picture.
const ROWS: f32 = 460.0;
/// Steps of the colour map, and of the shading that lets the shape be seen.
const COLOURS: usize = 40;
const SHADES: usize = 5;
/// Most triangles drawn; a mesh beyond it goes without a picture.
const MOST_TRIANGLES: usize = 4_000_000;

/// Eleven places of matplotlib's viridis (CC0): perceptually uniform, and readable in grey and
/// with any colour vision.
const VIRIDIS: [[f32; 3]; 11] = [
    [68.0, 1.0, 84.0],
    [72.0, 36.0, 117.0],
    [65.0, 68.0, 135.0],
    [53.0, 95.0, 141.0],
    [42.0, 120.0, 142.0],
    [33.0, 145.0, 140.0],
    [34.0, 168.0, 132.0],
    [68.0, 191.0, 112.0],
    [122.0, 209.0, 81.0],
    [189.0, 223.0, 38.0],
    [253.0, 231.0, 37.0],
];

/// The colour at 0..=1, darkened to `shade` of itself, as `rrggbb`.
fn colour(at: f32, shade: f32) -> String {
    let place = at.clamp(0.0, 1.0) * (VIRIDIS.len() - 1) as f32;
    let low = (place as usize).min(VIRIDIS.len() - 2);
    let mix = place - low as f32;
    let mut out = String::from("#");
    for (a, b) in VIRIDIS[low].iter().zip(VIRIDIS[low + 1]) {
        let value = shade * (a + mix * (b - a));
        let _ = write!(out, "{:02x}", value.round() as u8);
    }
    out
}

/// Both views with a legend; `None` where the mesh and the figures do not belong together.
pub(super) fn figure(surface: &Surface, rest: &RestMesh<'_>) -> Option<String> {
    let vertices = rest.positions.len();
    let fits = rest.point_of_vertex.len() == vertices
        && rest.triangles.len() <= MOST_TRIANGLES
        && rest.triangles.iter().flatten().all(|&v| (v as usize) < vertices)
        && rest.point_of_vertex.iter().all(|&p| (p as usize) < surface.ao_mae.len())
        && rest.positions.iter().all(|p| p.is_finite());
    if !fits || vertices == 0 || rest.triangles.is_empty() {
        return None;
    }
    let mut ascending: Vec<f64> = surface.ao_mae.iter().map(|&x| f64::from(x)).collect();
    ascending.sort_by(f64::total_cmp);
    let top = stats::quantile(&ascending, 0.99)?.max(1e-9) as f32;
    let value = |v: u32| surface.ao_mae[rest.point_of_vertex[v as usize] as usize] / top;
    let views = [("front", "Seen from +Z (front)", 1.0), ("back", "Seen from −Z (back)", -1.0)];
    let pictures: String = views
        .into_iter()
        .map(|(id, name, side)| {
            let canvas = Canvas::draw(rest, side, value);
            let description = "The rest pose, coloured by each vertex's mean absolute error.";
            let size = (canvas.width as f64, canvas.height as f64);
            let svg = svg::picture(id, size, (name, description), &canvas.strokes());
            format!("<div class=\"view\">{svg}<p>{name}</p></div>")
        })
        .collect();
    let caption = format!(
        "Mean absolute error of ambient occlusion at every vertex over the {} poses, on the rest \
         pose. The scale ends at the 99th percentile of vertices; shapes are lightly shaded.",
        surface.split.name()
    );
    Some(format!(
        "<figure class=\"body\"><div class=\"views\">{pictures}</div>{}<figcaption>{}</figcaption></figure>",
        legend(f64::from(top)),
        escape(&caption)
    ))
}

/// The colour map from 0 to `top`.
fn legend(top: f64) -> String {
    let mut body = String::new();
    for i in 0..COLOURS {
        let at = (i as f32 + 0.5) / COLOURS as f32;
        let _ = write!(
            body,
            r#"<rect x="{:.1}" y="0" width="6.2" height="12" fill="{}"/>"#,
            20.0 + 6.0 * i as f64,
            colour(at, 1.0),
        );
    }
    for (part, anchor) in [(0.0, "middle"), (0.5, "middle"), (1.0, "middle")] {
        let label = number(top * part, 2);
        let label = if part == 1.0 { format!("≥ {label}") } else { label };
        let _ = write!(
            body,
            r#"<text class="tick" x="{:.1}" y="28" text-anchor="{anchor}">{label}</text>"#,
            20.0 + 240.0 * part,
        );
    }
    let description = format!("From dark violet for 0 to yellow for {}", number(top, 2));
    let svg = svg::picture("scale", (280.0, 32.0), ("Colour scale", &description), &body);
    format!("<div class=\"scale\">{svg}</div>")
}

/// A picture of small integers: colour and shade per cell, 0 for nothing.
#[derive(Debug)]
struct Canvas {
    width: usize,
    height: usize,
    depth: Vec<f32>,
    cells: Vec<u16>,
}

impl Canvas {
    /// Orthographic, from +Z for side 1 and from −Z for side −1, +Y up.
    fn draw(rest: &RestMesh<'_>, side: f32, value: impl Fn(u32) -> f32) -> Self {
        let turned = |p: Vec3| Vec3::new(side * p.x, -p.y, side * p.z);
        let posed: Vec<Vec3> = rest.positions.iter().map(|&p| turned(p)).collect();
        let used = || rest.triangles.iter().flatten().map(|&v| posed[v as usize]);
        let low = used().reduce(Vec3::min).unwrap_or(Vec3::ZERO);
        let high = used().reduce(Vec3::max).unwrap_or(Vec3::ONE);
        let extent = (high - low).truncate();
        let scale = (ROWS - 4.0) / extent.max_element().max(1e-20);
        let side_cells = |x: f32| ((x * scale).ceil() as usize + 4).min(ROWS as usize + 4);
        let (width, height) = (side_cells(extent.x), side_cells(extent.y));
        let cells = width * height;
        let mut canvas =
            Self { width, height, depth: vec![f32::NEG_INFINITY; cells], cells: vec![0; cells] };
        for &triangle in rest.triangles {
            let corners = triangle.map(|v| {
                let p = posed[v as usize];
                let at = (p - low).truncate() * scale + Vec2::splat(2.0);
                (at.extend(p.z * scale), value(v))
            });
            canvas.triangle(corners);
        }
        canvas
    }

    fn triangle(&mut self, corners: [(Vec3, f32); 3]) {
        let [a, b, c] = corners.map(|c| c.0);
        let doubled = (b - a).truncate().perp_dot((c - a).truncate());
        // Seen edge-on, or so small that no cell's centre can lie in it.
        if doubled.abs() < 1e-9 {
            return;
        }
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let cell = |x: f32, most: usize| (x.floor().max(0.0) as usize).min(most);
        for y in cell(low.y, self.height - 1)..=cell(high.y, self.height - 1) {
            for x in cell(low.x, self.width - 1)..=cell(high.x, self.width - 1) {
                let p = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                let weight =
                    |u: Vec3, v: Vec3| (u.truncate() - p).perp_dot(v.truncate() - p) / doubled;
                let w = [weight(b, c), weight(c, a), weight(a, b)];
                if w.iter().any(|&w| w < -1e-4) {
                    continue;
                }
                let blend = |f: [f32; 3]| w[0] * f[0] + w[1] * f[1] + w[2] * f[2];
                let z = blend([a.z, b.z, c.z]);
                let at = y * self.width + x;
                if z > self.depth[at] {
                    self.depth[at] = z;
                    self.cells[at] = code(blend(corners.map(|c| c.1)), facing(a, b, c, doubled));
                }
            }
        }
    }

    /// Rows of equal cells as strokes, one path per colour.
    fn strokes(&self) -> String {
        let mut paths: BTreeMap<u16, String> = BTreeMap::new();
        for (y, row) in self.cells.chunks_exact(self.width).enumerate() {
            let mut x = 0;
            for run in row.chunk_by(|a, b| a == b) {
                if run[0] > 0 {
                    let path = paths.entry(run[0]).or_default();
                    let _ = write!(path, "M{x} {y}h{}", run.len());
                }
                x += run.len();
            }
        }
        let mut out = String::from("<g transform=\"translate(0 .5)\" class=\"cells\">");
        for (code, path) in paths {
            let (level, shade) = ((code - 1) as usize / SHADES, (code - 1) as usize % SHADES);
            let at = (level as f32 + 0.5) / COLOURS as f32;
            let shade = 0.72 + 0.28 * shade as f32 / (SHADES - 1) as f32;
            let _ = write!(out, r#"<path stroke="{}" d="{path}"/>"#, colour(at, shade));
        }
        out.push_str("</g>");
        out
    }
}

/// |n_z| of a triangle.
fn facing(a: Vec3, b: Vec3, c: Vec3, doubled: f32) -> f32 {
    let normal = (b - a).cross(c - a);
    (doubled / normal.length().max(1e-20)).abs()
}

/// Colour level and shade in one number above 0.
fn code(value: f32, facing: f32) -> u16 {
    let step = |x: f32, steps: usize| ((x.clamp(0.0, 1.0) * steps as f32) as usize).min(steps - 1);
    (1 + step(value, COLOURS) * SHADES + step(facing, SHADES)) as u16
}
