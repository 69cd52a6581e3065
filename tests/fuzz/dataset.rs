//! Fuzzes the readers of data sets: `Dataset::open` and all reads, `Reference::open`, and
//! `Writer::open` on a folder that is there. The first byte of an input below 128 picks one of the
//! files of a valid data set, which the rest replaces; from 128 on the rest is triples of bytes
//! (file, token, replacement), which change single values of valid JSON, so that several files can
//! tell the same lie.

#![no_main]

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use libfuzzer_sys::fuzz_target;
use poselight::dataset::{
    Attributes, Dataset, Error, Header, Layout, PartRange, PoseData, PoseTable, Reference,
    ReferenceHeader, ReferencePose, RestMesh, SPLIT_NAMES, Static, Writer,
};
use poselight::rig::RigidFrame;
use poselight::scene::Source;

/// Three poses, the last alone in its block.
const LAYOUT: Layout = Layout {
    poses: 3,
    points: 2,
    vertices: 3,
    triangles: 1,
    channels: 1,
    coefficients: 4,
    parameters: 1,
    bones: 1,
    block_poses: 2,
};

fuzz_target!(|data: &[u8]| {
    let Some((&way, rest)) = data.split_first() else { return };
    let victim = victim();
    let changes = if way < 128 {
        let file = usize::from(way) % victim.files.len();
        BTreeMap::from([(file, rest.to_vec())])
    } else {
        victim.edited(rest)
    };
    for (&file, bytes) in &changes {
        fs::write(&victim.files[file].path, bytes).expect("the folder can be written");
    }
    let _ = use_dataset(&victim.root);
    // A part of the inputs: it costs as much again and shares most of what it checks.
    if rest.iter().fold(0, |sum: u8, &byte| sum.wrapping_add(byte)) % 8 == 0 {
        let _ = Writer::open(&victim.root, &header(), &tables());
    }
    for &file in changes.keys() {
        let File { path, bytes, .. } = &victim.files[file];
        fs::write(path, bytes).expect("the folder can be written");
    }
});

/// Opens and reads everything, and holds it to what the documentation promises.
fn use_dataset(root: &Path) -> Result<(), Error> {
    let dataset = Dataset::open(root)?;
    let layout = dataset.header().layout;
    layout.check()?;
    check_tables(&dataset);
    dataset.sources()?;
    let mut row = vec![0.0; layout.points * layout.row()];
    for pose in 0..layout.poses {
        dataset.read_points(&[pose], 0..layout.points, &mut row)?;
        assert!(row.iter().all(|value| value.is_finite()), "pose {pose} is not finite");
    }
    let training = dataset.training()?;
    assert!(training.poses() > 0 && training.noise_variance().is_finite(), "training");
    let reference = Reference::open(&dataset)?;
    for (index, &pose) in reference.header().poses.iter().enumerate() {
        assert!(pose < layout.poses, "reference pose {pose}");
        reference.read(0, index, &mut row)?;
        reference.read_normals(index)?;
    }
    Ok(())
}

fn check_tables(dataset: &Dataset) {
    let (layout, mesh) = (dataset.header().layout, dataset.mesh());
    let below = |indices: &[u32], end: usize| indices.iter().all(|&index| (index as usize) < end);
    assert_eq!(dataset.parameters().len(), layout.poses * layout.parameters);
    assert_eq!(dataset.bone_rotations().len(), layout.poses * layout.bones);
    assert!(below(&mesh.point_of_vertex, layout.points));
    assert!(below(&mesh.vertex_of_point, layout.vertices));
    assert!(below(mesh.triangles.as_flattened(), layout.vertices));
    assert!(dataset.point_bones().iter().all(|&bone| usize::from(bone) < layout.bones));
    assert!(dataset.splits().iter().all(|&split| usize::from(split) < SPLIT_NAMES.len()));
    let clips = dataset.header().attributes.clip_names.len() as i64;
    assert!(dataset.clips().iter().all(|&clip| (-1..clips).contains(&i64::from(clip))));
}

/// One file of the valid data set.
struct File {
    path: PathBuf,
    bytes: Vec<u8>,
    /// Where the numbers and texts of a JSON file begin and end.
    tokens: Vec<(usize, usize)>,
}

/// The valid data set; ascending by path.
struct Victim {
    root: PathBuf,
    files: Vec<File>,
}

/// Values that are often wrong.
const EXTREMES: [&str; 16] = [
    "-1",
    "255",
    "65535",
    "65536",
    "4294967296",
    "9223372036854775807",
    "18446744073709551615",
    "1e39",
    "0.5",
    "null",
    "\"x\"",
    "\"NaN\"",
    "[]",
    "{}",
    "\"ao\"",
    "\"float32\"",
];

impl Victim {
    /// Files with single tokens replaced: small numbers, then [`EXTREMES`].
    fn edited(&self, edits: &[u8]) -> BTreeMap<usize, Vec<u8>> {
        let mut chosen: BTreeMap<usize, BTreeMap<usize, String>> = BTreeMap::new();
        for edit in edits.as_chunks::<3>().0.iter().take(40) {
            let file = usize::from(edit[0]) % self.files.len();
            let tokens = self.files[file].tokens.len();
            if tokens > 0 {
                let extreme = usize::from(edit[2]).checked_sub(128);
                let value = extreme.map_or_else(
                    || edit[2].to_string(),
                    |extreme| EXTREMES[extreme % EXTREMES.len()].to_owned(),
                );
                chosen.entry(file).or_default().insert(usize::from(edit[1]) % tokens, value);
            }
        }
        let change = |(file, values): (usize, BTreeMap<usize, String>)| {
            let File { bytes, tokens, .. } = &self.files[file];
            let (mut out, mut copied) = (Vec::new(), 0);
            for (token, value) in values {
                let (start, end) = tokens[token];
                out.extend_from_slice(&bytes[copied..start]);
                out.extend_from_slice(value.as_bytes());
                copied = end;
            }
            out.extend_from_slice(&bytes[copied..]);
            (file, out)
        };
        chosen.into_iter().map(change).collect()
    }
}

