# SPDX-License-Identifier: MIT
"""Starts Chromium to test web pages. If Chromium is not installed, importing this module exits with code 77 (test
skipped)."""
import shutil
import sys

try:
    from selenium import webdriver
    from selenium.webdriver.chrome.options import Options
    from selenium.webdriver.chrome.service import Service
except ImportError:
    webdriver = None
if not (webdriver and shutil.which("chromium") and shutil.which("chromedriver")):
    print("skipped: chromium, chromium-driver or python3-selenium is not installed (./scripts/setup --tests)")
    sys.exit(77)


def start():
    options = Options()
    for argument in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--enable-unsafe-swiftshader",
                     "--disable-background-networking", "--disable-component-update", "--no-first-run"):
        options.add_argument(argument)
    options.binary_location = shutil.which("chromium")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    return webdriver.Chrome(service=Service(shutil.which("chromedriver")), options=options)


def resize(browser, width, height):
    """Sets the size of the window. Widths below 600 emulate a phone with a touch screen."""
    browser.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": width < 600})
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", {
        "width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600})
    drawn(browser)


def drawn(browser):
    """Waits for two animation frames, so that the resized page has been drawn."""
    browser.execute_async_script("const done = arguments[0]; requestAnimationFrame(() => requestAnimationFrame(done))")
