//! Text of a user or a file, made fit for a message.

use std::borrow::Cow;
use std::ffi::OsStr;

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

/// The name of a file or a path, made fit for a message: control characters escaped, bytes that are no
/// UTF-8 replaced.
pub(crate) fn shown_name(name: &OsStr) -> String {
    shown(&name.to_string_lossy(), usize::MAX)
}

/// A message of several lines without control characters but their ends: names of files, which anyone may
/// have chosen, are in it, and a terminal obeys some characters.
pub(crate) fn printable(text: &str) -> Cow<'_, str> {
    let obeyed = |c: char| c.is_control() && c != '\n';
    if !text.contains(obeyed) {
        return Cow::Borrowed(text);
    }
    let mut printable = String::with_capacity(text.len() + 16);
    for character in text.chars() {
        if obeyed(character) {
            printable.extend(character.escape_default());
        } else {
            printable.push(character);
        }
    }
    Cow::Owned(printable)
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

    #[test]
    fn names_and_messages_do_not_steer_a_terminal() {
        assert_eq!(shown_name(OsStr::new("a\n\u{1b}[2Jb")), "a\\n\\u{1b}[2Jb");
        assert_eq!(printable("one\ntwo\u{7}\r"), "one\ntwo\\u{7}\\r");
        assert!(matches!(printable("größer\n"), Cow::Borrowed(_)));
    }
}
