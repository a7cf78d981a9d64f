# SPDX-License-Identifier: MIT
"""A reverse proxy in front of the viewer, similar to nginx with proxy_pass. For /lab/, it forwards the headers required
by the manual. For /plain/, it forwards only the default headers of nginx. For other paths, it returns its own 404 page."""
import socket
import threading
import urllib.parse

NOT_FOUND = b"HTTP/1.1 404 Not Found\r\nContent-Type: text/html\r\nConnection: close\r\n\r\n<html><h1>404 of the proxy</h1></html>"


class Proxy:
    def __init__(self, viewer):
        self.viewer = urllib.parse.urlsplit(viewer)
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.address = "http://127.0.0.1:%d" % self.listener.getsockname()[1]
        threading.Thread(target=self.accept, daemon=True).start()

    def accept(self):
        while True:
            try:
                client, _ = self.listener.accept()
            except OSError:
                return
            threading.Thread(target=self.serve, args=(client,), daemon=True).start()

    def serve(self, client):
        head = b""
        while b"\r\n\r\n" not in head:
            got = client.recv(65536)
            if not got:
                return client.close()
            head += got
        method, target, *_ = (lines := head.decode().split("\r\n"))[0].split()
        prefix = next((p for p in ("/lab/", "/plain/") if target.startswith(p)), None)
        if prefix is None:
            client.sendall(NOT_FOUND)
            return client.close()
        fields = dict(line.split(": ", 1) for line in lines[1:] if line)
        fields, asked = {**fields, "Host": self.viewer.netloc}, fields["Host"]
        if prefix == "/lab/":
            fields["X-Forwarded-Host"] = asked
        else:
            fields.pop("Upgrade", None)
            fields["Connection"] = "close"
        text = "".join(f"{name}: {value}\r\n" for name, value in fields.items())
        server = socket.create_connection((self.viewer.hostname, self.viewer.port))
        server.sendall(f"{method} /{target[len(prefix):]} HTTP/1.1\r\n{text}\r\n".encode())
        threading.Thread(target=self.pipe, args=(client, server), daemon=True).start()
        self.pipe(server, client)

    @staticmethod
    def pipe(source, sink):
        try:
            while got := source.recv(65536):
                sink.sendall(got)
            sink.shutdown(socket.SHUT_WR)
        except OSError:
            pass

    def close(self):
        self.listener.close()
