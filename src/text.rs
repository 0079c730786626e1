//! Text of a user or a file, made fit for a message.

/// The text, control characters escaped, shortened to `most` characters where it is longer.
pub(crate) fn shown(text: &str, most: usize) -> String {
    let mut shown = String::new();
    for (place, character) in text.chars().enumerate() {
        if place == most {
            shown.push('…');
            break;
        }
        if character.is_control() {
            shown.extend(character.escape_default());
        } else {
            shown.push(character);
        }
    }
    shown
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_long_is_shortened_and_what_does_not_print_is_escaped() {
        assert_eq!(shown("tip\n\u{1b}[2J", 48), "tip\\n\\u{1b}[2J");
        assert_eq!(shown("größer", 6), "größer");
        assert_eq!(shown("größer", 4), "größ…");
    }
}
