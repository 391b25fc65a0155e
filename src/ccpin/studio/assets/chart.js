// The map of Ω in two coordinates (or one): what is proved or sampled, and where the mechanism is. Drag it to drive.
const sheet = byId("omega"), pen = sheet.getContext("2d");
const chart = { axes: facts.dials.length > 1 ? [0, 1] : [0], window: null, cells: null, curves: [], square: null, level: null,
  goal: null, layer: null, zoom: null, words: "" };
const COLOURS = { 0: "#f2d16b", 1: "#d1541f", 2: "#9ccb9f", 3: "#d1541f", 4: "#e4e7eb" };
const LEGEND = [["certified", "#9ccb9f"], ["undecided", "#d1541f"], ["not reached", "#f2d16b"], ["empty", "#e4e7eb"]];
const INK = { here: "#16202b", goal: "#2e8b57", square: "#2970bd", level: "#7b2d8e", fold: "#8a2f0b", path: "#3d4a58" };

const dialAt = k => facts.dials[chart.axes[k]];
const flat = () => chart.axes.length === 1;
const view2 = () => chart.zoom ?? whole2();
function whole2() {                      // the whole of the map in its two coordinates; one coordinate is a strip
  const low = chart.axes.map(k => facts.dials[k].lower), high = chart.axes.map(k => facts.dials[k].upper);
  const { region } = chart.cells ?? {};
  const ends = region ?? [low, high];
  return flat() ? [[ends[0][0], 0], [ends[1][0], 1]] : ends;
}

const MARGIN = { left: 44, right: 12, top: 8, bottom: 34 };
function frame2() {                      // pixels: where the window lies on the sheet
  const width = sheet.clientWidth - MARGIN.left - MARGIN.right, height = sheet.clientHeight - MARGIN.top - MARGIN.bottom;
  const tall = flat() ? Math.min(height, 70) : height;
  const size = flat() ? width : Math.min(width, tall);
  return { x: MARGIN.left + (width - size) / 2, y: MARGIN.top, width: size, height: flat() ? tall : size };
}

function place(q) {                      // a point of the two coordinates on the sheet, in pixels
  const [low, high] = view2(), [first, last] = whole2(), box = frame2();
  const turned = q.map((value, k) => {
    const width = last[k] - first[k];
    return dialAt(k)?.angle && width > 6.28 ? value - width * Math.floor((value - first[k]) / width) : value;
  });
  const y = flat() ? 0.5 : (turned[1] - low[1]) / (high[1] - low[1]);
  return [box.x + box.width * (turned[0] - low[0]) / (high[0] - low[0]), box.y + box.height * (1 - y)];
}

function under(event) {                  // the two coordinates under the pointer
  const [low, high] = view2(), box = frame2(), at = sheet.getBoundingClientRect();
  const share = [(event.clientX - at.left - box.x) / box.width, 1 - (event.clientY - at.top - box.y) / box.height];
  return share.map((one, k) => low[k] + Math.min(Math.max(one, 0), 1) * (high[k] - low[k]));
}

function pointAt(event) {                // q under the pointer: the two coordinates replaced, in the turn they are in
  const [first, last] = whole2(), point = under(event), q = [...here.q];
  chart.axes.forEach((axis, k) => {
    const width = last[k] - first[k];
    const turns = facts.dials[axis].angle && width > 6.28 ? Math.floor((here.q[axis] - first[k]) / width) : 0;
    q[axis] = point[k] + turns * width;
  });
  return q;
}

function zoom(event) {                   // about the pointer, down to a thousandth and back to the whole
  event.preventDefault();
  const [low, high] = view2(), [first, last] = whole2(), point = under(event), factor = 1.0015 ** event.deltaY;
  const wide = last.map((value, k) => Math.max((high[k] - low[k]) * factor, 1e-3 * (value - first[k])));
  const start = point.map((value, k) => value - (value - low[k]) / (high[k] - low[k]) * wide[k]);
  const inside = start.map((value, k) => Math.min(Math.max(value, first[k]), last[k] - wide[k]));
  chart.zoom = wide[0] >= last[0] - first[0] ? null : flat() ? [[inside[0], 0], [inside[0] + wide[0], 1]]
    : [inside, inside.map((value, k) => value + wide[k])];
  paintSoon();
}

function unpack(cells) {
  if (!cells) return null;
  const corners = new Float32Array(bytes(cells.corners).buffer);
  return { corners, status: bytes(cells.status), region: cells.region };
}

