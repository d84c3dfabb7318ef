#!/usr/bin/env python3
"""Makes the pictures of docs/report.md of a report page.

usage: report_pictures.py [PAGE] [FOLDER]

PAGE is build/demo/model/report.html, which scripts/demo.sh makes, and FOLDER is
docs, unless given. Needs a Chromium (DGSFM_CHROMIUM, or on the path).
"""

import pathlib
import sys

from chromium import Chromium, find_chromium

ROOT = pathlib.Path(__file__).resolve().parents[1]
IS_READY = "document.documentElement?.dataset.ready === 'true'"
WIDTH = 1180
# Pixels of the picture per pixel of the page.
SCALE = 0.75

PICK_IMAGE = "page.sceneCard.select({image: page.data.models[0].images[4]})"
SHOW_VALID_PAIRS = "document.querySelector('.pair-choice input').click()"

# Name, colour scheme, what to do before, and first and last element in sight.
PICTURES = [
    ("report", "light", PICK_IMAGE, ".page-header", "#view"),
    ("report_pairs", "light", SHOW_VALID_PAIRS, "#view", "#pairs"),
    ("report_figures", "dark", "0", "#cameras", "#tracks"),
]


def box_of(browser, first, last, margin=12):
    """The part of the page (x, y, width, height) from one element to another."""
    top, bottom = browser.evaluate(
        f"""[document.querySelector('{first}').getBoundingClientRect().top,
             document.querySelector('{last}').getBoundingClientRect().bottom]
            .map((at) => at + scrollY)"""
    )
    top = max(0, top - margin)
    return 0, top, WIDTH, bottom - top + margin


def main():
    page = sys.argv[1] if len(sys.argv) > 1 else ROOT / "build/demo/model/report.html"
    folder = pathlib.Path(sys.argv[2]) if len(sys.argv) > 2 else ROOT / "docs"
    if find_chromium() is None:
        sys.exit("ERROR: there is no Chromium (apt-get install chromium)")
    for name, scheme, action, first, last in PICTURES:
        with Chromium(WIDTH, 900) as browser:
            browser.resize(WIDTH, 900, SCALE)
            browser.set_color_scheme(scheme)
            browser.open(page, IS_READY)
            browser.evaluate(f"{action}; 0")
            # Thumbnails and textures are decoded.
            for _ in range(3):
                browser.paint()
            path = folder / f"{name}.png"
            browser.screenshot(path, box_of(browser, first, last))
            print(path)


if __name__ == "__main__":
    main()
