"""Measure the page that cuts in real browsers: pictures a second, delay from input to picture, and its score.

    python -m scripts.validation.classroom.page_in_browsers --json runs/measure_page.json [--cuts 300] [--seconds 12]
        some minutes

In each browser that is installed (Debian's ``chromium`` and ``firefox-esr``, without a window or a graphics card) a
mouse leads a cut while every picture is timed: from the input's own time stamp to the end of drawing what it moved.
Then seeded hands cut drawn specimens in page and Python, and the page's score is compared with Python's, by the true
tip, and with that of ``cutenv score``, which knows what a rig measures.
"""

from __future__ import annotations

import argparse
import base64
import contextlib
import json
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from cutenv.people.browser import HandCut, write_page_alone
from cutenv.people.browser.page_alone import OFFERED
from cutenv.people.browser.page_data import specimen_data
from cutenv.people.browser.stylus_steps import HandDepthCut, HandPathCut
from cutenv.records.scoring import Truth, score
from cutenv.records.scoring.cut_metrics import MAP_METRICS, METRICS
from cutenv.records.scoring.points import task_points
from cutenv.records.scoring.scored_cut import ScoredCut
from cutenv.records.scoring.truth import TIP_AT_END
from cutenv.records.scoring.validity import Unavailable
from cutenv.sim.tissue.grid import depth_below
from cutenv.sim.trace import Trace
from cutenv.task.registry import TASKS, tasks_with
from scripts.browsers import chromium, firefox
from scripts.tables import keep_json, markdown_table

DEFAULT = Path("runs") / "measure_page.json"
BROWSERS = {"Chromium": chromium, "Firefox": firefox}
TIMED = """(() => {
  const kept = { pictures: [], drawing: [], delays: [] }, native = requestAnimationFrame;
  let waiting = [];
  addEventListener("pointermove", event => {
    const all = event.getCoalescedEvents();
    waiting.push(...(all.length ? all : [event]).map(each => each.timeStamp));
  }, true);
  window.requestAnimationFrame = callback => native(now => {
    const begun = performance.now(), seen = waiting;
    waiting = [];
    callback(now);
    const drawn = performance.now();
    kept.pictures.push(now);
    kept.drawing.push(drawn - begun);
    kept.delays.push(...seen.map(stamp => drawn - stamp));
  });
  window.timed = kept;
})()"""
CUT = """(() => {
  const { laws, told } = cutenvPage, values = new Float64Array(bytesOf("%s").buffer), stylus = [], specimen = %s;
  const { numbers } = told.tasks[specimen.task];
  for (let i = 0; i < values.length; i += numbers) stylus.push(Array.from(values.subarray(i, i + numbers)));
  const cut = new HandCut(laws[specimen.task], specimen);
  for (let i = 0; i < stylus.length; i += 100) cut.advance(stylus.slice(i, i + 100));
  cut.end ||= "given up";
  return taskPoints(cut, told).reduce((sum, each) => sum + each.points, 0);
})()"""


def led(cut: HandCut, seed: int) -> list[list[float]]:
    """Lead a cut by a seeded hand, and return its movements: position [m] and angle [rad] of every millisecond.

    It goes to the target, turns upright before it, draws back until little pulls, and rests; one in four gives up.
    Along a wanted depth, the third number is the level above that at the start [m], along a line the place across [m];
    both are off the wanted one by about a millimetre.
    """
    random = np.random.default_rng(seed)
    speed, lean = random.uniform(0.004, 0.025), random.uniform(0.8, 0.5 * np.pi)
    turn = cut.target_length + random.uniform(-0.003, 0.006)
    patience = random.choice([3_000, 30_000, 30_000, 30_000])
    at = force = 0.0
    back = False
    stylus: list[list[float]] = []
    shown = cut.cutting.shown_depth if isinstance(cut, HandDepthCut) else None
    line = cut.cutting.line if isinstance(cut, HandPathCut) else None
    off = random.normal(0.0, 0.001)
    while not cut.end and len(stylus) < patience:
        blade = float(cut.cuts["states"]["blade"][0, 0])
        back = back or blade >= turn
        pace = speed if not back else -0.004 if force > 0.25 else 0.0
        angle = lean if blade < cut.target_length - 0.012 else 0.5 * np.pi
        level = () if shown is None else (float(depth_below(shown.wanted, blade)) - shown.level + off,)
        ways = [min(max(at + 1e-3 * pace * k, 0.0), 0.149) for k in range(1, 21)]
        block = [[way, angle, *level] for way in ways]
        if line is not None:
            place, aside = (depth_below(each, np.array(ways)).tolist() for each in (line.x, line.y))
            block = [[x, angle, y + off] for x, y in zip(place, aside, strict=True)]
        at = ways[-1]
        readings = cut.follow(block)
        stylus += block[: len(readings)]
        force = float(readings["force"][-10:].mean())
    return stylus


