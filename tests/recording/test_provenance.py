"""Where a record comes from is kept with it; who held the blade is not."""

from __future__ import annotations

import math

import pytest

from cutenv.recording import Provenance, load_one, save
from cutenv.trace import Trace

WHOLE = Provenance(
    rig="bench 2",
    sensor="ATI Nano17, No. FT12345",
    blade="No. 10, new",
    specimen="porcine liver 3, left lobe",
    date="2026-03-01T14:05:00+01:00",
    operator="P07",
    consent=True,
    calibration={"gain_N_per_V": 4.98, "offset_N": -0.02, "by": "weights of 50 to 500 g"},
)


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".h5"])
def test_it_comes_back_from_a_file_beside_other_metadata(tmp_path, suffix):
    cut = Trace(time=[0.0, 0.001], force=[0.0, 0.1], metadata={"trial": 3, **WHOLE.metadata})
    save(cut, tmp_path / f"cut{suffix}")
    kept = load_one(tmp_path / f"cut{suffix}").metadata
    assert Provenance.from_metadata(kept) == WHOLE
    assert kept["trial"] == 3


def test_what_is_not_known_is_left_out():
    assert Provenance().metadata == {}
    assert Provenance(rig="bench 2", consent=False).metadata == {"rig": "bench 2", "consent": False}
    assert repr(Provenance(rig="bench 2")) == "Provenance(rig='bench 2')"


@pytest.mark.parametrize(
    "code", ["P07", "7", "A3", "op-12", "S_003", "12b", "surgeon07", "Trainee-4", "a3f9c2e1", "0f" * 32]
)
def test_a_code_is_taken(code):
    assert Provenance(operator=code).operator == code


@pytest.mark.parametrize(
    "name",
    [
        *("Jane Doe", "jane", "Smith", "Dr. Lee", "Doe, Jane", "JD", "Li", "jdoe", "john1", "Müller2", "李1", "R2 D2"),
        *(
            "jane.doe@clinic.org",
            "j7@x.de",
            "+49 30 123456",
            "030123456",
            "19800131",
            "1980-01-31",
            "",
            " P07",
            "P07\n",
        ),
    ],
)
def test_what_may_be_a_name_an_address_a_number_or_a_birthday_is_refused(name):
    with pytest.raises(ValueError, match=r"operator .* may identify a person. Give a code of up to three letters"):
        Provenance(operator=name)


@pytest.mark.parametrize(
    ("field", "value", "error", "message"),
    [
        ("rig", "", ValueError, "rig must be a text of 1 to 500 characters"),
        ("blade", "x" * 501, ValueError, "blade must be a text of 1 to 500"),
        ("sensor", 5, TypeError, "sensor must be text, got 5"),
        ("date", "yesterday", ValueError, "date 'yesterday' is none in ISO 8601. Write it as '2026-03-01'"),
        ("date", "01.03.2026", ValueError, "ISO 8601"),
        ("date", 20260301, TypeError, "date must be text"),
        ("operator", 7, TypeError, "operator must be a code such as 'P07'"),
        ("consent", "yes", TypeError, "consent must be True, False or None"),
        ("consent", 1, TypeError, "consent must be True, False or None"),
        ("calibration", 4.98, TypeError, "calibration must map names to values"),
        ("calibration", {"gain": math.nan}, TypeError, "not what JSON can hold"),
    ],
)
def test_nonsense_is_refused_with_its_name(field, value, error, message):
    with pytest.raises(error, match=message):
        Provenance(**{field: value})


def test_a_wrong_entry_in_metadata_is_refused_too():
    with pytest.raises(TypeError, match="consent must be True"):
        Provenance.from_metadata({"consent": "yes"})
