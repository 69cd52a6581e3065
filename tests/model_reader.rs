//! `proto/model.md` is enough to write a reader: the one that it shows, which shares no code with
//! this crate, reads blobs of every family and precision and evaluates them to the same numbers.
//! `make test` brings the interpreter; a run without it skips, except where `CI` is set.

#[path = "needs/python.rs"]
mod python;

use std::process::Command;

use poselight::model::{
    Cluster, Clustered, ColumnHeader, Decoder, FORMAT_VERSION, Family, Form, Frame, Header,
    MeshIdentity, Model, Multilinear, NodeHeader, Precision, Provenance, RigHeader,
    RootMotionHeader, Signal, SourceHeader, TrainingSummary, WeightHeader,
};
use poselight::num::random::Stream;

const POINTS: usize = 300;
const VERTICES: usize = 310;
const PARAMETERS: usize = 5;
const INPUTS: usize = 3;
const OUTPUTS: usize = 7;
const WIDTH: usize = 16;

/// What is run after the reader of the page.
const DRIVER: &str = r#"
import sys
blob, parameters, expected = sys.argv[1:]
header, tensors = read(blob)
x, expected = np.fromfile(parameters, "<f4"), np.fromfile(expected, "<f4")
y = evaluate(header, tensors, x)
assert y.shape == (310, 16), y.shape
worst = np.abs(y.ravel() - expected).max()
assert worst < 1e-4, worst
"#;

fn numbers(seed: u64, count: usize) -> Vec<f32> {
    let mut stream = Stream::new(seed);
    (0..count).map(|_| stream.normal() as f32).collect()
}

fn rig() -> RigHeader {
    let node = NodeHeader {
        name: "Hips".to_owned(),
        parent: None,
        translation: [0.0; 3],
        rotation: [0.0, 0.0, 0.0, 1.0],
        scale: [1.0; 3],
    };
    let slots = 0..PARAMETERS as u32;
    let weights = slots.clone().map(|i| WeightHeader { name: format!("{i}"), default: 0.0 });
    let columns = slots.map(|slot| ColumnHeader {
        name: format!("{slot}"),
        source: SourceHeader::Weight { slot },
    });
    RigHeader {
        nodes: vec![node],
        root_node: Some(0),
        bones: vec![0],
        weights: weights.collect(),
        columns: columns.collect(),
        size_m: 1.0,
        dropped: Vec::new(),
        root_motion: RootMotionHeader::Rigid,
    }
}

fn model(family: Family) -> Model {
    let own = matches!(family, Family::Mean | Family::Linear | Family::Multilinear);
    let retained = if own { 0 } else { INPUTS };
    let header = Header {
        format_version: FORMAT_VERSION,
        family,
        precision: Precision::F32,
        signal: Signal::Transfer,
        order: 4,
        channels: 1,
        frame: Frame::Bone,
        conventions: Header::conventions(),
        unshadowed: false,
        occluders: None,
        rest: None,
        rig: rig(),
        mesh: MeshIdentity {
            scene_sha256: "0".repeat(64),
            shape_sha256: None,
            receivers_sha256: None,
            vertices: VERTICES as u32,
            points: POINTS as u32,
            parts: Vec::new(),
        },
        training: TrainingSummary {
            poses: 1,
            centre: numbers(1, PARAMETERS),
            deviations: vec![1.0; retained],
            residual_rms: 0.0,
            reach: (!matches!(family, Family::Linear | Family::ClusteredTanh)).then_some(0.5),
            directions: Vec::new(),
        },
        errors: [].into(),
        provenance: Provenance::default(),
    };
    let mean = numbers(2, POINTS * WIDTH);
    let decoder = match family {
        Family::Mean => Decoder::Mean { mean },
        Family::Linear => {
            Decoder::Linear { mean, weights: numbers(3, POINTS * WIDTH * PARAMETERS) }
        }
        Family::PcaLinear => Decoder::PcaLinear {
            projection: numbers(4, PARAMETERS * INPUTS),
            coefficients: numbers(5, WIDTH * (INPUTS + 1) * OUTPUTS),
            basis: numbers(6, POINTS * OUTPUTS),
        },
        Family::Multilinear => Decoder::Multilinear(multilinear(mean)),
        Family::ClusteredLinear => Decoder::Clustered(clustered(Form::Linear, INPUTS, 0)),
        Family::ClusteredQuadratic => {
            let features = INPUTS + INPUTS * (INPUTS + 1) / 2;
            Decoder::Clustered(clustered(Form::Quadratic, features, 0))
        }
        Family::ClusteredTanh => Decoder::Clustered(clustered(Form::Tanh, 5, 5)),
    };
    let points = (0..VERTICES).map(|vertex| (vertex * 7 % POINTS) as u32).collect();
    Model::new(header, decoder, points, vec![0; POINTS]).expect("a valid model")
}

