// The camera: presets that frame the whole motion in a window of any shape, until somebody turns the scene by hand.
const FLIGHT = 350;                      // ms from one view to the next
const calm = matchMedia("(prefers-reduced-motion: reduce)");         // of who wants nothing to move by itself
const view = { name: "iso", told: null, touched: false, flight: null, window: "" };

function pose(name) {
  const { target, position, fit } = told("views")[name];
  const [width, height, share] = fit, aspect = pane.clientWidth / pane.clientHeight;
  const zoom = share * Math.tan(viewer.camera.fov * Math.PI / 360) / Math.max(height, width / aspect);
  return { target: new THREE.Vector3(...target), position: new THREE.Vector3(...position), zoom };
}

function stand({ target, position, zoom }) {
  viewer.controls.target.copy(target);
  viewer.camera.position.copy(position);
  viewer.camera.zoom = zoom;
  viewer.set_dirty();
}

function look(name, smoothly = true) {   // to a preset
  Object.assign(view, { name, touched: false, flight: null });
  const { camera, controls } = viewer;
  if (!smoothly || document.hidden || calm.matches) return stand(pose(name));
  const from = { target: controls.target.clone(), position: camera.position.clone(), zoom: camera.zoom };
  view.flight = { from, to: pose(name), start: performance.now() };
}

function fly() {                         // along an arc about the target
  if (!view.flight) return;
  const { from, to, start } = view.flight, share = Math.min(1, (performance.now() - start) / FLIGHT);
  const ease = share * share * (3 - 2 * share);
  const [a, b] = [from, to].map(at => new THREE.Spherical().setFromVector3(at.position.clone().sub(at.target)));
  const turn = b.theta - a.theta - 2 * Math.PI * Math.round((b.theta - a.theta) / (2 * Math.PI));
  const at = new THREE.Spherical(a.radius + ease * (b.radius - a.radius), a.phi + ease * (b.phi - a.phi),
    a.theta + ease * turn);
  const target = from.target.clone().lerp(to.target, ease);
  const position = share < 1 ? target.clone().add(new THREE.Vector3().setFromSpherical(at)) : to.position;
  stand({ target, position, zoom: from.zoom + ease * (to.zoom - from.zoom) });
  if (share === 1) view.flight = null;
}

function keepFramed() {                  // a new window or a motion that has left the frame; not against the user's hand
  const views = told("views");
  if (!views.iso) return;
  const size = `${pane.clientWidth}x${pane.clientHeight}`, first = view.told === null;
  if (views === view.told && size === view.window) return;
  const grown = views !== view.told && !first;
  Object.assign(view, { told: views, window: size });
  if (!view.touched) look(view.name, grown);
}

function handWatched() {                 // from the first drag or turn of the wheel on the view is the user's own
  for (const event of ["pointerdown", "wheel"])
    pane.addEventListener(event, () => {
      Object.assign(view, { touched: true, flight: null });
    }, { passive: true });
}
