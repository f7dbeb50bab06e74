"""Drivers of others: a rig's file names them, with options of their own, and what is wrong is said before any work."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import json
import sys
from pathlib import Path

import pytest

from cutenv.commands import cli
from cutenv.rig.config.settings import Axis, CameraSettings, RigSettings, SensorSettings, setting
from cutenv.rig.devices.driver_registry import (
    DriverKind,
    Mounting,
    driver_named,
    mounted,
    registered_drivers,
    rig_driver,
)
from cutenv.rig.devices.loop import FakeClock
from cutenv.rig.plant import rig_plant
from cutenv.rig.toml_file import read_rig_file, to_toml


@dataclasses.dataclass(frozen=True, kw_only=True)
class PlugOptions:
    port: str = setting("", "1", "Where it is plugged in.", example='"/dev/ttyACM0"')
    wait: float = setting(0.002, "ms", "Time for an answer.", 0.001, 0.1)


class _Plugged:
    rate, rate_error, axes = 500.0, 0.01, "x"

    def __init__(self, mounting: Mounting) -> None:
        self.name, self.mounting = mounting.role, mounting
        self.board = mounting.share("board", object)


@rig_driver(options=PlugOptions, emulated=lambda rig, role: True)
class Plug(_Plugged):
    """Plug for tests."""


class Plain(_Plugged):
    """Driver that declares nothing."""


def refuses(rig: RigSettings, role: str) -> None:
    raise ValueError(f"{role}.driver: this plug fits nowhere. Take another.")


@rig_driver(check=refuses)
class Unfit(_Plugged):
    """Driver that refuses every rig."""


HERE = f"{__name__}:Plug"
TEXT = f"""
emulated = true
depth_profile = [[0.0, 8.0], [150.0, 17.0]]
[calibration]
date = 2026-01-01
[blade]
driver = "{HERE}"
[blade.options]
port = "/dev/x"
wait_ms = 5
[sensor]
driver = "{HERE}"
[sensor.options]
port = "/dev/y"
"""


def written(folder: Path, text: str) -> Path:
    file = folder / "rig.toml"
    file.write_text(text)
    return file


def test_a_rig_of_drivers_of_others_needs_nothing_that_only_ours_read(tmp_path: Path) -> None:
    settings = read_rig_file(written(tmp_path, TEXT))
    assert settings.blade.options == PlugOptions(port="/dev/x", wait=0.005)
    assert settings.sensor.options == PlugOptions(port="/dev/y")


def test_drivers_of_a_rig_share_what_they_name(tmp_path: Path) -> None:
    settings, clock, shared = read_rig_file(written(tmp_path, TEXT)), FakeClock(), {}
    blade, sensor = (
        mounted(Mounting(role=role, rig=settings, clock=clock, shared=shared)) for role in ("blade", "sensor")
    )
    assert (blade.name, sensor.name) == ("blade", "sensor")
    assert blade.board is sensor.board
    assert blade.mounting.options.port == "/dev/x"


def test_a_plant_is_made_of_the_drivers_that_the_file_names(tmp_path: Path) -> None:
    plant = rig_plant(read_rig_file(written(tmp_path, TEXT)), FakeClock())
    assert isinstance(plant.spine.sensor, Plug)


def test_a_driver_of_ones_own_may_lie_in_the_present_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The installed program finds it there, like a policy, and like ``python -m``."""
    (tmp_path / "stage_of_ours.py").write_text(f"from {__name__} import Plug as Stage\n", encoding="utf-8")
    monkeypatch.setattr(sys, "path", [entry for entry in sys.path if entry != ""])
    monkeypatch.chdir(tmp_path)
    settings = read_rig_file(written(tmp_path, TEXT.replace(HERE, "stage_of_ours:Stage", 1)))
    assert isinstance(mounted(Mounting(role="blade", rig=settings, clock=FakeClock(), shared={})), Plug)


