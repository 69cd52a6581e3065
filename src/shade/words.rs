//! Lights and reflectances in a few words, for command lines, recipes and requests.

use super::{Brdf, Error, ShLight};
use crate::sh::Order;

/// The words for lights.
pub const LIGHT_WORDS: &str = "constant, directional:X,Y,Z, cone:X,Y,Z,DEGREES and \
     sphere:X,Y,Z,RADIUS, each with :R,G,B after it or white (radiance; of directional irradiance)";

/// The words for reflectances.
pub const BRDF_WORDS: &str = "lambert:ALBEDO, lambert:R,G,B, phong:DIFFUSE,SPECULAR,EXPONENT, \
     ggx:F0,ALPHA, ggx:F0,ALPHA,ALPHA and ashikhmin-shirley:DIFFUSE,SPECULAR,NU,NV";

/// Why words are no light or reflectance.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum WordsError {
    /// Too few or too many numbers, or none.
    #[error("wants {wanted} numbers between commas where it has `{found}`")]
    Numbers {
        /// How many there must be.
        wanted: usize,
        /// What there is.
        found: String,
    },
    /// More colons than parts.
    #[error("has too many parts")]
    TooManyParts,
    /// Something that is no number.
    #[error("has `{0}` where it wants a number")]
    NoNumber(String),
    /// Numbers that fit no form of a reflectance.
    #[error("has {0} numbers; it is one of {BRDF_WORDS}")]
    Count(usize),
    /// Numbers that no light or surface has.
    #[error(transparent)]
    Value(#[from] Error),
}

/// `constant`, `directional:X,Y,Z`, `cone:X,Y,Z,DEGREES` (half angle) or `sphere:X,Y,Z,RADIUS`, each
/// with `:R,G,B` after it or white; `None` where the word before the first colon is none of these.
#[must_use]
pub fn light_of_words(words: &str, order: Order) -> Option<Result<ShLight, WordsError>> {
    let name = words.split(':').next().unwrap_or_default();
    let wanted = match name {
        "constant" => 0,
        "directional" => 3,
        "cone" | "sphere" => 4,
        _ => return None,
    };
    Some(light(words, (name, wanted), order))
}

fn light(words: &str, (name, wanted): (&str, usize), order: Order) -> Result<ShLight, WordsError> {
    let mut parts = words.split(':').skip(1);
    let numbers = if wanted == 0 { Vec::new() } else { exactly(parts.next(), wanted)? };
    let colour = match parts.next() {
        None => [1.0; 3],
        given => <[f64; 3]>::try_from(exactly(given, 3)?).unwrap_or([1.0; 3]),
    };
    if parts.next().is_some() {
        return Err(WordsError::TooManyParts);
    }
    Ok(match (name, numbers.as_slice()) {
        ("directional", &[x, y, z]) => ShLight::directional(order, [x, y, z], colour)?,
        ("cone", &[x, y, z, degrees]) => {
            ShLight::cone(order, [x, y, z], degrees.to_radians(), colour)?
        }
        ("sphere", &[x, y, z, radius]) => ShLight::sphere(order, [x, y, z], radius, colour)?,
        _ => ShLight::constant(order, colour)?,
    })
}

/// Numbers between commas, as many as are wanted.
fn exactly(text: Option<&str>, wanted: usize) -> Result<Vec<f64>, WordsError> {
    let text = text.unwrap_or_default();
    match numbers(text) {
        Ok(numbers) if numbers.len() == wanted => Ok(numbers),
        _ => Err(WordsError::Numbers { wanted, found: text.to_owned() }),
    }
}

fn numbers(text: &str) -> Result<Vec<f64>, WordsError> {
    let number =
        |part: &str| part.trim().parse().map_err(|_| WordsError::NoNumber(part.to_owned()));
    text.split(',').map(number).collect()
}

/// The reflectance of [`BRDF_WORDS`]; `None` where the word before the first colon is none of these.
#[must_use]
pub fn brdf_of_words(words: &str) -> Option<Result<Brdf, WordsError>> {
    let (name, rest) = words.split_once(':')?;
    if !["lambert", "phong", "ggx", "ashikhmin-shirley"].contains(&name) {
        return None;
    }
    Some(numbers(rest).and_then(|numbers| brdf(name, &numbers)))
}

