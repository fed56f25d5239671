//! Reading Web Annotations as notes: strictly, all problems at once, each with its note.

use super::{
    Body, DEEPEST, LONGEST, MAX_ANNOTATIONS, NOTES_MAX, Note, Notes, NotesError, PACK_STATE, VIEW_STATE, View, Words,
    name_of,
};
use glam::DVec3;
use serde_json::{Map, Value};
use std::collections::BTreeMap;

/// What an annotation says that is written from what was understood of it, and not as it was.
const KNOWN: [&str; 7] = ["@context", "id", "type", "label", "body", "bodyValue", "target"];
/// As long as a language may be called, BCP 47.
const LANGUAGE_MAX: usize = 35;

impl Notes {
    /// Read a file of annotations.
    ///
    /// # Errors
    /// [`NotesError`] with everything that is wrong, each with its note.
    pub fn parse(bytes: &[u8]) -> Result<Self, NotesError> {
        let length = bytes.len() as u64;
        if length > NOTES_MAX {
            return Err(NotesError::one(format!(
                "the file of notes has {length} bytes; at most {NOTES_MAX} are allowed"
            )));
        }
        let bytes = bytes.strip_prefix("\u{feff}".as_bytes()).unwrap_or(bytes);
        let value: Value = kilwa_pack::json::from_slice(bytes).map_err(|e| {
            NotesError::one(format!(
                "it is not usable JSON ({e}); save the notes as a file in the viewer, Notes, \"Save as a file\""
            ))
        })?;
        let items = items_of(value)?;
        if items.len() > MAX_ANNOTATIONS {
            return Err(NotesError::one(format!(
                "the file has {} annotations; at most {MAX_ANNOTATIONS} are allowed",
                items.len()
            )));
        }
        let (mut notes, mut left_out, mut problems) = (Vec::new(), 0, Vec::new());
        let mut ids: BTreeMap<String, usize> = BTreeMap::new();
        for (number, item) in (1..).zip(items) {
            match note_of(item, number) {
                Ok(Some(note)) => {
                    if let Some(other) = ids.insert(note.id.clone(), number) {
                        problems.push(format!("notes {other} and {number} have the same id; give each its own"));
                    }
                    notes.push(note);
                }
                Ok(None) => left_out += 1,
                Err(problem) => problems.push(problem),
            }
        }
        if !problems.is_empty() {
            return Err(NotesError(problems));
        }
        if notes.is_empty() {
            let why = if left_out > 0 {
                "none of its annotations has a point on a model"
            } else {
                "it contains no annotations"
            };
            return Err(NotesError::one(format!("{why}; omit --notes to publish without notes")));
        }
        Ok(Self { notes, left_out })
    }
}

/// The annotations of a page, a collection, one annotation or a list.
fn items_of(value: Value) -> Result<Vec<Value>, NotesError> {
    let none = || {
        NotesError::one(
            "it contains no Web Annotations: expected an AnnotationPage, an AnnotationCollection, an Annotation or a list of them, as saved by the viewer",
        )
    };
    let elsewhere = || {
        NotesError::one(
            "some of its annotations are at other addresses (\"first\" or \"next\"); use a file that contains all of them",
        )
    };
    let Value::Object(mut map) = value else {
        return if let Value::Array(list) = value { Ok(list) } else { Err(none()) };
    };
    let kind = map.get("type").and_then(Value::as_str).unwrap_or_default();
    if kind == "Annotation" {
        return Ok(vec![Value::Object(map)]);
    }
    if kind == "AnnotationCollection" {
        map = match map.remove("first") {
            Some(Value::Object(first)) => first,
            Some(Value::String(_)) => return Err(elsewhere()),
            _ => return Err(none()),
        };
    }
    if map.get("next").is_some_and(|next| !next.is_null()) {
        return Err(elsewhere());
    }
    match map.remove("items").or_else(|| map.remove("resources")) {
        Some(Value::Array(list)) => Ok(list),
        _ => Err(none()),
    }
}

