"""``calibrate``: order and names of records do not matter; layers are replaced where records have depth."""

from __future__ import annotations

import dataclasses
import functools
import json
import math
from typing import Any

import numpy as np
import pytest
from recorded_cut import recorded_cut
from virtual_session import MODEL, traces

from cutenv.commands import cli
from cutenv.envs.depth_cut import DepthCutEnv
from cutenv.records import save
from cutenv.records.measurement import calibrate, estimate_fracture_resistance, measure_cut, measure_cuts
from cutenv.records.measurement.measured_cut import named
from cutenv.sim.plant import DescendingPlant, Leg, SimulatedPlant, run, to_trace
from cutenv.sim.tissue import Layers, Specimen, TissueDescription, load_description, measured_liver
from cutenv.sim.trace import Trace
from scripts.validation.measurement.stepped_cuts import DEPTHS, stepped_cut


def few() -> list[Trace]:
    """One liver: both angles, three speeds."""
    return traces()[:6]


@functools.cache
def tissue_of_few() -> TissueDescription:
    """What the six tell."""
    return calibrate(few(), resamples=0)


def changed(trace: Trace, **fields: Any) -> Trace:
    return dataclasses.replace(trace, **fields)


def called(trace: Trace, **facts: Any) -> Trace:
    """The same record with other metadata."""
    return changed(trace, metadata={name: value for name, value in facts.items() if value is not None})


def test_the_order_of_the_records_does_not_matter() -> None:
    records = traces()
    order = np.random.default_rng(1).permutation(len(records))
    plain, mixed = (calibrate(each, resamples=0) for each in (records, [records[i] for i in order]))
    for field in dataclasses.fields(plain):
        if isinstance(value := getattr(plain, field.name), float):
            assert getattr(mixed, field.name) == pytest.approx(value, rel=1e-3), field.name


def test_the_fields_of_a_record_that_nobody_asked_for_do_not_matter() -> None:
    bare = [changed(trace, speed=None) for trace in few()]
    assert calibrate(bare, resamples=0) == tissue_of_few()


def test_a_step_by_step_calibration_is_watched_record_by_record() -> None:
    seen: list[str] = []

    def watch(records: Any) -> Any:
        for label, trace in records:
            seen.append(label)
            yield label, trace

    calibrate(few(), resamples=0, progress=watch)
    assert seen == [f"cut {n}" for n in range(1, 7)]


def test_the_tissue_has_the_name_that_it_was_given() -> None:
    assert calibrate(few(), resamples=0, name="my liver").name == "my liver"


def test_records_are_called_by_their_names_and_others_by_their_numbers() -> None:
    (trace, *_) = few()
    records = [called(trace, name=name) for name in ("a", None, "b", "a", "")]
    assert [name for name, _ in named(records)] == ["a (0)", "trace 1", "b", "a (3)", "trace 4"]


def test_a_number_in_brackets_that_is_taken_is_not_given_twice() -> None:
    (trace, *_) = few()
    names = [
        name for name, _ in named([called(trace, name=name) for name in ("a", "a", "a (1)", "trace 5", None, None)])
    ]
    assert len(set(names)) == len(names)


BAD: list[tuple[str, dict[str, Any] | None, str]] = [
    ("no newtons", {"force_unit": "1"}, "needs force in newtons"),
    ("no position", {"position": None}, "needs position"),
    ("no angle", {"angle": None}, "needs angle"),
    ("no depth", {"depth": None}, "needs depth"),
    ("nothing but friction", None, "none of its 0 loading segments is steady|no return stroke"),
]


@pytest.mark.parametrize(("what", "fields", "reason"), BAD, ids=[each[0] for each in BAD])
def test_a_record_that_cannot_be_measured_is_left_out_and_listed(
    what: str, fields: dict[str, Any] | None, reason: str
) -> None:
    good = few()
    bad = called(good[0], name=what)
    if fields is None:
        forward = bad.select(slice(int(np.argmax(bad.position)) + 1))
        bad = changed(forward, force=np.full(len(forward), 0.5))
    else:
        bad = changed(bad, **fields)
    tissue = calibrate([*good, bad], resamples=0)
    assert tissue == tissue_of_few()
    assert tissue.calibration is not None
    (note,) = [note for note in tissue.calibration.notes if note.startswith("left out")]
    assert note.startswith(f"left out: {what}: ")
    assert any(part in note for part in reason.split("|"))


