//! Numbers as people read them.

/// Bytes in binary units.
pub(super) fn bytes(count: u64) -> String {
    const UNITS: [&str; 5] = ["B", "KiB", "MiB", "GiB", "TiB"];
    let mut value = count as f64;
    let mut unit = 0;
    while value >= 1024.0 && unit + 1 < UNITS.len() {
        value /= 1024.0;
        unit += 1;
    }
    if unit == 0 { format!("{count} B") } else { format!("{value:.1} {}", UNITS[unit]) }
}

/// More than this, a pebibyte, is a slip of the finger.
const MOST_BYTES: f64 = (1_u64 << 50) as f64;

/// Bytes as people write them: a number and a unit, of a thousand or (`KiB`) of 1024, whose parts round down.
pub(super) fn parse_bytes(text: &str) -> Result<u64, String> {
    const UNITS: [(&str, f64); 8] = [
        ("", 1.0),
        ("b", 1.0),
        ("kb", 1e3),
        ("mb", 1e6),
        ("gb", 1e9),
        ("kib", 1024.0),
        ("mib", 1_048_576.0),
        ("gib", 1_073_741_824.0),
    ];
    let text = text.trim();
    let end = text.find(|c: char| !(c.is_ascii_digit() || c == '.')).unwrap_or(text.len());
    let unit = text[end..].trim().to_ascii_lowercase();
    let unit = UNITS.iter().find(|(name, _)| *name == unit);
    let told =
        "it must be a whole number of bytes of at most 1024 TiB, such as 300000, 300kB or 1.5MiB";
    match (text[..end].parse::<f64>(), unit) {
        (Ok(number), Some((_, bytes))) => {
            let sound = (1.0..=MOST_BYTES).contains(&(number * bytes));
            // A byte has no parts.
            let whole = *bytes > 1.0 || number.fract() == 0.0;
            if sound && whole { Ok((number * bytes) as u64) } else { Err(told.to_owned()) }
        }
        _ => Err(told.to_owned()),
    }
}

/// Seconds as minutes and hours where they are long.
pub(super) fn seconds(value: f64) -> String {
    match value {
        v if v < 0.1 => format!("{:.1} ms", v * 1e3),
        v if v < 120.0 => format!("{v:.1} s"),
        v if v < 7200.0 => format!("{:.1} min", v / 60.0),
        v => format!("{:.1} h", v / 3600.0),
    }
}

/// A number of things by their name: 1 part, 2 parts.
pub(super) fn counted(count: usize, name: &str) -> String {
    format!("{count} {name}{}", if count == 1 { "" } else { "s" })
}

/// Whole numbers with thin groups: 12,345,678.
pub(super) fn count(value: u64) -> String {
    let digits = value.to_string();
    let mut out = String::with_capacity(digits.len() * 4 / 3);
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Units change where the next one reads better.
    #[test]
    fn units_read_well() {
        assert_eq!(bytes(1023), "1023 B");
        assert_eq!(bytes(1024), "1.0 KiB");
        assert_eq!(bytes(3 << 30), "3.0 GiB");
        assert_eq!(parse_bytes("300000"), Ok(300_000));
        assert_eq!(parse_bytes("300kB"), Ok(300_000));
        assert_eq!(parse_bytes(" 1.5 MiB"), Ok(3 << 19));
        assert_eq!((parse_bytes("1.5b").is_err(), parse_bytes("0.7 KiB")), (true, Ok(716)));
        let large = ["99999999999999999999", "2000000GiB"];
        for wrong in ["", "0", "kB", "-5", "3 apples", "1e5", "1.2.3MB", "1.5"].iter().chain(&large)
        {
            assert!(parse_bytes(wrong).expect_err(wrong).contains("300kB"));
        }
        assert_eq!(seconds(0.0123), "12.3 ms");
        assert_eq!(seconds(61.0), "61.0 s");
        assert_eq!(seconds(600.0), "10.0 min");
        assert_eq!(count(0), "0");
        assert_eq!(count(1_234_567), "1,234,567");
    }
}
