#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Converts the output of `echofuse-acquire run --json` to a file in the OpenMetrics text format, e.g. for the textfile
collector of Prometheus and for Grafana:

    echofuse-acquire run --json --out monday | python3 open_metrics.py /var/lib/node_exporter/echofuse.prom"""
import json
import os
import sys
import time

METRICS = {"on_disk": ("echofuse_records", "Records on disk in this run."),
           "window_s": ("echofuse_slot_seconds", "Slot length."),
           "code": ("echofuse_exit_code", "Exit code; absent while the run is recorded.")}
path = sys.argv[1]
values = {}
for line in sys.stdin:
    event = json.loads(line)
    if event["event"] == "left out":
        continue
    if event["event"] == "run":
        values.pop("code", None)
    values.update((key, event[key]) for key in METRICS if key in event)
    with open(f"{path}.part", "w", encoding="utf-8") as file:
        for key, value in values.items():
            name, text = METRICS[key]
            file.write(f"# TYPE {name} gauge\n# HELP {name} {text}\n{name} {value}\n")
        file.write("# TYPE echofuse_event_timestamp_seconds gauge\n# HELP echofuse_event_timestamp_seconds Last event.\n"
                   f"echofuse_event_timestamp_seconds {time.time():.3f}\n# EOF\n")
    os.replace(f"{path}.part", path)