function layer() {                       // cells and samples, drawn once for each size of the sheet
  const box = frame2(), scale = devicePixelRatio;
  const key = [box.width, box.height, scale, view2()].join();
  if (chart.layer?.key === key && chart.layer.of === (chart.cells ?? chart.samples)) return chart.layer.canvas;
  const canvas = Object.assign(document.createElement("canvas"),
    { width: Math.max(1, box.width * scale), height: Math.max(1, box.height * scale) });
  const brush = canvas.getContext("2d"), [low, high] = view2();
  const x = value => (value - low[0]) / (high[0] - low[0]) * canvas.width;
  const y = value => (1 - (value - low[1]) / (high[1] - low[1])) * canvas.height;
  if (chart.cells) {
    const { corners, status } = chart.cells, n = chart.axes.length;
    for (let k = 0; k < status.length; k++) {
      const at = 2 * n * k, left = x(corners[at]), right = x(corners[at + n]);
      const top = n > 1 ? y(corners[at + 3]) : 0, bottom = n > 1 ? y(corners[at + 1]) : canvas.height;
      brush.fillStyle = COLOURS[status[k]];
      brush.fillRect(left, top, right - left + 0.5, bottom - top + 0.5);
      if (right - left > 7 && status[k] === 2) {
        brush.strokeStyle = "rgba(255, 255, 255, .5)";
        brush.strokeRect(left + 0.5, top + 0.5, right - left - 1, bottom - top - 1);
      }
    }
  } else if (chart.samples) {
    const { x: across, y: up, value } = chart.samples;
    const wide = (across.at(-1) - across[0]) / (across.length - 1), high2 = (up.at(-1) - up[0]) / (up.length - 1);
    const best = Math.max(...value.flat().filter(one => one !== null), 1e-12);
    value.forEach((row, j) => row.forEach((one, i) => {
      if (one === null) return;
      const share = Math.max(0, 1 + Math.log10(one / best) / 3);
      brush.fillStyle = `hsl(${20 + 120 * share} 38% ${58 + 14 * share}%)`;
      const left = x(across[i] - wide / 2), top = y(up[j] + high2 / 2);
      brush.fillRect(left, top, x(across[i] + wide / 2) - left + 0.5, y(up[j] - high2 / 2) - top + 0.5);
    }));
  }
  chart.layer = { key, canvas, of: chart.cells ?? chart.samples };
  return canvas;
}

function line(points, closed = false) {  // broken where it leaves one edge of a full turn for the other
  const box = frame2();
  pen.beginPath();
  let before = null;
  for (const point of points) {
    const [x, y] = place(point);
    const jumps = before && (Math.abs(x - before[0]) > box.width / 2 || Math.abs(y - before[1]) > box.height / 2);
    if (!before || jumps) pen.moveTo(x, y); else pen.lineTo(x, y);
    before = [x, y];
  }
  if (closed) pen.closePath();
}

function dot([x, y], radius, fill, stroke) {
  pen.beginPath();
  pen.arc(x, y, radius, 0, 7);
  pen.fillStyle = fill;
  if (fill) pen.fill();
  pen.strokeStyle = stroke;
  pen.lineWidth = 2;
  if (stroke) pen.stroke();
}

const chosen = q => chart.axes.map(axis => q[axis]);
function paintChart() {
  const scale = devicePixelRatio, box = frame2();
  if (sheet.width !== Math.round(sheet.clientWidth * scale) || sheet.height !== Math.round(sheet.clientHeight * scale))
    Object.assign(sheet, { width: Math.round(sheet.clientWidth * scale), height: Math.round(sheet.clientHeight * scale) });
  pen.setTransform(scale, 0, 0, scale, 0, 0);
  pen.clearRect(0, 0, sheet.clientWidth, sheet.clientHeight);
  if (box.width < 20) return;
  pen.fillStyle = "#f4f6f8";
  pen.fillRect(box.x, box.y, box.width, box.height);
  pen.drawImage(layer(), box.x, box.y, box.width, box.height);
  pen.save();
  pen.beginPath();
  pen.rect(box.x, box.y, box.width, box.height);
  pen.clip();
  pen.lineWidth = 1.6;
  for (const { kind, q } of flat() ? [] : chart.curves) {
    pen.strokeStyle = INK.fold;
    if (q.length === 1) dot(place(q[0]), 4.5, "#fff", "#2970bd");
    else { line(q); pen.stroke(); }
  }
  if (chart.level && String(chart.level.axes) === String(chart.axes)) for (const edge of chart.level.lines) {
    line(edge, true);
    pen.fillStyle = "rgba(123, 45, 142, .14)";
    pen.fill();
    pen.strokeStyle = INK.level;
    pen.stroke();
  }
  if (chart.square?.radius > 0) {
    const [x, y] = place(chosen(chart.square.centre)), [low, high] = view2();
    const half = [0, 1].map(k => chart.square.radius / (high[k] - low[k]) * (k ? box.height : box.width));
    pen.setLineDash([5, 3]);
    pen.strokeStyle = INK.square;
    pen.strokeRect(x - half[0], flat() ? box.y + 2 : y - half[1], 2 * half[0], flat() ? box.height - 4 : 2 * half[1]);
    pen.setLineDash([]);
  }
  if (motion.now) {
    line(motion.now.t.map((_, k) => chart.axes.map(axis => motion.now.q[axis][k])));
    pen.strokeStyle = INK.path;
    pen.stroke();
  }
  if (chart.goal) dot(place(chosen(chart.goal)), 7, "", INK.goal);
  const at = place(chosen(here.q));
  if (here.stopped) dot(at, 11, "rgba(196, 44, 32, .3)", "");
  dot(at, 5, here.stopped ? "#c42c20" : INK.here, "#fff");
  pen.restore();
  pen.strokeStyle = dress("--edge");
  pen.lineWidth = 1;
  pen.strokeRect(box.x + 0.5, box.y + 0.5, box.width - 1, box.height - 1);
  paintScales(box);
}

