//! Links of an object that must lead somewhere: those of its landing page and of its records, as far as they stay in the object.
//!
//! Addresses elsewhere are not asked. An absolute address of the object itself counts as one in it.

use percent_encoding::percent_decode_str;
use serde_json::Value;

/// Keys of the records whose texts are addresses.
const KEYS: [&str; 4] = ["href", "@id", "id", "url"];

/// Addresses in HTML: values of `href`, `src` and `data-pack`, with the base that the page sets.
pub(crate) fn of_html(html: &str) -> Vec<String> {
    let mut links = Vec::new();
    let mut base = String::new();
    for tag in html.split('<').skip(1) {
        let tag = tag.split('>').next().unwrap_or_default();
        for name in ["href", "src", "data-pack"] {
            let Some(value) = attribute(tag, name) else { continue };
            if tag.starts_with("base ") {
                base = value;
            } else {
                links.push(value);
            }
        }
    }
    let join = |link: String| if is_relative(&link) && !link.is_empty() { format!("{base}{link}") } else { link };
    links.into_iter().map(join).collect()
}

fn attribute(tag: &str, name: &str) -> Option<String> {
    let at = tag.find(&format!(" {name}=\""))? + name.len() + 3;
    let value = tag.get(at..)?.split('"').next()?;
    Some(value.replace("&amp;", "&").replace("&#39;", "'").replace("&quot;", "\""))
}

/// Addresses in a record, by their keys. Names such as `#place` are none.
pub(crate) fn of_json(value: &Value) -> Vec<String> {
    under(value, &KEYS)
}

/// Addresses of tiles and further tilesets in a tileset of 3D Tiles.
pub(crate) fn of_tileset(value: &Value) -> Vec<String> {
    under(value, &["uri"])
}

/// Texts under these keys.
fn under(value: &Value, keys: &[&str]) -> Vec<String> {
    let mut links = Vec::new();
    let mut open = vec![value];
    while let Some(value) = open.pop() {
        match value {
            Value::Array(items) => open.extend(items),
            Value::Object(map) => {
                for (key, value) in map {
                    match value.as_str() {
                        Some(text) if keys.contains(&key.as_str()) => links.push(text.to_owned()),
                        _ => open.push(value),
                    }
                }
            }
            _ => {}
        }
    }
    links
}

fn is_relative(link: &str) -> bool {
    let scheme = link.split(['/', '?', '#']).next().unwrap_or_default();
    !scheme.contains(':') && !link.starts_with('/') && !link.starts_with('#')
}

/// The path in the object that a link leads to, from a file in `folder` (`""` or ending with `/`); `None` for what is not in the object.
/// `home` is the object's own absolute address.
pub(crate) fn target(link: &str, folder: &str, home: Option<&str>) -> Option<String> {
    let inside = home.and_then(|home| link.strip_prefix(home));
    let (link, folder) = match inside {
        Some(rest) => (rest, ""),
        None if is_relative(link) => (link, folder),
        None => return None,
    };
    let link = link.split(['?', '#']).next().unwrap_or_default();
    let link = percent_decode_str(link).decode_utf8_lossy();
    let mut parts: Vec<&str> = folder.split('/').filter(|p| !p.is_empty()).collect();
    for part in link.split('/') {
        match part {
            "" | "." => {}
            // Files above the object are not its own.
            ".." => drop(parts.pop()?),
            part => parts.push(part),
        }
    }
    let mut path = parts.join("/");
    if link.is_empty() || link.ends_with('/') || link.ends_with("..") || link == "." {
        path.push('/');
    }
    Some(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_of_a_page_lead_to_paths_in_the_object() {
        let html = "<base href=\"v1/viewer/\"><link href=\"style.css\" rel=x><script src=\"boot.js\"></script>\
            <a href=\"../../v1/plan%201.png?x=1&amp;y#z\">a</a><a href=\"../../\">home</a><a href=\"#top\">b</a>\
            <a href=\"https://other.example/\">c</a><body data-pack=\"../../v1/pack.kilwa\"><a href=\"../../../list\">d</a>";
        let links = of_html(html);
        let paths: Vec<String> = links.iter().filter_map(|l| target(l, "", None)).collect();
        assert_eq!(
            paths,
            ["v1/viewer/style.css", "v1/viewer/boot.js", "v1/plan 1.png", "/", "v1/pack.kilwa"].map(str::to_owned)
        );
    }

    proptest::proptest! {
        #[test]
        fn no_link_of_a_page_leaves_the_object(
            html in "(<base href=\"[a-z./]{0,6}\">)?(<[a-z]{1,4} (href|src)=\"[a-z%./:?#&;é0-9]{0,20}\"?>?){0,6}", folder in "([a-z]{1,3}/){0,3}",
        ) {
            for link in of_html(&html) {
                for home in [None, Some("https://a.example/x/")] {
                    let path = target(&link, &folder, home).unwrap_or_default();
                    proptest::prop_assert!(!path.starts_with("../") && !path.contains("/../"), "{} leads to {}", link, path);
                }
            }
        }

        #[test]
        fn no_text_makes_the_reader_panic_or_hang(text in ".{0,200}", folder in ".{0,20}") {
            for link in of_html(&text).iter().chain([&text]) {
                drop(target(link, &folder, None));
            }
        }
    }

    #[test]
    fn links_of_a_record_are_found_by_their_keys() {
        let value = serde_json::json!({ "linkset": [{ "item": [{ "href": "pack.kilwa" }], "anchor": "../",
            "license": [{ "href": "https://creativecommons.org/" }] }], "@id": "#place", "id": "https://a.example/x/v1/y" });
        let home = Some("https://a.example/x/");
        let mut paths: Vec<String> = of_json(&value).iter().filter_map(|l| target(l, "v1/", home)).collect();
        paths.sort();
        assert_eq!(paths, ["v1/pack.kilwa", "v1/y"].map(str::to_owned));
        assert_eq!(target("../../x", "v1/", home), None);
    }
}
