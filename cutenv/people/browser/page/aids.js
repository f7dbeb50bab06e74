// Aids of the person's choice, all off at first: the force as a sound and as vibration; what else leads the hand.

const LOWEST = 180; // Hz, without force
const OCTAVES = 2.5; // up to the limit of the force
const LOUDNESS = 0.12;
const SMOOTHED = 0.03; // s
const PULSE = 100; // ms from one pulse of vibration to the next

class ForceAids {
  constructor(sound, vibration, stylus) {
    Object.assign(this, { sound, vibration, stylus, pulsed: 0 });
    sound.addEventListener("change", () => this.listen());
  }

  // Names of those that are on, as the record notes them; of a pen, once it has pressed.
  get names() {
    const { sound, vibration, stylus: { penned: pen, serial: { open: serial } } } = this;
    return Object.entries({ sound: sound.checked, vibration: vibration.checked, pen, serial }).filter(([, on]) => on).map(([name]) => name);
  }

  // A sound may begin only when the person has asked for it.
  listen() {
    if (!this.sound.checked || this.context) return;
    this.context = new AudioContext();
    this.tone = new OscillatorNode(this.context, { frequency: LOWEST });
    this.volume = new GainNode(this.context, { gain: 0 });
    this.tone.connect(this.volume).connect(this.context.destination);
    this.tone.start();
  }

  // Play the force as a share of its limit, 0 to 1; null silences it.
  tell(part, now) {
    this.part = part;
    if (this.context) {
      const { currentTime: at } = this.context, heard = this.sound.checked && part !== null;
      if (heard) this.tone.frequency.setTargetAtTime(LOWEST * 2 ** (OCTAVES * part), at, SMOOTHED);
      this.volume.gain.setTargetAtTime(heard && part > 0 ? LOUDNESS : 0, at, SMOOTHED);
    }
    if (!this.vibration.checked || !part || now - this.pulsed < PULSE) return;
    this.pulsed = now;
    navigator.vibrate?.(Math.round(PULSE * part));
    for (const pad of navigator.getGamepads?.() ?? []) {
      pad?.vibrationActuator?.playEffect("dual-rumble", { duration: PULSE, strongMagnitude: part, weakMagnitude: part });
    }
  }
}
