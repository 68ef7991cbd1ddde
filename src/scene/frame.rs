//! Names with a place for a frame's number: `smoke_####.vdb`, the number with zeros in front up to so many digits; `{frame}`, the number as it is; `{frame:04}`, like `####`.

/// The text with the number in place of every pattern; `None` where there is no pattern.
pub fn numbered(text: &str, frame: u32) -> Option<String> {
    let (mut out, mut rest) = (String::new(), text);
    while let Some((at, length, digits)) = next(rest) {
        out += &rest[..at];
        out += &format!("{frame:0digits$}");
        rest = &rest[at + length..];
    }
    (rest.len() < text.len()).then(|| out + rest)
}

pub fn has_pattern(text: &str) -> bool {
    next(text).is_some()
}

/// The first pattern: its byte, its length, and the least number of digits.
fn next(text: &str) -> Option<(usize, usize, usize)> {
    let hashes = text.find('#').map(|at| {
        let n = text[at..].bytes().take_while(|&b| b == b'#').count();
        (at, n, n)
    });
    let braces = text.match_indices("{frame").find_map(|(at, head)| {
        let end = at + text[at..].find('}')?;
        let digits = match &text[at + head.len()..end] {
            "" => 1,
            form => form.strip_prefix(":0")?.parse::<u8>().ok()?.into(),
        };
        Some((at, end + 1 - at, digits))
    });
    hashes.into_iter().chain(braces).min()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_stand_in_place_of_patterns() {
        for (text, expected) in [
            ("a_####.vdb", "a_0042.vdb"),
            ("a_#.vdb", "a_42.vdb"),
            ("##/a.###.vdb", "42/a.042.vdb"),
            ("a_{frame}.vdb", "a_42.vdb"),
            ("{frame:06}ü{frame:01}", "000042ü42"),
            ("{frame}_#####", "42_00042"),
        ] {
            assert_eq!(numbered(text, 42).as_deref(), Some(expected));
            assert!(has_pattern(text));
        }
        assert_eq!(numbered("##", 12345).as_deref(), Some("12345"));
        for text in ["", "a.vdb", "{frame", "{frame:4}", "{frame:0}", "{frame:0x}", "{frames}", "{Frame}"] {
            assert_eq!(numbered(text, 42), None, "{text}");
        }
    }
}
