//! Command-line tool of wrenchd: calibrate, validate, simulate, replay, dump, demo
