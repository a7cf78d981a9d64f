#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Uses Chromium to test the viewer's web page with a simulated live run."""
import os
import pathlib
import re
import signal
import sys
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import chromium
from selenium.webdriver.common.action_chains import ActionChains

import live_view
import proxy
import waiting
from live import WINDOW_S, wait_for

PATIENCE_S = 60  # time limit in s, which is long because a busy machine renders slowly


# Returns the number of pixels by which elements move when the status and the label change from the shortest to the
# longest text.
header_jumps = """
  const at = () => ['numbers', 'lamps', 'transport', 'card-histogram', 'card-maps'].map(id => document.getElementById(id).getBoundingClientRect()).flatMap(r => [r.left, r.top]);
  const say = words => {
    for (const id in words) document.getElementById(id).textContent = words[id];
    return at();
  };
  const label = 'a person who holds the letter C and walks from the wall on the left to the window and back again, slowly, '.repeat(2);
  const lamp = (word, text, note) => document.querySelectorAll('.lamp').forEach(at => [['strong', word], ['.verdict', text], ['.age', note]].forEach(
    ([part, words]) => { at.querySelector(part).textContent = words; }));
  lamp('OK', '', '');
  const short = say({status: 'complete', label: '–', 'doubts-text': 'no record is doubtful', shown: '–', records: '1', elapsed: '0:01', disk: '1 GB', about: 'records of 3 s'}),
    long = say({status: 'recording; check SPD, radar, depth camera', label, 'doubts-text': label, shown: `record 7, ${label}`, records: '123456 / 200000',
                elapsed: '123:45:06', disk: '81.5 GB (123:45:06)', about: `records of 3 s on a-long-name.${'department.'.repeat(9)}example.org by ${label}`});
  lamp('CHECK', 'weak: 123 clicks above the background (minimum 1000); also lossy: 12 of 34 frames', 'last data 12.3 s ago');
  document.body.classList.toggle('held');
  const worse = at();
  document.body.classList.toggle('held');
  return Math.max(...short.map((v, i) => Math.abs(v - worse[i])), ...short.map((v, i) => Math.abs(v - long[i])));
"""


