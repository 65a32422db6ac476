"""Peer of event mode: python-can, cantools, Pinocchio and numpy as one would write it. echo.py URDF DBC IN OUT ID: after the frame with this
identifier a wrench in three frames, from the joints' inverse dynamics and a least squares of fixed rows."""

import sys

import can
import cantools
import numpy as np
import pinocchio as pin

urdf, dbc, source, target, last = sys.argv[1:]
model = pin.buildModelFromUrdf(urdf)
data = model.createData()
database = cantools.database.load_file(dbc)
rows = np.random.default_rng(1).normal(size=(8, 6))
signals, zero = {}, np.zeros(model.nv)
with can.Bus(interface="socketcan", channel=source) as near, can.Bus(interface="socketcan", channel=target) as far:
    print("ready", flush=True)
    for message in near:
        signals.update(database.decode_message(message.arbitration_id, message.data, decode_choices=False))
        if message.arbitration_id != int(last, 16):
            continue
        q = np.array([signals[f"Position{k}"] for k in range(1, 7)])
        counts = np.array([signals[f"Counts{k}"] for k in range(1, 9)])
        torques = pin.rnea(model, data, q, zero, zero)
        wrench = np.linalg.lstsq(rows, counts * 1e-6 - np.append(torques, [0.0, 0.0]), rcond=None)[0]
        raw = np.clip(wrench * 100, -32767, 32767).astype(">i2").tobytes()
        for number, part in ((0x400, raw[:6]), (0x401, raw[6:]), (0x402, raw[:6])):
            far.send(can.Message(arbitration_id=number, data=part + b"\0\0", is_extended_id=False))
