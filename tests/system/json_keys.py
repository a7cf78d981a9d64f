#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Tests that every --json output has exactly the keys documented in config/schema.json."""
import json
import re

import case

schema = json.loads((case.source / "config/schema.json").read_text(encoding="utf-8"))


def differences(documented, found, place):
    """Yields a message for each key that is missing or undocumented, and for each value that has the wrong type."""
    if isinstance(documented, str):
        if isinstance(found, (dict, list)) and place.split(".")[-1] != "rows?[]":
            yield f"{place}: expected a text or number"
    elif isinstance(documented, list):
        for one in found if isinstance(found, list) else [None]:
            yield from differences(documented[0], one, place + "[]")
    elif not isinstance(found, dict):
        yield f"{place}: expected an object, found {found!r}"
    else:
        if "*" not in documented:
            yield from (f"{place}: {key} is not documented" for key in found if not {key, key + "?"} & set(documented))
        for key, shape in documented.items():
            if key == "*":
                for name, value in found.items():
                    yield from differences(shape, value, f"{place}.{name}")
            elif key.rstrip("?") not in found:
                yield from [f"{place}: {key} is missing"] if key[-1] != "?" else []
            elif found[key.rstrip("?")] is not None:
                yield from differences(shape, found[key.rstrip("?")], f"{place}.{key}")


class JsonKeys(case.Case):
    def check(self, output, text):
        found = json.loads(text)
        self.assertEqual(found["schema"], 1, output)
        self.assertEqual(list(differences(schema[output], found, output)), [])
        return found

    def printed(self, output, *words):
        """Runs a command of the schema. Returns its checked output."""
        return self.check(output, self.call(*output.split()[:2], *words, "--json"))

    def test_json_output_of_every_command_is_documented(self):
        documented = {" ".join(output.split()[:2]) for output in schema if output != "how to read"}
        offered = set()
        for program in ("echofuse-acquire", "echofuse-recon", "echofuse-sim", "echofuse-report", "echofuse-view", "echofuse-export"):
            commands = re.findall(r"^  ([a-z]+)  ", self.call(program, "--help").partition("Subcommands:")[2], re.M)
            offered |= {f"{program} {command}".strip() for command in commands or [""]
                        if "--json" in self.call(program, *command.split(), "--help")}
        self.assertEqual(offered | {"scripts/audit_run.py"}, documented)

    def test_json_output_of_device_commands_matches_the_schema(self):
        lab = ("echofuse-sim", "lab", "--dir", "lab", "--window", "0.3", "--laser-rate-hz", "2e7", "--set", "signal_photons=5e4", "--scene", "reflector", "--",
               "sh", "-c", """cd lab
                   for command in devices "doctor --duration 1s" "calibrate --repeat 3 --time 0.2"; do
                     echofuse-acquire $command --json >${command%% *}.json 2>>log; echo $? $command >>codes
                   done
                   echofuse-acquire run --json -q --count 3 --out live >run.json 2>>log; echo $? run >>codes
                   echofuse-acquire run -q --count 20 --out second 2>>log &
                   until echofuse-acquire list --json | tee list.json | grep -q '"live": {'; do sleep 0.1; done
                   kill -INT $!; wait $!""")
        self.call(*lab, ok=(0, 5, 130))
        read = lambda name: (self.dir / "lab" / f"{name}.json").read_text()
        codes = (self.dir / "lab/codes").read_text() + (self.dir / "lab/log").read_text()
        for command, key in ("devices", "configured"), ("doctor", "checks"), ("calibrate", "sensors"):
            self.assertTrue(self.check(f"echofuse-acquire {command}", read(command))[key], codes)
        events = [self.check("echofuse-acquire run", line)["event"] for line in read("run").splitlines()]
        self.assertEqual((events[0], events[-1], set(events)), ("run", "end", {"run", "records", "end"}), codes)
        self.assertTrue(any(run["live"] for run in self.check("echofuse-acquire list", read("list"))["runs"]))
        self.assertTrue(self.printed("echofuse-acquire info", "lab/live")["devices"])

    def test_json_output_of_run_and_model_commands_matches_the_schema(self):
        for name, people in ("a", 60), ("b", 30):
            self.call("echofuse-sim", "dataset", "-q", "--people", people, "--letters", 0, "--seed", people, "--out",
                      f"{name}.sqlite", "--set", "radar_antennas=8")
        for model in ("mean-shape", "mean"):
            self.call("echofuse-recon", "train", "-q", "a.sqlite", "--model", model, "--out", f"{model}.safetensors")
        self.assertTrue(self.printed("echofuse-sim config")["settings"])
        self.assertTrue(self.printed("echofuse-acquire verdicts")["verdicts"])
        self.assertTrue(self.printed("echofuse-acquire info", "a")["array"]["places"])
        self.assertEqual(len(self.printed("echofuse-recon rows", "-q", "a.sqlite")["records"]), 60)
        models = "mean-shape.safetensors", "mean.safetensors"
        found = self.printed("echofuse-recon evaluate", "-q", "--per-record", "t.csv", *models, "b.sqlite")
        self.assertTrue(found["paired"] and found["calibration"] and found["domain_shift"])
        self.assertTrue(self.printed("echofuse-recon compare", "t.csv")["methods"][1]["difference"])
        for row in found["rows"]:
            row |= {"schema": 1, "data_crc32c": ""}
            self.assertEqual(list(differences(schema["echofuse-recon evaluate"], row, "rows")), [])
        self.call("echofuse-recon", "reconstruct", "-q", "mean-shape.safetensors", "b.sqlite", "--format", "npy", "--out", "maps")
        self.printed("echofuse-recon evaluate --maps", "-q", "--maps", "maps", "b.sqlite", "--train", "a.sqlite")


case.main(JsonKeys)
