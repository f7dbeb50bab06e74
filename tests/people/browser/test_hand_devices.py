"""Further devices that lead the hand in the page, by the same law: a pen's pressure, a handle on a serial port."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import pytest
from opened_page import Browser, start, wait

pytest.importorskip("jinja2", reason="pages are an extra: pip install 'cutenv[view]'")

import numpy as np

from cutenv.people.browser import HandCut
from cutenv.people.browser.watched_cut import from_runs
from cutenv.records import load
from cutenv.sim.plant.protocol import recorded_trace

PORT = """void Object.defineProperty(navigator, "serial", { configurable: true, value: { requestPort: async () => {
  if (window.refused) throw Object.assign(new Error("refused"), { name: window.refused });
  const read = new ReadableStream({ start(port) {
    window.send = text => port.enqueue(new TextEncoder().encode(text));
    window.unplug = () => port.error(new Error("The device has been lost."));
  } });
  return { open: async ({ baudRate }) => { window.baud = baudRate; window.portClosed = false; }, readable: read,
    close: async () => { window.portClosed = true; } };
} } })"""
ANGLE, SERIAL = "cutenvPage.stylus.angle", "cutenvPage.stylus.serial"


def click(page: Browser, name: str) -> None:
    page.value(f"document.getElementById('{name}').click()")


def record(page: Browser, tmp_path: Path) -> dict[str, Any]:
    """Give up, and return the facts of the record, whose readings are those of Python's law by the same movements."""
    click(page, "stop")
    path = tmp_path / "cut.csv"
    path.write_text(page.value("cutenvPage.page.cut.csv('P07', false)"), encoding="utf-8")
    (trace,) = load(path)
    cut = HandCut(specimen_class="liver")
    stylus = from_runs(trace.metadata["movements"])
    again = recorded_trace(cut.follow(stylus), cut.measured_depth)
    for name in ("time", "force", "position", "speed", "angle", "depth"):
        assert getattr(trace, name).tobytes() == getattr(again, name).tobytes(), name
    assert trace.force is not None
    assert np.ptp(trace.force) > 0.0, "nothing was cut: the test compares too little"
    return dict(trace.metadata)


def pointer(page: Browser, kind: str, x: float, y: float, pressure: float, by: str = "pen") -> None:
    told = f"pointerId: 5, pointerType: '{by}', pressure: {pressure}, buttons: {int(pressure > 0)}, tiltX: 20"
    event = f"new PointerEvent('{kind}', {{ {told}, clientX: {x}, clientY: {y} }})"
    page.value(f"void document.getElementById('picture').dispatchEvent({event})")


def test_a_pens_pressure_tilts_the_blade_where_the_person_wants_it(page: Browser, tmp_path: Path) -> None:
    click(page, "pen-tilts")
    x, y = start(page)
    page.value("void (document.getElementById('picture').setPointerCapture = () => {})")  # of a pen that is made up
    for by in ("touch", "mouse"):
        pointer(page, "pointerdown", x, y, 1.0, by)
        pointer(page, "pointermove", x, y, 1.0, by)
        pointer(page, "pointerup", x, y, 0.0, by)
    assert page.value(ANGLE) == np.pi / 2, "a finger and a mouse have no pressure of their own"
    assert page.value("cutenvPage.aids.names") == []
    pointer(page, "pointerdown", x, y, 0.5)
    for pressure, angle in ((0.5, 67.5), (1.0, 45.0), (0.2, 81.0)):
        pointer(page, "pointermove", x, y, pressure)
        assert page.value(ANGLE) == pytest.approx(np.radians(angle))
    for step in range(1, 60):
        pointer(page, "pointermove", x + 2 * step, y, 0.3)
    wait(page, "cutenvPage.page.cut.blade > 0.002")
    pointer(page, "pointerup", x, y, 0.0)
    assert page.value(ANGLE) == pytest.approx(np.radians(76.5)), "a pen that is lifted leaves the blade as it stands"
    assert record(page, tmp_path)["device_aids"] == ["pen"]
    click(page, "pen-tilts")
    start(page)
    pointer(page, "pointerdown", x, y, 1.0)
    pointer(page, "pointermove", x, y, 1.0)
    assert page.value(ANGLE) == pytest.approx(np.radians(70.0)), "its own tilt counts, as without the box"
    click(page, "stop")
    assert page.value("cutenvPage.page.cut.csv('', false).includes('device_aids')") is False


