#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""container.py PID FILE: opens the address that the default command of the container writes to FILE, as a browser does, and
waits for depth maps. PID is the process `unshare` of scripts/dev/check_container, which has the network of the container."""
import ctypes
import os
import pathlib
import re
import signal
import sys
import time
import urllib.error
import urllib.request

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "view"))
from page_socket import Client

RECORDS = 10
pid, output = int(sys.argv[1]), pathlib.Path(sys.argv[2])
end = time.monotonic() + 300
while not (line := output.read_text(encoding="ascii")).endswith("\n"):
    os.kill(pid, 0)
    assert time.monotonic() < end, "no address within 300 s"
    time.sleep(0.1)
assert re.fullmatch(r"http://localhost:8410/\?token=[0-9a-f]{32}\n", line), line
address = line.strip()
with open(f"/proc/{pid}/ns/net", encoding="ascii") as network:
    assert ctypes.CDLL(None).setns(network.fileno(), 0) == 0
assert b"<html" in urllib.request.urlopen(address).read()
try:
    urllib.request.urlopen(address.split("?")[0])
    sys.exit("the page can be opened without the token")
except urllib.error.HTTPError as refused:
    assert refused.code in (401, 403), refused
client = Client(address)
indices, overlaps = set(), []
while len(indices) < RECORDS:
    record = client.until("record", lambda record: "reconstruction" in record["arrays"])
    if record["index"] not in indices:
        indices.add(record["index"])
        overlaps.append(record["reconstruction"]["iou"] or 0)
print(f"{address}: {len(indices)} maps, mean IoU {sum(overlaps) / len(overlaps):.2f}")
first, = pathlib.Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii").split()
begun = time.monotonic()
os.kill(int(first), signal.SIGTERM)
while pathlib.Path(f"/proc/{first}").exists():
    assert time.monotonic() - begun < 10, "the container ignores SIGTERM for 10 s"
    time.sleep(0.05)
print(f"stopped {time.monotonic() - begun:.1f} s after SIGTERM")
