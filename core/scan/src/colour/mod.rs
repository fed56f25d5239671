//! The arithmetic of colouring a surface from photographs: the exposure of every photograph ([`tone`]), and one colour out of what several photographs
//! show ([`blend`]). Light is linear, 0 to 1 in a photograph.

pub mod blend;
pub mod tone;