/// One annotation; `None` where it names no point.
fn note_of(item: Value, number: usize) -> Result<Option<Note>, String> {
    let Value::Object(mut map) = item else { return Err(format!("annotation {number} is not a JSON object")) };
    let at = |what: String| format!("note {number}: {what}");
    let is_deep = map.values().any(|v| is_deeper(v, DEEPEST - 1));
    // By value: what is kept as it is may be most of the file.
    let Some((place, states)) = target_of(map.remove("target").unwrap_or_default()).map_err(at)? else {
        return Ok(None);
    };
    if is_deep {
        return Err(at(format!("it is nested deeper than {DEEPEST} levels; remove that part from the file")));
    }
    let mut note = Note {
        id: String::new(),
        label: None,
        bodies: Vec::new(),
        place,
        view: None,
        made_on: None,
        states: Vec::new(),
        rest: Map::new(),
    };
    if let Some(label) = map.get("label").filter(|l| !l.is_null()) {
        note.label = Some(words(label, LONGEST[0]).map_err(|e| at(format!("label: {e}")))?).filter(|w| !is_empty(w));
    }
    let at = |what: String| format!("{}: {what}", name_of(number, &note));
    let bodies = bodies_of(&map).map_err(at)?;
    let stated = States::of(states).map_err(at)?;
    (note.bodies, note.view, note.made_on, note.states) = (bodies, stated.view, stated.made_on, stated.others);
    note.id = match map.get("id") {
        None | Some(Value::Null) => String::new(),
        Some(Value::String(id)) if is_id(id) => id.clone(),
        Some(_) => {
            return Err(format!(
                "{}: its id must have at most {} characters and no spaces",
                name_of(number, &note),
                LONGEST[2]
            ));
        }
    };
    for known in KNOWN {
        map.remove(known);
    }
    map.entry("motivation").or_insert_with(|| "describing".into());
    note.rest = map;
    if note.id.is_empty() {
        note.id = note.derived_id(number);
    }
    if note.label.is_none() && note.bodies.is_empty() {
        return Err(format!("note {number} is empty: it has no title, text or link; write something, or delete it"));
    }
    Ok(Some(note))
}

fn is_id(id: &str) -> bool {
    id.encode_utf16().count() <= LONGEST[2] && !id.chars().any(|c| c.is_control() || c.is_whitespace())
}

fn is_empty(words: &Words) -> bool {
    words.all().iter().all(|(_, text)| text.trim().is_empty())
}

/// One or several.
fn list(value: &Value) -> &[Value] {
    match value {
        Value::Null => &[],
        Value::Array(list) => list,
        one => std::slice::from_ref(one),
    }
}

/// The same, to be kept.
fn many(value: Value) -> Vec<Value> {
    match value {
        Value::Null => Vec::new(),
        Value::Array(list) => list,
        one => vec![one],
    }
}

/// Whether a value has more levels than these.
fn is_deeper(value: &Value, levels: usize) -> bool {
    let below = |v: &Value| is_deeper(v, levels - 1);
    match value {
        Value::Array(list) => levels == 0 || list.iter().any(below),
        Value::Object(map) => levels == 0 || map.values().any(below),
        _ => false,
    }
}

/// A place and the states of its target.
type Target = (DVec3, Vec<Value>);

