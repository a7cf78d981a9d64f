#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""Checks the layout, the links, the keys and the escaping of report pages in Chromium, on the screen and as printed. Exits with
code 77 if Chromium is not installed."""
import pathlib
import sys
import tempfile
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import chromium
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "fixtures"))
import fixtures  # noqa: E402
from fixtures import program  # noqa: E402

faults = []


def check(name, holds):
    if not holds:
        faults.append(name)


# Returns the elements that extend beyond the right edge of the page, except those in scrolling boxes.
OUTSIDE = """return [...document.querySelectorAll('#report *, main *, header *')].filter(e => e.checkVisibility() &&
  e.getBoundingClientRect().right > innerWidth + 1 && !e.closest('.scroll, #sheet, h2')).map(e => e.outerHTML.slice(0, 80))"""
# Returns pairs of text elements that overlap.
OVERLAPS = """const all = [...document.querySelectorAll('h1, h2, h3, p, dt, dd, summary, li, button, .lamp strong, .verdict, .age')]
  .filter(e => e.textContent && e.checkVisibility() && !e.closest('#events, #sheet')).map(e => [e, e.getBoundingClientRect()]), out = [];
for (let i = 0; i < all.length; ++i) for (let j = i + 1; j < all.length; ++j) {
  const [[a, p], [b, q]] = [all[i], all[j]];
  if (!a.contains(b) && !b.contains(a) && Math.min(p.right, q.right) - Math.max(p.left, q.left) > 1 && Math.min(p.bottom, q.bottom) - Math.max(p.top, q.top) > 1)
    out.push(a.textContent.slice(0, 30) + ' | ' + b.textContent.slice(0, 30)); }
return out"""
# Returns the canvases with fewer than 8 colours, which are considered empty.
EMPTY = """return [...document.querySelectorAll('main canvas:not(#cloud)')].filter(c => c.checkVisibility() && c.width && !c.closest('#sheet, .strip')).filter(c => {
  const p = c.getContext('2d').getImageData(0, 0, c.width, c.height).data, seen = new Set();
  for (let i = 0; i < p.length; i += 4) seen.add(p[i] << 16 | p[i + 1] << 8 | p[i + 2]);
  return seen.size < 8; }).map(c => c.id || c.parentElement.className)"""
UNNAMED = """return [...document.querySelectorAll('.chart, .strip, main canvas[id]')].filter(at => !at.closest('[aria-label]')).map(at => at.id)"""
SHOWN = "return document.getElementById('shown').textContent"


def opened(browser, page):
    browser.get("about:blank")
    browser.get(page.as_uri())
    for _ in range(300):
        if browser.execute_script("return window.framesSeen") > 0:
            return
        time.sleep(0.1)
    faults.append(f"{page}: no record is shown")


def look(browser, page):
    """Checks the layout of a page in the light and dark themes, in a wide and a narrow window, and in print."""
    for width, height, scheme in ((1400, 900, "light"), (1400, 900, "dark"), (390, 844, "light"), (390, 844, "dark")):
        chromium.resize(browser, width, height)
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [{"name": "prefers-color-scheme", "value": scheme}]})
        chromium.drawn(browser)
        name = f"{page}, {width} px, {scheme}"
        fits(browser, name)
        check(f"{name}: wider than the window", browser.execute_script("return document.documentElement.scrollWidth") <= width)
        asked = browser.execute_script("return performance.getEntriesByType('resource').map(e => e.name)"
                                       ".filter(n => !n.startsWith('data:'))")
        check(f"{name}: requests {asked}", not asked)
        paper = browser.execute_script("return getComputedStyle(document.body).backgroundColor")
        check(f"{name}: {paper}", (max(map(int, paper[4:-1].split(","))) < 60) == (scheme == "dark"))
    chromium.resize(browser, 1400, 900)
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print", "features": []})
    browser.execute_script("dispatchEvent(new Event('beforeprint'))")
    fits(browser, f"{page}, on paper")
    wide = browser.execute_script("return Math.max(...[...document.querySelectorAll('.card')].map(e => e.getBoundingClientRect().right))")
    check(f"{page}, on paper: {wide} px wide", wide <= 702)
    browser.execute_script("dispatchEvent(new Event('afterprint'))")
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": []})


def fits(browser, name):
    for what, script in (("outside of the page", OUTSIDE), ("overlapping", OVERLAPS), ("blank", EMPTY)):
        found = browser.execute_script(script)
        check(f"{name}: {what}: {found[:3]}", not found)


with tempfile.TemporaryDirectory() as folder:
    folder = pathlib.Path(folder)
    run, models = folder / "run.sqlite", [folder / f"{inputs}.safetensors" for inputs in ("fused", "spd")]
    program("echofuse-sim", "dataset", "-q", "--out", run, "--records", 240)
    fixtures.change(run, "label <!--<script> instead of person")
    for model in models:
        words = ["--model", "ridge", "--set", "fallback=false", "--inputs", model.stem, "--out", model]
        program("echofuse-recon", "train", "-q", run, *words)
    for name, *words in (("page", "--run", run, "--model", *models, "--live", run), ("alone", "--live", run),
                         ("compared", "--run", run, "--compare", *models)):
        program("echofuse-report", folder / name, *words)
    browser = chromium.start()
    try:
        browser.set_page_load_timeout(90)
        opened(browser, folder / "page/report.html")
        look(browser, "report")
        check(f"charts without a name: {browser.execute_script(UNNAMED)}", not browser.execute_script(UNNAMED))
        check("no state of the lamps", browser.execute_script("return document.querySelector('#lamp-spd strong').textContent") == "OK")
        labels = browser.execute_script("return document.getElementById('report').textContent")
        check("the untrusted label is not shown", "<!--<script>" in labels)
        # A link shows its record, and the keys show the next and the previous record that the file contains.
        links = browser.execute_script("return [...document.querySelectorAll('#report a[href^=\"#\"]')].map(a => a.hash.slice(1))")
        check("no record's number is a link", len(links) > 3)
        for index in links[:3]:
            browser.execute_script("location.hash = arguments[0]", index)
            time.sleep(0.5)
            shown = browser.execute_script(SHOWN)
            check(f"record {index}: {shown}", shown.startswith(f"record {index},"))
        seen = []
        for key in ("Home", "ArrowRight", "ArrowLeft", "End"):
            browser.execute_script("document.dispatchEvent(new KeyboardEvent('keydown', {key: arguments[0]}))", key)
            time.sleep(0.5)
            seen.append(browser.execute_script(SHOWN).split()[1].rstrip(","))
        check(f"keys: {seen}", [seen[0], seen[2], seen[3]] == ["0", "0", "239"] and int(seen[1]) > 0)
        # The printed page uses the light theme. After printing, the page switches back to the previous theme.
        browser.execute_script("document.getElementById('theme').click()")
        looks = []
        for event in ("", "beforeprint", "afterprint"):
            looks.append(browser.execute_script("if (arguments[0]) dispatchEvent(new Event(arguments[0]));"
                                                "return [document.documentElement.dataset.theme, document.body.clientWidth]", event))
        check(f"on paper: {looks}", looks[1] == ["light", 700] and looks[2] == looks[0])
        browser.execute_cdp_cmd("Page.printToPDF", {"preferCSSPageSize": True})
        for other in ("compared", "alone"):
            opened(browser, folder / f"{other}/report.html")
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
