// The stage: MeshCat's viewer with an environment to reflect, shadows, and a ground that fades into the distance.
const THREE = MeshCat.THREE;
const pane = document.getElementById("pane");
const viewer = drawing();
const told = name => viewer.scene_tree.find(["ccpin", name]).object.userData;     // what Python says of `name`
const shown = { labels: 0, trace: true, ghosts: true, arrows: true, ground: true };

function drawing() {                     // a page that can draw nothing says why
  try { return new MeshCat.Viewer(pane); }
  catch (error) {
    pane.textContent = "This browser does not draw in 3D (no WebGL): turn on its hardware acceleration, or open the page in another one.";
    document.body.classList.add("flat");
    throw error;
  }
}

function room() {                        // what materials reflect: a grey room, a bright ceiling, two soft lamps
  const scene = new THREE.Scene(), box = new THREE.BoxGeometry();
  const put = (size, at, brightness, side) => {
    const mesh = new THREE.Mesh(box, new THREE.MeshBasicMaterial({ side }));
    mesh.material.color.setScalar(brightness);
    mesh.scale.set(...size);
    mesh.position.set(...at);
    scene.add(mesh);
  };
  put([20, 12, 20], [0, 3, 0], 0.62, THREE.BackSide);
  put([9, 0.1, 9], [0, 8.9, 0], 3.2, THREE.FrontSide);
  put([0.1, 4, 6], [-9.8, 4, 2], 4.0, THREE.FrontSide);
  put([6, 3, 0.1], [3, 4, 9.8], 2.2, THREE.FrontSide);
  return scene;
}

function dress(object) {                 // colours are as people see them; three.js computes with light
  object.traverse(part => {
    for (const material of part.isMesh ? [].concat(part.material) : []) {
      if (material.userData.dressed || !material.color) continue;
      material.color.convertSRGBToLinear();
      material.userData.dressed = true;
    }
  });
}

function fitted() {                      // to its pane, whatever else is on the page; MeshCat alone would take the window
  const fit = viewer.set_3d_pane_size.bind(viewer);
  viewer.set_3d_pane_size = (width = pane.clientWidth, height = pane.clientHeight) => fit(width, height);
  new ResizeObserver(() => viewer.set_3d_pane_size()).observe(pane);
}

function lit() {
  const { renderer, scene } = viewer;
  renderer.shadowMap.type = THREE.PCFShadowMap;                          // the one whose shadows' edges can be soft
  renderer.outputEncoding = THREE.sRGBEncoding;
  renderer.toneMapping = THREE.ACESFilmicToneMapping;
  renderer.toneMappingExposure = 1.0;
  viewer.show_background = () => viewer.hide_background();               // the page's style draws it
  scene.environment = new THREE.PMREMGenerator(renderer).fromScene(room()).texture;
  const put = viewer.set_object.bind(viewer);
  viewer.set_object = (path, object) => { dress(object); put(path, object); };
}

const GRID = {
  vertex: `varying vec2 at;
    void main() { at = position.xy; gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0); }`,
  fragment: `varying vec2 at; uniform vec2 origin; uniform float cell, radius;
    float line(float size) {
      vec2 place = (at - origin) / size, gap = abs(fract(place - 0.5) - 0.5) / fwidth(place);
      return 1.0 - min(min(gap.x, gap.y), 1.0);
    }
    void main() {
      float fade = 1.0 - smoothstep(0.1, 1.0, length(at) / radius);
      gl_FragColor = vec4(0.27, 0.33, 0.42, fade * max(0.25 * line(cell), 0.5 * line(5.0 * cell)));
    }`,
};

function reach(light, radius) {          // soft shadows of all within `radius` of what is looked at, and on the ground
  const wide = 1.6 * radius, { shadow } = light;
  light.position.setLength(4 * radius);
  Object.assign(shadow.camera, { left: -wide, right: wide, top: wide, bottom: -wide, near: radius, far: 9 * radius });
  shadow.camera.updateProjectionMatrix();
  Object.assign(shadow, { bias: -2e-4, normalBias: 4e-3 * radius, radius: 3 });
  shadow.mapSize.set(1024, 1024);
}

const ground = { group: null, shade: null, told: null, light: null };
function layGround() {                   // at the lowest point of the motion; its grid runs through the world's origin
  const floor = told("floor"), light = viewer.scene_tree.find(["Lights", "Key", "<object>"]).object;
  if ((floor === ground.told && light === ground.light) || !floor.radius || !light.shadow) return;
  ground.light = light;
  reach(light, floor.radius);
  if (ground.group) viewer.scene.remove(ground.group);
  ground.told = floor;
  const disc = new THREE.CircleGeometry(12 * floor.radius, 96);
  const shade = new THREE.Mesh(disc, new THREE.ShadowMaterial({ color: 0x1c2532, opacity: 0.3, depthWrite: false }));
  shade.receiveShadow = true;
  const uniforms = { origin: { value: new THREE.Vector2(...floor.origin) }, cell: { value: floor.cell },
    radius: { value: 6 * floor.radius } };
  const lines = new THREE.Mesh(disc, new THREE.ShaderMaterial({ uniforms, vertexShader: GRID.vertex,
    fragmentShader: GRID.fragment, transparent: true, depthWrite: false, side: THREE.DoubleSide }));
  shade.renderOrder = lines.renderOrder = -1;
  ground.shade = shade;
  ground.group = new THREE.Group();
  ground.group.name = "ground";
  ground.group.add(lines, shade);
  ground.group.position.z = floor.height;
  viewer.scene.add(ground.group);
  const cell = floor.cell >= 1 ? `${floor.cell} m` : floor.cell >= 0.01 ? `${Math.round(floor.cell * 100)} cm`
    : `${+(floor.cell * 1000).toPrecision(1)} mm`;
  document.getElementById("scale").textContent = `grid ${cell}`;
}

function showGround() {
  if (ground.group) ground.group.visible = shown.ground;
  if (ground.shade) ground.shade.visible = !plain.on;
  document.getElementById("scale").hidden = !shown.ground;
  viewer.scene_tree.find(["Lights", "AmbientLight"]).object.visible = plain.on;          // else the room lights
}

const plain = { on: false, room: null };
function drawPlainly(on) {               // no room to reflect, no shadows, no ghosts
  if (plain.on === on) return;
  const { scene } = viewer;
  plain.on = on;
  plain.room ??= scene.environment;
  scene.environment = on ? null : plain.room;
  if (ground.light) ground.light.castShadow = !on;
  viewer.set_dirty();
}