function paintScales(box) {
  const [low, high] = view2();
  pen.fillStyle = dress("--soft");
  pen.font = "11px system-ui, sans-serif";
  chart.axes.forEach((axis, k) => {
    const dial = facts.dials[axis], factor = factorOf(dial);
    const steps = ticks(low[k] * factor, high[k] * factor, (k ? box.height : box.width) / 55, dial.angle);
    for (const value of steps) {
      const share = (value / factor - low[k]) / (high[k] - low[k]), text = String(value).replace("-", "−");
      const last = k === 0 && share > 0.97;
      pen.textAlign = k ? "right" : last ? "right" : share < 0.03 ? "left" : "center";
      pen.textBaseline = k ? (share > 0.97 ? "top" : share < 0.03 ? "bottom" : "middle") : "top";
      if (k) pen.fillText(text, box.x - 5, box.y + box.height * (1 - share));
      else pen.fillText(text, box.x + box.width * share, box.y + box.height + 4);
    }
    pen.textAlign = "center";
    pen.textBaseline = k ? "middle" : "alphabetic";
    const name = fitting(dial.name, ` [${unitOf(dial)}]`, k ? box.height : box.width + 60);
    if (!k) pen.fillText(name, box.x + box.width / 2, box.y + box.height + 29);
    else {
      pen.save();
      pen.translate(box.x - 37, box.y + box.height / 2);
      pen.rotate(-Math.PI / 2);
      pen.fillText(name, 0, 0);
      pen.restore();
    }
  });
}

function fitting(name, rest, room) {
  let text = name;
  while (text.length > 3 && pen.measureText(text + rest).width > room) text = `${text.slice(0, -2)}…`;
  return text + rest;
}

function ticks(low, high, most, angle) { // round numbers; degrees in parts of a turn
  const span = high - low, rough = span / Math.max(most, 2);
  const power = 10 ** Math.floor(Math.log10(rough));
  const steps = angle && rough > 5 ? [10, 15, 30, 45, 60, 90, 180, 360] : [1, 2, 5, 10].map(one => one * power);
  const step = steps.find(one => one >= rough) ?? steps.at(-1);
  const first = Math.ceil(low / step - 1e-9), count = Math.floor(high / step + 1e-9) - first + 1;
  return Array.from({ length: Math.max(0, count) }, (_, k) => +((first + k) * step).toPrecision(12));
}

let painting = 0;
function paintSoon() {
  if (!painting) painting = requestAnimationFrame(() => { painting = 0; paintChart(); });
}

