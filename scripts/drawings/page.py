"""Draw the page that cuts, after a cut along an excision, photographed in a headless Chromium: page-path.png.

    python -m scripts.drawings.page

It lies in assets/pictures.  A seeded hand cuts, :func:`measure_page.led`, about a millimetre off the line.
Needs Debian's ``chromium``.
"""

from __future__ import annotations

import json
import tempfile
import time
from pathlib import Path

from PIL import Image  # comes with matplotlib

from cutenv.people.browser import write_page_alone
from cutenv.people.browser.stylus_steps import HandPathCut
from scripts.browsers import chromium
from scripts.drawings.view import COLOURS, PICTURES
from scripts.validation.classroom.page_in_browsers import led

WIDTH = 1100  # px, of the window
SEED = 4  # of specimen and hand
CUT = """(() => {
  const { page, laws, told } = cutenvPage, stylus = %s, cut = page.cut = new HandCut(laws.path, told.specimens[0]);
  for (let i = 0; i < stylus.length; i += 200) cut.advance(stylus.slice(i, i + 200));
})()"""


def main() -> None:
    """Cut in Python, repeat the cut in the page, and photograph its end."""
    stylus = led(HandPathCut(seed=SEED, line="excision"), SEED)
    picture = PICTURES / "page-path.png"
    with tempfile.TemporaryDirectory() as folder:
        path, shot, profile = (Path(folder) / name for name in ("cut.html", "cut.png", "profile"))
        write_page_alone(path, tasks=("path",), lines=("excision",), specimen_classes=("liver",), count=1, seed=SEED)
        with chromium.browser(profile) as page:
            page.open(path, WIDTH)
            for said, then in (
                ("Boolean(window.cutenvPage?.page.cut)", "cutenvPage.start()"),
                ("cutenvPage.page.phase === 'cutting'", CUT % json.dumps(stylus)),
                ("cutenvPage.page.phase === 'ended'", "document.activeElement.blur()"),
            ):
                while not page.value(said):
                    time.sleep(0.05)
                page.value(f"void {then}")
            page.screenshot(shot)
        Image.open(shot).convert("RGB").quantize(COLOURS, kmeans=3).save(picture, optimize=True)
    print(f"picture: {picture} ({picture.stat().st_size / 1e3:.0f} kB)")


if __name__ == "__main__":
    main()
