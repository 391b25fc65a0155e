// Time: the page owns it and seeks MeshCat's animator, so that speed, single frames and the growing path are exact.
const SPEEDS = [0.1, 0.25, 0.5, 1, 1.5, 2];
const HOLD = 0.6;                        // seconds at the end before the motion starts over
const player = { time: 0, speed: 1, playing: false, loop: false, duration: 0, held: 0, last: null, actions: null };
const [bar, play, scrub, time, speed, stamp, tools, keys] =
  ["bar", "play", "scrub", "time", "speed", "stamp", "tools", "keys"].map(id => document.getElementById(id));

const clock = () => ({ start: 0, end: Infinity, speed: 1, fps: 30, ...told("clock") });
const frameNow = () => player.time * clock().fps;

function takeOver() {                    // a new animation has come: from its start
  const { animator } = viewer;
  if (animator.actions === player.actions) return;
  player.actions = animator.actions;
  player.duration = animator.duration;
  player.playing = animator.playing && player.duration > 0 && !calm.matches;
  player.loop = player.actions.some(action => action.repetitions === Infinity);
  animator.pause();
  seek(0);
}

function seek(at) {
  player.time = Math.min(Math.max(0, at), player.duration);
  player.held = 0;
  if (player.duration > 0) viewer.animator.seek(player.time);
  viewer.set_dirty();
}

function advance(now) {
  const passed = player.last === null ? 0 : Math.min(0.1, (now - player.last) / 1000);
  player.last = player.playing ? now : null;
  if (!player.playing || !(player.duration > 0)) return;
  if (player.time < player.duration) return seek(player.time + passed * player.speed);
  player.held += passed;
  if (!player.loop) player.playing = false;
  else if (player.held > HOLD) seek(0);
}

function start(playing = !player.playing) {
  if (playing && player.time >= player.duration) seek(0);
  player.playing = playing && player.duration > 0;
  wake();
}

function step(count) {
  player.playing = false;
  seek((Math.round(frameNow()) + count) / clock().fps);
}

function setSpeed(value) {
  player.speed = value;
  speed.value = String(value);
}

function toggle(name) {
  shown[name] = name === "labels" ? (shown.labels + 1) % 3 : !shown[name];
  viewer.set_dirty();
}

function reset() {
  Object.assign(shown, { labels: 0, trace: true, ghosts: true, arrows: true, ground: true });
  setSpeed(1);
  seek(0);
  start(player.duration > 0);
  look("iso");
}

function moment() {                      // of the trajectory, in its own seconds
  const { start, end, speed } = clock();
  return `${Math.min(start + speed * player.time, end).toFixed(2)} s`;
}

const write = (place, words) => { if (place.textContent !== words) place.textContent = words; };   // else it is drawn anew

function refresh() {
  const { duration } = player, words = duration > 0 ? moment() : "";
  bar.style.display = duration > 0 ? "flex" : "none";
  document.body.classList.toggle("moving", duration > 0);                 // the grid's size stands above the bar
  write(play, player.playing ? "\u275A\u275A" : "\u25B6\uFE0E");
  scrub.max = duration;
  scrub.value = player.time;
  write(time, words);
  write(stamp, document.body.classList.contains("film") ? words : "");
  const there = { labels: told("labels").labels?.length, trace: told("trace").path, ghosts: told("ghosts").root,
    arrows: told("arrows").root, ground: ground.group };
  for (const button of tools.querySelectorAll("button")) {
    const { view: preset, toggle: name } = button.dataset;
    button.hidden = Boolean(name) && !there[name];
    const on = name ? Boolean(shown[name]) : preset === view.name && !view.touched;
    button.classList.toggle("on", on);
    if (name || preset) button.ariaPressed = on;
    if (name === "labels") write(button, ["Labels", "Motors", "All names"][shown.labels]);
  }
}

