"""Reads an MCAP file with the mcap packages from PyPI: read_mcap.py FILE prints its summary, then every message decoded."""

import sys

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

with open(sys.argv[1], "rb") as file:
    reader = make_reader(file, decoder_factories=[DecoderFactory()], validate_crcs=True)
    summary = reader.get_summary()
    print("profile", reader.get_header().profile)
    for channel in summary.channels.values():
        schema = summary.schemas[channel.schema_id]
        count = summary.statistics.channel_message_counts.get(channel.id, 0)
        print("channel", channel.topic, schema.name, schema.encoding, channel.message_encoding, count)
    for schema, channel, message, decoded in reader.iter_decoded_messages():
        stamp = decoded.header.stamp.sec * 1_000_000_000 + decoded.header.stamp.nanosec
        words = ["message", channel.topic, message.log_time, stamp, decoded.header.frame_id if channel.topic != "/diagnostics" else "-"]
        if channel.topic == "/wrench":
            force, torque = decoded.wrench.force, decoded.wrench.torque
            words += [force.x, force.y, force.z, torque.x, torque.y, torque.z]
        elif channel.topic.endswith("/fd"):
            assert decoded.len == len(decoded.data)
            words += [f"{decoded.id:03X}##{bytes(decoded.data).hex().upper()}", decoded.is_extended, decoded.is_error]
        elif channel.topic.startswith("/can/"):
            data = bytes(decoded.data)[: decoded.dlc].hex().upper()
            words += [f"{decoded.id:03X}#{data}", decoded.is_extended, decoded.is_rtr, decoded.is_error]
        else:
            (status,) = decoded.status
            words += [int.from_bytes(status.level, "little") if isinstance(status.level, bytes) else status.level, status.message]
        print(*words)
