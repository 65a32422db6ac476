//! Each fuzz target: the executable's name says which.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| {
    wrenchd_fuzz::target(env!("CARGO_BIN_NAME"))(data);
});
