// Points of a cut that has ended: the definition of cutenv.records.scoring.points with the metrics that it needs, for the true
// tip. Numbers come from Python's definition (told.scoring); a test compares whole cuts.

function taskPoints(cut, told) {
  const { scoring } = told, { points, halved } = scoring, metrics = metricsOf(cut, scoring);
  const share = value => Math.min(Math.max(value, 0), 1), { target, map } = cut, last = cut.last("tip");
  const farthest = cut.columns.tip.reduce((a, b) => Math.max(a, b), -Infinity) - target;
  const way = share(last / target), charged = charges(cut, metrics, scoring);
  const of = names => names.reduce((sum, name) => sum + charged[name], 0), left = (charge, half) => half / (half + charge);
  const beyond = farthest > scoring.overshoot_allowed || metrics.peak_force_per_depth > scoring.force_limit_per_depth ||
    map?.beyond(scoring) || ["overshoot", "force_limit", "layer", "off_line"].includes(cut.end);
  const success = cut.success && !beyond, charge = of(Object.keys(charged)) + (beyond ? scoring.beyond_limit : 0);
  let counts = success ? 1 : Math.exp(-charge / scoring.missed);
  const shares = {
    limits: beyond ? 0 : counts, way: counts * way,
    accuracy: counts * Math.max(1 - Math.abs(last - target) / scoring.close, 0), success: success ? 1 : 0,
  };
  for (const [part, names] of Object.entries(scoring.of_part)) shares[part] = success ? left(of(names), halved[part]) : 0;
  const gentle = map ? 1 - scoring.map_points / 100 : 1; // the depth, or the path, has the other points
  const parts = Object.entries(points).map(([part, most]) => ({ part, points: gentle * most * shares[part], most: gentle * most }));
  if (!map) return parts;
  counts *= way * (success ? 1 : scoring.map_missed);
  const gained = scoring.map_points * counts * share(1 + map.costs / scoring.map_cost);
  return [...parts, { part: cut.specimen.task, points: gained, most: scoring.map_points }];
}

// What the task charges for the way in which a cut was made.
function charges(cut, metrics, { charged, per, deadline }) {
  const { jump } = cut.columns, quantities = {
    haste: metrics.haste, uncontrolled: jump.reduce((sum, run) => sum + run, 0) / cut.target,
    jump: jump.reduce((sum, run) => sum + (run / per.run) ** 2, 0), force: metrics.pressed / per.force,
    lag: metrics.dragged / per.lag, backward: metrics.backward / cut.target,
    time: (metrics.duration ?? deadline) / per.time,
  };
  return Object.fromEntries(Object.entries(charged).map(([name, weight]) => [name, weight * quantities[name]]));
}

// The metrics by their names there, and sums over the cut that the charges need.
function metricsOf(cut, scoring) {
  const { time, force, position, tip, height } = cut.columns, n = time.length, span = time[n - 1] - time[0];
  const half = Math.max(1, Math.round(scoring.speed_window * (n - 1) / span));
  const speed = time.map((_, i) => {
    const before = Math.max(i - half, 0), after = Math.min(i + half, n - 1);
    return (position[after] - position[before]) / (time[after] - time[before]);
  });
  const moving = i => Math.abs(speed[i]) > scoring.standstill;
  let first = 0, end = n - 1;
  while (first < n && !moving(first)) first += 1;
  while (end > first && !moving(end)) end -= 1;

  let reached = -Infinity, perDepth = 0, pressed = 0, dragged = 0, backward = 0, began = 0;
  for (let i = 0; i < n; i++) {
    const lasts = 0.5 * ((i < n - 1 ? time[i + 1] - time[i] : 0) + (i ? time[i] - time[i - 1] : 0));
    const flat = cut.depthAt(cut.measuredDepth, position[i]); // of a blade at height 0
    const depth = Math.max(cut.deep ? flat - height[i] : flat, scoring.shallowest);
    reached = Math.max(reached, position[i]);
    if (speed[i] > scoring.standstill && position[i] >= reached - 1e-4) perDepth = Math.max(perDepth, force[i] / depth);
    pressed += lasts * Math.max(force[i] / depth - scoring.force_allowed, 0);
    dragged += lasts * Math.min(Math.max(Math.max(position[i] - tip[i], 0) - scoring.lag_allowed, 0), scoring.lag_charged);
    const back = speed[i] < -scoring.standstill;
    if (i && back && !(speed[i - 1] < -scoring.standstill)) began = i;
    if (back && (i === n - 1 || !(speed[i + 1] < -scoring.standstill))) {
      const way = position[began] - position[i];
      if (way >= scoring.shortest_stroke) backward += way;
    }
  }
  const count = Math.floor(span * scoring.haste_rate + 1e-3) + 1;
  const even = between(time, position, Array.from({ length: count }, (_, k) => time[0] + k / scoring.haste_rate));
  const cubes = even.slice(1).reduce((sum, x, k) => sum + Math.abs(x - even[k]) ** 3, 0);
  return {
    duration: first < n ? time[end] - time[first] : undefined, peak_force_per_depth: perDepth, pressed, dragged, backward,
    haste: cubes * scoring.haste_rate ** 2 / (scoring.stopping * cut.target),
  };
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
