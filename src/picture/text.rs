//! Text that comes from a plan, made fit for a drawing.

use super::canvas;

/// Longer text is cut before anything is measured.
const MAX_CHARS: usize = 400;
/// Stands for a character that XML cannot hold.
const REPLACEMENT: char = '\u{FFFD}';

/// Text as XML content or attribute: markup is escaped, breaks and tabs are spaces, and what XML 1.0 cannot
/// hold is U+FFFD.
pub(super) fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for character in text.chars() {
        match plain(character) {
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '&' => escaped.push_str("&amp;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&apos;"),
            other => escaped.push(other),
        }
    }
    escaped
}

fn plain(character: char) -> char {
    match character {
        '\n' | '\r' | '\t' => ' ',
        '\u{FFFE}' | '\u{FFFF}' => REPLACEMENT,
        other if other.is_control() => REPLACEMENT,
        other => other,
    }
}

/// The width of a line of text at a font size, in the units of that size.
pub(super) fn width(text: &str, size: f64) -> f64 {
    canvas::text_width(&escape(text)).unwrap_or(0.0) * size
}

/// `text` as one line of characters that XML can hold, not yet escaped; cut, with an ellipsis, where it is
/// wider than `room` at font size `size`.
pub(super) fn elide(text: &str, size: f64, room: f64) -> String {
    let mut characters: Vec<char> = text.chars().take(MAX_CHARS + 1).map(plain).collect();
    let cut = characters.len() > MAX_CHARS;
    characters.truncate(MAX_CHARS);
    let line: String = characters.iter().collect();
    if !cut && width(&line, size) <= room {
        return line;
    }
    let shortened = |kept: usize| {
        let kept: String = characters.iter().take(kept).collect();
        format!("{}…", kept.trim_end())
    };
    // The longest start that fits; a longer start is never narrower.
    let (mut fits, mut too_long) = (0, characters.len() + 1);
    while too_long - fits > 1 {
        let middle = fits.midpoint(too_long);
        if width(&shortened(middle), size) <= room {
            fits = middle;
        } else {
            too_long = middle;
        }
    }
    shortened(fits)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markup_and_control_characters_are_harmless() {
        assert_eq!(
            escape("<script>&\"'</script>"),
            "&lt;script&gt;&amp;&quot;&apos;&lt;/script&gt;"
        );
        assert_eq!(escape("a\nb\0c\u{FFFF}"), "a b\u{FFFD}c\u{FFFD}");
        assert_eq!(escape("ümlaut γ 鼻"), "ümlaut γ 鼻");
    }

    #[test]
    fn what_fits_stays_and_what_does_not_ends_in_an_ellipsis() {
        assert_eq!(elide("preoperative", 12.0, 200.0), "preoperative");
        let long = "a long name of a candidate ".repeat(300);
        let short = elide(&long, 12.0, 100.0);
        assert!(short.ends_with('…') && short.starts_with("a long"));
        assert!(width(&short, 12.0) <= 100.0);
        assert!(width(&short, 12.0) > 85.0);
        assert_eq!(elide("name", 12.0, 0.0), "…");
        assert_eq!(elide("", 12.0, 10.0), "");
    }
}
