//! Units of length.

use serde::{Deserialize, Serialize};

/// A unit of length. In files it is its symbol.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum LengthUnit {
    /// Metres.
    #[default]
    #[serde(rename = "m")]
    Metre,
    /// Decimetres.
    #[serde(rename = "dm")]
    Decimetre,
    /// Centimetres.
    #[serde(rename = "cm")]
    Centimetre,
    /// Millimetres.
    #[serde(rename = "mm")]
    Millimetre,
    /// Kilometres.
    #[serde(rename = "km")]
    Kilometre,
    /// International feet: 0.3048 m.
    #[serde(rename = "ft")]
    Foot,
    /// US survey feet: 1200/3937 m. Earlier versions of the measuring tools called them `ftUS`.
    #[serde(rename = "us-ft", alias = "ftUS")]
    UsSurveyFoot,
    /// Inches: 0.0254 m.
    #[serde(rename = "in")]
    Inch,
}

impl LengthUnit {
    /// All of them, in the order in which they are listed for people.
    pub const ALL: [Self; 8] = [
        Self::Metre,
        Self::Decimetre,
        Self::Centimetre,
        Self::Millimetre,
        Self::Kilometre,
        Self::Foot,
        Self::UsSurveyFoot,
        Self::Inch,
    ];

    /// Its symbol: in files, on the command line, after a value.
    pub fn symbol(self) -> &'static str {
        match self {
            Self::Metre => "m",
            Self::Decimetre => "dm",
            Self::Centimetre => "cm",
            Self::Millimetre => "mm",
            Self::Kilometre => "km",
            Self::Foot => "ft",
            Self::UsSurveyFoot => "us-ft",
            Self::Inch => "in",
        }
    }

    /// The unit of a symbol, or of `ftUS`, the earlier symbol of the US survey foot.
    pub fn parse(symbol: &str) -> Option<Self> {
        if symbol == "ftUS" {
            return Some(Self::UsSurveyFoot);
        }
        Self::ALL.into_iter().find(|unit| unit.symbol() == symbol)
    }

    /// All symbols, for a message: `m, dm, cm, mm, km, ft, us-ft, in`.
    pub fn symbols() -> String {
        Self::ALL.map(Self::symbol).join(", ")
    }

    /// One of it in metres, as a fraction: numerator and denominator, both exact.
    pub fn fraction(self) -> (f64, f64) {
        match self {
            Self::Metre => (1.0, 1.0),
            Self::Decimetre => (1.0, 10.0),
            Self::Centimetre => (1.0, 100.0),
            Self::Millimetre => (1.0, 1000.0),
            Self::Kilometre => (1000.0, 1.0),
            Self::Foot => (3048.0, 10_000.0),
            Self::UsSurveyFoot => (1200.0, 3937.0),
            Self::Inch => (254.0, 10_000.0),
        }
    }

    /// One of it in metres.
    pub fn metres(self) -> f64 {
        let (numerator, denominator) = self.fraction();
        numerator / denominator
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_symbol_is_read_back_and_the_metres_are_the_decimal_numbers() {
        for unit in LengthUnit::ALL {
            assert_eq!(LengthUnit::parse(unit.symbol()), Some(unit));
        }
        assert_eq!(LengthUnit::parse("ftUS"), Some(LengthUnit::UsSurveyFoot));
        assert_eq!(LengthUnit::parse("furlong"), None);
        assert_eq!(LengthUnit::symbols(), "m, dm, cm, mm, km, ft, us-ft, in");
        let metres = [1.0, 0.1, 0.01, 0.001, 1000.0, 0.3048, 1200.0 / 3937.0, 0.0254];
        assert_eq!(LengthUnit::ALL.map(LengthUnit::metres), metres);
    }
}
