//! The arithmetic of colouring a surface from photographs: the tone of every photograph ([`tone`]), and one colour from what several photographs
//! show ([`blend`]). Light is linear, 0 to 1 in a photograph.

pub mod blend;
pub mod tone;
