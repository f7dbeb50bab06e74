"use strict";
// Shows meshcat's scene of a slab with cuts along any curve. Every number was computed before.
(() => {
  const byId = name => document.getElementById(name);
  const bytes = encoded => Uint8Array.from(atob(encoded), letter => letter.charCodeAt(0));
  const told = JSON.parse(byId("told").textContent), unit = told.units_per_metre;
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

  for (const part of ["top", "bottom", "rim", "faces"]) {
    const mesh = node("tissue/" + part + "/<object>");
    mesh.geometry.computeVertexNormals();
    mesh.material.side = THREE.DoubleSide;
  }
  node("tissue/lines/<object>").castShadow = node("tissue/lines/<object>").receiveShadow = false;
  const scalpel = node("scalpel"), [x, y, z] = told.scalpel_m;
  scalpel.position.set(unit * x, unit * y, unit * z);
  scalpel.rotation.order = "ZXY"; // it leans in its own plane, which is then turned
  scalpel.rotation.set(told.scalpel_rad[0], 0, told.scalpel_rad[1]);

  const spot = node("Lights/SpotLight/<object>");
  spot.position.set(1.1, -0.6, 3.2);
  spot.angle = 0.5;
  spot.penumbra = 0.6;
  spot.target.position.set(0, 0.7, 0);
  viewer.scene.add(spot.target);

  viewer.set_3d_pane_size();
  const toThree = ([a, b, c]) => new THREE.Vector3(unit * a, unit * c, -unit * b); // meshcat's z is up, three's y
  const camera = viewer.camera, distance = camera.aspect > 1.1 ? 3.4 : 5;
  camera.fov = 28;
  camera.updateProjectionMatrix();
  viewer.controls.target.copy(toThree(told.middle_m));
  camera.position.copy(toThree(told.middle_m)).addScaledVector(toThree([0.75, -0.75, 1.05]).normalize(), distance);
  viewer.controls.update();
  viewer.set_dirty();
  window.addEventListener("resize", () => viewer.set_dirty());
})();