const KEYS = {
  " ": () => start(), ArrowLeft: () => step(-1), ArrowRight: () => step(1),
  Home: () => step(-Infinity), End: () => step(Infinity),
  "-": () => setSpeed(SPEEDS[Math.max(0, SPEEDS.indexOf(player.speed) - 1)]),
  "+": () => setSpeed(SPEEDS[Math.min(SPEEDS.length - 1, SPEEDS.indexOf(player.speed) + 1)]),
  "1": () => look("iso"), "2": () => look("front"), "3": () => look("side"), "4": () => look("top"),
  "0": () => look(view.name), l: () => toggle("labels"), t: () => toggle("trace"), g: () => toggle("ghosts"),
  f: () => toggle("arrows"), b: () => toggle("ground"), r: reset, "?": () => { keys.hidden = !keys.hidden; },
  Escape: () => { keys.hidden = true; }, m: () => document.body.classList.toggle("meshcat"),
};
KEYS["="] = KEYS["+"];

function listen() {
  speed.append(...SPEEDS.map(value => new Option(`${value}\u00D7`, String(value))));
  setSpeed(1);
  speed.onchange = () => { setSpeed(Number(speed.value)); speed.blur(); };
  play.onclick = () => start();
  scrub.oninput = () => { player.playing = false; seek(Number(scrub.value)); };
  document.getElementById("back").onclick = () => step(-1);
  document.getElementById("forth").onclick = () => step(1);
  document.getElementById("reset").onclick = reset;
  document.getElementById("help").onclick = KEYS["?"];
  for (const button of tools.querySelectorAll("button")) {
    const { view: preset, toggle: name } = button.dataset;
    if (preset) button.onclick = () => look(preset);
    if (name) button.onclick = () => toggle(name);
  }
  addEventListener("click", event => event.detail && event.target.closest?.("button")?.blur());   // space plays after a click
  addEventListener("keydown", event => {
    const press = KEYS[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!press || event.ctrlKey || event.metaKey || event.altKey || event.target.closest?.(".dg, select, textarea, input:not(#scrub)")) return;
    if (event.key === " " && event.target.closest?.("button, summary")) return;   // it presses what Tab has led to
    event.preventDefault();
    press();
  });
}

function draw() {                        // what depends on time, then MeshCat's picture, then the names over it
  const frame = frameNow();
  layGround();
  showGround();
  showGhosts();
  showTrace(frame);
  showArrows(frame);
  paint();
  writeNames(frame);
}
let paint;

// A page on which nothing moves rests: frames come while something does, and where a command or a hand has asked for one.
const turns = [];                        // what else is done each frame
let awake = false, seen = true;
function wake() {
  if (awake) return;
  awake = true;
  requestAnimationFrame(turn);
}

function turn(now) {
  awake = false;
  takeOver();
  advance(now);
  keepFramed();
  fly();
  viewer.animator.update();
  if (viewer.needs_render) viewer.render();
  refresh();
  for (const other of turns) other();
  if (seen && (player.playing || view.flight || viewer.animator.playing || viewer.needs_render)) wake();
  else player.last = null;
}

function rest() {                        // in place of MeshCat's own endless frames
  const dirty = viewer.set_dirty.bind(viewer);
  viewer.set_dirty = () => { dirty(); wake(); };
  viewer.animate = wake;
  for (const event of ["pointerdown", "pointerup", "wheel", "keydown", "input", "change", "focus"])
    addEventListener(event, wake, { capture: true, passive: true });
  new IntersectionObserver(([pane]) => { seen = pane.isIntersecting; wake(); }).observe(pane);   // or scrolled away
}

function film(frame) {                   // for who renders a film: one frame, without panels; resolves once it is shown
  document.body.classList.add("film");
  player.playing = false;
  look(view.name, false);
  seek(frame / clock().fps);
  refresh();
  viewer.render();
  return new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(true))));
}

function prepare() {                     // before MeshCat hears the first command
  paint = viewer.render.bind(viewer);
  viewer.render = draw;
  rest();
  fitted();
  lit();
  handWatched();
  listen();
}

function run() {
  wake();
}
