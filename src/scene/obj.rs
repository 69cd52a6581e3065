//! Wavefront OBJ for static meshes: `v`, `vn` and `f`; one part under one node.

use glam::Vec3;

use super::budget::{Budget, Notices, Quantity};
use super::{Error, Source, normals};
use crate::rig::{Deformer, Influence, Mesh, Node, Part, Skeleton, Transform};

/// A corner of a face: position and normal, both from 0; `NO_NORMAL` where there is none.
type Corner = (u32, u32);

const NO_NORMAL: u32 = u32::MAX;

/// What the lines hold.
#[derive(Debug, Default)]
struct Lines {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    triangles: Vec<[Corner; 3]>,
    /// Points and lines, which have no surface.
    skipped: usize,
}

/// Reads a whole file. Units are taken as metres, +Y as up.
///
/// Polygons become fans. A vertex is a position with a normal: in the order of `v`, and where a
/// position comes with several normals in the order of `vn`. So a mesh without creases keeps the
/// file's vertex numbers; positions that no face uses are dropped. Normals that are missing, or
/// only repeat the faces of a smooth surface, are computed.
pub(super) fn read(
    source: &Source,
    budget: &mut Budget,
    notices: &mut Notices,
) -> Result<(Skeleton, Mesh), Error> {
    let mut lines = read_lines(&source.bytes, budget)?;
    if lines.triangles.is_empty() {
        return Err(Error::NoTriangles { place: source.name.clone() });
    }
    if lines.skipped > 0 {
        let count = lines.skipped;
        notices.add(format!("{count} points and lines were left out: they have no surface"));
    }
    if has_derived_normals(&lines) {
        notices.add(
            "the file numbers one normal for each face of a smooth surface; these were replaced \
             by smooth normals, so that faces share vertices",
        );
        lines.triangles.iter_mut().flatten().for_each(|corner| corner.1 = NO_NORMAL);
    }
    share_equal_normals(&mut lines);
    let mut corners: Vec<Corner> = lines.triangles.iter().flatten().copied().collect();
    corners.sort_unstable();
    corners.dedup();
    budget.take(Quantity::Vertices, corners.len() as u64, "the file")?;
    Ok(assemble(&lines, &corners, &source.name, notices))
}

fn read_lines(bytes: &[u8], budget: &mut Budget) -> Result<Lines, Error> {
    let mut lines = Lines::default();
    for (index, line) in bytes.split(|&byte| byte == b'\n').enumerate() {
        let fault = |fault: String| Error::Obj { line: index + 1, fault };
        // Names and comments may be in any encoding; what is read is ASCII.
        let line = line.split(|&byte| byte == b'#').next().unwrap_or_default();
        let text = std::str::from_utf8(line).unwrap_or_default();
        let mut words = text.split_ascii_whitespace();
        match words.next() {
            Some("v") => {
                budget.take(Quantity::DecodedBytes, 12, "the file")?;
                lines.positions.push(vector(words).map_err(fault)?);
            }
            Some("vn") => {
                budget.take(Quantity::DecodedBytes, 12, "the file")?;
                lines.normals.push(vector(words).map_err(fault)?);
            }
            Some("f") => face(words, &mut lines, budget)?.map_err(fault)?,
            Some("p" | "l") => lines.skipped += 1,
            _ if line.ends_with(b"\\") || line.ends_with(b"\\\r") => {
                return Err(fault("lines continued by `\\` are not supported".into()));
            }
            _ => {}
        }
    }
    Ok(lines)
}

/// Three numbers; a `v` may have more, which are colours.
fn vector<'a>(mut words: impl Iterator<Item = &'a str>) -> Result<Vec3, String> {
    let mut out = [0.0; 3];
    for (axis, number) in ["x", "y", "z"].iter().zip(&mut out) {
        let word = words.next().ok_or_else(|| format!("{axis} is missing"))?;
        let value: Result<f32, _> = word.parse();
        *number = value.ok().filter(|value| value.is_finite()).ok_or_else(|| {
            let word: String = word.chars().take(20).collect();
            format!("{axis} is {word:?}, no finite number")
        })?;
    }
    Ok(Vec3::from_array(out))
}

/// A polygon as a fan around its first corner. The outer result is the budget's.
fn face<'a>(
    words: impl Iterator<Item = &'a str>,
    lines: &mut Lines,
    budget: &mut Budget,
) -> Result<Result<(), String>, Error> {
    let (mut first, mut previous, mut corners) = (None, None, 0_usize);
    for word in words {
        let corner = match corner(word, lines.positions.len(), lines.normals.len()) {
            Ok(corner) => corner,
            Err(fault) => return Ok(Err(fault)),
        };
        let before = previous.replace(corner);
        if let (2.., Some(first), Some(before)) = (corners, first, before) {
            budget.take(Quantity::Triangles, 1, "the file")?;
            lines.triangles.push([first, before, corner]);
        }
        first.get_or_insert(corner);
        corners += 1;
    }
    Ok(if corners < 3 { Err(format!("a face of {corners} corners")) } else { Ok(()) })
}

