// Verdict of a run: P(critical), which follows the thresholds.

// Share with its 95 % interval as a bar; marks for the likely share and a critical recording.
function bar({ value, low, high }, likely, isRecorded) {
  const part = (kind, from, to) => make(`i.${kind}`, { style: `left: ${100 * from}%; width: ${100 * (to - from)}%` });
  return make("div.bar", {}, !isMissing(value) && part("drawn", 0, value), !isMissing(value) && part("range", low, high),
    likely && part("likely", likely.value - 0.006, likely.value + 0.006), isRecorded && part("recorded", 0.985, 1));
}

function drawShares(run, state) {
  const hits = [];
  const lines = run.info.metrics.map(({ name, side, mean, recorded }, m) => {
    const limit = state.thresholds[m];
    if (mean || limit === null) return "";
    const now = state.share(m, run.columns[m]), likely = run.likely[m] && state.share(m, run.likely[m]);
    const isRecorded = state.isCritical(m, recorded);
    if (isRecorded) hits.push(name);
    const title = `${now.critical} of ${now.count}; 95 %: ${range(now)}${likely ? `; likely ${percent(likely.value)}` : ""}`;
    return make("div.share", { title }, make("span", `${name} ${side === "left" ? "≤" : "≥"} ${short(limit)}`),
      bar(now, likely, isRecorded), make("b", percent(now.value)));
  });
  const said = !run.recorded ? "nothing was recorded" : hits.length ? `critical by ${hits.join(", ")}` : "not critical";
  const about = `blue: possible, line: 95 %${run.likely[0] ? ", violet: likely" : ""}; recorded future: ${said}`;
  byId("shares").replaceChildren(...lines, make("p.soft", about));
}