def scores(page: chromium.Browser | firefox.Browser, seed: int, task: str = "gentle") -> tuple[float, float, float]:
    """Return the score of one cut: of the page, of Python by the true tip, and of Python by the record alone."""
    key: dict[str, Any] = {"specimen_class": OFFERED[seed % len(OFFERED)], "seed": seed, "episode": 0}
    cut = TASKS[task].hand(**key)
    stylus = np.array(led(cut, seed))
    again = TASKS[task].hand(**key)
    readings = again.follow(stylus)
    facts = {"end": again.end or "given up", TIP_AT_END: round(float(readings["tip"][-1]), 6)}
    trace = again.trace(readings, **facts, **again.noted)
    # There are no points for the resistance.
    truth = Truth(
        tip=readings["tip"], jump=readings["jump"], resistance=200.0,
        floor=again.cutting.floor_to_tip if isinstance(again, HandDepthCut) else None,
        aside=again.cutting.aside_to_tip if isinstance(again, HandPathCut) else None,
    )  # fmt: skip
    if isinstance(again, HandPathCut):
        exact = points_beside(again, trace, truth)
    else:
        known = score(trace, target_length=again.target_length, truth=truth)
        assert known.overall_score is not None, known.no_score
        exact = known.overall_score
    estimated = score(trace, target_length=again.target_length)
    assert estimated.overall_score is not None, estimated.no_score
    packed = base64.b64encode(stylus.astype("<f8").tobytes()).decode()
    shown = page.value(CUT % (packed, json.dumps(specimen_data(**key, task=task))))
    return float(shown), exact, estimated.overall_score


def points_beside(cut: HandPathCut, trace: Trace, truth: Truth) -> float:
    """Return the points of a cut beside its own line; a record's is one through rounded places."""
    scored = ScoredCut(trace=trace, target_length=cut.target_length, truth=truth, line=cut.cutting.line)
    values = {}
    for each in (METRICS | MAP_METRICS["path"]).values():
        with contextlib.suppress(Unavailable):
            values[each.name] = each.function(scored)
    return sum(each.points for each in task_points(scored, values))


def pictures(page: chromium.Browser | firefox.Browser, seconds: float) -> dict[str, Any]:
    """Lead a cut by mouse for some seconds; return what its pictures took [ms]."""
    while not page.value("Boolean(window.cutenvPage?.page.cut)"):
        time.sleep(0.05)
    page.value(TIMED)
    page.value("cutenvPage.start()")
    while page.value("cutenvPage.page.phase") != "cutting":
        time.sleep(0.1)
    left, top = page.value("(r => [r.left, r.top])(document.getElementById('picture').getBoundingClientRect())")
    page.value("Object.values(timed).forEach(each => { each.length = 0; })")
    until = time.monotonic() + seconds
    x = left + 60.0
    right = page.value("innerWidth") - 20.0
    while time.monotonic() < until:
        x = min(x + 0.5, right)
        page.move_mouse(x, top + 60)
        time.sleep(0.008)
    kept = page.value("timed")
    page.value("document.getElementById('stop').click()")
    gaps = np.diff(kept["pictures"])
    return {
        "pictures_per_s": 1e3 / float(gaps.mean()),
        "gap_ms": np.percentile(gaps, (50, 95)).tolist(),
        "drawing_ms": np.percentile(kept["drawing"], (50, 95)).tolist(),
        "delay_ms": np.percentile(kept["delays"], (50, 95)).tolist(),
        "inputs": len(kept["delays"]),
    }


