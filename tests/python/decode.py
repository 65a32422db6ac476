"""Decodes a candump log with cantools: decode.py DBC LOG.

One line a frame: stamp, message name, then name=value for each signal, numbers written so that they read back exactly.
Neither the parsing of the log (python-can) nor the decoding (cantools) is the project's own. A frame that the DBC does
not know ends the program with an error.
"""

import sys

import can
import cantools


def main():
    dbc, log = sys.argv[1:]
    database = cantools.database.load_file(dbc)
    out = []
    for message in can.CanutilsLogReader(log):
        if message.is_error_frame:
            continue
        definition = database.get_message_by_frame_id(message.arbitration_id)
        signals = definition.decode(message.data, decode_choices=False)
        words = [f"{message.timestamp!r}", definition.name]
        words += [f"{name}={float(value)!r}" for name, value in signals.items()]
        out.append(" ".join(words))
    sys.stdout.write("\n".join(out) + "\n" if out else "")


main()
