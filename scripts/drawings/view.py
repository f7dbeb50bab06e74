"""Draw two virtual cuts in ``cutenv view``, photographed in a headless Chromium: view.png and view-depth.png.

    python -m scripts.drawings.view

They lie in assets/pictures.  The first is a gentle cut, coloured by energy; the second one along a wanted depth, by a
simple hand.  Needs Debian's ``chromium``; takes a minute, because the browser draws in software.
"""

from __future__ import annotations

import math
import shutil
import subprocess
import tempfile
from pathlib import Path

from PIL import Image  # comes with matplotlib

from cutenv._engine.randomness import generator
from cutenv.display.viewer.solid import ShownCut, write_view
from cutenv.people.play.devices import simple_hand
from cutenv.people.play.played_cut import PlayedDepthCut
from cutenv.sim.plant import Leg, SimulatedPlant, run, to_trace
from cutenv.sim.tissue import Specimen, measured_liver
from cutenv.sim.trace import Trace
from scripts import ROOT

PICTURES = ROOT / "assets" / "pictures"
SIZE = "1100,760"  # px, of the window
COLOURS = 256  # of the picture, which halves the file
LEGS = [
    Leg(position=0.045, speed=0.0127, angle=math.radians(60.0)),
    Leg(position=0.084, speed=0.0127, angle=math.radians(75.0)),
    Leg(position=0.078, speed=0.0127, angle=math.radians(75.0)),
]


def photograph(page: Path, picture: Path) -> None:
    """Take a picture of a page in a browser."""
    browser = shutil.which("chromium")
    if browser is None:
        raise FileNotFoundError("no chromium: apt-get install chromium")
    command = [browser, "--headless=new", "--no-sandbox", "--hide-scrollbars", "--use-angle=swiftshader"]
    command += ["--enable-unsafe-swiftshader", f"--window-size={SIZE}", "--virtual-time-budget=4000"]
    command += [f"--user-data-dir={picture.parent / 'profile'}", f"--screenshot={picture}", page.as_uri()]
    subprocess.run(command, check=True, capture_output=True, timeout=300)


def gentle_cut() -> Trace:
    """Return a cut of a virtual liver by a leaning blade."""
    plant = SimulatedPlant(Specimen.draw(generator(4), specimen_class="liver", tissue=measured_liver()))
    return to_trace(plant, run(plant, LEGS), name="A virtual liver", target_length_m=0.08)


def deep_cut() -> Trace:
    """Return a cut of a virtual liver along a wanted depth, by a hand that follows it."""
    cut = PlayedDepthCut()
    hand = simple_hand(cut.target_length, level=cut.wanted_level)
    while not cut.end:
        cut.tick(hand.read())
    return cut.trace(name="A virtual liver, along a wanted depth", end=cut.end)


if __name__ == "__main__":
    for name, trace, colour in (("view.png", gentle_cut(), "energy"), ("view-depth.png", deep_cut(), "displacement")):
        with tempfile.TemporaryDirectory() as folder:
            page, shot = Path(folder) / "view.html", Path(folder) / "view.png"
            write_view(page, ShownCut.of(trace), colour=colour)
            photograph(page, shot)
            picture = PICTURES / name
            Image.open(shot).convert("RGB").quantize(COLOURS, kmeans=3).save(picture, optimize=True)
        print(f"picture: {picture} ({picture.stat().st_size / 1e3:.0f} kB)")
