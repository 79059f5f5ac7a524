//! Pieces of HTML with places to be filled.

/// The template with each `{{name}}` replaced by its value. Values are not searched again, so a
/// `{{name}}` in a value stays.
pub(crate) fn fill(template: &str, values: &[(&str, &str)]) -> String {
    let mut pieces = template.split("{{");
    let mut filled = pieces.next().unwrap_or_default().to_owned();
    for piece in pieces {
        let (name, after) = piece.split_once("}}").expect("a place in a template ends with }}");
        let value = values.iter().find(|(key, _)| *key == name).map(|(_, value)| *value);
        filled.push_str(value.unwrap_or_else(|| panic!("a template has a place {name} without value")));
        filled.push_str(after);
    }
    filled
}

/// Text escaped for HTML, also between quotes.
pub(crate) fn escaped(text: &str) -> String {
    let text = text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    text.replace('"', "&quot;").replace('\'', "&#39;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_filled_once() {
        let values = [("a", "{{b}}"), ("b", "2")];
        assert_eq!(fill("<{{a}}|{{b}}|{{a}}>", &values), "<{{b}}|2|{{b}}>");
        assert_eq!(fill("nothing", &values), "nothing");
    }

    #[test]
    fn text_ends_neither_tags_nor_attributes() {
        assert_eq!(escaped("<b a=\"x\" c='y'> & z"), "&lt;b a=&quot;x&quot; c=&#39;y&#39;&gt; &amp; z");
    }
}
