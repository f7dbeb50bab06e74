// The person's hand: pointer, pen, wheel, keys, gamepad, serial handle and sliders lead a stylus, of which the law takes
// numbers.

const UPRIGHT = 0.5 * Math.PI;
const NOTCH_HEIGHT = 12; // px that a second finger moves for a notch of the wheel
const FASTEST = 0.0254; // m/s, of a stick or a handle that is pushed as far as it goes
const IGNORED = { stick: 0.12, pressure: 0.15 }; // around the middle
const within = (value, low, high) => Math.min(Math.max(value, low), high);

// How fast a pen's pressure or a stick lets the blade descend, -1 to 1: 0 around the middle.
const beyond = (value, ignored, most) => Math.sign(value) * Math.max(Math.abs(value) - ignored, 0) / (most - ignored);

class Stylus {
  constructor(told) {
    Object.assign(this, { told, keys: new Set(), slowly: false, left: false, penTilts: false, serial: new SerialHandle() });
    this.rest("gentle");
  }

  // Stand at the clamp, upright, at the level where the blade stands: the start of a cut of a task.
  rest(task) {
    this.keys.clear();
    Object.assign(this, { deep: task === "depth", steered: task === "path", position: 0, across: 0, angle: UPRIGHT,
      level: 0, pressing: 0, penned: false, pointers: new Map() });
  }

  // What the law takes of it in a millisecond: where the blade is steered, the place along and across the slab.
  get numbers() {
    const third = this.deep ? [this.level] : this.steered ? [this.across] : [];
    return [this.position, this.angle, ...third];
  }

  move(along, across = 0) {
    this.position = within(this.position + along, 0, this.told.travel);
    if (!this.steered) return;
    const side = 0.5 * this.told.slab.width;
    this.across = within(this.across + across, -side, side);
  }
  lean(angle) { this.angle = within(angle, this.told.inclined, UPRIGHT); }
  raise(height) { this.level = within(this.level + height, -this.told.level_reach, this.told.level_reach); }

  // Turn the wheel by a notch: away from the person (1) raises the blade, or turns it upright; toward them (-1) lowers it.
  turn(way, leaning) {
    if (this.deep && !leaning) this.raise(way * this.told.level_notch);
    else this.lean(this.angle + way * this.told.notch);
  }

  // Stay near the hand that it leads, at a place along and across, and take what is held: keys, sticks, pen's pressure.
  advance(milliseconds, [hand, aside]) {
    const seconds = milliseconds / 1e3, { told } = this;
    const held = [0, 1].map(k => [...this.keys].reduce((sum, key) => sum + this.ways[key][k], 0));
    const speed = (this.slowly ? 0.003 : 0.015) / Math.max(Math.hypot(...held), 1);
    this.move(held[0] * speed * seconds, held[1] * speed * seconds);
    this.move(beyond(this.serial.push(performance.now()), IGNORED.stick, 1) * FASTEST * seconds);
    let descent = this.pressing;
    for (const pad of navigator.getGamepads?.() ?? []) {
      if (!pad) continue;
      const [along, across, other, trigger] = this.left ? [2, 3, 1, 6] : [0, 1, 3, 7]; // axes, and the other hand's
      const stick = [pad.axes[along] ?? 0, this.steered ? -(pad.axes[across] ?? 0) : 0].map(each => Math.abs(each) > IGNORED.stick ? each : 0);
      const size = FASTEST * seconds / Math.max(Math.hypot(...stick), 1);
      this.move(stick[0] * size, stick[1] * size);
      const pull = pad.buttons[trigger]?.value ?? 0;
      if (pull > 0.02) this.angle = UPRIGHT - pull * (UPRIGHT - told.inclined);
      descent += beyond(pad.axes[other] ?? 0, IGNORED.stick, 1);
    }
    if (this.deep) this.raise(-within(descent, -1, 1) * told.fastest_descent * seconds);
    const away = [this.position - hand, this.across - aside], distance = Math.hypot(...away);
    if (distance > told.lead) this.move(...away.map(each => each * (told.lead / distance - 1)));
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
      const key = LEFT_HANDED[event.code] ?? event.key;
      if (key in this.ways) this.keys.add(key);
      else if (key in TILTING) this.turn(TILTING[key], true);
      else if (key === "ArrowUp" || key === "ArrowDown") this.turn(key === "ArrowUp" ? 1 : -1, event.shiftKey);
      else return;
      this.slowly = event.shiftKey;
      event.preventDefault();
    });
    canvas.addEventListener("keyup", event => {
      this.keys.delete(LEFT_HANDED[event.code] ?? event.key);
      this.slowly = event.shiftKey;
    });
    canvas.addEventListener("blur", () => this.keys.clear());
    tilt.addEventListener("input", () => this.lean(tilt.value * Math.PI / 180));
    level.addEventListener("input", () => { this.level = level.value / 1e3; });
  }

  get ways() { return this.steered ? ANYWHERE : FORWARD; }

  touch({ pointerId, clientX: x, clientY: y }) { this.pointers.set(pointerId, { x, y }); }

  // The first pointer leads the hand; a second finger turns the wheel as it moves up or down.
  follow(event, before, scale) {
    const [first] = this.pointers.keys();
    if (event.pointerId !== first) { this.turn((before.y - event.clientY) / NOTCH_HEIGHT, false); return; }
    this.move((event.clientX - before.x) / scale, (before.y - event.clientY) / scale);
    if (event.pointerType !== "pen") return;
    if (this.penTilts) { this.lean(UPRIGHT - event.pressure * (UPRIGHT - this.told.inclined)); this.penned = true; return; }
    // A pen leans the blade as it leans itself. Pressed harder than by half it lowers the blade, more gently it raises it.
    if (event.tiltX || event.tiltY) this.lean(UPRIGHT - Math.hypot(event.tiltX, event.tiltY) * Math.PI / 180);
    this.pressing = event.buttons ? beyond(event.pressure - 0.5, IGNORED.pressure, 0.5) : 0;
  }
}

const FORWARD = { ArrowRight: [1, 0], ArrowLeft: [-1, 0] }; // ways of keys along and across the slab
const ANYWHERE = { ...FORWARD, ArrowUp: [0, 1], ArrowDown: [0, -1] };
// Keys under the left hand, by their place on the keyboard, for those on its right.
const LEFT_HANDED = { KeyA: "ArrowLeft", KeyD: "ArrowRight", KeyW: "ArrowUp", KeyS: "ArrowDown", KeyE: "PageUp", KeyQ: "PageDown" };
const TILTING = { PageUp: 1, PageDown: -1 };
