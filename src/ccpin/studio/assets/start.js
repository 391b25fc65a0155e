// Everything put together; offline, what the page was told last. Scripts in the page drive by `studio`.
window.studio = { facts, link, here, chart, motion, on, ask, drive,
  placeOf: q => {                        // where a q is on the map, in the window's pixels
    const at = sheet.getBoundingClientRect(), [x, y] = place(chosen(q));
    return [at.left + x, at.top + y];
  },
  gripAt: () => {                        // where the handle is, in the window's pixels
    const at = pane.getBoundingClientRect(), seen = grip.place.clone().project(viewer.camera);
    return [at.left + (1 + seen.x) * at.width / 2, at.top + (1 - seen.y) * at.height / 2];
  },
  drawn: () => new Promise(done => { here.drawn = done; }) };             // resolves when the next pose has been drawn
beginCoarsely();
makeDials();
listenChart();
listenExperiment();
byId("tools").insertAdjacentHTML("afterend", '<div id="gripped" class="panel"></div>');
makeGrip();
byId("gripped").hidden = !byId("gripped").children.length;
addEventListener("resize", () => motion.plots.forEach(paintPlot));
turns.push(follow);
if (link.offline) {
  document.body.classList.add("offline");
  document.querySelectorAll(".side input, .side button, .side select").forEach(one => { one.disabled = true; });
  replay.forEach(heard);
  say("An exported page: the motion plays and scrubs; driving needs ccpin studio.");
} else {
  connect(async () => {
    show(await ask({ do: "hello" }));
    begin("chart", { do: "chart" });
    await ask({ do: "goal" });
    offerGains();
    squareSoon();
  });
}
