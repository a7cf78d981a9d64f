# SPDX-License-Identifier: MIT
"""A reverse proxy in front of the viewer, similar to nginx with proxy_pass. For /lab/, it forwards the headers required
by the manual. For /plain/, it forwards only the default headers of nginx. For other paths, it returns its own 404 page."""
import socket
import threading
import urllib.parse

from page_socket import Client, Refused

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


def check_requests(test):
    """Sends requests like those forwarded by a proxy. The Origin header contains the forwarded host, and the Host
    header contains the address of the server."""
    here = urllib.parse.urlsplit(test.address).netloc
    for headers, status in ((["X-Forwarded-Host: lab.example.org", "Origin: https://lab.example.org"], 101),
                            (["X-Forwarded-Host: lab.example.org, inner", "Origin: http://lab.example.org"], 101),
                            (["X-Forwarded-Host: lab.example.org", f"Origin: http://{here}"], 403),
                            (["X-Forwarded-Host: lab.example.org", "Host: lab.example.org"], 421)):
        try:
            got = Client(test.address, headers=headers).status
        except Refused as refused:
            got = refused.args[0]
        test.assertEqual(got, status, headers)
    # The scripts of the page are public, so that the page can report why its WebSocket fails.
    test.assertEqual(test.get("/view.js", Origin="http://lab.example.org")[0].status, 200)
    test.assertIn(b"X-Forwarded-Host, Upgrade and Connection", test.get("/live")[1])
    for forwarded, named in ((here, here), ("lab.example.org", "lab.example.org"), ("a; script-src *", "a")):
        policy = test.get("/", **{"X-Forwarded-Host": forwarded})[0].getheader("Content-Security-Policy")
        test.assertIn(f"connect-src 'self' ws://{named} wss://{named};", policy)
