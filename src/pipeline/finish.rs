//! What light is reflected by: a reflectance, or an operator that was made of one before.

use std::sync::Arc;

use super::GLOSS_TERMS;
use crate::num::linalg::NoConvergence;
use crate::sh::Order;
use crate::shade::{
    Brdf, Material, Merl, MerlError, Reflectance, Reflector, ReflectorError, brdf_of_words, factor,
};

/// What a surface reflects by.
#[derive(Debug, Clone, PartialEq)]
pub enum Finish {
    /// A reflectance, of which operators of any order are made.
    Reflectance(Material),
    /// An operator, of one order and with terms of its own.
    Operator(Arc<Reflector>),
}

/// Why a finish is none, or not for what it is to shade.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FinishError {
    /// More terms than there are.
    #[error("an operator of order {order} has 1 to {most} terms, not {found}")]
    Terms {
        /// Bands.
        order: u8,
        /// Their square.
        most: usize,
        /// Asked for.
        found: usize,
    },
    /// An operator of another order.
    #[error("the operator is of order {found}, what it is to shade of order {expected}")]
    Order {
        /// Of the operator.
        found: u8,
        /// Of visibility and light.
        expected: u8,
    },
    /// An operator where rays are to be cast.
    #[error(
        "rays follow the reflectance itself, which the operator of `{name}` does not tell: give the \
         words or the MERL file that it was made of"
    )]
    Rays {
        /// What the operator says it was made of.
        name: String,
    },
    /// Neither kind of file.
    #[error(
        "it is neither a MERL file, which begins with the counts 90, 90, 180, nor an operator as \
         `poselight brdf` writes it ({0})"
    )]
    Neither(String),
    /// A MERL file that is damaged.
    #[error(transparent)]
    Merl(#[from] MerlError),
    /// An operator that is damaged.
    #[error(transparent)]
    Operator(ReflectorError),
    /// The reflectance could not be factored.
    #[error("the reflectance: {0}")]
    Factor(#[from] NoConvergence),
}

/// Whether an operator of an order can be asked for so many terms: 1 to n², and the default, which may
/// be more than a small order has.
#[must_use]
pub fn has_terms(order: Order, terms: usize) -> bool {
    (1..=order.coefficients()).contains(&terms) || terms == GLOSS_TERMS
}

impl Finish {
    /// Reads a MERL file, or an operator's.
    ///
    /// # Errors
    /// [`FinishError`] of bytes that are neither.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, FinishError> {
        if bytes.starts_with(&Merl::HEAD) {
            return Ok(Material::Measured(Arc::new(Merl::from_bytes(bytes)?)).into());
        }
        match Reflector::from_bytes(bytes) {
            Ok(operator) => Ok(Self::Operator(Arc::new(operator))),
            Err(ReflectorError::NotSafetensors { reason }) => Err(FinishError::Neither(reason)),
            Err(error) => Err(FinishError::Operator(error)),
        }
    }

    /// Whether it looks the same however a surface is turned about its normal.
    #[must_use]
    pub fn is_isotropic(&self) -> bool {
        match self {
            Self::Reflectance(material) => material.is_isotropic(),
            Self::Operator(operator) => operator.header().isotropic,
        }
    }

    /// What is to be said against a reflectance, in sentences.
    #[must_use]
    pub fn warnings(&self) -> Vec<String> {
        match self {
            Self::Reflectance(material) => material.warnings(),
            Self::Operator(_) => Vec::new(),
        }
    }

    /// The reflectance itself, which rays follow: of an operator, that which its name says in words.
    ///
    /// # Errors
    /// [`FinishError::Rays`] of an operator whose name is no words.
    pub fn reflectance(&self) -> Result<Material, FinishError> {
        match self {
            Self::Reflectance(material) => Ok(material.clone()),
            Self::Operator(operator) => {
                let name = &operator.header().name;
                match brdf_of_words(name) {
                    Some(Ok(brdf)) => Ok(brdf.into()),
                    _ => Err(FinishError::Rays { name: name.clone() }),
                }
            }
        }
    }

    /// The operator for visibility and light of an order; one that is given keeps its terms.
    ///
    /// # Errors
    /// [`FinishError::Terms`] of a number that no operator has, [`FinishError::Order`] of an operator of
    /// another order, [`FinishError::Factor`].
    pub fn operator(
        &self,
        name: &str,
        order: Order,
        terms: usize,
    ) -> Result<Reflector, FinishError> {
        let (expected, most) = (order.get(), order.coefficients());
        match self {
            Self::Reflectance(_) if !has_terms(order, terms) => {
                Err(FinishError::Terms { order: expected, most, found: terms })
            }
            Self::Reflectance(material) => {
                let factored = factor(material, order, material.nodes())?;
                let operators = factored.map(|colour| colour.operator(terms));
                Ok(Reflector::new(name, &operators, [0.0; 3]))
            }
            Self::Operator(operator) if operator.order() == order => Ok(Reflector::clone(operator)),
            Self::Operator(operator) => {
                Err(FinishError::Order { found: operator.order().get(), expected })
            }
        }
    }
}

impl From<Material> for Finish {
    fn from(material: Material) -> Self {
        Self::Reflectance(material)
    }
}

impl From<Brdf> for Finish {
    fn from(brdf: Brdf) -> Self {
        Material::from(brdf).into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Files of either kind are told apart by what they hold, an operator shades what is of its order,
    /// and rays follow it where its name is words.
    #[test]
    fn files_are_finishes() {
        let order = Order::new(3).expect("order");
        let words = Finish::from(Brdf::Ggx { normal_reflectance: [0.5; 3], alpha: [0.3, 0.6] });
        let of = |name: &str| {
            let made = words.operator(name, order, 5).expect("made");
            Finish::from_bytes(&made.to_bytes().expect("bytes")).expect("read")
        };
        let read = of("ggx:0.5,0.3,0.6");
        assert!(!read.is_isotropic() && read.warnings().is_empty());
        assert_eq!(read.reflectance().expect("words"), words.reflectance().expect("itself"));
        assert_eq!(read.operator("x", order, 8).expect("its order").header().terms, 5);
        let refused = |error: Option<FinishError>, word: &str| {
            let told = error.map(|error| error.to_string()).unwrap_or_default();
            assert!(told.contains(word), "{told}");
        };
        let other = Order::new(4).expect("order");
        refused(read.operator("x", other, 8).err(), "of order 3, what it is to shade of order 4");
        refused(of("gold.binary").reflectance().err(), "`gold.binary` does not tell");
        refused(Finish::from_bytes(b"no such thing").err(), "nor an operator");
        let short = [&Merl::HEAD[..], &[0; 20]].concat();
        refused(Finish::from_bytes(&short).err(), "this one has 32");
    }

    /// One rule for terms: up to n², and the default with any order.
    #[test]
    fn terms_have_one_rule() {
        let (two, four) = (Order::new(2).expect("order"), Order::new(4).expect("order"));
        let fits = |order, terms| has_terms(order, terms);
        assert!(fits(two, 4) && fits(two, 8) && fits(four, 16));
        assert!(!fits(two, 5) && !fits(four, 17) && !fits(four, 0));
        let lambert = Finish::from(Brdf::Lambert { albedo: [0.5; 3] });
        let told = lambert.operator("x", four, 17).expect_err("too many").to_string();
        assert!(told.contains("1 to 16 terms, not 17"), "{told}");
        assert_eq!(lambert.operator("x", two, 8).expect("the default").header().terms, 1);
    }
}