fn brdf(name: &str, numbers: &[f64]) -> Result<Brdf, WordsError> {
    let brdf = match (name, numbers) {
        ("lambert", &[albedo]) => Brdf::Lambert { albedo: [albedo; 3] },
        ("lambert", &[r, g, b]) => Brdf::Lambert { albedo: [r, g, b] },
        ("phong", &[diffuse, specular, exponent]) => {
            Brdf::Phong { diffuse: [diffuse; 3], specular: [specular; 3], exponent }
        }
        ("ggx", &[f0, alpha]) => Brdf::Ggx { normal_reflectance: [f0; 3], alpha: [alpha; 2] },
        ("ggx", &[f0, along, across]) => {
            Brdf::Ggx { normal_reflectance: [f0; 3], alpha: [along, across] }
        }
        ("ashikhmin-shirley", &[diffuse, specular, nu, nv]) => Brdf::AshikhminShirley {
            diffuse: [diffuse; 3],
            specular: [specular; 3],
            exponents: [nu, nv],
        },
        _ => return Err(WordsError::Count(numbers.len())),
    };
    Ok(brdf.checked()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn order() -> Order {
        Order::new(4).unwrap()
    }

    /// Each light is read with and without a colour; what is wrong is said with its text.
    #[test]
    fn words_are_lights() {
        let expected = [
            ("constant", ShLight::constant(order(), [1.0; 3])),
            ("constant:1,2,3", ShLight::constant(order(), [1.0, 2.0, 3.0])),
            ("directional:0, 1,0", ShLight::directional(order(), [0.0, 1.0, 0.0], [1.0; 3])),
            ("cone:1,0,0,90:1,0,0", {
                let half_angle = 90_f64.to_radians();
                ShLight::cone(order(), [1.0, 0.0, 0.0], half_angle, [1.0, 0.0, 0.0])
            }),
            ("sphere:0,3,0,1", ShLight::sphere(order(), [0.0, 3.0, 0.0], 1.0, [1.0; 3])),
        ];
        for (words, expected) in expected {
            let found = light_of_words(words, order()).unwrap().unwrap();
            assert_eq!(found, expected.unwrap(), "{words}");
        }
        for (words, told) in [
            ("cone:1,0,0", "wants 4 numbers"),
            ("cone:1,0,0,x", "`1,0,0,x`"),
            ("constant:1,2", "wants 3 numbers"),
            ("constant:1,2,3:4", "too many parts"),
            ("sphere:0,1,0,2", "radius 2 at distance 1"),
            ("directional", "wants 3 numbers"),
            ("constant:nan,0,0", "NaN"),
        ] {
            let error = light_of_words(words, order()).unwrap().unwrap_err().to_string();
            assert!(error.contains(told), "{words}: {error}");
        }
        assert!(light_of_words("sun:0,1,0", order()).is_none());
    }

    /// Every closed form is read; wrong counts and wrong numbers are told apart.
    #[test]
    fn words_are_reflectances() {
        for words in [
            "lambert:0.5",
            "lambert:0.1,0.2,0.3",
            "phong:0.4,0.4,12",
            "ggx:0.04,0.3",
            "ggx:0.9,0.2,0.5",
            "ashikhmin-shirley:0.3,0.2,10,100",
        ] {
            assert!(brdf_of_words(words).unwrap().is_ok(), "{words}");
        }
        for (words, told) in [
            ("lambert:0.5,0.5", "2 numbers"),
            ("lambert:x", "`x`"),
            ("lambert:1.5", "albedo"),
            ("ggx:0.5,0", "alpha"),
        ] {
            let error = brdf_of_words(words).unwrap().unwrap_err().to_string();
            assert!(error.contains(told), "{words}: {error}");
        }
        assert!(brdf_of_words("disney:1").is_none() && brdf_of_words("nickel.binary").is_none());
    }
}
