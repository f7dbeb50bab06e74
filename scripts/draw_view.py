"""Draw assets/pictures/view.png: a virtual cut in ``cutenv view``, photographed in a headless Chromium.

    python scripts/draw_view.py

Needs Debian's ``chromium``; takes half a minute, because the browser draws in software.
"""

from __future__ import annotations

import math
import shutil
import subprocess
import tempfile
from pathlib import Path

from PIL import Image  # comes with matplotlib

from cutenv._engine.randomness import generator
from cutenv.plant import Leg, SimulatedPlant, run, to_trace
from cutenv.tissue import Specimen, measured_liver
from cutenv.viewer.solid import ShownCut, write_view

PICTURE = Path(__file__).parents[1] / "assets" / "pictures" / "view.png"
SIZE = "1100,760"  # px, of the window
COLOURS = 256  # of the picture, which halves the file
LEGS = [
    Leg(position=0.045, speed=0.0127, angle=math.radians(60.0)),
    Leg(position=0.084, speed=0.0127, angle=math.radians(75.0)),
    Leg(position=0.078, speed=0.0127, angle=math.radians(75.0)),
]


def photograph(page: Path, picture: Path) -> None:
    """Take a picture of a page in a browser.

    Raises
    ------
    FileNotFoundError
        If there is no chromium.
    """
    browser = shutil.which("chromium")
    if browser is None:
        raise FileNotFoundError("no chromium: apt-get install chromium")
    command = [browser, "--headless=new", "--no-sandbox", "--hide-scrollbars", "--use-angle=swiftshader"]
    command += ["--enable-unsafe-swiftshader", f"--window-size={SIZE}", "--virtual-time-budget=4000"]
    command += [f"--user-data-dir={picture.parent / 'profile'}", f"--screenshot={picture}", page.as_uri()]
    subprocess.run(command, check=True, capture_output=True, timeout=300)


def main() -> None:
    """Cut, write the page, photograph it, and reduce the picture."""
    plant = SimulatedPlant(Specimen.draw(generator(4), specimen_class="liver", tissue=measured_liver()))
    trace = to_trace(plant, run(plant, LEGS), name="A virtual liver", target_length_m=0.08)
    with tempfile.TemporaryDirectory() as folder:
        page, shot = Path(folder) / "view.html", Path(folder) / "view.png"
        write_view(page, ShownCut.of(trace), colour="energy")
        photograph(page, shot)
        Image.open(shot).convert("RGB").quantize(COLOURS, kmeans=3).save(PICTURE, optimize=True)
    print(f"picture: {PICTURE} ({PICTURE.stat().st_size / 1e3:.0f} kB)")


if __name__ == "__main__":
    main()
