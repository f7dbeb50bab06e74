"""A headless Chromium that opens one file, told over a pipe what to do (the Chrome DevTools Protocol)."""

from __future__ import annotations

import base64
import contextlib
import json
import os
import select
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

PROGRAM = shutil.which("chromium")
PATIENCE_S = 120.0  # a browser that says nothing for so long is stuck
_OPTIONS = (
    "--headless=new",
    "--no-sandbox",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--remote-debugging-pipe",
)

_KEYS = {"Tab": 9, "Enter": 13, " ": 32, "ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39, "ArrowDown": 40}
_WITHOUT_GRAPHICS = ("--disable-gpu",)
_SOFTWARE_GRAPHICS = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")

# Of every element with text of its own, the contrast (WCAG 2.2) with the first background below it.
LEAST_CONTRAST = """(() => {
  const parts = colour => colour.match(/[\\d.]+/g).map(Number);
  const luminance = colour => parts(colour).slice(0, 3).map(v => v / 255)
    .map(v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
    .reduce((sum, v, k) => sum + v * [0.2126, 0.7152, 0.0722][k], 0);
  const below = element => {
    for (let at = element; at; at = at.parentElement) {
      const colour = getComputedStyle(at).backgroundColor;
      if (parts(colour)[3] !== 0) return colour;
    }
  };
  let least = 21;
  for (const element of document.body.querySelectorAll("*")) {
    if (![...element.childNodes].some(node => node.nodeType === 3 && node.data.trim())) continue;
    const pair = [luminance(getComputedStyle(element).color), luminance(below(element))].sort((a, b) => a - b);
    least = Math.min(least, (pair[1] + 0.05) / (pair[0] + 0.05));
  }
  return least;
})()"""

_AS_3_AND_4 = """
import fcntl, os, sys
ends = [fcntl.fcntl(int(end), fcntl.F_DUPFD, 10) for end in sys.argv[1:3]]  # out of the way of 3 and 4
os.dup2(ends[0], 3)
os.dup2(ends[1], 4)
os.execv(sys.argv[3], sys.argv[3:])
"""
"""The browser reads from its descriptor 3 and writes to 4."""


class Browser:
    """One page in one browser; answers come in order, and what happened meanwhile is kept in ``events``."""

    name = "Chromium"

    def __init__(self, to_browser: int, from_browser: int) -> None:
        self._to, self._from = to_browser, from_browser
        self._unread = b""
        self._session: str | None = None
        self._number = 0
        self.events: list[dict[str, Any]] = []
        target = self.tell("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.tell("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Network", "Log", "Runtime"):
            self.tell(f"{domain}.enable")

    def tell(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command; return its result."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        os.write(self._to, json.dumps(message).encode() + b"\0")
        while True:
            heard = self._hear()
            if heard.get("id") == self._number:
                assert "error" not in heard, f"{method}: {heard['error']}"
                return heard["result"]
            self.events.append(heard)

    def open(self, page: Path | str, width: int, height: int = 900, *, dark: bool = False) -> None:
        """Open a file or an address in a window of a width and height [px] and wait until it is loaded."""
        self.tell(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=min(width, height) < 700,
        )
        self.darken(dark)
        self._go_to(page if isinstance(page, str) else page.as_uri())

    def wait(self, condition: str) -> None:
        """Wait until a page is loaded in which a JavaScript condition holds."""
        until = time.monotonic() + PATIENCE_S
        while not self.value(f"document.readyState === 'complete' && Boolean({condition})"):
            assert time.monotonic() < until, condition
            time.sleep(0.05)

    def leave(self) -> None:
        """Show a blank page: one that moves takes a third of a processor from whatever comes next."""
        self._go_to("about:blank")

    def _go_to(self, url: str) -> None:
        self.events.clear()
        self.tell("Page.navigate", url=url)
        while not any(event.get("method") == "Page.loadEventFired" for event in self.events):
            self.events.append(self._hear())

    def darken(self, dark: bool) -> None:
        """Prefer dark pages, or light ones, from now on."""
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.tell("Emulation.setEmulatedMedia", features=[scheme])

    def value(self, expression: str) -> Any:
        """Return what a JavaScript expression is worth in the page; a promise is waited for."""
        result = self.tell("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in result, result["exceptionDetails"]
        return result["result"].get("value")

    def screenshot(self, path: Path) -> None:
        """Write a picture of the whole page (.png)."""
        shot = self.tell("Page.captureScreenshot", captureBeyondViewport=True)
        path.write_bytes(base64.b64decode(shot["data"]))

    def print(self, path: Path) -> None:
        """Write what the page prints (.pdf)."""
        path.write_bytes(base64.b64decode(self.tell("Page.printToPDF", printBackground=False)["data"]))

    def move_mouse(self, x: float, y: float) -> None:
        """Move the mouse to a place in the window [px], no button down."""
        self.tell("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)

    def turn_wheel(self, x: float, y: float, by: int) -> None:
        """Turn the mouse's wheel at a place in the window [px]; positive is towards the person."""
        self.tell("Input.dispatchMouseEvent", type="mouseWheel", x=x, y=y, deltaX=0, deltaY=by)

    def stroke(self, places: list[tuple[float, float]]) -> None:
        """Lead a finger along places in the window [px]: down at the first, up at the last."""
        for kind, (x, y) in zip(("Start", *["Move"] * (len(places) - 1)), places, strict=True):
            self.tell("Input.dispatchTouchEvent", type=f"touch{kind}", touchPoints=[{"x": x, "y": y}])
        self.tell("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])

    def press(self, key: str) -> None:
        """Press a key, named as in the DOM."""
        text = {"Enter": "\r"}.get(key, key if len(key) == 1 else "")
        kind = {"type": "keyDown", "text": text} if text else {"type": "rawKeyDown"}
        self.tell("Input.dispatchKeyEvent", **kind, key=key, windowsVirtualKeyCode=_number(key))

    def release(self, key: str) -> None:
        """Release a key."""
        self.tell("Input.dispatchKeyEvent", type="keyUp", key=key, windowsVirtualKeyCode=_number(key))

    def accessible(self, role: str, name: str) -> int:
        """Count what a screen reader finds by its role and its whole name."""
        root = self.tell("DOM.getDocument")["root"]["nodeId"]
        found = self.tell("Accessibility.queryAXTree", nodeId=root, role=role, accessibleName=name)["nodes"]
        return sum(not each["ignored"] for each in found)

    def requests(self) -> list[str]:
        """Return every address that the page asked for since it was opened."""
        asked = (event for event in self.events if event.get("method") == "Network.requestWillBeSent")
        return [event["params"]["request"]["url"] for event in asked]

    def complaints(self) -> list[str]:
        """Return what the browser logged since the page was opened: refused fetches and errors."""
        logged = (event for event in self.events if event.get("method") == "Log.entryAdded")
        return [event["params"]["entry"]["text"] for event in logged]

    def errors(self) -> list[str]:
        """Return what scripts threw, and what they wrote to the console as an error, since the page was opened."""
        thrown = [
            event["params"]["exceptionDetails"].get("exception", {}).get("description", "an exception")
            for event in self.events
            if event.get("method") == "Runtime.exceptionThrown"
        ]
        written = (event["params"] for event in self.events if event.get("method") == "Runtime.consoleAPICalled")
        return thrown + [str(each["args"]) for each in written if each["type"] in ("error", "warning", "assert")]

    def _hear(self) -> dict[str, Any]:
        while b"\0" not in self._unread:
            ready, _, _ = select.select([self._from], [], [], PATIENCE_S)
            assert ready, f"the browser said nothing for {PATIENCE_S:g} s"
            part = os.read(self._from, 1 << 16)
            assert part, "the browser ended"
            self._unread += part
        message, _, self._unread = self._unread.partition(b"\0")
        return json.loads(message)


def _number(key: str) -> int:
    return _KEYS[key] if key in _KEYS else ord(key.upper())


@contextlib.contextmanager
def browser(profile: Path, *, graphics: bool = False) -> Iterator[Browser]:
    """Start a browser with a fresh profile folder, end it when left; with ``graphics`` WebGL, drawn in software."""
    assert PROGRAM is not None
    read_here, write_there = os.pipe()
    read_there, write_here = os.pipe()
    command = [sys.executable, "-c", _AS_3_AND_4, str(read_there), str(write_there), PROGRAM, *_OPTIONS]
    command += _SOFTWARE_GRAPHICS if graphics else _WITHOUT_GRAPHICS
    process = subprocess.Popen(
        [*command, f"--user-data-dir={profile}", "about:blank"],
        pass_fds=(read_there, write_there),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    os.close(read_there)
    os.close(write_there)
    try:
        yield Browser(write_here, read_here)
    finally:
        os.close(write_here)
        os.close(read_here)
        process.terminate()
        process.wait(PATIENCE_S)
