"""Peer of the sender: python-can sends one frame after the other. send.py CHANNEL COUNT: us a frame."""

import sys
import time

import can

count = int(sys.argv[2])
with can.Bus(interface="socketcan", channel=sys.argv[1]) as bus:
    message = can.Message(arbitration_id=0x101, data=bytes(range(1, 9)), is_extended_id=False)
    begun = time.perf_counter()
    for _ in range(count):
        bus.send(message)
    print((time.perf_counter() - begun) * 1e6 / count)
