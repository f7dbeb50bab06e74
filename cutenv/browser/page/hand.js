// The person's hand: pointer, pen, wheel, keys, gamepad and sliders lead a stylus, of which the law takes numbers.

const UPRIGHT = 0.5 * Math.PI;
const NOTCH_HEIGHT = 12; // px that a second finger moves for a notch of the wheel
const IGNORED = { stick: 0.12, pressure: 0.15 }; // around the middle
const within = (value, low, high) => Math.min(Math.max(value, low), high);

// How fast a pen's pressure or a stick lets the blade descend, -1 to 1: 0 around the middle.
const beyond = (value, ignored, most) => Math.sign(value) * Math.max(Math.abs(value) - ignored, 0) / (most - ignored);

class Stylus {
  constructor(told) {
    Object.assign(this, { told, keys: new Set(), slowly: false });
    this.rest(false);
  }

  // Stand at the clamp, upright, at the level where the blade stands; a deep cut's blade also moves up and down.
  rest(deep) { Object.assign(this, { deep, position: 0, angle: UPRIGHT, level: 0, pressing: 0, pointers: new Map() }); }

  // What the law takes of it in a millisecond.
  get numbers() { return this.deep ? [this.position, this.angle, this.level] : [this.position, this.angle]; }

  move(distance) { this.position = within(this.position + distance, 0, this.told.travel); }
  lean(angle) { this.angle = within(angle, this.told.inclined, UPRIGHT); }
  raise(height) { this.level = within(this.level + height, -this.told.level_reach, this.told.level_reach); }

  // Turn the wheel by a notch: away from the person (1) raises the blade, or turns it upright; toward them (-1) lowers it.
  turn(way, leaning) {
    if (this.deep && !leaning) this.raise(way * this.told.level_notch);
    else this.lean(this.angle + way * this.told.notch);
  }

  // Stay near the hand that it leads, and take what is held: keys, sticks, and the pen's pressure.
  advance(milliseconds, hand) {
    const seconds = milliseconds / 1e3, { told } = this;
    for (const key of this.keys) this.move(KEYS[key] * (this.slowly ? 0.003 : 0.015) * seconds);
    let descent = this.pressing;
    for (const pad of navigator.getGamepads?.() ?? []) {
      if (!pad) continue;
      if (Math.abs(pad.axes[0]) > IGNORED.stick) this.move(pad.axes[0] * 0.0254 * seconds);
      const pull = pad.buttons[7]?.value ?? 0;
      if (pull > 0.02) this.angle = UPRIGHT - pull * (UPRIGHT - told.inclined);
      descent += beyond(pad.axes[3] ?? 0, IGNORED.stick, 1);
    }
    if (this.deep) this.raise(-within(descent, -1, 1) * told.fastest_descent * seconds);
    this.position = within(within(this.position, hand - told.lead, hand + told.lead), 0, told.travel);
  }

  // Follow the person on the picture and at the sliders; `at` says whether a cut goes on, the scale, and how to start.
  listen(canvas, at, tilt, level) {
    canvas.addEventListener("pointermove", event => {
      const before = this.pointers.get(event.pointerId);
      if (at.cutting() && before) this.follow(event, before, at.scale());
      if (event.pointerType === "mouse" || event.buttons) this.touch(event);
    });
    canvas.addEventListener("pointerdown", event => {
      this.touch(event);
      canvas.setPointerCapture(event.pointerId);
    });
    for (const name of ["pointerup", "pointerleave", "pointercancel"]) {
      canvas.addEventListener(name, event => {
        this.pointers.delete(event.pointerId);
        this.pressing = 0;
      });
    }
    canvas.addEventListener("wheel", event => {
      if (!at.cutting()) return;
      event.preventDefault();
      this.turn(-Math.sign(event.deltaY || event.deltaX), event.shiftKey); // with shift some turn it sideways
    }, { passive: false });
    canvas.addEventListener("keydown", event => {
      if (event.key === " ") { event.preventDefault(); at.start(); return; }
      if (!at.cutting()) return;
      if (event.key in KEYS) this.keys.add(event.key);
      else if (event.key === "ArrowUp" || event.key === "ArrowDown") this.turn(event.key === "ArrowUp" ? 1 : -1, event.shiftKey);
      else return;
      this.slowly = event.shiftKey;
      event.preventDefault();
    });
    canvas.addEventListener("keyup", event => {
      this.keys.delete(event.key);
      this.slowly = event.shiftKey;
    });
    canvas.addEventListener("blur", () => this.keys.clear());
    tilt.addEventListener("input", () => this.lean(tilt.value * Math.PI / 180));
    level.addEventListener("input", () => { this.level = level.value / 1e3; });
  }

  touch({ pointerId, clientX: x, clientY: y }) { this.pointers.set(pointerId, { x, y }); }

  // The first pointer leads the hand; a second finger turns the wheel as it moves up or down.
  follow(event, before, scale) {
    const [first] = this.pointers.keys();
    if (event.pointerId !== first) { this.turn((before.y - event.clientY) / NOTCH_HEIGHT, false); return; }
    this.move((event.clientX - before.x) / scale);
    if (event.pointerType !== "pen") return;
    // A pen leans the blade as it leans itself. Pressed harder than by half it lowers the blade, more gently it raises it.
    if (event.tiltX || event.tiltY) this.lean(UPRIGHT - Math.hypot(event.tiltX, event.tiltY) * Math.PI / 180);
    this.pressing = event.buttons ? beyond(event.pressure - 0.5, IGNORED.pressure, 0.5) : 0;
  }
}

const KEYS = { ArrowRight: 1, ArrowLeft: -1 };
