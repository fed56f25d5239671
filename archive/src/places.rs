//! The places of the viewer page that the facts of a model are put into. The build script reads this file too.

/// The places of `index.html` in their order, each with what goes there. Each must be there exactly once.
pub(crate) const PLACES: [(&str, &str); 11] = [
    ("<head>", "what the server's policy adds to the head"),
    ("<base href=\"./\">", "the address of the viewer"),
    ("<title>Kilwa</title>", "the title and what programs read"),
    ("</head>", "what a page without scripts needs"),
    ("data-pack=\"\"", "the address of the pack"),
    ("data-list=\"\"", "the address of the list of models"),
    ("<!--title-->", "the title"),
    ("<!--poster-->", "the picture that is shown until the model is there"),
    ("<!--about-->", "the texts about the model"),
    ("<!--facts-->", "the technical facts of the model"),
    ("</body>", "the page without a viewer"),
];

/// The pieces between the places.
///
/// # Errors
/// A sentence about the first place that is missing, or there twice, or not in its order.
pub(crate) fn cut(html: &str) -> Result<[&str; PLACES.len() + 1], String> {
    let mut pieces = [""; PLACES.len() + 1];
    let mut rest = html;
    for (piece, (place, what)) in pieces.iter_mut().zip(PLACES) {
        match html.matches(place).count() {
            1 => {}
            0 => return Err(format!("{place} is missing, where {what} would go")),
            n => return Err(format!("{place} is there {n} times; {what} can go to one place only")),
        }
        (*piece, rest) = rest.split_once(place).ok_or_else(|| format!("{place} is not in its order: {what}"))?;
    }
    pieces[PLACES.len()] = rest;
    Ok(pieces)
}
