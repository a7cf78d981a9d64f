# SPDX-License-Identifier: MIT
"""Code shared by all bridges: encoding of the bridge protocol (drivers/BRIDGES.md), a server for one
client, and a loop that reopens the device after it has been unplugged."""
import argparse
import collections
import json
import pathlib
import selectors
import signal
import socket
import struct
import sys
import threading
import time

import pack
from pack import np

HELLO, TAGS, DEPTH, BYE, HISTOGRAM, RANGE_PROFILE = range(6)
HEADER_BYTES, MAX_PAYLOAD_BYTES = 32, 16 << 20
USAGE, NO_DEVICE = 2, 4  # exit codes of the echofuse programs

QUEUE_BYTES = 256 << 20  # maximum size of the send queue; further blocks are dropped and counted
BLOCKS_A_TURN = 16       # maximum number of blocks to send before the server handles other events
HELLO_PAUSE_S = 0.5      # the protocol requires a heartbeat at least every second
FAREWELL_S = 2.0         # time limit for sending the rest of the queue when the program ends
DEAD_CLIENT_MS = 10_000  # a client that acknowledges nothing for this long is disconnected
LONGEST_RETRY_S = 2.0
VERSION = "0.3.0"  # version of the echofuse programs


def say(text):
    print(f"{pathlib.Path(sys.argv[0]).stem}: {text}", file=sys.stderr, flush=True)


def parser(text, epilog=""):
    """Returns an argument parser with the option --version; its --help text ends with the exit
    codes."""
    made = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter,
                                   epilog=f"{epilog}\nexit codes: 0 ok, 1 failed, 2 usage, 4 device".strip())
    made.add_argument("--version", action="version", version=f"%(prog)s {VERSION}")
    return made


def fail(text, code=NO_DEVICE):
    say(text)
    sys.exit(code)


def require_packages():
    if pack.MISSING:  # --help works without the packages
        fail(f"{pack.MISSING}; the bridges require numpy, and also crc32c if {pack.NAME} is missing (Debian packages: "
             "python3-numpy python3-crc32c)" + (f"; {pack.failure}" if pack.failure else ""))


def block(kind, sequence, payload, dropped=0):
    """Returns the header of a block for this payload, which must support Python's buffer protocol."""
    header = struct.pack("<4sHHIIQI", b"EFBR", 1, kind, sequence & 0xFFFFFFFF, len(payload),
                         dropped, 0)
    return header + struct.pack("<I", pack.crc32c(payload, pack.crc32c(header)))


def histogram(counts, first_bin_ps, bin_width_ps, exposure_s, pulses=0, time_us=None):
    """Returns the payload of a histogram block. counts: shape [bins] or [zones, bins]. pulses: number of laser
    pulses; 0 if unknown. time_us: device time at the end of the exposure; None: time.monotonic() of this machine."""
    counts = np.atleast_2d(np.asarray(counts, "<u4"))
    return struct.pack("<IIQQddI", *counts.shape, microseconds(time_us), pulses, first_bin_ps,
                       bin_width_ps, round(1e6 * exposure_s)) + counts.tobytes()


def range_profile(power, first_m, step_m, number, time_us=None):
    """Returns the payload of a range profile block. power: linear power per bin, in any scale. number: frame number.
    time_us: device time, us; None: time.monotonic() of this machine."""
    power = np.asarray(power, "<f4")
    return struct.pack("<IIQff", len(power), number & 0xFFFFFFFF, microseconds(time_us), first_m,
                       step_m) + power.tobytes()


def microseconds(time_us):
    return round(time.monotonic() * 1e6 if time_us is None else time_us)


# A block that is waiting in the send queue.
Waiting = collections.namedtuple("Waiting", "kind sequence payload dropped items")


def listen_address(text):
    """Parses HOST:PORT or [IPV6]:PORT for argparse; returns (host, port)."""
    host, colon, port = text.rpartition(":")
    if not colon or not host or not port.isdigit() or int(port) > 65535:
        raise argparse.ArgumentTypeError(f"{text!r}: expected HOST:PORT")
    return host.strip("[]"), int(port)


def number(kind, low, high):
    """Returns an argparse type that accepts numbers of type `kind` (int or float) from low to high."""
    def parse(text):
        try:
            value = kind(text)
        except ValueError:
            value = None
        if value is None or not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text!r}: expected a number from {low} to {high}")
        return value
    return parse


