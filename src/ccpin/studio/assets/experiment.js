// Experiments from here to the goal, recording by hand, and what is kept of them.
const running = new Set();

function begin(job, message) {           // an order that a thread answers, with its progress shown until then
  running.add(job);
  working(job, null, { modes: "searching the modes", chart: "the map", simulate: "simulating", sublevel: "Theorem 3" }[job] ?? job);
  ask(message).then(answer => { if (answer?.kind === "error") { idle(job); say(answer.words, true); } });
}

function working(job, share, words) {
  byId("work").hidden = false;
  byId("work").dataset.job = job;
  const bar = byId("work").querySelector("progress");
  if (share === null) bar.removeAttribute("value"); else bar.value = share;
  byId("work").querySelector("span").textContent = words;
}

function idle(job) {
  running.delete(job);
  const other = [...running].at(-1);
  if (other) byId("work").dataset.job = other;
  else byId("work").hidden = true;
}

on("progress", ({ job, share, words }) => { if (running.has(job)) working(job, share, words); });
on("error", ({ job, words }) => { if (job) { idle(job); say(words, true); } });
on("cancelled", ({ job }) => idle(job));
on("pose", message => { if (link.offline) show(message); });
on("motion", said => {
  idle("simulate");
  play3(said.commands);
  makePlots(said);
  say(`${said.title}: ${said.status}, ${said.words}; largest ‖φ‖ ${said.closure.toExponential(1)}`, said.status !== "finished");
  for (const id of ["npz", "csv"]) byId(id).disabled = link.offline;
  paintSoon();
});
on("recording", ({ on: active }) => {
  byId("record").classList.toggle("recording", active);
  byId("record").textContent = active ? "Stop" : "Record";
  if (active) say("Recording: drive by dials, map or handle, then stop.");
});
on("file", ({ name, content }) => {
  const url = URL.createObjectURL(new Blob([bytes(content)]));
  Object.assign(document.createElement("a"), { href: url, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 60000);
  say(`Saved ${name}.`);
});

const gains = id => byId(id).value.split(/[\s,;]+/).filter(part => part).map(Number);
function asked() {
  const n = facts.dials.length, spread = list => list.length === 1 ? Array(n).fill(list[0]) : list;
  return { law: byId("law").value, K_p: spread(gains("kp")), K_v: spread(gains("kv")), duration: Number(byId("duration").value) };
}

async function offerGains() {
  const offered = await ask({ do: "gains", law: byId("law").value });
  if (offered.kind === "error") return say(offered.words, true);
  for (const [id, values] of [["kp", offered.K_p], ["kv", offered.K_v]])
    byId(id).value = values.map(value => +value.toPrecision(4)).join("  ");
}

function listenExperiment() {
  byId("law").append(...Object.entries(facts.laws).map(([value, textContent]) =>
    Object.assign(document.createElement("option"), { value, textContent })));
  byId("law").onchange = offerGains;
  byId("set-goal").onclick = async () => { await ask({ do: "goal" }); offerGains(); };
  byId("simulate").onclick = () => begin("simulate", { do: "simulate", ...asked() });
  byId("certify").onclick = () => begin("sublevel", { do: "sublevel", axes: chart.axes, ...asked() });
  byId("certify").hidden = flat();
  byId("cancel").onclick = () => ask({ do: "cancel", job: byId("work").dataset.job });
  byId("record").onclick = () => ask({ do: "record" }).then(answer => { if (answer.kind === "error") say(answer.words, true); });
  for (const form of ["npz", "csv"]) byId(form).onclick = () => ask({ do: "save", format: form });
  byId("export").onclick = () => ask({ do: "export" });
}
