//! Links and obstacles whose geometry has no robots and no obstacles of its own.

mod hull;
mod point;
mod segment;
