// Points of a cut that has ended: the definition of cutenv.scoring.points with the metrics that it needs, for the true
// tip. Numbers come from Python's definition (told.scoring); a test compares whole cuts.

function taskPoints(cut, told) {
  const { scoring } = told, { points, tissue } = scoring, metrics = metricsOf(cut, scoring);
  const share = value => Math.min(Math.max(value, 0), 1), { target, map } = cut, last = cut.last("tip");
  const farthest = cut.columns.tip.reduce((a, b) => Math.max(a, b), -Infinity) - target;
  const way = share(last / target);
  if (farthest > scoring.overshoot_allowed || metrics.peak_force_per_depth > scoring.force_limit_per_depth ||
      map?.beyond(scoring) || ["overshoot", "force_limit", "layer", "off_line"].includes(cut.end)) {
    return [{ part: "way", points: scoring.beyond_limit * points.way * way, most: points.way }];
  }
  const counts = way * (cut.success ? 1 : scoring.missed);
  const taken = tissue.reduce((sum, [name, free, all]) => sum + Math.max(metrics[name] - free, 0) / all, 0);
  const shares = {
    limits: 1, way, accuracy: Math.max(1 - Math.abs(last - target) / scoring.close, 0), success: cut.success ? 1 : 0,
    tissue: counts * share(1 - taken),
    steadiness: counts * (metrics.peak_force > 0 ? share(1 - metrics.force_rate / metrics.peak_force / scoring.restless) : 0),
    time: counts * share(1 - metrics.duration / scoring.deadline),
  };
  const gentle = map ? 1 - scoring.map_points / 100 : 1; // the depth, or the path, has the other points
  const parts = Object.entries(points).map(([part, most]) => ({ part, points: gentle * most * shares[part], most: gentle * most }));
  if (!map) return parts;
  const gained = scoring.map_points * counts * share(1 + map.costs / scoring.map_cost);
  return [...parts, { part: cut.specimen.task, points: gained, most: scoring.map_points }];
}

// The metrics by their names there; what is unavailable there is what the points take it for.
function metricsOf(cut, scoring) {
  const { time, force, position, tip, jump, height } = cut.columns, n = time.length, span = time[n - 1] - time[0];
  const half = Math.max(1, Math.round(scoring.speed_window * (n - 1) / span));
  const speed = time.map((_, i) => {
    const before = Math.max(i - half, 0), after = Math.min(i + half, n - 1);
    return (position[after] - position[before]) / (time[after] - time[before]);
  });
  const moving = i => Math.abs(speed[i]) > scoring.standstill;
  let first = 0, end = n - 1;
  while (first < n && !moving(first)) first += 1;
  while (end > first && !moving(end)) end -= 1;
  const duration = first < n ? time[end] - time[first] : scoring.deadline;

  const advancing = [];
  let reached = -Infinity, lag = 0, weight = 0, peak = 0, perDepth = 0;
  for (let i = 0; i < n; i++) {
    reached = Math.max(reached, position[i]);
    advancing.push(speed[i] > scoring.standstill && position[i] >= reached - 1e-4 ? 1 : 0);
    if (!advancing[i]) continue;
    const lasts = 0.5 * ((i < n - 1 ? time[i + 1] - time[i] : 0) + (i ? time[i] - time[i - 1] : 0));
    const flat = cut.depthAt(cut.measuredDepth, position[i]); // of a blade at height 0
    const depth = Math.max(cut.deep ? flat - height[i] : flat, scoring.shallowest);
    weight += lasts;
    lag += lasts * Math.max(position[i] - tip[i], 0);
    peak = Math.max(peak, force[i]);
    perDepth = Math.max(perDepth, force[i] / depth);
  }
  const run = jump.reduce((sum, each) => sum + each, 0), advance = tip[n - 1] - Math.min(tip[0], 0);
  return {
    duration, peak_force: peak, peak_force_per_depth: perDepth, mean_lag: weight ? lag / weight : 0,
    uncontrolled_share: advance < 1e-3 ? 0 : Math.min(run / advance, 1),
    largest_jump: jump.reduce((a, b) => Math.max(a, b), 0),
    force_rate: forceRate(time, force, advancing, scoring),
  };
}

// Root mean square rate of the force below the scoring's bandwidth, while the blade advances.
function forceRate(time, force, advancing, { rate, shortest, filter }) {
  const n = time.length, count = Math.floor((time[n - 1] - time[0]) * rate + 1e-3);
  if (count < shortest) return 0;
  const impulse = [0];
  for (let i = 1; i < n; i++) impulse.push(impulse[i - 1] + 0.5 * (force[i] + force[i - 1]) * (time[i] - time[i - 1]));
  const borders = between(time, impulse, Array.from({ length: count + 1 }, (_, k) => time[0] + k / rate));
  const smooth = bothWays(borders.slice(1).map((value, k) => (value - borders[k]) * rate), filter);
  const counted = between(time, advancing, smooth.map((_, k) => time[0] + (k + 0.5) / rate));
  const rates = smooth.map((value, k) => k === 0 ? (smooth[1] - value) * rate
    : k === count - 1 ? (value - smooth[k - 1]) * rate : 0.5 * rate * (smooth[k + 1] - smooth[k - 1]));
  const chosen = rates.filter((_, k) => counted[k] > 0.5);
  return chosen.length ? Math.sqrt(chosen.reduce((sum, value) => sum + value * value, 0) / chosen.length) : 0;
}

// As numpy.interp, for places in order.
function between(places, values, wanted) {
  const last = places.length - 1;
  let i = 0;
  return wanted.map(place => {
    while (i < last - 1 && places[i + 1] <= place) i += 1;
    const share = (place - places[i]) / (places[i + 1] - places[i]);
    return values[i] + Math.min(Math.max(share, 0), 1) * (values[i + 1] - values[i]);
  });
}

// As scipy.signal.sosfiltfilt with one section: forward and backward over the values and their odd extension.
function bothWays(values, { section: [b0, b1, b2, , a1, a2], start, pad }) {
  const last = values.length - 1, ends = Array.from({ length: pad }, (_, k) => k + 1);
  const once = wide => {
    let [z0, z1] = start.map(each => each * wide[0]);
    return wide.map(x => {
      const y = b0 * x + z0;
      z0 = b1 * x - a1 * y + z1;
      z1 = b2 * x - a2 * y;
      return y;
    }).reverse();
  };
  const wide = [...ends.map(k => 2 * values[0] - values[k]).reverse(), ...values,
    ...ends.map(k => 2 * values[last] - values[last - k])];
  return once(once(wide)).slice(pad, pad + values.length);
}