class Server:
    """Serves one client at a time; a second client gets a BYE block.

    Threads: the device's thread calls send(), lose(), online(), offline() and close(); the server's
    own thread owns the sockets and `_rest`. `_lock` guards the queue and the counts."""

    def __init__(self, address, queue_bytes=QUEUE_BYTES):
        family = socket.AF_INET6 if ":" in address[0] else socket.AF_INET
        self._listener = socket.create_server(address, family=family)
        self._listener.setblocking(False)
        self.address = self._listener.getsockname()[:2]
        self._wake_out, self._wake_in = socket.socketpair()
        self._wake_out.setblocking(False)
        self._wake_in.setblocking(False)
        self._selector = selectors.DefaultSelector()
        for source in (self._listener, self._wake_out):
            self._selector.register(source, selectors.EVENT_READ)
        self._lock = threading.Lock()
        self._limit = queue_bytes
        # Elements of type Waiting. The first block stays in the queue until its last byte is sent.
        self._queue = collections.deque()
        self._rest = []  # unsent parts of the header and payload of the first block in the queue
        self._queued_bytes = 0
        self._client = None
        self._events = 0  # client socket events for which the selector is waiting
        self._hello = None  # payload of the HELLO block; None while the device is closed
        self._sequence = self._lost = 0
        self._leaving = False
        self._closed_by = None
        self._last_hello = 0.0
        self.clients = self.sent = self.dropped = 0
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    # The device's thread calls the methods below.

    def online(self, hello):
        """Starts accepting clients; called when the device has been opened."""
        with self._lock:
            self._hello = json.dumps(hello).encode()

    def offline(self):
        """Disconnects the client; called when the device has been unplugged."""
        with self._lock:
            self._hello = None
            self._part()
        self._wake()

    def send(self, kind, payload, items):
        """Queues a block if a client is connected. The caller must not change the payload afterwards."""
        with self._lock:
            if self._client is None or self._leaving:
                return
            if self._queued_bytes + HEADER_BYTES + len(payload) > self._limit:
                self._count_lost(items)
                return
            idle = not self._queue
            self._put(kind, payload, items)
        if idle:
            self._wake()

    def lose(self, items):
        """Adds to the number of lost items, which is reported with the next block."""
        with self._lock:
            if self._client is not None:
                self._count_lost(items)

    def check(self):
        """Ends the program with exit code 1 if the server's thread has failed."""
        if not self._thread.is_alive():
            fail("the server has failed", 1)

    def close(self):
        with self._lock:
            self._hello = None
            self._closed_by = time.monotonic() + FAREWELL_S
            self._part()
        self._wake()
        self._thread.join()

    # _lock guards the queue and the counts

    def _count_lost(self, items):
        self._lost += items
        self.dropped += items

    def _put(self, kind, payload, items=0):
        self._queue.append(Waiting(kind, self._sequence, payload, self._lost, items))
        self._queued_bytes += HEADER_BYTES + len(payload)
        self._sequence += 1
        self._lost = 0

    def _part(self):
        if self._client is not None and not self._leaving:
            self._put(BYE, b"")
            self._leaving = True

    # The server's own thread runs the methods below, except _wake().

    def _wake(self):
        try:
            self._wake_in.send(b"w")
        except OSError:
            pass  # the pipe is full (the thread is already awake) or closed

    def _run(self):
        while self._step():
            pass
        for each in (self._client, self._listener, self._wake_out, self._wake_in, self._selector):
            if each is not None:
                each.close()

    def _step(self):
        with self._lock:
            if self._closed_by is not None and (self._client is None or time.monotonic() > self._closed_by):
                return False
            if self._client is not None:
                self._stay_alive()
                events = selectors.EVENT_READ | (selectors.EVENT_WRITE if self._queue else 0)
                if events != self._events:
                    self._selector.modify(self._client, events)
                    self._events = events
        for key, events in self._selector.select(HELLO_PAUSE_S / 2):
            if key.fileobj is self._wake_out:
                self._wake_out.recv(4096)
            elif key.fileobj is self._listener:
                self._accept()
            elif self._client is not None:
                self._serve(events)
        return True

    def _stay_alive(self):
        """Sends a heartbeat if one is due."""
        due = time.monotonic() > self._last_hello + HELLO_PAUSE_S
        if due and self._hello and self._queued_bytes + HEADER_BYTES + len(self._hello) <= self._limit:
            self._greet()

    def _greet(self):
        self._put(HELLO, self._hello)
        self._last_hello = time.monotonic()

    def _accept(self):
        try:
            client, peer = self._listener.accept()
        except OSError:
            return
        client.setblocking(False)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, DEAD_CLIENT_MS)
        if not self._welcome(client):
            say(f"refused a connection from {peer[0]}:{peer[1]}: " + ("another client is connected" if self._client else "no device"))
            return send_away(client)
        self._selector.register(client, selectors.EVENT_READ)
        self._events = selectors.EVENT_READ
        say(f"client {peer[0]}:{peer[1]}")

    def _welcome(self, client):
        with self._lock:
            if self._hello is None or self._client is not None:
                return False
            self._client = client
            self._leaving = False
            self._sequence = self._lost = 0
            self.clients += 1
            self._greet()
        return True

    def _serve(self, events):
        try:
            if events & selectors.EVENT_READ and not self._client.recv(4096):
                return self._disconnect("closed the connection")
            for _ in range(BLOCKS_A_TURN if events & selectors.EVENT_WRITE else 0):
                self._write()
                if not self._queue:
                    break
        except BlockingIOError:
            pass
        except OSError as error:
            self._disconnect(error.strerror or str(error))

    def _write(self):
        """Sends as much of the first block as the socket accepts."""
        if not self._rest:
            first = self._queue[0]
            header = block(first.kind, first.sequence, first.payload, first.dropped)
            self._rest = [memoryview(piece) for piece in (header, first.payload) if len(piece)]
        done = left = self._client.sendmsg(self._rest)
        while self._rest and left >= len(self._rest[0]):
            left -= len(self._rest.pop(0))
        if left:
            self._rest[0] = self._rest[0][left:]
        with self._lock:
            self._queued_bytes -= done
            if self._rest:
                return
            self.sent += self._queue.popleft().items
            finished = self._leaving and not self._queue
        if finished:
            self._disconnect("was disconnected")

    def _disconnect(self, why):
        self._selector.unregister(self._client)
        with self._lock:
            unsent = sum(waiting.items for waiting in self._queue)
            self._client.close()
            self._client = None
            self._queue.clear()
            self._queued_bytes = 0
        self._rest = []
        say(f"the client {why}" + (f"; {unsent} items were not sent" if unsent else ""))


