//! What the pictures of a report are lit by.

use clap::Args;

use crate::pipeline::recipe::Recipe;

#[derive(Debug, Args)]
#[command(next_help_heading = "Pictures")]
pub(crate) struct PictureFlags {
    /// Light the report's pictures of `transfer` or `visibility`: a map (.hdr, .exr), or `constant`,
    /// `directional:X,Y,Z`, `cone:X,Y,Z,DEGREES` or `sphere:X,Y,Z,RADIUS`, each with `:R,G,B` after it or
    /// white [default: ambient occlusion].
    #[arg(long, value_name = "LIGHT")]
    light: Option<String>,
    /// Degrees to turn the light by about +Y, counter-clockwise seen from above.
    #[arg(long, value_name = "DEGREES", allow_negative_numbers = true)]
    turn: Option<f64>,
    /// Shade the pictures of `visibility` by an isotropic reflectance in closed form, as `poselight brdf`
    /// reads it [default: white].
    #[arg(long, value_name = "BRDF")]
    brdf: Option<String>,
}

impl PictureFlags {
    /// Edits the recipe's light.
    pub(crate) fn edit(&self, recipe: &mut Recipe) {
        if self.light.is_none() && self.turn.is_none() && self.brdf.is_none() {
            return;
        }
        let light = recipe.light.get_or_insert_default();
        if let Some(source) = &self.light {
            light.source.clone_from(source);
            light.sha256 = None;
        }
        light.turn_degrees = self.turn.unwrap_or(light.turn_degrees);
        light.brdf = self.brdf.clone().or(light.brdf.take());
    }
}