@pytest.mark.parametrize(
    ("angle_deg", "taken"), [(45.0, True), (90.0, True), (44.0, False), (30.0, False), (120.0, False)]
)
def test_an_angle_outside_of_45_to_90_degrees_is_refused_with_the_cure(angle_deg: float, taken: bool) -> None:
    good = few()
    turned = called(changed(good[0], angle=np.full(len(good[0]), math.radians(angle_deg))), name="turned")
    _, refused = measure_cuts([*good, turned], MODEL)
    assert [each.name for each in refused] == ([] if taken else ["turned"])
    for each in refused:
        assert f"is at {angle_deg:.0f} degrees" in each.reason
        assert "180 minus the angle" in each.reason


def test_a_cut_whose_crack_hardly_ran_is_left_out_of_the_means() -> None:
    """Tissue that the blade drags along and hardly cuts shows a resistance of -30 or -473 J/m2."""
    made = []
    for number in (2, 4):
        plant = SimulatedPlant(Specimen.draw(np.random.default_rng((10, number))), seed=10, episode=number)
        speed = (0.004, 0.0127, 0.0254)[number % 3]
        legs = [Leg(position=0.1, speed=speed), Leg(position=0.0, speed=0.0254)]
        made.append(to_trace(plant, run(plant, legs), name=f"cut {number}"))
    assert estimate_fracture_resistance(made[0]).corrected < 0.0
    assert any("hardly ran" in flag for flag in estimate_fracture_resistance(made[0]).flags)
    cuts, refused = measure_cuts(made, MODEL)
    assert ([cut.name for cut in cuts], [each.name for each in refused]) == (["cut 4"], ["cut 2"])
    assert "hardly ran" in refused[0].reason


def test_if_every_record_is_refused_all_reasons_are_told() -> None:
    bad = [changed(few()[0], depth=None), changed(few()[1], position=None)]
    with pytest.raises(ValueError, match=r"no record can be measured:\n  cut 1: .*depth.*\n  cut 2: .*position"):
        calibrate(bad)


def test_no_record_at_all_is_said() -> None:
    with pytest.raises(ValueError, match=r"no record can be measured:\n  there is no record"):
        calibrate([])


@pytest.mark.parametrize(
    ("share", "why"),
    [
        (0.1, r"modulus at 45 degrees falls to -\d+ Pa towards standstill.* Add cuts"),
        (0.05, r"6 cuts together give no tissue: fracture_between_cut_cv = .* outside 0 to 2.* Leave out"),
    ],
)
def test_cuts_that_do_not_go_together_are_refused_with_the_cure(share: float, why: str) -> None:
    """Flat cuts at the slowest speed with a small share of their force."""
    slowest = min(trace.speed.max() for trace in few())
    records = [
        changed(trace, force=share * trace.force)
        if trace.angle.max() < math.radians(60.0) and trace.speed.max() < 1.05 * slowest
        else trace
        for trace in few()
    ]
    with pytest.raises(ValueError, match=why):
        calibrate(records, resamples=0)


def test_cuts_that_show_no_modulus_are_no_tissue() -> None:
    short = recorded_cut("2 cm", speed=0.0254, turns=(0.008, 0.0)).trace
    with pytest.raises(ValueError, match="none of 1 cuts has a steady loading segment"):
        calibrate([short])


def test_a_cut_measured_by_itself_is_called_trace() -> None:
    assert measure_cut(few()[0], MODEL).name == "trace"


PUT_IN = Layers(boundary=0.010, deep_toughness=3.0, deep_modulus=2.0)


