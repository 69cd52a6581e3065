//! Numbers and names as text of a page.

/// Escapes text for element content and quoted attributes, and drops what has no place in a page:
/// control characters, and those that turn the direction of text around.
pub(super) fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            '\n' | '\t' => out.push(c),
            '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' | '\u{fffe}' | '\u{ffff}' => {}
            c if c.is_control() => {}
            c => out.push(c),
        }
    }
    out
}

/// A number to so many significant digits: plain between 10⁻⁴ and 10⁶, else with a power of ten.
pub(super) fn number(x: f64, digits: usize) -> String {
    if x == 0.0 {
        return "0".to_owned();
    }
    let scientific = format!("{:.*e}", digits - 1, x);
    let (mantissa, exponent) = scientific.split_once('e').unwrap_or((&scientific, "0"));
    let exponent: i32 = exponent.parse().unwrap_or(0);
    if (-4..6).contains(&exponent) {
        let decimals = (digits as i32 - 1 - exponent).max(0) as usize;
        let rounded = format!("{x:.decimals$}");
        let (whole, fraction) = rounded.split_once('.').unwrap_or((&rounded, ""));
        let grouped = if whole.len() > 4 { group(whole) } else { whole.to_owned() };
        return sign(&if fraction.is_empty() { grouped } else { format!("{grouped}.{fraction}") });
    }
    sign(&format!("{mantissa}\u{a0}×\u{a0}10{}", superscript(exponent)))
}

/// The true minus sign, as wide as the digits.
fn sign(number: &str) -> String {
    number.replacen('-', "−", 1)
}

/// A number as an exponent is written.
pub(super) fn superscript(exponent: i32) -> String {
    const DIGITS: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    let mut out = String::new();
    for c in exponent.to_string().chars() {
        out.push(c.to_digit(10).map_or('⁻', |d| DIGITS[d as usize]));
    }
    out
}

/// Digits in groups of three.
fn group(digits: &str) -> String {
    let (sign, digits) = digits.strip_prefix('-').map_or(("", digits), |rest| ("-", rest));
    let mut out = sign.to_owned();
    for (i, c) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(',');
        }
        out.push(c);
    }
    out
}

/// A count, grouped.
pub(super) fn count(n: u64) -> String {
    group(&n.to_string())
}

/// A large count in words: 3.91 million.
pub(super) fn many(n: u64) -> String {
    let x = n as f64;
    match n {
        0..1_000_000 => count(n),
        1_000_000..1_000_000_000 => format!("{}\u{a0}million", number(x / 1e6, 3)),
        1_000_000_000..1_000_000_000_000 => format!("{}\u{a0}billion", number(x / 1e9, 3)),
        _ => number(x, 3),
    }
}

/// Bytes in decimal units, value and unit.
pub(super) fn bytes(n: u64) -> (String, &'static str) {
    let x = n as f64;
    match n {
        0..1000 => (n.to_string(), "B"),
        1000..1_000_000 => (number(x / 1e3, 3), "kB"),
        1_000_000..1_000_000_000 => (number(x / 1e6, 3), "MB"),
        _ => (number(x / 1e9, 3), "GB"),
    }
}

/// Bytes as one string.
pub(super) fn size(n: u64) -> String {
    let (value, unit) = bytes(n);
    format!("{value}\u{a0}{unit}")
}

/// A time, value and unit.
pub(super) fn duration(seconds: f64) -> (String, &'static str) {
    match seconds {
        s if s < 1e-3 => (number(s * 1e6, 3), "µs"),
        s if s < 1.0 => (number(s * 1e3, 3), "ms"),
        s if s < 300.0 => (number(s, 3), "s"),
        s if s < 3.0 * 3600.0 => (number(s / 60.0, 3), "min"),
        s => (number(s / 3600.0, 3), "h"),
    }
}

/// A time as one string.
pub(super) fn time(seconds: f64) -> String {
    let (value, unit) = duration(seconds);
    format!("{value}\u{a0}{unit}")
}

/// A fraction as per cent.
pub(super) fn percent(fraction: f64) -> String {
    format!("{}\u{a0}%", number(fraction * 100.0, 3))
}

/// A word in the plural unless of one.
pub(super) fn plural(n: usize, word: &str) -> String {
    let s = if n == 1 { "" } else { "s" };
    format!("{}\u{a0}{word}{s}", count(n as u64))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Names from a hostile file cannot leave their place in the page.
    #[test]
    fn escaping() {
        assert_eq!(escape("<script>alert('x')</script>"), {
            "&lt;script&gt;alert(&#39;x&#39;)&lt;/script&gt;"
        });
        assert_eq!(escape("a\u{0}b\u{202e}c\"&\u{7f}"), "abc&quot;&amp;");
        assert_eq!(escape("Ünïcode 人"), "Ünïcode 人");
    }

    /// Significant digits, grouping, powers and units, by example.
    #[test]
    fn numbers() {
        assert_eq!(number(0.012_345, 3), "0.0123");
        assert_eq!(number(14_444.0, 5), "14,444");
        assert_eq!(number(-0.5, 2), "−0.50");
        assert_eq!(number(3.25e-5, 3), "3.25\u{a0}×\u{a0}10⁻⁵");
        assert_eq!(number(9.999, 2), "10");
        assert_eq!(number(0.0, 3), "0");
        assert_eq!(number(1234.0, 3), "1234");
        assert_eq!(many(3_910_000), "3.91\u{a0}million");
        assert_eq!(size(1_306_512), "1.31\u{a0}MB");
        assert_eq!(time(1.4e-4), "140\u{a0}µs");
        assert_eq!(time(73.0), "73.0\u{a0}s");
        assert_eq!(percent(0.629), "62.9\u{a0}%");
        assert_eq!(plural(1, "pose"), "1\u{a0}pose");
        assert_eq!(count(1_000_000), "1,000,000");
    }
}
