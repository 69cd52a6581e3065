//! A comparison as a JUnit document for machines and as a page for people.

use std::fmt::Write;

use super::Line;

/// The lines as test cases of one suite, in the form of JUnit that build servers read.
#[must_use]
pub fn junit(scene: &str, lines: &[Line]) -> String {
    let failures = lines.iter().filter(|line| !line.passes).count();
    let mut xml = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites>\n  <testsuite name=\"poselight {}\" \
         tests=\"{}\" failures=\"{failures}\" errors=\"0\" skipped=\"0\">\n",
        escape(scene),
        lines.len()
    );
    for line in lines {
        let name = escape(&line.name);
        let _ = write!(xml, "    <testcase classname=\"{}\" name=\"{name}\"", escape(scene));
        if line.passes {
            xml += "/>\n";
        } else {
            let text = escape(&sentence(line));
            let _ = writeln!(xml, ">\n      <failure message=\"{text}\"/>\n    </testcase>");
        }
    }
    xml += "  </testsuite>\n</testsuites>\n";
    xml
}

/// The lines as one short HTML file.
#[must_use]
pub fn page(scene: &str, lines: &[Line]) -> String {
    let failures = lines.iter().filter(|line| !line.passes).count();
    let verdict = match failures {
        0 => "nothing is worse than what was approved".to_owned(),
        1 => "one figure is worse than what was approved".to_owned(),
        count => format!("{count} figures are worse than what was approved"),
    };
    let mut rows = String::new();
    for line in lines {
        let class = if line.passes { "" } else { " class=\"worse\"" };
        let number = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), number);
        let _ = writeln!(
            rows,
            "<tr{class}><td>{}<td>{}<td>{}<td>{}<td>{}",
            escape(&line.name),
            number(line.approved),
            number(line.most),
            number(line.found),
            if line.passes { "passes" } else { "worse" }
        );
    }
    format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>Check of {0}</title>\
         <style>:root{{color-scheme:light dark}}body{{font-family:sans-serif;max-width:60em;\
         margin:2em auto;padding:0 1em}}td,th{{padding:.2em 1em;text-align:right}}\
         td:first-child,th:first-child{{text-align:left}}.worse{{color:#c00;font-weight:bold}}\
         </style><h1>{0}: {verdict}</h1><table><tr><th>figure<th>approved<th>at most<th>now\
         <th>verdict\n{rows}</table></html>\n",
        escape(scene)
    )
}

/// Why a line does not pass.
fn sentence(line: &Line) -> String {
    let Some(found) = line.found else { return "it was approved, and is not measured now".into() };
    let number_or = |value: Option<f64>| value.map_or_else(|| "nothing".to_owned(), number);
    format!(
        "it is {}; {} was approved, and at most {} passes",
        number(found),
        number_or(line.approved),
        number_or(line.most)
    )
}

fn number(value: f64) -> String {
    if value == value.trunc() && value.abs() < 1e15 {
        format!("{value}")
    } else {
        format!("{value:.5}")
    }
}

/// Text as XML and HTML take it; characters that neither can hold are left out.
fn escape(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars().filter(|c| !c.is_control()) {
        match c {
            '&' => out += "&amp;",
            '<' => out += "&lt;",
            '>' => out += "&gt;",
            '"' => out += "&quot;",
            '\'' => out += "&#39;",
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines() -> Vec<Line> {
        let line = |name: &str, found: Option<f64>, passes| Line {
            name: name.to_owned(),
            approved: Some(100.0),
            found,
            most: Some(105.0),
            passes,
        };
        vec![
            line("bytes", Some(90.0), true),
            line("a<b>", Some(0.123_456), false),
            line("gone", None, false),
        ]
    }

    /// Each line is a case; what fails says by how much; names cannot break out of the document.
    #[test]
    fn build_servers_can_read_it() {
        let xml = junit("he\"ro\u{1}.glb", &lines());
        assert!(xml.contains("tests=\"3\" failures=\"2\""), "{xml}");
        assert!(xml.contains("name=\"a&lt;b&gt;\"") && !xml.contains("a<b>"), "{xml}");
        assert!(xml.contains("poselight he&quot;ro.glb"), "{xml}");
        assert!(xml.contains("it is 0.12346; 100 was approved, and at most 105 passes"), "{xml}");
        assert!(xml.contains("is not measured now"), "{xml}");
        assert_eq!(xml.matches("<testcase").count(), 3);
        assert_eq!(
            xml.matches("</testcase>").count() + xml.matches("\"/>\n    <test").count(),
            3,
            "{xml}"
        );
    }

    /// The page names what is worse.
    #[test]
    fn people_can_read_it() {
        let page = page("hero.glb", &lines());
        assert!(page.contains("2 figures are worse"), "{page}");
        assert_eq!(page.matches("class=\"worse\"").count(), 2);
    }
}
