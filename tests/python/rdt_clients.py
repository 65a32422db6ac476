"""Two Net F/T clients from PyPI, unmodified, against a daemon on this computer: rdt_clients.py HTTP_PORT.

One line a record: how it was got, its sample number where the client gives one, force (N) and moment (Nm). What a client
shows to be wrong with the protocol ends the program with an error.
"""

import sys
import time

import NetFT
import pynetft

HOST = "127.0.0.1"
COUNTS_PER_UNIT = 1e6


def say(how, sample, wrench):
    print(how, sample, *(repr(float(value)) for value in wrench), flush=True)


def netft():
    sensor = NetFT.Sensor(HOST)
    sensor.sock.settimeout(10.0)
    for _ in range(20):
        say("polled", -1, [count / COUNTS_PER_UNIT for count in sensor.getMeasurement()])
    sensor.startStreaming(handler=False)
    for _ in range(100):
        say("streamed", -1, [count / COUNTS_PER_UNIT for count in sensor.receive()])
    sensor.stopStreaming()


def client(http_port):
    config = pynetft.Config(HOST, http_port=http_port, receive_timeout=2.0, configuration_timeout=10.0)
    with pynetft.Client(config, queue_size=1000) as client:
        assert client.wait_for_first_sample(20.0)
        calibration = client.health().sensor_configuration.calibration
        assert calibration.counts_per_force_unit == COUNTS_PER_UNIT, calibration
        samples = client.samples(timeout=10.0)
        last, longest = None, 0
        for sample in (next(samples) for _ in range(200)):
            assert sample.status == 0, sample
            # On a busy computer the client gives a stream up and asks for another.
            if sample.rdt_sequence == 1:
                last = None
            longest = max(longest, sample.rdt_sequence)
            assert last is None or sample.rdt_sequence == last.rdt_sequence + 1, (last, sample)
            assert last is None or sample.ft_sequence == last.ft_sequence + 1, (last, sample)
            say("client", sample.ft_sequence, [*sample.force, *sample.torque])
            last = sample
        assert longest >= 30, "no stream of 30 records"
        client.bias()
        begun = time.monotonic()
        for sample in samples:
            if sum(value**2 for value in sample.force) < 0.3**2:
                say("biased", sample.ft_sequence, [*sample.force, *sample.torque])
                return
            assert time.monotonic() - begun < 20.0, sample


netft()
client(int(sys.argv[1]))
