//! Units of length and the up axis of a mesh file.

/// The axis that points up in the source.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub enum Up {
    /// z is up: stored as it is.
    Z,
    /// y is up: (x, y, z) is stored as (x, -z, y).
    Y,
}

/// Units of the source.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub enum Units {
    /// Metres.
    Metre,
    /// Decimetres.
    Decimetre,
    /// Centimetres.
    Centimetre,
    /// Millimetres.
    Millimetre,
    /// Kilometres.
    Kilometre,
    /// International feet, 0.3048 m.
    Foot,
    /// US survey feet, 1200/3937 m.
    UsSurveyFoot,
    /// Inches, 0.0254 m.
    Inch,
}

impl Units {
    /// Name as accepted on the command line and stored in the metadata.
    pub fn name(self) -> &'static str {
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

    /// Metres in one unit.
    pub fn metres(self) -> f64 {
        match self {
            Self::Metre => 1.0,
            Self::Decimetre => 0.1,
            Self::Centimetre => 0.01,
            Self::Millimetre => 0.001,
            Self::Kilometre => 1000.0,
            Self::Foot => 0.3048,
            Self::UsSurveyFoot => 1200.0 / 3937.0,
            Self::Inch => 0.0254,
        }
    }

    /// The unit of that name.
    pub fn parse(name: &str) -> Option<Self> {
        [
            Self::Metre,
            Self::Decimetre,
            Self::Centimetre,
            Self::Millimetre,
            Self::Kilometre,
            Self::Foot,
            Self::UsSurveyFoot,
            Self::Inch,
        ]
        .into_iter()
        .find(|u| u.name() == name)
    }
}
