// A point of the mechanism to take hold of: dragged in its plane, or in the plane that faces the camera.
const grip = { at: facts.handles[0], ball: null, held: null, place: new THREE.Vector3() };
const ray = new THREE.Raycaster();

function makeGrip() {
  if (!grip.at || link.offline) return;
  const paint = new THREE.MeshBasicMaterial({ color: 0x2970bd, transparent: true, opacity: 0.75, depthTest: false });
  grip.ball = new THREE.Mesh(new THREE.SphereGeometry(1, 24, 16), paint);
  grip.ball.renderOrder = 5;
  viewer.scene.add(grip.ball);
  const choose = Object.assign(document.createElement("select"), { id: "grip", title: "What the blue ball takes hold of" });
  choose.append(...facts.handles.map(({ name }, value) => Object.assign(document.createElement("option"), { value, textContent: name })));
  choose.onchange = () => { grip.at = facts.handles[choose.value]; viewer.set_dirty(); choose.blur(); };
  const title = document.createElement("span");
  title.textContent = "drag ";
  title.className = "quiet";
  byId("gripped").append(title, choose);
  const draw = viewer.render.bind(viewer);
  viewer.render = () => { standGrip(); draw(); };
  pane.addEventListener("pointerdown", take, { capture: true });
  addEventListener("pointermove", pull);
  addEventListener("pointerup", release);
  addEventListener("pointercancel", release);
}

function standGrip() {                   // where it is, as large as 9 pixels
  const { camera } = viewer, body = node(grip.at.body).object;
  body.updateWorldMatrix(true, false);
  body.localToWorld(grip.place.set(...grip.at.point));
  viewer.scene.updateMatrixWorld();
  grip.ball.position.copy(viewer.scene.worldToLocal(grip.place.clone()));
  const far = grip.place.distanceTo(camera.position);
  const pixel = 2 * far * Math.tan(camera.fov * Math.PI / 360) / camera.zoom / pane.clientHeight;
  grip.ball.scale.setScalar((grip.held ? 11 : 9) * pixel);
}

function aimAt(event) {
  const box = pane.getBoundingClientRect();
  const at = new THREE.Vector2(2 * (event.clientX - box.left) / box.width - 1, 1 - 2 * (event.clientY - box.top) / box.height);
  ray.setFromCamera(at, viewer.camera);
}

function take(event) {
  const seen = grip.place.clone().project(viewer.camera), box = pane.getBoundingClientRect();
  const x = box.left + (1 + seen.x) * box.width / 2, y = box.top + (1 - seen.y) * box.height / 2;
  if (event.button || Math.hypot(event.clientX - x, event.clientY - y) > 16) return;
  event.stopPropagation();
  event.preventDefault();
  const root = node(facts.root).object, towards = viewer.camera.getWorldDirection(new THREE.Vector3());
  const plane = facts.normal ? new THREE.Vector3(...facts.normal).transformDirection(root.matrixWorld) : towards;
  const chosen = Math.abs(plane.dot(towards)) > 0.2 ? plane : towards;
  grip.held = new THREE.Plane().setFromNormalAndCoplanarPoint(chosen, grip.place);
  pane.style.cursor = "grabbing";
}

function pull(event) {
  if (!grip.held) return;
  aimAt(event);
  const point = ray.ray.intersectPlane(grip.held, new THREE.Vector3());
  if (!point) return;
  const to = node(facts.root).object.worldToLocal(point).toArray();
  order({ do: "drag", handle: grip.at.name, to }).then(show);
}

function release() {
  if (grip.held) viewer.set_dirty();
  grip.held = null;
  pane.style.cursor = "";
}
