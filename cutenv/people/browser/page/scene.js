// The scene of a cut as Python describes it (cutenv.display.viewer.scene_parts): formulas, places in metres, labels.

const WAYS = {
  "+": (a, b) => a + b, "-": (a, b) => a - b, "*": (a, b) => a * b, "/": (a, b) => a / b,
  clip: (value, low, high) => Math.min(Math.max(value, low), high),
};
for (const name of ["abs", "acos", "atan2", "cos", "max", "min", "sin", "sqrt", "tan"]) WAYS[name] = Math[name];

// The function of named values that a tree is; functions that are no formula's own are values, too.
function formula(tree) {
  if (typeof tree === "number") return () => tree;
  if (typeof tree === "string") return values => values[tree];
  const [name, ...given] = tree, [a, b, c] = given.map(formula), way = WAYS[name];
  if (!way) return values => values[name](a(values));
  return [values => way(a(values)), values => way(a(values), b(values)),
    values => way(a(values), b(values), c(values))][given.length - 1];
}

class Scene {
  constructor(told) {
    this.told = told;
    const { scene, slab } = told;
    this.quantities = scene.quantities.map(([name, tree]) => [name, formula(tree)]);
    this.numbers = Object.entries(scene.numbers).map(([name, [tree, digits]]) => [name, formula(tree), digits]);
    this.parts = scene.parts.map(part => ({ ...part, place: part.place.map(formula) }));
    this.tint = scene.tint.map(([role, tree]) => [role, formula(tree)]);
    this.halfGap = formula(scene.half_gap);
    this.openedAside = formula(scene.opened_aside);
    [this.sides, this.across, this.along] = slab.shape;
    this.rest = new Float64Array(bytesOf(slab.rest).buffer);
    this.fields = singlesOf(slab.fields);
    this.lines = [0, 1].map(side => Array.from({ length: this.across }, (_, i) => this.rest[this.at(side, i, 0)]));
    this.columns = Array.from({ length: this.along }, (_, j) => this.rest[this.at(0, 0, j) + 1]);
  }

  at(side, i, j) { return 2 * ((side * this.across + i) * this.along + j); }

  // Quantities of a moment by name, with those that the scene derives.
  values(cut, { low, high }) {
    const values = {
      blade: cut.blade, tip: cut.tip, angle: cut.angle, hand: cut.hand, target: cut.target, force: cut.last("force"),
      half_width: 0.5 * this.told.slab.width, chart_low: low, chart_high: high,
      force_limit_per_depth: cut.limitPerDepth, force_allowed_per_depth: this.told.force_allowed_per_depth,
      depth_at: along => cut.depthAt(cut.depth, along), limited_at: along => cut.depthAt(cut.depth, along),
      level: 0, bottom: 0, floor_at: () => 0, ...this.heights(cut),
    };
    for (const [name, each] of this.quantities) values[name] = each(values);
    return values;
  }

  // Quantities of a cut whose depth is wanted.
  heights(cut) {
    if (!cut.deep) return {};
    const { surface, wanted, layer, floor, level } = cut.deep;
    const heights = { depth_at: surface, limited_at: surface.map((height, i) => height - wanted[i]), floor_at: floor, wanted_at: wanted, layer_at: layer };
    const along = Object.entries(heights).map(([name, each]) => [name, place => cut.depthAt(each, place)]);
    return { level, bottom: -this.told.scene.below, ...Object.fromEntries(along) };
  }

  // Displacement of the lattice for the tip and lag of the moment: the finite-element field between two tips.
  displacement({ tip, lag }) {
    const size = 2 * this.sides * this.across * this.along, last = this.told.slab.tips - 1;
    const s = Math.min(Math.max(tip / this.told.length * last, 0), last - 1e-9), k = Math.floor(s), share = s - k;
    return Float64Array.from({ length: size }, (_, i) =>
      lag * ((1 - share) * this.fields[size * k + i] + share * this.fields[size * (k + 1) + i]));
  }

  // Where a place of the tissue at rest is drawn: displaced, and the cut open; and the size of its displacement.
  carried(values, moved, side, x, y) {
    const right = side > 0 ? 1 : 0, lines = this.lines[right], { columns } = this;
    const i = interval(lines, x), j = interval(columns, y);
    const s = (x - lines[i]) / (lines[i + 1] - lines[i]), t = (y - columns[j]) / (columns[j + 1] - columns[j]);
    const [a, b, c, d] = [this.at(right, i, j), this.at(right, i + 1, j), this.at(right, i, j + 1), this.at(right, i + 1, j + 1)];
    const mean = k => (1 - t) * ((1 - s) * moved[a + k] + s * moved[b + k]) + t * ((1 - s) * moved[c + k] + s * moved[d + k]);
    const dx = mean(0), dy = mean(1);
    values.across = x;
    values.along = y;
    return { place: [x + dx + side * this.halfGap(values) * this.openedAside(values), y + dy], size: Math.hypot(dx, dy) };
  }

  // Places of a part [m], in the chart [m, N].
  places(part, values, moved) {
    const [first, second] = part.place, own = { ...values };
    return part.rows.map(row => {
      part.own.forEach((name, k) => { own[name] = row[k]; });
      const place = [first(own), second(own)];
      return part.carried ? this.carried(own, moved, row[0], ...place).place : place;
    });
  }

  label(words, values) {
    return say(words, Object.fromEntries(this.numbers.map(([name, each, digits]) => [name, fixed(each(values), digits)])));
  }
}

// Number of the interval between ascending lines in which a place is.
function interval(lines, place) {
  let k = 0;
  while (k < lines.length - 2 && place >= lines[k + 1]) k += 1;
  return k;
}
