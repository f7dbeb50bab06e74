"use strict";
// The task and its law: WebAssembly made of the kernels that Python runs. Nothing is computed here but addresses.

const bytesOf = encoded => Uint8Array.from(atob(encoded), letter => letter.charCodeAt(0));
const singlesOf = encoded => new Float32Array(bytesOf(encoded).buffer);

const MOST_MILLISECONDS = 250; // made up for after a stall

class Law {
  constructor(program, told, task) {
    const { numbers, memory, shared, channels, ends, terms } = told.tasks[task];
    Object.assign(this, { told, channels, ends, terms });
    this.layout = { reading: told.layout.reading, cut: told.layout[`${task}_cut`], episode: told.layout[`${task}_episode`] };
    this.memory = program.memory;
    this.follow = program.follow;
    this.next = program.__heap_base.value;
    for (const name of ["cut", "episode"]) this[name] = this.room(this.layout[name].size);
    const kept = bytesOf(shared);
    this.shared = this.room(kept.length);
    this.columns = numbers;
    this.stylus = this.room(8 * numbers * MOST_MILLISECONDS);
    this.calls = memory.map(size => this.room(size));
    this.readings = this.room(this.layout.reading.size * MOST_MILLISECONDS);
    this.noted = this.room(8 * channels.length * MOST_MILLISECONDS);
    this.outcome = this.room(16);
    const missing = this.next - this.memory.buffer.byteLength;
    if (missing > 0) this.memory.grow(Math.ceil(missing / 65536));
    this.view = new DataView(this.memory.buffer);
    new Uint8Array(this.memory.buffer).set(kept, this.shared);
  }

  static async load(encoded, told, task) {
    const { instance } = await WebAssembly.instantiate(bytesOf(encoded), {});
    return new Law(instance.exports, told, task);
  }

  room(size) {
    const place = Math.ceil(this.next / 16) * 16;
    this.next = place + size;
    return place;
  }

  // Put the blade to the start of a specimen's cut.
  begin(specimen) {
    const memory = new Uint8Array(this.memory.buffer);
    for (const name of ["cut", "episode"]) memory.set(bytesOf(specimen.records[name]), this[name]);
    this.start = "motions.level" in this.layout.cut.offsets ? this.number("cut", "motions.level") : 0;
  }

  // Advance by a millisecond for each row of numbers of the stylus; return the readings up to the end of the cut, and
  // further channels of a record: of a blade that also moves up and down, or is steered.
  advance(stylus) {
    stylus.forEach((row, i) => row.forEach((value, k) => {
      this.view.setFloat64(this.stylus + 8 * (this.columns * i + k), value, true);
    }));
    const { motor_lag: lag, acceleration } = this.told.hand, count = stylus.length;
    const done = this.follow(this.cut, this.shared, this.episode, this.stylus, count, lag, acceleration, this.start,
      ...this.calls, this.readings, this.noted, this.outcome);
    const { size } = this.layout.reading, row = (start, bytes) => new Float64Array(this.memory.buffer.slice(start, start + bytes));
    const channels = this.channels.map((_, k) => row(this.noted + 8 * k * count, 8 * done));
    return { readings: row(this.readings, size * done), channels };
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
    return this.ends[this.view.getFloat64(this.outcome, true)];
  }

  get success() {
    return this.view.getFloat64(this.outcome + 8, true) === 1;
  }
}
