"""Peer of the decoder: python-can reads a log, cantools decodes it. decode.py DBC LOG: seconds of the processor, and the sum of all signals."""

import sys
import time

import can
import cantools

database = cantools.database.load_file(sys.argv[1])
begun = time.process_time()
total = 0.0
for message in can.CanutilsLogReader(sys.argv[2]):
    definition = database.get_message_by_frame_id(message.arbitration_id)
    total += sum(definition.decode(message.data, decode_choices=False).values())
print(time.process_time() - begun, repr(total))