/// `v`, `v/vt`, `v//vn` or `v/vt/vn`, from 1, or negative: counted back from the latest.
fn corner(word: &str, positions: usize, normals: usize) -> Result<Corner, String> {
    let mut parts = word.split('/');
    let position = resolve(parts.next().unwrap_or_default(), positions, "v")?;
    let _texture = parts.next();
    let normal = match parts.next() {
        None | Some("") => NO_NORMAL,
        Some(part) => resolve(part, normals, "vn")?,
    };
    Ok((position, normal))
}

fn resolve(part: &str, count: usize, list: &str) -> Result<u32, String> {
    let shown = || part.chars().take(20).collect::<String>();
    let number: i64 = part.parse().map_err(|_| format!("{:?} is no index", shown()))?;
    let count = count as i64;
    let index = if number < 0 { count.saturating_add(number) } else { number.saturating_sub(1) };
    if (0..count).contains(&index) {
        return Ok(index as u32);
    }
    Err(format!("it names {list} {}, but {count} of them stand before it", shown()))
}

/// Whether the normals are no more than a by-product of the faces: triangle k uses normal k at all
/// corners, and on nearly all corners it is within 30° of the smooth normal there. (Mesh
/// libraries write this; the faces of a box, which also have a normal each, are 55° off.)
fn has_derived_normals(lines: &Lines) -> bool {
    let numbered = |(face, triangle): (usize, &[Corner; 3])| {
        triangle.iter().all(|corner| corner.1 as usize == face)
    };
    if !lines.triangles.iter().enumerate().all(numbered) {
        return false;
    }
    let triangles: Vec<[u32; 3]> = lines.triangles.iter().map(|t| t.map(|c| c.0)).collect();
    let mut smooth = vec![Vec3::ZERO; lines.positions.len()];
    normals::complete(&lines.positions, &triangles, 0, &mut smooth);
    let off = |corner: &&Corner| {
        let given = lines.normals[corner.1 as usize].normalize_or_zero();
        given.dot(smooth[corner.0 as usize]) < 0.866
    };
    let creased = lines.triangles.iter().flatten().filter(off).count();
    creased * 20 < lines.triangles.len() * 3
}

/// Lets corners with equal normals name the first of them, so that they become one vertex.
fn share_equal_normals(lines: &mut Lines) {
    let bits = |index: &u32| lines.normals[*index as usize].to_array().map(f32::to_bits);
    let mut order: Vec<u32> = (0..lines.normals.len() as u32).collect();
    order.sort_by_key(bits);
    let mut first = vec![NO_NORMAL; lines.normals.len()];
    for run in order.chunk_by(|a, b| bits(a) == bits(b)) {
        run.iter().for_each(|&index| first[index as usize] = run[0]);
    }
    for corner in lines.triangles.iter_mut().flatten() {
        corner.1 = first.get(corner.1 as usize).copied().unwrap_or(NO_NORMAL);
    }
}

/// Numbers the vertices by the sorted `corners`.
fn assemble(
    lines: &Lines,
    corners: &[Corner],
    file: &str,
    notices: &mut Notices,
) -> (Skeleton, Mesh) {
    let index = |corner: &Corner| corners.binary_search(corner).unwrap_or_default() as u32;
    let triangles: Vec<[u32; 3]> =
        lines.triangles.iter().map(|t| t.each_ref().map(index)).collect();
    let positions: Vec<Vec3> = corners.iter().map(|c| lines.positions[c.0 as usize]).collect();
    let given = |corner: &Corner| lines.normals.get(corner.1 as usize).copied();
    let mut normals: Vec<Vec3> = corners.iter().map(|c| given(c).unwrap_or_default()).collect();
    let filled = normals::complete(&positions, &triangles, 0, &mut normals);
    if filled > 0 {
        let all = normals.len();
        notices.add(format!("{filled} of {all} normals are missing and were computed"));
    }
    let stem = file.rsplit('/').next().unwrap_or(file).split('.').next().unwrap_or(file);
    let name = if stem.is_empty() { "mesh" } else { stem }.to_owned();
    let node = Node { name: name.clone(), parent: None, rest: Transform::IDENTITY };
    let count = positions.len();
    let part = Part {
        node: 0,
        source_node: 0,
        primitive: 0,
        name,
        vertices: 0..count,
        triangles: 0..triangles.len(),
    };
    let mesh = Mesh {
        positions,
        normals,
        triangles,
        parts: vec![part],
        deformers: vec![Deformer { node: 0, inverse_bind: glam::Affine3A::IDENTITY }],
        influences: vec![Influence { deformer: 0, weight: 1.0 }; count],
        influence_starts: (0..=count as u32).collect(),
        ..Mesh::default()
    };
    (Skeleton { nodes: vec![node] }, mesh)
}

