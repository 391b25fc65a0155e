// Everything put together; offline, what the page was told last.
makeDials();
listenChart();
listenExperiment();
byId("tools").insertAdjacentHTML("afterend", '<div id="gripped" class="panel"></div>');
makeGrip();
byId("gripped").hidden = !byId("gripped").children.length;
addEventListener("resize", () => motion.plots.forEach(paintPlot));
follow();
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
Object.assign(window, { studioHere: here, studioDrive: drive });   // for who measures, and for scripts
