"""A rig's file: written once by ``cutenv rig init``, read in SI, and what is wrong said with section, key and unit."""

from __future__ import annotations

import dataclasses
import math
import re
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st
from made_up_settings import measured, nearly_usual

from cutenv.commands import cli
from cutenv.drivers.slow_profile import slow_settings
from cutenv.rig.config.file_schema import SECTIONS
from cutenv.rig.config.settings import CameraSettings, Identified, RigSettings, SensorCalibration
from cutenv.rig.toml_file import read_rig_file, template, to_toml, write_identified

FILLED = template("bench 2").replace("\n# FILL IN: ", "\n")
PROFILE = ((0.0, 0.0081), (0.005, 0.0124), (0.15, 0.0175))
SETTINGS = RigSettings(depth_profile=PROFILE)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "rig.toml"


def changed(old: str, new: str) -> str:
    assert FILLED.count(old) == 1, old
    return FILLED.replace(old, new)


def test_the_template_is_refused_until_filled_in_and_lists_what_is_missing(file: Path) -> None:
    file.write_text(template())
    with pytest.raises(ValueError, match="only a person can supply") as caught:
        read_rig_file(file)
    for name in (
        "depth_profile", "bus.interface", "blade.gear", "blade.lead_mm", "blade.pulses", "sensor.address",
        "calibration.date",
    ):  # fmt: skip
        assert re.search(rf" {re.escape(name)}[,.]", str(caught.value)), name
    assert "angle." not in str(caught.value)


def test_the_template_filled_in_has_the_defaults_and_is_armed_by_nobody(file: Path) -> None:
    file.write_text(FILLED)
    assert 'armed_by = ""' in FILLED
    assert read_rig_file(file) == RigSettings(
        name="bench 2",
        depth_profile=((0.0, 0.0081), (0.005, 0.0124), (0.020, 0.017), (0.150, 0.0175)),
        calibration=SensorCalibration(date="2026-03-01"),
    )


def test_the_commented_second_axis_is_read_when_its_comment_marks_are_taken_off(file: Path) -> None:
    before, commented = FILLED.split("# # The axis that turns", 1)
    block, after = commented.split("\n\n", 1)
    block = re.sub(r"^# (FILL IN: )?", "", re.sub(r"^# ", "", block, flags=re.M), flags=re.M)
    block = "\n".join(line for line in block.splitlines() if re.match(r"\[angle\]|\w+ = ", line))
    file.write_text(before.replace('= "fixed"', '= "free"') + block + "\n\n" + after)
    axis = read_rig_file(file).angle
    assert axis is not None
    assert (axis.node, axis.lead, axis.low) == (2, 2 * math.pi, math.radians(44.0))


def test_a_camera_is_read_and_written_if_there_is_one(file: Path) -> None:
    assert SETTINGS.camera is None
    with_camera = dataclasses.replace(SETTINGS, camera=CameraSettings(source="2", calibration="a.json", strip=0.006))
    file.write_text(to_toml(with_camera))
    assert read_rig_file(file) == with_camera


@pytest.mark.parametrize(
    ("section", "missing"),
    [
        ('[camera]\nsource = "0"\n', "camera.calibration"),
        ("[angle]\nnode = 2\n", "angle.gear, angle.lead_deg, angle.pulses, angle.low_deg, angle.high_deg"),
        ("[height]\n", "height.node, height.gear, height.lead_mm, height.pulses, height.low_mm, height.high_mm"),
    ],
)
def test_only_a_person_knows_what_an_optional_part_is_made_of(file: Path, section: str, missing: str) -> None:
    file.write_text(f"{FILLED}\n{section}")
    with pytest.raises(ValueError, match=rf"only a person can supply {re.escape(missing)}"):
        read_rig_file(file)


def test_units_of_the_file_become_si(file: Path) -> None:
    text = FILLED
    for old, new in {
        "force_N = 15.0": "force_N = 7",
        "speed_cm_s = 2.65": "speed_cm_s = 2.54",
        "stale_force_ms = 20.0": "stale_force_ms = 12.5",
        "lost_force_percent = 20.0": "lost_force_percent = 7.0",
        "fixed_angle_deg = 90.0": "fixed_angle_deg = 45.0",
        "lead_mm = 2.0\n": "lead_mm = 1.27\n",
        "acceleration_m_s2 = 0.1": "acceleration_m_s2 = 0.25",
    }.items():
        text = text.replace(old, new, 1)
    file.write_text(text + "backlash_um = 25.0\nmotor_lag_ms = 41.5\n")
    settings = read_rig_file(file)
    limits = settings.limits
    assert (limits.force, limits.speed, limits.stale_force, limits.lost_force) == (7.0, 0.0254, 0.0125, 0.07)
    assert (settings.fixed_angle, settings.blade.lead, settings.blade.acceleration) == (math.pi / 4, 0.00127, 0.25)
    assert settings.identified == Identified(backlash=2.5e-5, motor_lag=0.0415)


