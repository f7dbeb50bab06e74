"""What is shown of a record: even instants, the tip and the field that the force holds."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from recorded_cut import recorded_cut

from cutenv.display.viewer.solid import ShownCut
from cutenv.sim.trace import Trace


def forward() -> Any:
    return recorded_cut("liver", angle_deg=60.0, turns=(0.08,))


def without(trace: Trace, *names: str) -> Trace:
    return dataclasses.replace(trace, **dict.fromkeys(names))


def test_instants_are_even_and_hold_first_and_last() -> None:
    trace = forward().trace
    cut = ShownCut.of(trace, instants=50)
    assert len(cut) == 50
    assert cut.time[[0, -1]] == pytest.approx([0.0, trace.duration])
    assert np.ptp(np.diff(cut.time)) <= 2.1e-3  # readings are 1 ms apart
    shown = np.searchsorted(trace.time - trace.time[0], cut.time - 1e-9)
    np.testing.assert_array_equal(cut.force, trace.force[shown])
    np.testing.assert_array_equal(cut.position, trace.position[shown])


def test_a_short_record_is_shown_whole() -> None:
    trace = forward().trace.select(slice(0, 6000, 100))
    np.testing.assert_array_equal(ShownCut.of(trace).time, trace.time - trace.time[0])


def test_the_loaded_tip_stands_at_the_blade() -> None:
    """Compare where the force is smooth."""
    cut = ShownCut.of(forward().trace)
    loaded = cut.force > 1.0
    assert loaded.sum() > 40
    assert np.median(np.abs(cut.tip + cut.shift - cut.position)[loaded]) < 5e-4


@pytest.mark.parametrize(("turns", "source"), [((0.08,), "estimated"), ((0.08, 0.0), "return stroke")])
def test_the_shown_tip_is_near_the_true_one(turns: tuple[float, ...], source: str) -> None:
    recorded = recorded_cut("liver", turns=turns)
    cut = ShownCut.of(recorded.trace)
    true = np.interp(cut.time, recorded.trace.time - recorded.trace.time[0], recorded.tip)
    assert cut.tip_source == source
    assert np.abs(cut.tip - true)[-1] < 3e-3
    assert (np.diff(cut.tip) >= 0.0).all()


def test_the_field_carries_the_tip_by_its_shift() -> None:
    cut = ShownCut.of(forward().trace)
    i = int(np.argmax(cut.shift))
    model = cut.model
    on_line = np.sort(model.pairs[:, 0])
    corners = on_line[np.isin(on_line, model.elements)]
    along, moved = model.nodes[corners, 1], cut.field(i)[corners, 1]
    order = np.argsort(along)
    assert np.interp(cut.tip[i], along[order], moved[order]) == pytest.approx(cut.shift[i], rel=1e-9)


def test_the_given_target_goes_before_the_records() -> None:
    trace = dataclasses.replace(forward().trace, metadata={"target_length_m": 0.07})
    assert ShownCut.of(trace).target == 0.07
    assert ShownCut.of(trace, target=0.09).target == 0.09
    assert ShownCut.of(forward().trace).target is None


def test_without_an_angle_the_blade_is_upright_and_that_is_known() -> None:
    cut = ShownCut.of(without(forward().trace, "angle"))
    assert not cut.angle_known
    assert set(cut.angle) == {math.pi / 2}


@pytest.mark.parametrize("missing", ["position", "depth"])
def test_what_is_missing_is_named_with_the_cure(missing: str) -> None:
    with pytest.raises(ValueError, match=rf"view needs {missing}.*--map") as refused:
        ShownCut.of(without(forward().trace, missing, *(["speed"] if missing == "position" else [])))
    assert "depth=20mm" in str(refused.value)


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        (lambda trace: {"force_unit": "1"}, "view needs force in newtons"),
        (lambda trace: {"angle": np.full(len(trace), math.radians(5.0))}, "5 deg lies flat"),
        (
            lambda trace: {"position": 2.0 * trace.position, "speed": 2.0 * trace.speed},
            "longer than the model's specimen",
        ),
    ],
)
def test_what_cannot_be_drawn_is_refused(changed: Any, why: str) -> None:
    trace = forward().trace
    with pytest.raises(ValueError, match=why):
        ShownCut.of(dataclasses.replace(trace, **changed(trace)))


@pytest.mark.parametrize("instants", [1, 5000])
def test_a_number_of_instants_out_of_range_is_refused(instants: int) -> None:
    with pytest.raises(ValueError, match="instants"):
        ShownCut.of(forward().trace, instants=instants)
