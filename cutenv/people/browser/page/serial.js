// A handle on a serial port whose board sends one number a line, such as a load cell: how hard it is pushed leads the hand.

const BAUD = 115200;
const AT_REST = 20; // numbers at the beginning, whose mean is the handle at rest
const STALE = 300; // ms after which the last number says nothing any more
const LONGEST_LINE = 64; // characters
const BROKEN = "?"; // in place of the beginning of a line that was sent before anybody read
const A_NUMBER = /^\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*$/;

class SerialHandle {
  constructor() { Object.assign(this, { full: 1, open: false, trouble: "", count: 0, reading: null }); }

  // Let the person choose a port, and read it until it is closed or lost. A choice that is broken off changes nothing.
  async connect() {
    Object.assign(this, { trouble: "", count: 0, rest: 0, line: BROKEN, last: -Infinity });
    try {
      const port = await navigator.serial.requestPort();
      await port.open({ baudRate: BAUD });
      this.open = true;
      this.reading = this.read(port);
      await this.reading;
    } catch (error) {
      if (error.name !== "NotFoundError") this.trouble = String(error.message ?? error);
    } finally { this.open = false; }
  }

  async read(port) {
    const decoder = new TextDecoder();
    this.reader = port.readable.getReader();
    try {
      for (let part = await this.reader.read(); !part.done; part = await this.reader.read()) {
        this.take(decoder.decode(part.value, { stream: true }), performance.now());
      }
    } finally {
      this.reader.releaseLock();
      await port.close().catch(() => {}); // one that is lost is closed
    }
  }

  disconnect() { return this.reader.cancel(); }

  // Take what has arrived: whole lines; what is no number is passed over.
  take(text, now) {
    const lines = (this.line + text).split(/\r\n|\r|\n/);
    this.line = lines.pop().slice(0, LONGEST_LINE + 1);
    const whole = lines.filter(each => each.length <= LONGEST_LINE && A_NUMBER.test(each));
    for (const number of whole.map(Number).filter(Number.isFinite)) {
      if (this.count < AT_REST) this.rest += number / AT_REST;
      this.count += 1;
      Object.assign(this, { number, last: now });
    }
  }

  get resting() { return this.count < AT_REST; }
  silent(now) { return now - this.last > STALE; }

  // How hard it is pushed, -1 to 1; 0 while it is silent.
  push(now) {
    return !this.open || this.resting || this.silent(now) ? 0 : within((this.number - this.rest) / this.full, -1, 1);
  }
}
