// Draws the scene of a cut on a canvas: from above, from the side, and the force over the blade's position.

const FINER = 3; // cells drawn for one element, each way
const OVERLAP = 1; // px, so that nothing shines through between cells
const SIDE_HEIGHT = 0.063; // m of the view from the side

class Drawing {
  constructor(canvas, told) {
    this.canvas = canvas;
    this.pen = canvas.getContext("2d");
    this.told = told;
    this.scene = new Scene(told);
    this.begin(null);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.readColours());
    this.readColours();
  }

  begin(cut) {
    this.drawnCut = cut;
    this.drawn = 0;
    this.path = [];
    this.plan = cut?.path ? new Plan(this, cut) : null;
    this.standing = new Map(); // places that stay during a cut
    this.range = { low: this.told.scene.chart.low, high: this.told.scene.chart.high };
  }

  readColours() {
    const dark = matchMedia("(prefers-color-scheme: dark)").matches && !document.documentElement.classList.contains("printed");
    const { colours, shades } = this.told.scene;
    this.colours = colours[dark ? "dark" : "light"];
    this.colour = Object.fromEntries(Object.entries(this.colours).map(([role, colour]) => [role, rgb(colour)]));
    this.shades = shades[dark ? "dark" : "light"].map(rgb);
  }

  // What a picture depends on beside the cut.
  looks() { return [this.canvas.clientWidth, devicePixelRatio, this.colour.ink, this.lies]; }

  // On a telephone that lies the chart stands beside the scene, so that both are in view.
  get lies() { return innerHeight < 480 && innerWidth > innerHeight; }

  // Fit the canvas to its box; lengths are in CSS pixels from here on.
  fit(deep) {
    const ratio = devicePixelRatio || 1, width = this.canvas.clientWidth, margin = width < 560 ? 26 : 44;
    const { lies } = this, sceneWidth = lies ? 0.5 * width : width;
    this.left = margin;
    this.scale = (sceneWidth - margin - 12) / this.told.length;
    const half = 0.5 * this.told.slab.width * this.scale;
    this.line = 36 + half;
    this.sideTop = this.line + half + 28;
    this.level = this.sideTop + SIDE_HEIGHT * this.scale; // of a blade at level 0
    this.ground = this.level + (deep ? this.told.scene.below * this.scale : 0);
    [this.chartLeft, this.chartScale] = [width - sceneWidth + margin, this.scale];
    this.chartTop = lies ? 36 : this.ground + 50;
    this.chartBottom = lies ? this.ground : this.chartTop + (width < 560 ? 90 : 110);
    const height = lies ? this.ground + 34 : this.chartBottom + 12;
    this.canvas.style.height = `${height}px`;
    const wanted = [Math.round(width * ratio), Math.round(height * ratio)];
    if (this.canvas.width !== wanted[0] || this.canvas.height !== wanted[1]) [this.canvas.width, this.canvas.height] = wanted;
    this.pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.pen.clearRect(0, 0, width, height);
    this.pen.font = `${width < 560 ? 12 : 13}px system-ui, sans-serif`;
    this.pen.lineJoin = "round";
    this.box = { above: [0, 0, width, height], side: [0, this.sideTop, sceneWidth, this.ground + 1 - this.sideTop],
      chart: [this.chartLeft, this.chartTop, width, this.chartBottom - this.chartTop] };
  }

  pixels(view, [first, second]) {
    if (view === "above") return [this.left + this.scale * second, this.line + this.scale * first];
    if (view === "side") return [this.left + this.scale * first, this.level - this.scale * second];
    const { low, high } = this.range, share = (second - low) / (high - low);
    return [this.chartLeft + this.chartScale * first, this.chartBottom - (this.chartBottom - this.chartTop) * share];
  }

  trace(lines, close = false) {
    this.pen.beginPath();
    for (const points of lines) {
      points.forEach(([x, y], i) => i ? this.pen.lineTo(x, y) : this.pen.moveTo(x, y));
      if (close) this.pen.lineTo(...points[0]); // closePath takes the longer, the more outlines the path has
    }
  }
  areas(outlines, fill, edge) {
    this.trace(outlines, true);
    this.pen.fillStyle = fill;
    this.pen.fill();
    if (edge) { this.pen.strokeStyle = edge; this.pen.lineWidth = 1; this.pen.stroke(); }
  }
  strokes(lines, colour, width = 1, dash = []) {
    this.trace(lines);
    this.pen.strokeStyle = colour;
    this.pen.lineWidth = width;
    this.pen.setLineDash(dash);
    this.pen.stroke();
    this.pen.setLineDash([]);
  }
  words(text, x, y, { colour = this.colour.quiet, align = "left" } = {}) {
    this.pen.fillStyle = colour;
    this.pen.textAlign = align;
    this.pen.fillText(text, x, y);
  }
  clipped(view, draw) {
    this.pen.save();
    this.pen.beginPath();
    this.pen.rect(...this.box[view]);
    this.pen.clip();
    draw();
    this.pen.restore();
  }

  // `beside` is the way of an expert, and the time of the replay [s].
  draw(cut, { texts, showTip, seen, beside }) {
    this.fit(cut.deep);
    this.keepUp(cut);
    const { scene } = this, values = scene.values(cut, this.range), moved = scene.displacement(values);
    const shown = { "": true, truth: showTip, hand: true, force: seen.force,
      depth: cut.deep, layer: cut.deep && showTip };
    this.colour.tint = seen.force ? this.tint(values) : this.colour.steel;
    if (this.plan) this.plan.draw({ target: scene.label(texts.target, values), tip: texts.tip }, showTip);
    else this.drawTissue(values, moved);
    this.drawChart(texts, values, seen);
    for (const part of scene.parts) {
      if (!shown[part.shown] || (this.plan && part.view === "above")) continue;
      const places = this.standing.get(part) ?? scene.places(part, values, moved);
      if (part.standing) this.standing.set(part, places);
      this.clipped(part.view, () => this.drawPart(part, places, texts, values));
    }
    beside?.way.draw(this, cut, values, beside.time, showTip);
    if (seen.force) this.markStop(cut, texts);
    this.drawRuler();
    this.hatch(this.line - this.scale * values.half_width, this.line + this.scale * values.half_width);
    this.hatch(this.level - this.scale * this.told.scene.clamp.height, this.ground);
    const above = this.plan ? showTip ? texts.above_path_truth : texts.above_path : texts.above;
    if (this.lies) return; // there is no room for both
    this.words(scene.label(above, values), this.left, 14);
    this.words(scene.label(texts.side, values), this.left, this.sideTop - 8);
  }

  // Where a limit has ended the cut: a cross in the chart, and words.
  markStop(cut, texts) {
    if (["", "finished", "given up"].includes(cut.end)) return;
    const [x, y] = this.pixels("chart", [cut.blade, cut.last("force")]), colour = this.colour.limit;
    this.strokes([[[x - 7, y - 7], [x + 7, y + 7]], [[x - 7, y + 7], [x + 7, y - 7]]], colour, 3);
    const align = x > 0.6 * this.canvas.clientWidth ? "right" : "left", low = Math.min(Math.max(y, this.chartTop + 14), this.chartBottom - 4);
    this.words(texts.stopped_here, align === "left" ? x + 11 : x - 11, low, { colour: this.colour.ink, align });
  }

  drawPart(part, places, texts, values) {
    const points = places.map(place => this.pixels(part.view, place)), { pen, colour } = this;
    if (part.words) {
      const [x, y] = points[0], half = pen.measureText(this.scene.label(texts[part.words], values)).width / 2;
      const centred = Math.max(Math.min(x, this.canvas.clientWidth - half), half);
      this.words(this.scene.label(texts[part.words], values), part.align === "left" ? x : centred,
        part.align === "left" ? y + 4 : y - 5, { colour: colour[part.line], align: part.align });
      return;
    }
    const outlines = part.mark.length ? points.map(([x, y]) => part.mark.map(([a, b]) => [x + a, y + b])) : [points];
    pen.globalAlpha = part.opacity;
    if (part.fill) this.areas(outlines, colour[part.fill], colour[part.line]);
    else this.strokes(outlines, colour[part.line], part.width, part.dash ? [part.dash, part.dash] : []);
    pen.globalAlpha = 1;
  }

  // The blade's colour, mixed between those of the forces on either side.
  tint(values) {
    const force = Math.abs(values.force), stops = this.scene.tint.map(([role, each]) => [this.colours[role], each(values)]);
    const k = Math.max(stops.findLastIndex(([, least]) => force >= least), 0), [low, from] = stops[k];
    const [high, to] = stops[Math.min(k + 1, stops.length - 1)], share = to > from ? (force - from) / (to - from) : 0;
    return rgb(low.map((value, channel) => Math.round(value + share * (high[channel] - value))));
  }

  drawTissue(values, moved) {
    const { scene } = this, cells = this.shades.map(() => []), mesh = [], grounds = [];
    const finely = lines => Array.from({ length: FINER * (lines.length - 1) + 1 }, (_, n) => {
      const k = Math.min(Math.floor(n / FINER), lines.length - 2);
      return lines[k] + (n / FINER - k) * (lines[k + 1] - lines[k]);
    });
    const columns = finely(scene.columns);
    for (const side of [-1, 1]) {
      const lattice = finely(scene.lines[side > 0 ? 1 : 0]).map(x => columns.map(y => {
        const { place, size } = scene.carried(values, moved, side, x, y);
        return { point: this.pixels("above", place), size };
      }));
      const rows = lattice.length - 1, last = columns.length - 1;
      for (let i = 0; i < rows; i++) {
        for (let j = 0; j < last; j++) {
          const corners = [lattice[i][j], lattice[i + 1][j], lattice[i + 1][j + 1], lattice[i][j + 1]];
          const share = corners.reduce((sum, corner) => sum + corner.size, 0) / 4 / this.told.scene.largest_displacement;
          cells[Math.min(Math.floor(share * cells.length), cells.length - 1)].push(corners.map(({ point: [x, y] }, k) =>
            [x + (k > 1 ? OVERLAP : 0), y + (k === 1 || k === 2 ? OVERLAP : 0)]));
        }
      }
      for (let i = 0; i <= rows; i += FINER) mesh.push(lattice[i].map(each => each.point));
      for (let j = 0; j <= last; j += FINER) mesh.push(lattice.map(row => row[j].point));
      grounds.push([lattice[0], lattice.map(row => row[last]), [...lattice[rows]].reverse(), lattice.map(row => row[0]).reverse()]
        .flatMap(edge => edge.map(each => each.point)));
    }
    // Below the cells lies their commonest shade: edges of many cells, drawn at once, let a pixel here and there through.
    this.areas(grounds, this.shades[cells.reduce((best, each, n) => each.length > cells[best].length ? n : best, 0)]);
    cells.forEach((outlines, n) => { if (outlines.length) this.areas(outlines, this.shades[n]); });
    this.strokes(mesh, this.colour.mesh, 0.6);
  }

  hatch(top, bottom) {
    const { pen } = this, x = this.left - this.scale * this.told.scene.clamp.length;
    pen.save();
    this.trace([[[x, top], [this.left, top], [this.left, bottom], [x, bottom]]], true);
    pen.clip();
    const slanted = Array.from({ length: Math.ceil((bottom - top + 24) / 6) }, (_, n) => top - 12 + 6 * n);
    this.strokes(slanted.map(y => [[x, y + this.left - x], [this.left, y]]), this.colour.quiet);
    pen.restore();
    this.strokes([[[this.left, top], [this.left, bottom]]], this.colour.quiet, 1.5);
  }

  drawRuler() {
    const { step, labelled } = this.told.scene.ruler, count = Math.round(this.told.length / step);
    for (let k = 0; k <= count; k++) {
      const [x] = this.pixels("side", [k * step, 0]), long = k % labelled === 0;
      this.strokes([[[x, this.ground + 3], [x, this.ground + (long ? 10 : 7)]]], this.colour.ink);
      const align = k === count ? "right" : "center";
      if (long) this.words(k ? String(Math.round(100 * k * step)) : "0 cm", x, this.ground + 24, { colour: this.colour.ink, align });
    }
  }

  // The force as far as it was shown, thinned to what is visible.
  keepUp(cut) {
    if (cut !== this.drawnCut) this.begin(cut);
    const { position, force } = cut.columns, { samples, step, filled } = this.told.scene.chart, { range } = this;
    for (; this.drawn + samples <= cut.count; this.drawn += samples) {
      const part = force.slice(this.drawn, this.drawn + samples);
      for (const value of [Math.min(...part), Math.max(...part)]) {
        this.path.push([position[this.drawn + part.indexOf(value)], value]);
        while (value > filled * range.high) range.high += step;
        while (value < filled * range.low) range.low -= step;
      }
    }
  }

  // The ground of the chart, and the force; limits, target and the present force are parts of the scene.
  drawChart(texts, values, seen) {
    const { low, high } = this.range, end = this.told.length, place = (along, force) => this.pixels("chart", [along, force]);
    this.areas([[place(0, low), place(end, low), place(end, high), place(0, high)]], this.colour.panel);
    for (let force = 0; force <= high; force += this.told.scene.chart.step) {
      this.strokes([[place(0, force), place(end, force)]], force ? this.colour.rule : this.colour.ink);
      this.words(String(force), this.chartLeft - 5, place(0, force)[1] + 4, { colour: this.colour.ink, align: "right" });
    }
    this.clipped("chart", () => {
      if (this.path.length && seen.trace) this.strokes([this.path.map(point => place(...point))], this.colour.ink, 1.2);
    });
    this.words(this.lies ? `${texts.force} [N]` : this.scene.label(texts.chart, values), this.chartLeft, this.chartTop - 7);
  }
}

const rgb = ([red, green, blue]) => `rgb(${red}, ${green}, ${blue})`;
