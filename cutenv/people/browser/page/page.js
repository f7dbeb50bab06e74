// The page: choice of the specimen, the person's hand, the clock of a cut, and what is said of it.

(async () => {
  const byId = name => document.getElementById(name);
  const told = JSON.parse(byId("data").textContent);
  const canvas = byId("picture");
  let texts = told.texts[told.language];
  const laws = {};
  try {
    for (const task of Object.keys(told.tasks)) laws[task] = await Law.load(byId(`law-${task}`).textContent.trim(), told, task);
  } catch (error) {
    byId("trouble").hidden = false;
    throw error;
  }
  const drawing = new Drawing(canvas, told);
  const FEWEST = 100; // ms that make a cut a record

  const page = { phase: "ready", chosen: 0, cut: null, practised: false, from: 0, given: 0 };
  const stylus = new Stylus(told);
  const aids = new ForceAids(byId("sound"), byId("vibration"), stylus);

  // A server hands out each specimen, and says what is shown of the force; the page alone has its own.
  async function prepare() {
    if (told.served) {
      const handedOut = await ask("POST", "cuts");
      if (handedOut.status === 401) location.assign("."); // nobody was seen here for long
      page.done = !handedOut.records;
      if (page.done && page.kept) { // its card stays
        byId("course").textContent = reason(handedOut) ?? handedOut.ahead?.[document.documentElement.lang] ?? "";
        return;
      }
      page.handedOut = handedOut;
      page.kept = null;
      sayCourse();
      if (page.done) { show(); return; }
    }
    const specimen = page.handedOut ?? told.specimens[page.chosen];
    page.cut = new HandCut(laws[specimen.task], specimen);
    page.practised = false;
    page.phase = "ready";
    stylus.rest(specimen.task);
    show();
  }

  // Date and time as nobody mistakes them: 28 Nov 2026, 10:11.
  const moment = when => new Date(when).toLocaleString(document.documentElement.lang === "en" ? "en-GB" : document.documentElement.lang,
    { dateStyle: "medium", timeStyle: "short" });

  // Replay

  const replayLaws = {}; // apart from those of the cut whose card stands beside

  // Watch a cut again: its specimen, the movements of its hand, and an expert's way or null, with who that is.
  async function watch(specimen, movements, expert, by) {
    const { task } = specimen;
    replayLaws[task] ??= await Law.load(byId(`law-${task}`).textContent.trim(), told, task);
    page.replay = new Replay(replayLaws[task], specimen, movements, expert);
    page.expertBy = by;
    page.replay.pace = Number(byId("pace").value);
    page.last = performance.now();
    show();
    byId("stage").scrollIntoView({ block: "nearest" });
    byId("play").focus({ preventScroll: true });
  }

  async function watchAgain(number) {
    const { cut } = page;
    if (!told.served) { await watch(cut.specimen, cut.inputs, cut.specimen.expert ?? null, cut.specimen.expertBy ?? "planner"); return; }
    const found = await ask("GET", `cuts/${number}/replay`);
    if (!found.error) await watch(found.specimen, fromRuns(found.movements), found.expert, found.by);
    else if (number === page.handedOut?.id) await watch(cut.specimen, cut.inputs, null, ""); // the server is away
    else byId("course").textContent = reason(found);
  }

  // The cut that a course shows before a person's first one.
  async function demonstrate() {
    byId("course").textContent = texts.demonstration_loads;
    const found = await ask("GET", "demonstration");
    if (page.phase !== "ready") return; // the person has not waited
    sayCourse();
    if (found.error) { byId("course").textContent = reason(found); return; }
    await watch(found.specimen, fromRuns(found.movements), found.expert, found.by);
    page.demonstrates = true;
    tellReplay();
  }

  function endReplay() {
    page.replay = null;
    page.demonstrates = false;
    show();
    byId(byId("watch").checkVisibility?.() === false ? "start" : "watch").focus({ preventScroll: true });
  }

  function tellReplay() {
    const { replay } = page, text = replay.playing ? texts.pause : texts.play;
    put("play", text);
    byId("moment").max = Math.ceil(replay.lasts / 20) * 20;
    byId("moment").value = replay.passed;
    byId("moment").setAttribute("aria-valuetext", `${fixed(replay.passed / 1e3, 1)} s`);
    put("end-replay", page.demonstrates ? texts.end_demonstration : texts.end_replay);
    const head = row("th", "", page.demonstrates ? texts.shown_cut : texts.this_cut, ...replay.expert ? [texts[`by_${page.expertBy}`]] : []);
    byId("compared").replaceChildren(head, ...replay.rows(texts).map(cells => row("td", ...cells)));
    for (const each of byId("compared").rows) each.cells[2]?.classList.add("expert");
    put("expert-words", replay.expert ? texts[`note_${page.expertBy}`] : texts.note_nobody);
  }

  byId("show-first")?.addEventListener("click", demonstrate);
  byId("watch").addEventListener("click", () => watchAgain(page.handedOut?.id));
  byId("play").addEventListener("click", () => {
    const { replay } = page;
    if (!replay.playing && replay.passed >= replay.lasts) replay.seek(0);
    replay.playing = !replay.playing;
    tellReplay();
  });
  byId("end-replay").addEventListener("click", endReplay);
  byId("pace").addEventListener("change", event => { page.replay.pace = Number(event.target.value); });
  byId("moment").addEventListener("input", event => {
    page.replay.playing = false;
    page.replay.seek(Number(event.target.value));
    tellReplay();
  });

  // What comes next in the course, and what the last cut reached, in the language of the moment.
  function sayCourse() {
    const language = document.documentElement.lang, { handedOut, kept } = page;
    byId("course").textContent = handedOut?.error ? reason(handedOut) : (kept ?? handedOut)?.ahead?.[language] ?? "";
    byId("ahead-words").textContent = kept?.ahead?.[language] ?? "";
    byId("tries").replaceChildren();
    byId("tries-head").hidden = !kept?.advice.length;
    if (!kept) return;
    byId("tries").append(...kept.advice.map(({ try: next, seen }) =>
      element("li", [next[language], seen[language] && `(${seen[language]})`].filter(Boolean).join(" "))));
    const saved = kept.score === null ? texts.saved_no_score : say(texts.saved, { score: fixed(kept.score, 0) });
    const passed = kept.passed === null ? "" : say(kept.passed ? texts.passed : texts.not_passed, { mark: kept.pass_mark.toLocaleString(language) });
    byId("kept").textContent = [saved, kept.why?.[language], passed, kept.verdict[language]].filter(Boolean).join(" ");
  }

  async function start() {
    if (page.phase === "cutting" || page.phase === "countdown" || page.busy) return;
    page.replay = null;
    page.demonstrates = false;
    if (page.phase === "ended") {
      page.busy = true;
      try { await prepare(); } finally { page.busy = false; }
      if (page.done || page.phase !== "ready") { show(); return; }
    }
    if (told.served && !await begun()) return;
    page.phase = "countdown";
    page.from = performance.now();
    show();
    canvas.focus({ preventScroll: true });
    byId("stage").scrollIntoView({ block: "nearest" });
  }

  // A cut counts from its beginning on: it cannot begin unless the server knows it.
  async function begun() {
    page.busy = true;
    const said = await ask("POST", `cuts/${page.handedOut.id}/begun`);
    page.busy = false;
    if (said.status === 401) location.assign(".");
    if (said.error) byId("course").textContent = say(texts.not_begun, { reason: reason(said) });
    if (said.status === 409) { await prepare(); byId("course").textContent = say(texts.not_begun, { reason: texts.another_specimen }); }
    return !said.error;
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

  // Why the server refuses, in the language of the moment; of a lost connection the browser's own words.
  const reason = said => said.said?.[document.documentElement.lang] ?? said.error;

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
    const said = await ask("POST", `cuts/${handedOut.id}`, movements, { "X-Readings": digest, "X-Stalled": String(cut.stalled), "X-Aids": [...cut.aids].join() });
    page.busy = false;
    if (said.error) {
      byId("kept").textContent = say(texts.unsaved, { reason: reason(said) });
      const again = element("button", texts.retry);
      again.addEventListener("click", keep);
      if (said.status === 0 || said.status === 401 || said.status >= 500) byId("kept").append(" ", again);
    } else {
      page.kept = said;
      sayCourse();
      showPoints(said.points);
    }
    show();
    await tellHistory();
  }

  async function tellHistory() {
    const cuts = await ask("GET", "cuts");
    const rows = Object.values(cuts).filter(each => each?.state && !["prepared", "taken back"].includes(each.state)).reverse().map(({ id, when, state, outcome, score, stalled, replay, warm_up }) => {
      const made = row("td", moment(when),
        [warm_up && texts.warm_up, state !== "saved" && texts[`state_${state}`], outcome?.[document.documentElement.lang], stalled >= 0.5 && say(texts.stalled, { time: fixed(stalled, 1) })].filter(Boolean).join(": "), score ?? "–", "");
      if (!replay) return made;
      const button = element("button", texts.watch_short);
      button.setAttribute("aria-label", `${texts.watch_short}: ${moment(when)}`);
      button.addEventListener("click", () => { if (page.phase !== "cutting" && page.phase !== "countdown") watchAgain(id); });
      made.lastChild.append(button);
      return made;
    });
    byId("history").replaceChildren(row("th", texts.when, texts.outcome, texts.score, ""), ...rows);
    const comments = await ask("GET", "comments");
    byId("comments").replaceChildren(...Object.values(comments).filter(each => each?.said).map(({ when, said }) =>
      element("li", say(texts.comment, { said, when: moment(when) }))));
    byId("curve").innerHTML = (await ask("GET", "curve")).curve ?? "";
    byId("curve").firstChild?.setAttribute("aria-label", texts.curve);
  }

  // What a course's rule shows of the force now, as cutenv.people.play.course.shown_feedback.
  function shown() {
    if (page.replay) return { force: true, trace: true, result: true };
    const rule = page.handedOut?.feedback ?? "always", ended = page.phase === "ended", { cut } = page;
    const costs = cut.last("force") > told.force_allowed_per_depth * cut.engaged;
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
      stylus.advance(due, page.cut.path?.hand ?? [page.cut.hand, 0]);
      page.practised ||= practising();
      for (const name of aids.names) page.cut.aids.add(name);
      if (due > 0) {
        page.cut.advance(Array.from({ length: due }, () => stylus.numbers));
        page.given += due;
      }
      if (page.cut.end) finish(page.cut.end);
    }
    if (page.replay?.playing) {
      page.replay.advance(now - page.last);
      tell();
      tellReplay();
    }
    page.last = now;
    aids.tell(partOfLimit(), now);
    tellSerial(now);
    paint();
    const state = [page.cut.count, page.cut.hand, page.phase, stylus.angle, stylus.level, seconds(), document.documentElement.lang].join();
    if (page.phase !== "ended" && (page.cut !== page.described || state !== page.state)) tell();
    [page.described, page.state] = [page.cut, state];
    requestAnimationFrame(frame);
  }

  // The force as a part of its limit, while a cut is made or watched and the force is shown; else null.
  function partOfLimit() {
    const cut = page.replay?.cut ?? page.cut, moves = page.replay ? page.replay.playing : page.phase === "cutting";
    return moves && shown().force ? within(cut.last("force") / (cut.limitPerDepth * cut.engaged), 0, 1) : null;
  }

  // What the countdown shows.
  const seconds = () => page.phase === "countdown" ? String(Math.max(1, Math.ceil((1500 - (performance.now() - page.from)) / 500))) : "";

  // Draw, unless the picture would be the same: that would cost a tablet its battery.
  function paint() {
    const seen = shown(), { replay } = page, cut = replay?.cut ?? page.cut;
    const showTip = practising() || Boolean(replay) || (page.phase === "ended" && seen.result);
    const beside = replay?.expert && { way: replay.expert, time: replay.passed / 1e3 };
    const looks = [cut.count, beside?.time, showTip, page.phase, document.documentElement.lang, drawing.looks()].join();
    if (cut !== page.drawn || looks !== page.looks) drawing.draw(cut, { texts, seen, showTip, beside });
    [page.drawn, page.looks] = [cut, looks];
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
    const { task } = cut.specimen, named = name => `${name}_${task}` in texts ? `${name}_${task}` : name;
    byId("task").textContent = say(texts[named("task")], { target: fixed(1e3 * cut.target, 1) });
    document.body.dataset.task = (page.replay?.cut ?? cut).specimen.task;
    document.body.dataset.phase = page.replay ? "replay" : at;
    byId("replay").hidden = !page.replay;
    byId("watch-line").hidden = !mayWatch();
    if (byId("show-first")) byId("show-first").hidden = at !== "ready" || !page.handedOut?.demonstration || Boolean(page.replay);
    if (page.replay) tellReplay();
    for (const name of ["help", "advice", "result_note"]) {
      if (!byId(name)) continue;
      byId(name).dataset.text = named(name);
      byId(name).textContent = texts[byId(name).dataset.text];
    }
    byId("start").hidden = at === "cutting" || at === "countdown";
    byId("start").textContent = at === "ended" ? texts.again : texts.start;
    if (told.served) byId("start").textContent = at === "ended" ? texts.next : texts.start;
    byId("next").hidden = at !== "ended" || Boolean(told.served);
    byId("stop").hidden = at !== "cutting";
    for (const name of ["specimen", "language"]) {
      if (byId(name)) byId(name).disabled = at === "cutting" || at === "countdown";
    }
    byId("card").hidden = at !== "ended" || Boolean(page.replay);
    byId("advice").hidden = at === "ended";
    tell();
    tellPlatform();
    if (at !== "ended") return;
    const found = cut.numbers(), millimetres = value => fixed(1e3 * Math.abs(value), 1);
    const off = say(found.off > 0 ? texts.beyond : texts.short, { value: millimetres(apart(found.off)) });
    byId("verdict").textContent = verdict(cut, found, millimetres);
    byId("card").className = cut.success ? "card good" : "card bad";
    const scored = page.points ? [[texts.score, say(texts.points_of, { value: fixed(sum(page.points), told.platform ? 1 : 0), most: 100 })]] : [];
    const { peak_force: peak = found.peak, largest_jump: longest = found.longest, duration = found.time } = page.kept?.numbers ?? {};
    const rows = [...scored, [texts.result_off, off], [texts.result_peak, `${fixed(peak, 1)} N`],
      [texts.result_longest, `${millimetres(longest)} mm`], [texts.result_time, `${fixed(duration, 1)} s`],
      ...depthRows(cut), ...pathRows(cut)];
    const toldRows = mayTell() && !(told.served && page.busy) ? rows : []; // the server's numbers, once they are there
    if (!mayTell()) byId("verdict").textContent = texts.ended;
    byId("results").replaceChildren(...toldRows.flatMap(([name, value]) => [element("dt", name), element("dd", value)]));
    if (!told.served) showPoints(page.points ?? []);
    byId("practised").hidden = !page.practised;
    if (byId("save")) byId("save").disabled = cut.count < FEWEST;
  }

  const mayTell = () => page.handedOut?.feedback !== "never" || !told.served;

  // Once it is kept, or without a server: of a task that hides the force, nothing is watched.
  const mayWatch = () => page.phase === "ended" && mayTell() && page.cut.count >= FEWEST && (!told.served || Boolean(page.kept));

  function depthRows(cut) {
    if (!cut.deep) return [];
    const { mean_error_mm: mean, layer_mm: opened, too_deep_mm2: below, uncut_mm2: above } = cut.deep.errors(cut.target);
    return [[texts.result_depth, `${fixed(mean, 1)} mm`], [texts.result_layer, opened > 0 ? `${fixed(opened, 1)} mm` : texts.not_opened],
      [texts.result_too_deep, `${fixed(below, 0)} mm²`], [texts.result_uncut, `${fixed(above, 0)} mm²`]];
  }

  function pathRows(cut) {
    if (!cut.path) return [];
    const { area_mm2: area, largest_distance_mm: farthest } = cut.path.errors;
    const aside = cut.columns.lateral_force.reduce((most, force) => Math.max(most, Math.abs(force)), 0);
    return [[texts.result_path, `${fixed(1e3 * cut.path.mean(cut.target), 1)} mm`], [texts.result_farthest, `${fixed(farthest, 1)} mm`],
      [texts.result_area, `${fixed(area, 0)} mm²`], [texts.result_lateral, `${fixed(aside, 1)} N`]];
  }

  // A tip that missed the target is not rounded to one that did not.
  const apart = off => Math.abs(off) > told.tip_tolerance ? Math.max(Math.abs(off), told.tip_tolerance + 1e-4) : off;

  function verdict(cut, found, millimetres) {
    if (cut.end !== "finished") return texts[`end_${cut.end}`];
    if (cut.success) return texts.end_finished_success;
    if (Math.abs(found.off) > told.tip_tolerance) {
      return say(texts.end_finished_off, { off: millimetres(apart(found.off)), tolerance: fixed(1e3 * told.tip_tolerance, 0) });
    }
    if (cut.deep && Math.abs(UPRIGHT - cut.angle) <= told.angle_tolerance) {
      const { mean_error_mm: mean, layer_mm: opened } = cut.deep.errors(cut.target), allowed = 1e3 * told.layer_tolerance;
      return opened > allowed ? say(texts.end_finished_layer, { opened: fixed(Math.max(opened, allowed + 0.1), 1) })
        : say(texts.end_finished_depth, { mean: fixed(Math.max(mean, 1e3 * told.depth_tolerance + 0.1), 1), tolerance: fixed(1e3 * told.depth_tolerance, 1) });
    }
    if (cut.path && Math.abs(UPRIGHT - cut.angle) <= told.angle_tolerance) {
      const mean = cut.path.mean(cut.target), missed = mean > told.line_tolerance;
      const [name, off, allowed] = missed ? ["path", mean, told.line_tolerance] : ["farthest", cut.path.farthest, told.farthest_tolerance];
      return say(texts[`end_finished_${name}`], { off: fixed(1e3 * Math.max(off, allowed + 1e-4), 1), tolerance: fixed(1e3 * allowed, 0) });
    }
    return say(texts.end_finished_tilted, { angle: fixed(cut.angle * 180 / Math.PI, 0) });
  }

  // Only what has changed: a text that is written anew is laid out anew.
  function put(name, text) {
    if (byId(name).textContent !== text) byId(name).textContent = text;
  }

  function tell() {
    const cut = page.replay?.cut ?? page.cut, force = cut.last("force"), depth = cut.engaged;
    const limit = cut.limitPerDepth * depth, distance = 1e3 * (cut.target - cut.blade);
    const seen = shown().force;
    put("force", seen ? `${fixed(force, 1)} N` : "–");
    byId("bar").style.width = seen ? `${100 * within(Math.abs(force) / limit, 0, 1)}%` : "0";
    byId("bar").className = force > told.force_allowed_per_depth * depth ? "costs" : "";
    for (const name of ["costs", "costs-word"]) byId(name).style.left = `${100 * told.force_allowed_per_depth / cut.limitPerDepth}%`;
    put("distance", `${fixed(distance, 1)} mm`);
    if (cut.deep) put("below", signed(1e3 * (cut.depthAt(cut.deep.wanted, cut.blade) - cut.deep.level)));
    if (cut.path) {
      put("aside", signed(1e3 * cut.path.aside));
      put("lateral", seen ? `${fixed(cut.last("lateral_force"), 1)} N` : "–");
    }
    put("ahead", `${fixed(1e3 * (cut.hand - cut.blade), 1)} mm`);
    put("speed", `${fixed(1e2 * cut.last("speed"), 1)} cm/s`);
    put("angle", say(texts.degrees, { value: fixed(cut.angle * 180 / Math.PI, 0) }));
    put("time", say(texts.of, { value: fixed(cut.last("time"), 1), most: fixed(cut.deadline, 0) }));
    byId("tilt").value = Math.round(stylus.angle * 180 / Math.PI);
    byId("level").value = 1e3 * stylus.level;
    put("countdown", seconds());
    put("missing", page.phase === "cutting" ? missing(cut, force) : "");
    canvas.setAttribute("aria-label", say(texts.picture, { force: seen ? fixed(force, 1) : "–", distance: fixed(distance, 0) }));
  }

  // What the handle on a serial port does.
  function tellSerial(now) {
    const { serial } = stylus;
    put("serial-connect", serial.open ? texts.serial_disconnect : texts.serial_connect);
    if (!serial.open) put("serial-said", serial.trouble && say(texts.serial_lost, { reason: serial.trouble }));
    else if (serial.silent(now)) put("serial-said", texts.serial_silent);
    else if (serial.resting) put("serial-said", texts.serial_resting);
    else put("serial-said", say(texts.serial_push, { percent: fixed(100 * serial.push(now), 0) }));
  }

  const signed = value => `${value >= 0.05 ? "+" : ""}${fixed(value, 1)} mm`;

  // What is still missing to finish, once the blade has come near the target; from what a rig measures, too.
  function missing(cut, force) {
    const progress = name => cut.law.number("episode", `progresses.${name}`);
    if (!cut.count || progress("furthest") < cut.target - told.near_target) return "";
    if (Math.abs(UPRIGHT - cut.angle) > told.angle_tolerance) return say(texts.missing_upright, { angle: fixed(cut.angle * 180 / Math.PI, 0) });
    const rested = progress("quiet");
    if (rested > 0) return say(texts.missing_still, { time: fixed(Math.max(told.time_at_rest - rested, 0), 1) });
    return say(texts.missing_back, { force: shown().force ? fixed(Math.max(force, 0), 1) : "…" });
  }

  stylus.listen(canvas, { cutting: () => page.phase === "cutting", scale: () => drawing.scale, start }, byId("tilt"), byId("level"));

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
  byId("left-hand").addEventListener("change", event => {
    stylus.left = event.target.checked;
    document.body.dataset.hand = stylus.left ? "left" : "right";
  });
  byId("pen-tilts").addEventListener("change", event => { stylus.penTilts = event.target.checked; });
  byId("serial").hidden = !("serial" in navigator);
  byId("serial-connect").addEventListener("click", () => stylus.serial.open ? stylus.serial.disconnect() : stylus.serial.connect());
  byId("serial-full").addEventListener("input", event => { stylus.serial.full = Number(event.target.value) || 1; });
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
    byId("specimen").replaceChildren(...told.specimens.map(({ task, line, specimen_class: kind, episode }, k) => {
      const called = `${texts[`class_${kind}`]}, ${say(texts.number, { number: episode + 1 })}`;
      const along = texts[line ? `along_${line}` : `along_${task}`];
      const option = element("option", along ? say(along, { specimen: called }) : called);
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
  const wanted = [navigator.language, navigator.language?.slice(0, 2)].find(each => each in told.texts);
  await prepare();
  speak(told.language === "en" && wanted ? wanted : told.language);
  if (page.cut) requestAnimationFrame(frame);
  if (page.handedOut?.demonstration) demonstrate();
  window.cutenvPage = { page, stylus, aids, laws, start, told, drawing }; // for tests, and for whoever looks inside
})();
