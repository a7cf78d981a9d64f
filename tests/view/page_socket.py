# SPDX-License-Identifier: MIT
"""WebSocket client (RFC 6455) based on the standard library, and decoder for the messages of echofuse-view."""
import base64
import json
import os
import queue
import socket
import struct
import threading
import time
import urllib.parse

TYPES = {"u8": "B", "u16": "H", "u32": "I", "f32": "f", "f64": "d"}


class Refused(Exception):
    """Raised if the status code of the handshake response is not 101."""


class Client:
    def __init__(self, address, path="/live", token=True, headers=(), timeout_s=20):
        url = urllib.parse.urlsplit(address)
        self.sending = threading.Lock()
        self.socket = socket.create_connection((url.hostname, url.port), timeout_s)
        query = f"?{url.query}" if token else ""
        lines = [f"GET {path}{query} HTTP/1.1", "Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13",
                 f"Sec-WebSocket-Key: {base64.b64encode(os.urandom(16)).decode()}", *headers]
        if not any(line.lower().startswith("host:") for line in headers):
            lines.append(f"Host: {url.netloc}")
        self.socket.sendall(("\r\n".join(lines) + "\r\n\r\n").encode())
        self.bytes = b""
        while b"\r\n\r\n" not in self.bytes:
            self.more()
        head, self.bytes = self.bytes.split(b"\r\n\r\n", 1)
        self.status = int(head.split()[1])
        if self.status != 101:
            raise Refused(self.status)

    def more(self):
        got = self.socket.recv(1 << 16)
        if not got:
            raise EOFError
        self.bytes += got

    def take(self, count):
        while len(self.bytes) < count:
            self.more()
        out, self.bytes = self.bytes[:count], self.bytes[count:]
        return out

    def frame(self, opcode, payload):
        mask = os.urandom(4)
        size = bytes([0x80 | len(payload)]) if len(payload) < 126 else b"\xfe" + struct.pack(">H", len(payload))
        with self.sending:
            self.socket.sendall(bytes([0x80 | opcode]) + size + mask + bytes(b ^ mask[i % 4] for i, b in enumerate(payload)))

    def ask(self, what):
        self.frame(1, json.dumps(what).encode())

    def message(self):
        """Returns the next message from the server. Answers any pings received before it. Raises EOFError if the
        server closes the connection."""
        while True:
            first, second = self.take(2)
            size = second & 127
            if size == 126:
                size, = struct.unpack(">H", self.take(2))
            elif size == 127:
                size, = struct.unpack(">Q", self.take(8))
            payload, opcode = self.take(size), first & 15
            if opcode == 9:
                self.frame(10, payload)
            elif opcode == 8:
                raise EOFError(payload[2:].decode())
            elif opcode == 2:
                return decode(payload)

    def until(self, kind, condition=lambda message: True, timeout_s=60):
        """Returns the next message of the given kind that meets the condition. A TimeoutError contains the last
        problem reported by the server."""
        end, trouble = time.monotonic() + timeout_s, ""
        while time.monotonic() < end:
            message = self.message()
            if message["kind"] == kind and condition(message):
                return message
            if message["kind"] == "trouble":
                trouble = message
        raise TimeoutError(f"no {kind} within {timeout_s} s; {trouble}")


class Browser(Client):
    """Reads messages in a separate thread, as a browser does. Pings are thus answered even while a test waits for
    something else."""

    def __init__(self, address):
        super().__init__(address)
        self.messages = queue.Queue()
        threading.Thread(target=self.read, daemon=True).start()

    def read(self):
        try:
            while True:
                self.messages.put(super().message())
        except (OSError, EOFError) as end:
            self.messages.put(end)

    def message(self):
        message = self.messages.get(timeout=self.socket.gettimeout())
        if isinstance(message, Exception):
            raise message
        return message

    def close(self):
        # shutdown() ends the reading thread, which would otherwise keep the socket open.
        self.socket.shutdown(socket.SHUT_RDWR)
        self.socket.close()


def decode(payload):
    length, = struct.unpack_from("<I", payload)
    message = json.loads(payload[4:4 + length])
    begin = (4 + length + 7) // 8 * 8
    for name, a in message["arrays"].items():
        count = 1
        for side in a["shape"]:
            count *= side
        message["arrays"][name] = struct.unpack_from(f"<{count}{TYPES[a['type']]}", payload, begin + a["offset"])
    return message
