"""Settings compared within specimens: exact against the paired t-test, right on virtual livers that differ."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import t as student
from scipy.stats import ttest_rel
from virtual_session import EVEN, cuts

from cutenv.commands.calibrate import differences_in_handling, settings_table
from cutenv.measurement.within_specimens import compare_settings, mixed_model
from cutenv.recording import Provenance, TissueHandling, load_one, save
from cutenv.tissue import measured_liver
from cutenv.trace import Trace

pytest.importorskip("statsmodels", reason="mixed models are an extra: pip install 'cutenv[stats]'")

DIFFERENT = EVEN | {"modulus_between_liver_cv": 0.4}


@pytest.mark.parametrize("between", [0.3, 0.0])
def test_two_settings_once_in_each_group_are_the_paired_t_test(between: float) -> None:
    rng = np.random.default_rng(3)
    level = rng.normal(0.0, between, 6)
    first, second = level + rng.normal(0.0, 0.1, 6), level + 0.2 + rng.normal(0.0, 0.1, 6)
    design = np.stack([np.ones(12), np.repeat([0.0, 1.0], 6)], axis=1)
    fixed, errors, _, _ = mixed_model(np.concatenate([first, second]), design, np.tile(np.arange(6), 2))
    expected = ttest_rel(second, first).confidence_interval()
    reach = float(student.ppf(0.975, 12 - 6 - 1)) * errors[1]
    assert (fixed[1] - reach, fixed[1] + reach) == pytest.approx((expected.low, expected.high), abs=1e-5)


def test_livers_that_differ_and_miss_settings_do_not_hide_the_law_of_speed() -> None:
    made = [cut for cut in cuts(**DIFFERENT) if cut.angle > 1.2]
    soft, *_, stiff = sorted(
        {cut.specimen for cut in made}, key=lambda name: _mean([c for c in made if c.specimen == name])
    )
    # The soft liver lacks the slow cut, and the stiff one the fast: without their levels, speed would stiffen.
    slow, fast = min(cut.speed for cut in made), max(cut.speed for cut in made)
    kept = [
        cut
        for cut in made
        if not (cut.specimen == soft and cut.speed < 1.1 * slow)
        and not (cut.specimen == stiff and cut.speed > 0.9 * fast)
    ]
    modulus, resistance = compare_settings(kept)
    true_moduli = measured_liver().local_effective_modulus
    assert modulus.specimens == 3
    assert modulus.between_sd > 5.0 * modulus.within_sd
    for effect in modulus.effects:
        truth, reference = (true_moduli(each.speed, each.angle) for each in (effect.setting, modulus.reference))
        assert effect.ratio == pytest.approx(truth / reference, rel=0.06)
        assert effect.low < effect.ratio < effect.high
    assert all(each.ratio == pytest.approx(1.0, abs=0.05) for each in resistance.effects)
    assert "within 3 specimens" in settings_table(kept)


def _mean(own: list) -> float:  # type: ignore[type-arg]
    return float(np.mean([cut.material_modulus for cut in own]))


def test_cuts_that_allow_no_comparison_are_refused() -> None:
    made = cuts(**DIFFERENT)
    with pytest.raises(ValueError, match="Cut two specimens or more, each at the reference setting"):
        compare_settings([cut for cut in made if cut.specimen == made[0].specimen])


def test_what_was_done_with_the_tissue_is_kept_and_differences_are_said(tmp_path) -> None:  # type: ignore[no-untyped-def]
    fresh = TissueHandling(hours_post_mortem=6, storage="saline", temperature_C=21.5, capsule="kept", fixation="nails")
    origin = Provenance(specimen="liver 1", handling=fresh)
    time = np.arange(100) / 100.0
    save(Trace(time=time, force=time, metadata=origin.metadata), tmp_path / "a.csv")
    read = load_one(tmp_path / "a.csv")
    assert Provenance.from_metadata(read.metadata) == origin
    bare = Trace(time=time, force=time)
    assert differences_in_handling([read, read]) == []
    assert "the tissue's handling differs in capsule: kept (1 cuts), not noted (1 cuts)" in differences_in_handling(
        [read, bare]
    )
    with pytest.raises(ValueError, match="capsule must be one of None, 'kept', 'removed', got 'half'"):
        TissueHandling(capsule="half")
    with pytest.raises(ValueError, match="Did you mean 'temperature_C'"):
        Provenance.from_metadata({"handling": {"temperature": 20}})
