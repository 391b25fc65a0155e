// Dials, live numbers, modes: what is driven, and where it is.
const here = { q: facts.dials.map(() => 0), stopped: null, pose: null, held: null };
const DEGREE = 180 / Math.PI;
const unitOf = dial => dial.angle ? "°" : "mm", factorOf = dial => dial.angle ? DEGREE : 1000;
const order = latest();
const moved = [];                        // who wants to know that the mechanism has moved

function makeDials() {
  for (const [k, dial] of facts.dials.entries()) {
    const row = document.createElement("div"), name = document.createElement("span");
    const [slider, field] = ["range", "text"].map(type => Object.assign(document.createElement("input"), { type }));
    row.className = "dial";
    name.textContent = name.title = dial.name;
    Object.assign(slider, { min: dial.lower, max: dial.upper, step: "any" });
    slider.setAttribute("aria-label", dial.name);
    field.setAttribute("aria-label", `${dial.name}, ${unitOf(dial)}`);
    slider.oninput = () => drive(here.q.map((value, i) => i === k ? Number(slider.value) : value));
    slider.onpointerdown = () => { here.held = slider; };
    slider.onpointerup = slider.onpointercancel = () => { here.held = null; showDials(); };
    field.onchange = () => {
      const value = Number(field.value.replace(unitOf(dial), "").replace("−", "-").trim());
      field.blur();
      if (Number.isFinite(value)) drive(here.q.map((old, i) => i === k ? value / factorOf(dial) : old));
      else showDials();
    };
    row.append(name, field, slider);
    byId("dials").append(row);
  }
}

function showDials() {
  for (const [k, row] of [...byId("dials").children].entries()) {
    const [field, slider] = row.querySelectorAll("input"), dial = facts.dials[k];
    if (slider !== here.held) slider.value = here.q[k];
    if (field !== document.activeElement)
      field.value = `${(here.q[k] * factorOf(dial)).toFixed(dial.angle ? 2 : 1)} ${unitOf(dial)}`.replace("-", "−");
  }
}

async function drive(q) {                // resolves once the closed mechanism is drawn
  return show(await order({ do: "drive", q }));
}

function show(pose) {
  if (pose?.kind === "error") say(pose.words, true);
  if (pose?.kind !== "pose") return pose;
  if (pose.bodies) {
    player.playing = false;
    if (Math.min(...coarse.took) > SLOW) setCoarse(true);
    fine();
    facts.bodies.forEach((path, k) => viewer.set_transform(split(path), pose.bodies[k]));
    paintPose();
  }
  here.q = pose.facts.q;
  here.stopped = pose.stopped;
  if (!here.pose) requestAnimationFrame(tell);
  here.pose = pose;
  return pose;
}

function tell() {                        // the numbers, after the picture
  const { facts: numbers, stopped, mode } = here.pose;
  here.pose = null;
  glow(stopped !== null);
  if (byId("stopped").textContent !== (stopped ?? "")) byId("stopped").textContent = stopped ?? "";
  showDials();
  showFacts(numbers);
  showModes(mode);
  for (const heard of moved) heard();
}

const SLOW = 60;                         // ms a fine picture may take: beyond, it is coarse while it is driven
const COARSE = 0.33;                     // pixels of the picture to one of the window then
const coarse = { on: false, took: [0, 0], sync: null, waits: false };       // the last two fine pictures; one may be a hiccup
const fine = later(250, () => { setCoarse(false); paintPose(); });
function paintPose() {                   // at once, unless the graphics driver is at the picture before: then the newest after it
  viewer.needs_render = false;
  coarse.waits = coarse.sync !== null;
  if (coarse.waits) return;
  viewer.render();
  here.drawn?.();
  const gl = viewer.renderer.getContext();
  coarse.sync = gl.fenceSync?.(gl.SYNC_GPU_COMMANDS_COMPLETE, 0) ?? null;
  gl.flush();
  if (coarse.sync) painted(gl, performance.now(), !coarse.on);
}

function painted(gl, began, whole) {     // machines that draw in software keep up with the hand, and draw finely once it rests
  const passed = performance.now() - began;
  if (gl.getSyncParameter(coarse.sync, gl.SYNC_STATUS) !== gl.SIGNALED && passed < 5000)
    return setTimeout(painted, 2, gl, began, whole);
  gl.deleteSync(coarse.sync);
  coarse.sync = null;
  if (whole) coarse.took = [passed, coarse.took[0]];
  if (coarse.waits) paintPose();
}

