// Verdict of a run: P(critical), which follows the thresholds.

function drawShares(run, state) {
  const hits = [];
  for (const line of all(".share")) {
    const m = Number(line.dataset.metric), { name, side, recorded } = run.info.metrics[m], limit = state.thresholds[m];
    line.hidden = limit === null;
    if (line.hidden) continue;
    const now = state.share(m), likely = run.likely[m] ? state.share(m, run.likely[m]).value : NaN, [words, value] = all("span, b", line);
    if (state.isCritical(m, recorded)) hits.push(name);
    line.title = `${now.words}${isMissing(likely) ? "" : `; likely ${percent(likely)}`}`;
    words.textContent = `${name} ${side === "left" ? "≤" : "≥"} ${short(limit)}`;
    value.textContent = percent(now.value);
    const ends = [[0, now.value], [now.low, now.high], [likely - 0.006, likely + 0.006]];
    all("i", line).forEach((mark, i) => {
      mark.hidden = isMissing(ends[i][0]);
      Object.assign(mark.style, { left: `${100 * ends[i][0]}%`, width: `${100 * (ends[i][1] - ends[i][0])}%` });
    });
  }
  byId("recorded-said").textContent = !run.recorded ? "nothing was recorded" : hits.length ? `critical by ${hits.join(", ")}` : "not critical";
}
