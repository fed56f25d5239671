//! The institution's accent colour, in the light and the dark theme, with the contrast that WCAG 2.2 AA requires.

use std::fmt;

/// Minimum contrast of text with its background (WCAG 2.2, 1.4.3).
const CONTRAST: f64 = 4.5;
/// Steps from a colour to black or white on the way to one with enough contrast.
const STEPS: u32 = 200;

/// A colour of sRGB.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Rgb([u8; 3]);

/// The theme that a reader's browser asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Theme {
    Light,
    Dark,
}

impl Theme {
    /// For messages.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Light => "light",
            Self::Dark => "dark",
        }
    }

    /// The backgrounds of the accent (`--paper`, `--raised`, `--sunken`), and the colour of text on the accent (`--on-accent`); as in www/style.css.
    fn around(self) -> [Rgb; 4] {
        match self {
            Self::Light => [[0xf6, 0xf1, 0xe7], [0xff, 0xfc, 0xf5], [0xeb, 0xe4, 0xd6], [0xff, 0xfa, 0xf1]].map(Rgb),
            Self::Dark => [[0x1e, 0x1d, 0x1b], [0x29, 0x27, 0x25], [0x16, 0x15, 0x14], [0x1e, 0x15, 0x09]].map(Rgb),
        }
    }
}

/// The accent in both themes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Accent {
    pub(super) light: Rgb,
    pub(super) dark: Rgb,
}

impl Accent {
    /// Style sheet rules that replace Kilwa's accent with it. Nothing but the digits of a colour gets into them.
    pub(crate) fn css(self) -> String {
        let Self { light, dark } = self;
        format!(
            "\n:root {{ --accent: {light}; --accent-soft: color-mix(in srgb, var(--accent) 18%, var(--raised)); }}\n\
             @media (prefers-color-scheme: dark) {{ :root {{ --accent: {dark}; }} }}\n"
        )
    }
}

impl Rgb {
    /// From `#rrggbb` or `#rgb`.
    pub(crate) fn parse(text: &str) -> Option<Self> {
        let digits = text.strip_prefix('#')?.as_bytes();
        let value = |digit: u8| char::from(digit).to_digit(16).map(|d| d as u8);
        let pair = |a: u8, b: u8| Some(value(a)? * 16 + value(b)?);
        match *digits {
            [r, g, b] => Some(Self([pair(r, r)?, pair(g, g)?, pair(b, b)?])),
            [a, b, c, d, e, f] => Some(Self([pair(a, b)?, pair(c, d)?, pair(e, f)?])),
            _ => None,
        }
    }

    /// Relative luminance (WCAG 2.2).
    fn luminance(self) -> f64 {
        let [r, g, b] = self.0.map(|channel| {
            let c = f64::from(channel) / 255.0;
            if c <= 0.040_45 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
        });
        0.2126 * r + 0.7152 * g + 0.0722 * b
    }

    /// From 1 to 21.
    fn contrast(self, other: Self) -> f64 {
        let (a, b) = (self.luminance() + 0.05, other.luminance() + 0.05);
        a.max(b) / a.min(b)
    }

    /// The lowest contrast that it has in a theme, as text and behind text.
    pub(crate) fn contrast_in(self, theme: Theme) -> f64 {
        theme.around().into_iter().map(|other| self.contrast(other)).fold(f64::INFINITY, f64::min)
    }

    /// Whether it can be read in a theme.
    pub(crate) fn suits(self, theme: Theme) -> bool {
        self.contrast_in(theme) >= CONTRAST
    }

    /// The nearest colour towards black, or in the dark theme towards white, that has enough contrast.
    pub(crate) fn adjusted(self, theme: Theme) -> Self {
        let end = if theme == Theme::Light { 0.0 } else { 255.0 };
        let mixed = |step: u32| {
            let share = f64::from(step) / f64::from(STEPS);
            Self(self.0.map(|c| (f64::from(c) + (end - f64::from(c)) * share).round() as u8))
        };
        (0..STEPS).map(mixed).find(|color| color.suits(theme)).unwrap_or_else(|| mixed(STEPS))
    }
}

impl fmt::Display for Rgb {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [r, g, b] = self.0;
        write!(f, "#{r:02x}{g:02x}{b:02x}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colors_are_read_in_both_forms_and_nothing_else_is() {
        assert_eq!(Rgb::parse("#0aF").map(|c| c.to_string()).as_deref(), Some("#00aaff"));
        assert_eq!(Rgb::parse("#9A5412").map(|c| c.to_string()).as_deref(), Some("#9a5412"));
        for bad in ["", "#", "9a5412", "#9a541", "#9a54123", "#ggg", "red", "#é12", "rgb(1,2,3)"] {
            assert_eq!(Rgb::parse(bad), None, "{bad}");
        }
    }

    #[test]
    fn contrast_is_that_of_wcag() {
        let of = |a: &str, b: &str| Rgb::parse(a).unwrap().contrast(Rgb::parse(b).unwrap());
        assert!((of("#000", "#fff") - 21.0).abs() < 1e-9);
        assert!((of("#777", "#fff") - 4.478).abs() < 1e-3);
        assert!((of("#36c", "#36c") - 1.0).abs() < 1e-9);
    }

    #[test]
    fn every_color_becomes_readable_in_both_themes_and_readable_ones_stay() {
        let steps = (0..=255u8).step_by(15);
        for r in steps.clone() {
            for g in steps.clone() {
                for b in steps.clone() {
                    for theme in [Theme::Light, Theme::Dark] {
                        let (color, adjusted) = (Rgb([r, g, b]), Rgb([r, g, b]).adjusted(theme));
                        assert!(adjusted.suits(theme), "{color} {adjusted} {theme:?}");
                        assert!(!color.suits(theme) || adjusted == color, "{color} {theme:?}");
                    }
                }
            }
        }
    }

    /// The style sheet that the accent is put into has the colours that it was compared with.
    #[test]
    fn the_surroundings_are_those_of_the_style_sheet() {
        let css = include_str!("../../../www/style.css");
        let (light, dark) = css.split_once("prefers-color-scheme: dark").unwrap();
        for (theme, css) in [(Theme::Light, light), (Theme::Dark, dark)] {
            for (name, color) in ["paper", "raised", "sunken", "on-accent"].into_iter().zip(theme.around()) {
                assert!(css.contains(&format!("--{name}: {color};")), "{theme:?} --{name} {color}");
            }
        }
    }
}
