//! What all figures share: title, remark and legend around a drawing.

use crate::escape::escape;
use crate::svg::Ink;

/// How a legend shows an entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Mark {
    Line,
    Dashed,
    Dots,
    Area,
}

/// Writes a figure: caption, legend where there is more than one entry to tell apart, drawing.
pub(crate) fn write(
    out: &mut String,
    title: &str,
    remark: &str,
    legend: &[(String, Ink, Mark)],
    drawing: &str,
) {
    out.push_str(&format!("<figure><figcaption><b>{}</b>", escape(title)));
    if !remark.is_empty() {
        out.push_str(&format!(" <span>{}</span>", escape(remark)));
    }
    out.push_str("</figcaption>\n");
    if legend.len() > 1 {
        out.push_str("<div class=\"legend\">");
        for (name, ink, mark) in legend {
            let kind = match mark {
                Mark::Line => "",
                Mark::Dashed => " gaps",
                Mark::Dots => " dot",
                Mark::Area => " area",
            };
            out.push_str(&format!("<span><i class=\"{}{kind}\"></i>{}</span>", ink.fill(), escape(name)));
        }
        out.push_str("</div>\n");
    }
    out.push_str(drawing);
    out.push_str("</figure>\n");
}
