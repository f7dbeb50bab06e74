"""Cut a thousand specimens twice, in Python and in the WebAssembly of the page, and compare every byte.

    python -m scripts.validation.physics.browser_law [--cuts 1000] [--task path]    some minutes

Specimens of all classes in turn; seeded hands that go forward and back, pause and tilt, where a depth is wanted up and
down, and along a line to either side.  Compared are all readings and the whole state of cut and task at the end.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from typing import Any

import numpy as np
import wasmtime
from tqdm import tqdm

from cutenv.people.browser.page_data import law_of, shared_part
from cutenv.people.browser.stylus_steps import HandCut, HandDepthCut, HandPathCut
from cutenv.sim.cutting.dtypes import READING
from cutenv.sim.tissue.grid import depth_below
from cutenv.task.registry import TASKS, tasks_with

CLASSES = ("uniform", "liver", "vascular", "mixed")
MILLISECONDS = 12_000


class CompiledCut:
    """A copy of a cut, advanced by a compiled program, by default the one that the page carries.

    ``records`` has the address of each record of its state, beside Python's.
    """

    def __init__(self, cut: HandCut, program: bytes | None = None) -> None:
        task = next(name for name in tasks_with("hand") if type(cut) is TASKS[name].hand)
        self._store = wasmtime.Store(_ENGINE)
        module = CARRIED[task] if program is None else wasmtime.Module(_ENGINE, program)
        instance = wasmtime.Instance(self._store, module, [])
        self._exports: Any = instance.exports(self._store)
        self._hand = cut.hand
        begin: Any = self._exports["__heap_base"]
        self._next: int = begin.value(self._store)
        self._shared = self._put(shared_part(task, cut.cutting.plant.specimen.tissue.slab()).tobytes())
        self._start = float(cut.cutting.motion["level"][0]) if isinstance(cut, HandDepthCut) else 0.0
        self._channels = len(cut.channel_fields)
        led = cut.led.task
        # of action, observation, force across the cut, outcome
        memory = [8 * len(led.action_names), 4 * len(led.all_components), 8, 16]
        self.records = [(self._put(each.tobytes()), each) for each in cut.records.values()]
        *self._memory, self._outcome = (self._put(bytes(size)) for size in memory)

    def _put(self, content: bytes) -> int:
        place = -(-self._next // 16) * 16
        self._next = place + len(content)
        memory = self._exports["memory"]
        if (missing := self._next - memory.data_len(self._store)) > 0:
            memory.grow(self._store, missing // 65536 + 1)
        memory.write(self._store, content, place)
        return place

    def follow(self, stylus: Any) -> tuple[bytes, bytes]:
        """Advance by a millisecond for each row of ``stylus``; return readings, and further channels."""
        places, readings = self._put(stylus.tobytes()), self._put(bytes(READING.itemsize * len(stylus)))
        channels = self._put(bytes(8 * self._channels * len(stylus)))
        cut, episode = (place for place, _ in self.records)
        done = self._exports["follow"](
            self._store, cut, self._shared, episode, places, len(stylus), self._hand.motor_lag,
            self._hand.acceleration, self._start, *self._memory, readings, channels, self._outcome,
        )  # fmt: skip
        noted = b"".join(self.bytes_at(channels + 8 * row * len(stylus), 8 * done) for row in range(self._channels))
        return self.bytes_at(readings, READING.itemsize * done), noted

    def bytes_at(self, place: int, size: int) -> bytes:
        """Return ``size`` bytes of its memory."""
        return bytes(self._exports["memory"].read(self._store, place, place + size))


_ENGINE = wasmtime.Engine()
CARRIED = {task: wasmtime.Module(_ENGINE, law_of(task)) for task in tasks_with("hand")}
"""The programs that the page carries."""


def wandering(cut: HandCut, seed: int, count: int = MILLISECONDS) -> Any:
    """Return a seeded hand that goes forward and back, pauses and tilts; also up and down, or beside a line.

    Position [m], angle [rad], and level of the blade above that at the start, or place across [m]; shape (n,
    numbers of an action).
    """
    random = np.random.default_rng(seed)
    steps = random.uniform(-0.6, 1.0, count // 200 + 1) * (random.random(count // 200 + 1) < 0.9)
    angles = random.uniform(0.7, 1.65, count // 300 + 1).repeat(300)[:count]
    aside = np.cumsum(random.uniform(-1.0, 1.0, count // 250 + 1).repeat(250)[:count] * 1e-5).clip(-0.02, 0.02)
    places = np.clip(np.cumsum(steps.repeat(200)[:count] * 3e-5), 0.0, 0.149)
    if isinstance(cut, HandPathCut):
        line = cut.cutting.line
        aside = depth_below(line.y, places) + 0.25 * aside
        places = depth_below(line.x, places)
    return np.stack([places, angles, aside][: len(cut.led.task.action_names)], axis=-1)


def same(cut: HandCut, stylus: Any, program: bytes | None = None) -> bool:
    """Return whether a cut and its copy in WebAssembly agree in every byte after the same movements."""
    compiled = CompiledCut(cut, program)
    readings, channels = compiled.follow(stylus)
    known = cut.follow(stylus).tobytes()
    state = all(compiled.bytes_at(place, record.nbytes) == record.tobytes() for place, record in compiled.records)
    return readings == known and channels == cut.channels.tobytes() and state


def main() -> int:
    """Compare; return 1 if a cut differs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cuts", type=int, default=1000, metavar="N", help="number of cuts; default 1000")
    parser.add_argument("--task", choices=tasks_with("hand"), default="gentle", help="task to cut; default gentle")
    arguments = parser.parse_args()
    ends: Counter[str] = Counter()
    different = []
    milliseconds = 0
    for seed in tqdm(range(arguments.cuts), unit="cut", disable=None):
        cut = TASKS[arguments.task].hand(specimen_class=CLASSES[seed % len(CLASSES)], seed=seed)
        if not same(cut, wandering(cut, seed)):
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
