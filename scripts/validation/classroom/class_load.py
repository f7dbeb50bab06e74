"""Fill a class's server with people who cut at once, kill it amid cuts, send it nonsense, and count what was lost.

    python -m scripts.validation.classroom.class_load                              ten minutes or more
    python -m scripts.validation.classroom.class_load --json runs/class-load.json  for scripts/update_docs.py class-load

A server on this machine gets malformed messages and bytes: it must go on, store nothing and not grow.  Then it is
killed (SIGKILL) in the middle of cuts and started again: whatever it said was saved must be there, and whatever was
going on must be noted as unfinished.  At last all people cut at the same time, each cut sent as the page sends it;
printed are the cuts lost and how long saving takes, then also while a study is worked out, and how many cuts two
servers on one PostgreSQL (apt-get install postgresql) hand out twice.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
import zlib
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from datetime import date
from pathlib import Path
from typing import Any

import httpx2
import numpy as np

from cutenv.people.browser import HandCut
from cutenv.people.classroom import ClassStore
from cutenv.people.classroom.class_tables import BROKEN_OFF, GOING_ON, SAVED, UNFINISHED
from scripts.tables import keep_json
from scripts.test_programs import own_postgresql
from scripts.validation.classroom.malformed_messages import malformed_bytes, malformed_message, send_bytes

DEFAULT = Path("runs") / "class-load.json"
PARTS_OF_LOAD = ("nonsense", "study", "kills", "load", "servers")
MOVEMENT = 16  # bytes of a millisecond of a hand
PATIENCE = 120.0  # seconds for one answer on a busy machine


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

    def __enter__(self) -> Served:
        return self

    def __exit__(self, *_: object) -> None:
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()

    def client(self) -> httpx2.Client:
        """Return a client that is not signed in."""
        return httpx2.Client(base_url=self.address, timeout=PATIENCE)

    def person(self, code: str) -> httpx2.Client:
        """Return the client of a person who has entered with a code."""
        client = self.client()
        assert client.post("", data={"code": code, "consent": "yes"}).status_code == 303
        return client

    def memory(self) -> float:
        """Return the memory in use [MB]; NaN where the system does not say."""
        status = Path("/proc") / str(self._process.pid) / "status"
        found = re.search(r"VmRSS:\s+(\d+)", status.read_text()) if status.is_file() else None
        return int(found[1]) / 1000.0 if found else float("nan")

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
    return finished(client, client, client.post("cuts").json())


def finished(client: httpx2.Client, saving: httpx2.Client, handed_out: dict[str, Any]) -> float:
    """Begin a cut, let it last, and send it, perhaps to another server; return as :func:`cut_once`."""
    client.post(f"cuts/{handed_out['id']}/begun")
    began = time.monotonic()
    content, headers = made_cut(handed_out)
    time.sleep(max(0.0, began + len(content) / MOVEMENT / 1e3 - time.monotonic()))
    sent = time.monotonic()
    answer = saving.post(f"cuts/{handed_out['id']}", content=content, headers=headers)
    return time.monotonic() - sent if answer.status_code == 200 else float("nan")


def full_class(folder: Path, people: int, cuts: int) -> tuple[int, list[float]]:
    """Let everybody cut at once; return the records found, and the times of saving [s]."""
    store = ClassStore(f"sqlite:///{folder / 'class.db'}")
    codes = store.add_codes(people)
    store.close()
    with Served(folder) as served, ThreadPoolExecutor(people) as pool:
        clients = [served.person(code) for code in codes]
        waits = [wait for waits in pool.map(lambda c: [cut_once(c) for _ in range(cuts)], clients) for wait in waits]
        for client in clients:
            client.close()
        assert served.end() == 0
    return len(list(folder.rglob("records/*/*.csv"))), waits


def beside_a_study(folder: Path, people: int) -> tuple[list[float], list[float]]:
    """Let everybody cut thrice; return the times of saving [s] of the second cut, and of the third beside a study."""
    store = ClassStore(f"sqlite:///{folder / 'class.db'}")
    codes = store.add_codes(people)
    store.close()
    served = Served(folder)
    clients = [served.person(code) for code in codes]
    teacher = served.client()
    assert teacher.post("teacher", data={"token": served.token}).status_code == 303
    with ThreadPoolExecutor(people) as pool:
        first = list(pool.map(cut_once, clients))  # not timed: everything is loaded by it
        alone = list(pool.map(cut_once, clients))
        begun = teacher.post("teacher/studies", data={"kind": "study", "code": codes})
        beside = list(pool.map(cut_once, clients))
    study = f"teacher/{begun.headers['location']}"
    assert "refresh" in teacher.get(study).headers, "the study ended before the cuts: nothing was measured"
    for client in [*clients, teacher]:
        client.close()
    assert served.end() == 0
    assert not np.isnan(first).any(), "a cut was lost"
    return alone, beside


def two_servers(folder: Path, database: str, people: int, cuts: int) -> dict[str, int]:
    """Let everybody begin each cut at two servers at once; return how many were handed out twice, and lost."""
    store = ClassStore(database)
    codes = store.add_codes(people)
    options = ("--database", database)
    with Served(folder, *options) as one, Served(folder, *options) as two, ThreadPoolExecutor(2 * people) as asking:
        pairs = []
        for code in codes:
            pairs.append((one.person(code), two.client()))
            pairs[-1][1].cookies = pairs[-1][0].cookies

        def cut(pair: tuple[httpx2.Client, httpx2.Client]) -> tuple[int, int]:
            """Return how many cuts were handed out twice, and how many were said to be saved."""
            twice = saved = 0
            for number in range(cuts):
                given = [each.json() for each in asking.map(lambda client: client.post("cuts"), pair)]
                twice += given[0]["id"] != given[1]["id"]
                saved += not np.isnan(finished(pair[number % 2], pair[(number + 1) % 2], given[0]))
            return twice, saved

        with ThreadPoolExecutor(people) as pool:
            twice, saved = np.sum(list(pool.map(cut, pairs)), axis=0).tolist()
        for each in (client for pair in pairs for client in pair):
            each.close()
        assert [one.end(), two.end()] == [0, 0]
    kept = [each for each in store.cuts() if each.state == SAVED]
    store.close()
    there = sum((folder / "records" / each.code / each.record).is_file() for each in kept)
    assert len({(each.code, each.nth) for each in kept}) == len(kept)
    lost = people * cuts - min(saved, there)
    return {"people": people, "cuts": people * cuts, "twice": twice, "lost": lost}


def killed(folder: Path, people: int) -> tuple[int, int, int]:
    """Kill the server while everybody cuts; return cuts that it said were saved, that are, and unfinished ones."""
    store = ClassStore(f"sqlite:///{folder / 'class.db'}")
    codes = store.add_codes(people)
    before = len(list(folder.rglob("records/*/*.csv")))

    def until_killed(client: httpx2.Client) -> int:
        saved = 0
        try:
            while True:
                saved += not np.isnan(cut_once(client))
        except (httpx2.HTTPError, ValueError, KeyError):  # it is gone, or says that it cannot hand out a cut
            return saved

    with Served(folder) as served, ThreadPoolExecutor(people) as pool:
        clients = [served.person(code) for code in codes]
        going = [pool.submit(until_killed, client) for client in clients]
        until = time.monotonic() + PATIENCE
        while len(list(folder.rglob("records/*/*.csv"))) < before + people and time.monotonic() < until:
            time.sleep(0.05)
        served.end(signal.SIGKILL)
        said = sum(each.result() for each in going)
    with Served(folder) as again:
        assert again.end() in (0, 130)  # ended before or after it began to serve
    cuts = [each for code in codes for each in store.cuts(code)]
    store.close()
    assert all(each.state != GOING_ON for each in cuts)
    there = sum(each.state == SAVED and (folder / "records" / each.code / each.record).is_file() for each in cuts)
    return said, there, sum(each.state in (BROKEN_OFF, UNFINISHED) for each in cuts)


def nonsense(folder: Path, count: int) -> dict[str, Any]:
    """Send malformed messages and bytes; return the answers by class, what was stored, and the memory [MB]."""
    store = ClassStore(f"sqlite:///{folder / 'class.db'}")
    (code,) = store.add_codes(1)
    random = np.random.default_rng(27)
    answers: Counter[str] = Counter()
    memory = []
    with Served(folder) as served:
        person, teacher, nobody = served.person(code), served.client(), served.client()
        teacher.post("teacher", data={"token": served.token})
        number = person.post("cuts").json()["id"]
        for sent in range(count):
            if sent % 5 == 0:
                reply = send_bytes(served.address, malformed_bytes(random))
                answers[f"{reply[9:10].decode()}xx" if reply.startswith(b"HTTP/1.1 ") else "hung up"] += 1
            else:
                message = malformed_message(random, (code, number))._asdict()
                client = (person, teacher, nobody)[sent % 3]
                answer = client.request(message.pop("method"), message.pop("path"), **message)
                answers[f"{answer.status_code // 100}xx"] += 1
            if sent in (count // 10, count - 1):
                memory.append(served.memory())
        alive = nobody.get("").status_code == 200
        for client in (person, teacher, nobody):
            client.close()
        served.end()
    stored = len(store.codes()) - 1 + len(list(folder.rglob("records/*/*.csv")))
    store.close()
    return {"count": count, "answers": dict(sorted(answers.items())), "stored": stored, "memory": memory, "up": alive}


def markdown(kept: dict[str, Any]) -> str:
    """Return the table of load and faults for the documentation."""
    rows = []
    if load := kept.get("load"):
        what = f"{load['people']} people at once, {load['cuts']} cuts of 4 s without a pause between them"
        rows.append(
            (what, f"{load['lost']} lost; saved after {load['median']:.1f} s (median), {load['slow']:.1f} s (99 %)")
        )
    if both := kept.get("servers"):
        what = f"{both['people']} people at two servers on one PostgreSQL, {both['cuts']} cuts begun at both at once"
        rows.append((what, f"{both['twice']} handed out twice, {both['lost']} lost"))
    if study := kept.get("study"):
        saved = f"saved after {study['alone']:.1f} s (median), and after {study['beside']:.1f} s while it is worked out"
        what = f"{study['people']} people at once, each a cut of 4 s alone and one while a study of all of them is made"
        rows.append((what, f"{study['lost']} lost; {saved}; load of the machine before {study['busy']:.1f}"))
    if kills := kept.get("kills"):
        what = f"server killed {kills['times']} times amid 50 people who cut"
        lost = f"{kills['said']} cuts said to be saved, {kills['lost']} of them lost"
        rows.append((what, f"{lost}; {kills['unfinished']} that were going on noted as unfinished"))
    if sent := kept.get("nonsense"):
        answers = ", ".join(f"{count} {name}" for name, count in sent["answers"].items())
        memory = " MB, then ".join(f"{each:.0f}" for each in sent["memory"])
        ends = "the server goes on" if sent["up"] else "THE SERVER ENDED"
        result = f"{ends}; {sent['stored']} things stored; answers {answers}; memory after a tenth {memory} MB"
        rows.append((f"{sent['count']:,} malformed messages and bytes", result))
    about = f"On {kept['cores']} busy cores, which the people's own computing shares ({kept['date']}):\n\n"
    return about + "| what | result |\n|---|---|\n" + "\n".join(f"| {what} | {result} |" for what, result in rows)


def main() -> int:
    """Run what is asked for; return 1 if a finished cut was lost, or nonsense was stored or ended the server."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--parts", nargs="+", choices=PARTS_OF_LOAD, default=PARTS_OF_LOAD, help="what is measured; default all of it")
    add("--people", type=int, default=100, metavar="N", help="people at once; default 100")
    add("--cuts", type=int, default=10, metavar="N", help="cuts of each; default 10")
    add("--kills", type=int, default=10, metavar="N", help="times that the server is killed; default 10")
    add("--messages", type=int, default=10_000, metavar="N", help="malformed messages; default 10000")
    add("--json", type=Path, metavar="FILE", help=f"keep the numbers there; the documentation is made from {DEFAULT}")
    arguments = parser.parse_args()
    path: Path | None = arguments.json
    kept: dict[str, Any] = json.loads(path.read_text()) if path is not None and path.is_file() else {}

    def keep(part: str, numbers: dict[str, Any]) -> None:
        kept.update({"date": date.today().isoformat(), "cores": os.cpu_count(), part: numbers})
        print(f"{part}: {numbers}", flush=True)
        if path is not None:
            keep_json(path, kept)

    with tempfile.TemporaryDirectory() as folder:
        if "nonsense" in arguments.parts:
            keep("nonsense", nonsense(Path(folder), arguments.messages))
    with tempfile.TemporaryDirectory() as folder:
        if "study" in arguments.parts:
            facts = {"people": arguments.people, "busy": os.getloadavg()[0]}
            alone, beside = beside_a_study(Path(folder), arguments.people)
            facts |= {"alone": float(np.nanmedian(alone)), "beside": float(np.nanmedian(beside))}
            keep("study", facts | {"lost": int(np.isnan(alone + beside).sum())})
    with tempfile.TemporaryDirectory() as folder:
        totals = np.zeros(3, int)
        for times in range(1, arguments.kills + 1) if "kills" in arguments.parts else ():
            totals += killed(Path(folder), 50)
            said, found, unfinished = totals.tolist()
            keep("kills", {"times": times, "said": said, "lost": max(said - found, 0), "unfinished": unfinished})
    with tempfile.TemporaryDirectory() as folder:
        if "load" in arguments.parts:
            found, waits = full_class(Path(folder), arguments.people, arguments.cuts)
            middle, slow = np.nanpercentile(waits, [50, 99]).tolist()
            asked = arguments.people * arguments.cuts
            facts = {"people": arguments.people, "cuts": asked, "lost": asked - found, "median": middle, "slow": slow}
            keep("load", facts)
    if "servers" in arguments.parts:
        with own_postgresql() as database, tempfile.TemporaryDirectory() as folder:
            keep("servers", two_servers(Path(folder), database, arguments.people, arguments.cuts))
    print(markdown(kept))
    sent = kept.get("nonsense", {"stored": 0, "up": True, "answers": {}})
    lost = sum(kept.get(part, {"lost": 0})["lost"] for part in ("load", "study", "kills", "servers"))
    lost += kept.get("servers", {"twice": 0})["twice"]
    return 1 if lost or sent["stored"] or not sent["up"] or "5xx" in sent["answers"] else 0


if __name__ == "__main__":
    sys.exit(main())
