//! The same light in the forms that other programs take.
//!
//! Directions stay in the axes of glTF (right-handed, +Y up). An engine whose axes differ turns
//! the light first; one that mirrors an axis changes the sign of the harmonics that are odd in it
//! (for z, those of odd l + m).

use std::f64::consts::PI;

use super::ShLight;
use crate::sh::{Order, zonal};

/// Bands that three.js and Filament keep: nine coefficients.
pub const THREE_BANDS: u8 = 3;

/// Bands that D3DX keeps at most: 36 coefficients.
pub const D3DX_BANDS: u8 = 6;

/// What `LightProbe.sh` of three.js takes: nine colours of radiance in our own basis, which is
/// also theirs (`SphericalHarmonics3`); the clamped cosine is applied by three.js itself.
#[must_use]
pub fn three_js(light: &ShLight) -> [[f64; 3]; 9] {
    std::array::from_fn(|i| light.coefficient(i))
}

/// What Filament's `IndirectLight::Builder::irradiance(3, sh)` takes: radiance reflected by a white
/// Lambertian surface, times the constants of the polynomials
/// 1, y, z, x, xy, yz, 3z² − 1, xz, x² − y², so that a shader adds plain products. The first is
/// the environment's mean radiance.
#[must_use]
pub fn filament(light: &ShLight) -> [[f64; 3]; 9] {
    let order = Order::new(THREE_BANDS).unwrap_or(light.order());
    let cosine = zonal::clamped_cosine(order);
    let polynomial = [
        (0.25 / PI).sqrt(),
        (0.75 / PI).sqrt(),
        (0.75 / PI).sqrt(),
        (0.75 / PI).sqrt(),
        (3.75 / PI).sqrt(),
        (3.75 / PI).sqrt(),
        (0.3125 / PI).sqrt(),
        (3.75 / PI).sqrt(),
        (0.9375 / PI).sqrt(),
    ];
    std::array::from_fn(|i| {
        let l = i.isqrt();
        let convolved = (4.0 * PI / (2 * l + 1) as f64).sqrt() * cosine[l] / PI;
        light.coefficient(i).map(|value| convolved * polynomial[i] * value)
    })
}

/// What functions of D3DX and DirectXSH take, an array for each of red, green and blue: radiance in
/// the basis with the Condon–Shortley sign, (−1)^m times ours, up to [`D3DX_BANDS`] bands.
#[must_use]
pub fn d3dx(light: &ShLight) -> [Vec<f64>; 3] {
    let bands = light.order().bands().min(usize::from(D3DX_BANDS));
    let sign = |i: usize| {
        let l = i.isqrt();
        if i.abs_diff(l * (l + 1)).is_multiple_of(2) { 1.0 } else { -1.0 }
    };
    light.colours().each_ref().map(|colour| {
        colour[..bands * bands].iter().enumerate().map(|(i, l)| sign(i) * l).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A light that tells axes, signs and colours apart: a lamp from one side over a dim sky.
    fn known() -> (ShLight, impl Fn([f64; 3]) -> [f64; 3]) {
        let order = Order::new(3).unwrap();
        let towards = [0.36, 0.8, -0.48];
        let mut light = ShLight::directional(order, towards, [1.0, 0.5, 0.25]).unwrap();
        light.add(&ShLight::constant(order, [0.1, 0.2, 0.3]).unwrap());
        // Irradiance of three bands in closed form: A_l P_l(cos θ)(2l+1)/4π, A = π, 2π/3, π/4.
        let irradiance = move |n: [f64; 3]| {
            let t: f64 = n.iter().zip(towards).map(|(n, d)| n * d).sum();
            let lamp = 0.25 + 0.5 * t + 5.0 / 16.0 * (1.5 * t * t - 0.5);
            let sky = [0.1, 0.2, 0.3];
            std::array::from_fn(|c| [1.0, 0.5, 0.25][c] * lamp + PI * sky[c])
        };
        (light, irradiance)
    }

    const NORMALS: [[f64; 3]; 5] = [
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
        [0.6, -0.64, 0.48],
        [-0.48, 0.6, -0.64],
    ];

    /// three.js turns the coefficients to irradiance with the constants of its
    /// `SphericalHarmonics3.getIrradianceAt`; the result is the known light's.
    #[test]
    fn three_js_sees_the_known_light() {
        let (light, irradiance) = known();
        let sh = three_js(&light);
        for [x, y, z] in NORMALS {
            let basis = [
                0.886227,
                2.0 * 0.511664 * y,
                2.0 * 0.511664 * z,
                2.0 * 0.511664 * x,
                2.0 * 0.429043 * x * y,
                2.0 * 0.429043 * y * z,
                0.743125 * z * z - 0.247708,
                2.0 * 0.429043 * x * z,
                0.429043 * (x * x - y * y),
            ];
            for c in 0..3 {
                let found: f64 = basis.iter().zip(&sh).map(|(b, sh)| b * sh[c]).sum();
                assert!((found - irradiance([x, y, z])[c]).abs() < 3e-6);
            }
        }
    }

    /// Filament's shader adds plain polynomials; the result is irradiance over π. Its first number
    /// is the mean radiance.
    #[test]
    fn filament_sees_the_known_light() {
        let (light, irradiance) = known();
        let sh = filament(&light);
        for [x, y, z] in NORMALS {
            let basis = [1.0, y, z, x, y * x, y * z, 3.0 * z * z - 1.0, z * x, x * x - y * y];
            for c in 0..3 {
                let found: f64 = basis.iter().zip(&sh).map(|(b, sh)| b * sh[c]).sum();
                assert!((found - irradiance([x, y, z])[c] / PI).abs() < 1e-12);
            }
        }
        let even = ShLight::constant(Order::new(1).unwrap(), [2.0, 3.0, 4.0]).unwrap();
        for (found, expected) in filament(&even)[0].iter().zip([2.0, 3.0, 4.0]) {
            assert!((found - expected).abs() < 1e-12);
        }
        assert_eq!(filament(&even)[5], [0.0; 3]);
    }

    /// The basis of `D3DXSHEvalDirection`, written out, gives the known light's radiance; more than
    /// six bands are cut, fewer stay.
    #[test]
    fn d3dx_sees_the_known_light() {
        let (light, _) = known();
        let sh = d3dx(&light);
        for [x, y, z] in NORMALS {
            let basis = [
                0.282094791,
                -0.488602511 * y,
                0.488602511 * z,
                -0.488602511 * x,
                1.092548430 * x * y,
                -1.092548430 * y * z,
                0.315391565 * (3.0 * z * z - 1.0),
                -1.092548430 * x * z,
                0.546274215 * (x * x - y * y),
            ];
            for (c, expected) in light.radiance([x, y, z]).iter().enumerate() {
                let found: f64 = basis.iter().zip(&sh[c]).map(|(b, sh)| b * sh).sum();
                assert!((found - expected).abs() < 1e-8, "{found} {expected}");
            }
        }
        let sun = |bands| {
            let order = Order::new(bands).unwrap();
            ShLight::directional(order, [0.6, 0.0, 0.8], [1.0; 3]).unwrap()
        };
        assert_eq!(d3dx(&sun(8))[0].len(), 36);
        assert_eq!(d3dx(&sun(2))[2].len(), 4);
    }
}
