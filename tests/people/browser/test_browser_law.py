"""The law of the page is Python's to the last bit, and can be built anew from the kernels."""

from __future__ import annotations

import base64
import dataclasses
import importlib.util
import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cutenv.people.browser.page_alone import page_alone
from cutenv.people.browser.page_data import shared_part
from cutenv.people.browser.stylus_steps import HandCut, HandDepthCut, HandPathCut
from cutenv.people.play import Stylus
from cutenv.sim.tissue import measured_liver
from cutenv.task.registry import TASKS, tasks_with

pytest.importorskip("wasmtime", reason="runs WebAssembly in the tests: pip install 'cutenv[dev]'")

from scripts.validation.physics import browser_law

FURTHER = {"depth": ("height", "vertical_force"), "path": ("blade_x", "blade_y", "lateral_force")}
ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize("task", tasks_with("hand"))
def test_the_program_asks_its_surroundings_for_nothing(task: str) -> None:
    assert list(browser_law.CARRIED[task].imports) == []


@pytest.mark.parametrize(
    ("task", "seed"), [*(("gentle", seed) for seed in range(4)), ("depth", 0), ("depth", 3), ("path", 1), ("path", 2)]
)
def test_a_cut_in_webassembly_is_pythons_to_the_last_bit(task: str, seed: int) -> None:
    kind = TASKS[task].hand
    cut = kind(specimen_class=browser_law.CLASSES[seed % 4], seed=seed, episode=seed % 2)
    assert browser_law.same(cut, browser_law.wandering(cut, seed))
    if isinstance(cut, HandPathCut):
        assert np.ptp(cut.channels[1]) > 5e-4, "the blade goes straight on: the test compares too little"
    if isinstance(cut, HandDepthCut):
        assert np.ptp(cut.channels[0]) > 0.003, "the blade stays at its level: the test compares too little"
        return
    assert cut.cuts["states"]["uncontrolled"][0, 0] > 0.0, "nothing was cut: the test compares too little"


@pytest.mark.parametrize("task", tasks_with("played"))
def test_a_led_cut_is_the_windows(task: str) -> None:
    key: dict[str, Any] = {"specimen_class": "vascular", "seed": 5} | ({"line": "excision"} if task == "path" else {})
    led, played = TASKS[task].hand(**key), TASKS[task].played(**key)
    if task == "path":
        hand = played.simple_hand()
        stylus = [hand.read() for _ in range(3_000)]
        numbers = np.array([(each.position, each.angle, each.across) for each in stylus])
    else:
        numbers = browser_law.wandering(led, 5, 3_000)
        stylus = [Stylus(place, angle, level=sum(level)) for place, angle, *level in numbers.tolist()]
    readings = np.concatenate([led.follow(part) for part in np.split(numbers, [7, 1500])])
    for each in stylus:
        played.tick(each)
    assert led.end == played.end
    if task == "gentle":
        assert readings.tobytes() == played.readings.tobytes()
        return
    noted = led.noted if task == "path" else {}
    ours, theirs = led.trace(readings, **noted), played.trace()
    for name in ("time", "force", "position", "speed", "angle", "depth", *FURTHER[task]):
        assert getattr(ours, name).tobytes() == getattr(theirs, name).tobytes(), name
    if task == "path":
        assert np.ptp(ours.lateral_force) > 0.1
        assert {"line": "excision"} | {name: theirs.metadata[name] for name in set(noted) - {"line"}} == noted


def test_a_page_of_another_tissue_holds_its_specimens_and_cuts_as_python_does(tmp_path: Path) -> None:
    tissue = tmp_path / "other.json"
    other = dataclasses.replace(measured_liver(), name="other", poisson=0.4, fracture_resistance=120.0)
    tissue.write_text(other.to_json())
    cut = TASKS["depth"].hand(specimen_class="uniform", tissue=tissue)
    page = page_alone(tasks=["depth"], specimen_classes=["uniform"], count=1, tissue=tissue)
    (data,) = re.findall(r'id="data">(.*?)</script>', page, re.DOTALL)
    told = json.loads(data)
    held = {name: base64.b64decode(record) for name, record in told["specimens"][0]["records"].items()}
    assert held == {name: record.tobytes() for name, record in cut.records.items()}
    assert base64.b64decode(told["tasks"]["depth"]["shared"]) == shared_part("depth", other.slab()).tobytes()
    assert held["cut"] != TASKS["depth"].hand(specimen_class="uniform").records["cut"].tobytes()
    assert browser_law.same(cut, browser_law.wandering(cut, 5, 3_000))


def test_a_cut_that_has_ended_stays_as_it_is() -> None:
    cut = HandCut(seed=1, deadline=1.0)
    assert len(cut.follow(np.tile([0.0, 1.5], (1500, 1)))) == 1000
    assert cut.end == "deadline"
    assert not cut.success
    assert len(cut.follow([[0.0, 1.5]])) == 0


@pytest.mark.skipif(importlib.util.find_spec("ziglang") is None, reason="its linker: pip install 'cutenv[dev]'")
@pytest.mark.slow
@pytest.mark.parametrize("task", ["gentle", *FURTHER])
def test_it_can_be_built_anew_from_the_kernels_and_is_the_same_law(tmp_path: Path, task: str) -> None:
    build = [sys.executable, "scripts/build_browser_law.py", "--out", str(tmp_path), "--task", task]
    done = subprocess.run(build, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, f"the kept one still serves: {done.stdout[-500:]}{done.stderr[-500:]}"
    for seed in (20, 21):
        cut = TASKS[task].hand(specimen_class=browser_law.CLASSES[seed % 4], seed=seed)
        stylus = browser_law.wandering(cut, seed, 6000)
        assert browser_law.same(cut, stylus, (tmp_path / f"{task}_law.wasm").read_bytes()), seed
