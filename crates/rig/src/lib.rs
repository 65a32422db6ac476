//! A robot as configured: configuration, run directories, and the cycle from CAN frames to a wrench
