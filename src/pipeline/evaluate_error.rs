//! Why a model cannot be evaluated as asked.

use crate::model;

fn known_clips(known: &[String]) -> String {
    match known {
        [] => "it has none".to_owned(),
        known => format!("it has {}", known.join(", ")),
    }
}

/// Why a model cannot be evaluated as asked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EvaluateError {
    /// The model's own objection.
    #[error(transparent)]
    Model(#[from] model::Error),
    /// No such clip.
    #[error("the scene has no clip `{name}`; {}", known_clips(.known))]
    Clip {
        /// What was asked for.
        name: String,
        /// What there is.
        known: Vec<String>,
    },
    /// The scene is not the model's.
    #[error("the scene has no node `{0}`, which the model's rig has")]
    Node(String),
    /// The scene is not the model's.
    #[error("the scene has {found} vertices, but the model is of a mesh with {expected}")]
    Vertices {
        /// In the scene.
        found: usize,
        /// In the model.
        expected: usize,
    },
    /// The scene has as many vertices as the model's, and is another.
    #[error(
        "{found} has as many vertices as the mesh of the model, which was baked from {expected}, but in \
         other places, in another order or with other triangles: name that scene, or attach the model \
         to this one with `poselight rebind`"
    )]
    OtherMesh {
        /// The scene's file.
        found: String,
        /// The name of the file that the model was baked from.
        expected: String,
    },
    /// The model looks at the posed mesh.
    #[error(
        "the model looks at the posed mesh, which parameters alone do not give, and joints only to \
         a model fitted with `include_rest`: name a scene and its clip"
    )]
    NeedsScene,
    /// Positions of another mesh.
    #[error("{found} numbers are no positions of {vertices} vertices, three each")]
    Positions {
        /// Given.
        found: usize,
        /// Of the model's mesh.
        vertices: usize,
    },
    /// A position that is not finite.
    #[error("the position of vertex {0} is not finite")]
    PositionNotFinite(usize),
    /// Positions do not give parameters.
    #[error(
        "the model's {0} parameters come from joints or morph weights, which positions of vertices do \
         not give"
    )]
    NeedsJoints(usize),
    /// Coefficients in the frames of bones cannot meet a light.
    #[error("the model is in the frame of bones or tangents: a light needs poses, not parameters")]
    NeedsPose,
    /// Visibility has no shading.
    #[error("a model of `visibility` has no shading; `transfer` and `ao` fold a light")]
    NoShading,
    /// A reflectance on another signal.
    #[error("a reflectance meets a model of `visibility`; this one holds `{signal}`")]
    NeedsVisibility {
        /// What it holds.
        signal: &'static str,
    },
    /// A reflection operator of another order.
    #[error("the operator is of order {found}, the model of order {expected}")]
    Operator {
        /// Of the operator.
        found: u8,
        /// Of the model.
        expected: u8,
    },
    /// A grain on a model without tangents, and the model's frame.
    #[error(
        "the reflectance has a grain, which runs along tangents: a model fitted in the frame `tangent` \
         carries them, this one is in the frame `{0}`"
    )]
    NeedsTangents(&'static str),
    /// Reflection without a mesh to reflect.
    #[error(
        "reflection needs the posed mesh: name the scene, or fit the model with `include_rest`"
    )]
    NeedsMesh,
    /// A light of the wrong size.
    #[error("the light has {found} coefficients a colour, the model takes {expected}")]
    Light {
        /// Given.
        found: usize,
        /// n².
        expected: usize,
    },
    /// A light that is not finite.
    #[error("the light is not finite everywhere")]
    LightNotFinite,
    /// A vertex that the mesh does not have.
    #[error("vertex {vertex} is none of the model's {count}")]
    Vertex {
        /// Asked for.
        vertex: u32,
        /// How many there are.
        count: usize,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A scene without clips is said to have none, in a whole sentence.
    #[test]
    fn no_clips_are_a_sentence() {
        let told = |known| EvaluateError::Clip { name: "a".to_owned(), known }.to_string();
        assert_eq!(told(Vec::new()), "the scene has no clip `a`; it has none");
        assert_eq!(told(vec!["b".into(), "c".into()]), "the scene has no clip `a`; it has b, c");
    }
}
