"""The energy account of a cut, for any motion of the blade in any specimen, one that no drive makes included."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from led_cut import (
    INCLINED,
    UPRIGHT,
    LedCut,
    changed_law,
    constant_feed,
    homogeneous,
    lead,
    lead_by,
    policies,
    recorded_work,
    residual_of,
    specimens,
    through,
    toughening,
    turning_work,
)

from cutenv._engine.randomness import generator
from cutenv.sim.cutting.dtypes import LawParameters
from cutenv.sim.tissue.specimen import N_POINTS, SPACING, Specimen
from scripts.validation.physics.adversarial_motions import MOTIONS

some = settings(max_examples=40)


def check_identity(cut: LedCut) -> None:
    """Work = stored + fracture + friction + loss + ledger, at every instant."""
    assert np.all(np.abs(residual_of(cut)) <= 1e-9 * np.maximum(cut.states["work"], 1e-3))


def check_recorded_work(cut: LedCut) -> None:
    """The work booked is that of the recorded force over the recorded motion, and of turning.

    The record does not hold the peak from which a run starts: its half step counts to the tolerance.
    """
    r = cut.readings
    moved = np.abs(np.diff(cut.states["blade"]))
    unseen = np.cumsum(cut.along("stiffness", cut.states["tip"][:-1]) * r["jump"] * moved)
    difference = cut.states["work"] - turning_work(cut) - recorded_work(cut)
    scale = np.maximum.accumulate(np.maximum(cut.states["work"], 1e-3))
    assert np.all(np.abs(difference[1:]) <= unseen + 5e-4 * scale[1:])


def check_second_law(cut: LedCut) -> None:
    """No motion yields work, loop or no loop: what is neither stored nor friction nor turning never falls.

    Friction gives back what its bristles hold, f z/2 at most.
    """
    rubbed, law = cut.states["friction"], cut.law
    held = 0.5 * law.friction_per_depth * cut.profile["depth"].max() * law.presliding_length
    assert (np.maximum.accumulate(rubbed) - rubbed).max() <= held * (1.0 + 1e-9)
    assert np.diff(cut.states["work"] - cut.stored - rubbed - turning_work(cut)).min() >= -1e-12


def check_loss_never_decreases(cut: LedCut) -> None:
    assert np.diff(cut.states["loss"]).min() >= 0.0


def check_a_cut_never_heals(cut: LedCut) -> None:
    assert np.diff(cut.states["tip"]).min() >= 0.0


def check_ledger_floor(cut: LedCut) -> None:
    """The ledger never falls below -R B l, l = 1.5 mm, of the toughest place so far."""
    toughest = np.maximum.accumulate(cut.profile["toughness"])
    R_B = toughest[np.minimum(np.searchsorted(np.arange(N_POINTS) * SPACING, cut.states["tip"]), len(toughest) - 1)]
    assert np.all(cut.states["ledger"] >= -R_B * 1.5e-3 * (1.0 + 1e-9))


@settings(max_examples=60)
@given(specimens(), policies())
def test_no_motion_breaks_the_account_yields_work_loses_less_or_heals_or_borrows_too_much(specimen, policy):
    """Every check, of one cut."""
    cut = lead(specimen, *policy.path())
    check_identity(cut)
    check_second_law(cut)
    assert np.all(cut.states["work"] >= cut.stored - 1e-12)
    check_loss_never_decreases(cut)
    check_a_cut_never_heals(cut)
    check_ledger_floor(cut)


@settings(max_examples=20)
@given(specimens(), policies(most_legs=4))
def test_the_work_booked_is_that_of_the_recorded_force(specimen, policy):
    check_recorded_work(lead(specimen, *policy.path(dt=1e-4), dt=1e-4))


def net_work_of_loop(cut: LedCut, back: LedCut) -> float:
    """Work [J] of a motion ``back`` from where ``cut`` ended to the same blade, tip and angle."""
    assert back.end.tip == cut.end.tip
    assert back.end.blade == pytest.approx(cut.end.blade, abs=1e-15)
    assert back.end.angle == cut.end.angle
    return float(back.end.work - cut.end.work)


@some
@given(specimens(), policies(most_legs=3), st.floats(1e-6, 0.02), st.floats(INCLINED, UPRIGHT), st.floats(1e-3, 0.0254))
def test_a_closed_loop_of_motion_and_angle_costs_friction_and_turning(specimen, policy, amplitude, turned, speed):
    """Retract and come back, turning there and back; where turning lets the blade cut, at most U is given back."""
    cut = lead(specimen, *policy.path())
    x = cut.end.blade
    amplitude = min(amplitude, x)
    place = through([x - amplitude, x], speed * 1e-3, start=x)
    angle = cut.end.angle + (turned - cut.end.angle) * np.sin(np.linspace(0.0, np.pi, len(place)))
    angle[-1] = cut.end.angle
    back = lead(specimen, place, np.clip(angle, INCLINED, UPRIGHT), start=cut.end)
    if back.end.tip == cut.end.tip:
        assert net_work_of_loop(cut, back) >= -1e-12
    assert back.end.work - cut.end.work >= back.stored[-1] - cut.stored[-1] - 1e-12


@some
@given(specimens(), st.floats(0.005, 0.1), st.floats(0.002, 0.0254), st.floats(0.002, 0.0254))
def test_unloading_gives_back_the_stored_energy_at_any_speed(specimen, reach, speed_out, speed_back):
    cut = lead(specimen, through([reach], speed_out * 1e-3))
    back = lead(specimen, through([cut.end.tip], speed_back * 1e-3, start=reach), start=cut.end)
    given_back = (cut.end.work - cut.end.friction) - (back.end.work - back.end.friction)
    assert given_back == pytest.approx(cut.stored[-1], rel=1e-9, abs=1e-15)


def strokes(*, step: float, friction_share: float, turning: bool) -> tuple[Specimen, np.ndarray, np.ndarray]:
    """Creep on in short strokes, return, then cut into tissue so weak that the crack runs up to the blade."""
    tough = homogeneous(friction_share=friction_share)
    weak_beyond_5_cm = np.where(np.arange(N_POINTS) * SPACING < 0.05, 211.0, 20.0)
    specimen = dataclasses.replace(tough, fracture_resistance=weak_beyond_5_cm)
    creep = [x for peak in np.linspace(0.02, 0.04, 80) for x in (peak, peak - 0.3e-3)]
    positions = through([*creep, 0.02, 0.06], step)
    waves = np.cos(np.linspace(0.0, 20.0, len(positions)))
    angles = 0.5 * (UPRIGHT + INCLINED) + 0.5 * (UPRIGHT - INCLINED) * (waves if turning else 1.0)
    return specimen, positions, np.broadcast_to(angles, positions.shape)


RUBBED = "    row.depth[n], row.bristle[n] = next_depth, next_bristle\n"
"""Line of the law that follows where friction is added to a straight cut."""


@pytest.mark.parametrize(
    ("check", "old", "new"),
    [
        (check_identity, "change = U - next_U - spent", "change = F * (tip - a) - spent"),
        (check_identity, "row.work[n] += energy\n", "row.work[n] += 1.01 * energy\n"),
        (check_identity, "loss + max(ledger, 0.0)", "loss"),
        (check_identity, f"row.friction[n] += rubbed\n{RUBBED}", f"row.friction[n] += 1.01 * rubbed\n{RUBBED}"),
        (check_recorded_work, "mean_depth * abs(dx", "0.9 * mean_depth * abs(dx"),
        (check_recorded_work, "row.work[n] += energy\n", "row.work[n] += 2.0 * energy\n"),
        (check_recorded_work, "    work = 0.5 * (before.F", "    work = 0.45 * (before.F"),
        (check_second_law, "row.U[n] - U\n", "row.U[n] - 1.001 * U\n"),
        (check_second_law, "mean_depth * abs(dx", "mean_depth * (1.0 if dx > 0.0 else -1.0) * abs(dx"),
        (check_loss_never_decreases, "loss + max(ledger, 0.0)", "loss - ledger"),
        (
            check_a_cut_never_heals,
            "x, a, dx, K = row.blade[n] - row.creep[n], row.tip[n],",
            "row.tip[n] = min(row.tip[n], row.blade[n]); x, a, dx, K = row.blade[n] - row.creep[n], row.tip[n],",
        ),
    ],
)
def test_a_law_broken_on_purpose_fails_its_check(check, old, new):
    frictionless = check is check_loss_never_decreases
    step = 5e-6 if check is check_recorded_work else 25e-6
    motion = strokes(step=step, friction_share=0.0 if frictionless else 0.2, turning=not frictionless)
    check(lead(*motion))
    with pytest.raises(AssertionError):
        check(lead_by(changed_law((old, new)), *motion))


def test_a_law_that_lends_without_limit_fails_the_check():
    motion = toughening(), constant_feed(0.0254, to=0.05), INCLINED
    check_ledger_floor(lead(*motion))
    with pytest.raises(AssertionError):
        check_ledger_floor(lead_by(changed_law(("ledger + change >= -toughness * debt_length", "True")), *motion))


MOST_FRACTURE_ERROR = 1e-5  # [J], of 0.1 J and more


def check_account(cut: LedCut) -> None:
    """Work = stored + fracture + friction + loss + ledger; the force is finite and pulls back; no crack heals."""
    assert np.all(np.abs(residual_of(cut)) <= 1e-12 * np.maximum(cut.states["work"], 1e-3))
    assert np.all(np.isfinite(cut.readings["true_force"]))
    assert cut.readings["elastic_force"].min() >= 0.0
    assert np.diff(cut.states["tip"]).min() >= 0.0


def check_fracture(cut: LedCut) -> None:
    """What was booked as fracture, less turning, is the integral of R B from the clamp to the tip."""
    knots = cut.profile["toughness"]
    whole = SPACING * np.concatenate(([0.0], np.cumsum(0.5 * (knots[1:] + knots[:-1]))))
    tip = cut.states["tip"]
    i = np.minimum((tip / SPACING).astype(int), len(knots) - 2)
    rest = tip - i * SPACING
    integral = whole[i] + 0.5 * rest * (knots[i] + cut.along("toughness", tip))
    assert np.abs(cut.states["fracture"] - turning_work(cut) - integral).max() <= MOST_FRACTURE_ERROR


@pytest.mark.parametrize("episode", range(3))
@pytest.mark.parametrize("name", MOTIONS)
def test_the_account_and_fracture_are_exact_under_any_motion(name, episode):
    rng = generator(13, episode)
    specimen = Specimen.draw(rng, specimen_class="vascular" if episode else "liver")
    relaxing = LawParameters(relaxing_share=0.4 if episode == 2 else 0.0)
    cut = lead(specimen, *MOTIONS[name](rng), parameters=relaxing)
    check_account(cut)
    check_fracture(cut)


def leap(law: Any = None) -> LedCut:
    """From the clamp by 10 cm in one update, the crack growing stably by some of them."""
    specimen, path = Specimen.draw(generator(13, 1), specimen_class="vascular"), np.full(2, 0.1)
    return lead(specimen, path) if law is None else lead_by(law, specimen, path)


def test_a_leap_that_is_not_divided_fails_the_check_of_fracture():
    check_fracture(leap())
    with pytest.raises(AssertionError):
        check_fracture(leap(changed_law(("leaps += 1 if da > LONGEST_ADVANCE else 0", "leaps += 0"))))


def test_a_leap_whose_parts_are_not_paid_fails_the_check_of_the_account():
    check_account(lead(homogeneous(), np.full(2, 0.1)))
    law = changed_law(("        work += cutting_work\n        fracture += spent\n", "        work += cutting_work\n"))
    with pytest.raises(AssertionError):
        check_account(lead_by(law, homogeneous(), np.full(2, 0.1)))
