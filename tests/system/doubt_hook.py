#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Tests the program started by alert.on_doubt during a run of the simulated laboratory. Called as
`tests/system/doubt_hook.py BIN_DIR [TEST]`."""
import shutil
import signal
import subprocess
import time

import live
from live import bin_dir, wait_for

SLOT_S = 5 * live.WINDOW_S
# Time in s between the end of a slot and the moment when the daemon closes its record.
GRACE_S = 0.5


class DoubtHook(live.Live):
    def hook(self):
        """Writes an alert program. Each call of the program appends the time, the argument and the environment
        variables to a file."""
        program, calls = self.dir / "lab/alert", self.dir / "calls"
        program.write_text(f"""#!/bin/sh
echo to stdout
printf '%s\\t' "$(date +%s.%N)" "$#" "$1" "$ECHOFUSE_SOURCE" "$ECHOFUSE_DOUBT" "$ECHOFUSE_RECORD" "$ECHOFUSE_RUN" >>{calls}
echo "$ECHOFUSE_TEXT" >>{calls}
""")
        program.chmod(0o755)
        return calls

    def calls(self, file):
        names = "TIME", "COUNT", "WORD", "SOURCE", "DOUBT", "RECORD", "RUN", "TEXT"
        rows = [line.split("\t") for line in file.read_text().splitlines()] if file.exists() else []
        return [dict(zip(names, row)) for row in rows if len(row) == len(names)]

    def test_alert_program_is_called_within_one_slot_of_a_sensor_loss(self):
        """A sensor that stops sending data is reported once, within one slot of its first missing record. Importing
        raw data does not start the alert program."""
        file = self.hook()
        config = self.dir / "lab/lab.toml"
        config.write_text(config.read_text() + '\n[alert]\non_doubt = ["./alert", "lab  7; $(id)"]\nafter_s = 0.001\n')
        prefix = () if not shutil.which("setpriv") else ("setpriv", "--no-new-privs", "--bounding-set=-all")
        daemon = self.start([*prefix, bin_dir / "echofuse-acquire", "run", "--json", "--config", config, "--out", self.run,
                             "--set", f"run.window_s={SLOT_S}", "--keep-raw", self.dir / "raw"],
                            env=self.environment(),
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        wait_for("a record of all sensors", lambda: self.committed() >= 3 and self.rows()[-1]["valid"] == 7, 60)
        self.close_lab()

        def missing():
            return {call["SOURCE"]: call for call in self.calls(file) if call["DOUBT"] == "no data"}
        wait_for("calls", lambda: len(missing()) == 3)
        time.sleep(3 * SLOT_S)
        calls = self.calls(file)
        daemon.send_signal(signal.SIGTERM)
        told, log = daemon.communicate(timeout=30)
        self.assertEqual(daemon.returncode, 0, log)
        self.assertNotIn("to stdout", told)
        rows = self.rows()
        for sensor, call in missing().items():
            self.assertEqual((call["COUNT"], call["WORD"]), ("1", "lab  7; $(id)"))
            self.assertEqual(call["RUN"], str(self.run))
            row = rows[int(call["RECORD"])]
            bit = 1 << ("spd", "radar", "depth").index(sensor)
            self.assertEqual(row["idx"], 1 + max(row["idx"] for row in rows if row["valid"] & bit))
            word, figures = row[f"{sensor}_verdict"], row[f"{sensor}_figures"]
            self.assertEqual(call["TEXT"], f"{word}: {figures}" if figures else word)
        # Only the time of the first call is checked, because later calls wait until the previous call ends.
        call = min(missing().values(), key=lambda call: float(call["TIME"]))
        end_s = rows[int(call["RECORD"])]["slot_utc_ns"] / 1e9 + SLOT_S
        self.assertLess(float(call["TIME"]) - end_s, GRACE_S + SLOT_S, call)
        changes = [(call["SOURCE"], call["DOUBT"]) for call in calls]
        self.assertTrue(all(a != b for s in missing() for a, b in zip(*[[c for c in changes if c[0] == s][k:] for k in (0, 1)])),
                        changes)

        # An import must not start the alert program, even if the stored configuration contains an alert program.
        kept = self.dir / "raw/lab.toml"
        self.assertNotIn("lab/alert", kept.read_text())
        kept.write_text(kept.read_text().replace("on_doubt = []", f'on_doubt = ["{self.dir}/lab/alert"]'))
        self.assertIn("lab/alert", kept.read_text())
        count = len(self.calls(file))
        subprocess.run([bin_dir / "echofuse-acquire", "import", self.dir / "raw", "--out", self.dir / "again"], check=True,
                       stderr=subprocess.DEVNULL)
        self.assertEqual(len(self.calls(file)), count)


if __name__ == "__main__":
    live.main(DoubtHook)
