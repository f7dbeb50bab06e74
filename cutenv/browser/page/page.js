// The page: choice of the specimen, the person's hand, the clock of a cut, and what is said of it.

(async () => {
  const byId = name => document.getElementById(name);
  const told = JSON.parse(byId("data").textContent);
  const canvas = byId("picture");
  let texts = told.texts[told.language];
  let law;
  try {
    law = await Law.load(byId("law").textContent.trim(), told);
  } catch (error) {
    byId("trouble").hidden = false;
    throw error;
  }
  const drawing = new Drawing(canvas, told);
  const upright = 0.5 * Math.PI;
  const FEWEST = 100; // ms that make a cut a record
  const within = (value, low, high) => Math.min(Math.max(value, low), high);

  const page = { phase: "ready", chosen: 0, cut: null, practised: false, from: 0, given: 0 };
  const stylus = { position: 0, angle: upright, keys: new Set(), pointer: null };

  // A server hands out each specimen, and says what is shown of the force; the page alone has its own.
  async function prepare() {
    if (told.served) {
      page.handedOut = await ask("POST", "cuts");
      sayCourse();
      page.done = !page.handedOut.cut;
      if (page.done) { show(); return; }
    }
    page.cut = new HandCut(law, page.handedOut ?? told.specimens[page.chosen]);
    page.practised = false;
    page.phase = "ready";
    stylus.position = 0;
    stylus.angle = upright;
    stylus.pointer = null;
    show();
  }

  // What comes next in the course, and what the last cut reached, in the language of the moment.
  function sayCourse() {
    const language = document.documentElement.lang, { handedOut, kept } = page;
    byId("course").textContent = handedOut?.error ?? handedOut?.ahead?.[language] ?? "";
    byId("ahead-words").textContent = kept?.ahead?.[language] ?? "";
    if (!kept) return;
    const saved = kept.score === null ? texts.saved_no_score : say(texts.saved, { score: fixed(kept.score, 0) });
    const passed = kept.passed === null ? "" : say(kept.passed ? texts.passed : texts.not_passed, { mark: kept.pass_mark });
    byId("kept").textContent = [saved, passed, kept.verdict[language]].filter(Boolean).join(" ");
  }

  async function start() {
    if (page.phase === "cutting" || page.phase === "countdown" || page.busy) return;
    if (page.phase === "ended") {
      page.busy = true;
      try { await prepare(); } finally { page.busy = false; }
      if (page.done || page.phase !== "ready") return;
    }
    if (told.served) ask("POST", `cuts/${page.handedOut.id}/begun`);
    page.phase = "countdown";
    page.from = performance.now();
    show();
    canvas.focus({ preventScroll: true });
    byId("stage").scrollIntoView({ block: "nearest" });
  }

  function finish(end) {
    page.cut.end ||= end;
    page.phase = "ended";
    page.points = told.served || page.cut.count < FEWEST ? null : taskPoints(page.cut, told);
    if (told.served) keep();
    if (platform?.open && !page.practised) platform.report(page.chosen, page.points && sum(page.points), page.cut.end !== "given up");
    show();
    byId("card").focus({ preventScroll: false });
  }

  const sum = points => points.reduce((total, each) => total + each.points, 0);

  function showPoints(points) {
    byId("points").hidden = !points.length;
    byId("points").replaceChildren(...points.map(({ part, points: gained, most }) =>
      row("td", texts[`part_${part}`] ?? part, say(texts.points_of, { value: fixed(gained, 0), most: fixed(most, 0) }))));
  }

  // What the learning platform was told, if the page lies in a package for one.
  function tellPlatform() {
    if (!told.platform) return;
    const line = byId("platform"), { mark } = told.platform, { best } = platform?.progress ?? {};
    if (!platform) line.textContent = texts.platform_none;
    else if (platform.refused || !platform.open) line.textContent = say(texts.platform_refused, { reason: platform.refused });
    else if (page.phase === "ended" && page.practised) line.textContent = texts.platform_practice;
    else {
      const known = say(best === null ? texts.platform_ready : texts.platform,
        { best: fixed(best ?? 0, 1), done: platform.done, all: told.specimens.length });
      const passed = platform.status === "passed" ? texts.platform_passed : say(texts.platform_mark, { mark: fixed(mark ?? 0, Number.isInteger(mark) ? 0 : 1) });
      line.textContent = mark === null ? known : `${known} ${passed}`;
    }
  }

  // The server

  async function ask(method, path, body, headers = {}) {
    try {
      const answer = await fetch(path, { method, body, headers });
      return { ...await answer.json(), status: answer.status };
    } catch (error) {
      return { error: String(error.message ?? error), status: 0 };
    }
  }

  // Send the movements of the hand; the server repeats the cut, and keeps it if its law finds these readings.
  async function keep() {
    const { cut, handedOut } = page, movements = new Float64Array(cut.inputs.flat());
    page.kept = null;
    if (cut.count < FEWEST) { byId("kept").textContent = ""; return; }
    page.busy = true;
    show();
    byId("kept").textContent = texts.saving;
    showPoints([]);
    const digest = crc32(cut.bytes());
    const said = await ask("POST", `cuts/${handedOut.id}`, movements, { "X-Readings": digest, "X-Stalled": String(cut.stalled) });
    page.busy = false;
    if (said.error) {
      byId("kept").textContent = say(texts.unsaved, { reason: said.error });
      const again = element("button", texts.retry);
      again.addEventListener("click", keep);
      if (said.status === 0 || said.status >= 500) byId("kept").append(" ", again);
    } else {
      page.kept = said;
      sayCourse();
      showPoints(said.points);
    }
    await tellHistory();
    show();
  }

  async function tellHistory() {
    const cuts = await ask("GET", "cuts");
    const rows = Object.values(cuts).filter(each => each?.state && each.state !== "prepared").reverse().map(({ when, state, outcome, score }) =>
      row("td", new Date(when).toLocaleString(document.documentElement.lang),
        [state !== "saved" && texts[`state_${state}`], outcome].filter(Boolean).join(": "), score ?? "–"));
    byId("history").replaceChildren(row("th", texts.when, texts.outcome, texts.score), ...rows);
    byId("curve").innerHTML = (await ask("GET", "curve")).curve ?? "";
    byId("curve").firstChild?.setAttribute("aria-label", texts.curve);
  }

  // What a course's rule shows of the force now, as cutenv.play.course.shown_feedback.
  function shown() {
    const rule = page.handedOut?.feedback ?? "always", ended = page.phase === "ended", { cut } = page;
    const costs = cut.last("force") > told.force_allowed_per_depth * cut.depthAt(cut.depth, cut.blade);
    const after = ended && rule !== "never", whole = rule === "always" || after;
    return { force: whole || (rule === "above-limit" && costs), trace: whole, result: after || !ended };
  }

  // Once for each picture: the milliseconds that are due, under where the hand is now.
  function frame(now) {
    if (page.phase === "countdown" && now - page.from >= 1500) {
      page.phase = "cutting";
      page.from = now;
      page.given = 0;
      show();
    }
    if (page.phase === "cutting") {
      let due = Math.floor(now - page.from) - page.given;
      if (due > MOST_MILLISECONDS) { // time beyond it is lost to the cut, and the record says so
        page.cut.stalled += (due - MOST_MILLISECONDS) / 1e3;
        page.from += due - MOST_MILLISECONDS;
        due = MOST_MILLISECONDS;
      }
      moveByKeys(due);
      moveByGamepad(due);
      stylus.position = within(within(stylus.position, page.cut.hand - told.lead, page.cut.hand + told.lead), 0, told.travel);
      page.practised ||= practising();
      if (due > 0) {
        page.cut.advance(Array.from({ length: due }, () => [stylus.position, stylus.angle]));
        page.given += due;
      }
      if (page.cut.end) finish(page.cut.end);
    }
    paint();
    if (page.phase !== "ended") tell();
    requestAnimationFrame(frame);
  }

  // Draw, unless the picture would be the same: that would cost a tablet its battery.
  function paint() {
    const seen = shown(), showTip = practising() || (page.phase === "ended" && seen.result);
    const looks = [page.cut.count, showTip, page.phase, document.documentElement.lang, drawing.looks()].join();
    if (page.cut !== page.drawn || looks !== page.looks) drawing.draw(page.cut, { texts, seen, showTip });
    [page.drawn, page.looks] = [page.cut, looks];
  }

  for (const [name, printed] of [["beforeprint", true], ["afterprint", false]]) {
    addEventListener(name, () => {
      document.documentElement.classList.toggle("printed", printed); // on paper everything is light
      drawing.readColours();
      if (page.cut) paint();
    });
  }

  // Words and numbers beside the picture

  const practising = () => byId("practice")?.checked ?? false;

  function show() {
    const { cut } = page, at = page.phase;
    byId("start").disabled = Boolean(page.busy || page.done);
    if (page.done) byId("card").hidden = true;
    if (!cut) return;
    byId("task").textContent = say(texts.task, { target: fixed(1e3 * cut.target, 1) });
    byId("start").hidden = at === "cutting" || at === "countdown";
    byId("start").textContent = at === "ended" ? texts.again : texts.start;
    if (told.served) byId("start").textContent = at === "ended" ? texts.next : texts.start;
    byId("next").hidden = at !== "ended" || Boolean(told.served);
    byId("stop").hidden = at !== "cutting";
    for (const name of ["specimen", "language"]) {
      if (byId(name)) byId(name).disabled = at === "cutting" || at === "countdown";
    }
    byId("card").hidden = at !== "ended";
    byId("advice").hidden = at === "ended";
    tell();
    tellPlatform();
    if (at !== "ended") return;
    const found = cut.numbers(), millimetres = value => fixed(1e3 * Math.abs(value), 1);
    const off = say(found.off > 0 ? texts.beyond : texts.short, { value: millimetres(apart(found.off)) });
    byId("verdict").textContent = verdict(cut, found, millimetres);
    byId("card").className = cut.success ? "card good" : "card bad";
    const reward = law.numbers("episode", "totals", told.terms.length).reduce((sum, term) => sum + term, 0);
    const scored = page.points ? [[texts.score, say(texts.points_of, { value: fixed(sum(page.points), told.platform ? 1 : 0), most: 100 })]] : [];
    const rows = [...scored, [texts.result_off, off], [texts.result_peak, `${fixed(found.peak, 1)} N`],
      [texts.result_longest, `${millimetres(found.longest)} mm`], [texts.result_time, `${fixed(found.time, 1)} s`],
      [texts.result_return, fixed(reward, 2)]];
    const toldRows = shown().result ? rows : [];
    if (!shown().result) byId("verdict").textContent = texts.ended;
    byId("results").replaceChildren(...toldRows.flatMap(([name, value]) => [element("dt", name), element("dd", value)]));
    if (!told.served) showPoints(page.points ?? []);
    byId("practised").hidden = !page.practised;
    if (byId("save")) byId("save").disabled = cut.count < FEWEST;
  }

  // A tip that missed the target is not rounded to one that did not.
  const apart = off => Math.abs(off) > told.tip_tolerance ? Math.max(Math.abs(off), told.tip_tolerance + 1e-4) : off;

  function verdict(cut, found, millimetres) {
    if (cut.end !== "finished") return texts[`end_${cut.end}`];
    if (cut.success) return texts.end_finished_success;
    if (Math.abs(found.off) > told.tip_tolerance) {
      return say(texts.end_finished_off, { off: millimetres(apart(found.off)), tolerance: fixed(1e3 * told.tip_tolerance, 0) });
    }
    return say(texts.end_finished_tilted, { angle: fixed(cut.angle * 180 / Math.PI, 0) });
  }

  // Only what has changed: a text that is written anew is laid out anew.
  function put(name, text) {
    if (byId(name).textContent !== text) byId(name).textContent = text;
  }

  function tell() {
    const { cut } = page, force = cut.last("force"), depth = cut.depthAt(cut.depth, cut.blade);
    const limit = cut.limitPerDepth * depth, distance = 1e3 * (cut.target - cut.blade);
    const seen = shown().force;
    put("force", seen ? `${fixed(force, 1)} N` : "–");
    byId("bar").style.width = seen ? `${100 * within(Math.abs(force) / limit, 0, 1)}%` : "0";
    byId("bar").className = force > told.force_allowed_per_depth * depth ? "costs" : "";
    for (const name of ["costs", "costs-word"]) byId(name).style.left = `${100 * told.force_allowed_per_depth / cut.limitPerDepth}%`;
    put("distance", `${fixed(distance, 1)} mm`);
    put("ahead", `${fixed(1e3 * (cut.hand - cut.blade), 1)} mm`);
    put("speed", `${fixed(1e2 * cut.last("speed"), 1)} cm/s`);
    put("angle", say(texts.degrees, { value: fixed(cut.angle * 180 / Math.PI, 0) }));
    put("time", say(texts.of, { value: fixed(cut.last("time"), 1), most: fixed(cut.deadline, 0) }));
    byId("tilt").value = Math.round(stylus.angle * 180 / Math.PI);
    put("countdown", page.phase === "countdown" ? String(Math.max(1, Math.ceil((1500 - (performance.now() - page.from)) / 500))) : "");
    put("missing", page.phase === "cutting" ? missing(cut, force) : "");
    canvas.setAttribute("aria-label", say(texts.picture, { force: seen ? fixed(force, 1) : "–", distance: fixed(distance, 0) }));
  }

  // What is still missing to finish, once the blade has come near the target; from what a rig measures, too.
  function missing(cut, force) {
    const progress = name => law.number("episode", `progresses.${name}`);
    if (!cut.count || progress("furthest") < cut.target - told.near_target) return "";
    if (Math.abs(upright - cut.angle) > told.angle_tolerance) return say(texts.missing_upright, { angle: fixed(cut.angle * 180 / Math.PI, 0) });
    const rested = progress("quiet");
    if (rested > 0) return say(texts.missing_still, { time: fixed(Math.max(told.time_at_rest - rested, 0), 1) });
    return say(texts.missing_back, { force: shown().force ? fixed(Math.max(force, 0), 1) : "…" });
  }

  // The hand: pointer, wheel, keys, gamepad, slider

  function move(distance) { stylus.position = within(stylus.position + distance, 0, told.travel); }
  function tilt(by) { stylus.angle = within(stylus.angle + by, told.inclined, upright); }

  canvas.addEventListener("pointermove", event => {
    if (page.phase === "cutting" && stylus.pointer?.id === event.pointerId) {
      move((event.clientX - stylus.pointer.x) / drawing.scale);
      if (event.pointerType === "pen" && (event.tiltX || event.tiltY)) {
        stylus.angle = within(upright - Math.hypot(event.tiltX, event.tiltY) * Math.PI / 180, told.inclined, upright);
      }
    }
    if (event.pointerType === "mouse" || event.buttons) stylus.pointer = { id: event.pointerId, x: event.clientX };
  });
  canvas.addEventListener("pointerdown", event => {
    stylus.pointer = { id: event.pointerId, x: event.clientX };
    canvas.setPointerCapture(event.pointerId);
  });
  for (const name of ["pointerup", "pointerleave", "pointercancel"]) {
    canvas.addEventListener(name, () => { stylus.pointer = null; });
  }
  canvas.addEventListener("wheel", event => {
    if (page.phase !== "cutting") return;
    event.preventDefault();
    tilt(-Math.sign(event.deltaY) * told.notch);
  }, { passive: false });
  byId("tilt").addEventListener("input", event => { stylus.angle = within(event.target.value * Math.PI / 180, told.inclined, upright); });

  const KEYS = { ArrowRight: 1, ArrowLeft: -1 };
  canvas.addEventListener("keydown", event => {
    if (event.key === " ") { event.preventDefault(); start(); return; }
    if (page.phase !== "cutting") return;
    if (event.key in KEYS) stylus.keys.add(event.key);
    else if (event.key === "ArrowUp") tilt(told.notch);
    else if (event.key === "ArrowDown") tilt(-told.notch);
    else return;
    stylus.slowly = event.shiftKey;
    event.preventDefault();
  });
  canvas.addEventListener("keyup", event => {
    stylus.keys.delete(event.key);
    stylus.slowly = event.shiftKey;
  });
  canvas.addEventListener("blur", () => stylus.keys.clear());

  function moveByKeys(milliseconds) {
    const speed = stylus.slowly ? 0.003 : 0.015; // m/s
    for (const key of stylus.keys) move(KEYS[key] * speed * milliseconds / 1e3);
  }

  function moveByGamepad(milliseconds) {
    for (const pad of navigator.getGamepads?.() ?? []) {
      if (!pad) continue;
      const push = Math.abs(pad.axes[0]) > 0.12 ? pad.axes[0] : 0;
      move(push * 0.0254 * milliseconds / 1e3);
      const pull = pad.buttons[7]?.value ?? 0;
      if (pull > 0.02) stylus.angle = upright - pull * (upright - told.inclined);
    }
  }

  // Buttons and choices

  byId("start").addEventListener("click", start);
  byId("next").addEventListener("click", async () => {
    page.chosen = (page.chosen + 1) % told.specimens.length;
    byId("specimen").value = page.chosen;
    await prepare();
    start();
  });
  byId("stop").addEventListener("click", () => finish("given up"));
  byId("specimen")?.addEventListener("change", event => { page.chosen = Number(event.target.value); prepare(); });
  byId("save")?.addEventListener("click", () => {
    const operator = byId("operator");
    if (!operator.reportValidity()) return;
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([page.cut.csv(operator.value, page.practised)], { type: "text/csv" }));
    link.download = `${page.cut.name}.csv`;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1e4);
  });
  byId("language").addEventListener("change", event => speak(event.target.value));

  function speak(language) {
    texts = told.texts[language];
    document.documentElement.lang = language;
    document.title = texts.title;
    for (const each of document.querySelectorAll("[data-text]")) each.textContent = texts[each.dataset.text];
    for (const each of document.querySelectorAll("[data-label]")) each.setAttribute("aria-label", texts[each.dataset.label]);
    byId("language").value = language;
    if (told.served) { tellHistory(); sayCourse(); }
    if (page.cut) show();
    if (told.served) return;
    byId("operator").title = texts.bad_operator;
    byId("specimen").replaceChildren(...told.specimens.map(({ specimen_class: kind, episode }, k) => {
      const option = element("option", `${texts[`class_${kind}`]}, ${say(texts.number, { number: episode + 1 })}`);
      option.value = k;
      return option;
    }));
    byId("specimen").value = page.chosen;
  }

  byId("language").replaceChildren(...Object.entries(told.texts).map(([code, each]) => {
    const option = element("option", each.language_name);
    option.value = code;
    return option;
  }));
  const api = told.platform && Platform.find();
  const platform = api && new Platform(api, told.specimens.length, told.platform.mark);
  if (platform) {
    page.chosen = platform.next;
    addEventListener("pagehide", () => platform.leave());
    addEventListener("pageshow", event => { if (event.persisted) location.reload(); }); // its session has ended
  }
  const wanted = navigator.language?.slice(0, 2);
  await prepare();
  speak(told.language === "en" && wanted in told.texts ? wanted : told.language);
  if (page.cut) requestAnimationFrame(frame);
  window.cutenvPage = { page, stylus, law, start, told, drawing }; // for tests, and for whoever looks inside
})();
