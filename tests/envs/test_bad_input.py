"""Every public function refuses NaN, what is out of range and what looks like another unit, and says what to do."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from cutenv.agents import policy
from cutenv.agents.policy import (
    ConstantFeed,
    FastThenSlow,
    Features,
    ForceFeedback,
    InclineBetween,
    OneReturnStroke,
    PlannerNominal,
    PlannerWithTruth,
    ProbeAndCreep,
    StopAndUnload,
    TipEstimate,
    experts,
)
from cutenv.envs.constants import Constants
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.sim import plant, tissue
from cutenv.sim.cutting.drive import Hand, PDRig, Rig
from cutenv.sim.cutting.sensor import Sensor, SensorParameters
from cutenv.sim.plant import DescendingPlant, Leg, SimulatedPlant, forward_backward
from cutenv.sim.tissue import (
    CutModel,
    Layers,
    Specimen,
    TissueDescription,
    draw_liver,
    local_effective_modulus,
    measured_liver,
)
from cutenv.task.observation import in_units, to_action
from cutenv.task.reward import Limits

NAN = math.nan
DATA = (dict, tuple, str)
UPRIGHT = math.pi / 2
MODEL = CutModel()
LIVER = measured_liver()
SPECIMEN = Specimen.draw(np.random.default_rng(0))


def even(**changes: Any) -> Specimen:
    return Specimen.homogeneous(**({"modulus": 48e3, "fracture_resistance": 211.0, "depth": 0.02} | changes))


def changed(**changes: Any) -> TissueDescription:
    return dataclasses.replace(LIVER, **changes)


def simulated(**keywords: Any) -> SimulatedPlant:
    return SimulatedPlant(SPECIMEN, **keywords)


def leg(**changes: Any) -> Leg:
    return Leg(**({"position": 0.08, "speed": 0.01} | changes))


def advance(speed: float = 0.01, angle: float = UPRIGHT, ticks: Any = 20) -> Any:
    return simulated().advance(speed, angle, ticks)


# Call, name of the field, value as shown: 2.54 for cm/s, 90 for degrees, 2 for centimetres, 48.4 for kilopascals.
OUTSIDE: list[tuple[Callable[[], Any], str, str]] = [
    (lambda: MODEL.stiffness(5), "cut_length", "5 m"),
    (lambda: MODEL.stiffness([0.05, NAN]), "cut_length", "nan m"),
    (lambda: MODEL.displacement(0.05, NAN, 48e3, 0.02), "force", "nan N"),
    (lambda: MODEL.displacement(0.05, 2.0, 0.0, 0.02), "modulus", "0 Pa"),
    (lambda: MODEL.displacement(0.05, 2.0, 48e3, 2), "thickness", "2 m"),
    (lambda: MODEL.displacement(5, 2.0, 48e3, 0.02), "cut_length", "5 m"),
    (lambda: MODEL.convert_modulus(NAN, MODEL, 0.05), "modulus", "nan Pa"),
    (lambda: MODEL.convert_modulus(48e3, MODEL, 5), "cut_length", "5 m"),
    (lambda: Layers(boundary=12), "boundary", "12 m"),
    (lambda: Layers(boundary=0.001, capsule_thickness=0.002), "boundary", "0.001 m"),
    (lambda: DescendingPlant(SPECIMEN).advance(0.01, 1.5, 20, 5), "descent_speed", "5 m/s"),
    (lambda: local_effective_modulus(2.54, UPRIGHT), "speed", "2.54 m/s"),
    (lambda: even(depth=2), "depth", "2 m"),
    (lambda: even(modulus=48.4), "modulus", "48.4 Pa"),
    (lambda: even(fracture_resistance=0.211), "fracture_resistance", "0.211 J/m2"),
    (lambda: even(friction_share=20), "friction_share", "20"),
    (lambda: dataclasses.replace(SPECIMEN, depth=100 * SPECIMEN.depth), "depth", "0.1\\d* m"),
    (lambda: dataclasses.replace(SPECIMEN, modulus=NAN * SPECIMEN.modulus), "modulus", "nan Pa"),
    (lambda: dataclasses.replace(SPECIMEN, friction_per_depth=-1.0), "friction_per_depth", "-1 N/m"),
    (lambda: changed(poisson=0.5), "poisson", "0.5"),
    (lambda: changed(intercept_90=NAN), "intercept_90", "nan Pa"),
    (lambda: changed(speed_max=2.54), "speed_max", "2.54 m/s"),
    (lambda: changed(eta90=28), "eta90", "28"),
    (lambda: changed(crown_depth=2), "crown_depth", "2 m"),
    (lambda: changed(correlation_length=20), "correlation_length", "20 m"),
    (lambda: advance(speed=2.54), "speed", "2.54 m/s"),
    (lambda: advance(speed=NAN), "speed", "nan m/s"),
    (lambda: advance(angle=90), "angle", "90 rad"),
    (lambda: advance(angle=NAN), "angle", "nan rad"),
    (lambda: advance(ticks=0), "ticks", "0"),
    (lambda: advance(ticks=-5), "ticks", "-5"),
    (lambda: advance(ticks=NAN), "ticks", "nan"),
    (lambda: simulated(angle=90), "angle", "90 rad"),
    (lambda: simulated(seed=-1), "seed", "-1"),
    (lambda: simulated(episode=-1), "episode", "-1"),
    (lambda: simulated(depth=100 * SPECIMEN.depth), "depth", "\\d\\S* m"),
    (lambda: leg(position=80), "position", "80 m"),
    (lambda: leg(speed=2.54), "speed", "2.54 m/s"),
    (lambda: leg(angle=90), "angle", "90 rad"),
    (lambda: leg(dwell=-1.0), "dwell", "-1 s"),
    (lambda: forward_backward(first=2.54, speed=0.01), "position", "2.54 m"),
    (lambda: forward_backward(speed=1.27), "speed", "1.27 m/s"),
    (lambda: forward_backward(speed=0.01, angle=90), "angle", "90 rad"),
    (lambda: ConstantFeed(speed=2.54), "speed", "2.54 m/s"),
    (lambda: ConstantFeed(speed=0.01, angle=90), "angle", "90 rad"),
    (lambda: FastThenSlow(fast=2.54), "speed", "2.54 m/s"),
    (lambda: FastThenSlow(slow=NAN), "speed", "nan m/s"),
    (lambda: FastThenSlow(approach=15), "approach", "15 m"),
    (lambda: FastThenSlow(angle=45), "angle", "45 rad"),
    (lambda: InclineBetween(speed=1.9), "speed", "1.9 m/s"),
    (lambda: InclineBetween(angle=45), "angle", "45 rad"),
    (lambda: InclineBetween(start=10), "start", "10 m"),
    (lambda: InclineBetween(approach=NAN), "approach", "nan m"),
    (lambda: ForceFeedback(unloaded=0.64), "speed", "0.64 m/s"),
    (lambda: ForceFeedback(loaded=2.54), "speed", "2.54 m/s"),
    (lambda: ForceFeedback(full_load=0), "full_load", "0 N/m"),
    (lambda: ForceFeedback(angle=NAN), "angle", "nan rad"),
    (lambda: ProbeAndCreep(speed=1.9), "speed", "1.9 m/s"),
    (lambda: ProbeAndCreep(creep_angle=45), "angle", "45 rad"),
    (lambda: ProbeAndCreep(approach=3), "approach", "3 m"),
    (lambda: ProbeAndCreep(near_enough=2), "near_enough", "2 m"),
    (lambda: ProbeAndCreep(margin=NAN), "margin", "nan m"),
    (lambda: ProbeAndCreep(probes=0), "probes", "0"),
    (lambda: OneReturnStroke(stroke=2.5), "stroke", "2.5 m"),
    (lambda: OneReturnStroke(stroke_speed=1.0), "speed", "1 m/s"),
    (lambda: OneReturnStroke(held=0.5), "held", "0.5"),
    (lambda: OneReturnStroke(beyond=NAN), "beyond", "nan m"),
    (lambda: OneReturnStroke(run_share=-0.1), "run_share", "-0.1"),
    (lambda: PlannerWithTruth(rounds=-1), "rounds", "-1"),
    (lambda: PlannerNominal(rounds=NAN), "rounds", "nan"),
    (lambda: Features(history=-1), "history", "-1"),
    (lambda: Features(0), "count", "0"),
    (lambda: StopAndUnload(margin=3), "margin", "3 m"),
    (lambda: StopAndUnload(retreat_speed=0.5), "retreat_speed", "0.5 m/s"),
    (lambda: to_action(2.54, UPRIGHT), "speed", "2.54 m/s"),
    (lambda: to_action(0.01, 90), "angle", "90 rad"),
    (lambda: Constants.from_keywords({"acceleration": NAN}), "acceleration", "nan m/s2"),
    (lambda: Rig(rotation_rate=90), "rotation_rate", "90 rad/s"),
    (lambda: Rig(motor_lag=40), "motor_lag", "40 s"),
    (lambda: PDRig(drag=-1), "drag", "-1 N s/m"),
    (lambda: PDRig(proportional_gain=NAN), "proportional_gain", "nan N/m"),
    (lambda: Hand(mass=150), "mass", "150 kg"),
    (lambda: SensorParameters(force_delay=10), "force_delay", "10 s"),
    (lambda: Sensor(seed=-1), "seed", "-1"),
    (lambda: Limits(force_limit_per_depth=NAN), "force_limit_per_depth", "nan N/m"),
    (lambda: GentleCutEnv(target_length=8), "target_length", "8 m"),
    (lambda: GentleCutEnv(deadline_s=NAN), "deadline_s", "nan s"),
    (lambda: GentleCutEnv(control_hz=0.02), "control_hz", "0.02 Hz"),
    (lambda: GentleCutEnv().reset(options={"episode": -1}), "episode", "-1"),
]


@pytest.mark.parametrize(
    ("call", "field", "value"), OUTSIDE, ids=[f"{n}: {f} = {v}" for n, (_, f, v) in enumerate(OUTSIDE)]
)
def test_a_value_out_of_range_is_refused_by_field_value_range_and_cure(call, field, value):
    """A ValueError that names field, value with unit, range and cure."""
    with pytest.raises(ValueError, match=rf"^{field} = {value} is outside \S+ to \S+.*\. \S.*"):
        call()


UNLIKE: list[tuple[Callable[[], Any], type[Exception], str]] = [
    (lambda: MODEL.stiffness("5"), TypeError, "cut_length must be real numbers in m"),
    (lambda: MODEL.convert_modulus(48e3, 5, 0.05), TypeError, "to must be a CutModel"),
    (lambda: Specimen.draw(5), TypeError, "rng = 5 must be a numpy.random.Generator"),
    (lambda: draw_liver(5), TypeError, "rng = 5 must be a numpy.random.Generator"),
    (lambda: Specimen.draw(np.random.default_rng(0), specimen_class="livr"), ValueError, "Did you mean 'liver'"),
    (lambda: Specimen.draw(np.random.default_rng(0), liver_factor=NAN), ValueError, "nan"),
    (lambda: Specimen.from_json("{}"), ValueError, "expected a JSON object with schema 'cutenv-specimen/2'"),
    (lambda: Specimen.from_json(LIVER.to_json()), ValueError, "cutenv-specimen/2.*found 'cutenv-tissue/2'"),
    (lambda: TissueDescription.from_json("x"), ValueError, "not JSON"),
    (
        lambda: dataclasses.replace(SPECIMEN, depth=SPECIMEN.depth[:10]),
        ValueError,
        r"depth has shape \(10,\); give 301",
    ),
    (lambda: changed(element="quad"), ValueError, "element must be .*Did you mean 'quad8'"),
    (lambda: changed(formulation="plane-stress"), ValueError, "formulation must be .*Did you mean 'plane_stress'"),
    (lambda: changed(slope_90=-11.6e6), ValueError, "must stay positive up to speed_max"),
    (lambda: changed(speed_min=0.1, speed_max=0.02), ValueError, "speed_min = 0.1 m/s must be below speed_max"),
    (lambda: advance(ticks=2.5), ValueError, "ticks = 2.5 is not a whole number"),
    (lambda: simulated(depth=0.02), ValueError, r"depth has shape \(\); give 301 values"),
    (lambda: plant.run(simulated(), []), ValueError, "give at least one Leg"),
    (lambda: in_units([1.0, 2.0]), ValueError, r"observation has shape \(2,\); its last axis must hold 12"),
    (lambda: in_units(np.full(12, NAN)), ValueError, "observation = .*nan.* must be finite"),
    (lambda: TipEstimate()(np.full(12, NAN)), ValueError, "observation = .*nan.* must be finite"),
    (lambda: ConstantFeed(speed=0.01)(np.full(12, NAN)), ValueError, "observation = .*nan.* must be finite"),
    (lambda: FastThenSlow()(np.zeros(11)), ValueError, "observation has shape"),
    (lambda: Features()(np.full(12, NAN)), ValueError, "observation = .*nan.* must be finite"),
    (lambda: Features(history=2.5), ValueError, "history = 2.5 is not a whole number"),
    (lambda: Features(1.5), ValueError, "count = 1.5 is not a whole number"),
    (lambda: Features(2, force="no"), TypeError, "force = 'no' must be True"),
    (lambda: Features(2)(np.zeros((3, 12))), ValueError, r"observations have shape \(3, 12\); give \(2, 12\)"),
    (lambda: Features(1)(np.full((1, 12), NAN)), ValueError, "observation = .*nan.* must be finite"),
    (lambda: experts("paths"), ValueError, "task must be .*Did you mean 'path'"),
    (lambda: GentleCutEnv(tissue=5), TypeError, "tissue = 5 must be the path"),
    (lambda: GentleCutEnv().reset(options={"specimen": 5}), TypeError, "specimen must be a cutenv.sim.tissue.Specimen"),
    (lambda: GentleCutEnv().reset(options={"episode": 1.5}), ValueError, "episode = 1.5 is not a whole number"),
]


@pytest.mark.parametrize(("call", "error", "message"), UNLIKE, ids=[f"{n}: {m}" for n, (_, _, m) in enumerate(UNLIKE)])
def test_a_wrong_kind_of_argument_is_refused_in_words(call, error, message):
    with pytest.raises(error, match=message):
        call()


def test_every_public_function_that_takes_an_argument_is_in_the_tables():
    here = {name for call, *_ in [*OUTSIDE, *UNLIKE] for name in call.__code__.co_names}
    helpers = (even, changed, simulated, leg, advance)
    here |= {name for helper in helpers for name in helper.__code__.co_names}
    takes_none = {"measured_fracture_resistance", "measured_liver", "quasi_static_modulus", "NoAction", "RandomAction"}
    interfaces = {"ArrayPolicy", "Plant", "Policy", "PrivilegedPolicy", "Script"}
    in_their_own_tests = {
        "PathModel",
        "SteeredModel",
        "SteeredPlant",
        "FreehandPlant",
        "Network",
        "RecurrentNetwork",
        "PolicyCard",
        "TrainedPolicy",
        "save_policy",
        "feed_name",
        "ReplayPlant",
        "shipped",
        "named_policy",
        "gentle_policy",
    }
    through_others = {"load_description", "to_trace"}  # a file read by from_json; readings of a plant
    public = {
        name for room in (tissue, plant, policy) for name in room.__all__ if not isinstance(getattr(room, name), DATA)
    }
    apart = takes_none | interfaces | in_their_own_tests | through_others | {"TissueDescription", "CutModel"}
    assert public - here <= apart


def test_a_dead_time_in_which_no_command_would_act_is_refused():
    with pytest.raises(ValueError, match=r"dead_time = 0\.01 s is not below the 10 ms between decisions.*control_hz"):
        GentleCutEnv(dead_time=0.01, control_hz=100)
    GentleCutEnv(dead_time=0.01, control_hz=50)