#[cfg(test)]
mod tests {
    use super::super::{Limits, Scene, import_sources};
    use super::*;

    fn read_text(text: &str) -> Result<Scene, Error> {
        let source = Source { name: "a.obj".into(), bytes: text.as_bytes().to_vec() };
        import_sources(vec![source], &Limits::default())
    }

    const QUAD: &str = "v 0 0 0\nv 1 0 0 \nv 9 9 9\nv 1 1 0\r\nv 0 1 0\n";

    /// A polygon becomes a fan, unused positions are dropped, order is kept, and the normals of a
    /// flat polygon are its own.
    #[test]
    fn polygons_become_fans() {
        let scene = read_text(&format!("{QUAD}# f 1 2 3\nf 1 2 4 5\n")).unwrap();
        assert_eq!(scene.mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(scene.mesh.positions.len(), 4);
        assert!(scene.mesh.normals.iter().all(|normal| *normal == Vec3::Z));
        assert_eq!(scene.mesh.influence_starts, [0, 1, 2, 3, 4]);
        assert_eq!(scene.skeleton.nodes[0].name, "a");
    }

    /// Negative indices count back, all four forms of a corner are read, and a position with two
    /// normals is two vertices.
    #[test]
    fn corners_name_normals() {
        let text = format!("{QUAD}vn 0 0 2\nvn 1 0 0\nf -5/1/1 2//1 4//-2\nf 1//2 4//2 5//-1\n");
        let scene = read_text(&text).unwrap();
        assert_eq!(scene.mesh.triangles, [[0, 2, 3], [1, 4, 5]]);
        assert_eq!(scene.mesh.normals[0], Vec3::Z);
        assert_eq!(scene.mesh.normals[1], Vec3::X);
    }

    /// An octahedron subdivided towards a sphere with a normal numbered for each face is read as
    /// smooth; a tetrahedron, whose faces meet sharply, keeps its facets.
    #[test]
    fn facet_normals_of_smooth_surfaces_are_dropped() {
        let sphere = |rings: usize| {
            let at = |i: usize, j: usize| {
                let (u, v) = (i as f32 / rings as f32, j as f32 / rings as f32);
                format!("v {} {} {}\n", u - 0.5, v - 0.5, (u * u + v * v) * 0.2)
            };
            let mut text = String::new();
            (0..=rings).for_each(|i| (0..=rings).for_each(|j| text += &at(i, j)));
            let (mut faces, mut count) = (String::new(), 0);
            for i in 0..rings {
                for j in 0..rings {
                    let a = i * (rings + 1) + j + 1;
                    let (b, c, d) = (a + 1, a + rings + 1, a + rings + 2);
                    for [p, q, r] in [[a, c, d], [a, d, b]] {
                        count += 1;
                        text += "vn 0 0 1\n";
                        faces += &format!("f {p}//{count} {q}//{count} {r}//{count}\n");
                    }
                }
            }
            text + &faces
        };
        let smooth = read_text(&sphere(8)).unwrap();
        assert_eq!(smooth.mesh.positions.len(), 81);
        assert!(smooth.notices.iter().any(|notice| notice.contains("smooth")));
        let tetrahedron = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvn 0 0 -1\nvn 0 -1 0\nvn -1 0 0\n\
             vn 1 1 1\nf 1//1 3//1 2//1\nf 1//2 2//2 4//2\nf 1//3 4//3 3//3\nf 2//4 3//4 4//4\n";
        assert_eq!(read_text(tetrahedron).unwrap().mesh.positions.len(), 12);
        let twice =
            format!("{QUAD}vn 0 0 1\nvn 0 0 1\nvn 1 0 0\nf 1//1 2//1 4//1\nf 1//2 4//2 5//3\n");
        assert_eq!(read_text(&twice).unwrap().mesh.positions.len(), 4);
    }

    /// Each fault is refused with its line.
    #[test]
    fn faults_name_their_line() {
        for (line, expected) in [
            ("v 0 nan 0", "y is \"nan\""),
            ("v 0 1", "z is missing"),
            ("v 1e39 0 0", "x is \"1e39\""),
            ("f 1 2", "a face of 2 corners"),
            ("f 1 2 6", "names v 6"),
            ("f 1 2 0", "names v 0"),
            ("f 1 2 -6", "names v -6"),
            ("f 1//1 2 4", "names vn 1"),
            ("f 1 2 x", "\"x\" is no index"),
        ] {
            let refusal = read_text(&format!("{QUAD}{line}\n")).unwrap_err().to_string();
            assert!(refusal.contains("line 6") && refusal.contains(expected), "{refusal}");
        }
        assert!(matches!(read_text(QUAD), Err(Error::NoTriangles { .. })));
    }
}
