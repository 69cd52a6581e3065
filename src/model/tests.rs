//! Tests of a whole model: evaluation, frames, poses and folding against plain f64 arithmetic.

use glam::{Quat, Vec3};
use proptest::prelude::*;

use super::synthetic::{self, PARAMETERS, POINTS};
use super::*;
use crate::rig::Pose;
use crate::sh::{Rotation, evaluate, zonal};

/// The definition of each family in f64, straight from the decoder's plain arrays.
fn oracle(model: &Model, parameters: &[f32]) -> Vec<f64> {
    let (shape, centre) = (model.shape(), &model.header().training.centre);
    let f = |x: f32| f64::from(x);
    match model.decoder() {
        Decoder::Mean { mean } => mean.into_iter().map(f).collect(),
        Decoder::Linear { mean, weights } => mean
            .iter()
            .enumerate()
            .map(|(row, &mean)| {
                let weights = &weights[row * shape.parameters..];
                let terms = parameters.iter().zip(centre).zip(weights);
                f(mean) + terms.map(|((&x, &c), &w)| f(w) * (f(x) - f(c))).sum::<f64>()
            })
            .collect(),
        Decoder::PcaLinear { projection, coefficients, basis } => {
            let (d_in, d_out) = (shape.inputs, shape.outputs);
            let mut features: Vec<f64> = (0..d_in)
                .map(|k| {
                    (0..PARAMETERS).map(|i| f(projection[i * d_in + k]) * f(parameters[i])).sum()
                })
                .collect();
            features.push(1.0);
            let mut out = Vec::new();
            for v in 0..shape.points {
                for c in 0..shape.width {
                    out.push(
                        (0..d_out)
                            .flat_map(|j| (0..=d_in).map(move |k| (j, k)))
                            .map(|(j, k)| {
                                let x = f(coefficients[(c * (d_in + 1) + k) * d_out + j]);
                                f(basis[v * d_out + j]) * x * features[k]
                            })
                            .sum(),
                    );
                }
            }
            out
        }
        Decoder::Multilinear(m) => multilinear_oracle(&m, shape, parameters),
        Decoder::Clustered(c) => clustered_oracle(&c, shape, centre, parameters),
    }
}

/// AO07 equations 4 and 5 as they are printed, with the intercept where there is one.
fn multilinear_oracle(m: &Multilinear, shape: Shape, parameters: &[f32]) -> Vec<f64> {
    let f = |x: f32| f64::from(x);
    let Shape { points, width, parameters: a, .. } = shape;
    let (clusters, inner) = (m.centres.len() / a, m.inputs + usize::from(m.intercepts));
    let offset = |j: usize, i: usize| f(parameters[i]) - f(m.centres[j * a + i]);
    let inverse = |j: usize| {
        let square: f64 = (0..a).map(|i| offset(j, i).powi(2)).sum();
        square.sqrt().powf(-f(m.blend_exponent))
    };
    let sum: f64 = (0..clusters).map(inverse).sum();
    let mut out = vec![0.0; points * width];
    for (at, out) in out.iter_mut().enumerate() {
        let (point, c) = (at / width, at % width);
        *out = m.mean.get(at).map_or(0.0, |&x| f(x));
        for j in 0..clusters {
            let row = m.row_of_point.get(j * points + point).map_or(point, |&row| row as usize);
            let x = &m.coefficients[((row * clusters + j) * width + c) * inner..][..inner];
            let projected = |k: usize| -> f64 {
                (0..a)
                    .map(|i| f(m.projection[(i * clusters + j) * m.inputs + k]) * offset(j, i))
                    .sum()
            };
            let linear: f64 = (0..m.inputs).map(|k| f(x[k]) * projected(k)).sum();
            *out += inverse(j) / sum * (linear + x.get(m.inputs).map_or(0.0, |&x| f(x)));
        }
    }
    out
}

