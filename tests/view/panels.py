#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Uses Chromium to test the alerts, rates, sums, plan view and pixel values on the web page."""
import re
import signal
import struct
import sys
import time
import unittest

import page
from fixtures import query
from selenium.webdriver.common.action_chains import ActionChains

# Shows the longest possible texts in the lamps, the status and the table of losses. Returns the visible elements that are clipped or
# outside the window.
CUT = """
  for (const lamp of document.querySelectorAll('.lamp'))
    for (const [part, text] of [['strong', 'CHECK'], ['.verdict', 'weak: 123 clicks above the background (minimum 1000)'], ['.age', 'last data 12.3 s ago']])
      lamp.querySelector(part).textContent = text, lamp.classList.remove('long');
  document.getElementById('status').textContent = 'recording; check SPD, radar, depth camera';
  for (const row of document.querySelectorAll('#losses tr'))
    ['123.4k clicks', '123.4k', '123.4M', '123.4k', '123.4 ms'].forEach((text, i) => row.cells[i + 1].textContent = text);
  const scrolls = getComputedStyle(document.body).overflowY !== 'hidden', out = [];
  for (const at of document.querySelectorAll('body *')) {
    if (!at.checkVisibility() || at.closest('dialog, svg, noscript') || !at.getClientRects().length) continue;
    const box = at.getBoundingClientRect(), style = getComputedStyle(at), name = `${at.tagName} ${at.id} ${at.className}`;
    if (box.right > innerWidth + 1 || box.left < -1 || !scrolls && box.bottom > innerHeight + 1) out.push(`${name} outside`);
    const own = [...at.childNodes].some(n => n.nodeType === 3 && n.textContent.trim());
    if (own && style.display !== 'inline' && style.textOverflow !== 'ellipsis' && at.scrollWidth > at.clientWidth + 1) out.push(`${name} cut`);
  }
  return [document.documentElement.scrollWidth - document.documentElement.clientWidth, out];
"""


