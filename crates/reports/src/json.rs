//! JSON in a readable form: indented, with lists of numbers on one line.

use serde_json::Value;

/// The same JSON, easy to read.
pub fn readable(value: &Value) -> String {
    let mut text = String::new();
    write(value, 0, &mut text);
    text
}

fn write(value: &Value, depth: usize, text: &mut String) {
    match value {
        Value::Object(fields) if is_long(value) => {
            let lines = fields.iter().map(|(key, value)| (Some(key.as_str()), value));
            write_lines('{', lines, '}', depth, text);
        }
        Value::Array(items) if is_long(value) => {
            write_lines('[', items.iter().map(|value| (None, value)), ']', depth, text);
        }
        short => text.push_str(&on_one_line(short)),
    }
}

fn write_lines<'a>(
    open: char,
    lines: impl Iterator<Item = (Option<&'a str>, &'a Value)>,
    close: char,
    depth: usize,
    text: &mut String,
) {
    text.push(open);
    for (i, (key, value)) in lines.enumerate() {
        text.push_str(if i == 0 { "\n" } else { ",\n" });
        text.push_str(&"  ".repeat(depth + 1));
        if let Some(key) = key {
            text.push_str(&format!("{}: ", Value::from(key)));
        }
        write(value, depth + 1, text);
    }
    text.push('\n');
    text.push_str(&"  ".repeat(depth));
    text.push(close);
}

/// Whether a value needs several lines: it is nested twice, or is wide.
fn is_long(value: &Value) -> bool {
    const WIDTH: usize = 90;
    let holds_some = |inner: &Value| match inner {
        Value::Array(items) => !items.is_empty(),
        Value::Object(fields) => !fields.is_empty(),
        _ => false,
    };
    let is_nested = match value {
        Value::Array(items) => items.iter().any(|item| item.is_object() && holds_some(item)),
        Value::Object(fields) => fields.len() > 3 || fields.values().any(holds_some),
        _ => false,
    };
    is_nested || on_one_line(value).chars().count() > WIDTH && holds_some(value)
}

fn on_one_line(value: &Value) -> String {
    match value {
        Value::Array(items) => {
            let items: Vec<String> = items.iter().map(on_one_line).collect();
            format!("[{}]", items.join(", "))
        }
        Value::Object(fields) => {
            let fields: Vec<String> = fields
                .iter()
                .map(|(key, value)| {
                    format!("{}: {}", Value::from(key.as_str()), on_one_line(value))
                })
                .collect();
            format!("{{{}}}", fields.join(", "))
        }
        scalar => scalar.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use serde_json::json;

    use super::*;

    #[test]
    fn lists_of_numbers_stay_on_one_line() {
        let spec = json!({"kind": "x", "range": [0.1, 2], "data": {"digest": "ab"}, "e": {}});
        let expected = "{\n  \"data\": {\"digest\": \"ab\"},\n  \"e\": {},\n  \"kind\": \"x\",\n  \
                        \"range\": [0.1, 2]\n}";
        assert_eq!(readable(&spec), expected);
    }

    #[test]
    fn every_preset_reads_back_the_same() {
        for preset in spec::presets() {
            let text = readable(&preset.spec);
            assert_eq!(serde_json::from_str::<Value>(&text).unwrap(), preset.spec);
        }
    }

    proptest! {
        #[test]
        fn any_text_reads_back_the_same(key in ".*", word in ".*", x in -1e9..1e9) {
            let value = json!({key: [[word.as_str(), x], {"a": [word.as_str(), null, {}]}]});
            let text = readable(&value);
            prop_assert_eq!(serde_json::from_str::<Value>(&text).unwrap(), value);
        }
    }
}
