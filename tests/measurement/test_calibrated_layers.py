"""``cutenv calibrate`` replaces the assumed layers from records with depth, and the tasks along a depth use them."""

from __future__ import annotations

import json

import pytest
from stepped_cuts import DEPTHS, stepped_cut

from cutenv import cli
from cutenv.envs.depth_cut import DepthCutEnv
from cutenv.measurement import calibrate
from cutenv.plant import DescendingPlant
from cutenv.recording import save
from cutenv.tissue import Layers, Specimen, TissueDescription, load_description, measured_liver

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
