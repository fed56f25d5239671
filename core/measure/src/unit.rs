//! Units that values are shown in. Values are stored in metres (square, cubic) and radians, and showing them otherwise never changes
//! what is stored.

use crate::quantity::Quantity;
use serde::{Deserialize, Serialize};

/// What kind of quantity a value is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Dimension {
    /// Metres.
    Length,
    /// Square metres.
    Area,
    /// Cubic metres.
    Volume,
    /// Radians.
    Angle,
    /// A share, 1 is all.
    Ratio,
}

/// A unit of length; areas and volumes are shown in its powers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum LengthUnit {
    /// Metres.
    #[default]
    #[serde(rename = "m")]
    Metre,
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
    /// US survey feet: 1200/3937 m.
    #[serde(rename = "ftUS")]
    SurveyFoot,
    /// Inches: 0.0254 m.
    #[serde(rename = "in")]
    Inch,
}

impl LengthUnit {
    /// All units with their symbols.
    pub const ALL: [(Self, &'static str); 7] = [
        (Self::Metre, "m"),
        (Self::Centimetre, "cm"),
        (Self::Millimetre, "mm"),
        (Self::Kilometre, "km"),
        (Self::Foot, "ft"),
        (Self::SurveyFoot, "ftUS"),
        (Self::Inch, "in"),
    ];

    /// The unit of a symbol.
    pub fn from_symbol(symbol: &str) -> Option<Self> {
        Self::ALL.iter().find(|(_, s)| *s == symbol).map(|(unit, _)| *unit)
    }

    /// Its symbol.
    pub fn symbol(self) -> &'static str {
        Self::ALL.iter().find(|(unit, _)| *unit == self).map_or("m", |(_, s)| s)
    }

    /// A length of one of it, in metres: numerator and denominator, both exact.
    fn metres(self) -> (f64, f64) {
        match self {
            Self::Metre => (1.0, 1.0),
            Self::Centimetre => (1.0, 100.0),
            Self::Millimetre => (1.0, 1000.0),
            Self::Kilometre => (1000.0, 1.0),
            Self::Foot => (3048.0, 10_000.0),
            Self::SurveyFoot => (1200.0, 3937.0),
            Self::Inch => (254.0, 10_000.0),
        }
    }

    /// A stored quantity in this unit (degrees for angles, per cent for shares), with its symbol.
    pub fn show(self, quantity: Quantity, dimension: Dimension) -> (Quantity, String) {
        let (numerator, denominator) = self.metres();
        let power = match dimension {
            Dimension::Length => 1,
            Dimension::Area => 2,
            Dimension::Volume => 3,
            Dimension::Angle => return (each(quantity, f64::to_degrees), "°".to_owned()),
            Dimension::Ratio => return (each(quantity, |x| x * 100.0), "%".to_owned()),
        };
        let shown = each(quantity, |x| (0..power).fold(x, |x, _| x * denominator / numerator));
        let symbol = self.symbol();
        let raised = match (self, power) {
            (_, 1) => symbol.to_owned(),
            (Self::SurveyFoot, 2) => "ft²US".to_owned(),
            (Self::SurveyFoot, _) => "ft³US".to_owned(),
            (_, 2) => format!("{symbol}²"),
            _ => format!("{symbol}³"),
        };
        (shown, raised)
    }
}

fn each(q: Quantity, by: impl Fn(f64) -> f64) -> Quantity {
    Quantity { value: by(q.value), uncertainty: by(q.uncertainty) }
}

/// One named value of a measurement: `straight`, `plan`, `volume` …
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Reading {
    /// Its name, English and stable: files and translations refer to it.
    pub name: String,
    /// What kind of quantity.
    pub dimension: Dimension,
    /// The value and its standard uncertainty, in metres, square or cubic metres, radians.
    #[serde(flatten)]
    pub quantity: Quantity,
}

impl Reading {
    /// A reading.
    pub fn new(name: &str, dimension: Dimension, value: f64, uncertainty: f64) -> Self {
        Self { name: name.to_owned(), dimension, quantity: Quantity { value, uncertainty } }
    }

    /// Value, uncertainty and unit as text: what the page and the command line print.
    pub fn text(&self, unit: LengthUnit) -> String {
        let (quantity, symbol) = unit.show(self.quantity, self.dimension);
        format!("{quantity} {symbol}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_areas_and_volumes_are_shown_in_the_right_power_of_the_unit() {
        let r = |dimension, value| Reading::new("x", dimension, value, 0.001);
        assert_eq!(r(Dimension::Length, 1234.5).text(LengthUnit::Kilometre), "1.2345000 ± 0.0000010 km");
        assert_eq!(r(Dimension::Length, 0.3048).text(LengthUnit::Foot), "1.0000 ± 0.0033 ft");
        assert_eq!(r(Dimension::Length, 1200.0 / 3937.0).text(LengthUnit::SurveyFoot), "1.0000 ± 0.0033 ftUS");
        assert_eq!(r(Dimension::Area, 1.0).text(LengthUnit::Centimetre), "10000 ± 10 cm²");
        assert_eq!(r(Dimension::Volume, 1.0).text(LengthUnit::Inch), "61024 ± 61 in³");
        assert_eq!(r(Dimension::Angle, std::f64::consts::FRAC_PI_2).text(LengthUnit::Metre), "90.000 ± 0.057 °");
        for (unit, symbol) in LengthUnit::ALL {
            assert_eq!(LengthUnit::from_symbol(symbol), Some(unit));
        }
        assert_eq!(LengthUnit::from_symbol("furlong"), None);
    }
}
