//! Units that values are shown in. Values are stored in metres (square, cubic) and radians, and showing them otherwise never changes
//! what is stored.

use crate::quantity::{Quantity, decimals};
use kilwa_geometry::LengthUnit;
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

/// A stored quantity in a unit of length or its powers (degrees for angles, per cent for shares), with the symbol.
pub fn shown(quantity: Quantity, dimension: Dimension, unit: LengthUnit) -> (Quantity, String) {
    let (numerator, denominator) = unit.fraction();
    let (power, raised) = match dimension {
        Dimension::Length => (1, ""),
        Dimension::Area => (2, "²"),
        Dimension::Volume => (3, "³"),
        Dimension::Angle => return (each(quantity, f64::to_degrees), "°".to_owned()),
        Dimension::Ratio => return (each(quantity, |x| x * 100.0), "%".to_owned()),
    };
    let shown = each(quantity, |x| (0..power).fold(x, |x, _| x * denominator / numerator));
    (shown, format!("{}{raised}", unit.symbol()))
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
    /// Only if the accuracy of the capture is unknown, in the unit of the value: the uncertainty if every coordinate were as uncertain as the
    /// spacing of the mesh is wide. No digit below its first is printed, because nothing is known of the surface between the vertices.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub resolution: Option<f64>,
}

impl Reading {
    /// A reading.
    pub fn new(name: &str, dimension: Dimension, value: f64, uncertainty: f64) -> Self {
        Self { name: name.to_owned(), dimension, quantity: Quantity { value, uncertainty }, resolution: None }
    }

    /// Value, uncertainty and unit as text: what the page and the command line print. The uncertainty is in parentheses if the accuracy of the capture
    /// is unknown, because the whole is larger than what is printed.
    pub fn text(&self, unit: LengthUnit) -> String {
        let (quantity, symbol) = shown(self.quantity, self.dimension, unit);
        let Some(resolution) = self.resolution else { return format!("{quantity} {symbol}") };
        let Quantity { value, uncertainty } = quantity;
        let resolution = shown(Quantity { value: resolution, uncertainty: 0.0 }, self.dimension, unit).0.value;
        let own = decimals(uncertainty);
        let digits = own.min((-libm::floor(libm::log10(resolution))).clamp(0.0, 12.0) as usize);
        format!("{value:.digits$} {symbol} (± {uncertainty:.own$} {symbol})")
    }

    /// Whether the same value was found, to the last bit. Its uncertainty may differ: later versions know more of what it consists of.
    pub fn is_same(&self, other: &Self) -> bool {
        (&self.name, self.dimension, self.quantity.value) == (&other.name, other.dimension, other.quantity.value)
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
        assert_eq!(r(Dimension::Length, 1200.0 / 3937.0).text(LengthUnit::UsSurveyFoot), "1.0000 ± 0.0033 us-ft");
        assert_eq!(r(Dimension::Area, 1.0).text(LengthUnit::Centimetre), "10000 ± 10 cm²");
        assert_eq!(r(Dimension::Volume, 1.0).text(LengthUnit::Inch), "61024 ± 61 in³");
        assert_eq!(r(Dimension::Angle, std::f64::consts::FRAC_PI_2).text(LengthUnit::Metre), "90.000 ± 0.057 °");
    }

    #[test]
    fn without_the_accuracy_of_the_capture_no_digit_is_finer_than_the_mesh() {
        let text = |value, uncertainty, resolution: f64, unit| {
            let reading = Reading::new("straight", Dimension::Length, value, uncertainty);
            Reading { resolution: Some(resolution), ..reading }.text(unit)
        };
        assert_eq!(text(20.536_20, 0.000_4, 0.074, LengthUnit::Metre), "20.54 m (± 0.00040 m)");
        assert_eq!(text(20.536_20, 0.000_4, 0.074, LengthUnit::Millimetre), "20536 mm (± 0.40 mm)");
        // Pointing is worse than the mesh: its digits count.
        assert_eq!(text(20.536_20, 0.52, 0.074, LengthUnit::Metre), "20.54 m (± 0.52 m)");
        assert_eq!(text(20.536_20, 5.2, 0.074, LengthUnit::Metre), "20.5 m (± 5.2 m)");
        assert_eq!(text(20.536_20, 0.000_4, 1e-9, LengthUnit::Metre), "20.53620 m (± 0.00040 m)");
    }
}
