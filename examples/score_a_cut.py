"""Record a cut as CSV, load it, and score it as a person's cut would be scored."""

from cutenv.records import load_one, save
from cutenv.records.scoring import ReferenceSet, score
from cutenv.sim.plant import Leg, SimulatedPlant, run, to_trace
from cutenv.sim.tissue import Specimen

plant = SimulatedPlant(Specimen.drawn(3))
legs = [
    Leg(position=0.085, speed=0.0127, dwell=0.2),  # the blade goes beyond the target: the tip lags behind
    Leg(position=0.075, speed=0.005),  # and draws back, so that nothing is left loaded
]
save([to_trace(plant, run(plant, legs))], "cut.csv")

card = score(load_one("cut.csv"), target_length=0.08, reference=ReferenceSet.shipped())
for name in ("tip_error", "peak_force", "force_drops"):
    scored = card.metrics[name]
    print(f"{name:12} {scored.value:8.4g}   better than {scored.percentile:.0f} % of the reference cuts")
print(f"overall score: {card.overall_score:.0f} of 100; faults: {[fault.kind for fault in card.faults]}")

tip = plant.states["tip"][0]  # hidden: the card estimates it from the return stroke
assert abs(card.metrics["tip_error"].value - abs(tip - 0.08)) < 0.5e-3