class Panels(page.Page):
    def number(self, element):
        return float(re.search(r"-?[\d.]+", self.text(element))[0])

    def pressed(self, button):
        return self.js("return document.getElementById(arguments[0]).getAttribute('aria-pressed')", button) == "true"

    def choose(self, records):
        self.js("const at = document.getElementById('sum'); at.value = arguments[0]; at.dispatchEvent(new Event('change'))",
                str(records))

    def themes(self):
        """Checks that no element is clipped or outside the window in either theme or font size."""
        for width, height in ((1400, 900), (400, 800)):
            self.size(width, height)
            for key in "", "t", "f", "t", "f":
                if key:
                    self.key(key)
                time.sleep(0.3)
                wider, cut = self.js(CUT)
                self.assertLessEqual(wider, 0, (width, key))
                self.assertEqual(cut, [], (width, key))
        self.size(1400, 900)

    def test_web_page_shows_alerts_and_plays_alarms(self):
        address = self.view()
        viewer = self.processes[-1]
        daemon = self.record("--set", "alert.disk_free_gb=1e6", "--set", "run.label=person", "--set", "signal.clicks_per_pulse=1e-6")
        self.size(1400, 900)
        self.browser.get(address)
        self.wait("records", lambda: self.js("return window.framesSeen") > 2)
        self.wait("alert of the disk", lambda: self.js("return document.getElementById('box-disk').classList.contains('bad')"))
        self.assertEqual((self.text("sound"), self.pressed("sound"), self.js("return window.alarms")), ("sound on", False, 0))
        self.browser.find_element("id", "sound").click()
        self.wait("sound", lambda: self.pressed("sound"))
        self.assertEqual(self.text("sound"), "sound is on")
        self.wait("alarm of the disk", lambda: self.js("return window.alarms") > 0)

        # The simulated tagger sends a sync tag only if the pulse causes a click, so the page must show the rate as
        # filtered.
        self.wait("filter", lambda: self.text("sync-name") == "filtered sync")
        for number in "sync-rate", "click-rate", "dark-rate":
            self.wait(number, lambda: re.fullmatch(r"[\d.]+[kM]?/s", self.text(number)))
        self.wait("clicks a pulse", lambda: self.number("pulse-rate") > 0)
        self.wait("warning of pile-up", lambda: "Reduce the light to at most 0.000001" in self.text("pile-up"))
        self.wait("curves of the radar", lambda: self.js(
            "return ['of-temperature', 'of-margin'].every(id => !document.getElementById(id).hidden)"))
        self.choose(10)
        self.wait("sum of ten records", lambda: re.fullmatch(r"of 10 records from record \d+", self.text("rates-of")))
        self.choose(0)
        self.wait("no mark", lambda: "no mark" in self.text("rates-of"))
        newest = self.js("return record.index")
        self.answer("m", "door opened")
        found = lambda: re.fullmatch(r"of (\d+) records from record (\d+)", self.text("rates-of"))
        self.wait("sum of records since the mark", lambda: found() and int(found()[1]) >= 2 and int(found()[2]) >= newest)
        self.choose(1)

        # The viewer process is stopped. The page must report the lost connection to the viewer, not missing sensor
        # data.
        heard = self.js("return window.alarms")
        self.js("document.getElementById('status').seen = []; new MutationObserver(() => document.getElementById('status').seen.push("
                "document.getElementById('status').textContent)).observe(document.getElementById('status'), {childList: true})")
        viewer.send_signal(signal.SIGSTOP)
        self.wait("silence", lambda: re.fullmatch(r"no connection to the viewer for \d+ s", self.text("status")))
        self.assertEqual(self.verdict("spd"), "no connection")
        self.assertGreaterEqual(self.number("status"), 3)
        self.wait("alarm of the viewer", lambda: self.js("return window.alarms") > heard)
        time.sleep(2 * page.WINDOW_S + 1)
        self.assertNotIn("NO DATA", " ".join(self.js("return document.getElementById('status').seen")))
        viewer.send_signal(signal.SIGCONT)
        self.wait("viewer again", lambda: self.text("status").startswith("recording"))
        self.themes()

        heard = self.js("return window.alarms")
        self.close_lab()
        self.wait("alarm of the sensors", lambda: self.js("return window.alarms") > heard)
        daemon.kill()
        self.wait("crash", lambda: self.text("status").startswith("crashed at "))
        heard = self.js("return window.alarms")
        self.wait("alarm again", lambda: self.js("return window.alarms") > heard)
        self.browser.find_element("id", "sound").click()
        self.wait("silent page", lambda: not self.pressed("sound"))

    def test_web_page_shows_peak_fit_plan_view_and_pixel_values(self):
        scenes, model = self.dir / "scenes.sqlite", self.dir / "model.h5"
        self.program("sim", "dataset", "--out", scenes, "--people", 60, "--letters", 0, "--set", "radar_antennas=8")
        self.program("recon", "train", scenes, "--model", "nearest", "--out", model)
        self.run = scenes
        self.size(1400, 900)
        self.browser.get(self.view("--model", model))
        self.wait("record", lambda: self.js("return window.framesSeen") > 0)
        fit = r"; centre ([\d.]+) (m|ns), FWHM ([\d.]+) (cm|ns)$"
        self.wait("fit", lambda: re.search(fit, self.text("histogram-readout")) and re.search(fit, self.text("profile-readout")))
        metres = re.search(fit, self.text("histogram-readout"))
        peak = float(re.match(r"peak ([\d.]+) m", self.text("histogram-readout"))[1])
        self.assertAlmostEqual(float(metres[1]), peak, delta=0.1)
        self.key("n")
        self.wait("ns", lambda: (re.search(fit, self.text("histogram-readout")) or " " * 5)[2] == "ns")
        self.assertAlmostEqual(float(re.search(fit, self.text("histogram-readout"))[1]), 6.6713 * float(metres[1]), delta=0.04)
        self.assertIn("ns", self.js("return document.getElementById('unit').textContent"))
        self.key("n")
        # In the difference view of a sum, the mean over the first minute (20 records) is subtracted from each of the
        # summed records.
        rows = [struct.unpack(f"<{len(spd) // 4}I", spd) for spd, in query(scenes, "SELECT spd FROM record ORDER BY idx")]
        expected = max(sum(bins[-10:]) - sum(bins[:20]) / 2 for bins in zip(*rows))
        self.choose(10)
        self.key("d")
        self.wait("difference of the sum", lambda: (found := re.search(r", ([\d.]+)(k?) clicks", self.text("histogram-readout"))) and abs(
            float(found[1]) * (1000 if found[2] else 1) / expected - 1) < 0.01)
        self.key("d")
        self.choose(1)
        self.wait("first fit", lambda: metres[0] in self.text("histogram-readout"))
        # Zooming a chart limits the peak fit to the zoomed range.
        over = self.browser.find_element("css selector", "#histogram .u-over")
        ActionChains(self.browser).drag_and_drop_by_offset(over, 100, 0).perform()
        self.wait("other fit", lambda: metres[0] not in self.text("histogram-readout"))
        ActionChains(self.browser).double_click(over).perform()
        self.wait("first fit", lambda: metres[0] in self.text("histogram-readout") or
                  ActionChains(self.browser).move_to_element(self.browser.find_element("id", "file")).perform())

        # The map and the camera image show the value under the pointer. Without a pointer, they show the percentage
        # of pixels without a return.
        self.assertRegex(self.text("map-value") + self.text("camera-value"), r"^([\d.]+ % without a return){2}$")
        canvas = self.browser.find_element("id", "camera")
        ActionChains(self.browser).move_to_element_with_offset(canvas, -60, 40).perform()
        self.wait("value", lambda: re.match(r"(depth|no return)", self.text("camera-value")))
        words = self.js("""
            const canvas = document.getElementById('camera'), box = canvas.getBoundingClientRect();
            for (let y = 0; y < box.height; y += 6)
              for (let x = 0; x < box.width; x += 6) {
                canvas.dispatchEvent(new PointerEvent('pointermove', {clientX: box.left + x, clientY: box.top + y}));
                const words = document.getElementById('camera-value').textContent;
                if (words.startsWith('depth')) return words;
              }""")
        found = re.match(r"depth ([\d.]+) m; azimuth (-?[\d.]+)°, elevation .*; x (-?[\d.]+) m, z ([\d.]+) m", words or "")
        self.assertTrue(found, words)
        depth, azimuth, x, z = map(float, found.groups())
        self.assertAlmostEqual(depth, z, delta=0.01)
        self.assertAlmostEqual(self.js("return Math.tan(arguments[0] * Math.PI / 180)", azimuth) * z, x, delta=0.02)

        # The plan view shows the radar and the antennas in the detector's coordinates.
        self.wait("plan", lambda: self.canvas_is_drawn("plan"))
        seen = self.js("return [...fromRadar(-0.5, 3, 0.5), ...fromRadar(0.5, 1, 0.5)]")
        self.assertEqual(seen[:2], [3, 0])
        self.assertAlmostEqual(seen[3], 2 ** -0.5)
        self.wait("body", lambda: re.match(r"body at x -?[\d.]+ m.*, z [\d.]+ m, azimuth -?[\d.]+°$", self.text("place")))
        self.themes()
        self.assertEqual(self.contrast_faults(), [])


unittest.main(argv=[sys.argv[0], *(f"Panels.{name}" for name in sys.argv[2:])])