function beginCoarsely() {               // where it is known to be drawn in software: the first picture at once, the fine one after it
  const gl = viewer.renderer.getContext(), about = gl.getExtension("WEBGL_debug_renderer_info");
  if (!about || !/swiftshader|llvmpipe|software/i.test(gl.getParameter(about.UNMASKED_RENDERER_WEBGL))) return;
  coarse.took = [2 * SLOW, 2 * SLOW];
  setCoarse(true);
}

function setCoarse(wanted) {             // fewer pixels, and what is drawn plainly: a tenth of the work
  if (coarse.on === wanted) return;
  coarse.on = wanted;
  viewer.renderer.setPixelRatio(wanted ? COARSE : devicePixelRatio);
  drawPlainly(wanted);
}

function glow(stopped) {
  if (here.glows === stopped) return;
  here.glows = stopped;
  byId("stage").classList.toggle("stopped", stopped);
  for (const path of facts.bodies) node(path).object.traverse(part => {
    if (part.isMesh && part.material.emissive) part.material.emissive.setHex(stopped ? 0x7a1008 : 0);
  });
  viewer.set_dirty();
}

const digits = (value, most = 4) => Math.abs(value) >= 1e-3 && Math.abs(value) < 1e5 || value === 0
  ? (+value.toPrecision(most)).toString().replace("-", "−") : value.toExponential(most - 2).replaceAll("-", "−");
const cell = text => `<td>${String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;")}</td>`;

const MATRIX = 7;                        // coordinates up to which D is shown whole
function showFacts({ phi, rcond, D, g, q_free: joints, beyond }) {
  const share = Math.max(0, Math.min(1, 1 + Math.log10(Math.max(rcond, 1e-12)) / 6));   // a millionth: empty
  byId("facts").innerHTML = `<tr><td>1/κ(ψ)</td><td>${rcond.toExponential(2).replace("-", "−")}</td>` +
    `<td><meter aria-label="Distance from singularities" min="0" max="1" low="0.45" high="0.6" optimum="1" value="${share}"></meter></td></tr>` +
    `<tr><td>‖φ‖</td><td>${phi.toExponential(1).replace("-", "−")}</td><td></td></tr>` +
    (beyond.length ? `<tr><td>beyond limits</td><td colspan="2">${beyond.map(name => name.replace(/</g, "&lt;")).join(", ")}</td></tr>` : "");
  const most = g.length > 3 ? 3 : 4;
  byId("model").classList.toggle("wide", g.length > 3 && g.length <= MATRIX);
  byId("model").innerHTML = g.length > MATRIX ? `<tr>${["", "g", "D diagonal"].map(cell).join("")}</tr>` + g.map((value, k) =>
    `<tr>${[facts.dials[k].name, digits(value), digits(D[k][k])].map(cell).join("")}</tr>`).join("") : `<tr>${cell("g")}${g.map(value => cell(digits(value, most))).join("")}</tr>` +
    D.map((row, k) => `<tr>${cell(k ? "" : "D")}${row.map(value => cell(digits(value, most))).join("")}</tr>`).join("");
  if (byId("joints").parentElement.open)
    byId("joints").innerHTML = joints.map(([name, ...q]) => `<tr>${[name, ...q.map(value => digits(value))].map(cell).join("")}</tr>`).join("");
}

function showModes({ signs, own }) {
  const words = JSON.stringify([signs, own]), holder = byId("modes");
  if (holder.dataset.shown === words) return;
  holder.dataset.shown = words;
  holder.replaceChildren(...signs.map((sign, k) => {
    const button = document.createElement("button");
    button.textContent = `${k + 1} ${sign > 0 ? "+" : sign < 0 ? "−" : ""}`;
    button.title = `mode ${k + 1}, det ψ ${sign > 0 ? "> 0" : sign < 0 ? "< 0" : "undefined"}`;
    button.className = k === own ? "on" : "";
    button.onclick = async () => { if (show(await order({ do: "mode", mode: k }))?.kind === "pose") chartAnew(); };
    button.disabled = link.offline;
    return button;
  }));
  if (!signs.length) holder.innerHTML = '<span class="quiet">the reference’s; others not sought yet</span>';
}

on("modes", ({ mode, words }) => { idle("modes"); showModes(mode); say(`${mode.signs.length} assembly modes: ${words}`); });
byId("find-modes").onclick = () => begin("modes", { do: "modes" });
byId("notes").hidden = !facts.notes.length;
byId("notes").querySelector("ul").append(...facts.notes.map(note =>
  Object.assign(document.createElement("li"), { textContent: note })));