def test_every_field_of_the_settings_has_its_line() -> None:
    """Nothing of a rig is out of reach of its file, and the file holds nothing that no field takes."""
    for section in SECTIONS:
        fields = {field.name for field in dataclasses.fields(section.of)}
        fields -= {"options"} if section.name else {part.name for part in SECTIONS}  # a table of the driver's own
        assert {key.field for key in section.keys} == fields, section.name


def test_every_number_of_the_file_says_its_unit() -> None:
    pure = {"node", "gear", "pulses", "direction", "port", "sign", "force_sign", "gain", "tag"}
    for section in SECTIONS:
        for key in section.keys:
            if key.kind in (int, float) and key.field not in pure:
                assert key.unit.name != "1", section.where(key)
                assert key.name.endswith(key.unit.name)


REFUSED = {
    "unknown key": (("force_N = 15.0", "force_mN = 15.0"), r"in \[limits\] the name .*Did you mean 'force_N'"),
    "unknown section": (("[sensor]", "[sensr]"), "name 'sensr' is not known. Did you mean 'sensor'"),
    "unknown line": (("emulated =", "emulate ="), "Did you mean 'emulated'"),
    "out of range": (("force_rise_N_per_s = 200.0", "force_rise_N_per_s = 2e6"),
                     r"\[limits\] force_rise_N_per_s = 2e\+06 N/s is outside 1 to 5000 N/s"),
    "in its unit": (("stale_force_ms = 20.0", "stale_force_ms = 0.02"),
                    r"\[limits\] stale_force_ms = 0.02 ms is outside 2 to 500 ms"),
    "angle": (("fixed_angle_deg = 90.0", "fixed_angle_deg = 30"), "fixed_angle_deg = 30 deg is outside 45 to 90 deg"),
    "NaN": (("force_N = 15.0", "force_N = nan"), r"\[limits\] force_N = nan N is outside"),
    "infinite": (("force_N = 15.0", "force_N = inf"), r"\[limits\] force_N = inf N is outside"),
    "text": (("force_N = 15.0", 'force_N = "15"'), r"\[limits\] force_N must be one real number in N, got '15'"),
    "bool": (("force_N = 15.0", "force_N = true"), r"\[limits\] force_N must be one real number in N"),
    "broken number": (("pulses = 1024\n# 1", "pulses = 1024.0\n# 1"), r"\[blade\] pulses must be a whole number"),
    "bool as number": (("direction = 1\n# One", "direction = true\n# One"), "direction must be a whole number"),
    "hardware called emulated": (("emulated = false", "emulated = true"), "emulated = true is for an emulator on this"),
    "number as bool": (("emulated = false", "emulated = 0"), "emulated must be true or false, got 0"),
    "number as text": (('name = "bench 2"', "name = 2"), "name must be a text in quotation marks"),
    "direction": (("direction = 1\n# One", "direction = 2\n# One"),
                  r"\[blade\]: direction must be one of 1, -1, got 2"),
    "node": (("node = 127", "node = 128"), r"\[bus\]: node = 128 is outside 1 to 127"),
    "choice": (('cut_axis = "x"', 'cut_axis = "X"'), r"\[sensor\] cut_axis must be one of 'x', 'y', 'z'"),
    "ends of travel": (("high_mm = 149.0", "high_mm = -5.0"),
                       r"\[blade\] low_mm = -2 must be below high_mm = -5: they are the ends of travel"),
    "angle mode": (('angle_mode = "fixed"', 'angle_mode = "free"'), '"free" needs the second axis "angle"'),
    "date": (("date = 2026-03-01", 'date = "1 March"'), r"\[calibration\] date = '1 March' is not a date"),
    "date of a kind": (("date = 2026-03-01", "date = 20260301"), r"\[calibration\] date must be a date such as"),
    "section as line": (("[bus]", "bus = 3\n[buss]"), r"bus must be a section, \[bus\]|Did you mean 'bus'"),
    "not TOML": (('"bench 2"', "bench 2"), r"it is not TOML: .*line 8.*quotation marks"),
    "one point": (("[5.0, 12.4], [20.0, 17.0], [150.0, 17.5]", ""), "depth_profile has 1 points, and needs 2"),
    "fall back": (("[20.0, 17.0]", "[2.0, 17.0]"), "goes from 5 to 2 mm; positions must rise"),
    "late": (("[[0.0, 8.1]", "[[1.5, 8.1]"), "begins at 1.5 mm, and must within 1 mm"),
    "short": (("[150.0, 17.5]", "[59.0, 17.5]"), "ends at 59 mm, and the blade goes to 60 mm"),
    "in metres": (("[5.0, 12.4]", "[5.0, 0.0124]"), "depth = 0.0124 mm is outside 1 to 60 mm"),
    "no pairs": (("[5.0, 12.4]", "5.0, 12.4"), r"depth_profile must be a list of \[position_mm, depth_mm\]"),
    "text in a pair": (("[5.0, 12.4]", '[5.0, "12"]'), "depth_profile must be one real number in mm, got '12'"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_wrong_is_said_with_file_section_key_and_unit(file: Path, name: str) -> None:
    change, message = REFUSED[name]
    file.write_text(changed(*change))
    with pytest.raises(ValueError, match=message) as caught:
        read_rig_file(file)
    assert str(caught.value).startswith(f"{file}")


def test_a_file_that_is_not_there_is_answered_with_the_command(file: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"cutenv rig init .*rig\.toml"):
        read_rig_file(file)


def test_what_is_no_text_is_refused(file: Path) -> None:
    file.write_bytes(b'name = "Pr\xfcfstand"\n')
    with pytest.raises(ValueError, match="not UTF-8 text"):
        read_rig_file(file)


@st.composite
def any_settings(draw: st.DrawFn) -> RigSettings:
    text = st.text(st.characters(codec="utf-8"), max_size=10)
    settings = draw(nearly_usual())
    rise = draw(st.lists(st.floats(0.001, 0.06), min_size=2, max_size=5))
    profile = tuple((0.02 * i, depth) for i, depth in enumerate([*rise, 0.02]))
    return dataclasses.replace(
        settings,
        name=draw(text.map(str.strip).filter(lambda name: name.isprintable() and bool(name))),
        armed_by=draw(text),
        fixed_angle=draw(st.floats(math.pi / 4, math.pi / 2)),
        bus=dataclasses.replace(settings.bus, channel=draw(text), node=draw(st.integers(3, 127))),
        blade=dataclasses.replace(settings.blade, direction=draw(st.sampled_from([1, -1]))),
        sensor=dataclasses.replace(settings.sensor, cut_axis=draw(st.sampled_from("xyz"))),
        calibration=SensorCalibration(date=draw(st.sampled_from(["", "2026-03-01", "2026-03-01T14:05:00"]))),
        identified=draw(measured()),
        depth_profile=(*profile, (0.15 + draw(st.floats(0.0, 0.1)), 0.01)),
    )


@given(settings=any_settings())
@examples(max_examples=40)
def test_what_is_written_is_read_back(tmp_path_factory: pytest.TempPathFactory, settings: RigSettings) -> None:
    file = tmp_path_factory.mktemp("rig") / "rig.toml"
    file.write_text(to_toml(settings), encoding="utf-8")
    again = read_rig_file(file)
    assert close(dataclasses.asdict(again), dataclasses.asdict(settings))
    assert to_toml(again) == to_toml(settings)


def close(one: Any, other: Any) -> bool:
    """Whether two settings are the same up to 15 digits."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(close(one[name], other[name]) for name in one)
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(close, one, other))
    return math.isclose(one, other, rel_tol=1e-14) if isinstance(one, float) else bool(one == other)


@given(number=st.decimals(0, 999, places=3))
def test_what_a_lab_writes_is_neither_lengthened_nor_rounded(number: Decimal) -> None:
    for section in SECTIONS:
        for key in section.keys:
            assert key.from_si(key.to_si(float(number))) == float(number), section.where(key)


MEASURED = Identified(date="2026-04-01", motor_lag=0.0415, dead_time=0.012, backlash=2.5e-5, force_noise=0.019)


def test_what_was_identified_is_read_back(file: Path) -> None:
    file.write_text(FILLED)
    before = read_rig_file(file)
    write_identified(file, MEASURED)
    assert read_rig_file(file) == dataclasses.replace(before, identified=MEASURED)
    assert "motor_lag_ms = 41.5\n" in file.read_text()


@pytest.mark.parametrize("place", ["last", "amidst", "missing", "windows"])
def test_all_the_rest_of_the_file_stays_as_it_was(file: Path, place: str) -> None:
    mine = "# our bench, in the cellar\n[sensor]  # the new one\n"
    text = changed("[sensor]\n", mine)
    head, section = text.split("# What 'cutenv rig identify'")
    section = f"# What 'cutenv rig identify'{section}"
    if place == "amidst":
        text = head.replace(mine, f"{section}\n{mine}")
    elif place == "missing":
        text = head
    elif place == "windows":
        text = text.replace("\n", "\r\n")
    file.write_bytes(text.encode())
    write_identified(file, MEASURED)
    written = file.read_bytes().decode()
    added = {"[identified]", "date = \"2026-04-01\"", "motor_lag_ms = 41.5", "dead_time_ms = 12.0",
             "backlash_um = 25.0", "force_noise_N = 0.019"}  # fmt: skip
    rest = [line for line in written.split("\n") if line.strip() and line.strip() not in added]
    assert rest == [line for line in text.split("\n") if line.strip() and line.strip() != "[identified]"]
    assert read_rig_file(file).identified == MEASURED


def test_a_second_measurement_takes_the_place_of_the_first_and_keeps_comments(file: Path) -> None:
    file.write_text(FILLED + "motor_lag_ms = 40.0  # by hand\nfriction_N = 3.0\n")
    write_identified(file, Identified(motor_lag=0.05))
    assert "motor_lag_ms = 50.0  # by hand\n" in file.read_text()
    assert read_rig_file(file).identified == Identified(motor_lag=0.05)


def test_a_measurement_that_the_file_cannot_hold_leaves_it_as_it_was(file: Path) -> None:
    file.write_text(FILLED)
    for wrong in (Identified(motor_lag=math.nan), Identified(friction=-1.0), Identified(date="yesterday")):
        with pytest.raises(ValueError, match=r"\[identified\]"):
            write_identified(file, wrong)
        assert file.read_text() == FILLED
    assert list(file.parent.iterdir()) == [file]


def test_an_empty_date_of_a_measurement_is_none(file: Path) -> None:
    file.write_text(FILLED + 'date = ""\n')
    with pytest.raises(ValueError, match=r"\[identified\] date = '' is not a date"):
        read_rig_file(file)


def test_a_new_file_is_the_template_with_the_rig_s_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "bench.toml"
    assert cli.main(["rig", "init", str(path), "--name", 'bench "2"']) == 0
    assert path.read_text(encoding="utf-8") == template('bench "2"')
    assert "nothing moves while armed_by is empty" in capsys.readouterr().out
    cli.main(["rig", "init", str(tmp_path / "mine.toml")])  # called as its file
    assert (tmp_path / "mine.toml").read_text(encoding="utf-8") == template("mine")


def test_a_new_file_of_a_slow_rig_tells_all_missing_lines_at_once_and_has_no_section_of_other_drives(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "slow.toml"
    cli.main(["rig", "init", str(path), "--profile", "serial"])
    text = path.read_text(encoding="utf-8")
    assert "[height]" not in text
    assert "# FILL IN: lead_mm = 8.0\n" in text  # of this kind of rig, and as the page has it
    assert "# FILL IN: counts_per_N = 42800.0\n" in text
    capsys.readouterr()
    assert cli.main(["rig", "check", str(path)]) == 2
    told = capsys.readouterr().err
    for line in ("depth_profile", "blade.lead_mm", "blade.options.port", "blade.options.steps", "sensor.options.port",
                 "sensor.options.counts_per_N", "calibration.date"):  # fmt: skip
        assert line in told


def test_counts_of_a_cell_that_pulls_the_other_way_are_told_of_the_sign(tmp_path: Path) -> None:
    path = tmp_path / "slow.toml"
    text = to_toml(dataclasses.replace(slow_settings("/dev/board"), depth_profile=((0.0, 0.01), (0.15, 0.02))))
    path.write_text(text.replace("counts_per_N = 42800.0", "counts_per_N = -42800"), encoding="utf-8")
    with pytest.raises(ValueError, match=r"counts_per_N = -42800 is negative. Write 42800, .* by sensor.sign"):
        read_rig_file(path)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("mine.toml", "is there already, and is left"),
        ("rig.txt", "must end in .toml"),
        ("gone/rig.toml", "gone. Make it, or give another place"),
    ],
)
def test_nothing_is_written_where_it_should_not_be(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, message: str
) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text("mine")
    assert cli.main(["rig", "init", str(tmp_path / name)]) == 2
    assert message in capsys.readouterr().err
    assert mine.read_text() == "mine"
    assert list(tmp_path.iterdir()) == [mine]


def test_help_lists_the_commands_of_the_rig(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        cli.main(["rig", "--help"])
    shown = capsys.readouterr().out
    assert all(name in shown and command.summary in shown for name, command in cli.RIG_COMMANDS.items())


def test_an_unknown_command_of_the_rig_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        cli.main(["rig", "ini"])
    assert "init" in capsys.readouterr().err
