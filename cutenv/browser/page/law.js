"use strict";
// The task and its law: WebAssembly made of the kernels that Python runs. Nothing is computed here but addresses.

const bytesOf = encoded => Uint8Array.from(atob(encoded), letter => letter.charCodeAt(0));
const singlesOf = encoded => new Float32Array(bytesOf(encoded).buffer);

const MOST_MILLISECONDS = 250; // made up for after a stall

class Law {
  constructor(program, told) {
    this.told = told;
    this.layout = told.layout;
    this.memory = program.memory;
    this.follow = program.follow;
    this.next = program.__heap_base.value;
    this.cut = this.room(this.layout.cut.size);
    this.episode = this.room(this.layout.episode.size);
    this.stylus = this.room(16 * MOST_MILLISECONDS);
    this.action = this.room(16);
    this.observation = this.room(48);
    this.readings = this.room(this.layout.reading.size * MOST_MILLISECONDS);
    this.outcome = this.room(16);
    const missing = this.next - this.memory.buffer.byteLength;
    if (missing > 0) this.memory.grow(Math.ceil(missing / 65536));
    this.view = new DataView(this.memory.buffer);
  }

  static async load(encoded, told) {
    const { instance } = await WebAssembly.instantiate(bytesOf(encoded), {});
    return new Law(instance.exports, told);
  }

  room(size) {
    const place = Math.ceil(this.next / 16) * 16;
    this.next = place + size;
    return place;
  }

  // Put the blade to the start of a specimen's cut.
  begin(specimen) {
    const memory = new Uint8Array(this.memory.buffer);
    memory.set(bytesOf(specimen.cut), this.cut);
    memory.set(bytesOf(specimen.task), this.episode);
  }

  // Advance by a millisecond for each [position, angle] of the stylus; return the readings up to the end of the cut.
  advance(stylus) {
    stylus.forEach(([position, angle], i) => {
      this.view.setFloat64(this.stylus + 16 * i, position, true);
      this.view.setFloat64(this.stylus + 16 * i + 8, angle, true);
    });
    const { motor_lag: lag, acceleration } = this.told.hand;
    const done = this.follow(this.cut, this.episode, this.stylus, stylus.length, lag, acceleration, this.action,
      this.observation, this.readings, this.outcome);
    const size = this.layout.reading.size;
    return new Float64Array(this.memory.buffer.slice(this.readings, this.readings + size * done));
  }

  number(record, field) {
    return this.view.getFloat64(this[record] + this.layout[record].offsets[field], true);
  }

  whole(record, field) {
    return this.view.getInt32(this[record] + this.layout[record].offsets[field], true);
  }

  numbers(record, field, count) {
    const start = this[record] + this.layout[record].offsets[field];
    return new Float64Array(this.memory.buffer.slice(start, start + 8 * count));
  }

  get end() {
    return this.told.ends[this.view.getFloat64(this.outcome, true)];
  }

  get success() {
    return this.view.getFloat64(this.outcome + 8, true) === 1;
  }
}
