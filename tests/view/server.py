#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Tests echofuse-view with a finished run over real sockets."""
import base64
import contextlib
import hashlib
import http.client
import json
import math
import os
import pathlib
import random as random_numbers
import re
import shutil
import socket
import struct
import subprocess
import sys
import tempfile
import time
import urllib.parse

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "system"))
from case import SharedCase, bin_dir, main
import fixtures
from page_socket import Browser, Client, Refused
import waiting

RECORDS = 24


class Server(SharedCase):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.run_file = cls.dir / "scenes.sqlite"
        shutil.copy(fixtures.scenes(RECORDS), cls.run_file)
        cls.address = cls.enterClassContext(cls.viewer(cls.dir))

    @staticmethod
    @contextlib.contextmanager
    def viewer(*arguments, listen="127.0.0.1:0"):
        """Runs a viewer and yields its address. The viewer must exit on SIGTERM."""
        with subprocess.Popen([bin_dir / "echofuse-view", *arguments, *(("--listen", listen) if listen else ())], stdout=subprocess.PIPE,
                              text=True) as process:
            try:
                yield process.stdout.readline().strip()
            finally:
                process.terminate()
                assert process.wait(10) == 0

    def get(self, path, token=True, method="GET", address=None, **headers):
        url = urllib.parse.urlsplit(address or self.address)
        with contextlib.closing(http.client.HTTPConnection(url.hostname, url.port, timeout=20)) as connection:
            connection.request(method, path + (f"?{url.query}" if token else ""), headers=headers)
            answer = connection.getresponse()
            return answer, answer.read()

    def raw(self, request):
        url = urllib.parse.urlsplit(self.address)
        with socket.create_connection((url.hostname, url.port), 20) as s:
            s.sendall(request)
            out = b""
            with contextlib.suppress(ConnectionResetError):
                while got := s.recv(4096):
                    out += got
        return out

    def test_viewer_messages_contain_the_data_of_the_records(self):
        client = Client(self.address)
        run = client.until("run")
        self.assertEqual((run["file"], run["model"], run["may_write"]), ("scenes.sqlite", None, False))
        state = client.until("state")
        found = [state[key] for key in ("status", "records", "last_index", "doubts")]
        self.assertEqual(found, ["complete", RECORDS, RECORDS - 1, ""])
        self.assertEqual(state["sensors"]["spd"]["verdict"], "ok")
        self.assertIn("seed", [name for name, _ in run["facts"]])
        self.assertEqual((len(client.until("strip")["arrays"]["first"]), client.until("record")["live"]), (RECORDS, True))
        client.ask({"show": 3})
        record = client.until("record")
        spds, labels = zip(*fixtures.query(self.run_file, "SELECT spd, label FROM record ORDER BY idx"))
        spds = [struct.unpack(f"<{len(spd) // 4}I", spd) for spd in spds]
        arrays = record["arrays"]
        self.assertEqual((record["index"], record["live"], record["label"], arrays["spd"]), (3, False, labels[3], spds[3]))
        self.assertEqual((len(arrays["radar"]), len(arrays["map"])), (run["axes"]["radar"]["count"], run["map"]["size"] ** 2))
        self.assertTrue(any(1 < z < 6 for z in arrays["map"]))
        # A sum ends with the displayed record. Near the start of the run, it contains fewer records than requested.
        for count, shown in ((2, 3), (2, 4), (1000, 5)):
            client.ask({"show": shown})
            client.ask({"sum": [count, -1e6, 1e6]})
            first = max(0, shown - count + 1)
            summed = client.until("sum", lambda m: (m.get("from"), m.get("records")) == (first, shown - first + 1))
            self.assertEqual(summed["arrays"]["spd"], tuple(map(float, map(sum, zip(*spds[first:shown + 1])))))
            self.assertGreater(summed["fits"]["spd"]["fwhm_m"], 0)
        # The sum of a single record contains no histogram, because the record message already contains the histogram.
        client.ask({"sum": [1, -1e6, 1e6]})
        fitted = client.until("sum", lambda m: m.get("records") == 1)
        self.assertEqual((fitted["from"], fitted["arrays"], fitted["fits"]["spd"]["fwhm_m"] > 0), (5, {}, True))
        client.ask({"sum": [0, 0, 9]})
        self.assertIn("no mark", client.until("sum", lambda m: "why" in m)["why"])
        client.ask({"sheet": [0, RECORDS]})
        sheet = client.until("sheet")
        arrays, bins = sheet["arrays"], run["axes"]["spd"]["count"]
        self.assertEqual((sheet["index"], len(arrays["maps"])), (list(range(RECORDS)), RECORDS * 32 * 32))
        # Each waterfall column contains the maximum of several neighbouring bins.
        by = -(-bins // 256)
        waterfall = tuple(float(max(spd[i:i + by])) for spd in spds for i in range(0, bins, by))
        self.assertEqual((arrays["spd"], arrays["time_s"][3]), (waterfall, 3 * run["window_s"]))
        client.ask({"mark": "a finished run is not marked"})
        self.assertIn("not being recorded", client.until("answer")["text"])
        client.ask({"show": 10 ** 6})
        self.assertIn("no record 1000000", client.until("trouble")["text"])

    def test_viewer_marks_records_on_which_the_model_was_trained(self):
        client = Client(self.enterContext(self.viewer(self.run_file, "--model", fixtures.model("mean", fixtures.scenes(RECORDS)))))
        self.assertFalse(client.until("run")["calibrated"])
        seen = 0
        for index in range(RECORDS):
            client.ask({"show": index})
            seen += client.until("record", lambda record: record["index"] == index)["reconstruction"]["seen"]
        # The model was trained on at least 80 % of the records. The other records were held out for testing.
        self.assertTrue(0 < RECORDS - seen <= 0.2 * RECORDS, seen)

    def test_record_message_contains_the_histograms_and_directions_of_the_zones(self):
        run = fixtures.plates("nine_zones")
        record = Client(self.enterContext(self.viewer(run))).until("record")
        zones, spd = record["arrays"]["zones"], record["arrays"]["spd"]
        self.assertEqual(tuple(sum(zones[bin::len(spd)]) for bin in range(len(spd))), spd)
        stated = fixtures.query(run, "SELECT x, y, width FROM zone ORDER BY rowid")
        self.assertEqual([tuple(zone) for zone in record["zones"]], stated)

    def test_track_message_contains_the_body_positions_of_earlier_records(self):
        run = fixtures.made("echofuse-sim", "dataset", "-q", "--people", 80, "--letters", 0)
        client = Client(self.enterContext(self.viewer(run, "--model", fixtures.model("mean-shape", run))))
        self.assertTrue(client.until("run")["calibrated"])

        def shown(index):
            client.ask({"show": index})
            return client.until("record", lambda m: (m["index"], m["live"]) == (index, False))
        values = shown(60)["arrays"]["track"]
        track = [values[i:i + 4] for i in range(0, len(values), 4)]
        self.assertGreater(len(track), 10)
        slot_s = track[1][0] - track[0][0]
        for age_s, *place in track:
            record = shown(60 - round(age_s / slot_s))
            self.assertIn("deviation", record["arrays"])
            stated = [record["reconstruction"][key] for key in ("x_m", "z_m", "lateral_interval_90_m")]
            for a, b in zip(place, stated):
                self.assertTrue(math.isnan(a) if b is None else abs(a - b) < 1e-5, (age_s, place, stated))

    def handshake(self, address, **how):
        """Returns the status code of the response to a WebSocket handshake."""
        try:
            return Client(address, **how).status
        except Refused as refused:
            return refused.args[0]

    def test_viewer_refuses_invalid_http_requests(self):
        here = urllib.parse.urlsplit(self.address).netloc
        lab = "X-Forwarded-Host: lab.example.org"  # a proxy forwards the host, and replaces Host by the address of the server
        for *headers, status in (
                (101,), (f"Origin: http://{here}", 101), ("Origin: http://evil.example", 403), ("Host: evil.example", 421),
                ("Host: ", 421), ("Host: localhost", 101), (lab, "Origin: https://lab.example.org", 101),
                (lab + ", inner", "Origin: http://lab.example.org", 101), (lab, f"Origin: http://{here}", 403),
                (lab, "Host: lab.example.org", 421)):
            self.assertEqual(self.handshake(self.address, headers=headers), status, headers)
        for path, method, status in (("/", "GET", 200), ("/", "HEAD", 200), ("/", "POST", 405), ("/../etc/passwd", "GET", 404),
                                     ("/live", "GET", 426), ("/nothing", "GET", 404), ("/index.html/", "GET", 404)):
            self.assertEqual(self.get(path, method=method)[0].status, status, path)
        # The scripts of the page are public, so that the page can report why its WebSocket fails.
        self.assertEqual(self.get("/view.js", Origin="http://lab.example.org")[0].status, 200)
        self.assertIn(b"X-Forwarded-Host, Upgrade and Connection", self.get("/live")[1])
        for forwarded, named in ((here, here), ("lab.example.org", "lab.example.org"), ("a; script-src *", "a")):
            policy = self.get("/", **{"X-Forwarded-Host": forwarded})[0].getheader("Content-Security-Policy")
            self.assertIn(f"connect-src 'self' ws://{named} wss://{named};", policy)
        # A malformed request target is rejected without affecting other clients.
        for target in (b"?", b"?token=1", b"live", b"http://localhost/", b"*"):
            self.assertIn(b" 400 ", self.raw(b"GET " + target + b" HTTP/1.1\r\nHost: localhost\r\n\r\n")[:40], target)
        self.assertEqual(self.get("/")[0].status, 200)
        # Every user of this machine may read the data, but a token is required to set marks.
        client = Client(self.address, token=False)
        client.until("run")
        client.ask({"label": "x"})
        answer = client.until("answer")
        self.assertEqual((answer["ok"], "token" in answer["text"]), (False, True))

    def test_viewer_on_a_public_address_requires_the_token(self):
        url = urllib.parse.urlsplit(self.enterContext(self.viewer(self.dir, listen="0.0.0.0:0")))
        here = f"http://127.0.0.1:{url.port}/?{url.query}"
        self.assertRegex(url.query, "^token=[0-9a-f]{32}$")
        for query, status in (("", 401), ("?token=", 401), ("?token=" + "0" * 32, 401), (f"?{url.query}", 200)):
            for path in ("/", "/runs"):
                self.assertEqual(self.get(path + query, token=False, address=here)[0].status, status, (path, query))
        self.assertEqual((self.handshake(here, token=False), self.handshake(here)), (401, 101))

    def test_viewer_uses_another_port_if_its_default_ports_are_in_use(self):
        with contextlib.ExitStack() as taken:
            for port in range(8410, 8420):
                with contextlib.suppress(OSError):  # The port is already in use.
                    taken.enter_context(socket.create_server(("127.0.0.1", port)))
            address = self.enterContext(self.viewer(self.dir, listen=None))
        self.assertNotIn(urllib.parse.urlsplit(address).port, range(8410, 8420))
        self.assertEqual(Client(address).until("state")["records"], RECORDS)

    def test_viewer_refuses_oversized_and_malformed_requests(self):
        for request in (b"GET / HTTP/1.1\r\nHost: localhost\r\nX: " + b"a" * 100_000 + b"\r\n\r\n",
                        b"POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1000000000\r\n\r\n" + b"a" * 10_000,
                        b"GET / HTTP/1.1\r\nHost: localhost\r\nHost: localhost\r\n\r\n", b"\x16\x03\x01\x02\x00" * 200,
                        b"GET " + b"/" * 20_000 + b" HTTP/1.1\r\n\r\n"):
            self.assertNotIn(b" 200 ", self.raw(request)[:40])
        client = Client(self.address)
        client.frame(1, b'{"mark": "' + b"a" * 2000 + b'"}')
        with self.assertRaises((EOFError, ConnectionError)):
            client.until("answer")
        client = Client(self.address)
        for bad in (b"", b"{}", b'{"show": 1e300}', b"[" * 900, b'{"label": "a\\u001bb"}'):
            client.frame(1, bad)
            self.assertFalse(client.until("answer")["ok"], bad)
        self.assertEqual(self.get("/")[0].status, 200)

    def test_random_bytes_close_only_the_connection_that_sent_them(self):
        random = random_numbers.Random(1)
        healthy = Browser(self.address)  # answers pings
        url = urllib.parse.urlsplit(self.address)
        for k in range(120):
            with Client(self.address).socket if k % 2 else socket.create_connection((url.hostname, url.port), 20) as client:
                begin = random.choice([b"", b"GET /live HTTP/1.1\r\n", b"\x81", b"\x81\xfe\xff\xff", b"\x88\x80", b"\x89\x84", b"\x02\x81"])
                with contextlib.suppress(ConnectionError):
                    client.sendall(begin + random.randbytes(random.randrange(200)))
        healthy.ask({"show": 1})
        self.assertEqual(healthy.until("record", lambda m: not m["live"])["index"], 1)
        healthy.close()

    def test_viewer_accepts_at_most_64_connections(self):
        clients = [Browser(self.address) for _ in range(64)]
        for _ in range(3):
            with self.assertRaises((EOFError, ConnectionError)):
                Client(self.address)
        for client in clients:
            client.until("record")
        clients.pop().close()

        def accepted():
            with contextlib.suppress(ConnectionError):
                return self.get("/runs")[0].status == 200
        waiting.wait_for("a new connection", accepted, 10)
        for client in clients:
            client.close()
        time.sleep(0.3)

    def test_slow_client_does_not_delay_other_clients(self):
        silent = Client(self.address)
        asking = Client(self.address)
        for k in range(200):
            silent.ask({"show": k % RECORDS})
        begun = time.monotonic()
        asking.ask({"show": 5})
        asking.until("record", lambda m: m["index"] == 5)
        self.assertLess(time.monotonic() - begun, 5)
        # The kernel states whether the server has closed the connection. The client itself does not notice the end
        # while unread data remain.
        ports = urllib.parse.urlsplit(self.address).port, silent.socket.getsockname()[1]
        established = r": \w+:{:04X} \w+:{:04X} 01 ".format(*ports)

        def is_connected():
            return re.search(established, pathlib.Path("/proc/net/tcp").read_text())
        self.assertTrue(is_connected())
        end = time.monotonic() + 40
        while is_connected():
            self.assertLess(time.monotonic(), end, "a client that never reads is still connected")
            asking.message()  # Reading a message also answers pings.

    def test_web_page_contacts_only_its_own_server(self):
        for path, hashes in ("/", 0), ("/newest/", 2):
            answer, page = self.get(path)
            policy, text = answer.getheader("Content-Security-Policy"), page.decode()
            self.assertIn("default-src 'none'", policy)
            self.assertNotIn("unsafe", policy)
            self.assertNotRegex(text, r" style=|<script(?![^>]* src=)| on\w+=")
            parts = re.findall(r'(?:src|href)="([\w.]+)"(?: integrity="sha384-([^"]+)")?', text)
            self.assertGreaterEqual(len(parts), 2)
            self.assertEqual(len([hashed for _, hashed in parts if hashed]), hashes)
            for name, hashed in parts:
                got, body = self.get("/" + name, token=False)
                self.assertEqual(got.status, 200, name)
                if hashed:
                    self.assertEqual(base64.b64encode(hashlib.sha384(body).digest()).decode(), hashed)
                others = r"wss?://" if hashed else r"\b(https?|wss?):(?!//\$\{location)"
                self.assertNotRegex(body.decode().replace("http://www.w3.org", ""), others)

    def test_viewer_lists_the_runs_of_a_folder(self):
        folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory(dir=self.dir)))
        for name in "one.sqlite", "zwei & drei.sqlite":
            shutil.copy(self.run_file, folder / name)
        (folder / "none.sqlite").write_text("no run")
        here = self.enterContext(self.viewer(folder))
        self.assertRegex(here, r"^http://[\d.:]+/\?token=\w+$")
        runs = {run["name"]: run for run in json.loads(self.get("/runs", address=here)[1])}
        self.assertEqual(set(runs), {"one", "zwei & drei", "none"})
        self.assertIn("not an echofuse run file", runs["none"]["fault"])
        for run in fixtures.json_of("echofuse-acquire", "list", folder)["runs"]:
            for what in "length_s", "labels", "verdict", "records", "status":
                self.assertEqual(runs[run["name"]][what], run[what])
            self.assertEqual(len(runs[run["name"]]["map"]), 32 * 32)
        for path, status in (("/run/one/", 200), ("/run/zwei%20%26%20drei/", 200), ("/run/one/view.js", 200),
                             ("/run/two/", 404), ("/run/one", 404), ("/run//", 404),
                             ("/run/..%2fscenes/", 404), ("/run/../scenes/", 404), ("/run/one/runs", 404),
                             (f"/run/{urllib.parse.quote(str(folder), safe='')}%2fone/", 404)):
            self.assertEqual(self.get(path, address=here)[0].status, status, path)
        # Two clients follow two runs at the same time. Each client must receive only the messages of its own run.
        clients = {name: Client(here, path=f"/run/{urllib.parse.quote(name)}/live") for name in ("one", "zwei & drei")}
        for name, client in clients.items():
            self.assertEqual(client.until("run")["file"], f"{name}.sqlite")
        clients["one"].socket.close()
        clients["zwei & drei"].ask({"show": 3})
        self.assertEqual(clients["zwei & drei"].until("record", lambda m: not m["live"])["index"], 3)
        self.assertEqual(self.handshake(here, path="/run/two/live"), 404)

    def test_newest_run_in_a_folder_is_the_one_that_started_last(self):
        """Other files in the folder are ignored."""
        fifo, earlier, junk = (self.dir / f"{name}.sqlite" for name in ("newest", "earlier", "junk"))
        os.mkfifo(fifo)
        fixtures.changed(self.run_file, earlier, "without the records after ?1", 3)
        fixtures.change(earlier, "started at ?1", "2001-01-01T00:00:00.000Z")
        junk.write_text("no database")
        try:
            newest = Client(self.address)
            self.assertEqual(newest.until("run")["file"], self.run_file.name)
            newest.socket.close()
        finally:
            for path in fifo, earlier, junk:
                path.unlink()


main(Server)
