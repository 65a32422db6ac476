//! CAN frames, DBC decode tables, candump logs, sources, and assembly of gauge and joint snapshots
