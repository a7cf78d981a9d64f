#!/usr/bin/env python3
# SPDX-License-Identifier: MIT
"""tests/recon/report_page.py BIN_DIR: a report in Chromium: nothing overflows, nothing is asked of others, the points in
space are drawn, light and dark, wide and narrow. Exit code 77 without Chromium."""
import pathlib
import subprocess
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import chromium

bin_dir = pathlib.Path(sys.argv[1]).resolve()
faults = []


def run(*words):
    subprocess.run([bin_dir / words[0], *map(str, words[1:])], check=True, stdout=subprocess.DEVNULL)


def check(name, holds):
    if not holds:
        faults.append(name)


# What stands out of the page to the right, unless it is within a box that scrolls.
OUTSIDE = """return [...document.querySelectorAll('main *, header *')].filter(e =>
  e.getBoundingClientRect().right > innerWidth + 1 && !e.closest('.scroll') && !e.closest('svg svg, svg *')).map(e => e.outerHTML.slice(0, 80))"""
# Texts of a drawing that reach beyond it.
CUT = """return [...document.querySelectorAll('svg text')].filter(t => {
  const box = t.getBoundingClientRect(), svg = t.closest('svg').getBoundingClientRect();
  return box.right > svg.right + 1.5 || box.left < svg.left - 1.5 || box.bottom > svg.bottom + 1.5; }).map(t => t.textContent)"""
# Tables that are cut off: their first column must stay, and the edge must show it.
SCROLLED = """return [...document.querySelectorAll('.scroll')].filter(s => s.scrollWidth > s.clientWidth + 1 && !(
  getComputedStyle(s.querySelector('tbody th')).position == 'sticky' && getComputedStyle(s).backgroundImage.includes('gradient')))
  .map(s => s.textContent.slice(0, 60))"""
# The least letters of a drawing as it is shown, in pixels.
LETTERS = """return Math.min(...[...document.querySelectorAll('svg.drawing:not(svg svg)')].filter(s => s.getBoundingClientRect().width)
  .map(s => 13 * s.getBoundingClientRect().width / s.viewBox.baseVal.width))"""
DRAWN = """const gl = document.getElementById('cloud').getContext('webgl'); if (!gl) return -1;
const p = new Uint8Array(4 * gl.drawingBufferWidth * gl.drawingBufferHeight);
gl.readPixels(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight, gl.RGBA, gl.UNSIGNED_BYTE, p);
return p.filter((v, i) => i % 4 == 3 && v > 0).length"""

with tempfile.TemporaryDirectory() as folder:
    folder = pathlib.Path(folder)
    run("echofuse-sim", "dataset", "-q", "--out", folder / "run.sqlite", "--records", 240)
    for inputs in ("fused", "spd"):
        run("echofuse-recon", "train", "-q", folder / "run.sqlite", "--model", "ridge", "--inputs", inputs, "--out",
            folder / f"{inputs}.h5")
    run("echofuse-recon", "report", folder / "page", "--run", folder / "run.sqlite", "--fused", folder / "fused.h5",
        "--spd", folder / "spd.h5", "--live", folder / "run.sqlite")
    browser = chromium.start()
    try:
        browser.set_page_load_timeout(90)
        browser.get((folder / "page/report.html").as_uri())
        for width in (1280, 390):
            for scheme in ("light", "dark"):
                chromium.resize(browser, width, 900)
                browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {
                    "features": [{"name": "prefers-color-scheme", "value": scheme}]})
                name = f"{width} px, {scheme}"
                outside, cut = browser.execute_script(OUTSIDE), browser.execute_script(CUT)
                check(f"{name}: out of the page: {outside[:3]}", not outside)
                check(f"{name}: cut off: {cut[:5]}", not cut)
                scrolled, letters = browser.execute_script(SCROLLED), browser.execute_script(LETTERS)
                check(f"{name}: tables cut without a sign: {scrolled}", not scrolled)
                check(f"{name}: letters of {letters} px", letters >= 11)
                check(f"{name}: it is wider than the window",
                      browser.execute_script("return document.documentElement.scrollWidth") <= width)
                asked = browser.execute_script("return performance.getEntriesByType('resource').map(e => e.name)"
                                               ".filter(n => !n.startsWith('data:'))")
                check(f"{name}: asks for {asked}", not asked)
                paper = browser.execute_script("return getComputedStyle(document.body).backgroundColor")
                check(f"{name}: {paper}", (max(map(int, paper[4:-1].split(","))) < 60) == (scheme == "dark"))
        check("no points in space", browser.execute_script(DRAWN) != 0)
        check("the browser complains", not [m for m in browser.get_log("browser") if m["level"] == "SEVERE"])
    finally:
        browser.quit()
print("\n".join(faults) or "the report fits")
sys.exit(bool(faults))
