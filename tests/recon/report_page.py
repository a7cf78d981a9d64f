#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Opens report pages in Chromium: light and dark, wide and narrow, and as printed. Called as
`tests/recon/report_page.py BIN_DIR`. Checks that nothing overflows, overlaps or stays empty, and that the page
contacts no server. Maps and charts must show the values under the pointer. Untrusted text must be shown but not
executed. Exits with code 77 if Chromium is not installed."""
import pathlib
import subprocess
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import chromium
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "fixtures"))
import fixtures  # noqa: E402
from selenium.webdriver.common.action_chains import ActionChains

bin_dir = pathlib.Path(sys.argv[1]).resolve()
faults = []


def run(*words):
    subprocess.run([bin_dir / words[0], *map(str, words[1:])], check=True, stdout=subprocess.DEVNULL)


def check(name, holds):
    if not holds:
        faults.append(name)


# Returns the elements that extend beyond the right edge of the page, except those in scrolling boxes.
OUTSIDE = """return [...document.querySelectorAll('main *, header *')].filter(e =>
  e.getBoundingClientRect().right > innerWidth + 1 && !e.closest('.scroll')).map(e => e.outerHTML.slice(0, 80))"""
# Returns the tables that scroll but do not have both a fixed first column and a gradient at the edge.
SCROLLED = """return [...document.querySelectorAll('.scroll')].filter(s => s.scrollWidth > s.clientWidth + 1 && !(
  getComputedStyle(s.querySelector('tbody th')).position == 'sticky' && getComputedStyle(s).backgroundImage.includes('gradient')))
  .map(s => s.textContent.slice(0, 60))"""
# Returns pairs of text elements that overlap.
OVERLAPS = """const all = [...document.querySelectorAll('h1, h2, h3, p:not(.readout), figcaption, .named, .u-legend th, .u-legend td, summary, li, button')]
  .filter(e => e.textContent && e.checkVisibility()).map(e => [e, e.getBoundingClientRect()]), out = [];
for (let i = 0; i < all.length; ++i) for (let j = i + 1; j < all.length; ++j) {
  const [[a, p], [b, q]] = [all[i], all[j]];
  if (!a.contains(b) && !b.contains(a) && Math.min(p.right, q.right) - Math.max(p.left, q.left) > 1 && Math.min(p.bottom, q.bottom) - Math.max(p.top, q.top) > 1)
    out.push(a.textContent.slice(0, 30) + ' | ' + b.textContent.slice(0, 30)); }