def send_away(client):
    with client:
        try:
            client.send(block(BYE, 0, b""))  # 32 bytes always fit into the empty socket buffer
        except OSError:
            pass


def choose(attached, serial, what):
    """Returns the serial number of the device to open; raises an error unless exactly one attached device matches."""
    listed = ", ".join(attached)
    if not attached:
        raise RuntimeError(f"no {what} is connected")
    if serial and serial not in attached:
        raise RuntimeError(f"no {what} with the serial number {serial}; attached: {listed}")
    if not serial and len(attached) > 1:
        raise RuntimeError(f"more than one {what} is connected; choose one with --serial: {listed}")
    return serial or attached[0]


class Finished(Exception):
    """Raised at the end of a recording."""


class Stop:
    """True after the first SIGINT or SIGTERM; a second signal ends the program immediately. Not a
    threading.Event, because the interrupted thread may hold the lock of the Event."""

    def __init__(self):
        self._requested = False
        for name in (signal.SIGINT, signal.SIGTERM):
            signal.signal(name, self._handle)

    def _handle(self, name, _frame):
        signal.signal(name, signal.SIG_DFL)
        self._requested = True

    def __bool__(self):
        return self._requested

    def wait(self, seconds):
        end = time.monotonic() + seconds
        while not self._requested and (left := end - time.monotonic()) > 0:
            time.sleep(min(left, 0.05))  # Python resumes sleep() after a signal, so sleep in short steps
        return self._requested


def run(address, open_device, items):
    """Serves a device until a signal arrives; returns the exit code. open_device() returns an
    object with hello() -> dict, poll(server) -> seconds until the next call, and close(). Any
    exception from these calls means that the device is gone. During startup, such an exception ends
    the bridge; later, the bridge reopens the device."""
    stop = Stop()
    try:
        device = open_device()
    except Exception as error:  # vendor libraries may raise any exception
        fail(text_of(error))
    try:
        server = Server(address)
    except OSError as error:
        device.close()
        fail(f"cannot listen on {address[0]}:{address[1]}: {error.strerror or error}", 1)
    announced = False
    while device:
        try:
            server.online(device.hello())
            if not announced:  # print the address only after online(), because earlier clients are rejected
                say(f"listening on {server.address[0]}:{server.address[1]}")
                announced = True
            while not stop.wait(device.poll(server)):
                server.check()
        except Finished as end:
            say(str(end))
            close_quietly(device)
            break
        except Exception as error:
            say(f"{text_of(error)}; trying again")
            server.offline()
        close_quietly(device)
        device = reopen(open_device, stop)
    server.close()
    say(f"sent {server.sent} {items} to {server.clients} clients, and dropped {server.dropped} {items}")
    return 0


def reopen(open_device, stop):
    """Tries to reopen the device until it succeeds; returns the device, or None after a signal."""
    pause_s, reported = 0.1, None
    while not stop.wait(pause_s):
        try:
            return open_device()
        except Exception as error:
            if text_of(error) != reported:
                reported = text_of(error)
                say(reported)
            pause_s = min(2 * pause_s, LONGEST_RETRY_S)
    return None


def close_quietly(device):
    try:
        device.close()
    except Exception as error:  # close() may fail if the device is gone
        say(f"error while closing the device: {text_of(error)}")


def text_of(error):
    return " ".join(str(error).split()) or type(error).__name__
