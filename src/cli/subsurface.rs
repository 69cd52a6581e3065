//! Flags that say what light does below the surface.

use clap::Args;

use crate::pipeline::recipe::subsurface::SubsurfaceRecipe;

#[derive(Debug, Args)]
#[command(next_help_heading = "Subsurface")]
pub(crate) struct SubsurfaceFlags {
    /// Diffuse transfer below the surface as in a measured material: skin, pale-skin, marble, milk,
    /// potato or apple.
    #[arg(long, value_name = "MATERIAL", conflicts_with_all = ["mean_free_path", "absorption", "refractive_index"])]
    subsurface: Option<String>,
    /// Or with these reduced mean free paths, metres: of all light, or of red, green and blue.
    #[arg(long, num_args = 1..=3, value_names = ["METRES", "G", "B"])]
    mean_free_path: Vec<f32>,
    /// Absorption per metre, of all light or of red, green and blue [default: 0].
    #[arg(long, num_args = 1..=3, value_names = ["PER_METRE", "G", "B"], requires = "mean_free_path")]
    absorption: Vec<f32>,
    /// Refractive index of the material [default: 1.3].
    #[arg(long, value_name = "N", requires = "mean_free_path")]
    refractive_index: Option<f32>,
    /// A mesh of the material (may be repeated) [default: all but receivers].
    #[arg(long, value_name = "MESH")]
    subsurface_mesh: Vec<String>,
}

/// One value for all colours, or one for each.
fn colours(flag: &str, values: &[f32]) -> anyhow::Result<Option<[f32; 3]>> {
    match values {
        [] => Ok(None),
        &[all] => Ok(Some([all; 3])),
        &[r, g, b] => Ok(Some([r, g, b])),
        _ => anyhow::bail!("--{flag} takes one number, or three for red, green and blue"),
    }
}

impl SubsurfaceFlags {
    /// Edits the recipe's subsurface.
    pub(crate) fn edit(&self, recipe: &mut Option<SubsurfaceRecipe>) -> anyhow::Result<()> {
        if let Some(material) = &self.subsurface {
            let material = Some(material.clone());
            *recipe = Some(SubsurfaceRecipe { material, ..SubsurfaceRecipe::default() });
        }
        if let Some(path) = colours("mean-free-path", &self.mean_free_path)? {
            *recipe = Some(SubsurfaceRecipe {
                material: None,
                mean_free_path_m: Some(path),
                absorption_per_m: colours("absorption", &self.absorption)?,
                refractive_index: self.refractive_index,
                ..SubsurfaceRecipe::default()
            });
        }
        match recipe {
            _ if self.subsurface_mesh.is_empty() => {}
            Some(below) => below.meshes.clone_from(&self.subsurface_mesh),
            None => anyhow::bail!(
                "--subsurface-mesh says where a material is: --subsurface or --mean-free-path says which"
            ),
        }
        Ok(())
    }
}
