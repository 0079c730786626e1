//! Keys that are given twice. The parser finds them and keeps the first; this finds where that is.

use toml::de::{DeTable, DeValue};

use super::decode::{Value, quote};
use super::diagnostic::{Code, Fault};
use super::source::Span;

/// The parser's words for a key that is given twice.
pub(super) const MESSAGE: &str = "duplicate key";

/// The fault of a key that is given again at `span`, after it was given at `first`.
pub(super) fn fault(text: &str, span: Span, first: Option<Span>) -> Fault {
    let key = quote(key_at(text, span), '`');
    let fault = Fault::new(Code::DuplicateKey, span, format!("{key} is given twice"));
    let fault = fault.found(format!("a second {key}"));
    let before = first.and_then(|first| text.get(..first.start));
    match before {
        Some(before) => {
            let line = before.matches('\n').count() + 1;
            fault.expected(format!("each key once; it is given first on line {line}"))
        }
        None => fault.expected("each key once"),
    }
}

/// A key as it is written, its quotes removed.
fn key_at(text: &str, span: Span) -> &str {
    let written = text.get(span.start..span.end).unwrap_or_default();
    written.trim().trim_matches(['"', '\''])
}

/// Where the table that holds `span` has the key at `span` before it.
pub(super) fn first_given(document: &DeTable<'_>, text: &str, span: Span) -> Option<Span> {
    let mut holder = Holder {
        text,
        at: span.start,
        start: 0,
        table: document,
    };
    holder.search(document);
    let (first, _) = holder.table.get_key_value(key_at(text, span))?;
    let first = Span::from(first.span());
    (first.start < span.start).then_some(first)
}

/// Finds the table that holds a place: the innermost inline table around it, or else the table of the
/// last header before it.
struct Holder<'a, 'i> {
    text: &'a str,
    at: usize,
    /// Where the best table so far begins.
    start: usize,
    table: &'a DeTable<'i>,
}

impl<'a, 'i> Holder<'a, 'i> {
    fn search(&mut self, table: &'a DeTable<'i>) {
        for value in table.values() {
            self.visit(value);
        }
    }

    fn visit(&mut self, value: &'a Value<'i>) {
        match value.get_ref() {
            DeValue::Array(items) => {
                for item in items.iter() {
                    self.visit(item);
                }
            }
            DeValue::Table(table) => {
                // The span of an inline table is all of it; that of any other is its header alone.
                let span = value.span();
                let inline = self.text.as_bytes().get(span.start) == Some(&b'{');
                if inline && !span.contains(&self.at) {
                    return;
                }
                if span.start <= self.at && span.start >= self.start {
                    self.start = span.start;
                    self.table = table;
                }
                self.search(table);
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The fault of the last of the parser's errors.
    fn fault_of(text: &str) -> Fault {
        let (document, errors) = DeTable::parse_recoverable(text);
        let error = errors.last().unwrap();
        assert_eq!(error.message(), MESSAGE, "the parser's words have changed");
        let span = Span::from(error.span().unwrap());
        fault(text, span, first_given(document.get_ref(), text, span))
    }

    #[test]
    fn the_line_of_the_first_is_named() {
        for (text, line) in [
            ("a = 1\nb = 2\na = 3", 1),
            ("[t]\na = { a = 1 }\nb = 1\n'a' = 2", 2),
            ("x = 1\n[t]\nx = 1\n[u]\nx = 2\nx = 3", 5),
            ("x = [{ a = 1 },\n{ a = 2,\n a = 3 }]", 2),
            ("[[c]]\nn = 1\n[[c]]\nn = 1\n[[c.s]]\nn = 1\nn = 2", 6),
            ("c.n = 1\nc.n = 2", 1),
        ] {
            let expected = fault_of(text).expected.unwrap();
            let named = format!("on line {line}");
            assert!(expected.ends_with(&named), "{text:?}: {expected}");
        }
    }

    #[test]
    fn a_table_given_twice_is_named() {
        let fault = fault_of("[ct]\npath = 1\n[ct]\n");
        assert_eq!(fault.message, "`ct` is given twice");
    }
}
