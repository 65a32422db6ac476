//! Whole-program tests of wrenchd
