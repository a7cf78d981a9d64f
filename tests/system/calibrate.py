#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Tests that `calibrate` measures the biases of the simulated laboratory, that a run stores them, and that uncorrected
biases degrade depth maps."""
import json
import math

from case import Case, bin_dir, main, source
import fixtures
import waiting

config = source / "config/radar"
SPD_PS, RADAR_M = 437, 0.037
SPD_M = SPD_PS * 299792458 / 2e12


def settings(*pairs):
    return [word for pair in pairs for word in ("--set", pair)]


class Calibrate(Case):
    def acquire(self, command, *options, cfg="xwr68xx_44mm.cfg", scene=("reflector", "--laser-rate-hz", "4e6"), sets=(f"radar_bias_m={RADAR_M}",)):
        """Runs a command of echofuse-acquire in the simulated laboratory."""
        return self.lab(bin_dir / "echofuse-acquire", command, "--config", self.dir / "lab/lab.toml", *options, options=(
            "--window", "1", "--radar-cfg", config / cfg, *settings(f"spd_delay_ps={SPD_PS}", *sets), "--scene", *scene))

    def calibrate(self, *options, **how):
        """Calibrates with --json. Returns the finished process and the JSON object that it printed last."""
        done = self.acquire("calibrate", "--json", *options, **how)
        return done, json.loads(done.stdout.splitlines()[-1])

    def info(self, run):
        return fixtures.json_of("echofuse-acquire", "info", run)

    def dataset(self, name, *words):
        """Simulates four records like the calibration. Returns the run."""
        run = self.dir / f"{name}.sqlite"
        self.call("echofuse-sim", "dataset", "-q", "--out", run, "--records", "4", *words)
        return run

    def test_calibrate_measures_range_offsets_that_a_run_stores(self):
        stored = self.dir / "calibration.toml"
        uses = ("--set", f"run.calibration={stored}")
        done, said = self.calibrate("--repeat", "6", "--time", "0.4", "--window", "0.3", *uses)
        self.assertEqual(done.returncode, 0, done.stderr)
        spd, radar = said["sensors"]
        for sensor, true_m in (spd, SPD_M), (radar, RADAR_M):
            # On average, points on the reflector plate are less than 0.02 mm farther away than the centre of the
            # plate.
            self.assertLess(abs(sensor["offset_m"] - true_m), 5 * sensor["measurement_error_m"] + 2e-5, sensor)
            self.assertLess(sensor["measurement_error_m"], 3e-4)
            self.assertGreater(sensor["snr_db"], 10)
        # The distance and the baseline are each assumed to have an error of 2 mm. The SPD range depends only on the
        # distance.
        self.assertAlmostEqual(spd["reflector_error_m"], 2e-3, 6)
        self.assertAlmostEqual(radar["reflector_error_m"], math.sqrt(1 + .5 * .5 * 2) / math.sqrt(1.25) * 2e-3, 5)
        self.assertAlmostEqual(radar["true_range_m"], math.sqrt(1.25), 6)
        self.assertNotIn("kept", said)
        run = self.acquire("run", "--out", self.dir / "run", "--count", "1", *uses)
        self.assertEqual(run.returncode, 0, run.stderr)
        info = self.info(self.dir / "run.sqlite")
        self.assertEqual([c["sensor"] for c in info["calibrations"]], ["spd", "radar"])
        # The sensor responses of the simulated laboratory must be measured and stored in the run.
        response = said["response"]
        width, _, error = response["irf_fwhm_ps"].partition(" +- ")
        self.assertLess(abs(float(width) - 200), 5 * float(error), response)
        taps = [float(tap) for tap in response["radar_taps"].partition(" +- ")[0].split()]
        # The expected taps are the response of a Blackman window, sampled at quarters of a range cell.
        for tap, blackman in zip(taps, (1, .939, .776, .563)):
            self.assertLess(abs(tap - blackman), .02, response)
        unstated = said.get("unstated", {})
        if done.starved and "radar_noise_exponent" in unstated:
            waiting.not_checked(f"exponent of the radar noise ({unstated['radar_noise_exponent']})", done.starved)
        else:
            exponent, _, error = response["radar_noise_exponent"].partition(" +- ")
            self.assertLess(abs(float(exponent) + .5), 5 * float(error), response)
        self.assertEqual({key: info["meta"][key] for key in response}, response)
        like = self.dataset("like", "--like", stored)
        made = self.info(like)["meta"]
        self.assertEqual(made["radar_taps"].split()[:16], response["radar_taps"].split()[:16])
        self.assertEqual(made["irf_fwhm_ps"], response["irf_fwhm_ps"].partition(" +- ")[0])
        # Simulated and recorded runs must have equal axes, so that a model can be trained on both kinds of runs.
        axes = "SELECT name, unit, count, start, step FROM axis WHERE name IN ('spd', 'radar', 'map_x', 'map_y', 'map_z')"
        self.assertEqual(len(fixtures.query(like, axes)), 5)
        self.assertEqual(*(sorted(fixtures.query(path, axes)) for path in (self.dir / "run.sqlite", like)))
        for kept, measured in zip(info["calibrations"], (spd, radar)):
            self.assertAlmostEqual(kept["offset_m"], measured["offset_m"], 12)

    def test_calibrate_detects_a_swapped_antenna_row(self):
        stored = self.dir / "calibration.toml"

        def calibrate(before, *options):
            return self.acquire("calibrate", "--repeat", "4", "--time", "0.5", "--set", f"run.calibration={stored}", *options,
                                cfg="xwr68xx_azimuth_44mm.cfg", sets=(f"reflector_before={before}", "radar_phase_error_rad=1"))

        self.assertEqual(calibrate("each", "--only", "radar").returncode, 4)
        self.assertFalse(stored.exists())
        done = calibrate("detector", "--only", "radar")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertRegex(done.stdout, r"\nradar  response 1\.\d\d range cells FWHM \(cells of 0\.044 m\), standard error of each tap 0\.\d{3}\n"
                         r"radar_noise_exponent not measured: fewer than 40 frames received\n")
        self.assertNotRegex(done.stdout, r"(?m)^spd\b")
        self.assertNotIn("[spd]", stored.read_text())
        for side in "left", "right":
            done = calibrate(side, "--side", side)
            self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
            self.assertRegex(done.stdout, f"echo on the {side} at .*: the antenna order is correct")
        self.assertEqual(calibrate("left", "--side", "right").returncode, 4)

    def test_model_for_calibrated_antennas_can_be_used_on_a_recorded_run(self):
        """If the antennas have phase and gain errors, a model for eight antennas works after a calibration with one
        reflector in front of the detector."""
        stored, cfg = self.dir / "calibration.toml", "xwr68xx_azimuth_50cm.cfg"
        errors = "radar_phase_error_rad=1", "radar_gain_error_db=1"
        uses = "--set", f"run.calibration={stored}"
        done = self.acquire("calibrate", *uses, "--repeat", "5", cfg=cfg, sets=errors)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        run = self.acquire("run", "-q", *uses, "--out", self.dir / "run", "--count", "30", cfg=cfg, scene=("mixed", "--hold", "1"),
                           sets=(*errors, "radar_sum=coherent"))
        self.assertIn(run.returncode, (0, 5), run.stderr)
        scenes, model = self.dir / "scenes.sqlite", self.dir / "model.safetensors"
        slots = "--set radar_antennas=8 --set radar_sum=coherent --set window_s=1 --set radar_frames=20"
        self.call("echofuse-sim", "dataset", "-q", "--out", scenes, "--records", "1500", "--like", stored, *slots.split())
        self.call("echofuse-recon", "train", "-q", scenes, "--model", "factorised-16", "--out", model)
        said = self.call("echofuse-recon", "evaluate", model, self.dir / "run.sqlite", "--all", "--json")
        self.assertGreater(json.loads(said)["metrics"]["iou"]["mean"], .4, said)

    def asymmetric(self):
        """Returns the power response of a Hann window with a cubic phase error of 6 rad, sampled from its peak in
        steps of a quarter of a range cell."""
        sweep = [(k + .5) / 400 - .5 for k in range(400)]

        def power(u):
            return sum((1 + math.cos(2 * math.pi * t)) * math.cos(2 * math.pi * t * u + 48 * t ** 3)
                       for t in sweep) ** 2
        peak = max((k / 200 for k in range(-200, 200)), key=power)
        return [round(power(peak + k / 4) / power(peak), 5) for k in range(-20, 17)]

    def test_calibrate_reports_an_asymmetric_radar_response(self):
        powers = self.asymmetric()
        peak, stored = powers.index(1), self.dir / "calibration.toml"
        taps = "radar_taps=" + " ".join(map(str, powers))
        done, said = self.calibrate("--repeat", "4", "--distance", "3", "--window", "0.6", "--reflector", "each", "--set",
                                    f"run.calibration={stored}", cfg="xwr68xx_paper_50cm.cfg",
                                    sets=("reflector_before=each", "reflector_z_m=3", taps))
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        odd = [far - near for far, near in zip(powers[peak + 1:], powers[peak - 1::-1])]
        self.assertAlmostEqual(said["lopsided"]["flank_difference"], max(odd, key=abs), delta=.03, msg=said)
        self.assertLess(abs(said["sensors"][1]["offset_m"]), .01, said)
        stated = self.info(self.dataset("like", "--like", stored))["meta"]["radar_taps"].split()
        measured = [float(tap) for tap in said["response"]["radar_taps"].partition(" +- ")[0].split()]
        self.assertEqual(([float(tap) for tap in stated], measured[15]), (measured, 1))
        for tap, true in zip(measured, powers[peak - 15:]):
            self.assertLess(abs(tap - true), .05, said)

    def test_range_calibration_restores_the_accuracy_of_depth_maps(self):
        def score(run):
            metrics = json.loads(self.call("echofuse-recon", "evaluate", "model.h5", run, "--all", "--json"))["metrics"]
            return metrics["lateral_m"], metrics["iou"]

        scenes = "--records", "150", "--seed", "2"
        self.call("echofuse-sim", "dataset", "--out", "train", "--records", "500", "--seed", "1")
        kind = "--model", "factorised-16", *settings("fallback=false")
        self.call("echofuse-recon", "train", "train", "--out", "model.h5", *kind)
        self.call("echofuse-sim", "dataset", "--out", "right", *scenes)
        lateral, iou = score("right")
        for spd_ps, radar_m in (0, 0.05), (-133.4, 0.03), (337, 0):
            run = f"off{spd_ps}"
            biases = settings(f"spd_delay_ps={spd_ps}", f"radar_bias_m={radar_m}")
            self.call("echofuse-sim", "dataset", "--out", run, *scenes, *biases)
            self.assertGreater(score(run)[0]["mean"], 2 * lateral["mean"])
            for sensor, offset_m in ("spd", spd_ps * 299792458 / 2e12), ("radar", radar_m):
                fixtures.change(self.dir / run, "offset ?2 of the sensor ?1", sensor, offset_m)
            for now, then in zip(score(run), (lateral, iou)):
                self.assertLess(abs(now["mean"] - then["mean"]), 2 * then["se"], (spd_ps, radar_m, now, then))


main(Calibrate)
