// Four plots of a motion over one time: the cursor of one is the cursor of all, and drags the picture through the motion.
const motion = { now: null, at: -1, plots: [] };
const LINES = ["#d55e00", "#0072b2", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"];
const ROOM = { left: 52, right: 10, top: 24, bottom: 24 };

function plotsOf(said) {
  const angles = facts.dials.every(dial => dial.angle), lengths = facts.dials.every(dial => !dial.angle);
  const factor = angles ? DEGREE : lengths ? 1000 : 1, unit = angles ? "°" : lengths ? "mm" : "rad, m";
  const names = facts.dials.map(dial => dial.name), scaled = rows => rows.map(row => row.map(value => value * factor));
  const torque = angles ? "N m" : lengths ? "N" : "N m, N";
  return [
    { title: `q [${unit}]`, rows: scaled(said.q), names, levels: said.goal?.map(value => value * factor) ?? [] },
    { title: `q̇ [${unit}/s]`, rows: scaled(said.v), names, levels: [] },
    { title: `u [${torque}]`, rows: said.u, names: facts.motors, levels: [] },
    { title: said.energy ? `𝒱 [${said.energy}]` : "𝒱: none of a motion by hand", rows: said.energy ? [said.lyapunov] : [], names: [], levels: [] },
  ];
}

const timeNow = () => { const { start, speed } = clock(); return start + speed * player.time; };
const sampleAt = time => {               // the motion's sample nearest to a time
  const { t } = motion.now;
  let low = 0, high = t.length - 1;
  while (high - low > 1) { const middle = (low + high) >> 1; if (t[middle] <= time) low = middle; else high = middle; }
  return time - t[low] < t[high] - time ? low : high;
};

const brief = value => { // as short as a scale needs
  const plain = String(+value.toPrecision(6)), short = Math.abs(value) < 1e-3 || plain.length > 6;
  return (value && short ? value.toExponential(1).replace(".0e", "e") : plain).replaceAll("-", "−");
};

function paintPlot({ canvas, title, rows, names, levels }) {
  const brush = canvas.getContext("2d"), scale = devicePixelRatio, { t } = motion.now;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  Object.assign(canvas, { width: Math.round(width * scale), height: Math.round(height * scale) });
  brush.setTransform(scale, 0, 0, scale, 0, 0);
  brush.font = "11px system-ui, sans-serif";
  const values = [...rows.flat().filter(value => value !== null), ...levels];
  let low = Math.min(...values), high = Math.max(...values);
  if (!values.length) [low, high] = [0, 1];
  const spare = Math.max(0.06 * (high - low), 0.05 * Math.abs(high + low) * (high - low < 1e-6), 1e-7);
  [low, high] = [low - spare, high + spare];
  const x = time => ROOM.left + (time - t[0]) / (t.at(-1) - t[0] || 1) * (width - ROOM.left - ROOM.right);
  const y = value => ROOM.top + (high - value) / (high - low) * (height - ROOM.top - ROOM.bottom);
  brush.strokeStyle = dress("--grid");
  brush.fillStyle = dress("--soft");
  brush.textBaseline = "middle";
  brush.textAlign = "right";
  for (const value of values.length ? ticks(low, high, (height - 50) / 28, false) : []) {
    brush.strokeRect(ROOM.left, Math.round(y(value)) + 0.5, width - ROOM.left - ROOM.right, 0);
    brush.fillText(brief(value), ROOM.left - 5, y(value));
  }
  brush.textBaseline = "top";
  brush.textAlign = "center";
  const times = ticks(t[0], t.at(-1), (width - 60) / 60, false);
  for (const time of times) {
    const at = x(time), last = at > width - 26;
    brush.strokeRect(Math.round(at) + 0.5, ROOM.top, 0, height - ROOM.top - ROOM.bottom);
    brush.textAlign = last ? "right" : "center";
    brush.fillText(digits(time) + (time === times.at(-1) ? " s" : ""), last ? width - 3 : at, height - ROOM.bottom + 6);
  }
  brush.textAlign = "left";
  brush.textBaseline = "alphabetic";
  brush.font = "600 12px system-ui, sans-serif";
  brush.fillStyle = dress("--ink");
  brush.fillText(title, 12, 15);
  let right = 12 + brush.measureText(title).width + 12;
  brush.font = "11px system-ui, sans-serif";
  for (const [k, name] of names.slice(0, rows.length).entries()) {
    const wide = brush.measureText(name).width;
    if (right + wide + 18 > width) break;
    brush.fillStyle = LINES[k % LINES.length];
    brush.fillRect(right, 10, 9, 3);
    brush.fillText(name, right + 13, 15);
    right += wide + 24;
  }
  brush.save();
  brush.beginPath();
  brush.rect(ROOM.left, ROOM.top - 1, width - ROOM.left - ROOM.right, height - ROOM.top - ROOM.bottom + 2);
  brush.clip();
  brush.setLineDash([4, 3]);
  brush.lineWidth = 1;
  for (const [k, level] of levels.entries()) {
    brush.strokeStyle = LINES[k % LINES.length];
    brush.strokeRect(ROOM.left, y(level), width, 0);
  }
  brush.setLineDash([]);
  brush.lineWidth = 1.6;
  for (const [k, row] of rows.entries()) {
    brush.strokeStyle = LINES[k % LINES.length];
    brush.beginPath();
    row.forEach((value, i) => { if (value !== null) brush.lineTo(x(t[i]), y(value)); });
    brush.stroke();
  }
  brush.restore();
}

function makePlots(said) {
  motion.now = said;
  motion.at = -1;
  byId("plots").hidden = false;
  byId("plots").replaceChildren();
  motion.plots = plotsOf(said).map(plot => {
    const holder = document.createElement("div"), canvas = document.createElement("canvas"), hand = document.createElement("i");
    holder.className = "plot";
    hand.className = "cursor";
    canvas.role = "img";
    canvas.ariaLabel = `${plot.title} over time [s]`;
    holder.append(canvas, hand);
    byId("plots").append(holder);
    const scrubTo = event => {
      const share = (event.offsetX - ROOM.left) / (canvas.clientWidth - ROOM.left - ROOM.right), { t } = said;
      const { start, speed } = clock(), time = t[0] + Math.min(Math.max(share, 0), 1) * (t.at(-1) - t[0]);
      player.playing = false;
      seek((time - start) / speed);
    };
    canvas.onpointerdown = event => { canvas.setPointerCapture(event.pointerId); scrubTo(event); };
    canvas.onpointermove = event => { if (canvas.hasPointerCapture(event.pointerId)) scrubTo(event); };
    return { ...plot, canvas, hand };
  });
  motion.plots.forEach(paintPlot);
  wake();
}

const lookAt = latest();
function follow() {                      // the player's time has moved: cursors, numbers and the map's point with it
  if (!motion.now || !(player.duration > 0) || player.actions !== viewer.animator.actions) return;
  if (motion.followed === player.time) return;
  motion.followed = player.time;
  const { t } = motion.now, time = timeNow(), share = (time - t[0]) / (t.at(-1) - t[0] || 1);
  for (const { canvas, hand } of motion.plots)
    hand.style.left = `${ROOM.left + share * (canvas.clientWidth - ROOM.left - ROOM.right)}px`;
  const sample = sampleAt(time);
  if (sample === motion.at) return;
  motion.at = sample;
  if (link.offline) return standAt(sample);
  lookAt({ do: "at", sample: motion.now.sample[sample] }).then(show);
}

function standAt(sample) {               // without Python: q of the motion itself
  here.q = motion.now.q.map(row => row[sample]);
  showDials();
  paintSoon();
}
