"""Take the README's picture of a report: the verdicts on six known-answer controllers, and below them one frame.

Usage: python docs/make_report_picture.py BANK OUT.png   (needs the extra 'browser' and Chromium)
"""

import io
import os
import shutil
import sys
import tempfile
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page, sync_playwright

from eyechart.report.page import write_page
from eyechart.studies import battery
from eyechart.studies.battery.page import make_page
from eyechart.studies.battery.subjects import read_evidence

CONTROLLERS = ("constant", "presence", "scene_only", "crash_colour", "depth", "depth_lateral")
WIDTH, TOP, BELOW = 1360, 757, 762


def make_report(bank: Path, folder: Path) -> Path:
    """Run the battery of the six controllers on a bank and return its report."""
    run = folder / "six-controllers"
    battery.run(battery.plan(bank, [f"scripted:{name}" for name in CONTROLLERS], run))
    write_page(make_page(read_evidence([run], [bank], score=battery.score)), folder / "report.html")
    return folder / "report.html"


def shot(page: Page, selector: str, height: int) -> Image.Image:
    """Return what the window shows when it is scrolled to an element."""
    page.set_viewport_size({"width": WIDTH, "height": height})
    page.evaluate("selector => document.querySelector(selector).scrollIntoView({ block: 'start' })", selector)
    page.wait_for_timeout(300)
    return Image.open(io.BytesIO(page.screenshot()))


def take(report: Path, out: Path) -> None:
    """Write the picture: the top of the page in light colours, and the browser of frames in dark ones."""
    chromium = os.environ.get("EYECHART_CHROMIUM") or shutil.which("chromium")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox", "--disable-gpu"])
        page = browser.new_page(color_scheme="light")
        page.goto(report.as_uri())
        above = shot(page, "body", TOP)
        page.emulate_media(color_scheme="dark")
        page.select_option("#f-model", "5")
        page.locator("#list button").nth(4).click()
        below = shot(page, "#filters", BELOW)
        browser.close()
    sheet = Image.new("RGB", (WIDTH, TOP + BELOW))
    sheet.paste(above, (0, 0))
    sheet.paste(below, (0, TOP))
    out.parent.mkdir(parents=True, exist_ok=True)
    sheet.save(out, optimize=True)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as work:
        take(make_report(Path(sys.argv[1]), Path(work)), Path(sys.argv[2]))