def test_a_handle_on_a_serial_port_leads_the_hand_as_hard_as_it_is_pushed(page: Browser, tmp_path: Path) -> None:
    page.value(PORT)
    page.value(
        "(e => { e.value = '-20'; e.dispatchEvent(new Event('input')); })(document.getElementById('serial-full'))"
    )
    click(page, "serial-connect")
    wait(page, f"{SERIAL}.open")
    said = "document.getElementById('serial-said').textContent"
    wait(page, f"{said}.startsWith('No numbers arrive')")
    assert page.value("baud") == 115200
    page.value("send('1\\r\\n')")
    assert page.value(f"{SERIAL}.count") == 0, "its beginning may have been lost"
    page.value("send('8.5\\r\\n')")
    assert "alone" in page.value(f"new Promise(done => setTimeout(() => done({said}), 100))")
    page.value("send('8.5\\r\\nboard ready\\n' + '8.5\\n'.repeat(18) + 'nan\\n1e999\\n\\n-')")
    wait(page, f"!{SERIAL}.resting")
    assert page.value(f"[{SERIAL}.count, {SERIAL}.rest]") == [20, pytest.approx(8.5)]
    start(page)
    assert page.value("cutenvPage.stylus.position") == 0.0
    hold = "window.held = setInterval(() => send('%s\\n'), 20)"
    page.value("send('2.0\\n')")  # ends the line that had begun: -2.0
    page.value(f"void ({hold % '-11.5'})")
    wait(page, "cutenvPage.page.cut.blade > 0.004")
    assert page.value(f"{SERIAL}.push(performance.now())") == 1.0
    assert "100 %" in page.value(said)
    page.value(f"void (clearInterval(held), {hold % '18.5'})")
    at = page.value("cutenvPage.stylus.position")
    wait(page, f"cutenvPage.stylus.position < {at}")
    page.value("void clearInterval(held)")
    wait(page, f"{SERIAL}.push(performance.now()) === 0")
    at = page.value("cutenvPage.stylus.position")
    time.sleep(0.1)
    assert page.value("cutenvPage.stylus.position") == at, "a handle that is silent leads nothing"
    page.value("unplug()")
    wait(page, f"{said}.includes('The device has been lost.')")
    assert page.value(f"[{SERIAL}.open, portClosed]") == [False, True]
    assert record(page, tmp_path)["device_aids"] == ["serial"]


def test_a_handle_is_asked_for_by_a_click_alone_and_may_be_refused_and_let_go(page: Browser) -> None:
    assert page.value("document.getElementById('serial').hidden === !('serial' in navigator)") is True
    page.value(PORT)
    page.value("void (window.asked = 0, window.own = navigator.serial.requestPort)")
    page.value("void (navigator.serial.requestPort = () => { asked += 1; return own(); })")
    start(page)
    click(page, "stop")
    assert page.value("asked") == 0
    said = "document.getElementById('serial-said').textContent"
    for refused, shown in (("NotFoundError", ""), ("SecurityError", "The handle cannot be read: refused")):
        page.value(f"void (window.refused = '{refused}')")
        click(page, "serial-connect")
        wait(page, f"{said} === {json.dumps(shown)}")
        assert page.value(f"{SERIAL}.open") is False
    page.value("void (window.refused = '')")
    button = "document.getElementById('serial-connect').textContent"
    click(page, "serial-connect")
    wait(page, f"{button} === 'Disconnect the handle'")
    click(page, "serial-connect")
    wait(page, f"portClosed && {button}.startsWith('Connect')")
    assert page.value("cutenvPage.aids.names") == []


def test_noise_without_an_end_of_line_is_not_kept(page: Browser) -> None:
    page.value(f"void ({SERIAL}.line = '')")
    page.value(f"void {SERIAL}.take('7'.repeat(100000), 0)")
    assert page.value(f"{SERIAL}.line.length") == 65
    page.value(f"void {SERIAL}.take('7\\n7\\n', 0)")
    assert page.value(f"[{SERIAL}.count, {SERIAL}.number]") == [1, 7]