/// The point that a target names, and its states; of several selectors, which are ways to say the same, the first with a point.
fn target_of(target: Value) -> Result<Option<Target>, String> {
    let mut found = None;
    for mut one in many(target) {
        let selectors = one.get("selector").map_or(&[][..], list);
        let Some(selector) = selectors.iter().find(|s| is_type(s, &["PointSelector", "urn:kilwa:point"])) else {
            continue;
        };
        let axis = |name: &str| selector.get(name).and_then(Value::as_f64).filter(|v| v.is_finite());
        // A point on a picture has no z.
        if selector.get("z").is_none() {
            continue;
        }
        let (Some(x), Some(y), Some(z)) = (axis("x"), axis("y"), axis("z")) else {
            return Err("its PointSelector has no numbers x, y and z".to_owned());
        };
        let states = one.get_mut("state").map(Value::take).map(many).unwrap_or_default();
        if found.replace((DVec3::new(x, y, z) + DVec3::ZERO, states)).is_some() {
            return Err("it has two places; split it into two notes".to_owned());
        }
    }
    Ok(found)
}

fn is_type(value: &Value, wanted: &[&str]) -> bool {
    let kind = value.get("type").unwrap_or(&Value::Null);
    list(kind).iter().filter_map(Value::as_str).any(|k| wanted.contains(&k))
}

/// What the states of a target say.
#[derive(Default)]
struct States {
    made_on: Option<String>,
    view: Option<View>,
    others: Vec<Value>,
}

impl States {
    fn of(states: Vec<Value>) -> Result<Self, String> {
        let mut all = Self::default();
        for mut state in states {
            if is_type(&state, &[PACK_STATE]) {
                let identity = state.get("identity").and_then(Value::as_str).unwrap_or_default();
                let is_hex = identity.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f'));
                if !(12..=64).contains(&identity.len()) || !is_hex {
                    return Err("the identity of its pack is not 12 to 64 digits of 0-9 and a-f".to_owned());
                }
                all.made_on.get_or_insert_with(|| identity.to_owned());
            } else if is_type(&state, &[VIEW_STATE]) && all.view.is_none() {
                all.view = Some(view_of(&mut state)?);
            } else if !is_type(&state, &[VIEW_STATE]) {
                all.others.push(state);
            }
        }
        Ok(all)
    }
}

fn view_of(state: &mut Value) -> Result<View, String> {
    let camera = match state.get("camera") {
        None | Some(Value::Null) => None,
        Some(camera) => {
            let numbers: Option<Vec<f64>> =
                camera.as_array().map(|l| l.iter().map_while(Value::as_f64).filter(|v| v.is_finite()).collect());
            let whole = |n: &Vec<f64>| {
                camera.as_array().is_some_and(|l| l.len() == n.len())
                    && (7..=9).contains(&n.len())
                    && n.get(2).is_some_and(|d| *d > 0.0)
            };
            Some(numbers.filter(whole).ok_or("its camera is not 7 to 9 numbers, the third of which is a distance")?)
        }
    };
    let display = match state.get_mut("display").map(Value::take) {
        None | Some(Value::Null) => None,
        Some(display @ Value::Object(_)) => Some(display),
        Some(_) => return Err("its display is not a JSON object".to_owned()),
    };
    Ok(View { camera, display })
}

fn bodies_of(map: &Map<String, Value>) -> Result<Vec<Body>, String> {
    let mut all = Vec::new();
    if let Some(value) = map.get("bodyValue").filter(|v| !v.is_null()) {
        let words = words(value, LONGEST[1]).map_err(|e| format!("bodyValue: {e}"))?;
        all.push(Body::Text { purpose: "describing".to_owned(), language: None, words });
    }
    for body in map.get("body").map_or(&[][..], list) {
        let found = match body {
            Value::Null => continue,
            Value::String(address) => link(address, "linking".to_owned())?,
            Value::Object(_) => body_of(body)?,
            _ => return Err("a body of it is neither an object nor an address".to_owned()),
        };
        all.push(found);
    }
    all.retain(|b| !matches!(b, Body::Text { words, .. } if is_empty(words)));
    Ok(all)
}

