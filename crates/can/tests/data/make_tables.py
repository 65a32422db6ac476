#!/usr/bin/env python3
"""Makes the truth tables beside this file: decoding by cantools.

    python3 -m venv venv && venv/bin/pip install cantools==45.1.0 && venv/bin/python make_tables.py
"""
import pathlib
import random

import cantools

here = pathlib.Path(__file__).parent
random.seed(20261122)
dbc = cantools.database.load_file(here / "odd.dbc", strict=False)
rows = []
for message in dbc.messages:
    for trial in range(40):
        data = bytearray(random.randbytes(message.length))
        if trial == 0:
            data = bytearray(message.length)
        if trial == 1:
            data = bytearray(b"\xff" * message.length)
        if message.name == "Paged":
            data[0] = random.choice([0, 3])
        if message.name == "Nested":
            data[0], data[1] = random.choice([(1, 2), (1, 5), (1, 7), (4, 2)])
        try:
            values = message.decode(bytes(data), decode_choices=False)
        except cantools.database.errors.DecodeError:
            continue
        text = " ".join(f"{name}={float(value)!r}" for name, value in sorted(values.items()))
        identifier = message.frame_id | (0x80000000 if message.is_extended_frame else 0)
        rows.append(f"{identifier:08X} {data.hex()} {text}")
(here / "cantools.txt").write_text("\n".join(rows) + "\n")
print(len(rows), "frames decoded by cantools", cantools.__version__)
