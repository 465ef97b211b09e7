"""A picture of a report, docs/figures/report_page.png: its top, wide and dark, and on a telephone.

python scripts/report_page.py    (needs playwright and a chromium; CHROMIUM names its program)
"""

from __future__ import annotations

import io
import os
import tempfile
from pathlib import Path

from PIL import Image

from common import DATA, FIGURES
from torchliner.cli.main import main as torchliner

CASE, PRESSURE = "data/slit_g03_145_y0.5mm.h5", "data/pressure_g03_145.h5"
VIEWS = ((960, "light", ""), (960, "dark", "complex"), (390, "light", "along"))  # px, scheme, at
HEIGHT, GAP = 1500, 24


def main() -> None:
    from playwright.sync_api import sync_playwright

    program = os.environ.get("CHROMIUM", "/usr/bin/chromium")
    with tempfile.TemporaryDirectory() as name, sync_playwright() as play:
        found, page = Path(name) / "map.h5", Path(name) / "report.html"
        os.chdir(DATA.parent)  # so that the names on the page are those of the repository
        torchliner(["educe", CASE, "--in-situ", PRESSURE, "-o", str(found), "--quiet"])
        torchliner(["report", str(found), "--data", CASE, "-o", str(page), "--quiet"])
        browser = play.chromium.launch(executable_path=program, args=["--no-sandbox"])
        pictures = []
        for width, scheme, section in VIEWS:
            shown = browser.new_page(
                viewport={"width": width, "height": HEIGHT},
                color_scheme="dark" if scheme == "dark" else "light",
                reduced_motion="reduce",
            )
            shown.goto(page.as_uri())
            if section:
                shown.evaluate(f"document.getElementById('{section}').scrollIntoView()")
            pictures.append(Image.open(io.BytesIO(shown.screenshot())))
        browser.close()
    width = sum(picture.width for picture in pictures) + GAP * (len(pictures) - 1)
    whole, left = Image.new("RGB", (width, HEIGHT), "#808080"), 0
    for picture in pictures:
        whole.paste(picture, (left, 0))
        left += picture.width + GAP
    whole = whole.resize((width * 2 // 3, HEIGHT * 2 // 3), Image.Resampling.LANCZOS)
    whole.save(FIGURES / "report_page.png", optimize=True)


if __name__ == "__main__":
    main()