def test_what_is_written_is_read_again_and_holds_no_key_of_other_drivers(tmp_path: Path) -> None:
    settings = read_rig_file(written(tmp_path, TEXT))
    text = to_toml(settings)
    assert read_rig_file(written(tmp_path, text)) == settings
    assert not {"interface", "pulses", "address", "bitrate_bit_s"} & {
        line.partition(" =")[0] for line in text.split("\n")
    }


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (HERE, "gone:Plug", "driver 'gone:Plug'.*cannot be imported.*gone"),
        (HERE, f"{__name__}:Pluck", "cannot be imported.*Pluck"),
        (HERE, f"{__name__}:HERE", "no class or function"),
        (HERE, "canopn", r"\[blade\] driver must be one of.*Did you mean 'canopen'.*module:Class"),
        (HERE, f"{__name__}:Plain", "has no options; found port, wait_ms"),
        (HERE, f"{__name__}:Unfit", "has no options"),
        ('port = "/dev/x"', "", r"only a person can supply blade\.options\.port"),
        ("wait_ms = 5", "wait_ms = 500", r"\[blade.options\] wait_ms = 500 ms is outside 1 to 100 ms"),
        ("wait_ms = 5", "weight_ms = 5", "the name must be one of 'port', 'wait_ms', got 'weight_ms'"),
        ("wait_ms = 5", 'wait_ms = "5"', "wait_ms must be one real number in ms"),
        (f'driver = "{HERE}"', "driver = 5", r"\[blade\] driver must be a text"),
        ("[blade.options]", "[blade]", "not TOML"),
    ],
)
def test_a_driver_or_option_that_cannot_be_is_refused_with_its_place(
    old: str, new: str, said: str, tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match=said):
        read_rig_file(written(tmp_path, TEXT.replace(old, new, 1)))


def test_a_driver_may_refuse_a_rig_before_anything_is_connected(tmp_path: Path) -> None:
    text = TEXT.replace(HERE, f"{__name__}:Unfit").replace("emulated = true", "")
    text = "\n".join(line for line in text.split("\n") if "port" not in line and "wait" not in line)
    with pytest.raises(ValueError, match="fits nowhere"):
        read_rig_file(written(tmp_path, text))


def test_a_rig_is_emulated_only_if_each_of_its_drivers_says_so(tmp_path: Path) -> None:
    text = TEXT.replace(
        f'[sensor]\ndriver = "{HERE}"\n[sensor.options]\nport = "/dev/y"', '[sensor]\naddress = "10.0.0.9"'
    )
    with pytest.raises(ValueError, match=r"emulated = true.*\[sensor\], 'netft'"):
        read_rig_file(written(tmp_path, text))


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a package be installed that brings two force drivers, one under the name of ours."""
    points = [
        importlib.metadata.EntryPoint(name, HERE, DriverKind.FORCE.group)._for(
            type("Package", (), {"name": "labstage", "version": "1"})()
        )
        for name in ("plug", "netft")
    ]
    monkeypatch.setattr(
        "cutenv.rig.devices.driver_registry.entry_points",
        lambda group: [point for point in points if point.group == group],
    )


@pytest.mark.usefixtures("installed")
def test_installed_packages_bring_drivers_and_take_no_name_of_ours() -> None:
    found = registered_drivers(DriverKind.FORCE)
    assert found["plug"].load() is Plug
    assert found["netft"].origin == "cutenv"
    assert found["labstage.netft"].load() is Plug


@pytest.mark.usefixtures("installed")
def test_the_command_lists_drivers_and_explains_one(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["rig", "drivers", "--json"]) == 0
    told = {(each["kind"], each["name"]): each for each in json.loads(capsys.readouterr().out)}
    assert told["force", "plug"]["summary"] == "Plug for tests."
    assert told["motion", "canopen"]["origin"] == "cutenv"
    assert cli.main(["rig", "drivers", "plug"]) == 0
    assert "wait_ms: Time for an answer. 1 to 100 ms. Default 2.0." in capsys.readouterr().out
    assert cli.main(["rig", "drivers", "plugg"]) == 2
    assert "Did you mean 'plug'" in capsys.readouterr().err


def test_every_driver_of_this_package_can_be_loaded() -> None:
    for kind in DriverKind:
        for name, driver in registered_drivers(kind).items():
            assert driver.load().__doc__, name
    assert driver_named(DriverKind.CAMERA, "opencv").load()(
        Mounting(role="camera", rig=RigSettings(camera=CameraSettings()), clock=FakeClock())
    )


def test_defaults_are_the_drivers_that_were_there_before() -> None:
    assert (Axis().driver, SensorSettings().driver, CameraSettings().driver) == ("canopen", "netft", "opencv")
