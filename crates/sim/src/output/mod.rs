//! Run directories (being built up).
