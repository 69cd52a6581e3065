//! `poselight light`: a light as coefficients, in our convention and in those of engines.

use anyhow::ensure;
use serde_json::{Value, json};

use crate::cli::light_args::{LightArgs, WindowArg};
use crate::cli::light_source::{LightSource, read_light};
use crate::cli::{Answer, files};
use crate::sh::Order;
use crate::shade::{Lobe, ShLight, Window, ZonalLight, d3dx, filament, three_js};

pub(in crate::cli) fn light(args: &LightArgs) -> anyhow::Result<Answer> {
    let order = Order::new(args.order)?;
    let LightSource { mut light, map, notices } = read_light(&args.source, order, args.turn)?;
    for notice in &notices {
        tracing::warn!("{notice}");
    }
    let window = window(args)?;
    if let Some(window) = window {
        light = light.windowed(window);
    }
    if let Some(path) = &args.output {
        let values: Vec<f32> = (0..order.coefficients())
            .flat_map(|i| light.coefficient(i).map(|value| value as f32))
            .collect();
        ensure!(values.iter().all(|v| v.is_finite()), "the light is too bright for an f32 array");
        files::write_npy(path, &[order.coefficients(), 3], &values)?;
    }
    let json = json!({
        "source": args.source,
        "turn_degrees": args.turn,
        "order": order.get(),
        "window": window.map(describe),
        "map": map,
        "notices": notices,
        "output": args.output,
        "poselight": {
            "convention": "radiance; real, orthonormal, no Condon-Shortley sign, index l(l+1)+m, \
                           axes of glTF (+Y up, m = 0 about +Z)",
            "coefficients": coefficients(&light),
        },
        "three_js": {
            "convention": "LightProbe.sh: nine colours of radiance, the cosine left to three.js",
            "coefficients": three_js(&light),
        },
        "filament": {
            "convention": "IndirectLight::Builder::irradiance(3, sh): irradiance over pi, times \
                           the polynomials' constants",
            "coefficients": filament(&light),
        },
        "d3dx": d3dx_json(&light),
        "lobes": args.lobes.map(|count| lobes(&light, usize::from(count))),
    });
    Ok(Answer::new(serde_json::to_string_pretty(&json)?, json))
}

/// The light as lobes: z_l y_lm(axis) of each, the numbers by band, red, green and blue.
fn lobes(light: &ShLight, count: usize) -> Value {
    let fit = ZonalLight::fit(light, count);
    let bands = light.order().bands();
    let lobe = |lobe: &Lobe| {
        let colours = lobe.bands.each_ref().map(|colour| colour[..bands].to_vec());
        json!({ "axis": lobe.axis, "bands": colours })
    };
    json!({
        "convention": "coefficient l,m of a colour is the sum over lobes of bands[colour][l] * y_lm(axis)",
        "lobes": fit.lobes().iter().map(lobe).collect::<Vec<_>>(),
        "residual_energy": fit.residuals(),
    })
}

fn coefficients(light: &ShLight) -> Vec<[f64; 3]> {
    (0..light.order().coefficients()).map(|i| light.coefficient(i)).collect()
}

fn d3dx_json(light: &ShLight) -> Value {
    let [red, green, blue] = d3dx(light);
    json!({
        "convention": "radiance in the basis of D3DXSHEvalDirection, with the Condon-Shortley \
                       sign; at most six bands",
        "order": red.len().isqrt(),
        "red": red,
        "green": green,
        "blue": blue,
    })
}

fn window(args: &LightArgs) -> anyhow::Result<Option<Window>> {
    let Some(kind) = args.window else { return Ok(None) };
    let width = args.window_size.unwrap_or(f64::from(args.order));
    let window = match kind {
        WindowArg::Hann => Window::Hann { width },
        WindowArg::Lanczos => Window::Lanczos { width },
        WindowArg::Laplacian => Window::Laplacian { strength: args.window_size.unwrap_or(0.01) },
    };
    Ok(Some(window.checked()?))
}

fn describe(window: Window) -> Value {
    match window {
        Window::Hann { width } => json!({ "kind": "hann", "width": width }),
        Window::Lanczos { width } => json!({ "kind": "lanczos", "width": width }),
        Window::Laplacian { strength } => json!({ "kind": "laplacian", "strength": strength }),
    }
}