/// Numbers and quoted texts of a JSON file; values and names of fields alike.
fn tokens(bytes: &[u8]) -> Vec<(usize, usize)> {
    let (mut found, mut at) = (Vec::new(), 0);
    while at < bytes.len() {
        let rest = &bytes[at..];
        let length = match rest[0] {
            b'"' => rest[1..].iter().position(|&byte| byte == b'"').map_or(1, |end| end + 2),
            b'0'..=b'9' | b'-' => {
                rest.iter().position(|&byte| b",\n".contains(&byte)).unwrap_or(rest.len())
            }
            _ => 0,
        };
        if length > 0 {
            found.push((at, at + length));
        }
        at += length.max(1);
    }
    found
}

fn victim() -> &'static Victim {
    static VICTIM: OnceLock<Victim> = OnceLock::new();
    VICTIM.get_or_init(|| {
        let parent = Path::new("/dev/shm");
        let parent = if parent.is_dir() { parent.to_owned() } else { std::env::temp_dir() };
        remove_stale(&parent);
        let root = parent.join(format!("{PREFIX}{}", std::process::id()));
        bake(&root).expect("the valid data set can be written");
        use_dataset(&root).expect("the valid data set can be read");
        let mut files = Vec::new();
        list(&root, &mut files);
        files.sort_by(|a, b| a.path.cmp(&b.path));
        Victim { root, files }
    })
}

/// The folder's name up to the process that uses it.
const PREFIX: &str = "poselight-fuzz-dataset-";

/// Removes the folders of processes that have ended; a fuzzer never comes to clean up its own.
fn remove_stale(parent: &Path) {
    for entry in fs::read_dir(parent).into_iter().flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        let process = name.strip_prefix(PREFIX).map(|id| Path::new("/proc").join(id));
        if process.is_some_and(|process| !process.exists()) {
            let _ = fs::remove_dir_all(entry.path());
        }
    }
}

fn list(folder: &Path, files: &mut Vec<File>) {
    for entry in fs::read_dir(folder).expect("the data set is there") {
        let path = entry.expect("the data set is there").path();
        if path.is_dir() {
            list(&path, files);
        } else {
            let bytes = fs::read(&path).expect("the data set is there");
            let json = path.extension().is_some_and(|extension| extension == "json");
            let tokens = if json { tokens(&bytes) } else { Vec::new() };
            files.push(File { path, bytes, tokens });
        }
    }
}

fn header() -> Header {
    let part = PartRange {
        node: "n".into(),
        mesh: "m".into(),
        primitive: 0,
        first_vertex: 0,
        vertices: LAYOUT.vertices,
        first_triangle: 0,
        triangles: LAYOUT.triangles,
    };
    Header {
        layout: LAYOUT,
        attributes: Attributes {
            hashes: BTreeMap::from([("bake".into(), "b".into())]),
            signal: "transfer".into(),
            order: 2,
            clip_names: vec!["c".into()],
            parameter_names: vec!["p".into()],
            parts: vec![part],
            ..Attributes::default()
        },
    }
}

fn tables() -> Static {
    Static {
        poses: PoseTable {
            parameters: vec![0.5; 3],
            clips: vec![0; 3],
            times_s: vec![0.0, 0.1, 0.2],
            splits: vec![0, 0, 1],
            roots: vec![RigidFrame::IDENTITY; 3],
            bone_rotations: vec![RigidFrame::IDENTITY.rotation; 3],
        },
        mesh: RestMesh {
            positions: vec![RigidFrame::IDENTITY.translation; 3],
            normals: vec![RigidFrame::IDENTITY.translation; 3],
            triangles: vec![[0, 1, 2]],
            point_of_vertex: vec![0, 1, 1],
            vertex_of_point: vec![0, 1],
            bone_of_point: vec![0; 2],
        },
        sources: vec![Source { name: "s".into(), bytes: b"glTF".to_vec() }],
    }
}

fn bake(root: &Path) -> Result<(), Error> {
    let mut writer = Writer::open(root, &header(), &tables())?;
    let data = PoseData { coefficients: &[0.25; 8], noise: &[0.1; 2], rays: &[9; 2] };
    for block in writer.missing_blocks() {
        writer.commit(block, &vec![data; LAYOUT.poses_of(block).len()])?;
    }
    let dataset = Dataset::open(root)?;
    let header = ReferenceHeader { poses: vec![2], rays: 9, seeds: [1, 2], hash: "r".into() };
    let mut reference = Reference::open_or_create(&dataset, &header)?;
    let normals = [RigidFrame::IDENTITY.translation; 2];
    let data = ReferencePose { coefficients: &[0.25; 8], noise: &[0.1; 2], normals: &normals };
    reference.commit(0, 0, &data)?;
    reference.commit(1, 0, &data)
}