class Page(live_view.LiveView):
    def setUp(self):
        super().setUp()
        self.browser = chromium.start()

    def tearDown(self):
        self.browser.quit()
        super().tearDown()

    def js(self, code, *arguments):
        return self.browser.execute_script(code, *arguments)

    def text(self, element):
        return self.js("return document.getElementById(arguments[0]).textContent", element)

    def lamp(self, sensor):
        return self.js("return document.getElementById('lamp-' + arguments[0]).dataset.lamp", sensor)

    def verdict(self, sensor):
        return self.js("return document.querySelector(`#lamp-${arguments[0]} .verdict`).textContent", sensor)

    def wait(self, what, condition):
        wait_for(what, condition, PATIENCE_S)

    def key(self, key):
        self.js("document.dispatchEvent(new KeyboardEvent('keydown', {key: arguments[0], bubbles: true}))", key)

    def answer(self, key, text):
        """Presses the key m (mark) or l (label), and answers the question of the page."""
        self.key(key)
        self.wait("question", lambda: self.js("return document.getElementById('ask-text').checkVisibility()"))
        self.js("document.getElementById('ask-text').value = arguments[0]; document.getElementById('ask-ok').click()", text)

    def size(self, width, height, scheme=None, *features):
        """Sets the size of the window, and the theme that the user prefers."""
        chromium.resize(self.browser, width, height)
        if scheme:
            preferred = [{"name": "prefers-color-scheme", "value": scheme}, *features]
            self.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": preferred})
            chromium.drawn(self.browser)

    def looks_right(self, width, height, scheme):
        """Checks that the page does not overflow horizontally, and the contrast of its texts."""
        self.size(width, height, scheme, {"name": "prefers-reduced-motion", "value": "reduce"})  # lamps change colour at once
        time.sleep(0.3)
        wide, inner = self.js("return [document.documentElement.scrollWidth, innerWidth]")
        self.assertLessEqual(wide, inner, (width, scheme))
        self.assertEqual(self.contrast_faults(), [], (width, scheme))

    def canvas_is_drawn(self, canvas):
        return self.js("""const c = document.getElementById(arguments[0]), p = c.getContext('2d').getImageData(0, 0, c.width,
            c.height).data; const seen = new Set(); for (let i = 0; i < p.length; i += 4) seen.add(p[i] << 16 | p[i + 1] << 8 |
            p[i + 2]); return seen.size;""", canvas) > 20

    def test_web_page_follows_a_live_run(self):
        model = self.dir / "model.h5"
        scenes = self.dir / "scenes.sqlite"
        self.program("sim", "dataset", "--out", scenes, "--records", 80)
        self.program("recon", "train", scenes, "--model", "ridge", "--set", "fallback=false", "--out", model)
        self.chooser(scenes)
        address, viewer = self.view("--model", model), self.processes[-1]
        daemon = self.record("--set", "run.label=empty")
        self.size(1280, 800)
        self.browser.get(address)
        self.wait("record on the page", lambda: self.js("return window.framesSeen") > 1)
        before = int(self.text("records"))
        self.wait("next record", lambda: int(self.text("records")) > before)
        self.wait("status of a recording", lambda: self.text("status").startswith("recording"))
        for width in 1400, 1000, 400:
            self.size(width, 800)
            self.assertEqual(self.js(header_jumps), 0, width)
        self.size(1280, 800)
        for canvas in ("map", "camera"):
            self.wait(f"drawing in {canvas}", lambda: self.canvas_is_drawn(canvas))
        self.assertFalse(self.js("return document.getElementById('box-reconstruction').hidden"))
        self.assertGreater(self.js("return document.querySelectorAll('#histogram canvas').length"), 0)

        # Narrow and wide pages must not overflow horizontally in the light theme or in the dark theme.
        for width, height, scheme in ((390, 844, "light"), (1280, 800, "dark"), (820, 1180, "light")):
            self.looks_right(width, height, scheme)
        self.size(1280, 800)

        # Keys are used to select another record, to return to the live record, and to add a mark.
        self.key("Home")
        self.wait("record 0", lambda: self.text("shown").startswith("record 0,"))
        # Space opens the settings if they have the focus, and does not change the record.
        self.js("document.querySelector('#card-facts summary').dispatchEvent(new KeyboardEvent('keydown', {key: ' ', bubbles: true}))")
        self.assertTrue(self.js("return document.body.classList.contains('held')"))
        self.key("ArrowRight")
        self.wait("record 1", lambda: self.text("shown").startswith("record 1,"))
        self.key("End")
        self.wait("live record", lambda: int(self.text("shown").split()[1].rstrip(",")) > 1)
        self.wait("thumbnails", lambda: self.js("return document.querySelectorAll('#sheet button').length") > 0)
        self.answer("m", "door opened")
        self.wait("mark", lambda: "door opened" in self.text("events"))
        self.answer("l", "two")
        self.wait("label", lambda: self.text("label") == "two")
        self.looks()

        # The laboratory is stopped. Two slots later, every lamp must be red and show LOST.
        self.wait("lamps", lambda: {self.lamp("radar"), self.lamp("maps")} <= {"ok", "look"})
        self.close_lab()
        closed = time.monotonic()
        self.wait("red lamps", lambda: [self.lamp(sensor) for sensor in ("spd", "radar", "depth")] == ["bad"] * 3)
        late_s = time.monotonic() - closed
        if late_s >= 2 * WINDOW_S + 10:
            starved = waiting.starved(*waiting.descendants(os.getpid()))
            self.assertTrue(starved, f"the lamps were red only after {late_s:.1f} s")
            waiting.not_checked(f"time until the lamps are red ({late_s:.1f} s)", starved)
        self.assertIn("LOST", self.js("return document.getElementById('lamp-spd').textContent"))
        self.wait("status of the page", lambda: self.text("status") == "NO DATA from any sensor")
        self.wait("lamp of the maps", lambda: self.lamp("maps") == "bad" and self.verdict("maps") ==
                  "lacks SPD and radar, which the model needs")
        self.assertRegex(self.text("histogram-readout"), r"^no data; last data in record \d+$")
        self.assertIn("old", self.js("return document.getElementById('histogram').className"))
        self.assertGreater(self.js("return +document.querySelector('#losses tr td:nth-child(3)').textContent"), 0)
        daemon.kill()
        daemon.wait()
        self.wait("crash on the page", lambda: self.text("status").startswith("crashed at "))

        # The viewer is stopped. The page must show that the connection has been lost.
        viewer.terminate()
        self.assertEqual(viewer.wait(10), 0)
        self.wait("status of the page", lambda: "no connection" in self.text("status"))
        self.view("--model", model, listen=address.split("/")[2])
        self.wait("page of the viewer started again", lambda: self.text("status").startswith("crashed at "))

        # The page must follow a new run that has the same name as the first run. In the new run, the laser is 500
        # times too weak.
        for file in self.dir.glob("*.sqlite*"):
            file.unlink()
        self.open_again("--set", "signal_photons=100")
        daemon = self.record()
        self.wait("new run", lambda: self.text("status").startswith("recording") and int(self.text("records")) > 1)
        self.wait("verdict of the weak laser", lambda: self.verdict("spd").startswith("weak: "))
        self.assertEqual(self.lamp("spd"), "look")
        self.assertIn("CHECK", self.text("lamp-spd"))
        self.wait("maps lamp with the verdict", lambda: self.lamp("maps") == "look" and "SPD: weak: " in self.verdict("maps"))
        self.wait("green lamp of the radar", lambda: self.lamp("radar") == "ok")
        self.wait("event of the weak laser", lambda: "SPD: record" in self.text("events") and "weak: " in self.text("events"))
        self.wait("maps of the thumbnails", lambda: self.js(
            "return +document.querySelector('#sheet button:last-child').dataset.index") > 0)
        self.finish(daemon, signal.SIGINT)
        self.wait("end of the run", lambda: self.text("status").startswith("complete at "))
        # After the end, a lamp shows the verdict on the whole run.
        self.wait("verdict of the run", lambda: re.fullmatch(r"weak in \d+ of \d+ records", self.verdict("spd")))
        self.assertRegex(self.text("doubts-text"), r"^\d+ of \d+ doubtful, last at [\d: -]+ UTC \(record \d+\): .*SPD weak \d+")
        self.browser.find_element("id", "acknowledge").click()
        self.assertRegex(self.text("doubts-text"), r"\(record \d+\), acknowledged: ")
        self.assertEqual(self.js("return document.getElementById('doubts').dataset.none"), "true")
        self.assertEqual(self.lamp("spd"), "look")
        # The difference view is available in a complete run, even if the run is short.
        self.wait("difference", lambda: not self.js("return document.getElementById('difference').disabled"))
        before = self.text("histogram-readout")
        self.key("d")
        self.assertNotEqual(self.text("histogram-readout"), before)
        faults = [entry["message"] for entry in self.browser.get_log("browser")
                  if entry["level"] == "SEVERE" and "/live" not in entry["message"]]
        self.assertEqual(faults, [])
        asked = self.js("return performance.getEntriesByType('resource').map(e => new URL(e.name).host)")
        self.assertEqual(set(asked), {address.split("/")[2]})

    def test_web_page_works_behind_a_reverse_proxy(self):
        self.program("sim", "dataset", "--out", "scenes.sqlite", "--records", 8)
        before = proxy.Proxy(self.view(of=self.dir))
        self.addCleanup(before.close)
        self.browser.get(f"{before.address}/lab/")
        card = "return document.querySelector('.run h2')?.textContent"
        self.wait("run in the list", lambda: self.js(card) == "scenes")
        self.js("document.querySelector('.run').click()")
        self.wait("its record", lambda: self.js("return window.framesSeen") > 0)
        self.assertEqual(self.js("return location.pathname"), "/lab/run/scenes/")
        named = "return [...document.querySelectorAll('.chart, .strip')].filter(at => at.role !== 'img' || !at.ariaLabel).map(at => at.id)"
        self.assertEqual(self.js(named), [])
        self.browser.find_element("id", "runs").click()
        self.wait("list again", lambda: self.js(card) == "scenes")
        self.browser.find_element("id", "newest").click()
        self.wait("the newest run", lambda: self.js("return window.framesSeen") > 0)
        self.browser.find_element("id", "runs").click()
        self.wait("list once more", lambda: self.js(card) == "scenes")
        self.browser.get(f"{before.address}/plain/newest/")
        self.wait("reason", lambda: "expected a WebSocket" in self.text("trouble"))
        self.assertEqual(self.text("status"), "no connection to the viewer")

    def test_web_page_shows_the_histogram_of_each_detector_zone(self):
        for name, side in ("nine", 3), ("one", 1):
            self.program("sim", "dataset", "--out", f"{name}.sqlite", "--people", 1, "--set", f"spd_zones={side}", "--set", "target_x_m=0")
        address = self.view(of=self.dir)
        for name in "one", "nine":
            self.browser.get(address.replace("?", f"run/{name}/?"))
            self.wait("its record", lambda: self.js("return window.framesSeen ?? 0") > 0)
            self.assertEqual(self.js("return document.getElementById('card-zones').hidden"), name == "one")
            self.assertRegex(self.text("histogram-readout"), r"peak \d+\.\d\d m, [\d.]+k clicks")
        # Counts the pixels in the histogram colour in each cell of the 3 x 3 grid, beginning at the top left.
        self.wait("histograms", lambda: self.canvas_is_drawn("zones"))
        drawn = self.js("""const c = document.getElementById('zones'), p = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
            const [r, g, b] = getComputedStyle(document.body).getPropertyValue('--spd').match(/[0-9a-f]{2}/gi).map(t => parseInt(t, 16));
            const cells = Array(9).fill(0), side = Math.min(c.width, c.height), left = (c.width - side) / 2;
            for (let y = 0; y < side; ++y)
              for (let x = 0; x < side; ++x) {
                const at = 4 * (Math.floor(left + x) + c.width * y);
                if (Math.hypot(p[at] - r, p[at + 1] - g, p[at + 2] - b) < 60) ++cells[3 * Math.floor(3 * y / side) + Math.floor(3 * x / side)];
              }
            return cells;""")
        self.assertGreater(min(drawn), 0, drawn)
        # The person is in the middle column.
        self.assertEqual(max(range(9), key=drawn.__getitem__) % 3, 1, drawn)

    def chooser(self, scenes):
        """Checks that clicking on a run in the list opens the run, and that a link leads back to the list."""
        self.browser.get(self.view(of=self.dir))
        cards = "return [...document.querySelectorAll('.run h2')].map(at => at.textContent)"
        self.wait("run in the list", lambda: self.js(cards) == [scenes.stem])
        words = self.js("return document.querySelector('.run').textContent")
        for part in "complete", "80 records", ", 4:00,", "person 20":
            self.assertIn(part, words)
        for width, scheme in ((390, "light"), (1280, "dark")):
            self.looks_right(width, 800, scheme)
        # A redrawn list keeps the keyboard focus.
        self.js("document.querySelector('.run').focus(); draw()")
        self.assertEqual(self.js("return document.activeElement.className"), "card run")
        # The click is performed by a script, because the list may be redrawn at any time.
        self.js("document.querySelector('.run').click()")
        self.wait("page of the run", lambda: self.js("return document.getElementById('file')?.textContent") == scenes.name)
        self.wait("its record", lambda: self.js("return window.framesSeen") > 0)
        self.browser.find_element("id", "runs").click()
        self.wait("list again", lambda: self.js(cards) == [scenes.stem])
        self.processes[-1].terminate()

    def looks(self):
        """Checks the keys that change the histogram, the point cloud and the font size. Also checks zooming and
        measuring in the charts."""
        peaks = (("histogram-readout", r"peak \d+\.\d\d m, [\d.]+[kM]? clicks(; centre [\d.]+ m, FWHM [\d.]+ cm)?"),
                 ("profile-readout", r"peak \d+\.\d\d m, [\d.]+ dB(; centre [\d.]+ m, FWHM [\d.]+ cm)?"))

        # Holds the displayed record, so that the page is changed only by the keys.
        def hold():
            self.key(" ")
            self.wait("held record", lambda: "held" in self.text("shown"))
            whole = all(re.fullmatch(words, self.text(at)) for at, words in peaks)
            if not whole:
                self.key(" ")
            return whole
        self.wait("record with both peaks", hold)
        for key, button in ("g", "log"), ("h", "hold"):
            for pressed in "true", "false":
                self.key(key)
                self.assertEqual(self.js("return document.getElementById(arguments[0]).getAttribute('aria-pressed')", button),
                                 pressed)
        # Dragging zooms both charts, two clicks measure a distance, and a double click resets the zoom.
        over = self.browser.find_element("css selector", "#histogram .u-over")
        ends = "return [...document.querySelectorAll('#card-histogram .u-over, #card-profile .u-over')].length"
        self.assertEqual(self.js(ends), 2)
        shown = "return document.querySelector('#profile canvas').toDataURL()"
        whole = self.js(shown)
        ActionChains(self.browser).drag_and_drop_by_offset(over, 120, 0).perform()
        self.assertNotEqual(self.js(shown), whole)
        for at in (-50, 50):
            ActionChains(self.browser).move_to_element_with_offset(over, at, 0).click().pause(0.6).perform()
        self.assertRegex(self.text("histogram-readout"), r"^A to B [\d.]+ cm; peak ")
        ActionChains(self.browser).double_click(over).move_to_element(
            self.browser.find_element("id", "histogram-readout")).perform()
        self.assertNotIn("A to B", self.text("histogram-readout"))
        picture = "return document.getElementById('cloud').toDataURL()"
        for key in "ArrowLeft", "+":
            before = self.js(picture)
            self.js("document.getElementById('cloud').dispatchEvent(new KeyboardEvent('keydown', {key: arguments[0]}))", key)
            self.assertNotEqual(self.js(picture), before, key)
        self.key("f")
        font_size = "return parseFloat(getComputedStyle(document.querySelector('#lamp-spd strong')).fontSize)"
        self.assertGreaterEqual(self.js(font_size), 44)
        self.key("f")
        before = self.js("return getComputedStyle(document.body).backgroundColor")
        self.key("t")
        self.assertNotEqual(self.js("return getComputedStyle(document.body).backgroundColor"), before)
        self.key("t")
        self.key(" ")
        self.wait("live record", lambda: "held" not in self.text("shown"))

    def contrast_faults(self):
        """Returns the text elements with a contrast below the limit of WCAG 2.1 AA. The limit is a ratio of 4.5, or 3
        for large text."""
        return self.js(r"""
            const part = v => (v /= 255) <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
            const luminance = ([r, g, b]) => 0.2126 * part(r) + 0.7152 * part(g) + 0.0722 * part(b);
            const rgb = text => text.match(/[\d.]+/g).map(Number);
            const faults = [];
            for (const at of document.querySelectorAll('body *')) {
              if (![...at.childNodes].some(n => n.nodeType === 3 && n.textContent.trim()) || !at.offsetParent || at.disabled) continue;
              const style = getComputedStyle(at);
              let under = at;
              while (under && (rgb(getComputedStyle(under).backgroundColor)[3] ?? 1) === 0) under = under.parentElement;
              const [a, b] = [luminance(rgb(style.color)), luminance(rgb(getComputedStyle(under ?? document.body).backgroundColor))];
              const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05), size = parseFloat(style.fontSize);
              if (ratio < (size >= 24 || (size >= 18.7 && +style.fontWeight >= 700) ? 3 : 4.5))
                faults.push(`${at.tagName} ${at.id} "${at.textContent.slice(0, 30)}" ${ratio.toFixed(2)}`);
            }
            return faults;""")


if __name__ == "__main__":
    unittest.main(argv=[sys.argv[0], *(f"Page.{name}" for name in vars(Page) if name.startswith("test_"))])
