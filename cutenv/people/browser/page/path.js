// Path of a cut along a drawn line: places along the slab and across it, to the left [m], and what is made of them.

class CutPath {
  constructor(law, specimen, points) {
    Object.assign(this, { law, given: specimen.facts, spacing: law.told.spacing });
    const of = name => law.numbers("cut", `motions.${name}`, points), across = of("y");
    this.places = Array.from(of("x_excess"), (excess, i) => [i * this.spacing + excess, across[i]]);
    const cosines = of("cosine");
    this.angles = Array.from(of("sine"), (sine, i) => Math.atan2(sine, cosines[i]));
  }

  number(name) { return this.law.number("cut", `motions.${name}`); }
  of(name) { return Math.max(this.law.number("episode", `wholes.${name}`), 0); } // rounding may leave -1e-20

  get blade() { return [this.law.number("cut", "states.blade") + this.number("east"), this.number("north")]; }
  get heading() { return [this.number("ahead"), this.number("across")]; }
  get aside() { return this.number("aside"); } // of the blade, to the left of the line

  // Place of the hand, in front of the blade by the spring, as cutenv.people.play.hand_model.hand_over_slab.
  get hand() {
    const hand = this.law.number("cut", "states.hand"), reach = hand - this.law.number("cut", "states.blade");
    const [ahead, across] = this.heading;
    return [hand + this.number("east") + reach * (ahead - 1), this.number("north") + reach * across];
  }

  get tip() {
    const settled = this.number("settled"), way = (this.law.number("cut", "states.tip") - settled) * this.number("stretch");
    return [settled + this.number("tip_east") + way * this.number("tip_ahead"), this.number("tip_north") + way * this.number("tip_across")];
  }

  // Distance of the cut to the left of each point of the line up to the tip, as PathEpisode.aside_to_tip.
  get cut() {
    const tip = this.law.number("cut", "states.tip"), last = Math.min(Math.floor(tip / this.spacing), this.places.length - 2);
    const passed = [...this.law.numbers("cut", "motions.cut", this.law.whole("cut", "motions.cell") + 1)];
    if (last < passed.length) return passed;
    const share = tip / this.spacing - last, settled = this.number("settled"), from = this.number("tip_aside");
    const between = value => value(last) + share * (value(last + 1) - value(last));
    const [x, y, angle] = [i => this.places[i][0], i => this.places[i][1], i => this.angles[i]].map(between);
    const [east, north] = this.tip, end = (north - y) * Math.cos(angle) - (east - x) * Math.sin(angle);
    for (let i = passed.length; i <= last; i++) passed.push(from + (end - from) * (i * this.spacing - settled) / (tip - settled));
    return passed;
  }

  // Places of the cut from the clamp to its tip.
  get cutPlaces() {
    const beside = ([x, y], angle, aside) => [x - aside * Math.sin(angle), y + aside * Math.cos(angle)];
    return [...this.cut.map((aside, i) => beside(this.places[i], this.angles[i], aside)), this.tip];
  }

  get farthest() { return this.of("farthest"); }
  beyond(limits) { return this.farthest > limits.line_limit; }

  // Errors as the task counts them, [mm2] and [mm].
  get errors() {
    const cut = Math.max(this.law.number("cut", "states.tip") - this.of("begun"), 1e-9);
    return { area_mm2: 1e6 * this.of("area"), mean_distance_mm: 1e3 * this.of("distance") / cut, largest_distance_mm: 1e3 * this.farthest };
  }

  // Mean distance over the target length, by which a success is judged.
  mean(target) { return this.of("distance") / target; }

  // What the record notes, as cutenv.task.path.PathEpisode.noted_path.
  noted() {
    const errors = Object.entries(this.errors).map(([name, value]) => [name, Math.round(1e3 * value) / 1e3]);
    const aside = this.cut.map(value => Math.round(1e6 * value) / 1e6);
    return { environment: "cutenv/PathCut-v1", ...Object.fromEntries(errors), ...this.given, aside_end_m: aside };
  }

  get costs() {
    return this.law.terms.reduce((sum, name) => sum + this.law.number("episode", `wholes.total_${name}`), 0);
  }
}
