// A rig watched live: its state, its numbers, and the force of the last seconds. It only receives.

(() => {
  const SHOWN = 20, SILENT = 1.5; // s
  const LOW = -1, HIGH = 6; // N, at least
  const byId = name => document.getElementById(name);
  const words = JSON.parse(byId("words").textContent);
  const say = (text, values) => text.replace(/\{(\w+)\}/g, (_, name) => values[name]);
  const shown = (value, count) => value === null ? "–" : value.toLocaleString(document.documentElement.lang, { minimumFractionDigits: count, maximumFractionDigits: count });
  const units = { force_N: " N", position_mm: " mm", speed_mm_s: " mm/s", angle_deg: "°" };
  const colour = name => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  let kept = [], heard = 0;

  const source = new EventSource("rig/readings");
  source.addEventListener("message", event => {
    const message = JSON.parse(event.data), last = kept.at(-1);
    if (last && message.time_s < last.time_s - 0.5) kept = []; // another clock: the machine was started again
    kept = kept.filter(each => each.time_s > message.time_s - SHOWN);
    kept.push(message);
    heard = performance.now();
  });

  function pencil(canvas) {
    const ratio = devicePixelRatio || 1, { clientWidth: width, clientHeight: height } = canvas;
    if (canvas.width !== Math.round(width * ratio)) [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    pen.font = "13px system-ui, sans-serif";
    pen.fillStyle = colour("quiet");
    return { pen, width, height };
  }

  function line(pen, points, name, wide = 1) {
    pen.beginPath();
    points.forEach(([x, y], k) => k ? pen.lineTo(x, y) : pen.moveTo(x, y));
    pen.strokeStyle = colour(name);
    pen.lineWidth = wide;
    pen.stroke();
  }

  function drawForce(now) {
    const { pen, width, height } = pencil(byId("force")), forces = kept.filter(each => each.force_N !== null);
    const low = Math.min(LOW, ...forces.map(each => each.force_N)), high = Math.max(HIGH, ...forces.map(each => each.force_N));
    const limit = kept.at(-1).force_limit_N;
    const x = time => 34 + (width - 40) * (1 - (now - time) / SHOWN), y = force => 8 + (height - 16) * (high - force) / (high - low);
    for (let force = Math.ceil(low / 2) * 2; force <= high; force += 2) {
      line(pen, [[34, y(force)], [width, y(force)]], "rule");
      pen.fillText(shown(force || 0, 0), 6, y(force) + 4);
    }
    pen.textAlign = "right";
    pen.fillText(`${words.force} [N], ${SHOWN} s`, width - 6, 20);
    pen.textAlign = "left";
    if (limit !== null && limit < high * 1.5) {
      line(pen, [[34, y(limit)], [width, y(limit)]], "bad", 1.5);
      pen.fillText(words.limit, 38, y(limit) - 4);
    }
    line(pen, forces.map(each => [x(each.time_s), y(each.force_N)]), "accent", 2);
    byId("force").setAttribute("aria-label", say(words.rig_chart, { time: SHOWN, force: shown(kept.at(-1).force_N, 2) }));
  }

  function drawWay({ low_mm: low, high_mm: high, position_mm: position }) {
    const { pen, width } = pencil(byId("way"));
    if (low === null || high === null || !(high > low)) return;
    const x = value => 34 + (width - 68) * (value - low) / (high - low);
    line(pen, [[x(low), 16], [x(high), 16]], "quiet", 4);
    pen.textAlign = "center";
    for (const value of [low, high]) pen.fillText(`${shown(value, 0)} mm`, x(value), 42);
    if (position !== null) line(pen, [[x(position), 4], [x(position), 28]], "accent", 5);
    byId("way").setAttribute("aria-label", say(words.rig_travel, { low, high, position: shown(position, 1) }));
  }

  function tell(name, text) {
    if (byId(name).textContent !== text) byId(name).textContent = text; // a screen reader says what changes, once
  }

  function show() {
    requestAnimationFrame(show);
    const last = kept.at(-1), silent = (performance.now() - heard) / 1000;
    if (!last) return;
    tell("name", last.rig ? `: ${last.rig}` : "");
    const state = words[`rig_${last.phase}`] ?? last.phase;
    tell("state", silent > SILENT ? say(words.rig_silent, { time: Math.floor(silent / 5) * 5 || "1–5" }) : state);
    byId("state").className = last.phase === "stopped" ? "stopped" : "";
    tell("why", last.stop ?? "");
    for (const [name, unit] of Object.entries(units)) tell(name, shown(last[name], name === "angle_deg" ? 0 : 2) + unit);
    drawForce(last.time_s + Math.min(silent, SHOWN));
    drawWay(last);
  }
  show();
})();
