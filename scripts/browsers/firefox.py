"""A headless Firefox that opens one file, told over a socket what to do (WebDriver BiDi); as ``chromium.py``."""

from __future__ import annotations

import base64
import contextlib
import json
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from scripts.browsers.chromium import PATIENCE_S

PROGRAM = shutil.which("firefox-esr") or shutil.which("firefox")
_ADDRESS = "WebDriver BiDi listening on "
_KEYS = {
    "ArrowLeft": "\ue012",
    "ArrowUp": "\ue013",
    "ArrowRight": "\ue014",
    "ArrowDown": "\ue015",
    "Tab": "\ue004",
    "Enter": "\ue007",
}
_LIGHT = 'user_pref("layout.css.prefers-color-scheme.content-override", 1);\n'
_DARK_MANIFEST = {
    "manifest_version": 2,
    "name": "dark",
    "version": "1",
    "permissions": ["browserSettings"],
    "background": {"scripts": ["dark.js"]},
    "browser_specific_settings": {"gecko": {"id": "dark@cutenv"}},
}
_DARK_SCRIPT = 'browser.browserSettings.overrideContentColorScheme.set({ value: "dark" });'


class Browser:
    """One page in one Firefox, with the methods of :class:`chromium.Browser`."""

    name = "Firefox"

    def __init__(self, socket: Any) -> None:
        self._socket = socket
        self._number = 0
        self.events: list[dict[str, Any]] = []
        self.tell("session.new", capabilities={})
        self.tell("session.subscribe", events=["log.entryAdded", "network.beforeRequestSent"])
        self._page = self.tell("browsingContext.getTree")["contexts"][0]["context"]
        self._dark_extension = ""

    def tell(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command; return its result."""
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": parameters}))
        while True:
            heard: dict[str, Any] = json.loads(self._socket.recv(PATIENCE_S))
            if heard.get("id") == self._number:
                assert heard["type"] == "success", f"{method}: {heard.get('message')}"
                return heard["result"]  # type: ignore[no-any-return]
            self.events.append(heard)

    def open(self, page: Path | str, width: int, height: int = 900, *, dark: bool = False) -> None:
        """Open a file or an address in a window of a width and height [px] and wait until it is loaded."""
        self._be_dark(dark)
        viewport = {"width": width, "height": height}
        self.tell("browsingContext.setViewport", context=self._page, viewport=viewport, devicePixelRatio=1)
        self._go_to(page if isinstance(page, str) else page.as_uri())

    def leave(self) -> None:
        """Show a blank page: one that moves takes a third of a processor from whatever comes next."""
        self._go_to("about:blank")

    def _go_to(self, url: str) -> None:
        self.events.clear()
        self.tell("browsingContext.navigate", context=self._page, url=url, wait="complete")

    def _be_dark(self, dark: bool) -> None:
        """Let pages be dark or light, by an extension that sets it: the protocol has no command for that."""
        if dark == bool(self._dark_extension):
            return
        if dark:
            with tempfile.TemporaryDirectory() as folder:
                (Path(folder) / "manifest.json").write_text(json.dumps(_DARK_MANIFEST), encoding="utf-8")
                (Path(folder) / "dark.js").write_text(_DARK_SCRIPT, encoding="utf-8")
                data = {"type": "path", "path": folder}
                self._dark_extension = self.tell("webExtension.install", extensionData=data)["extension"]
                self._wait_until_dark(True)
        else:
            self.tell("webExtension.uninstall", extension=self._dark_extension)
            self._dark_extension = ""
            self._wait_until_dark(False)

    def _wait_until_dark(self, dark: bool) -> None:
        until = time.monotonic() + PATIENCE_S
        while self.value("matchMedia('(prefers-color-scheme: dark)').matches") is not dark:
            assert time.monotonic() < until, "the colours do not change"
            time.sleep(0.05)

    def value(self, expression: str) -> Any:
        """Return what a JavaScript expression is worth in the page; a promise is waited for."""
        worth = self._evaluate(f"(async () => JSON.stringify(await ({expression})))()", self._page)
        return json.loads(worth["value"]) if "value" in worth else None

    def screenshot(self, path: Path) -> None:
        """Write a picture of the whole page (.png)."""
        shot = self.tell("browsingContext.captureScreenshot", context=self._page, origin="document")
        path.write_bytes(base64.b64decode(shot["data"]))

    def print(self, path: Path) -> None:
        """Write what the page prints (.pdf)."""
        path.write_bytes(base64.b64decode(self.tell("browsingContext.print", context=self._page)["data"]))

    def move_mouse(self, x: float, y: float) -> None:
        """Move the mouse to a place in the window [px], no button down."""
        self._act("pointer", "mouse", [_to(x, y)])

    def turn_wheel(self, x: float, y: float, by: int) -> None:
        """Turn the mouse's wheel at a place in the window [px]; positive is towards the person."""
        self._act("wheel", "wheel", [{"type": "scroll", **_place(x, y), "deltaX": 0, "deltaY": by}])

    def stroke(self, places: list[tuple[float, float]]) -> None:
        """Lead a finger along places in the window [px]: down at the first, up at the last."""
        first, *others = (_to(x, y) for x, y in places)
        down, up = ({"type": f"pointer{way}", "button": 0} for way in ("Down", "Up"))
        self._act("pointer", "touch", [first, down, *others, up])

    def press(self, key: str) -> None:
        """Press a key, named as in the DOM."""
        self._act("key", "keys", [{"type": "keyDown", "value": _KEYS.get(key, key)}])

    def release(self, key: str) -> None:
        """Release a key."""
        self._act("key", "keys", [{"type": "keyUp", "value": _KEYS.get(key, key)}])

    def accessible(self, role: str, name: str) -> int:
        """Count what a screen reader finds by its role and its whole name."""
        locator = {"type": "accessibility", "value": {"role": role, "name": name}}
        return len(self.tell("browsingContext.locateNodes", context=self._page, locator=locator)["nodes"])

    def requests(self) -> list[str]:
        """Return every address that the page asked for since it was opened."""
        asked = (event for event in self.events if event["method"] == "network.beforeRequestSent")
        return [event["params"]["request"]["url"] for event in asked]

    def complaints(self) -> list[str]:
        """Return what the browser logged since the page was opened: errors of scripts and of its own."""
        return self._logged("javascript")

    def errors(self) -> list[str]:
        """Return what scripts wrote to the console as an error or a warning since the page was opened."""
        return self._logged("console")

    def _logged(self, kind: str) -> list[str]:
        logged = [event["params"] for event in self.events if event["method"] == "log.entryAdded"]
        return [each["text"] for each in logged if each["type"] == kind and each["level"] in ("error", "warn")]

    def _evaluate(self, expression: str, context: str) -> dict[str, Any]:
        done = self.tell("script.evaluate", expression=expression, target={"context": context}, awaitPromise=True)
        assert done["type"] == "success", done["exceptionDetails"]["text"]
        return done["result"]  # type: ignore[no-any-return]

    def _act(self, kind: str, device: str, actions: list[dict[str, Any]]) -> None:
        source: dict[str, Any] = {"type": kind, "id": device, "actions": actions}
        if kind == "pointer":
            source["parameters"] = {"pointerType": device}
        self.tell("input.performActions", context=self._page, actions=[source])


def _place(x: float, y: float) -> dict[str, int]:
    return {"x": round(x), "y": round(y)}


def _to(x: float, y: float) -> dict[str, Any]:
    return {"type": "pointerMove", "duration": 0, **_place(x, y)}


@contextlib.contextmanager
def browser(profile: Path) -> Iterator[Browser]:
    """Start a browser with a fresh profile folder, and end it when it is left."""
    from websockets.sync.client import connect

    assert PROGRAM is not None
    (profile / "user.js").write_text(_LIGHT, encoding="utf-8")
    options = ("--headless", "--no-remote", "--remote-debugging-port", "0")
    process = subprocess.Popen(
        [PROGRAM, *options, "--profile", str(profile)],
        stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        assert process.stderr is not None
        address = next(line.split(_ADDRESS)[1].strip() for line in process.stderr if _ADDRESS in line)
        with connect(f"{address}/session", max_size=None, proxy=None) as socket:
            yield Browser(socket)
    finally:
        process.terminate()
        process.communicate(timeout=PATIENCE_S)
