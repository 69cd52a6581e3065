//! Pictures of the model beside its truth, within the page as data.

use super::text::{escape, number};

/// One picture: model, truth and difference of a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct ReportStill {
    /// What the frame stands for, such as `Worst`.
    pub name: String,
    /// The clip; empty for a static pose.
    pub clip: String,
    /// Seconds since the clip's start.
    pub time_s: f32,
    /// Mean |error| of ambient occlusion over the mesh.
    pub error: f64,
    /// The picture's file.
    pub png: Vec<u8>,
}

/// A figure for each.
pub(super) fn figures(stills: &[ReportStill]) -> String {
    stills.iter().map(figure).collect()
}

fn figure(still: &ReportStill) -> String {
    let frame = match still.clip.as_str() {
        "" => "the static pose".to_owned(),
        clip => format!("{} at {:.2}\u{a0}s", escape(clip), still.time_s),
    };
    let words = format!(
        "{}: {frame}, mean |error| {} of ambient occlusion",
        escape(&still.name),
        number(still.error, 3)
    );
    format!(
        "<figure class=\"still\"><img alt=\"Model, truth and their difference\" \
         src=\"data:image/png;base64,{}\"/><figcaption>{words}</figcaption></figure>",
        base64(&still.png)
    )
}

/// RFC 4648, with padding.
fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for block in bytes.chunks(3) {
        let [a, b, c] = [0, 1, 2].map(|i| u32::from(block.get(i).copied().unwrap_or(0)));
        let bits = a << 16 | b << 8 | c;
        for i in 0..4 {
            let letter = LETTERS[(bits >> (18 - 6 * i) & 63) as usize];
            out.push(if i <= block.len() { char::from(letter) } else { '=' });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The test vectors of RFC 4648, and every byte.
    #[test]
    fn base64_is_the_standard() {
        for (text, expected) in
            [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foobar", "Zm9vYmFy")]
        {
            assert_eq!(base64(text.as_bytes()), expected);
        }
        assert_eq!(base64(&[251, 255, 190]), "+/++");
    }

    /// What comes from the scene is escaped.
    #[test]
    fn names_are_escaped() {
        let png = vec![1, 2, 3];
        let still =
            ReportStill { name: "Worst".into(), clip: "<b>".into(), time_s: 0.5, error: 0.1, png };
        let figure = figures(&[still]);
        assert!(
            figure.contains("&lt;b&gt; at 0.50") && figure.contains("base64,AQID\""),
            "{figure}"
        );
    }
}