/// RPO09 equation 12 and its linear and quadratic counterparts.
fn clustered_oracle(m: &Clustered, shape: Shape, centre: &[f32], x: &[f32]) -> Vec<f64> {
    let f = |x: f32| f64::from(x);
    let d = shape.inputs;
    let reduced: Vec<f64> = (0..d)
        .map(|k| (0..x.len()).map(|i| f(m.projection[i * d + k]) * (f(x[i]) - f(centre[i]))).sum())
        .collect();
    let mut out = vec![0.0; shape.points * shape.width];
    let mut seen = vec![0; m.clusters.len()];
    for (point, out) in out.chunks_exact_mut(shape.width).enumerate() {
        let cluster = &m.clusters[m.cluster_of_point[point] as usize];
        let first = &mut seen[m.cluster_of_point[point] as usize];
        let mut features = match m.form {
            Form::Tanh => Vec::new(),
            Form::Linear | Form::Quadratic => reduced.clone(),
        };
        if m.form == Form::Quadratic {
            features.extend(
                (0..d)
                    .flat_map(|i| (i..d).map(move |j| (i, j)))
                    .map(|(i, j)| reduced[i] * reduced[j]),
            );
        }
        for neuron in cluster.hidden.chunks_exact(d + 1) {
            let sum: f64 = (0..d).map(|k| f(neuron[k]) * reduced[k]).sum();
            features.push((sum + f(neuron[d])).tanh());
        }
        features.push(1.0);
        let z = |k: usize| -> f64 {
            let row = &cluster.weights[k * features.len()..][..features.len()];
            row.iter().zip(&features).map(|(&w, x)| f(w) * x).sum()
        };
        let (k, basis) = (cluster.outputs, &cluster.basis);
        for (c, out) in out.iter_mut().enumerate() {
            let row = &basis[(*first * shape.width + c) * (k + 1)..][..k + 1];
            *out = f(row[k]) + (0..k).map(|j| f(row[j]) * z(j)).sum::<f64>();
        }
        *first += 1;
    }
    out
}

fn evaluated(model: &Model, parameters: &[f32], points: Option<&[u32]>) -> Vec<f32> {
    let count = points.map_or(POINTS, <[u32]>::len);
    let mut out = vec![f32::NAN; count * model.shape().width];
    model.evaluate(parameters, points, &mut out).unwrap();
    out
}

fn rotations() -> Vec<Quat> {
    [(0.1, 0.7, -0.3, 0.5), (0.0, 0.0, 0.0, 2.0), (-0.6, 0.1, 0.2, -0.4)]
        .map(|(x, y, z, w)| Quat::from_xyzw(x, y, z, w))
        .to_vec()
}

/// Every family agrees with its definition in f64; any list of points gives the same bits as the
/// whole; the planar layout holds the same numbers.
#[test]
fn evaluation_is_the_definition() {
    for model in synthetic::all() {
        let parameters = synthetic::numbers(21, PARAMETERS);
        let out = evaluated(&model, &parameters, None);
        for (found, expected) in out.iter().zip(oracle(&model, &parameters)) {
            assert!((f64::from(*found) - expected).abs() < 2e-5, "{found} {expected}");
        }
        let (list, width) = ([36, 0, 5, 5, 31], model.shape().width);
        let some = evaluated(&model, &parameters, Some(&list));
        for (row, point) in some.chunks_exact(width).zip(list) {
            assert_eq!(row, &out[point as usize * width..(point as usize + 1) * width]);
        }
        let mut planar = vec![0.0; out.len()];
        model.evaluate_planar(&parameters, &mut planar).unwrap();
        for (i, value) in out.iter().enumerate() {
            assert_eq!(*value, planar[i % width * POINTS + i / width]);
        }
    }
}

/// Wrong lengths, NaN and points out of range are errors that say so.
#[test]
fn bad_requests_are_errors() {
    let model = synthetic::model(Family::PcaLinear, Signal::Transfer, Frame::Bone, 1);
    let mut out = vec![0.0; POINTS * 9];
    let zeros = vec![0.0; PARAMETERS];
    assert!(matches!(model.evaluate(&zeros[1..], None, &mut out), Err(Error::Length { .. })));
    assert!(matches!(model.evaluate(&zeros, None, &mut out[1..]), Err(Error::Length { .. })));
    let nan = vec![f32::NAN; PARAMETERS];
    assert!(matches!(model.evaluate(&nan, None, &mut out), Err(Error::NotFinite { .. })));
    let error = model.evaluate(&zeros, Some(&[0, 37]), &mut out).unwrap_err();
    assert!(matches!(error, Error::OutOfRange { found: 37, count: 37, .. }), "{error}");
    let error = model.to_root_frame(&[Quat::IDENTITY], None, &mut out).unwrap_err();
    assert!(matches!(error, Error::Length { found: 1, expected: 3, .. }), "{error}");
    let mut bad = rotations();
    bad[2] = Quat::from_xyzw(0.0, 0.0, 0.0, 0.0);
    let error = model.to_root_frame(&bad, None, &mut out).unwrap_err();
    assert_eq!(error, Error::NoRotation { joint: "Head".to_owned() });
}

