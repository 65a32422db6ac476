"""Does harm over the network until it is told to end: hostile.py HTTP RDT SOCKET. Then it tells what it got for it.

Kinds of attack, each on threads of its own: floods of datagrams and of forged starts, HTTP that is slow, huge, endless, hoarded or strange, a
control socket that is talked to and not listened to, and orders from a user who may give none. An answer that should not have been given ends it with an error.
"""

import collections
import os
import signal
import socket
import struct
import sys
import threading
import time

HOST = "127.0.0.1"
HTTP_PORTS = [int(port) for port in sys.argv[1].split(",")]
RDT_PORT = int(sys.argv[2])
CONTROL = sys.argv[3]
NOBODY = 65534

done = threading.Event()
counts = collections.Counter()
wrong = []


def attack(function, *arguments):
    """Goes on with an attack until the end, whatever the daemon does to the sockets."""

    def again():
        while not done.is_set():
            try:
                function(*arguments)
            except OSError:
                time.sleep(0.01)

    threading.Thread(target=again, daemon=True).start()


def request(command, count=0):
    return struct.pack(">HHI", 0x1234, command, count)


def flood(source):
    """Starts, stops and biases, and what is no request at all, from a host that does not hold the stream."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.bind((source, 0))
        sender.setblocking(False)
        kinds = [request(2), request(0), request(3, 5), b"", os.urandom(8), request(2) + b"x", os.urandom(1400)]
        if source == "127.0.0.2":  # outside of allow: nothing that it says may count
            kinds += [request(0x42), request(0x41)]
        while not done.is_set():
            for data in kinds:
                sender.sendto(data, (HOST, RDT_PORT))
                counts["datagrams"] += 1
            try:
                record = sender.recv(100)
                wrong.append(f"{source} got a record of {len(record)} bytes")
            except BlockingIOError:
                pass
            time.sleep(0.001)


def connect(port):
    client = socket.create_connection((HOST, port), timeout=5.0)
    counts["connections"] += 1
    return client


def slow(port):
    """A request that never ends, a byte at a time."""
    with connect(port) as client:
        for byte in b"GET / HTTP/1.1\r\n" + b"A: b\r\n" * 1000:
            client.sendall(bytes([byte]))
            if done.wait(0.1):
                return


def greedy(port):
    """Asks on and on and reads nothing."""
    with connect(port) as client:
        while not done.is_set():
            client.sendall(b"GET /metrics HTTP/1.1\r\nHost: x\r\n\r\n" * 100)
            counts["unread requests"] += 100
            time.sleep(0.01)


def hoard(port):
    """As many connections at a time as it gets, all silent."""
    clients = []
    try:
        while len(clients) < 500 and not done.is_set():
            clients.append(connect(port))
            counts["hoarded connections"] += 1
    finally:
        done.wait(1.0)
        for client in clients:
            client.close()


def local():
    """The control socket's own users, who may ask, misbehaving: a stream that nobody reads, a line without end, noise."""
    for data in [b'{"command": "stream", "rate_hz": 200}\n', b'{"command": "records"}\n', b"{" * 10_000_000, os.urandom(5000) + b"\n"]:
        with socket.socket(socket.AF_UNIX) as client:
            client.settimeout(5.0)
            client.connect(CONTROL)
            counts["control connections"] += 1
            try:
                client.sendall(data)
            except OSError:
                pass  # cut off, which is right
            done.wait(1.0)


STRANGE = [
    b"GET /../../etc/passwd HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n",
    b"GET //etc/passwd HTTP/1.0\r\n\r\n",
    b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 999999999999999\r\nConnection: close\r\n\r\n" + b"{}" * 50000,
    b"PUT /tare HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n",
    b"DELETE /metrics HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\nFFFFFFFFFFFFFFFFF\r\n",
    b"GET / HTTP/1.1\r\n" + b"A: " + b"b" * 1_000_000 + b"\r\n\r\n",
    b"GET /" + b"a" * 1_000_000 + b" HTTP/1.1\r\n\r\n",
    b"GET / HTTP/1.1\r\n" + b"".join(b"H%d: x\r\n" % k for k in range(1000)) + b"\r\n",
    b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
    b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(500),
    os.urandom(3000),
]


def strange(port):
    """Requests that are none of a reader's; no answer may be what a file or an order would give."""
    for data in STRANGE:
        answer = b""
        try:
            with connect(port) as client:
                client.sendall(data)
                while len(answer) < 100_000 and (part := client.recv(4096)):
                    answer += part
        except OSError:
            pass  # cut off, which is right
        if answer:
            counts["answers"] += 1
        if answer and not answer.startswith((b"HTTP/1.1 4", b"HTTP/1.0 4")):
            wrong.append(f"{data[:40]!r} was answered by {answer[:200]!r}")
        if done.is_set():
            return


REFUSED, LET_IN, UNTRIED = range(3)


def orders():
    """Another user's orders. By a fork: the interpreter itself may lie where only its owner can run it."""
    child = os.fork()
    if child == 0:
        code = UNTRIED
        try:
            os.setgroups([])
            os.setgid(NOBODY)
            os.setuid(NOBODY)
            socket.socket(socket.AF_UNIX).connect(CONTROL)
            code = LET_IN
        except PermissionError:
            code = REFUSED
        finally:
            os._exit(code)
    # Untried: those who hoard connections may have left no descriptor for this one.
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    counts["orders"] += code == REFUSED
    if code == LET_IN:
        wrong.append("a stranger was not refused by the control socket")
    done.wait(1.0)


signal.signal(signal.SIGTERM, lambda *_: done.set())
attack(flood, "127.0.0.2")
attack(flood, "127.0.0.3")
attack(orders)
attack(local)
for port in HTTP_PORTS:
    attack(greedy, port)
    attack(strange, port)
    attack(hoard, port)
    for _ in range(20):
        attack(slow, port)
print("begun", flush=True)
done.wait()
for name, count in sorted(counts.items()):
    print(name, count)
for words in sorted(set(wrong)):
    print("WRONG", words)
sys.exit(bool(wrong))
