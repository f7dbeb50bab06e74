"""Configuration page of the sensor: counts per unit, units, rate of the readings."""

from __future__ import annotations

import queue
import threading
import urllib.error
import urllib.request
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from http.client import HTTPException
from typing import NoReturn

from cutenv._base.validation import in_range
from cutenv.rig.errors import RigError

SETTINGS_PATH = "/netftapi2.xml"
LARGEST = 1 << 20
"""Greatest size of a page [byte]; a real one has about 4000."""

_COUNTS = (1e-3, 1e12)  # least and greatest number of counts in a unit
_RATES = (1.0, 1e5)  # [Hz]

_POUND = 4.4482216152605  # [N], exact by definition
_INCH = 0.0254  # [m]
_FOOT = 0.3048  # [m]
_KILOGRAM = 9.80665  # [N], by the standard gravity

# Models spell them differently ("Nm", "N-m"): see _plain.
NEWTONS_PER_UNIT = {
    "n": 1.0,
    "kn": 1000.0,
    "lbf": _POUND,
    "klbf": 1000.0 * _POUND,
    "kg": _KILOGRAM,
    "kgf": _KILOGRAM,
    "g": _KILOGRAM / 1000.0,
    "gf": _KILOGRAM / 1000.0,
}
"""Newtons in each unit of force."""
TORQUE_UNITS = {
    "nm": 1.0,
    "nmm": 0.001,
    "knm": 1000.0,
    "lbfin": _POUND * _INCH,
    "lbfft": _POUND * _FOOT,
    "kgcm": _KILOGRAM / 100.0,
    "kgfcm": _KILOGRAM / 100.0,
}
"""Newton metres in each unit of torque."""


@dataclass(frozen=True, kw_only=True)
class Page:
    """Configuration that the sensor reports.

    Attributes
    ----------
    newtons_per_count, newton_metres_per_count : float
        Force and torque for one count [N], [N m].
    rate : float or None
        Rate of the records [Hz]; None if the page does not contain it.
    """

    newtons_per_count: float
    newton_metres_per_count: float
    rate: float | None


def read_page(address: str, timeout: float = 3.0) -> Page:
    """Fetch the page from ``address`` (http://...) and read it.

    Raises
    ------
    RigError
        If it does not arrive within ``timeout`` [s], is too large, or lacks a necessary value.
    """
    if not address.startswith("http://"):
        raise RigError(f"sensor.page {address!r} must begin with http://, as http://192.168.1.1{SETTINGS_PATH} does.")
    answer: queue.SimpleQueue[bytes | RigError] = queue.SimpleQueue()

    def ask() -> None:
        try:
            answer.put(_fetch(address, timeout))
        except RigError as error:
            answer.put(error)

    # In a thread, because urllib limits only each single wait: a byte now and then would keep it waiting for ever.
    threading.Thread(target=ask, name="sensor's page", daemon=True).start()
    try:
        text = answer.get(timeout=timeout)
    except queue.Empty:
        raise RigError(f"The force sensor's page {address} did not come within {timeout:g} s. {_CURE}") from None
    if isinstance(text, RigError):
        raise text
    return parse_page(text, address)


def parse_page(text: bytes, address: str = "netftapi2.xml") -> Page:
    """Parse the page's XML; ``address`` is named in errors.

    Raises
    ------
    RigError
        If it is not XML, declares entities, or lacks a scale or a known unit.
    """
    try:
        root = ET.fromstring(text, parser=ET.XMLParser(target=_Tree(address)))
    except (ET.ParseError, LookupError, ValueError) as error:  # a wrong encoding is one of the latter two
        raise RigError(f"The force sensor's page {address} is not XML: {error}. Is it the sensor's address?") from None
    found: dict[str, str] = {}
    for element in root.iter():
        found.setdefault(element.tag.rpartition("}")[2].lower(), (element.text or "").strip())
    wanted = {"cfgcpf": "counts per force", "cfgcpt": "counts per torque", "scfgfu": "unit of force",
              "scfgtu": "unit of torque"}  # fmt: skip
    missing = [f"{name} ({meaning})" for name, meaning in wanted.items() if not found.get(name)]
    if missing:
        raise RigError(
            f"The force sensor's page {address} lacks {', '.join(missing)}. Nothing is assumed in their place: is it"
            " the page of a Net F/T or an Ethernet Axia?"
        )
    force = _number(found["cfgcpf"], "cfgcpf", *_COUNTS, address)
    torque = _number(found["cfgcpt"], "cfgcpt", *_COUNTS, address)
    return Page(
        newtons_per_count=_unit(found["scfgfu"], "scfgfu", NEWTONS_PER_UNIT, address) / force,
        newton_metres_per_count=_unit(found["scfgtu"], "scfgtu", TORQUE_UNITS, address) / torque,
        rate=_number(found["comrdtrate"], "comrdtrate", *_RATES, address) if found.get("comrdtrate") else None,
    )


_CURE = "Is the sensor powered and on this network, and sensor.address (or sensor.page) of the rig's file right?"


class _Tree(ET.TreeBuilder):
    """Tree builder that refuses a document type: its entities can expand without limit or refer elsewhere."""

    def __init__(self, address: str) -> None:
        super().__init__()
        self._address = address

    def doctype(self, name: str, public: str | None, system: str | None) -> NoReturn:
        raise RigError(
            f"The force sensor's page {self._address} declares a document type, which a sensor's never does."
        )


def _fetch(address: str, timeout: float) -> bytes:
    # No proxies, no redirection: only the sensor itself may answer.
    opener = urllib.request.OpenerDirector()
    for handler in (
        urllib.request.HTTPHandler(),
        urllib.request.HTTPErrorProcessor(),
        urllib.request.HTTPDefaultErrorHandler(),
    ):
        opener.add_handler(handler)
    try:
        with opener.open(address, timeout=timeout) as response:
            text: bytes = response.read(LARGEST + 1)
    except urllib.error.HTTPError as error:
        raise RigError(f"The force sensor's page {address} is refused: {error}. Is the path {SETTINGS_PATH}?") from None
    except (OSError, HTTPException, ValueError) as error:  # ValueError: an address like http://:x
        raise RigError(f"The force sensor's page {address} cannot be read: {error}. {_CURE}") from None
    if len(text) > LARGEST:
        raise RigError(f"The force sensor's page {address} has more than {LARGEST} bytes, which is not a sensor's.")
    return text


def _number(text: str, name: str, low: float, high: float, address: str) -> float:
    try:
        return in_range(name, float(text), low, high, "1")
    except ValueError:
        raise RigError(
            f"The force sensor's page {address} has {name} = {text[:40]!r}, which must be {low:g} to {high:g}."
        ) from None


def _unit(text: str, name: str, units: dict[str, float], address: str) -> float:
    try:
        return units[_plain(text)]
    except KeyError:
        raise RigError(
            f"The force sensor's page {address} has {name} = {text[:40]!r}, a unit that is not known. Choose another"
            f" on its configuration page, such as {'N' if units is NEWTONS_PER_UNIT else 'N-m'}."
        ) from None


def _plain(unit: str) -> str:
    return "".join(letter for letter in unit.lower() if letter.isalpha())
