"""Table 7.1: beads beside the cut, finite elements against experiment; the printed numbers among themselves."""

from __future__ import annotations

import numpy as np
import pytest

from cutenv.tissue.tables import table

T = table("7.1")
FEM, EXPERIMENT = T["fem_displacement_cm"], T["experimental_displacement_cm"]


def check_agreement(bead: int) -> None:
    """Computed and measured displacement agree within a quarter."""
    assert abs(FEM[bead - 1] - EXPERIMENT[bead - 1]) <= 0.25 * EXPERIMENT[bead - 1] * (1 + 1e-9)


@pytest.mark.parametrize("bead", [1, 2, 3, 5])
def test_half_of_the_beads_agree(bead):
    check_agreement(bead)


@pytest.mark.parametrize("bead", [4, 6, 7, 8])
def test_erratum_the_other_half_does_not(bead):
    assert any("Beads 4 and 6" in erratum for erratum in T.errata)
    with pytest.raises(AssertionError):
        check_agreement(bead)


def test_the_root_mean_square_difference_is_1_8_mm():
    assert np.sqrt(np.mean((FEM - EXPERIMENT) ** 2)) == pytest.approx(0.178, abs=0.001)
