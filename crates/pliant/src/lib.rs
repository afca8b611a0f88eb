//! pliant
