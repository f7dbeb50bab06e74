"""A rig watched live: what is seen, who sees it, and that watching changes nothing on the rig."""

from __future__ import annotations

import itertools
import json
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("starlette", reason="the server is an extra: pip install 'cutenv[serve]'")
pytest.importorskip("httpx2", reason="asks the server in its tests: pip install 'cutenv[dev]'")

from starlette.testclient import TestClient

from cutenv.commands.cli import main
from cutenv.people.classroom import ClassStore, Lesson
from cutenv.people.classroom.class_server import class_app
from cutenv.people.classroom.class_site import ClassSite
from cutenv.people.classroom.live_rig import LiveRig, checked_message
from cutenv.records import load_one

PATIENCE = 180.0
MESSAGE: dict[str, Any] = {"schema": "cutenv-live/1", "rig": "bench", "phase": "ready", "time_s": 1.0, "force_N": 2.5}


@pytest.fixture
def live() -> Iterator[LiveRig]:
    opened = LiveRig(0)
    yield opened
    opened.close()


def seen(live: LiveRig) -> list[dict[str, Any]]:
    return [message for _, message in live.since(0)]


def cut(folder: Path, *options: str) -> Any:
    """Cut once on a fake rig; the forces of the record."""
    main(["rig", "run", "--policy", "fast then slow", "--rig", "fake", "--out", str(folder), *options])
    (record,) = folder.glob("*.csv")
    return load_one(record).force.tobytes()


def test_a_stop_is_seen_with_its_reason_and_watching_changes_no_reading(live: LiveRig, tmp_path: Path) -> None:
    limit = ("--force-limit-N", "1.5")
    alone = cut(tmp_path / "alone", *limit)
    watched = cut(tmp_path / "watched", *limit, "--watch", str(live.port))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as deaf:  # a viewer that never takes anything
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)
        deaf.bind(("127.0.0.1", 0))
        port = str(deaf.getsockname()[1])
        ignored = cut(tmp_path / "ignored", *limit, "--watch", port)
    nobody = cut(tmp_path / "nobody", *limit, "--watch", port)
    assert alone == watched == ignored == nobody
    messages = seen(live)
    assert {"unready", "ready", "stopped"} <= {each["phase"] for each in messages}
    assert messages[-1]["stop"].startswith("force limit: ")
    assert max(each["force_N"] for each in messages if each["force_N"] is not None) >= 1.5
    positions = [each["position_mm"] for each in messages if each["position_mm"] is not None]
    assert max(positions) - min(positions) > 1.0


@pytest.mark.parametrize(
    "datagram",
    [
        b"",
        b"\xff" * 100,
        b"[]",
        b'"cutenv-live/1"',
        b"[" * 2000,
        json.dumps({"rig": "another schema"}).encode(),
        *(json.dumps(MESSAGE | {"force_N": value}).encode() for value in ("x", True, [], float("nan"), 1e300, 10**400)),
        *(json.dumps(MESSAGE | {"stop": value}).encode() for value in (1, {}, "x" * 401)),
        json.dumps(MESSAGE | {"other": "x" * 2048}).encode(),
    ],
    ids=lambda datagram: repr(datagram[-20:]),
)
def test_what_is_no_reading_is_dropped(datagram: bytes) -> None:
    assert checked_message(datagram) is None


def test_no_unknown_word_of_a_message_gets_through() -> None:
    message = checked_message(json.dumps(MESSAGE | {"onload": "alert(1)"}).encode())
    assert message is not None
    assert "onload" not in message
    assert message["force_N"] == 2.5


def test_a_port_that_is_taken_is_named(live: LiveRig) -> None:
    with pytest.raises(ValueError, match=f"--watch {live.port}: .*another port"):
        LiveRig(live.port)


@pytest.mark.parametrize("port", ["x", "-1", "65536", "1.5"])
def test_a_bad_port_is_named(port: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["rig", "run", "--policy", "fast then slow", "--rig", "fake", "--watch", port])
    assert "--watch" in capsys.readouterr().err


def test_the_teacher_alone_may_watch_and_nobody_can_send(live: LiveRig, tmp_path: Path) -> None:
    store = ClassStore(f"sqlite:///{tmp_path / 'class.db'}")
    site = ClassSite(lesson=Lesson(store, tmp_path / "records"), secret="secret")
    client = TestClient(class_app(site, live=live), base_url="http://class")
    for path in ("/rig", "/rig/readings"):
        assert client.get(path).status_code == 401
    client.post("/teacher", data={"token": "secret"})
    assert 'href="rig"' in client.get("/teacher").text
    page = client.get("/rig")
    assert "script-src 'sha256-" in page.text
    assert "EventSource" in page.text
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as rig:
        rig.sendto(json.dumps(MESSAGE).encode(), ("127.0.0.1", live.port))
        until = time.monotonic() + 10.0
        while not live.since(0) and time.monotonic() < until:
            time.sleep(0.01)
    looks = iter((False, True))
    live.ended = lambda: next(looks)
    stream = client.get("/rig/readings")
    assert stream.headers["content-type"].startswith("text/event-stream")
    assert 'data: {"time_s": 1.0, "force_N": 2.5' in stream.text
    assert client.post("/rig/readings", content=b"stop").status_code == 405
    store.close()


def test_an_emulated_rigs_cut_is_seen_in_real_time_and_so_is_why_it_stopped(live: LiveRig, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "cutenv", "rig", "run", "--policy", "fast then slow", "--rig", "emulator"]
    command += ["--out", str(tmp_path), "--watch", str(live.port), "--force-limit-N", "1.5"]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    messages, printed = seen(live), ran.stdout + ran.stderr
    assert ran.returncode in (2, 3), printed  # a busy machine stops it before the force does, and is seen to do so
    assert messages[-1]["stop"].partition(":")[0] in printed
    assert messages[-1]["phase"] == "stopped"
    apart = [after["time_s"] - before["time_s"] for before, after in itertools.pairwise(messages)]
    assert len(messages) > 50
    assert sorted(apart)[len(apart) // 2] == pytest.approx(0.04, abs=0.02)
