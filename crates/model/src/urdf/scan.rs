//! Where the elements of an XML text stand, so that an error can name its line and no nesting can exhaust the stack.

/// Deeper elements than any URDF has; the parsers recurse once per level.
const MAX_DEPTH: usize = 64;

/// Places of the root's opening tag and of its children.
#[derive(Debug, Default)]
pub(super) struct Outline {
    root: (usize, usize),
    children: Vec<(usize, usize)>,
}

/// Finds the root and its children; the error is a line (from 1) and a reason.
pub(super) fn outline(text: &str) -> Result<Outline, (usize, String)> {
    let mut outline = Outline::default();
    let (mut at, mut depth, mut start) = (0, 0usize, 0);
    while let Some(offset) = text[at..].find('<') {
        let open = at + offset;
        let rest = &text[open..];
        let end = tag_end(rest).map(|length| open + length);
        let Some(end) = end else {
            return Err((line_of(text, open), "a tag or comment that is opened here never ends".to_owned()));
        };
        at = end;
        if rest.starts_with("<!") || rest.starts_with("<?") {
            continue;
        }
        if rest.starts_with("</") {
            depth = depth.saturating_sub(1);
            if depth == 1 {
                outline.children.push((start, end));
            }
            continue;
        }
        match depth {
            0 => outline.root = (open, end),
            1 => start = open,
            _ => {}
        }
        if !text[..end].ends_with("/>") {
            depth += 1;
        } else if depth == 1 {
            outline.children.push((open, end));
        }
        if depth > MAX_DEPTH {
            return Err((line_of(text, open), format!("elements are nested deeper than {MAX_DEPTH} levels")));
        }
    }
    Ok(outline)
}

/// Length of the tag, comment, CDATA section or instruction at the start of `rest`.
fn tag_end(rest: &str) -> Option<usize> {
    for (opening, closing) in [("<!--", "-->"), ("<![CDATA[", "]]>"), ("<?", "?>")] {
        if let Some(inner) = rest.strip_prefix(opening) {
            return inner.find(closing).map(|at| opening.len() + at + closing.len());
        }
    }
    let mut quote = None;
    for (at, byte) in rest.bytes().enumerate() {
        match quote {
            Some(open) if byte == open => quote = None,
            Some(_) => {}
            None if byte == b'"' || byte == b'\'' => quote = Some(byte),
            None if byte == b'>' => return Some(at + 1),
            None => {}
        }
    }
    None
}

/// Line, from 1, of a byte of the text.
fn line_of(text: &str, at: usize) -> usize {
    text.bytes().take(at).filter(|byte| *byte == b'\n').count() + 1
}

impl Outline {
    /// Line and reason of the first child of the root that cannot be read by itself.
    pub(super) fn offender(
        &self,
        text: &str,
        fails: impl Fn(&str) -> Option<String>,
    ) -> Option<(usize, String)> {
        let root = &text[self.root.0..self.root.1];
        let name: String =
            root.chars().skip(1).take_while(|c| !c.is_whitespace() && !"/>".contains(*c)).collect();
        self.children.iter().find_map(|&(start, end)| {
            let part = &text[start..end];
            let reason = fails(&format!("{root}{part}</{name}>"))?;
            let tag = &part[..tag_end(part).unwrap_or(part.len())];
            let shown = tag.split_whitespace().collect::<Vec<_>>().join(" ");
            Some((line_of(text, start), format!("in {shown}: {reason}")))
        })
    }
}
