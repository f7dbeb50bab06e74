// View from above of a cut along a line, as cutenv.display.viewer.views: line, cut, blade, hand and tip in their places.

const MESH = 0.01, MESH_FINE = 0.0025; // m, between lines on the tissue, and between the points of one
const HALF_BLADE = 0.001, BESIDE_TARGET = 0.008; // m
const CARRIED = 0.012; // m, over which the tissue gives way around the tip; an illustration
const BLADE = [[0, 0], [-0.4, -1], [-1, -1], [-1, 1], [-0.4, 1]]; // shares of chord and half width
const HAND = [[9, 0], [20, -6], [20, 6]]; // px, along and beside the blade

class Plan {
  constructor(drawing, cut) {
    Object.assign(this, { drawing, path: cut.path, target: Math.round(cut.target / cut.path.spacing) });
    const { length, slab: { width } } = drawing.told, half = 0.5 * width;
    Object.assign(this, { length, half });
    const steps = (from, to, step) => Array.from({ length: Math.round((to - from) / step) + 1 }, (_, k) => from + k * step);
    const along = steps(0, length, MESH_FINE), across = steps(-half, half, MESH_FINE);
    this.mesh = [...steps(-half, half, MESH).slice(1, -1).map(y => along.map(x => [x, y])),
      ...steps(0, length, MESH).slice(1, -1).map(x => across.map(y => [x, y]))];
    const outside = this.path.places.findIndex(([x, y]) => x > length || Math.abs(y) > half);
    this.line = outside < 0 ? this.path.places : this.path.places.slice(0, outside);
  }

  pixels(places) { return places.map(([x, y]) => this.drawing.pixels("above", [-y, x])); }

  // Places in the tissue at rest where the blade has carried them: the tip to the blade; in the open cut, nothing.
  givenWay(places) {
    const { blade, tip, heading } = this.path, carried = [blade[0] - tip[0], blade[1] - tip[1]];
    if (carried[0] * heading[0] + carried[1] * heading[1] <= 0) return places;
    return places.map(([x, y]) => {
      const share = Math.exp(-Math.hypot(x - tip[0], y - tip[1]) / CARRIED);
      return [x + share * carried[0], y + share * carried[1]];
    });
  }

  // With the hidden truth the tissue is at rest, and what lies between cut and line is filled.
  draw(words, truth) {
    const { drawing, path, line, target } = this, { colour } = drawing, places = path.cutPlaces;
    const corners = [[0, this.half], [this.length, this.half], [this.length, -this.half], [0, -this.half]];
    drawing.areas([this.pixels(corners)], drawing.shades[0], colour["tissue edge"]);
    drawing.strokes((truth ? this.mesh : this.mesh.map(each => this.givenWay(each))).map(each => this.pixels(each)), colour.mesh, 0.6);
    if (truth && places.length > 2) {
      drawing.pen.globalAlpha = 0.6;
      drawing.areas([this.pixels([...places, ...line.slice(0, places.length - 1).reverse()])], colour.costs);
      drawing.pen.globalAlpha = 1;
    }
    drawing.strokes([this.pixels(line.slice(0, target + 1))], colour.target, 1.6, [5, 5]);
    drawing.strokes([this.pixels(line.slice(target))], colour.quiet, 1, [3, 3]);
    this.drawTarget(words);
    if (path.cut.length > 1) drawing.strokes([this.pixels(truth ? places : this.givenWay(places))], colour.gap, truth ? 1.6 : 3);
    if (truth) drawing.strokes([this.pixels([path.tip, path.blade])], colour.quiet);
    const [ahead, across] = path.heading, { scale } = drawing;
    const turned = (at, rows) => rows.map(([a, b]) => [at[0] + a * ahead - b * across, at[1] + a * across + b * ahead]);
    for (const side of [1, -1]) {
      const mark = HAND.map(([along, beside]) => [side * beside / scale, side * along / scale]);
      drawing.areas([this.pixels(turned(path.hand, mark))], colour.hand, colour.edge);
    }
    const { chord } = drawing.told.scene;
    drawing.areas([this.pixels(turned(path.blade, BLADE.map(([a, b]) => [chord * a, HALF_BLADE * b])))], colour.tint, colour.edge);
    if (!truth) return;
    const [[x, y]] = this.pixels([path.tip]);
    drawing.areas([[[x, y - 6], [x + 6, y], [x, y + 6], [x - 6, y]]], colour.tip, colour.edge);
    this.named = [words.tip, x - 6, y + 18];
    this.nameTip();
  }

  // Write the tip's name, again after what is drawn over it.
  nameTip() {
    const { drawing } = this, { pen, colour } = drawing, [text, x, y] = this.named;
    pen.textAlign = "right";
    pen.strokeStyle = drawing.shades[0];
    pen.lineWidth = 4;
    pen.strokeText(text, x, y);
    drawing.words(text, x, y, { colour: colour.ink, align: "right" });
  }

  // Where the cut is to end, across the line.
  drawTarget(words) {
    const { drawing, path, target } = this, [x, y] = path.places[target], angle = path.angles[target];
    const [c, s] = [Math.cos(angle), Math.sin(angle)], off = drawing.told.tip_tolerance;
    const at = (along, beside) => [x + along * c - beside * s, y + along * s + beside * c];
    const around = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([a, b]) => at(a * off, b * BESIDE_TARGET));
    drawing.pen.globalAlpha = 0.3;
    drawing.areas([this.pixels(around)], drawing.colour.target);
    drawing.pen.globalAlpha = 1;
    drawing.strokes([this.pixels([at(0, -BESIDE_TARGET), at(0, BESIDE_TARGET)])], drawing.colour.target, 2);
    const [[across, top]] = this.pixels([[x, this.half]]), half = drawing.pen.measureText(words.target).width / 2;
    const centred = Math.max(Math.min(across, drawing.canvas.clientWidth - half), half);
    drawing.words(words.target, centred, top - 5, { colour: drawing.colour.target, align: "center" });
  }
}
