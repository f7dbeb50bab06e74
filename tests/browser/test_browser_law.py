"""The law of the page is Python's to the last bit, and the file that is kept is what the kernels of today give."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cutenv._base import resources
from cutenv.browser.page_alone import LAW_PROGRAM
from cutenv.browser.stylus_steps import HandCut
from cutenv.cutting.dtypes import READING
from cutenv.play import PlayedCut, Stylus

wasmtime: Any = pytest.importorskip("wasmtime", reason="runs WebAssembly in the tests: pip install 'cutenv[dev]'")

ROOT = Path(__file__).parents[2]
CLASSES = ("uniform", "liver", "vascular", "mixed")


def wandering(seed: int, count: int) -> Any:
    """A hand that goes forward, back and beyond, and tilts: shape (count, 2)."""
    random = np.random.default_rng(seed)
    steps = random.uniform(-0.6, 1.0, count // 200 + 1).repeat(200)[:count] * 3e-5
    angles = random.uniform(0.7, 1.65, count // 300 + 1).repeat(300)[:count]
    return np.stack([np.clip(np.cumsum(steps), 0.0, 0.149), angles], axis=-1)


class Compiled:
    """The law that the page carries, run by wasmtime on a copy of a cut."""

    def __init__(self, cut: HandCut) -> None:
        self._store = wasmtime.Store()
        module = wasmtime.Module(self._store.engine, resources.path(LAW_PROGRAM).read_bytes())
        assert not module.imports
        self._exports = wasmtime.Instance(self._store, module, []).exports(self._store)
        self._hand = cut.hand
        self._next: int = self._exports["__heap_base"].value(self._store)
        self.cut, self.episode = self._put(cut.cuts.tobytes()), self._put(cut.episodes.tobytes())
        self._action, self._observation, self._outcome = (self._put(bytes(size)) for size in (16, 48, 16))

    def _put(self, content: bytes) -> int:
        place = -(-self._next // 16) * 16
        self._next = place + len(content)
        memory = self._exports["memory"]
        if (missing := self._next - memory.data_len(self._store)) > 0:
            memory.grow(self._store, missing // 65536 + 1)
        memory.write(self._store, content, place)
        return place

    def follow(self, stylus: Any) -> bytes:
        """Advance the cut; the readings as they lie in memory."""
        places, readings = self._put(stylus.tobytes()), self._put(bytes(READING.itemsize * len(stylus)))
        done = self._exports["follow"](
            self._store, self.cut, self.episode, places, len(stylus), self._hand.motor_lag, self._hand.acceleration,
            self._action, self._observation, readings, self._outcome,
        )  # fmt: skip
        return self.bytes_at(readings, READING.itemsize * done)

    def bytes_at(self, place: int, size: int) -> bytes:
        return bytes(self._exports["memory"].read(self._store, place, place + size))


@pytest.mark.parametrize("seed", range(12))
def test_a_cut_in_webassembly_is_pythons_to_the_last_bit(seed: int) -> None:
    cut = HandCut(specimen_class=CLASSES[seed % 4], seed=seed, episode=seed // 4)
    compiled = Compiled(cut)
    stylus = wandering(seed, 12_000)
    assert compiled.follow(stylus) == cut.follow(stylus).tobytes()
    assert compiled.bytes_at(compiled.cut, cut.cuts.nbytes) == cut.cuts.tobytes()
    assert compiled.bytes_at(compiled.episode, cut.episodes.nbytes) == cut.episodes.tobytes()
    assert cut.cuts["states"]["uncontrolled"][0, 0] > 0.0, "nothing was cut: the test compares too little"


def test_a_led_cut_is_the_windows() -> None:
    led, played = HandCut(specimen_class="vascular", seed=5), PlayedCut(specimen_class="vascular", seed=5)
    stylus = wandering(5, 3_000)
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
