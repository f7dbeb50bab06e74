"use strict";
// Moves meshcat's scene from instant to instant. Every number was computed before; here it is only shown.
(() => {
  const text = name => document.getElementById(name).textContent;
  const bytes = encoded => Uint8Array.from(atob(encoded), letter => letter.charCodeAt(0));
  const byId = name => document.getElementById(name);

  const told = JSON.parse(text("told"));
  const unit = told.units_per_metre;
  const rest = new Float32Array(bytes(text("rest")).buffer);
  const displacements = new Int16Array(bytes(text("displacements")).buffer);
  const amounts = bytes(text("amounts"));
  const count = told.time_s.length, nPoints = rest.length / 3;

  const THREE = MeshCat.THREE, pane = byId("pane");
  let viewer;
  try {
    viewer = new MeshCat.Viewer(pane);
  } catch (error) {
    byId("trouble").textContent = "This browser shows no 3-D graphics (WebGL). Turn hardware acceleration on, or try another browser.";
    byId("trouble").hidden = false;
    throw error;
  }
  const fitPane = viewer.set_3d_pane_size.bind(viewer);
  viewer.set_3d_pane_size = () => fitPane(pane.clientWidth, pane.clientHeight);
  for (const command of told.commands) viewer.handle_command_bytearray(bytes(command));
  const node = path => viewer.scene_tree.find(path.split("/")).object;
  const geometry = path => node(path + "/<object>").geometry;

  // Surfaces: each vertex is a point of the solid.
  const skins = Object.entries(told.skins).map(([path, points]) => ({ path, points, geometry: geometry(path) }));
  const lines = geometry("tissue/lines");
  lines.setIndex(told.lines);
  lines.setAttribute("position", geometry("tissue/top").attributes.position);
  node("tissue/lines").position.z = 0.0025; // a quarter of a millimetre, so that the lines show
  for (const { path } of skins) node(path + "/<object>").frustumCulled = false; // what culls is not kept up to date
  node("tissue/lines/<object>").frustumCulled = false;
  for (const path of ["target/<object>", "tissue/lines/<object>"]) node(path).castShadow = node(path).receiveShadow = false;
  for (const path of ["arrow/shaft/<object>", "arrow/head/<object>", "tip/<object>"]) node(path).castShadow = false;

  const floor = new THREE.Mesh(new THREE.PlaneGeometry(8, 8), new THREE.ShadowMaterial({ opacity: 0.22 }));
  floor.position.set(0, 0.7, unit * told.ground_m);
  floor.receiveShadow = true;
  viewer.scene.add(floor);
  const spot = node("Lights/SpotLight/<object>");
  spot.position.set(1.1, -0.6, 3.2);
  spot.angle = 0.5;
  spot.penumbra = 0.6;
  spot.shadow.mapSize.set(1536, 1536);
  spot.shadow.camera.near = 1;
  spot.shadow.camera.far = 8;
  spot.shadow.radius = 4;
  spot.target.position.set(0, 0.7, 0);
  viewer.scene.add(spot.target);

  const shades = told.palette.map(colour => colour.map(value => value / 255));
  let now = -1;

  function moveTissue(i) {
    const from = 2 * nPoints * i, step = told.displacement_step_m;
    for (const skin of skins) {
      const position = skin.geometry.attributes.position;
      skin.points.forEach((point, k) => position.setXYZ(k,
        unit * (rest[3 * point] + step * displacements[from + 2 * point]),
        unit * (rest[3 * point + 1] + step * displacements[from + 2 * point + 1]),
        unit * rest[3 * point + 2]));
      position.needsUpdate = true;
      const colour = skin.geometry.attributes.color;
      if (colour) {
        skin.points.forEach((point, k) => {
          const amount = amounts[i * told.n_lattice + point % told.n_lattice];
          colour.setXYZ(k, ...shades[Math.round(amount / 255 * (shades.length - 1))]);
        });
        colour.needsUpdate = true;
      }
      skin.geometry.computeVertexNormals();
    }
    const cut = 3 * told.cut_parts[i];
    for (const name of ["faces", ...told.plane]) {
      if (name === "ahead") geometry("tissue/ahead").setDrawRange(cut, Infinity);
      else if (["faces", "near", "below"].includes(name)) geometry(`tissue/${name}`).setDrawRange(0, cut);
    }
  }

  // Take the near half off, so that the plane of the cut is seen; the far half's parts come first everywhere.
  function takeOff(on) {
    for (const name of ["top", "bottom", "rim", "lines"]) {
      const shape = geometry(`tissue/${name}`);
      shape.setDrawRange(0, on ? shape.index.count / 2 : Infinity);
    }
    node("tissue/near").visible = !on;
    node("tissue/below").visible = node("tissue/ahead").visible = on;
    byId("label-layer").textContent = on && told.plane.includes("layer") ? "layer below" : "";
    byId("label-wanted").textContent = on && told.plane.includes("wanted") ? "wanted depth" : "";
    viewer.set_dirty();
  }

  function moveScalpel(i) {
    const scalpel = node("scalpel");
    scalpel.position.set(0, unit * told.scalpel_along_m[i], unit * told.scalpel_height_m[i]);
    scalpel.rotation.set(told.angle_rad[i] - Math.PI / 2, 0, 0);
  }

  // The force on the blade: an arrow that starts at its edge and points back toward the clamp where it resists.
  function moveArrow(i) {
    const length = told.arrow_m_per_N * told.force_N[i], size = Math.abs(length), sign = length > 0 ? -1 : 1;
    const above = told.arrow_above_m, start = told.position_m[i] + above / Math.tan(told.angle_rad[i]);
    const head = Math.min(1, size / 0.009), headLength = 0.006 * head, shaft = Math.max(size - headLength, 1e-5);
    node("arrow").visible = size > 5e-4;
    node("arrow").position.set(0, unit * start, unit * (told.surface_m[i] + above));
    node("arrow/shaft").scale.set(1, unit * shaft, 1);
    node("arrow/shaft").position.y = sign * unit * shaft / 2;
    node("arrow/head").scale.setScalar(head);
    node("arrow/head").rotation.z = sign < 0 ? Math.PI : 0;
    node("arrow/head").position.y = sign * unit * (shaft + headLength / 2);
    anchors.arrow = [0, start + sign * size / 2, told.surface_m[i] + above];
    byId("label-arrow").textContent = told.force_N[i].toFixed(2) + " N";
  }

  // Labels are text over the picture, so that they stay sharp and can be read out.
  const anchors = { clamp: [told.specimen_m[0] / 2, -0.006, 0.006] };
  if (told.target_m !== null) anchors.target = [0, 0, 0];

  function moveTip(i) {
    node("tip").position.set(0, unit * told.tip_shown_m[i], unit * told.tip_height_m[i]);
    node("tip").visible = told.tip_m[i] > 0;
    anchors["tip-mark"] = told.tip_m[i] > 0 ? [0, told.tip_shown_m[i], told.tip_height_m[i]] : null;
    anchors.opened = told.tip_m[i] > 0.02 ? [0, 0.4 * told.tip_m[i], told.tip_height_m[i]] : null;
    if (anchors.target) {
      const corner = geometry("target").attributes.position.array; // its upper one on the far side
      anchors.target = [0, 1, 2].map(axis => corner[axis] / unit);
    }
  }

  const number = (value, digits) => value.toFixed(digits).replace(/^-(?=[0.]*$)/, "").replace("-", "\u2212");
  function tell(i) {
    const show = (name, value) => { byId("shown-" + name).textContent = value; };
    show("time", number(told.time_s[i], 2) + " s");
    show("force", number(told.force_N[i], 2) + " N");
    show("speed", number(1e2 * told.speed_m_s[i], 2) + " cm/s");
    show("angle", number(told.angle_rad[i] * 180 / Math.PI, 0) + "°");
    show("blade", number(1e3 * told.position_m[i], 1) + " mm");
    show("tip", number(1e3 * told.tip_m[i], 1) + " mm");
    if (told.plane.length) show("below", number(1e3 * told.below_m[i], 1) + " mm");
    if (told.wanted_m) show("wanted", number(1e3 * told.wanted_m[i], 1) + " mm");
    const slider = byId("slider");
    slider.value = i;
    slider.setAttribute("aria-valuetext", number(told.time_s[i], 2) + " s, " + number(told.force_N[i], 2) + " N");
    byId("cursor").style.left = 100 * told.time_s[i] / told.duration_s + "%";
  }

  function show(i) {
    if (i === now) return;
    now = i;
    moveTissue(i);
    moveScalpel(i);
    moveArrow(i);
    moveTip(i);
    tell(i);
    viewer.set_dirty();
  }

  // The camera: far enough to hold everything, from the side on a wide screen and from behind the clamp on a narrow one.
  const toThree = ([x, y, z]) => new THREE.Vector3(unit * x, unit * z, -unit * y); // meshcat's z is up, three's y
  function resetView() {
    viewer.set_3d_pane_size();
    const camera = viewer.camera, wide = camera.aspect > 1.1;
    camera.fov = 28;
    camera.updateProjectionMatrix();
    const held = told.in_picture_m.map(toThree);
    const from = toThree(wide ? [1.0, -0.42, 0.62] : [0.72, -0.95, 0.95]).normalize();
    const centre = new THREE.Box3().setFromPoints(held).getCenter(new THREE.Vector3());
    const right = new THREE.Vector3(), up = new THREE.Vector3();
    let distance = 6;
    for (let round = 0; round < 8; ++round) { // perspective: the place in the middle and the distance depend on each other
      viewer.controls.target.copy(centre);
      camera.position.copy(centre).addScaledVector(from, distance);
      viewer.controls.update();
      camera.updateMatrixWorld(true);
      const seen = new THREE.Box3().setFromPoints(held.map(place => place.clone().project(camera)));
      const half = distance * Math.tan(camera.fov * Math.PI / 360);
      camera.matrixWorld.extractBasis(right, up, new THREE.Vector3());
      centre.addScaledVector(right, half * camera.aspect * (seen.min.x + seen.max.x) / 2);
      centre.addScaledVector(up, half * (seen.min.y + seen.max.y) / 2);
      distance *= Math.max((seen.max.x - seen.min.x) / 1.86, (seen.max.y - seen.min.y) / (wide ? 1.8 : 1.5));
    }
    viewer.set_dirty();
  }

  // Names of layer and wanted depth stand where the plane of the cut shows them, before its end.
  for (const name of ["layer", "wanted"]) {
    if (!told.plane.includes(name)) continue;
    const points = told.skins[`tissue/${name}`], point = points[Math.round(0.47 * points.length)]; // of its upper row
    anchors[name] = [0, rest[3 * point + 1], rest[3 * point + 2]];
  }
  const beside = { layer: [0, 26], wanted: [0, -12], target: [0, -14], clamp: [0, 20], arrow: [0, -16], "tip-mark": [74, 26], opened: [44, 56] };
  function placeLabels() {
    const width = pane.clientWidth, height = pane.clientHeight;
    for (const name of Object.keys(beside)) {
      const label = byId("label-" + name), anchor = anchors[name];
      const shown = Boolean(anchor && label.textContent) && (name !== "arrow" || node("arrow").visible);
      label.hidden = !shown;
      if (!shown) continue;
      const seen = toThree(anchor).project(viewer.camera), [right, down] = beside[name];
      const half = label.offsetWidth / 2;
      const x = Math.min(Math.max((seen.x + 1) / 2 * width + right, half + 4), width - half - 4);
      const y = Math.min(Math.max((1 - seen.y) / 2 * height + down, 14), height - 14);
      label.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px) translate(-50%, -50%)`;
    }
  }

  // Playing: time passes, and the instant before it is shown.
  let playing = false, clock = 0, last = 0;
  const at = time => Math.max(0, told.time_s.findLastIndex(each => each <= time + 1e-9));
  function setPlaying(on) {
    playing = on;
    byId("play").textContent = on ? "pause" : "play";
    if (on) clock = now >= count - 1 ? 0 : told.time_s[now];
  }
  function tick(stamp) {
    if (playing) {
      clock += Number(byId("pace").value) * Math.min((stamp - last) / 1e3, 0.2);
      show(at(clock));
      if (clock >= told.time_s[count - 1]) setPlaying(false);
    }
    last = stamp;
    placeLabels();
    requestAnimationFrame(tick);
  }
  byId("play").addEventListener("click", () => setPlaying(!playing));
  byId("slider").addEventListener("input", event => { setPlaying(false); show(Number(event.target.value)); });
  byId("turn-back").addEventListener("click", resetView);
  byId("see-through").addEventListener("change", event => {
    for (const path of ["top", "rim", "bottom", "faces", ...told.plane].map(name => `tissue/${name}`)) {
      if (["tissue/layer", "tissue/wanted"].includes(path)) continue;
      const material = node(path + "/<object>").material;
      material.transparent = event.target.checked;
      material.opacity = event.target.checked ? 0.35 : 1;
      material.depthWrite = !event.target.checked;
      material.needsUpdate = true;
    }
    viewer.set_dirty();
  });
  if (told.plane.length) {
    byId("half").addEventListener("change", event => takeOff(event.target.checked));
    takeOff(byId("half").checked);
  }
  byId("controls").addEventListener("submit", event => event.preventDefault());

  window.cutView = { viewer, show, node, told }; // for whoever opens the browser's console
  show(told.first_instant);
  resetView();
  window.addEventListener("load", resetView);
  requestAnimationFrame(tick);
})();