/// An unoccluded point keeps looking unoccluded: the bone-frame coefficients of the clamped cosine
/// about the rest normal become those about the turned normal.
#[test]
fn root_frame_turns_with_the_bone() {
    let mut header = synthetic::header(Family::Mean, Signal::Transfer, Frame::Bone, 1);
    header.order = 5;
    let order = header.sh_order();
    let normals: Vec<Vec3> = synthetic::numbers(3, POINTS * 3)
        .as_chunks::<3>()
        .0
        .iter()
        .map(|&n| Vec3::from_array(n).normalize())
        .collect();
    let shaded = |normals: &[Vec3]| {
        let mut all = vec![0.0; POINTS * 25];
        for (out, &normal) in all.chunks_exact_mut(25).zip(normals) {
            zonal::rotate(order, &zonal::unshadowed(order), normal, out);
        }
        all
    };
    let (points, bones) = synthetic::maps();
    let decoder = Decoder::Mean { mean: shaded(&normals) };
    let model = Model::new(header, decoder, points, bones.clone()).unwrap();
    let mut out = evaluated(&model, &[0.0; PARAMETERS], None);
    model.to_root_frame(&rotations(), None, &mut out).unwrap();
    let turned: Vec<Vec3> = normals
        .iter()
        .zip(bones)
        .map(|(&n, bone)| rotations()[usize::from(bone)].normalize() * n)
        .collect();
    for (found, expected) in out.iter().zip(shaded(&turned)) {
        assert!((found - expected).abs() < 2e-6, "{found} {expected}");
    }
}

/// Evaluating, turning to the root frame and dotting with the light, in plain arithmetic.
fn lit(model: &Model, parameters: &[f32], light: &[f32], rotations: &[Quat]) -> Vec<f32> {
    let mut coefficients = evaluated(model, parameters, None);
    model.to_root_frame(rotations, None, &mut coefficients).unwrap();
    let count = model.header().coefficients();
    let (channels, given) = (usize::from(model.header().channels), light.len() / count);
    let mut out = Vec::new();
    for row in coefficients.chunks_exact(model.shape().width) {
        for colour in 0..channels.max(given) {
            let row = &row[colour.min(channels - 1) * count..][..count];
            let light = &light[colour.min(given - 1) * count..][..count];
            out.push(row.iter().zip(light).map(|(a, b)| a * b).sum());
        }
    }
    out
}

/// Folding and shading agree with evaluating and dotting, for every family, frame, number of
/// channels and of colours; `visibility` and the tangent frame refuse by name.
#[test]
fn folding_is_evaluating_and_dotting() {
    for model in synthetic::all() {
        let count = model.header().coefficients();
        for colours in [1, 3] {
            let light = synthetic::numbers(31, colours * count);
            if model.header().signal == Signal::Visibility {
                let error = model.fold(&light, &rotations()).unwrap_err();
                assert_eq!(error, Error::CannotFold { signal: Signal::Visibility });
                continue;
            }
            if model.header().frame == Frame::Tangent {
                let told = model.fold(&light, &rotations()).unwrap_err().to_string();
                assert!(told.contains("tangent frame"), "{told}");
                continue;
            }
            let folded = model.fold(&light, &rotations()).unwrap();
            for seed in [41, 42] {
                let parameters = synthetic::numbers(seed, PARAMETERS);
                let expected = lit(&model, &parameters, &light, &rotations());
                let mut out = vec![f32::NAN; POINTS * folded.colours()];
                folded.evaluate(&parameters, &mut out).unwrap();
                let mut shaded = vec![f32::NAN; out.len()];
                model.shade(&parameters, &light, &rotations(), &mut shaded).unwrap();
                for ((a, b), expected) in out.iter().zip(&shaded).zip(&expected) {
                    assert!((a - expected).abs() < 2e-4, "folded {a} {expected}");
                    assert!((b - expected).abs() < 2e-4, "shaded {b} {expected}");
                }
            }
        }
    }
}

