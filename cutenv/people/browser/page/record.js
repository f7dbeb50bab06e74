// A cut that goes on or has ended: its readings, its numbers, and the file that `cutenv score` reads.

const READING = ["time", "force", "position", "speed", "angle", "true_force", "elastic_force", "tip", "jump"];
const LONG_RUN = 0.004; // m

class HandCut {
  constructor(law, specimen) {
    this.law = law;
    this.specimen = specimen;
    law.begin(specimen);
    this.columns = Object.fromEntries([...READING, ...law.channels].map(name => [name, []]));
    this.parts = [];
    this.inputs = [];
    this.target = law.number("episode", "tasks.target");
    this.deadline = law.number("episode", "tasks.deadline");
    this.limitPerDepth = law.number("episode", "tasks.force_limit_per_depth");
    const points = Math.round(law.told.length / law.told.spacing) + 1;
    this.deep = specimen.task === "depth" ? new CutDepth(law, specimen, points) : null;
    this.path = specimen.task === "path" ? new CutPath(law, specimen, points) : null;
    this.depth = this.deep?.surface ?? law.numbers("cut", "profiles.depth", points);
    this.measuredDepth = law.numbers("episode", "nominals.depth", points);
    this.end = "";
    this.success = false;
    this.stalled = 0;
    this.aids = new Set(); // that were on
    this.begun = null;
  }

  advance(stylus) {
    if (this.end) return;
    this.begun ??= new Date();
    const { readings, channels } = this.law.advance(stylus), width = READING.length;
    this.parts.push(readings);
    for (let i = 0; i < readings.length / width; i++) {
      READING.forEach((name, k) => this.columns[name].push(readings[width * i + k]));
      this.inputs.push(stylus[i]);
      channels.forEach((values, k) => this.columns[this.law.channels[k]].push(values[i]));
    }
    this.end = this.law.end;
    this.success = this.law.success;
  }

  // All readings as they lie in memory.
  bytes() {
    const all = new Float64Array(READING.length * this.count);
    let place = 0;
    for (const part of this.parts) { all.set(part, place); place += part.length; }
    return all;
  }

  get count() { return this.columns.time.length; }
  last(name) { return this.count ? this.columns[name][this.count - 1] : 0; }
  get hand() { return this.law.number("cut", "states.hand"); }
  get blade() { return this.law.number("cut", "states.blade"); }
  get tip() { return this.law.number("cut", "states.tip"); }
  get angle() { return this.law.number("cut", "states.angle"); }
  get lag() { return Math.max(this.blade - this.tip, 0); }

  get map() { return this.deep ?? this.path; }

  // Depth to which the blade is engaged, and to which limits of force belong.
  get engaged() {
    return this.depthAt(this.deep ? this.law.numbers("cut", "profiles.depth", this.depth.length) : this.depth, this.blade);
  }
  // Sum of the task's rewards.
  get gained() {
    const terms = this.law.numbers("episode", "totals", this.law.told.terms.length);
    return terms.reduce((sum, term) => sum + term, 0) + (this.map?.costs ?? 0);
  }

  depthAt(profile, position) {
    // As numpy.interp, to the last bit.
    const spacing = this.law.told.spacing, last = profile.length - 1;
    let i = Math.min(Math.max(Math.floor(position / spacing), 0), last - 1);
    while (i > 0 && position < i * spacing) i -= 1;
    while (i < last - 1 && position >= (i + 1) * spacing) i += 1;
    if (position <= 0) return profile[0];
    if (position >= last * spacing) return profile[last];
    const slope = (profile[i + 1] - profile[i]) / ((i + 1) * spacing - i * spacing);
    return slope * (position - i * spacing) + profile[i];
  }

  // What is shown of a cut that has ended; metres, newtons, seconds.
  numbers() {
    const runs = [];
    let run = 0;
    for (const jump of this.columns.jump) {
      if (jump > 0) run += jump;
      else if (run > 0) { runs.push(run); run = 0; }
    }
    if (run > 0) runs.push(run);
    return {
      off: this.tip - this.target,
      peak: Math.max(...this.columns.force),
      longest: Math.max(0, ...runs),
      long: runs.filter(length => length > LONG_RUN).length,
      time: this.last("time"),
    };
  }

  get name() {
    const { specimen_class: kind, seed, episode } = this.specimen;
    const stamp = localTime(this.begun).slice(0, 19).replace(/[-:]/g, "");
    return `${stamp}_${this.map ? `${this.specimen.task}_` : ""}${kind}_${seed}-${episode}`;
  }

  // The text of the record, schema cutenv-record/1: what a rig would have recorded, and where the tip ended.
  csv(operator, practised) {
    const { specimen_class: kind, seed, episode, line } = this.specimen;
    const told = {
      rig: "cutenv page, simulated", sensor: "simulated, 1 kHz",
      specimen: `${kind}, seed ${seed}, number ${episode}`,
      ...(line ? { line } : {}),
      ...(operator ? { operator } : {}),
      date: localTime(this.begun), name: this.name, program: `cutenv ${this.law.told.version}`,
      specimen_class: kind, specimen_seed: seed, specimen_episode: episode, practice: practised,
      end: this.end || "given up", success: this.success, device: "browser", hand: this.law.told.hand,
      ...(this.aids.size ? { device_aids: [...this.aids].sort() } : {}),
      stalled_s: Math.round(1e3 * this.stalled) / 1e3, target_length_m: this.target,
      tip_end_m: Math.round(1e6 * this.last("tip")) / 1e6, ...this.map?.noted(this.target), movements: inRuns(this.inputs),
    };
    const { time, force, position, speed, angle } = this.columns, { channels } = this.law;
    const rows = time.map((_, i) => [time[i], force[i], position[i], speed[i], angle[i],
      this.depthAt(this.measuredDepth, position[i]), ...channels.map(name => this.columns[name][i])].map(digits).join(","));
    const further = channels.map(name => `,${name}_${name.endsWith("force") ? "N" : "m"}`).join("");
    return ["# cutenv-record/1", `# rows: ${rows.length}`, `# metadata: ${JSON.stringify(told)}`,
      `time_s,force_N,position_m,speed_m_s,angle_rad,depth_m${further}`, ...rows, ""].join("\n");
  }
}

const digits = value => Object.is(value, -0) ? "-0.0" : String(value);

function localTime(date) {
  const two = value => String(value).padStart(2, "0"), away = -date.getTimezoneOffset(), size = Math.abs(away);
  return `${date.getFullYear()}-${two(date.getMonth() + 1)}-${two(date.getDate())}T${two(date.getHours())}:` +
    `${two(date.getMinutes())}:${two(date.getSeconds())}${away < 0 ? "-" : "+"}${two(Math.floor(size / 60))}:${two(size % 60)}`;
}

const CRC = Array.from({ length: 256 }, (_, value) => {
  for (let bit = 0; bit < 8; bit++) value = value & 1 ? 0xedb88320 ^ (value >>> 1) : value >>> 1;
  return value >>> 0;
});

// CRC-32 as in zlib: the browser's own digests exist only under https.
function crc32(numbers) {
  let sum = 0xffffffff;
  for (const byte of new Uint8Array(numbers.buffer)) sum = CRC[(sum ^ byte) & 0xff] ^ (sum >>> 8);
  return ((sum ^ 0xffffffff) >>> 0).toString(16).padStart(8, "0");
}
