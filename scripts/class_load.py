"""Fill a class's server with people who cut at once, kill it amid cuts, and count what was lost.

    python scripts/class_load.py [--people 100] [--cuts 10] [--kills 10]    some minutes

First all people cut at the same time against one server on this machine, each cut sent as the page sends it; printed
are the cuts lost and how long saving takes.  Then the server is killed (SIGKILL) in the middle of cuts and started
again: whatever it said was saved must be there, and whatever was going on must be noted as unfinished.
"""

from __future__ import annotations

import argparse
import re
import signal
import subprocess
import sys
import tempfile
import time
import zlib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx2
import numpy as np

from cutenv.browser import HandCut
from cutenv.classroom import ClassStore
from cutenv.classroom.class_store import GOING_ON, SAVED, UNFINISHED

PATIENCE = 120.0
"""Seconds for one answer on a busy machine."""


class Served:
    """A server of a class in a process of its own."""

    def __init__(self, folder: Path, *options: str) -> None:
        self.folder = folder
        command = [sys.executable, "-m", "cutenv", "serve", str(folder), "--port", "0", *options]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        assert self._process.stdout is not None
        self.notes: list[str] = []
        for line in self._process.stdout:
            if line.startswith("class: "):
                self.address = line.split()[1]
            elif found := re.search(r"with the token (\S+)", line):
                self.token = found[1]
            elif found := re.search(r"--watch (\d+)", line):
                self.watched = int(found[1])
            elif line.startswith("end with"):
                break
            else:
                self.notes.append(line.strip())

    def client(self) -> httpx2.Client:
        """Return a client that is not signed in."""
        return httpx2.Client(base_url=self.address, timeout=PATIENCE)

    def person(self, code: str) -> httpx2.Client:
        """Return the client of a person who has entered with a code."""
        client = self.client()
        assert client.post("", data={"code": code, "consent": "yes"}).status_code == 303
        return client

    def end(self, how: signal.Signals = signal.SIGINT) -> int:
        """End it, and return its exit status."""
        self._process.send_signal(how)
        return self._process.wait(PATIENCE)


def made_cut(handed_out: dict[str, Any], count: int = 4000) -> tuple[bytes, dict[str, str]]:
    """Return the movements of a hand that goes forward for some seconds, and the headers of the page."""
    random = np.random.default_rng(handed_out["seed"])
    steps = random.uniform(-2e-6, 2e-5, count // 100).repeat(100)
    stylus = np.stack([np.cumsum(steps), np.full(len(steps), np.pi / 2)], axis=-1)
    readings = HandCut(specimen_class=handed_out["specimen_class"], seed=handed_out["seed"]).follow(stylus)
    sent = stylus[: len(readings)].astype("<f8").tobytes()
    return sent, {"X-Readings": f"{zlib.crc32(readings.tobytes()):08x}"}


def cut_once(client: httpx2.Client) -> float:
    """Cut once; return how long saving took [s], or NaN if it was not saved."""
    handed_out = client.post("cuts").json()
    client.post(f"cuts/{handed_out['id']}/begun")
    content, headers = made_cut(handed_out)
    began = time.monotonic()
    answer = client.post(f"cuts/{handed_out['id']}", content=content, headers=headers)
    return time.monotonic() - began if answer.status_code == 200 else float("nan")


def full_class(folder: Path, people: int, cuts: int) -> tuple[int, list[float]]:
    """Let everybody cut at once; return the records found, and the times of saving [s]."""
    store = ClassStore(f"sqlite:///{folder / 'class.db'}")
    codes = store.add_codes(people)
    store.close()
    served = Served(folder)
    clients = [served.person(code) for code in codes]
    with ThreadPoolExecutor(people) as pool:
        waits = [wait for waits in pool.map(lambda c: [cut_once(c) for _ in range(cuts)], clients) for wait in waits]
    for client in clients:
        client.close()
    assert served.end() == 0
    return len(list(folder.rglob("records/*/*.csv"))), waits


def killed(folder: Path, people: int) -> tuple[int, int, int]:
    """Kill the server while everybody cuts; return cuts that it said were saved, that are, and unfinished ones."""
    store = ClassStore(f"sqlite:///{folder / 'class.db'}")
    codes = store.add_codes(people)
    before = len(list(folder.rglob("records/*/*.csv")))
    served = Served(folder)
    clients = [served.person(code) for code in codes]

    def until_killed(client: httpx2.Client) -> int:
        saved = 0
        try:
            while True:
                saved += not np.isnan(cut_once(client))
        except (httpx2.HTTPError, ValueError):
            return saved

    with ThreadPoolExecutor(people) as pool:
        going = [pool.submit(until_killed, client) for client in clients]
        until = time.monotonic() + PATIENCE
        while len(list(folder.rglob("records/*/*.csv"))) < before + people and time.monotonic() < until:
            time.sleep(0.05)
        served.end(signal.SIGKILL)
        said = sum(each.result() for each in going)
    again = Served(folder)
    assert again.end() in (0, 130)  # ended before or after it began to serve
    cuts = [each for code in codes for each in store.cuts(code)]
    store.close()
    assert all(each.state != GOING_ON for each in cuts)
    there = sum(each.state == SAVED and (folder / "records" / each.code / each.record).is_file() for each in cuts)
    return said, there, sum(each.state == UNFINISHED for each in cuts)


def main() -> int:
    """Run both; return 1 if a finished cut was lost."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--people", type=int, default=100, metavar="N", help="people at once; default 100")
    parser.add_argument("--cuts", type=int, default=10, metavar="N", help="cuts of each; default 10")
    parser.add_argument(
        "--kills", type=int, default=10, metavar="N", help="times that the server is killed; default 10"
    )
    arguments = parser.parse_args()
    lost = 0
    with tempfile.TemporaryDirectory() as folder:
        found, waits = full_class(Path(folder), arguments.people, arguments.cuts)
        asked = arguments.people * arguments.cuts
        lost += asked - found
        middle, slow = np.nanpercentile(waits, [50, 99])
        print(
            f"{arguments.people} people at once, {asked} cuts of 4 s: {asked - found} lost; "
            f"saved after {middle:.2f} s (median), {slow:.2f} s (99 of 100)"
        )
    with tempfile.TemporaryDirectory() as folder:
        totals = np.zeros(3, int)
        for _ in range(arguments.kills):
            totals += killed(Path(folder), 50)
        said, found, unfinished = totals.tolist()
        lost += max(said - found, 0)
        print(
            f"server killed {arguments.kills} times amid 50 people: {said} cuts said to be saved, "
            f"{max(said - found, 0)} of them lost; {unfinished} noted as unfinished"
        )
    return 1 if lost else 0


if __name__ == "__main__":
    sys.exit(main())
