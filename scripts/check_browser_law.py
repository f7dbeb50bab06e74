"""Cut a thousand specimens twice, in Python and in the WebAssembly of the page, and compare every byte.

    python scripts/check_browser_law.py [--cuts 1000]    some minutes

Specimens of all classes in turn; seeded hands that go forward and back, pause and tilt.  Compared are all readings and
the whole state of cut and task at the end.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from typing import Any

import numpy as np
import wasmtime
from tqdm import tqdm

from cutenv._base import resources
from cutenv.browser.page_alone import LAW_PROGRAM
from cutenv.browser.stylus_steps import HandCut
from cutenv.cutting.dtypes import READING

CLASSES = ("uniform", "liver", "vascular", "mixed")
MILLISECONDS = 12_000


class CompiledCut:
    """A copy of a cut, advanced by a compiled program, by default the one that the page carries.

    Attributes
    ----------
    cut, episode : int
        Addresses of the two records of its state.
    """

    def __init__(self, cut: HandCut, program: bytes | None = None) -> None:
        self._store = wasmtime.Store(_ENGINE)
        module = CARRIED if program is None else wasmtime.Module(_ENGINE, program)
        instance = wasmtime.Instance(self._store, module, [])
        self._exports: Any = instance.exports(self._store)
        self._hand = cut.hand
        begin: Any = self._exports["__heap_base"]
        self._next: int = begin.value(self._store)
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
        """Advance by a millisecond for each row of ``stylus``; return the readings as they lie in memory."""
        places, readings = self._put(stylus.tobytes()), self._put(bytes(READING.itemsize * len(stylus)))
        done = self._exports["follow"](
            self._store, self.cut, self.episode, places, len(stylus), self._hand.motor_lag, self._hand.acceleration,
            self._action, self._observation, readings, self._outcome,
        )  # fmt: skip
        return self.bytes_at(readings, READING.itemsize * done)

    def bytes_at(self, place: int, size: int) -> bytes:
        """Return ``size`` bytes of its memory."""
        return bytes(self._exports["memory"].read(self._store, place, place + size))


_ENGINE = wasmtime.Engine()
CARRIED = wasmtime.Module(_ENGINE, resources.path(LAW_PROGRAM).read_bytes())
"""The program that the page carries."""


def wandering(seed: int, count: int = MILLISECONDS) -> Any:
    """Return a seeded hand that goes forward and back, pauses and tilts: position [m], angle [rad], shape (n, 2)."""
    random = np.random.default_rng(seed)
    steps = random.uniform(-0.6, 1.0, count // 200 + 1) * (random.random(count // 200 + 1) < 0.9)
    angles = random.uniform(0.7, 1.65, count // 300 + 1).repeat(300)[:count]
    return np.stack([np.clip(np.cumsum(steps.repeat(200)[:count] * 3e-5), 0.0, 0.149), angles], axis=-1)


def same(cut: HandCut, stylus: Any, program: bytes | None = None) -> bool:
    """Return whether a cut and its copy in WebAssembly agree in every byte after the same movements."""
    compiled = CompiledCut(cut, program)
    return (
        compiled.follow(stylus) == cut.follow(stylus).tobytes()
        and compiled.bytes_at(compiled.cut, cut.cuts.nbytes) == cut.cuts.tobytes()
        and compiled.bytes_at(compiled.episode, cut.episodes.nbytes) == cut.episodes.tobytes()
    )


def main() -> int:
    """Compare; return 1 if a cut differs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cuts", type=int, default=1000, metavar="N", help="number of cuts; default 1000")
    arguments = parser.parse_args()
    ends: Counter[str] = Counter()
    different = []
    milliseconds = 0
    for seed in tqdm(range(arguments.cuts), unit="cut", disable=None):
        cut = HandCut(specimen_class=CLASSES[seed % len(CLASSES)], seed=seed)
        if not same(cut, wandering(seed)):
            different.append(seed)
        ends[cut.end or "still going on"] += 1
        milliseconds += int(cut.cuts["states"]["tick"][0, 0])
    print(
        f"{arguments.cuts - len(different)} of {arguments.cuts} cuts equal in every byte, "
        f"{milliseconds} updates of 1 ms"
    )
    print("ends: " + ", ".join(f"{count} {end}" for end, count in ends.most_common()))
    if different:
        print(f"different: seeds {different[:20]}")
    return 1 if different else 0


if __name__ == "__main__":
    sys.exit(main())
