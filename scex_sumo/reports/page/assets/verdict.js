// Verdict of a run: P(collision), P(critical), and the worst encounters in words.

// Share with its 95 % interval as a bar; marks for the likely share and a critical recording.
function bar({ value, low, high }, likely, isRecorded) {
  const part = (kind, from, to) => make(`i.${kind}`, { style: `left: ${100 * from}%; width: ${100 * (to - from)}%` });
  return make("div.bar", {}, !Number.isNaN(value) && part("drawn", 0, value), !Number.isNaN(value) && part("range", low, high),
    likely && part("likely", likely.value - 0.006, likely.value + 0.006), isRecorded && part("recorded", 0.985, 1));
}

function drawVerdict(run, state, onEncounter) {
  const { info } = run, { collision } = info;
  const number = make("div.big", percent(collision && collision.value));
  number.classList.toggle("hot", Boolean(collision && collision.value));
  const first = make("div.card", {}, make("h2", "P(collision)"), number, make("p.soft", collision
    ? `${collision.count} of ${some(run.children, "child scenario")}; 95 %: ${range(collision)}` : "not in this result; run it again"),
  info.likely_collisions && make("p", `likely: ${percent(info.likely_collisions[0] / info.likely_collisions[1])}`));

  const shares = make("div.card", {}, make("h2", "P(critical)")), hits = [];
  info.metrics.forEach(({ name, side, mean, recorded }, m) => {
    const limit = state.thresholds[m];
    if (mean || limit === null) return;
    const now = state.share(m, run.columns[m]), likely = run.likely[m] && state.share(m, run.likely[m]);
    const isRecorded = state.isCritical(m, recorded);
    if (isRecorded) hits.push(name);
    const title = `${now.critical} of ${now.count}; 95 %: ${range(now)}${likely ? `; likely ${percent(likely.value)}` : ""}`;
    shares.append(make("div.share", { title }, make("span", `${name} ${side === "left" ? "≤" : "≥"} ${short(limit)}`),
      bar(now, likely, isRecorded), make("b", percent(now.value))));
  });
  const said = !run.recorded ? "nothing was recorded" : hits.length ? `critical by ${hits.join(", ")}` : "not critical";
  shares.append(make("p.soft", `blue: possible, line: 95 %${run.likely[0] ? ", violet: likely" : ""}; recorded future: ${said}`));

  const worst = info.encounters.slice(0, 3).map((row) => make("li", {}, make("button", { onclick: () => onEncounter(row) }, row.words)));
  const list = make("div.card", {}, make("h2", "Worst encounters"), worst.length ? make("ol", {}, ...worst) : make("p", "Nobody meets anybody."));
  byId("verdict").replaceChildren(first, shares, list);
}
