"""Relaxing tissue, an option: what a dwell does to the force, and to a probe that unloads."""

from __future__ import annotations

import numpy as np
import pytest
from led_cut import LedCut, changed_law, constant_feed, homogeneous, lead, lead_by, residual_of, through

from cutenv.cutting.parameters import LawParameters

SHARE, CREEP_TIME = 0.4, LawParameters().creep_time
RELAXING = LawParameters(relaxing_share=SHARE)
SPEED = 0.0254
HELD = 0.002  # [m]: below the force at which a blade begins to cut


def dwell(seconds: float, *, back: float = 0.0) -> np.ndarray:
    """Positions [m]: press the tissue at the clamp, stay, and draw back."""
    press = constant_feed(SPEED, to=HELD)
    rest = np.full(round(1e3 * seconds), press[-1])
    return np.concatenate((press, rest, through([back], SPEED * 1e-3, start=press[-1]) if back else np.zeros(0)))


def check_dwell(cut: LedCut) -> None:
    """The force falls by exp(-t / (1 - rho) T) to (1 - rho) K u; the account holds, and nothing is won back."""
    pressed = round(HELD / SPEED * 1e3) - 1
    force = cut.readings["elastic_force"][pressed:]
    time = 1e-3 * np.arange(len(force))
    rest = (1.0 - SHARE) * cut.profile["stiffness"][0] * cut.readings["position"][-1]
    expected = rest + (force[0] - rest) * np.exp(-time / ((1.0 - SHARE) * CREEP_TIME))
    assert force == pytest.approx(expected, rel=1e-3)
    assert force[-1] == pytest.approx(rest, rel=1e-3)
    assert np.abs(residual_of(cut)).max() < 1e-12 * max(cut.end.work, 1e-3)
    assert np.diff(cut.states["loss"]).min() >= 0.0


def test_a_held_blades_force_relaxes():
    check_dwell(lead(homogeneous(), dwell(10.0), parameters=RELAXING))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("row.loss[n] += lost\n", "row.loss[n] += 0.0\n"),
        ("rate * law.relaxing_share * max(reach, creep)", "rate * max(reach, creep)"),
    ],
)
def test_a_relaxation_broken_on_purpose_fails_the_check(old, new):
    check_dwell(lead_by(changed_law(), homogeneous(), dwell(10.0), parameters=RELAXING))
    with pytest.raises(AssertionError):
        check_dwell(lead_by(changed_law((old, new)), homogeneous(), dwell(10.0), parameters=RELAXING))


def test_tissue_that_nobody_holds_comes_back():
    held = lead(homogeneous(), dwell(10.0), parameters=RELAXING)
    free = lead(homogeneous(), np.zeros(1000), start=held.end, parameters=RELAXING)
    assert free.states["creep"][1:] == pytest.approx(
        free.states["creep"][1] * np.exp(-1e-3 * np.arange(1000) / CREEP_TIME), rel=1e-3
    )
    assert np.all(free.readings["elastic_force"][1:] == 0.0)
    assert np.abs(residual_of(free)).max() < 1e-15


@pytest.mark.parametrize(("seconds", "short_by"), [(0.0, 0.02), (1.0, 0.25), (10.0, SHARE)])
def test_a_probe_after_a_dwell_tells_the_stiffness_but_finds_the_tip_too_early(seconds, short_by):
    """Unloading by 1 mm within 40 ms: the slope is K, and its zero lies before the tip by what has crept."""
    cut = lead(homogeneous(), dwell(seconds, back=0.5 * HELD), parameters=RELAXING)
    probe = cut.readings[-40:]
    slope, offset = np.polyfit(probe["position"], probe["elastic_force"], 1)
    assert slope == pytest.approx(cut.profile["stiffness"][0], rel=0.03)
    assert -offset / slope == pytest.approx(short_by * HELD, abs=0.05 * HELD)


def test_tissue_does_not_relax_unless_it_is_asked_to():
    path = np.concatenate((constant_feed(0.01, to=0.03), np.full(1000, 0.03)))
    plain, slow = (lead(homogeneous(), path, parameters=LawParameters(creep_time=t)) for t in (CREEP_TIME, 50.0))
    assert plain.states.tobytes() == slow.states.tobytes()
    assert np.ptp(plain.readings["elastic_force"][-1000:]) == 0.0