def measure(cuts: int, seconds: float) -> dict[str, Any]:
    """Measure in every browser that is installed; the scores in one of them."""
    kept: dict[str, Any] = {"pictures": {}, "cuts": cuts, "off_truth": {}, "off_record": {}, "bytes": {}}
    installed = {name: browser for name, browser in BROWSERS.items() if browser.PROGRAM is not None}
    if not installed:
        raise SystemExit("no browser: apt-get install chromium firefox-esr")
    with tempfile.TemporaryDirectory() as folder:
        for task in tasks_with("hand"):
            kept["bytes"][task] = write_page_alone(Path(folder) / f"{task}.html", tasks=(task,))
        path = Path(folder) / "cut.html"
        write_page_alone(path, count=1, tasks=tasks_with("hand"))
        for name, browser in installed.items():
            profile = Path(folder) / name
            profile.mkdir()
            with browser.browser(profile) as page:
                for width in (1100, 400):
                    page.open(path, width)
                    kept["pictures"][f"{name}, {width} px"] = pictures(page, seconds)
                page.open(Path(folder) / "path.html", 1100)
                kept["pictures"][f"{name}, 1100 px, along a line"] = pictures(page, seconds)
        profile.mkdir(exist_ok=True)
        with browser.browser(profile) as page:
            page.open(path, 1100)
            for task in tasks_with("hand"):
                found = np.array([scores(page, seed, task) for seed in tqdm(range(cuts), unit="cut", disable=None)])
                kept["off_truth"][task] = float(np.abs(found[:, 0] - found[:, 1]).max())
                kept["off_record"][task] = np.percentile(np.abs(found[:, 0] - found[:, 2]), (50, 95)).tolist()
    return kept


def markdown(kept: dict[str, Any]) -> str:
    """Return the block of the documentation."""

    def both(pair: list[float]) -> str:
        return f"{pair[0]:.1f}, {pair[1]:.1f}"

    rows = [
        (name, f"{each['pictures_per_s']:.1f}", both(each["drawing_ms"]), both(each["delay_ms"]))
        for name, each in kept["pictures"].items()
    ]
    where = {name: TASKS[name].along or "at constant height" for name in kept["bytes"]}
    columns = ("window of", "pictures a second", "drawing one [ms]", "input to picture [ms]")
    sentences = [
        f"In {kept['cuts']} seeded cuts {words} the page's score differs from Python's by the true tip by "
        f"{kept['off_truth'][task]:.0e} points at most. From that of `cutenv score`, by the record alone, it differs "
        f"by {off[0]:.1f} points in the median, and by {off[1]:.1f} at most in 95 % of the cuts."
        for task, words in where.items()
        for off in [kept["off_record"][task]]
    ]
    sizes = ", ".join(f"{kept['bytes'][task] / 1e6:.1f} MB {words}" for task, words in where.items())
    sentences.append(f"A page of twelve specimens has {sizes}.")
    return f"{markdown_table(columns, rows)}\n\n" + "\n".join(sentences)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--json", type=Path, metavar="FILE", help=f"keep the numbers there; the page is made from {DEFAULT}"
    )
    parser.add_argument("--cuts", type=int, default=300, metavar="N", help="cuts whose scores are compared")
    parser.add_argument("--seconds", type=float, default=12.0, metavar="S", help="duration of a timed cut")
    arguments = parser.parse_args()
    kept = measure(arguments.cuts, arguments.seconds)
    print(markdown(kept))
    if arguments.json is not None:
        keep_json(arguments.json, kept)
