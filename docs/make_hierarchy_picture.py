"""Take the pictures of the hierarchy's page: what became of each source, some worlds from above, and a frame of a film.

Usage: python docs/make_hierarchy_picture.py STUDY FOLDER   (needs the extra 'browser' and Chromium)
"""

import os
import shutil
import sys
import tempfile
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

from eyechart.report.page import write_page
from eyechart.studies.closed_loop import read_drives
from eyechart.studies.closed_loop.film import write_film
from eyechart.studies.closed_loop.replay import find_episode
from eyechart.studies.hierarchy import score
from eyechart.studies.hierarchy.page import make_hierarchy_page

WIDTH, WORLDS_HIGH = 1360, 760
EPISODE, MOMENT = "route rover-mpc-lateral/slalom/1 real", 6
"""The drive of which a frame is shown, and after how many decisions."""


def take(study: Path, folder: Path) -> None:
    """Write hierarchy.png, the second ablation in light colours, and plan.png, a frame of a film."""
    chromium = os.environ.get("EYECHART_CHROMIUM") or shutil.which("chromium")
    with tempfile.TemporaryDirectory() as work, sync_playwright() as playwright:
        page_file, film_file = Path(work) / "page.html", Path(work) / "film.gif"
        write_page(make_hierarchy_page(study, score(study)), page_file)
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox", "--disable-gpu"])
        page = browser.new_page(color_scheme="light", viewport={"width": WIDTH, "height": WORLDS_HIGH})
        page.goto(page_file.as_uri())
        page.locator("#second .figure").screenshot(path=Path(work) / "above.png")
        group = page.locator(".group").filter(has_text="mpc-oracle")
        group.evaluate("node => node.scrollIntoView({ block: 'start' })")
        box = group.bounding_box()
        assert box is not None
        clip = {"x": box["x"] - 1, "y": max(0, box["y"]), "width": box["width"] + 2, "height": WORLDS_HIGH - box["y"]}
        page.screenshot(path=Path(work) / "below.png", clip=clip)
        browser.close()
        parts = [Image.open(Path(work) / name).convert("RGB") for name in ("above.png", "below.png")]
        sheet = Image.new(
            "RGB", (max(part.width for part in parts), sum(part.height for part in parts) + 16), "#faf9f6"
        )
        sheet.paste(parts[0], (0, 0))
        sheet.paste(parts[1], (0, parts[0].height + 16))
        sheet.save(folder / "hierarchy.png", optimize=True)
        drives, found = find_episode(read_drives([study / "lateral"]), EPISODE)
        write_film(drives, found, film_file)
        with Image.open(film_file) as film:
            film.seek(MOMENT)
            film.convert("RGB").quantize(128, dither=Image.Dither.NONE).save(folder / "plan.png", optimize=True)


if __name__ == "__main__":
    take(Path(sys.argv[1]), Path(sys.argv[2]))
