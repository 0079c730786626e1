//! The text of a plan file, and places in it.

/// A place in the text, as byte offsets: from the first to one past the last.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Span {
    pub start: usize,
    pub end: usize,
}

impl From<std::ops::Range<usize>> for Span {
    fn from(range: std::ops::Range<usize>) -> Self {
        Self {
            start: range.start,
            end: range.end,
        }
    }
}

/// A value, and the place in the text that gives it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Located<T> {
    pub value: T,
    pub span: Span,
}

/// A plan's text under the name by which the user knows it.
#[derive(Debug, Clone)]
pub(super) struct Source {
    name: String,
    text: String,
    /// Byte offset of the first character of every line.
    line_starts: Vec<usize>,
}

/// A place as people count: lines and characters from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Position {
    pub line: usize,
    pub column: usize,
}

/// The longest line that messages quote, in bytes. Longer ones are machine-made, and would fill the
/// screen.
const MAX_QUOTED_LINE: usize = 400;

/// A line of the text, and the part of it that a message is about, as byte offsets in the line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Excerpt {
    pub line: String,
    pub span: Span,
}

impl Source {
    /// The text without its byte order mark, if it has one.
    pub fn new(name: String, text: &str) -> Self {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text).to_owned();
        let line_starts = std::iter::once(0)
            .chain(text.match_indices('\n').map(|(newline, _)| newline + 1))
            .collect();
        Self {
            name,
            text,
            line_starts,
        }
    }

    pub fn name(&self) -> &str {
        &self.name
    }

    pub fn text(&self) -> &str {
        &self.text
    }

    /// Where a place begins. Offsets past the end are the end; offsets inside a character are its start.
    pub fn position(&self, span: Span) -> Position {
        let (number, start) = self.line_at(span.start);
        let before = self.text.get(start..self.boundary(span.start));
        Position {
            line: number,
            column: before.map_or(0, |before| before.chars().count()) + 1,
        }
    }

    /// The line on which a place begins, and the part of the place on it; none where the line is too
    /// long to show.
    pub fn excerpt(&self, span: Span) -> Option<Excerpt> {
        let (_, start) = self.line_at(span.start);
        let line = self.text.get(start..)?.lines().next().unwrap_or("");
        if line.len() > MAX_QUOTED_LINE {
            return None;
        }
        let within = |offset: usize| self.boundary(offset).saturating_sub(start).min(line.len());
        Some(Excerpt {
            line: line.to_owned(),
            span: Span {
                start: within(span.start),
                end: within(span.end).max(within(span.start)),
            },
        })
    }

    /// The number of the line that holds a byte offset, from 1, and the offset of its first character.
    fn line_at(&self, offset: usize) -> (usize, usize) {
        let number = self.line_starts.partition_point(|&start| start <= offset);
        let start = self.line_starts.get(number.saturating_sub(1));
        (number.max(1), start.copied().unwrap_or(0))
    }

    fn boundary(&self, offset: usize) -> usize {
        let mut offset = offset.min(self.text.len());
        while !self.text.is_char_boundary(offset) {
            offset -= 1;
        }
        offset
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(text: &str, start: usize, end: usize) -> (Position, Option<Excerpt>) {
        let source = Source::new("plan.toml".to_owned(), text);
        let span = Span { start, end };
        (source.position(span), source.excerpt(span))
    }

    #[test]
    fn columns_count_characters_and_lines_end_in_either_way() {
        let text = "a = 1\r\nné = 2\r\nc";
        let (position, excerpt) = at(text, 11, 12);
        assert_eq!(position, Position { line: 2, column: 4 });
        let excerpt = excerpt.unwrap();
        assert_eq!(excerpt.line, "né = 2");
        assert_eq!(excerpt.line.get(excerpt.span.start..), Some("= 2"));
    }

    #[test]
    fn places_that_leave_their_line_or_the_text_are_cut() {
        let (position, excerpt) = at("a = 1\nb", 4, 7);
        assert_eq!(position, Position { line: 1, column: 5 });
        assert_eq!(excerpt.unwrap().span, Span { start: 4, end: 5 });
        let (position, excerpt) = at("a = 1\nb", 99, 120);
        assert_eq!(position, Position { line: 2, column: 2 });
        assert_eq!(excerpt.unwrap().span, Span { start: 1, end: 1 });
        let (position, _) = at("", 0, 0);
        assert_eq!(position, Position { line: 1, column: 1 });
    }

    #[test]
    fn a_byte_order_mark_takes_no_column() {
        let (position, excerpt) = at("\u{feff}a = 1", 0, 1);
        assert_eq!(position, Position { line: 1, column: 1 });
        assert_eq!(excerpt.unwrap().line, "a = 1");
    }

    #[test]
    fn very_long_lines_are_not_quoted() {
        let text = "x".repeat(MAX_QUOTED_LINE + 1);
        assert_eq!(at(&text, 3, 4).1, None);
    }
}
