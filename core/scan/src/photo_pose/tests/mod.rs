mod frames;
mod motions;
mod photographs;
