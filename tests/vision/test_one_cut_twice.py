"""The script that renders one cut and measures it twice: what was put in comes out, and what is done is kept."""

import json

import numpy as np
import pytest

from cutenv.records import read_record

pytest.importorskip("cv2", reason="OpenCV is an extra: pip install 'cutenv[vision]'")
pytest.importorskip("av", reason="PyAV is an extra: pip install 'cutenv[vision]'")

from scripts.validation.measurement import one_cut_twice


def test_the_beads_are_moved_by_the_force_that_the_record_shows(tmp_path):
    cut = one_cut_twice.RenderedCut(1)
    cut.record(tmp_path / "cut.csv")
    (trace,) = read_record(tmp_path / "cut.csv").traces
    assert trace.depth is None
    history, model, deep = cut.session.cut, cut.session.model, cut.session.model.thickness
    cutting = (np.gradient(trace.position, trace.time) > 1e-3) & (history.force > 2.0)
    moving = model.stiffness(history.tip) * cut.modulus * deep * history.lead + cut.specimen.friction_per_depth * deep
    assert np.median(np.abs(trace.force - moving)[cutting]) < 0.05
    most = float(history.time[history.force.argmax()])
    assert 1e-3 < np.abs(cut.session.places(most) - cut.session.rest).max() < 2e-2


@pytest.mark.slow
def test_both_moduli_are_what_was_put_in(tmp_path):
    assert one_cut_twice.measure(3, tmp_path) == 0
    found = json.loads((tmp_path / "twice.json").read_text())
    put_in = found["modulus_put_in_Pa"]
    assert found["modulus_by_force_Pa"]["mean"] == pytest.approx(put_in, rel=0.02)
    assert found["modulus_by_image_Pa"]["mean"] == pytest.approx(put_in, rel=0.05)
    assert found["field"]["rms_m"] < 1.5e-4
