//! What `tradeoff` tries with less than the data set has.

use clap::Args;

use super::args::set;
use super::fit_args::FamilyArg;
use crate::pipeline::recipe::Recipe;
use crate::pipeline::{Efforts, forget_other_sizes};

#[derive(Debug, Args)]
#[command(next_help_heading = "What a bake's effort buys (lists with commas)")]
pub(crate) struct EffortFlags {
    /// Try one model with fewer rays per point as well; they are baked, and not kept.
    #[arg(long, value_name = "N,…", value_delimiter = ',')]
    rays: Vec<u32>,
    /// With fewer training poses, those that lie farthest apart.
    #[arg(long, value_name = "N,…", value_delimiter = ',')]
    poses: Vec<u32>,
    /// With fewer bands of spherical harmonics.
    #[arg(long, value_name = "N,…", value_delimiter = ',')]
    orders: Vec<u8>,
    /// The family of that one model [default: the data set's recipe].
    #[arg(long, value_enum)]
    family: Option<FamilyArg>,
}

impl EffortFlags {
    /// A flag that says which model less is tried with.
    pub(crate) fn family_flag(&self) -> Option<&'static str> {
        self.family.map(|_| "--family")
    }

    /// What is tried; the recipe becomes that of the model.
    pub(crate) fn edit(&self, recipe: &mut Recipe) -> Efforts {
        set(&mut recipe.fit.family, self.family);
        forget_other_sizes(&mut recipe.fit);
        let Self { rays, poses, orders, .. } = self;
        Efforts { rays: rays.clone(), poses: poses.clone(), orders: orders.clone() }
    }
}
