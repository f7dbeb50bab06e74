// A learning platform that has opened the page, by its SCORM 1.2 interface: best score, status, and what is needed to
// go on with the next specimen.

class Platform {
  // The interface stands in one of the windows around this one, or around the one that opened it.
  static find() {
    for (const opened of [() => window, () => window.opener, () => window.top.opener]) {
      try {
        for (let at = opened(); at; at = at.parent === at ? null : at.parent) {
          if (typeof at.API?.LMSInitialize === "function") return at.API;
        }
      } catch { continue; } // a window of another origin
    }
    return null;
  }

  constructor(api, count, mark) {
    Object.assign(this, { api, mark, begun: performance.now(), refused: "", open: false });
    this.progress = { cuts: 0, best: null, done: "0".repeat(count) };
    this.open = this.ask("LMSInitialize", "") === "true";
    if (!this.open) return;
    this.goOn(this.ask("LMSGetValue", "cmi.suspend_data"));
    const begun = this.ask("LMSGetValue", "cmi.core.lesson_status") !== "not attempted";
    this.tell({ ...(begun ? {} : { lesson_status: "incomplete" }), exit: "suspend" });
  }

  // Take up the progress of an earlier session, unless it is of another package.
  goOn(kept) {
    let found = {};
    try { found = JSON.parse(kept) ?? {}; } catch { return; }
    const known = Number.isInteger(found.cuts) && found.cuts >= 0 && /^[01]+$/.test(found.done) &&
      (found.best === null || (found.best >= 0 && found.best <= 100));
    if (known && found.done.length === this.progress.done.length) this.progress = found;
  }

  // Number of the first specimen that has not been cut, 0 if all have.
  get next() { return Math.max(this.progress.done.indexOf("0"), 0); }
  get done() { return this.progress.done.split("1").length - 1; }

  get status() {
    const { best } = this.progress, whole = !this.progress.done.includes("0");
    if (this.mark === null) return whole ? "completed" : "incomplete";
    if (best !== null && best >= this.mark) return "passed";
    return whole ? "failed" : "incomplete";
  }

  // Report a cut that has ended: its score, 0 to 100, and whether the specimen counts as cut.
  report(number, score, whole) {
    const { progress } = this;
    progress.cuts += 1;
    if (score !== null) progress.best = Math.max(progress.best ?? 0, Math.round(10 * score) / 10);
    if (whole) progress.done = `${progress.done.slice(0, number)}1${progress.done.slice(number + 1)}`;
    const { best } = progress;
    this.tell({
      ...(best === null ? {} : { "score.raw": best, "score.min": 0, "score.max": 100 }),
      lesson_status: this.status, session_time: this.time,
    }, { suspend_data: JSON.stringify(progress) });
  }

  leave() {
    if (!this.open) return;
    this.tell({ session_time: this.time });
    this.ask("LMSFinish", "");
    this.open = false;
  }

  tell(core, others = {}) {
    this.refused = "";
    for (const [name, value] of Object.entries(core)) this.ask("LMSSetValue", `cmi.core.${name}`, String(value));
    for (const [name, value] of Object.entries(others)) this.ask("LMSSetValue", `cmi.${name}`, value);
    this.ask("LMSCommit", "");
  }

  ask(name, ...values) {
    try {
      const said = String(this.api[name](...values));
      if (said === "false") throw new Error(this.api.LMSGetErrorString(String(this.api.LMSGetLastError())));
      return said;
    } catch (error) {
      this.refused ||= `${[name, ...values].join(" ")}: ${error.message}`;
      return "";
    }
  }

  // Time since the page was opened, as SCORM writes it.
  get time() {
    const hundredths = Math.floor((performance.now() - this.begun) / 10), two = value => String(value).padStart(2, "0");
    const [hours, minutes] = [Math.min(Math.floor(hundredths / 360000), 9999), Math.floor(hundredths / 6000) % 60];
    return `${two(hours)}:${two(minutes)}:${two(Math.floor(hundredths / 100) % 60)}.${two(hundredths % 100)}`;
  }
}
