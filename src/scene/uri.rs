//! URIs (RFC 3986) as far as glTF needs them: percent escapes and `data:`.

/// Whether the URI carries its data itself.
pub(super) fn is_data(uri: &str) -> bool {
    uri.get(..5).is_some_and(|scheme| scheme.eq_ignore_ascii_case("data:"))
}

/// The content of a `data:` URI (RFC 2397), base64 or percent-encoded.
///
/// Allocates at most the length of the text.
pub(super) fn decode_data(uri: &str) -> Result<Vec<u8>, String> {
    let (head, payload) = uri.split_once(',').ok_or("the data: URI has no comma")?;
    if head.ends_with(";base64") {
        decode_base64(payload.as_bytes())
    } else {
        decode_percent(payload)
    }
}

/// Replaces `%xx` by its byte.
pub(super) fn decode_percent(text: &str) -> Result<Vec<u8>, String> {
    let bytes = text.as_bytes();
    let mut out = Vec::with_capacity(bytes.len());
    let mut at = 0;
    while at < bytes.len() {
        if bytes[at] == b'%' {
            let digits =
                text.get(at + 1..at + 3).filter(|d| d.bytes().all(|b| b.is_ascii_hexdigit()));
            let byte = digits.and_then(|digits| u8::from_str_radix(digits, 16).ok());
            out.push(byte.ok_or_else(|| format!("bad percent escape at character {at}"))?);
            at += 3;
        } else {
            out.push(bytes[at]);
            at += 1;
        }
    }
    Ok(out)
}

/// Base64 of RFC 4648 §4, with or without padding.
fn decode_base64(text: &[u8]) -> Result<Vec<u8>, String> {
    let padding = text.iter().rev().take(2).take_while(|&&byte| byte == b'=').count();
    let digits = &text[..text.len() - padding];
    if digits.len() % 4 == 1 || (padding > 0 && !text.len().is_multiple_of(4)) {
        return Err(format!("base64 of {} characters is cut short", text.len()));
    }
    let mut out = Vec::with_capacity(digits.len() / 4 * 3 + 2);
    let (mut group, mut bits) = (0_u32, 0);
    for (at, &byte) in digits.iter().enumerate() {
        let value = match byte {
            b'A'..=b'Z' => byte - b'A',
            b'a'..=b'z' => byte - b'a' + 26,
            b'0'..=b'9' => byte - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            _ => return Err(format!("character {at} of the base64 data is none of base64's")),
        };
        group = (group << 6) | u32::from(value);
        bits += 6;
        if bits >= 8 {
            bits -= 8;
            out.push((group >> bits) as u8);
        }
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The vectors of RFC 4648 §10, padded and bare, and refusal of everything between.
    #[test]
    fn base64_follows_the_standard() {
        for (text, plain) in
            [("", ""), ("Zg==", "f"), ("Zm8=", "fo"), ("Zm9v", "foo"), ("Zm9vYmE=", "fooba")]
        {
            assert_eq!(decode_base64(text.as_bytes()).unwrap(), plain.as_bytes());
            let bare = text.trim_end_matches('=');
            assert_eq!(decode_base64(bare.as_bytes()).unwrap(), plain.as_bytes());
        }
        for bad in ["Z", "Zg=", "Zm9v=", "Zm 9", "Zm9v!", "====", "=", "Zm=9"] {
            assert!(decode_base64(bad.as_bytes()).is_err(), "{bad}");
        }
    }

    /// Percent escapes decode, and broken ones are refused rather than passed on.
    #[test]
    fn percent_escapes_are_checked() {
        assert_eq!(decode_percent("a%20b%2f").unwrap(), b"a b/");
        for bad in ["%", "%2", "%zz", "%+1", "%é"] {
            assert!(decode_percent(bad).is_err(), "{bad}");
        }
        assert_eq!(decode_data("data:,a%00").unwrap(), b"a\0");
        assert_eq!(decode_data("DATA:x/y;base64,AAEC").unwrap(), [0, 1, 2]);
        assert!(is_data("Data:,") && !is_data("dat"));
    }
}
