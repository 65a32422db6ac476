"""Rewrites the DBC of arm A so that each round is one CAN FD frame: fd_dbc.py ARM_A.dbc > ARM_FD.dbc.

The payloads of the seven messages of a round follow each other, so a signal's start moves by 64 bits a message.
"""

import re
import sys

ROUND = [0x201, 0x202, 0x203, 0x101, 0x102, 0x103, 0x104]


def main():
    out, place, signals, within_round = [], None, {}, False
    for line in open(sys.argv[1], encoding="utf-8"):
        line = line.rstrip("\n")
        message = re.match(r"BO_ (\d+) \w+: 8 (\w+)$", line)
        signal = re.match(r"( SG_ \w+ : )(\d+)(\|\d+@1.*)$", line)
        if message and int(message[1]) in ROUND:
            place, within_round = ROUND.index(int(message[1])), True
            signals[place] = []
        elif within_round and signal:
            signals[place].append(f"{signal[1]}{int(signal[2]) + 64 * place}{signal[3]}")
        elif within_round and not line:
            within_round = False
        else:
            within_round = False
            out.append(line)
    head = out.index(next(line for line in out if line.startswith("BU_"))) + 1
    merged = ["", "BO_ 384 Round: 64 GAUGES"] + [line for place in sorted(signals) for line in signals[place]]
    print("\n".join(out[:head] + merged + out[head:]).rstrip("\n"))


main()
