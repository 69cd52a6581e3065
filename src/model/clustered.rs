//! Family `clustered` (RPO09 §5): for every cluster of points an own small map from the reduced
//! pose to the reduced outputs of the cluster, linear, quadratic, or with tanh neurons.

use super::header::{check_finite, check_index, field, limits, within};
use super::{Error, Family, Header, Shape};
use crate::num::cpu::Isa;
use crate::num::kernels::{Layout, multiply};
use crate::num::panels::Panels;

/// The features of a cluster before its last layer; X has d dimensions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// X itself.
    Linear,
    /// X and all products X_i X_j, i ≤ j.
    Quadratic,
    /// tanh(d_n · X + d0_n), RPO09 eq. 12.
    Tanh,
}

impl Form {
    /// The family that has these features.
    #[must_use]
    pub const fn family(self) -> Family {
        match self {
            Self::Linear => Family::ClusteredLinear,
            Self::Quadratic => Family::ClusteredQuadratic,
            Self::Tanh => Family::ClusteredTanh,
        }
    }

    /// The features of a family, where it is clustered.
    pub(super) const fn of(family: Family) -> Option<Self> {
        match family {
            Family::ClusteredLinear => Some(Self::Linear),
            Family::ClusteredQuadratic => Some(Self::Quadratic),
            Family::ClusteredTanh => Some(Self::Tanh),
            _ => None,
        }
    }

    /// The features of the reduced pose; `hidden` is `[neuron, d + 1]`.
    #[must_use]
    pub fn features(self, reduced: &[f32], hidden: &[f32]) -> Vec<f32> {
        let mut features = match self {
            Self::Linear | Self::Quadratic => reduced.to_vec(),
            Self::Tanh => Vec::new(),
        };
        match self {
            Self::Linear => {}
            Self::Quadratic => {
                for (i, a) in reduced.iter().enumerate() {
                    features.extend(reduced[i..].iter().map(|b| a * b));
                }
            }
            Self::Tanh => {
                for row in hidden.chunks_exact(reduced.len() + 1) {
                    let sum: f32 = row.iter().zip(reduced).map(|(d, x)| d * x).sum();
                    features.push((sum + row[reduced.len()]).tanh());
                }
            }
        }
        features
    }

    /// How many features d dimensions and so many neurons have.
    pub(super) fn count(self, inputs: usize, neurons: usize) -> usize {
        match self {
            Self::Linear => inputs,
            Self::Quadratic => inputs + inputs * (inputs + 1) / 2,
            Self::Tanh => neurons,
        }
    }
}

/// y\[v\] = basis_c\[v\] · (z, 1) for the points v of cluster c, z = weights_c · (φ_c(X), 1) and
/// X = projectionᵀ(x − `training.centre`).
#[derive(Debug, Clone, PartialEq)]
pub struct Clustered {
    /// The features.
    pub form: Form,
    /// `[parameter, d]`.
    pub projection: Vec<f32>,
    /// `[point]`.
    pub cluster_of_point: Vec<u32>,
    /// In the order of their numbers.
    pub clusters: Vec<Cluster>,
}

/// One cluster of points.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Cluster {
    /// k, reduced outputs; 0 where nothing varies.
    pub outputs: usize,
    /// `[point of the cluster, width, k + 1]`, the mean last.
    pub basis: Vec<f32>,
    /// `[k, features + 1]`, the bias last.
    pub weights: Vec<f32>,
    /// `[neuron, d + 1]`, the bias last; empty unless the form is tanh.
    pub hidden: Vec<f32>,
}

/// The sizes that shape a cluster's tensors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Sizes {
    /// Points × width.
    pub(super) rows: usize,
    /// k.
    pub(super) outputs: usize,
    /// Features + 1.
    pub(super) features: usize,
    /// 0 unless the form is tanh.
    pub(super) neurons: usize,
}

impl Clustered {
    pub(super) fn inputs(&self, parameters: usize) -> usize {
        self.projection.len() / parameters.max(1)
    }

    pub(super) fn sizes(&self, parameters: usize) -> Vec<Sizes> {
        let inputs = self.inputs(parameters);
        let size = |cluster: &Cluster| {
            let neurons = cluster.hidden.len() / (inputs + 1);
            let outputs = cluster.outputs;
            let rows = cluster.basis.len() / (outputs + 1);
            Sizes { rows, outputs, features: self.form.count(inputs, neurons) + 1, neurons }
        };
        self.clusters.iter().map(size).collect()
    }

