"""Shortcuts that start a class by a double click: what each platform's file holds, and Linux's, run."""

from __future__ import annotations

import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("starlette", reason="the server is an extra: pip install 'cutenv[serve]'")
pytest.importorskip("httpx2", reason="asks the server in its tests: pip install 'cutenv[dev]'")

import httpx2
from starlette.testclient import TestClient

from cutenv.commands.cli import main
from cutenv.people.classroom import ClassStore, Lesson
from cutenv.people.classroom.class_server import class_app
from cutenv.people.classroom.class_site import ClassSite
from cutenv.people.classroom.desktop_shortcut import write_shortcut

ODD = ("py thon", "--title", "it's $HOME `x` \\ 100% & more", "é")
PATIENCE = 120.0


def test_a_command_file_runs_the_command_as_it_is_on_macos(tmp_path: Path) -> None:
    echo = (sys.executable, "-c", "import os, sys; print(os.getcwd(), sys.argv[1:])", *ODD)
    folder = tmp_path / "a 'folder"
    folder.mkdir()
    path = write_shortcut(echo, "my class/1", place=tmp_path, folder=folder, platform="darwin")
    assert path.name == "my class_1.command"
    assert subprocess.check_output([path], text=True).strip() == f"{folder} {list(ODD)}"


def test_a_batch_file_quotes_every_argument_on_windows(tmp_path: Path) -> None:
    path = write_shortcut(
        ("C:\\py\\python.exe", *ODD, "D:\\"), "class", place=tmp_path, folder=tmp_path, platform="win32"
    )
    lines = path.read_bytes().decode().split("\r\n")
    assert path.suffix == ".bat"
    assert lines[0] == "@chcp 65001 > nul", "UTF-8 from here on"
    assert lines[2] == (
        f'@cd /d "{tmp_path}" && "C:\\py\\python.exe" "py thon" "--title" "it\'s $HOME `x` \\ 100%% & more" "é"'
        ' "D:\\\\" || pause'
    )
    with pytest.raises(ValueError, match="no shortcut can hold"):
        write_shortcut(("a", 'b" & del c'), "class", place=tmp_path, platform="win32")


def test_what_no_shortcut_can_hold_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no shortcut can hold"):
        write_shortcut(("a", "b\nExec=rm"), "class", place=tmp_path)


@pytest.mark.parametrize(("ticket", "minute", "opens"), [("t", 60.0, True), ("x", 60.0, False), ("t", -1.0, False)])
def test_the_address_of_a_double_click_holds_for_a_minute(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ticket: str, minute: float, opens: bool
) -> None:
    monkeypatch.setattr("cutenv.people.classroom.teacher_pages._TICKET_LASTS", minute)
    store = ClassStore(f"sqlite:///{tmp_path / 'class.db'}")
    app = class_app(ClassSite(lesson=Lesson(store, tmp_path / "records"), secret="token"), ticket="t")
    answer = TestClient(app, base_url="http://class", follow_redirects=False).get(f"/teacher/open/{ticket}")
    assert answer.headers["location"].endswith("teacher")
    assert ("set-cookie" in answer.headers) is opens
    store.close()


def gio_launches(path: Path, folder: Path) -> None:
    """Open a desktop file by GLib, as a double click does, with a terminal that is a script."""
    (folder / "bin").mkdir()
    for name in ("xterm", "xdg-terminal-exec"):
        terminal = folder / "bin" / name
        place = shlex.quote(str(folder))
        terminal.write_text(f'#!/bin/sh\n[ "$1" = -e ] && shift\necho $$ > {place}/pid\nexec setsid "$@"\n')
        terminal.chmod(0o755)
    (folder / "bin" / "browse").write_text(f'#!/bin/sh\necho "$1" > {shlex.quote(str(folder))}/opened\n')
    (folder / "bin" / "browse").chmod(0o755)
    path_of_programs = f"{folder / 'bin'}:/usr/bin:/bin"
    environment = os.environ | {"PATH": path_of_programs, "BROWSER": str(folder / "bin" / "browse")}
    subprocess.run(
        ["gio", "launch", path], env=environment, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )


def awaited(path: Path) -> str:
    until = time.monotonic() + PATIENCE
    while not path.is_file() or not path.read_text().endswith("\n"):
        assert time.monotonic() < until, f"{path} does not come"
        time.sleep(0.05)
    return path.read_text().strip()


@pytest.mark.needs("gio")
def test_a_desktop_file_runs_the_command_as_it_is_on_linux(tmp_path: Path) -> None:
    echo = (sys.executable, "-c", "import os, sys; print(os.getcwd(), sys.argv[2:], file=open(sys.argv[1], 'w'))")
    said = tmp_path / "said"
    path = write_shortcut((*echo, str(said), *ODD), "class", place=tmp_path, folder=tmp_path, platform="linux")
    gio_launches(path, tmp_path)
    assert awaited(said) == f"{tmp_path} {list(ODD)}"


@pytest.mark.needs("gio")
@pytest.mark.skipif(sys.platform != "linux", reason="makes the shortcut of Linux")
def test_a_double_click_serves_the_class_and_opens_the_teachers_page_signed_in(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "Desktop").mkdir()
    assert main(["serve", "my class", "--port", "0", "--shortcut"]) == 0
    path = Path(capsys.readouterr().out.removeprefix("shortcut: ").strip())
    assert path == tmp_path / "Desktop" / "cutenv my class.desktop"
    gio_launches(path, tmp_path)
    address = awaited(tmp_path / "opened")
    try:
        with (
            httpx2.Client(follow_redirects=True, timeout=PATIENCE) as browser,
            httpx2.Client(timeout=PATIENCE) as other,
        ):
            page = browser.get(address)
            assert page.status_code == 200
            assert 'action="teacher/codes"' in page.text, "the teacher is signed in"
            assert other.get(address, follow_redirects=True).text.count('type="password"') == 1, "once, and no more"
    finally:
        os.killpg(int(awaited(tmp_path / "pid")), signal.SIGHUP)  # as a terminal's window that is closed
    assert (tmp_path / "my class" / "class.db").is_file()
