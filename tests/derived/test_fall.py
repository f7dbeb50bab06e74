"""The fall of the LEM with speed: steps between measured speeds, the same in the law, the description and the fit."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from cutenv.cutting.law import loading_ratio
from cutenv.cutting.parameters import law_records
from cutenv.tissue import Specimen, measured_liver
from cutenv.tissue.description import TissueDescription, tables_only
from cutenv.tissue.effective_modulus import falls, linear_fit
from cutenv.tissue.fall import checked_falls, end_of_fall, speed_on_line
from cutenv.tissue.tables import table
from cutenv.tissue.variance_components import inclined_spread

LIVER = measured_liver()
SPEEDS = np.array([0.0, 0.0005, 0.001, 0.002, 0.0038, 0.006, 0.0127, 0.015, 0.0165, 0.02, 0.0254, 0.05])
UPRIGHT, INCLINED = math.pi / 2, math.pi / 4
# Pooled by hand from Table 5.6 at 90 degrees, [kPa]: neighbours that rise are averaged.
POOLED = (51.0, 40.0, 38.5, 38.5, 22.0, 22.0, 22.0)


def test_the_law_follows_the_pooled_means_at_every_measured_speed() -> None:
    for speed, level in zip(table("5.6")["speed_cm_s"] / 100, POOLED, strict=True):
        assert LIVER.local_effective_modulus(float(speed), UPRIGHT) == pytest.approx(1e3 * level, rel=1e-9)


def test_no_curve_that_never_rises_is_nearer_to_the_means() -> None:
    """Moved anywhere by 0.1 kPa, it is farther away or rises."""
    means = table("5.6")["lem_plane_stress_90_deg_Pa"] / 1e3
    best = float(((means - np.array(POOLED)) ** 2).sum())
    for n in range(len(means)):
        for change in (-0.1, 0.1):
            moved = np.array(POOLED)
            moved[n] += change
            assert (np.diff(moved) > 1e-9).any() or ((means - moved) ** 2).sum() > best


@pytest.mark.parametrize("angle", [INCLINED, 1.0, UPRIGHT])
@pytest.mark.parametrize("inclined_ratio", [0.5, 1.0, 2.5])
@pytest.mark.parametrize("tissue", [LIVER, tables_only()], ids=["steps", "line"])
def test_law_and_specimen_have_the_same_ratio(tissue: TissueDescription, inclined_ratio: float, angle: float) -> None:
    specimen = dataclasses.replace(Specimen.mean(tissue), inclined_ratio=inclined_ratio)
    law = law_records([specimen])[0]
    for speed in SPEEDS:
        ratio = specimen.loading_ratio(float(speed), angle)
        assert loading_ratio(law, speed, angle) == pytest.approx(ratio, rel=1e-12)
        assert 0.0 < ratio <= 1.0


def test_a_tissue_without_steps_falls_along_the_line_of_the_thesis() -> None:
    fit = linear_fit("5.6", angle_deg=90)
    for speed in (0.001, 0.01, 0.0254):
        assert tables_only().local_effective_modulus(speed, UPRIGHT) == pytest.approx(float(fit.modulus(speed)))


def test_steps_and_a_line_of_the_same_mean_slope_meet_at_the_end() -> None:
    intercept, slope, steps = falls("5.6")
    end = end_of_fall(steps)
    assert end == 0.0165
    assert float(speed_on_line(end, steps)) == pytest.approx(end)
    assert float(speed_on_line(1.0, steps)) == pytest.approx(end)
    assert intercept + slope * end == pytest.approx(22e3)
    assert speed_on_line([0.01, 0.02], ()).tolist() == [0.01, 0.02]


@pytest.mark.parametrize(
    "given",
    [
        3.0,
        [(0.5, 0.001, 0.01)],
        [(1.0, 0.01)],
        [(0.25, 0.0, 0.01)] * 4,
        [(1.5, 0.0, 0.01), (-0.5, 0.01, 0.02)],
        [(1.0, 0.02, 0.01)],
        [("half", 0.0, 0.01)],
    ],
)
def test_steps_that_are_none_are_refused_by_name(given: object) -> None:
    with pytest.raises(ValueError, match="falls_90"):
        checked_falls("falls_90", given)  # type: ignore[arg-type]


def test_a_description_keeps_its_steps_in_a_file() -> None:
    assert TissueDescription.from_json(LIVER.to_json()).falls_90 == LIVER.falls_90


def test_an_inclined_blade_scatters_as_table_5_6_does_beyond_an_upright_one() -> None:
    cv = {
        angle: table("5.6")[f"sd_plane_stress_{angle}_deg_Pa"] / table("5.6")[f"lem_plane_stress_{angle}_deg_Pa"]
        for angle in (45, 90)
    }
    assert inclined_spread() ** 2 + (cv[90] ** 2).mean() == pytest.approx((cv[45] ** 2).mean())
    drawn = np.log([Specimen.drawn(5, n).inclined_ratio for n in range(2000)])
    sigma = math.sqrt(math.log(1.0 + inclined_spread() ** 2))
    assert drawn.std() == pytest.approx(sigma, rel=0.05)
    assert np.exp(drawn).mean() == pytest.approx(1.0, abs=0.04)


def test_a_specimen_keeps_its_inclined_ratio_in_a_file() -> None:
    specimen = Specimen.drawn(5)
    assert specimen.inclined_ratio != 1.0
    assert Specimen.from_json(specimen.to_json()) == specimen
