//! Text made safe for HTML and SVG, and numbers made short for people.

/// Text that stands in an element or in a quoted attribute and means itself; control characters become blanks.
#[must_use]
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            c if c.is_control() => out.push(' '),
            c => out.push(c),
        }
    }
    out
}

/// A number with so many significant digits and no exponent where that can be read; a dash where it is not finite.
#[must_use]
pub fn number(value: f64, significant: usize) -> String {
    if !value.is_finite() {
        return "\u{2013}".to_owned();
    }
    if value == 0.0 {
        return "0".to_owned();
    }
    let before = value.abs().log10().floor() as i32;
    if !(-5..9).contains(&before) {
        return format!("{value:.*e}", significant.saturating_sub(1)).replace('-', "\u{2212}");
    }
    let decimals = usize::try_from(significant as i32 - 1 - before).unwrap_or(0);
    let text = format!("{value:.decimals$}");
    // A minus as wide as a plus, so that columns of numbers stay aligned.
    text.replace('-', "\u{2212}")
}

/// At most `most` characters of a text, with an ellipsis where it was cut.
#[must_use]
pub fn short(text: &str, most: usize) -> String {
    if text.chars().count() <= most {
        return text.to_owned();
    }
    let mut out: String = text.chars().take(most.saturating_sub(1)).collect();
    out.push('\u{2026}');
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn nothing_escapes(text in ".{0,60}") {
            let safe = escape(&text);
            prop_assert!(!safe.contains(['<', '>', '"', '\'']));
            let back = safe.replace("&lt;", "<").replace("&gt;", ">").replace("&quot;", "\"")
                .replace("&#39;", "'").replace("&amp;", "&");
            let expected: String = text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
            prop_assert_eq!(back, expected);
        }

        #[test]
        fn a_number_is_itself_to_its_digits(value in -1e8..1e8f64) {
            prop_assume!(value.abs() > 1e-4);
            let back: f64 = number(value, 4).replace('\u{2212}', "-").parse().unwrap();
            prop_assert!((back - value).abs() <= 0.51e-3 * value.abs(), "{back} {value}");
        }
    }

    #[test]
    fn what_is_no_number_is_a_dash() {
        assert_eq!(
            [number(f64::NAN, 3), number(-0.0251, 2), number(0.0, 3)],
            ["\u{2013}", "\u{2212}0.025", "0"]
        );
        assert_eq!(short("a long name", 6), "a lon\u{2026}");
    }
}