@pytest.fixture(scope="module")
def records():
    """Four cuts in steps of depth, of livers with the thesis's bulge."""
    liver = Specimen.mean(measured_liver())
    return [
        stepped_cut(
            liver, PUT_IN, depths=DEPTHS if n % 2 else DEPTHS[::-1], seed=n,
            name=f"cut {n}", specimen=f"liver {n}", end="finished",
        )[0]
        for n in range(4)
    ]  # fmt: skip


@pytest.fixture(scope="module")
def tissue(records):
    return calibrate(records, boundary=0.010, resamples=20)


def test_layers_are_measured_with_intervals_and_the_tissue_is_that_between_them(tissue):
    told = {each.name: each for each in tissue.calibration.evidence}
    for name in ("deep_toughness", "deep_modulus"):
        assert told[f"layers.{name}"].provenance == "measured"
        assert told[f"layers.{name}"].low <= getattr(PUT_IN, name) <= told[f"layers.{name}"].high
    assert told["layers.boundary"].provenance == "choice"
    assert told["layers.capsule_toughness"].provenance == "assumed"
    assert tissue.layers.capsule_toughness == 1.0
    liver = measured_liver()
    assert tissue.fracture_resistance == pytest.approx(liver.fracture_resistance, rel=0.08)
    assert tissue.friction_share == pytest.approx(liver.friction_share, abs=0.02)
    assert tissue.crown_depth == pytest.approx(liver.crown_depth, rel=0.02)  # of the slab, not of the steps
    assert "eta90" in tissue.calibration.not_measured


def test_a_tissue_with_layers_is_read_as_written_and_one_without_has_no_word_of_them(tissue):
    again = TissueDescription.from_json(tissue.to_json())
    assert again == tissue
    assert again.layers == tissue.layers
    assert again.calibration == tissue.calibration
    assert "layers" not in json.loads(measured_liver().to_json())
    content = json.loads(tissue.to_json())
    content["layers"] = {"boundary": 0.01}
    with pytest.raises(ValueError, match="must have capsule_thickness"):
        TissueDescription.from_json(json.dumps(content))


def test_a_plant_has_the_layers_of_its_tissue(tissue):
    specimen = Specimen.mean(tissue)
    assert DescendingPlant(specimen).descents["deep_toughness"][0] == tissue.layers.deep_toughness
    assert DescendingPlant(specimen, layers=Layers()).descents["deep_toughness"][0] == 1.0


def test_the_task_draws_where_the_layer_is_and_takes_what_was_measured(tissue, tmp_path):
    path = tmp_path / "tissue.json"
    path.write_text(tissue.to_json())
    env = DepthCutEnv(tissue=path)
    places = []
    for episode in range(3):
        env.reset(seed=1, options={"episode": episode})
        record = env.cutting.motion[0]
        assert record["deep_toughness"] == tissue.layers.deep_toughness
        assert record["deep_modulus"] == tissue.layers.deep_modulus
        places.append(float(record["boundary"]))
    assert len(set(places)) == 3
    plain = DepthCutEnv()
    drawn = []
    for episode in range(3):
        plain.reset(seed=1, options={"episode": episode})
        drawn.append(float(plain.cutting.motion["deep_toughness"][0]))
    assert len(set(drawn)) == 3


def test_the_command_prints_layers_and_refuses_a_thickness_that_is_none(records, tmp_path, capsys):
    paths = [tmp_path / f"{n}.csv" for n in range(len(records))]
    for trace, path in zip(records, paths, strict=True):
        save(trace, path)
    out = tmp_path / "tissue.json"
    options = ["calibrate", *map(str, paths), "--out", str(out), "--resamples", "5", "--layer-depth"]
    assert cli.main([*options, "19mm"]) == 0
    said = capsys.readouterr().out
    assert "layers.deep_toughness" in said
    assert "sections open the layer at 19 mm; the deepest goes down to 1" in said
    assert load_description(out).layers == Layers(boundary=0.019)
    assert cli.main([*options, "12"]) == 2
    assert "no length with a unit" in capsys.readouterr().err
    assert cli.main([*options, "12mm", "--capsule-thickness", "12mm"]) == 2
    assert "--capsule-thickness" in capsys.readouterr().err