fn body_of(body: &Value) -> Result<Body, String> {
    let purpose = |otherwise: &str| {
        let given = body.get("purpose").map_or(&[][..], list).first().and_then(Value::as_str);
        let given = given.filter(|p| !p.is_empty() && p.len() <= 100 && !p.chars().any(char::is_control));
        given.unwrap_or(otherwise).to_owned()
    };
    let value = body.get("value").or_else(|| body.get("chars")).filter(|v| !v.is_null());
    if value.is_none() && is_type(body, &["Choice", "Composite", "List", "Independents"]) {
        return Err("its body is a choice or a composite; only texts and links are supported".to_owned());
    }
    if value.is_some() || is_type(body, &["TextualBody"]) {
        let formats = body.get("format").map_or(&[][..], list).iter().filter_map(Value::as_str);
        if formats.into_iter().any(|f| f.to_ascii_lowercase().contains("html")) {
            return Err(
                "its text is HTML, but published notes must be plain text: open the file in the viewer, which converts it, and save it again".to_owned(),
            );
        }
        let words = words(value.unwrap_or(&Value::Null), LONGEST[1]).map_err(|e| format!("its text: {e}"))?;
        let language = body.get("language").map_or(&[][..], list).first().and_then(Value::as_str);
        let language = language.filter(|l| is_language(l)).map(str::to_owned);
        return Ok(Body::Text { purpose: purpose("describing"), language, words });
    }
    let source = body.get("source").unwrap_or(&Value::Null);
    let address = source.as_str().or_else(|| source.get("id")?.as_str()).or_else(|| body.get("id")?.as_str());
    link(address.ok_or("a body of it has neither a text nor an address")?, purpose("linking"))
}

fn is_language(text: &str) -> bool {
    !text.is_empty() && text.len() <= LANGUAGE_MAX && text.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-')
}

/// An address that may be followed.
fn link(address: &str, purpose: String) -> Result<Body, String> {
    let address = address.trim();
    let short: String = address.chars().take(60).collect();
    let rest = ["http://", "https://"].iter().find_map(|scheme| {
        let start = address.get(..scheme.len())?;
        start.eq_ignore_ascii_case(scheme).then(|| address.get(scheme.len()..).unwrap_or_default())
    });
    match rest {
        Some(rest) if !rest.is_empty() && is_id(address) && !address.contains(['<', '>', '"', '\\']) => {
            Ok(Body::Link { purpose, address: address.to_owned() })
        }
        _ => Err(format!("its link {short:?} is not an http or https address; correct or remove it")),
    }
}

/// A text or texts by language, no longer than `most`.
fn words(value: &Value, max: usize) -> Result<Words, String> {
    let text = |text: &str| {
        let length = text.encode_utf16().count();
        if length > max {
            return Err(format!("it has {length} characters; at most {max} are allowed"));
        }
        if text.chars().any(|c| c.is_control() && !"\n\r\t".contains(c)) {
            return Err("it contains control characters".to_owned());
        }
        Ok(text.to_owned())
    };
    match value {
        Value::Null => Ok(Words::Plain(String::new())),
        Value::String(one) => Ok(Words::Plain(text(one)?)),
        Value::Object(map) => {
            if let Some(value) = map.get("@value").and_then(Value::as_str) {
                let one = text(value)?;
                let language = map.get("@language").and_then(Value::as_str).filter(|l| is_language(l));
                return Ok(match language {
                    Some(language) => Words::ByLanguage([(language.to_owned(), vec![one])].into()),
                    None => Words::Plain(one),
                });
            }
            let mut all = BTreeMap::new();
            for (language, texts) in map {
                if !is_language(language) {
                    return Err(format!("{:?} is not a language code", language.chars().take(40).collect::<String>()));
                }
                let strings: Option<Vec<&str>> = list(texts).iter().map(Value::as_str).collect();
                let strings = strings.ok_or("expected a text, or texts by language")?;
                all.insert(language.clone(), strings.into_iter().map(text).collect::<Result<_, _>>()?);
            }
            Ok(Words::ByLanguage(all))
        }
        _ => Err("expected a text, or texts by language".to_owned()),
    }
}
