// Draws a cut: tissue from above by the finite-element field, blade from the side, force over the blade's position.
// Numbers and shapes are those of the window's picture (cutenv.viewer.scene).

const BLADE = { length: 0.0425, chord: 0.007, thickness: 0.002, belly: 0.006 };
const OPENED = { widest: 0.0025, perLength: 0.05 }; // half the gap of the cut drawn open: illustration
const DARKEST = 0.012; // m of displacement
const FINER = 3; // cells drawn for one element, each way
const OVERLAP = 1; // px, so that nothing shines through between cells
const SHADES = 64; // of displaced tissue: cells of one shade are drawn at once
const CHART = { low: -1, high: 6, step: 2 }; // N

class Drawing {
  constructor(canvas, told) {
    this.canvas = canvas;
    this.pen = canvas.getContext("2d");
    this.told = told;
    this.rest = singlesOf(told.slab.rest);
    this.fields = singlesOf(told.slab.fields);
    this.path = [];
    this.high = CHART.high;
    this.low = CHART.low;
    this.drawn = 0;
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.readColours());
    this.readColours();
  }

  readColours() {
    const style = getComputedStyle(document.documentElement); // slow to ask, so each colour is asked for once
    this.colour = new Proxy({}, { get: (known, name) => known[name] ??= style.getPropertyValue(`--${name}`).trim() });
    const [pale, deep] = ["tissue-pale", "tissue-deep"].map(name => this.colour[name].split(/\s+/).map(Number));
    this.shades = Array.from({ length: SHADES }, (_, n) =>
      `rgb(${pale.map((value, k) => Math.round(value + n / (SHADES - 1) * (deep[k] - value))).join()})`);
  }

  // What a picture depends on beside the cut.
  looks() { return [this.canvas.clientWidth, devicePixelRatio, this.shades[0], this.colour.ink]; }

  // Fit the canvas to its box; lengths are in CSS pixels from here on.
  fit() {
    const ratio = devicePixelRatio || 1, width = this.canvas.clientWidth, margin = width < 560 ? 26 : 44;
    this.left = margin;
    this.scale = (width - margin - 12) / this.told.length;
    const half = 0.5 * this.told.slab.width * this.scale;
    this.line = 22 + half;
    this.ground = this.line + half + 40 + (BLADE.length + 0.012) * this.scale;
    this.chartTop = this.ground + 46;
    this.chartBottom = this.chartTop + (width < 560 ? 90 : 110);
    const height = this.chartBottom + 24;
    this.canvas.style.height = `${height}px`;
    const wanted = [Math.round(width * ratio), Math.round(height * ratio)];
    if (this.canvas.width !== wanted[0] || this.canvas.height !== wanted[1]) [this.canvas.width, this.canvas.height] = wanted;
    this.pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.pen.clearRect(0, 0, width, height);
    this.pen.font = `${width < 560 ? 12 : 13}px system-ui, sans-serif`;
    this.pen.lineJoin = "round";
  }

  above(across, along) { return [this.left + this.scale * along, this.line + this.scale * across]; }
  beside(along, height) { return [this.left + this.scale * along, this.ground - this.scale * height]; }
  charted(along, force) {
    const share = (force - this.low) / (this.high - this.low);
    return [this.left + this.scale * along, this.chartBottom - (this.chartBottom - this.chartTop) * share];
  }

  trace(lines, close = false) {
    this.pen.beginPath();
    for (const points of lines) {
      points.forEach(([x, y], i) => i ? this.pen.lineTo(x, y) : this.pen.moveTo(x, y));
      if (close) this.pen.lineTo(...points[0]); // closePath takes the longer, the more outlines the path has
    }
  }
  area(points, fill, edge) { this.areas([points], fill, edge); }
  areas(outlines, fill, edge) {
    this.trace(outlines, true);
    this.pen.fillStyle = fill;
    this.pen.fill();
    if (edge) { this.pen.strokeStyle = edge; this.pen.lineWidth = 1; this.pen.stroke(); }
  }
  stroke(points, colour, width = 1, dash = []) { this.strokes([points], colour, width, dash); }
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

  draw(cut, { texts, showTip, seen }) {
    this.seen = seen;
    this.fit();
    this.drawAbove(cut, texts, showTip);
    this.drawSide(cut, texts, showTip);
    this.drawChart(cut, texts);
  }

  // Displacement of the lattice for the present tip and lag, [across, along] by point.
  displaced(cut) {
    const [sides, across, along] = this.told.slab.shape, size = 2 * sides * across * along, last = this.told.slab.tips - 1;
    const s = Math.min(Math.max(cut.tip / this.told.length * last, 0), last - 1e-9), k = Math.floor(s), share = s - k, lag = cut.lag;
    const moved = new Float32Array(size);
    for (let i = 0; i < size; i++) {
      moved[i] = lag * ((1 - share) * this.fields[size * k + i] + share * this.fields[size * (k + 1) + i]);
    }
    return moved;
  }

  halfGap(along, tip) {
    if (tip <= 0) return 0;
    const t = Math.min(Math.max(along / tip, 0), 1);
    return Math.min(OPENED.widest, OPENED.perLength * tip) * 2 * Math.sqrt(t * (1 - t));
  }

  drawAbove(cut, texts, showTip) {
    const [sides, across, along] = this.told.slab.shape, half = 0.5 * this.told.slab.width;
    const moved = this.displaced(cut), { pen } = this;
    const at = (side, i, j, k) => 2 * ((side * across + i) * along + j) + k;
    const finely = (values, side, u, v, k) => {
      const i = Math.min(Math.floor(u), across - 2), j = Math.min(Math.floor(v), along - 2), s = u - i, t = v - j;
      return (1 - t) * ((1 - s) * values[at(side, i, j, k)] + s * values[at(side, i + 1, j, k)]) +
        t * ((1 - s) * values[at(side, i, j + 1, k)] + s * values[at(side, i + 1, j + 1, k)]);
    };
    const place = (side, u, v) => {
      const x = finely(this.rest, side, u, v, 0), y = finely(this.rest, side, u, v, 1);
      const dx = finely(moved, side, u, v, 0), dy = finely(moved, side, u, v, 1);
      const aside = this.halfGap(y, cut.tip) * (1 - Math.abs(x) / half) ** 2;
      return { point: this.above(x + dx + (side ? aside : -aside), y + dy), size: Math.hypot(dx, dy) };
    };
    const cells = this.shades.map(() => []), mesh = [], grounds = [];
    for (let side = 0; side < sides; side++) {
      const rows = FINER * (across - 1), columns = FINER * (along - 1);
      const lattice = Array.from({ length: rows + 1 }, (_, i) =>
        Array.from({ length: columns + 1 }, (_, j) => place(side, i / FINER, j / FINER)));
      for (let i = 0; i < rows; i++) {
        for (let j = 0; j < columns; j++) {
          const corners = [lattice[i][j], lattice[i + 1][j], lattice[i + 1][j + 1], lattice[i][j + 1]];
          const share = Math.min(corners.reduce((sum, corner) => sum + corner.size, 0) / 4 / DARKEST, 1);
          cells[Math.round(share * (SHADES - 1))].push(corners.map(({ point: [x, y] }, k) =>
            [x + (k > 1 ? OVERLAP : 0), y + (k === 1 || k === 2 ? OVERLAP : 0)]));
        }
      }
      for (let i = 0; i <= rows; i += FINER) mesh.push(lattice[i].map(each => each.point));
      for (let j = 0; j <= columns; j += FINER) mesh.push(lattice.map(row => row[j].point));
      grounds.push([lattice[0], lattice.map(row => row[columns]), [...lattice[rows]].reverse(), lattice.map(row => row[0]).reverse()]
        .flatMap(edge => edge.map(each => each.point)));
    }
    // Below the cells lies their commonest shade: edges of many cells, drawn at once, let a pixel here and there through.
    this.areas(grounds, this.shades[cells.reduce((best, each, n) => each.length > cells[best].length ? n : best, 0)]);
    cells.forEach((outlines, n) => { if (outlines.length) this.areas(outlines, this.shades[n]); });
    this.strokes(mesh, this.colour.mesh, 0.6);
    // The target is a mark on the tissue, so it moves with it.
    const marked = position => [0, 1].flatMap(side => Array.from({ length: FINER * (across - 1) + 1 }, (_, i) =>
      place(side, i / FINER, position / this.told.length * (along - 1)).point));
    const tolerance = this.told.tip_tolerance;
    pen.globalAlpha = 0.3;
    this.area([...marked(cut.target - tolerance), ...marked(cut.target + tolerance).reverse()], this.colour.target);
    pen.globalAlpha = 1;
    const line = marked(cut.target);
    this.stroke(line, this.colour.target, 2);
    this.words(texts.target, line[0][0], 15, { colour: this.colour.target, align: "center" });

    const steps = 60, carried = y => finely(moved, 0, across - 1, Math.min(y / this.told.length, 1) * (along - 1), 1);
    const edge = sign => Array.from({ length: steps + 1 }, (_, n) => {
      const y = 0.5 * cut.tip * (1 - Math.cos(Math.PI * n / steps));
      return this.above(sign * this.halfGap(y, cut.tip), y + carried(y));
    });
    this.area([...edge(-1), ...edge(1).reverse()], this.colour.gap);

    const chord = BLADE.chord / Math.sin(cut.angle), thick = 0.5 * BLADE.thickness;
    const reach = Math.max(BLADE.length * Math.sin(cut.angle) - cut.depthAt(cut.depth, cut.blade), 0) / Math.tan(cut.angle);
    const section = [[0, 0], [-thick, -0.4 * chord], [-thick, -chord], [thick, -chord], [thick, -0.4 * chord]];
    this.area(section.map(([x, y]) => this.above(x, y + cut.blade)), this.tint(cut), this.colour.ink);
    const over = [[-thick, -chord], [-thick, reach - chord], [0, reach], [thick, reach - chord], [thick, -chord]];
    pen.globalAlpha = 0.4;
    this.area(over.map(([x, y]) => this.above(x, y + cut.blade)), this.colour.steel, this.colour.ink);
    pen.globalAlpha = 1;
    const [handX] = this.above(0, cut.hand);
    for (const sign of [-1, 1]) {
      this.area([[0, 10], [-6, 21], [6, 21]].map(([x, y]) => [handX + x, this.line + sign * y]), this.colour.hand, this.colour.ink);
    }
    if (showTip) {
      const [x, y] = this.above(0, cut.tip + cut.lag);
      this.area([[0, -6], [6, 0], [0, 6], [-6, 0]].map(([a, b]) => [x + a, y + b]), "white", "black");
    }
    this.hatch(this.line - half * this.scale, this.line + half * this.scale);
    this.words(texts.above, this.left, 15);
  }

  tint(cut) {
    if (!this.seen.force) return this.colour.steel;
    const depth = cut.depthAt(cut.depth, cut.blade), force = Math.abs(cut.last("force"));
    if (force > cut.limitPerDepth * depth) return this.colour.limit;
    return force > this.told.force_allowed_per_depth * depth ? this.colour.costs : this.colour.steel;
  }

  hatch(top, bottom) {
    const { pen } = this, x = this.left - 12;
    pen.save();
    this.trace([[[x, top], [this.left, top], [this.left, bottom], [x, bottom]]], true);
    pen.clip();
    const slanted = Array.from({ length: Math.ceil((bottom - top + 24) / 6) }, (_, n) => top - 12 + 6 * n);
    this.strokes(slanted.map(y => [[x, y + 12], [this.left, y]]), this.colour.quiet);
    pen.restore();
    this.stroke([[this.left, top], [this.left, bottom]], this.colour.quiet, 1.5);
  }

  drawSide(cut, texts, showTip) {
    const { pen } = this, top = Array.from(cut.depth, (depth, i) => this.beside(i * this.told.spacing, depth));
    const end = this.told.length, tolerance = this.told.tip_tolerance;
    this.area([...top, this.beside(end, 0), this.beside(0, 0)], this.colour["tissue-side"], this.colour["tissue-edge"]);
    const band = [cut.target - tolerance, cut.target + tolerance].map(along => this.beside(along, 0)[0]);
    pen.globalAlpha = 0.3;
    this.area([[band[0], this.ground], [band[0], this.ground - 0.026 * this.scale], [band[1], this.ground - 0.026 * this.scale], [band[1], this.ground]], this.colour.target);
    pen.globalAlpha = 1;
    const depth = cut.depthAt(cut.depth, cut.blade), { angle } = cut;
    const along = [Math.cos(angle), Math.sin(angle)], back = [-Math.sin(angle), Math.cos(angle)];
    const lower = [cut.blade - depth / Math.tan(angle), 0];
    const outline = Array.from({ length: 9 }, (_, n) => {
      const t = 0.5 * Math.PI * n / 8, b = BLADE.chord * Math.sin(t), e = BLADE.belly * (1 - Math.cos(t));
      return [b * back[0] + e * along[0], b * back[1] + e * along[1]];
    });
    outline.push([BLADE.length * along[0] + BLADE.chord * back[0], BLADE.length * along[1] + BLADE.chord * back[1]],
      [BLADE.length * along[0], BLADE.length * along[1]]);
    this.area(outline.map(([x, y]) => this.beside(lower[0] + x, lower[1] + y)), this.tint(cut), this.colour.ink);
    if (showTip) {
      const [x, y] = this.beside(cut.tip, cut.depthAt(cut.depth, cut.tip));
      this.area([[0, -6], [6, 0], [0, 6], [-6, 0]].map(([a, b]) => [x + a, y + b]), "white", "black");
    }
    for (let centimetres = 0; centimetres <= 15; centimetres++) {
      const [x] = this.beside(centimetres / 100, 0), long = centimetres % 5 === 0;
      this.stroke([[x, this.ground + 3], [x, this.ground + (long ? 10 : 7)]], this.colour.ink);
      if (long) this.words(centimetres ? String(centimetres) : "0 cm", x, this.ground + 24, { colour: this.colour.ink, align: centimetres === 15 ? "right" : "center" });
    }
    this.words(texts.side, this.left, this.line + 0.5 * this.told.slab.width * this.scale + 18);
  }

  // The force as far as it was shown, thinned to what is visible.
  keepUp(cut) {
    if (cut !== this.drawnCut) { this.drawnCut = cut; this.drawn = 0; this.path = []; this.high = CHART.high; this.low = CHART.low; }
    const { position, force } = cut.columns;
    for (; this.drawn + 10 <= cut.count; this.drawn += 10) {
      const part = force.slice(this.drawn, this.drawn + 10);
      for (const value of [Math.min(...part), Math.max(...part)]) {
        this.path.push([position[this.drawn + part.indexOf(value)], value]);
        while (value > 0.95 * this.high) this.high += CHART.step;
        while (value < 0.95 * this.low) this.low -= CHART.step;
      }
    }
  }

  drawChart(cut, texts) {
    this.keepUp(cut);
    const { pen } = this, end = this.told.length;
    this.area([this.charted(0, this.low), this.charted(end, this.low), this.charted(end, this.high), this.charted(0, this.high)], this.colour.panel);
    for (let force = 0; force <= this.high; force += CHART.step) {
      this.stroke([this.charted(0, force), this.charted(end, force)], force ? this.colour.rule : this.colour.ink);
      this.words(String(force), this.left - 5, this.charted(0, force)[1] + 4, { colour: this.colour.ink, align: "right" });
    }
    pen.save();
    this.trace([[this.charted(0, this.low), this.charted(end, this.low), this.charted(end, this.high), this.charted(0, this.high)]], true);
    pen.clip();
    const allowed = perDepth => Array.from(cut.depth, (depth, i) => this.charted(i * this.told.spacing, perDepth * depth));
    this.stroke(allowed(this.told.force_allowed_per_depth), this.colour.costs, 1.5, [6, 4]);
    this.stroke(allowed(cut.limitPerDepth), this.colour.limit, 1.5);
    this.stroke([this.charted(cut.target, this.low), this.charted(cut.target, this.high)], this.colour.target, 1.5);
    if (this.path.length && this.seen.trace) this.stroke(this.path.map(([along, force]) => this.charted(along, force)), this.colour.ink, 1.2);
    pen.restore();
    const [x, y] = this.charted(cut.blade, this.seen.force ? cut.last("force") : 0);
    pen.beginPath();
    pen.arc(x, y, 4, 0, 2 * Math.PI);
    pen.fillStyle = this.colour.ink;
    pen.fill();
    this.words(texts.chart, this.left, this.chartTop - 7);
  }
}
