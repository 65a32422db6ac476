//! The arm and its gauges run forwards: motions, loads, noise, CAN frames, run directories
