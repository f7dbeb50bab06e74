"""The law of the page is Python's to the last bit, and the file that is kept is what the kernels of today give."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cutenv.browser.stylus_steps import HandCut
from cutenv.play import PlayedCut, Stylus

pytest.importorskip("wasmtime", reason="runs WebAssembly in the tests: pip install 'cutenv[dev]'")

import check_browser_law

ROOT = Path(__file__).parents[2]


def test_the_program_asks_its_surroundings_for_nothing() -> None:
    assert check_browser_law.IMPORTS == []


@pytest.mark.parametrize("seed", range(8))
def test_a_cut_in_webassembly_is_pythons_to_the_last_bit(seed: int) -> None:
    cut = HandCut(specimen_class=check_browser_law.CLASSES[seed % 4], seed=seed, episode=seed // 4)
    assert check_browser_law.same(cut, check_browser_law.wandering(seed))
    assert cut.cuts["states"]["uncontrolled"][0, 0] > 0.0, "nothing was cut: the test compares too little"


def test_a_led_cut_is_the_windows() -> None:
    led, played = HandCut(specimen_class="vascular", seed=5), PlayedCut(specimen_class="vascular", seed=5)
    stylus = check_browser_law.wandering(5, 3_000)
    readings = led.follow(stylus)
    for position, angle in stylus.tolist():
        played.tick(Stylus(position, angle))
    assert readings.tobytes() == played.readings.tobytes()
    assert led.end == played.end


def test_a_cut_that_has_ended_stays_as_it_is() -> None:
    cut = HandCut(seed=1, deadline=1.0)
    assert len(cut.follow(np.tile([0.0, 1.5], (1500, 1)))) == 1000
    assert cut.end == "deadline"
    assert not cut.success
    assert len(cut.follow([[0.0, 1.5]])) == 0


@pytest.mark.skipif(importlib.util.find_spec("ziglang") is None, reason="its linker: pip install 'cutenv[dev]'")
def test_the_law_that_is_kept_is_what_the_kernels_give() -> None:
    """A new Numba may give others: build it again then; the tests above say whether it is still the same law."""
    done = subprocess.run(
        [sys.executable, "scripts/build_browser_law.py", "--check"], cwd=ROOT, capture_output=True, text=True
    )
    assert done.returncode == 0, f"{done.stdout[-500:]}{done.stderr[-500:]}"
