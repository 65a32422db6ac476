"""What a ROS 2 node over zenoh gets of a wrench: eclipse-zenoh in the place of rmw_zenoh, CDR decoded by hand.

ros2_peer.py PORT: listens there, says "listening", then one line for each token of the graph and each message, until it is ended.
"""

import struct
import sys
import threading

import zenoh

lock = threading.Lock()


def say(*words):
    with lock:
        print(*words, flush=True)


def text(data, at):
    at += -(at - 4) % 4
    (length,) = struct.unpack_from("<I", data, at)
    assert data[at + 3 + length] == 0, "a string without its zero"
    return data[at + 4 : at + 3 + length].decode(), at + 4 + length


def wrench(data):
    assert data[:4] == bytes([0, 1, 0, 0]), "not plain little-endian CDR"
    sec, nanosec = struct.unpack_from("<iI", data, 4)
    frame, at = text(data, 12)
    at += -(at - 4) % 8
    assert len(data) == at + 48, "more or less than a WrenchStamped"
    return [sec, nanosec, frame, *struct.unpack_from("<6d", data, at)]


def diagnostics(data):
    _, at = text(data, 12)
    at += -(at - 4) % 4
    (count,) = struct.unpack_from("<I", data, at)
    assert count == 1
    level = data[at + 4]
    name, at = text(data, at + 5)
    message, at = text(data, at)
    _, at = text(data, at)
    at += -(at - 4) % 4
    (values,) = struct.unpack_from("<I", data, at)
    at += 4
    for _ in range(2 * values):
        _, at = text(data, at)
    assert at == len(data), "more or less than a DiagnosticArray"
    return [level, values, name, message]


def heard(sample):
    key, data, attachment = str(sample.key_expr), bytes(sample.payload), bytes(sample.attachment)
    number, stamp, length = struct.unpack_from("<qqB", attachment)
    assert length == 16 and len(attachment) == 33, "not rmw_zenoh's attachment"
    decode = wrench if "WrenchStamped" in key else diagnostics
    say("message", key, number, stamp, attachment[17:].hex(), *decode(data))


config = zenoh.Config()
config.insert_json5("mode", '"peer"')
config.insert_json5("listen/endpoints", f'["tcp/127.0.0.1:{sys.argv[1]}"]')
config.insert_json5("scouting/multicast/enabled", "false")
with zenoh.open(config) as session:
    tokens = session.liveliness().declare_subscriber(
        "@ros2_lv/**", lambda sample: say("token", str(sample.kind).rpartition(".")[2], sample.key_expr), history=True
    )
    messages = session.declare_subscriber("7/**", heard)
    say("listening")
    threading.Event().wait()