/// A light of another order, or with NaN, is refused.
#[test]
fn bad_lights_are_errors() {
    let model = synthetic::model(Family::PcaLinear, Signal::Transfer, Frame::Root, 1);
    assert!(matches!(model.fold(&[1.0; 4], &[]), Err(Error::Length { .. })));
    assert!(matches!(model.fold(&[f32::NAN; 9], &[]), Err(Error::NotFinite { .. })));
    assert!(model.fold(&[1.0; 9], &[]).is_ok());
}

fn joint(rotation: Quat) -> JointTransform {
    JointTransform { rotation: Some(rotation), ..JointTransform::default() }
}

/// A pose by names becomes the rig's parameters: what is named is used (normalised), what is not
/// stays at rest, unknown names are listed, zero quaternions refused.
#[test]
fn poses_by_name() {
    let model = synthetic::model(Family::PcaLinear, Signal::Transfer, Frame::Bone, 1);
    let mean = Quat::from_xyzw(0.28, 0.0, 0.0, 0.96);
    let turn = Quat::from_rotation_y(0.5);
    let mut pose = JointPose::default();
    pose.joints.insert("Arm".to_owned(), joint(mean * turn * 3.0));
    let head = JointTransform {
        translation: Some(Vec3::new(0.0, 2.5, 0.0)),
        scale: Some(Vec3::new(1.5, 1.0, 1.0)),
        rotation: None,
    };
    pose.joints.insert("Head".to_owned(), head);
    let parameters = model.parameters_of(&pose).unwrap();
    let expected = [0.0, 0.5, 0.0, (2.5 - 0.75) / 1.75, 0.5, 0.25];
    for (found, expected) in parameters.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-5, "{parameters:?}");
    }
    pose.weights.insert("Body/smile".to_owned(), 0.75);
    assert_eq!(model.parameters_of(&pose).unwrap()[5], 0.75);

    pose.joints.insert("Tail".to_owned(), JointTransform::default());
    pose.joints.insert("Wing".to_owned(), JointTransform::default());
    let message = model.parameters_of(&pose).unwrap_err().to_string();
    assert_eq!(message, "the model's rig has no joints named `Tail`, `Wing`");
    pose.joints.retain(|name, _| name == "Arm");
    pose.weights.insert("frown".to_owned(), 1.0);
    assert!(model.parameters_of(&pose).unwrap_err().to_string().contains("`frown`"));
    pose.weights.clear();
    pose.joints.insert("Arm".to_owned(), joint(Quat::from_xyzw(0.0, 0.0, 0.0, 0.0)));
    let error = model.parameters_of(&pose).unwrap_err();
    assert_eq!(error, Error::NoRotation { joint: "Arm".to_owned() });
    pose.joints.insert("Arm".to_owned(), joint(Quat::from_xyzw(f32::NAN, 0.0, 0.0, 1.0)));
    assert!(model.parameters_of(&pose).is_err());
}

/// At rest no bone has turned and the root frame is the scene; a turn of the root turns the frame
/// and no bone; a turn of a joint turns its bone alone.
#[test]
fn bone_rotations_follow_the_pose() {
    let model = synthetic::model(Family::PcaLinear, Signal::Transfer, Frame::Bone, 1);
    let rest = model.pose_of(&JointPose::default()).unwrap();
    let close = |a: Quat, b: Quat| a.dot(b).abs() > 1.0 - 1e-6;
    for rotation in model.bone_rotations_of(&rest).unwrap() {
        assert!(close(rotation, Quat::IDENTITY), "{rotation}");
    }
    let mut turned = rest.clone();
    turned.local[1].rotation = Quat::from_rotation_x(0.7);
    for rotation in model.bone_rotations_of(&turned).unwrap() {
        assert!(close(rotation, Quat::IDENTITY), "{rotation}");
    }
    assert!(!close(model.root_frame_of(&turned).unwrap().rotation, Quat::IDENTITY));
    let mut waving = rest.clone();
    waving.local[2].rotation *= Quat::from_rotation_z(1.0);
    let rotations = model.bone_rotations_of(&waving).unwrap();
    assert!(close(rotations[0], Quat::IDENTITY) && close(rotations[2], Quat::IDENTITY));
    assert!((rotations[1].angle_between(Quat::IDENTITY) - 1.0).abs() < 1e-3);

    let short = Pose { local: rest.local[1..].to_vec(), ..rest };
    assert!(matches!(model.bone_rotations_of(&short), Err(Error::Length { .. })));
}