return out"""
NAMES_OUT = """return [...document.querySelectorAll('.named')].filter(n => {
  const a = n.getBoundingClientRect(), b = n.parentElement.getBoundingClientRect();
  return a.left < b.left - 1 || a.right > b.right + 1 || a.top < b.top - 1 || a.bottom > b.bottom + 1; }).map(n => n.textContent)"""
# Returns the canvases with fewer than 8 colours, which are considered empty.
EMPTY = """return [...document.querySelectorAll('main canvas:not(#cloud)')].filter(c => c.checkVisibility() && c.width).filter(c => {
  const p = c.getContext('2d').getImageData(0, 0, c.width, c.height).data, seen = new Set();
  for (let i = 0; i < p.length; i += 4) seen.add(p[i] << 16 | p[i + 1] << 8 | p[i + 2]);
  return seen.size < 8; }).map(c => c.id || c.parentElement.className)"""
# Returns the values that the maps of the first figure show for the pixel under the pointer.
READOUTS = "return [...document.querySelector('.maps').querySelectorAll('.pixel')].map(p => p.textContent)"
DRAWN = """const gl = document.getElementById('cloud').getContext('webgl'); if (!gl) return -1;
const p = new Uint8Array(4 * gl.drawingBufferWidth * gl.drawingBufferHeight);
gl.readPixels(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight, gl.RGBA, gl.UNSIGNED_BYTE, p);
return p.filter((v, i) => i % 4 == 3 && v > 0).length"""


# Counts the legends that show values although the pointer is not over their chart.
LEGENDS = """return [...document.querySelectorAll('.u-live .u-value')].filter(v => getComputedStyle(v).visibility === 'visible').length"""
# Returns true if the floor below the point cloud is cut off at an edge of the canvas.
FLOOR = """const c = document.getElementById('cloud'), gl = c.getContext('webgl'), wide = gl.drawingBufferWidth, high = gl.drawingBufferHeight;
const row = (x, y, w, h) => { const p = new Uint8Array(4 * w * h); gl.readPixels(x, y, w, h, gl.RGBA, gl.UNSIGNED_BYTE, p); return p.some((v, i) => i % 4 === 3 && v > 0); };
return row(0, 0, wide, 1) || row(0, 0, 1, high) || row(wide - 1, 0, 1, high)"""
# Returns the chapters of the printed page that contain nothing but a heading.
EMPTY_CHAPTERS = """return [...document.querySelectorAll('section')].filter(s => s.checkVisibility() && ![...s.children].some(c =>
  c.tagName !== 'H2' && c.checkVisibility() && !(c.tagName === 'DETAILS' && !c.open))).map(s => s.ariaLabel)"""
# Returns the number of pixels by which the first table is wider than its box.
BEYOND = "const s = document.querySelector('main .scroll'); return s ? s.scrollWidth - s.clientWidth : 0"
DEAD_LINKS = """return [...document.querySelectorAll('a[href^="#"]')].filter(a => !document.getElementById(a.hash.slice(1))).map(a => a.hash)"""
UNNAMED = """return [...document.querySelectorAll('.chart, .strip, main canvas[id]')].filter(at => !at.closest('[aria-label]')).map(at => at.id)"""


def look(browser, page):
    """Checks the layout of a page in the light and dark themes, in a wide and a narrow window, and in print."""
    for width in (1280, 390):
        for scheme in ("light", "dark"):
            chromium.resize(browser, width, 900)
            browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {
                "features": [{"name": "prefers-color-scheme", "value": scheme}]})
            chromium.drawn(browser)
            name = f"{page}, {width} px, {scheme}"
            fits(browser, name)
            check(f"{name}: wider than the window",
                  browser.execute_script("return document.documentElement.scrollWidth") <= width)
            if page == "report":
                beyond = browser.execute_script(BEYOND)
                check(f"{name}: the first table is {beyond} px wider than its box", beyond <= 1)
            asked = browser.execute_script("return performance.getEntriesByType('resource').map(e => e.name)"
                                           ".filter(n => !n.startsWith('data:'))")
            check(f"{name}: requests {asked}", not asked)
            paper = browser.execute_script("return getComputedStyle(document.body).backgroundColor")
            check(f"{name}: {paper}", (max(map(int, paper[4:-1].split(","))) < 60) == (scheme == "dark"))
    chromium.resize(browser, 1280, 900)
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print", "features": []})
    browser.execute_script("dispatchEvent(new Event('beforeprint'))")
    fits(browser, f"{page}, on paper")
    empty = browser.execute_script(EMPTY_CHAPTERS)
    check(f"{page}, on paper: empty chapters {empty}", not empty)
    browser.execute_script("dispatchEvent(new Event('afterprint'))")
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": []})


def fits(browser, name):
    for what, script in (("outside of the page", OUTSIDE), ("overlapping", OVERLAPS), ("blank", EMPTY),
                         ("tables cut off without a sign", SCROLLED), ("names outside of their chart", NAMES_OUT)):
        found = browser.execute_script(script)
        check(f"{name}: {what}: {found[:3]}", not found)


with tempfile.TemporaryDirectory() as folder:
    folder = pathlib.Path(folder)
    run("echofuse-sim", "dataset", "-q", "--out", folder / "run.sqlite", "--records", 240)
    fixtures.change(folder / "run.sqlite", "label <!--<script> instead of person")
    for inputs in ("fused", "spd"):
        run("echofuse-recon", "train", "-q", folder / "run.sqlite", "--model", "ridge", "--set", "fallback=false", "--inputs", inputs, "--out",
            folder / f"{inputs}.h5")
    run("echofuse-report", folder / "page", "--run", folder / "run.sqlite", "--model", folder / "fused.h5", folder / "spd.h5",
        "--live", folder / "run.sqlite")
    run("echofuse-report", folder / "compared", "--run", folder / "run.sqlite", "--compare", folder / "fused.h5", folder / "spd.h5")
    run("echofuse-report", folder / "alone", "--live", folder / "run.sqlite")
    browser = chromium.start()
    try:
        browser.set_page_load_timeout(90)
        browser.get((folder / "page/report.html").as_uri())
        look(browser, "report")
        chromium.drawn(browser)
        check("no points in space", browser.execute_script(DRAWN) != 0)
        check("the floor is cut off", not browser.execute_script(FLOOR))
        check(f"charts without a name: {browser.execute_script(UNNAMED)}", not browser.execute_script(UNNAMED))
        check("legends with values", browser.execute_script(LEGENDS) == 0)
        chromium.resize(browser, 1280, 900)
        headings = browser.execute_script("return [...document.querySelectorAll('h2')].map(h => h.id)")
        check(f"sections: {headings}", headings == ["failures", "gallery", "errors", "labels", "metrics", "cost", "records",
                                                    "space", "live", "made", "terms"])
        check(f"links to nothing: {browser.execute_script(DEAD_LINKS)}", not browser.execute_script(DEAD_LINKS))
        check("no record's number is a link", browser.execute_script("return document.querySelectorAll('td a[href^=\"#record-\"]').length > 0"))
        labels = browser.execute_script("return document.getElementById('labels').parentElement.textContent")
        check(f"untrusted label is shown as {labels}", "<!--<script>" in labels)
        # Pointing at one map shows the values of all maps. Dragging zooms all maps, and a double click resets the
        # zoom.
        maps = browser.find_elements("css selector", ".maps")[0].find_elements("css selector", "canvas")
        browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", maps[0])
        quiet = browser.execute_script(READOUTS)
        ActionChains(browser).move_to_element_with_offset(maps[0], -20, 10).perform()
        readouts = browser.execute_script(READOUTS)
        check(f"readouts of the maps: {readouts}", len(readouts) == 3 and all("\N{DEGREE SIGN}" in t for t in readouts) and readouts != quiet)
        before = browser.execute_script("return arguments[0].toDataURL()", maps[1])
        ActionChains(browser).move_to_element_with_offset(maps[0], -60, -60).click_and_hold().move_by_offset(60, 60).release().perform()
        part = browser.execute_script("return arguments[0].toDataURL()", maps[1])
        ActionChains(browser).double_click(maps[0]).perform()
        whole = browser.execute_script("return arguments[0].toDataURL()", maps[1])
        check("dragging on a map does not zoom the other", part != before)
        check("a double click does not reset the zoom", whole not in (part, before))
        # A chart shows the values under the pointer.
        plot = browser.find_element("css selector", ".charts .u-over")
        browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", plot)
        ActionChains(browser).move_to_element(plot).perform()
        values = browser.execute_script("return [...document.querySelector('.charts .u-legend').querySelectorAll('.u-value')].map(v => v.textContent)")
        check(f"readout of a chart: {values}", len(values) >= 2 and all(v not in ("", "--", "\N{EN DASH}") for v in values))
        # The printed page uses the light theme. After printing, the page switches back to the previous theme.
        browser.find_element("id", "theme").click()
        looks = []
        for event in ("", "beforeprint", "afterprint"):
            looks.append(browser.execute_script("if (arguments[0]) dispatchEvent(new Event(arguments[0]));"
                                                "return [document.documentElement.dataset.theme, document.body.clientWidth]", event))
        check(f"on paper: {looks}", looks[1] == ["light", 700] and looks[2] == looks[0])
        browser.execute_cdp_cmd("Page.printToPDF", {"preferCSSPageSize": True})
        for other in ("compared", "alone"):
            browser.get((folder / f"{other}/report.html").as_uri())
            look(browser, other)
        size = (folder / "page/report.html").stat().st_size
        check(f"{size} bytes", size < 3e6)
        check("the browser logs errors", not [m for m in browser.get_log("browser") if m["level"] == "SEVERE"])
        ran = browser.execute_script("""const text = "document.title = 'ran'", script = document.createElement('script');
            script.textContent = text, document.body.append(script);
            document.body.insertAdjacentHTML('beforeend', `<img src="data:," onerror="${text}">`);
            return new Promise(done => setTimeout(() => done(document.title), 200))""")
        check(f"an untrusted script runs: {ran}", ran != "ran")
    finally:
        browser.quit()
print("\n".join(faults) or "the report passes")
sys.exit(bool(faults))
