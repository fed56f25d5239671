//! Names, whose hyphens may represent decimal points or spaces, and lists, whose items may belong together.

use super::text::readable;
use super::{Finding, Location, codes};
use serde_json::Value;

/// Keys of names: hyphens in their texts are searched as points, too.
const NAMES: [&str; 3] = ["title", "slug", "alternative_titles"];

impl Location {
    /// The part of a slug, a title or another name that gives the location away: [`Location::find`], and the same with hyphens read as decimal points and as spaces
    /// (`8-95611-39-60023`, `lat-8-956-lon-39-600`), and as the plus sign of a Plus Code (`6g3x2jv2-h3`).
    pub fn find_in_name(&self, name: &str) -> Option<Finding> {
        self.find(name).or_else(|| {
            let texts = readable(name).into_iter().filter(|text| text.iter().any(|c| is_hyphen(*c)));
            texts.into_iter().find_map(|text| {
                let found = unhyphenated(&text).iter().find_map(|text| self.find_in(text, false));
                found.or_else(|| self.code_with_hyphen(&text))
            })
        })
    }

    /// The location, if the items of a list together give it away: `["-8.956", "39.600"]`.
    pub fn find_in_list<'a>(&self, items: impl IntoIterator<Item = &'a str>) -> Option<Finding> {
        let items: Vec<&str> = items.into_iter().collect();
        if items.len() < 2 {
            return None;
        }
        [", ", " "].iter().find_map(|between| self.find(&items.join(between)))
    }

    /// Search the strings of a JSON list together, and those that its objects have under the same key. Items for which `is_passed` returns true are skipped.
    pub(super) fn find_in_json_list(&self, list: &[Value], is_passed: &dyn Fn(usize) -> bool) -> Option<Finding> {
        let items = || list.iter().enumerate().filter(|(i, _)| !is_passed(*i)).map(|(_, v)| v);
        self.find_in_list(items().filter_map(Value::as_str)).or_else(|| {
            let mut keys: Vec<&String> = items().filter_map(Value::as_object).flat_map(serde_json::Map::keys).collect();
            keys.sort_unstable();
            keys.dedup();
            keys.into_iter().find_map(|key| {
                let column = items().filter_map(|v| v.as_object()?.get(key)?.as_str());
                self.find_in_list(column)
            })
        })
    }

    /// A Plus Code with a hyphen in place of its sign: a full one of any place, a short one near the location.
    fn code_with_hyphen(&self, text: &[char]) -> Option<Finding> {
        let text: Vec<char> = text.iter().map(|c| if is_hyphen(*c) { '+' } else { *c }).collect();
        let range = codes::full_plus_code(&text).or_else(|| codes::near_plus_code(&text, &self.sites));
        range.map(|range| super::says(&text, range, super::Kind::Code))
    }
}

/// Whether a key or JSON path is that of a name: `title`, `alternative_titles[1]`.
pub fn is_name(at: &str) -> bool {
    let key = at.rsplit('.').next().unwrap_or_default();
    NAMES.contains(&key.split('[').next().unwrap_or_default())
}

fn is_hyphen(c: char) -> bool {
    matches!(c, '-' | '_')
}

/// A text with its hyphens read in other ways: those between digits as decimal points, every second one of a chain as a decimal point, and all as spaces.
fn unhyphenated(text: &[char]) -> [Vec<char>; 3] {
    let digit = |i: usize| text.get(i).is_some_and(char::is_ascii_digit);
    let (mut points, mut pairs, mut blanks) = (Vec::new(), Vec::new(), Vec::new());
    // Whether the next hyphen between digits is a decimal point.
    let mut is_point = true;
    for (i, c) in text.iter().enumerate() {
        if !is_hyphen(*c) {
            is_point |= !c.is_ascii_digit();
            for all in [&mut points, &mut pairs, &mut blanks] {
                all.push(*c);
            }
            continue;
        }
        let is_between = i > 0 && digit(i - 1) && digit(i + 1);
        points.push(if is_between { '.' } else { ' ' });
        pairs.push(if is_between && is_point { '.' } else { ' ' });
        blanks.push(' ');
        is_point = !(is_between && is_point);
    }
    [points, pairs, blanks]
}