proptest! {
    /// A light that turns with the whole character leaves the shading as it is: evaluation in the
    /// bone frame is equivariant.
    #[test]
    fn turning_light_and_bones_together_changes_nothing(
        q in prop::array::uniform4(-1.0..1.0_f32)
            .prop_filter("has a direction", |q| q.iter().map(|x| x * x).sum::<f32>() > 0.1),
    ) {
        let q = Quat::from_array(q).normalize();
        let model = synthetic::model(Family::PcaLinear, Signal::Transfer, Frame::Bone, 1);
        let order = model.header().sh_order();
        let parameters = synthetic::numbers(51, PARAMETERS);
        let mut light = [0.0; 9];
        evaluate(order, Vec3::new(0.36, -0.48, 0.8), &mut light);
        let mut turned = [0.0; 9];
        Rotation::new(order, q).apply(&light, &mut turned);
        let bones: Vec<Quat> = rotations().iter().map(|bone| q * bone.normalize()).collect();
        let (mut a, mut b) = (vec![0.0; POINTS], vec![0.0; POINTS]);
        model.shade(&parameters, &light, &rotations(), &mut a).unwrap();
        model.shade(&parameters, &turned, &bones, &mut b).unwrap();
        for (a, b) in a.iter().zip(&b) {
            prop_assert!((a - b).abs() < 5e-5, "{} {}", a, b);
        }
    }
}

/// Proves that a pose within reach is taken as it is, one beyond it as the pose on the way to the
/// centre that lies at that distance, also where a light is folded; and that without any reach the
/// centre's values are all there is.
#[test]
fn far_poses_are_drawn_to_the_reach() {
    for model in synthetic::all() {
        if !model.has_distance() {
            continue;
        }
        let centre = model.header().training.centre.clone();
        let far: Vec<f32> =
            centre.iter().zip([3.0, -2.0, 4.0, 1.0, 2.5, -3.0]).map(|(c, x)| c + x).collect();
        let distance = model.distance(&far).unwrap().mahalanobis;
        let at = |model: &Model, pose: &[f32]| {
            let mut out = vec![0.0; model.shape().points * model.shape().width];
            model.evaluate(pose, None, &mut out).unwrap();
            out
        };
        let near = |a: &[f32], b: &[f32]| {
            a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-4 * (1.0 + b.abs()))
        };
        let wide = model.clone().with_reach(Some(2.0 * distance)).unwrap();
        assert_eq!(at(&wide, &far), at(&model, &far));
        let half = model.clone().with_reach(Some(0.5 * distance)).unwrap();
        let drawn: Vec<f32> = centre.iter().zip(&far).map(|(c, x)| c + 0.5 * (x - c)).collect();
        assert!(near(&at(&half, &far), &at(&model, &drawn)), "{}", model.kind());
        let none = model.clone().with_reach(Some(0.0)).unwrap();
        assert!(near(&at(&none, &far), &at(&model, &centre)), "{}", model.kind());
        assert_eq!(half.distance(&far).unwrap(), model.distance(&far).unwrap());
        let bytes = half.to_bytes(Precision::F32).unwrap();
        assert_eq!(at(&Model::from_bytes(&bytes).unwrap(), &far), at(&half, &far));
        let folds = model.header().frame != Frame::Tangent;
        if folds && model.header().signal == Signal::Transfer && model.header().channels == 1 {
            let light = synthetic::numbers(40, model.header().coefficients());
            let turns = [Quat::IDENTITY; 3];
            let shaded = |model: &Model, pose: &[f32]| {
                let mut out = vec![0.0; model.shape().points];
                model.fold(&light, &turns).unwrap().evaluate(pose, &mut out).unwrap();
                let mut turned = out.clone();
                model.shade(pose, &light, &turns, &mut turned).unwrap();
                assert!(near(&out, &turned));
                out
            };
            assert!(near(&shaded(&half, &far), &shaded(&model, &drawn)), "{}", model.kind());
        }
        assert!(model.with_reach(Some(-1.0)).is_err());
    }
}
