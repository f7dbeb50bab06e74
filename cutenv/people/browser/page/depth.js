// Depth of a cut along a wanted one: heights above the plane to which a blade at level 0 cuts [m], and what is made of them.

class CutDepth {
  constructor(law, specimen, points) {
    Object.assign(this, { law, points, given: specimen.facts });
    this.surface = law.numbers("cut", "motions.surface", points);
    this.wantedDepth = law.numbers("episode", "wholes.wanted", points);
    this.boundary = law.number("cut", "motions.boundary");
    this.wanted = this.surface.map((height, i) => height - this.wantedDepth[i]);
    this.layer = this.surface.map(height => height - this.boundary);
  }

  get level() { return this.law.number("cut", "motions.level"); }
  get floor() { return this.law.numbers("cut", "motions.floor", this.points); } // where nothing is cut, the surface

  get opened() { return Math.max(this.law.number("episode", "wholes.deepest"), 0); } // depth into the layer below

  beyond(limits) { return this.opened > limits.layer_limit; }

  // Errors as the task counts them, [mm2] and [mm]; rounding may leave -1e-20.
  errors(target) {
    const sum = name => Math.max(this.law.number("episode", `wholes.${name}`), 0);
    return {
      too_deep_mm2: 1e6 * sum("deep"), uncut_mm2: 1e6 * sum("uncut"), layer_mm2: 1e6 * sum("layer"),
      layer_mm: 1e3 * this.opened, mean_error_mm: 1e3 * (sum("deep") + sum("uncut")) / target,
    };
  }

  // What the record notes, as cutenv.task.depth.DepthEpisode.noted_depth.
  noted(target) {
    const cell = this.law.whole("cut", "motions.cell"), { floor } = this;
    const errors = Object.entries(this.errors(target)).map(([name, value]) => [name, Math.round(1e3 * value) / 1e3]);
    const below = Array.from({ length: cell + 1 }, (_, i) => Math.round(1e6 * Math.max(this.surface[i] - floor[i], 0)) / 1e6);
    return { environment: "cutenv/DepthCut-v1", ...Object.fromEntries(errors), ...this.given, floor_end_m: below };
  }

  // Costs of the depth since the start, which the return holds beside those of gentle cutting.
  get costs() {
    return this.law.terms.reduce((sum, name) => sum + this.law.number("episode", `wholes.total_${name}`), 0);
  }
}
