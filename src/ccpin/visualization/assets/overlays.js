// What is drawn over and beside the mechanism: its path as far as it has gone, ghosts of start and goal, names, forces.
const split = path => path.split("/").filter(part => part);
const node = path => viewer.scene_tree.find(split(path));
const made = { trace: null, whole: null, ghosts: null, arrows: null };                  // and from which words of Python's

function showTrace(frame) {
  const trace = told("trace");
  if (made.trace?.parent) made.trace.parent.visible = Boolean(trace.path) && shown.trace;
  if (!trace.path) return;
  const mesh = node(trace.path).find(["<object>"]).object;
  if (!mesh.geometry) return;
  if (made.trace !== mesh) {
    made.trace = mesh;
    const whole = new THREE.Mesh(mesh.geometry.clone(), mesh.material.clone());
    Object.assign(whole.material, { transparent: true, opacity: 0.16, depthWrite: false });
    mesh.castShadow = mesh.receiveShadow = false;
    made.whole?.removeFromParent();      // of the motion before
    made.whole = whole;
    mesh.parent.add(whole);
  }
  mesh.parent.visible = shown.trace;
  mesh.geometry.setDrawRange(0, trace.ends[Math.min(Math.max(0, Math.floor(frame + 1e-6)), trace.ends.length - 1)]);
}

const BEHIND = { transparent: true, polygonOffset: true, polygonOffsetFactor: 2, polygonOffsetUnits: 16 };
function ghostOf(mesh, tint) {           // into depth first, so that no inner faces shine through; never over what is there
  const depth = new THREE.Mesh(mesh.geometry, new THREE.MeshBasicMaterial({ ...BEHIND, colorWrite: false }));
  const colour = new THREE.Mesh(mesh.geometry, new THREE.MeshBasicMaterial({ ...BEHIND, color: tint, opacity: 0.17,
    depthWrite: false }));
  depth.renderOrder = 1;
  colour.renderOrder = 2;
  const pair = new THREE.Group();
  pair.add(depth, colour);
  return pair;
}

function anew(name, said, build) {       // the group of what is drawn by `said`, built only when that has changed
  if (made[name]?.told !== said) {
    made[name]?.group.parent?.remove(made[name].group);
    made[name] = { told: said, group: new THREE.Group() };
    made[name].group.name = name;
    if (said.root) node(said.root).object.add(made[name].group);
    if (said.root) build(made[name].group);
  }
  made[name].group.visible = shown[name] && !(name === "ghosts" && plain.on);
  return made[name].group;
}

function showGhosts() {
  const ghosts = told("ghosts");
  anew("ghosts", ghosts, group => {
    for (const { name, tint, bodies } of ghosts.poses) {
      const ghost = new THREE.Group();
      ghost.name = name;
      for (const [path, matrix] of Object.entries(bodies)) {
        const body = node(path).object;
        body.updateWorldMatrix(true, true);
        const inverse = body.matrixWorld.clone().invert();
        body.traverse(part => {
          if (!part.isMesh) return;
          const twin = ghostOf(part, tint);
          twin.applyMatrix4(inverse.clone().multiply(part.matrixWorld).premultiply(
            new THREE.Matrix4().fromArray(matrix)));
          ghost.add(twin);
        });
      }
      group.add(ghost);
    }
  });
}

function arrow(colour) {                 // of length 1 along y, shaft and head
  const material = new THREE.MeshStandardMaterial({ color: colour, roughness: 0.5 });
  const shaft = new THREE.Mesh(new THREE.CylinderGeometry(1, 1, 1, 16), material);
  const head = new THREE.Mesh(new THREE.ConeGeometry(2.6, 1, 20), material);
  const group = new THREE.Group();
  group.add(shaft, head);
  dress(group);
  group.visible = false;
  return group;
}

function aim(group, base, force, width) {
  const length = force.length(), tip = Math.min(0.5 * length, 6 * width), [shaft, head] = group.children;
  group.visible = length > width;
  group.position.copy(base);
  group.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), force.clone().divideScalar(length || 1));
  shaft.scale.set(width, Math.max(length - tip, 1e-9), width);
  shaft.position.y = (length - tip) / 2;
  head.scale.set(width, tip, width);
  head.position.y = length - tip / 2;
}

const blend = (rows, at) => {            // between frames, along the straight line
  const low = Math.min(Math.floor(at), rows.length - 1), high = Math.min(low + 1, rows.length - 1);
  return new THREE.Vector3(...rows[low]).lerp(new THREE.Vector3(...rows[high]), at - Math.floor(at));
};

function showArrows(frame) {
  const arrows = told("arrows");
  const group = anew("arrows", arrows, made => arrows.forces.forEach(() => made.add(arrow(0x7b2d8e))));
  group.children.forEach((child, index) => {
    const { points, forces } = arrows.forces[index];
    aim(child, blend(points, frame), blend(forces, frame).multiplyScalar(arrows.scale), arrows.width);
  });
}

function names(frame) {                  // every name to be written: its class, its text, its point in the scene
  const { labels = [] } = told("labels"), arrows = told("arrows");
  const wanted = labels.filter(label => shown.labels === 2 || (shown.labels === 1 && label.kind === "motor"));
  const written = wanted.map(({ kind, text, path, point }) =>
    ({ kind, text, at: node(path).object.localToWorld(new THREE.Vector3(...point)) }));
  if (shown.arrows && arrows.root) for (const { name, points, forces } of arrows.forces) {
    const force = blend(forces, frame), tip = blend(points, frame).addScaledVector(force, arrows.scale);
    written.push({ kind: "force", text: `${name} ${force.length().toPrecision(3)} N`,
      at: node(arrows.root).object.localToWorld(tip) });
  }
  return written;
}

function writeNames(frame) {
  const holder = document.getElementById("labels"), written = names(frame);
  while (holder.children.length > written.length) holder.lastChild.remove();
  while (holder.children.length < written.length) holder.append(document.createElement("span"));
  const taken = [];
  written.map(entry => ({ ...entry, seen: entry.at.clone().project(viewer.camera) }))
    .sort((a, b) => b.seen.y - a.seen.y)
    .forEach(({ kind, text, seen }, index) => {
      const span = holder.children[index], x = (1 + seen.x) * pane.clientWidth / 2 + 10;
      let y = (1 - seen.y) * pane.clientHeight / 2 - 10;
      const width = 7 * text.length + 12;
      while (taken.some(other => Math.abs(other.y - y) < 20 && x < other.x + other.width && other.x < x + width)) y += 20;
      taken.push({ x, y, width });
      span.className = kind;
      if (span.textContent !== text) span.textContent = text;
      span.style.visibility = Math.abs(seen.z) < 1 ? "visible" : "hidden";
      span.style.transform = `translate(${Math.round(x)}px, ${Math.round(y)}px)`;
    });
}