    pub(super) fn check(&self, header: &Header) -> Result<Shape, Error> {
        let points = header.mesh.points as usize;
        let (width, parameters) = (header.width(), header.parameters());
        let inputs = self.inputs(parameters);
        within("input dimensions", inputs as u64, parameters as u64)?;
        within("clusters", self.clusters.len() as u64, limits::CLUSTERS)?;
        let length = |what: String, found: usize, expected: usize| match found == expected {
            true => Ok(()),
            false => Err(Error::Length { what, found, expected }),
        };
        length("encoder.projection".to_owned(), self.projection.len(), inputs * parameters)?;
        check_finite("encoder.projection", &self.projection)?;
        length("map.cluster_of_point".to_owned(), self.cluster_of_point.len(), points)?;
        let mut counts = vec![0_usize; self.clusters.len()];
        for &cluster in &self.cluster_of_point {
            check_index("a cluster of map.cluster_of_point", cluster, counts.len())?;
            counts[cluster as usize] += 1;
        }
        for (i, ((cluster, sizes), count)) in
            self.clusters.iter().zip(self.sizes(parameters)).zip(counts).enumerate()
        {
            within("output dimensions", sizes.outputs as u64, limits::OUTPUTS)?;
            within("neurons", sizes.neurons as u64, limits::OUTPUTS)?;
            let name = |what: &str| format!("cluster.{i}.{what}");
            let basis = count * width * (sizes.outputs + 1);
            length(name("basis"), cluster.basis.len(), basis)?;
            length(name("weights"), cluster.weights.len(), sizes.outputs * sizes.features)?;
            length(name("hidden"), cluster.hidden.len(), sizes.neurons * (inputs + 1))?;
            if self.form != Form::Tanh && sizes.neurons > 0 {
                return Err(field(name("hidden"), "only tanh has neurons"));
            }
            check_finite(&name("basis"), &cluster.basis)?;
            check_finite(&name("weights"), &cluster.weights)?;
            check_finite(&name("hidden"), &cluster.hidden)?;
        }
        Ok(Shape { points, width, parameters, inputs, outputs: 0 })
    }
}

/// In the layout that evaluates.
#[derive(Debug, Clone)]
pub(super) struct Core {
    /// Without the clusters' bases.
    parts: Clustered,
    inputs: usize,
    width: usize,
    /// Of each cluster: its points, and rows `[point, width]`, inner k + 1.
    bases: Vec<(Vec<u32>, Panels)>,
}

impl Core {
    pub(super) fn new(mut parts: Clustered, shape: Shape) -> Self {
        let mut members = vec![Vec::new(); parts.clusters.len()];
        for (point, &cluster) in (0..).zip(&parts.cluster_of_point) {
            members[cluster as usize].push(point);
        }
        let bases = parts.clusters.iter_mut().zip(members).map(|(cluster, points)| {
            let basis = std::mem::take(&mut cluster.basis);
            let inner = cluster.outputs + 1;
            let panels = Panels::new(basis.len() / inner, inner, |row, k| basis[row * inner + k]);
            (points, panels)
        });
        let bases = bases.collect();
        Self { inputs: shape.inputs, width: shape.width, bases, parts }
    }

    /// As [`Core::new`] took it.
    pub(super) fn parts(&self) -> Clustered {
        let mut parts = self.parts.clone();
        for (cluster, (_, panels)) in parts.clusters.iter_mut().zip(&self.bases) {
            let rows = 0..panels.rows();
            cluster.basis =
                rows.flat_map(|row| (0..panels.inner()).map(move |k| panels.at(row, k))).collect();
        }
        parts
    }

    /// `[point, width]` of all points.
    pub(super) fn evaluate(&self, isa: Isa, centre: &[f32], parameters: &[f32], out: &mut [f32]) {
        let reduced = self.reduced(centre, parameters);
        let width = self.width;
        let mut rows = Vec::new();
        for (cluster, (points, panels)) in self.parts.clusters.iter().zip(&self.bases) {
            let mut features = match cluster.outputs {
                0 => Vec::new(),
                _ => self.parts.form.features(&reduced, &cluster.hidden),
            };
            features.push(1.0);
            let sum = |row: &[f32]| row.iter().zip(&features).map(|(w, x)| w * x).sum::<f32>();
            let mut z: Vec<f32> = cluster.weights.chunks_exact(features.len()).map(sum).collect();
            z.truncate(cluster.outputs);
            z.push(1.0);
            rows.resize(panels.rows(), 0.0);
            multiply(isa, panels, &z, 1, Layout::Rows, &mut rows);
            for (row, &point) in rows.chunks_exact(width).zip(points) {
                out[point as usize * width..][..width].copy_from_slice(row);
            }
        }
    }

    fn reduced(&self, centre: &[f32], parameters: &[f32]) -> Vec<f32> {
        let mut sums = vec![0.0_f64; self.inputs];
        for (i, (&x, &c)) in parameters.iter().zip(centre).enumerate() {
            let row = &self.parts.projection[i * self.inputs..][..self.inputs];
            let offset = f64::from(x) - f64::from(c);
            sums.iter_mut().zip(row).for_each(|(sum, &p)| *sum += f64::from(p) * offset);
        }
        sums.into_iter().map(|x| x as f32).collect()
    }

    /// Contracts every vector over the width with a light; see [`super::multilinear::Core::fold`].
    pub(super) fn fold(&self, colours: usize, dot: &super::fold::Dot<'_>) -> Self {
        let fold = |(points, panels): &(Vec<u32>, Panels)| {
            let folded = Panels::new(points.len() * colours, panels.inner(), |at, k| {
                let (i, colour) = (at / colours, at % colours);
                dot(points[i] as usize, colour, &|c| panels.at(i * self.width + c, k))
            });
            (points.clone(), folded)
        };
        let bases = self.bases.iter().map(fold).collect();
        Self { parts: self.parts.clone(), inputs: self.inputs, width: colours, bases }
    }

    /// Multiply-adds of one evaluation, the encoder included.
    pub(super) fn multiply_adds(&self, parameters: usize) -> u64 {
        let clusters = self.parts.clusters.iter().zip(&self.bases);
        let each = clusters.map(|(cluster, (_, panels))| {
            cluster.weights.len() + cluster.hidden.len() + panels.rows() * (panels.inner() - 1)
        });
        (each.sum::<usize>() + parameters * self.inputs) as u64
    }
}
