"""What the page of 20 models on 288 frames under 15 conditions weighs, and the processor time to open it in Chromium.

    make long-page

Known-answer controllers answer a bank of textured pictures, 600 by 160 pixels, at some length; the page is made of
their run, copied to 20 models with words of their own. It is opened in a fresh browser each time, wide and narrow. Time
is the processor time of all processes of the browser from the address until the page is drawn, and then, apart, until
the replies are listed. Writes ``benchmarks/results/large_page.json``; exit 1 where the page has 15 MB or more, or the
median of a width takes 2 s or more to be drawn.
"""

import argparse
import datetime as dt
import json
import os
import shutil
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from playwright.sync_api import Browser, sync_playwright

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "tests")]

from eyechart import __version__  # noqa: E402 - the tests lie beside
from eyechart.report.page import write_page  # noqa: E402
from eyechart.studies.battery.page import make_page  # noqa: E402
from large_runs import CONDITIONS, FRAMES, MODELS, large_evidence  # noqa: E402 - of the tests, which make it too

RESULT = ROOT / "benchmarks" / "results" / "large_page.json"
MOST_BYTES, MOST_CPU_S = 15_000_000, 2.0
WIDTHS = (1280, 400)
TIMES = 10
DRAWN = "new Promise(done => requestAnimationFrame(() => setTimeout(done, 0)))"


def processor_s(browser: Browser) -> float:
    """Return the processor seconds that all processes of a browser took."""
    session = browser.new_browser_cdp_session()
    found = session.send("SystemInfo.getProcessInfo")["processInfo"]
    session.detach()
    return sum(float(one["cpuTime"]) for one in found)


def opened(chromium: Any, path: str, url: str, width: int) -> dict[str, float]:  # noqa: ANN401 - playwright's own type
    """Open a page in a fresh browser: processor and wall seconds until it is drawn, elements, and replies unpacked."""
    browser = chromium.launch(executable_path=path, args=["--no-sandbox", "--disable-gpu"])
    page = browser.new_page(viewport={"width": width, "height": 900})
    page.goto("about:blank")
    page.evaluate(DRAWN)
    before, begun = processor_s(browser), time.monotonic()
    page.goto(url)
    page.evaluate(DRAWN)
    took = {"cpu_s": processor_s(browser) - before, "wall_s": time.monotonic() - begun}
    took["elements"] = page.evaluate("document.querySelectorAll('*').length")
    before, begun = processor_s(browser), time.monotonic()
    page.evaluate("document.getElementById('frames')?.scrollIntoView()")
    if url.endswith(".html"):
        page.locator("#list button").first.wait_for(timeout=120_000)
    took |= {"replies_cpu_s": processor_s(browser) - before, "replies_wall_s": time.monotonic() - begun}
    browser.close()
    return took


def make(file: Path, work: Path, given: Path | None) -> float:
    """Write the page, or copy one that was made before; return the processor seconds that making it took."""
    if given is not None:
        shutil.copy(given, file)
        return 0.0
    evidence = large_evidence(work, ("constant", "random", "depth", "presence"), times=TIMES)
    begun = time.process_time()
    write_page(make_page([evidence]), file)
    return time.process_time() - begun


def main() -> int:
    """Make the page, open it, and write what it took."""
    options = argparse.ArgumentParser()
    options.add_argument("--opens", type=int, default=5)
    options.add_argument("--page", type=Path, help="a page that was made before, rather than one made anew")
    given = options.parse_args()
    path = os.environ.get("EYECHART_CHROMIUM") or shutil.which("chromium") or ""
    with tempfile.TemporaryDirectory() as work:
        file = Path(work) / "report.html"
        made = make(file, Path(work), given.page)  # before the browser, which brings an event loop of its own
        with sync_playwright() as playwright:
            turns = [
                {width: opened(playwright.chromium, path, file.as_uri(), width) for width in WIDTHS}
                for _ in range(given.opens)
            ]
            empty = statistics.median(
                opened(playwright.chromium, path, "data:text/html,<p>nothing", WIDTHS[0])["cpu_s"]
                for _ in range(given.opens)
            )
        size = file.stat().st_size
    found: dict[str, Any] = {
        "eyechart": __version__,
        "date": dt.datetime.now(dt.UTC).date().isoformat(),
        "models": MODELS,
        "frames": FRAMES,
        "conditions": CONDITIONS,
        "bytes": size,
        "elements": turns[0][WIDTHS[0]]["elements"],
        "make_cpu_s": round(made, 1),
        "empty_page_cpu_s": round(empty, 3),
        "opens": given.opens,
    }
    for width in WIDTHS:
        for what in ("cpu_s", "wall_s", "replies_cpu_s", "replies_wall_s"):
            every = [turn[width][what] for turn in turns]
            found[f"{width}_px_{what}"] = [round(one, 2) for one in every]
            found[f"{width}_px_median_{what}"] = round(statistics.median(every), 2)
    RESULT.write_text(json.dumps(found, indent=1) + "\n")
    sys.stdout.write(json.dumps(found, indent=1) + "\n")
    slow = any(found[f"{width}_px_median_cpu_s"] >= MOST_CPU_S for width in WIDTHS)
    return int(slow or size >= MOST_BYTES)


if __name__ == "__main__":
    raise SystemExit(main())
