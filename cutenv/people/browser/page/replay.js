// Replay of a cut: the law makes it again from the movements of its hand, beside the way of an expert in the same specimen.

const COMPARED = 0.001; // m of the way over which two forces are compared
const SHORTLY = 100; // ms over which a speed is told
const EXPERT_COLOURS = { light: "#8f3072", dark: "#e79cca" };
const EXPERT_DASH = [4, 2]; // px; the words under a replay name an expert's lines by it

// Movements as a record keeps them, how often each stands and its numbers; and back.
function inRuns(movements) {
  const runs = [];
  for (const row of movements) {
    const last = runs.at(-1);
    if (last && row.every((value, k) => Object.is(value, last[k + 1]))) last[0] += 1;
    else runs.push([1, ...row]);
  }
  return runs;
}
const fromRuns = runs => runs.flatMap(([count, ...row]) => Array.from({ length: count }, () => row));

// Mean force of each millimetre, by columns of positions and forces, while the blade is there for the first time.
function forceByPlace({ position, force }, count) {
  const sums = [];
  let farthest = -1;
  for (let i = 0; i < count; i++) {
    const place = Math.floor(position[i] / COMPARED);
    if (place < Math.max(farthest, 0)) continue;
    farthest = place;
    sums[place] ??= [0, 0];
    sums[place][0] += force[i];
    sums[place][1] += 1;
  }
  return Array.from(sums, each => each && each[0] / each[1]);
}

// The way of an expert, thinned: places and forces at moments, cutenv.people.browser.watched_cut.way_of.
class ExpertWay {
  constructor(columns) {
    Object.assign(this, { columns, count: columns.time.length });
    this.forces = forceByPlace(columns, this.count);
  }

  get peak() { return Math.max(...this.columns.force); }
  get lasts() { return this.columns.time[this.count - 1]; }

  // Number of the last moment up to a time [s].
  until(time) {
    const after = this.columns.time.findIndex(each => each > time);
    return after < 0 ? this.count - 1 : Math.max(after - 1, 0);
  }

  // What the expert does when the blade is first at a place [m]; null if it never was.
  at(place) {
    const { position, force, time } = this.columns, k = position.findIndex(each => each >= place);
    if (k < 0) return null;
    const from = Math.max(k - 3, 0), to = Math.min(k + 2, this.count - 1);
    return { force: force[k], time: time[k], speed: (position[to] - position[from]) / (time[to] - time[from]) };
  }

  // Beside a cut: the area between both forces, the expert's force, and the blade where it is at a time [s].
  draw(drawing, cut, values, time, showTip) {
    const { scene, pen } = drawing, { columns } = this, k = this.until(time);
    const dark = drawing.colours === drawing.told.scene.colours.dark, colour = EXPERT_COLOURS[dark ? "dark" : "light"];
    const chart = (along, force) => drawing.pixels("chart", [along, force]);
    const strokes = (lines, width) => drawing.strokes(lines, colour, width, EXPERT_DASH);
    drawing.clipped("chart", () => {
      const own = forceByPlace(cut.columns, cut.count), both = own.map((force, n) => [n, force, this.forces[n]]).filter(([, a, b]) => a !== undefined && b !== undefined);
      const middle = n => (n + 0.5) * COMPARED;
      pen.globalAlpha = 0.35;
      for (let n = 1; n < both.length; n++) {
        const [[i, a, b], [j, c, d]] = [both[n - 1], both[n]];
        if (j === i + 1) drawing.areas([[chart(middle(i), a), chart(middle(j), c), chart(middle(j), d), chart(middle(i), b)]], a + c > b + d ? drawing.colour.costs : drawing.colour.target);
      }
      pen.globalAlpha = 1;
      strokes([columns.position.map((along, n) => chart(along, columns.force[n]))], 1);
      strokes([columns.position.slice(0, k + 1).map((along, n) => chart(along, columns.force[n]))], 1.8);
    });
    const at = { ...values, blade: columns.position[k], tip: columns.tip[k], hand: columns.position[k], angle: columns.angle[k], force: columns.force[k],
      level: columns.height?.[k] ?? values.level };
    for (const [name, each] of scene.quantities) at[name] = each(at);
    const outlined = showTip ? ["blade", "tip"] : ["blade"];
    if (!drawing.plan) outlined.push("blade from above", ...showTip ? ["tip from above"] : []);
    for (const part of scene.parts.filter(each => outlined.includes(each.name))) {
      const points = scene.places(part, at, null).map(place => drawing.pixels(part.view, place));
      const lines = part.mark.length ? points.map(([x, y]) => part.mark.map(([a, b]) => [x + a, y + b])) : [points];
      drawing.clipped(part.view, () => strokes(lines.map(each => [...each, each[0]]), 2));
    }
    if (!drawing.plan) return;
    const places = drawing.plan.pixels(columns.blade_x.map((x, n) => [x, columns.blade_y[n]]));
    strokes([places], 1);
    strokes([places.slice(0, k + 1)], 2.2);
    const [x, y] = places[k];
    strokes([[[x, y - 6], [x + 6, y], [x, y + 6], [x - 6, y], [x, y - 6]]], 2);
    if (showTip) drawing.plan.nameTip();
  }
}

class Replay {
  // `law` is one that no other cut uses; `expert` the columns of a way, or null.
  constructor(law, specimen, movements, expert) {
    Object.assign(this, { law, specimen, movements, pace: 1, playing: true, passed: 0 });
    this.expert = expert && new ExpertWay(expert);
    this.cut = new HandCut(law, specimen);
  }

  get lasts() { return Math.max(this.movements.length, this.expert ? 1e3 * this.expert.lasts : 0); } // ms

  // Show the cut as it was so many milliseconds after its beginning.
  seek(moment) {
    this.passed = Math.min(Math.max(moment, 0), this.lasts);
    const due = Math.min(Math.floor(this.passed), this.movements.length);
    if (due < this.cut.count) this.cut = new HandCut(this.law, this.specimen);
    while (this.cut.count < due && !this.cut.end) {
      this.cut.advance(this.movements.slice(this.cut.count, Math.min(this.cut.count + MOST_MILLISECONDS, due)));
    }
  }

  // Go on by so many milliseconds of the clock; at the end it stands still.
  advance(milliseconds) {
    if (!this.playing) return;
    this.seek(this.passed + this.pace * milliseconds);
    if (this.passed >= this.lasts) this.playing = false;
  }

  get speed() {
    const { count, columns: { position, time } } = this.cut, from = Math.max(count - 1 - SHORTLY, 0);
    return count > 1 ? (position[count - 1] - position[from]) / (time[count - 1] - time[from]) : 0;
  }

  // Rows of own and expert's numbers: at this place, and of the whole cut so far.
  rows(texts) {
    const { cut, expert } = this, place = cut.last("position"), there = cut.count ? expert?.at(place) : null;
    const numbers = (value, count, unit) => value === undefined ? "–" : `${fixed(value, count)} ${unit}`;
    const peak = cut.count ? cut.columns.force.reduce((most, force) => Math.max(most, force), 0) : 0;
    return [
      [texts.force, numbers(cut.last("force"), 1, "N"), numbers(there?.force, 1, "N")],
      [texts.speed, numbers(100 * this.speed, 1, "cm/s"), numbers(there && 100 * there.speed, 1, "cm/s")],
      [texts.time, numbers(cut.last("time"), 1, "s"), numbers(there?.time, 1, "s")],
      [texts.result_peak, numbers(peak, 1, "N"), numbers(expert?.peak, 1, "N")],
    ].map(row => expert ? row : row.slice(0, 2));
  }
}