/// Three pose clusters whose points share four rows about a mean.
fn multilinear(mean: Vec<f32>) -> Multilinear {
    Multilinear {
        blend_exponent: 3.0,
        inputs: INPUTS,
        intercepts: true,
        centres: numbers(10, 3 * PARAMETERS),
        projection: numbers(11, PARAMETERS * 3 * INPUTS),
        mean,
        coefficients: numbers(12, 4 * 3 * WIDTH * (INPUTS + 1)),
        row_of_point: (0..3 * POINTS).map(|i| (i * 3 % 4) as u32).collect(),
    }
}

/// Two clusters, the second without outputs.
fn clustered(form: Form, features: usize, neurons: usize) -> Clustered {
    let count = |cluster: usize| (0..POINTS).filter(|point| point % 2 == cluster).count();
    let first = Cluster {
        outputs: 3,
        basis: numbers(13, count(0) * WIDTH * 4),
        weights: numbers(14, 3 * (features + 1)),
        hidden: numbers(15, neurons * (INPUTS + 1)),
    };
    let second = Cluster { basis: numbers(16, count(1) * WIDTH), ..Cluster::default() };
    Clustered {
        form,
        projection: numbers(4, PARAMETERS * INPUTS),
        cluster_of_point: (0..POINTS).map(|point| (point % 2) as u32).collect(),
        clusters: vec![first, second],
    }
}

/// Our own evaluation of the bytes, at the vertices.
fn evaluated(bytes: &[u8], parameters: &[f32]) -> Vec<f32> {
    let model = Model::from_bytes(bytes).expect("our own blob");
    let mut out = vec![0.0; POINTS * WIDTH];
    model.evaluate(parameters, None, &mut out).expect("evaluates");
    let rows = model.point_of_vertex().iter();
    rows.flat_map(|&point| &out[point as usize * WIDTH..][..WIDTH]).copied().collect()
}

/// The Python code of the page, with what drives it.
fn script() -> String {
    let page = include_str!("../proto/model.md");
    let (_, code) = page.split_once("```python\n").expect("the page shows a reader");
    let (code, _) = code.split_once("```").expect("the reader ends");
    format!("{code}{DRIVER}")
}

/// A blob with one more field in its header.
fn with_field(blob: &[u8], field: &str) -> Vec<u8> {
    let length = u64::from_le_bytes(blob[..8].try_into().expect("eight bytes")) as usize;
    let header = std::str::from_utf8(&blob[8..8 + length]).expect("text");
    let start = r#""poselight":"{"#;
    assert!(header.contains(start), "{header}");
    let more = header.replacen(start, &format!(r#"{start}\"{field}\":true,"#), 1);
    [&(more.len() as u64).to_le_bytes(), more.as_bytes(), &blob[8 + length..]].concat()
}

/// What the page's reader cannot evaluate it refuses by name, rather than give a part of it as the
/// whole; a field that nobody knows is refused by our own reader too.
#[test]
fn the_pages_reader_refuses_what_it_does_not_handle() {
    let Some(python) = python::with("numpy") else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| folder.path().join(name);
    std::fs::write(path("reader.py"), script()).expect("writes");
    std::fs::write(path("empty"), b"").expect("writes");
    let bytes = model(Family::Mean).to_bytes(Precision::F32).expect("writes");
    for field in ["unshadowed", "occluders", "tint"] {
        let blob = with_field(&bytes, field);
        let ours = Model::from_bytes(&blob);
        assert_eq!(ours.is_ok(), field == "unshadowed", "{field}: {ours:?}");
        std::fs::write(path("blob"), blob).expect("writes");
        let paths = ["reader.py", "blob", "empty", "empty"].map(path);
        let run = Command::new(&python).args(paths).output().expect("runs");
        let text = String::from_utf8_lossy(&run.stderr);
        let expected = format!("this reader does not handle {{'{field}'}}");
        assert!(!run.status.success() && text.contains(&expected), "{field}: {text}");
    }
}

#[test]
fn the_page_is_enough_for_a_reader() {
    let Some(python) = python::with("numpy") else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).expect("writes");
        path
    };
    let script = file("reader.py", script().as_bytes());
    let raw = |values: &[f32]| values.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    let parameters = numbers(9, PARAMETERS);
    let input = file("parameters", &raw(&parameters));
    for &family in Family::ALL {
        for &precision in Precision::ALL {
            let bytes = model(family).to_bytes(precision).expect("writes");
            let blob = file("model.safetensors", &bytes);
            let expected = file("expected", &raw(&evaluated(&bytes, &parameters)));
            let run = Command::new(&python).args([&script, &blob, &input, &expected]).output();
            let run = run.expect("runs");
            let text = String::from_utf8_lossy(&run.stderr);
            assert!(run.status.success(), "{family} {precision}: {text}");
        }
    }
}
