//! Real-time daemon: end-effector wrench from joint torque sensors over SocketCAN