// What Python says of the map.
on("chart", message => {
  if (message.done) idle("chart");
  chart.cells = unpack(message.cells) ?? (facts.dials.length > 2 || !message.cells ? null : chart.cells);
  chart.known = Boolean(message.region);
  if (message.curves.length || !chart.curves.length) chart.curves = message.curves;
  chart.words = message.words;
  sliceSoon();
  showLegend();
});
on("slice", ({ axes, cells, samples }) => {
  idle("slice");
  if (String(axes) !== String(chart.axes)) return;
  chart.cells = unpack(cells);
  chart.samples = samples;
  showLegend();
});
on("square", message => { chart.square = message; idle("square"); showLegend(); });
on("sublevel", message => {
  idle("sublevel");
  chart.level = message;
  say(message.level > 0 ? `𝒱 < ${digits(message.level)} J. ${message.words}` : message.words, message.verdict !== "proven");
  showLegend();
});
on("goal", ({ q, commands }) => {
  play3(commands);
  Object.assign(chart, { goal: q, level: null });
  byId("goal").textContent = q.map((value, k) => `${(value * factorOf(facts.dials[k])).toFixed(facts.dials[k].angle ? 1 : 0)}`
    .replace("-", "−")).slice(0, 3).join(", ") + (q.length > 3 ? ", …" : ` ${unitOf(facts.dials[0])}`);
  showLegend();
});

function showLegend() {
  const entries = chart.cells ? [...LEGEND] : chart.samples ? [["sampled 1/κ(ψ): high", "hsl(140 38% 72%)"], ["low", "hsl(20 38% 58%)"]] : [];
  const lines = [chart.curves.some(({ q }) => q.length > 1) && ["singular", INK.fold],
    chart.curves.some(({ q }) => q.length === 1) && ["self-motion", "#2970bd", "50%"], chart.square?.radius > 0 && ["Theorem 2", INK.square],
    chart.level?.lines.length && ["𝒱 < c", INK.level], chart.goal && ["goal", INK.goal]].filter(Boolean);
  byId("legend").replaceChildren(...[...entries, ...lines].map(([name, colour, round], k) => {
    const entry = document.createElement("span"), mark = document.createElement("i");
    mark.style[k < entries.length ? "background" : "border"] = k < entries.length ? colour : `2px solid ${colour}`;
    if (round) mark.style.borderRadius = round;
    entry.append(mark, name);
    return entry;
  }));
  byId("charted").textContent = chart.words;
  paintSoon();
}

const sliceSoon = later(120, () => { // more coordinates than two: the slice through where the mechanism is by now
  if (link.offline || flat() || (facts.dials.length === 2 && chart.cells)) return;
  ask({ do: "slice", axes: chart.axes });
});
const squareSoon = later(200, () => {    // once it rests: Theorem 2's square, and the views that show it all
  if (link.offline) return;
  ask({ do: "square" });
  ask({ do: "frame" });
});
on("frame", ({ commands }) => play3(commands));
const play3 = commands => commands.forEach(command => viewer.handle_command_bytearray(bytes(command)));
const chartAnew = () => {
  Object.assign(chart, { cells: null, curves: [], words: "" });
  begin("chart", { do: "chart" });
};
moved.push(paintSoon, squareSoon, () => {
  const others = JSON.stringify(here.q.filter((_, k) => !chart.axes.includes(k)).map(value => value.toFixed(4)));
  if (others !== chart.others) sliceSoon();
  chart.others = others;
});

function listenChart() {
  byId("sheet").classList.toggle("flat", flat());
  const selects = [byId("axis-x"), byId("axis-y")];
  byId("axes").hidden = facts.dials.length < 3;
  selects.forEach((select, k) => {
    select.append(...facts.dials.map(({ name }, value) => Object.assign(document.createElement("option"), { value, textContent: name })));
    select.value = k;
    select.onchange = () => {
      const other = selects[1 - k];
      if (other.value === select.value) other.value = chart.axes[k];
      chart.axes = selects.map(one => Number(one.value));
      Object.assign(chart, { cells: null, samples: null, others: "", zoom: null });
      paintSoon();
      sliceSoon();
    };
  });
  sheet.onpointerdown = event => {
    if (link.offline) return;
    if (event.shiftKey) return void ask({ do: "goal", q: pointAt(event) }).then(show);
    sheet.setPointerCapture(event.pointerId);
    drive(pointAt(event));
  };
  sheet.onpointermove = event => { if (sheet.hasPointerCapture(event.pointerId)) drive(pointAt(event)); };
  sheet.onkeydown = event => {            // a hundredth of the map's width at a press
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowDown: [0, -1], ArrowUp: [0, 1] }[event.key], [low, high] = view2();
    if (!step || link.offline) return;
    event.preventDefault();
    event.stopPropagation();
    const q = [...here.q];
    chart.axes.forEach((axis, k) => { q[axis] += step[k] * (high[k] - low[k]) / 100; });
    drive(q);
  };
  sheet.addEventListener("wheel", zoom, { passive: false });
  sheet.ondblclick = () => { chart.zoom = null; paintSoon(); };
  new ResizeObserver(paintSoon).observe(sheet);
}
