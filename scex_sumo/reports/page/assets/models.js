// Table of vehicles and models: how often a child is critical, given who drives a vehicle.

const FEW = 5; // children that say too little

function drawModels(run, state) {
  const { info, children, vehicles } = run, models = info.models.length;
  const { test, words } = criticalBy(run, state), hits = new Float64Array(vehicles * models), counts = new Float64Array(vehicles * models);
  for (let c = 0; c < children; c++) {
    const hit = test(c);
    for (let v = 0; v < vehicles; v++) {
      counts[v * models + run.model(c, v)]++;
      hits[v * models + run.model(c, v)] += hit;
    }
  }
  const mean = hits.subarray(0, models).reduce((sum, hit) => sum + hit, 0) / children;
  const cellOf = (v, model) => {
    const i = v * models + model, count = counts[i], share = hits[i] / count;
    const cell = make("td.cell", count ? percent(share) : "");
    if (!count) return cell;
    cell.classList.toggle("few", count < FEW);
    cell.title = `${hits[i]} of ${count}; 95 %: ${range(wilson(hits[i], count))}`;
    const color = share > mean ? "critical" : "drawn", ink = Math.min(75, Math.round(150 * Math.abs(share - mean)));
    cell.style.background = `color-mix(in srgb, var(--${color}) ${ink}%, transparent)`;
    return onPress(cell, () => state.filter(`vehicle ${v}`, `${run.id(v)} as ${info.models[model]}`, (c) => run.model(c, v) === model));
  };
  const spread = (v) => {
    const known = info.models.map((_, model) => v * models + model).filter((i) => counts[i] >= FEW).map((i) => hits[i] / counts[i]);
    return known.length ? Math.max(...known) - Math.min(...known) : 0;
  };
  const order = [...info.track_ids.keys()].sort((a, b) => spread(b) - spread(a));
  byId("models-about").textContent = `Share of children with ${words}, given who drives a vehicle; overall ${percent(mean)}. A click selects those children.`;
  byId("models").replaceChildren(make("div.scroll", {}, make("table", {},
    make("thead", {}, make("tr", {}, ...["vehicle", ...info.models].map((name) => make("th", name.replaceAll("_", " "))))),
    make("tbody", {}, ...order.map((v) => make("tr", {}, make("td", run.id(v) + (info.under_test.includes(run.id(v)) ? " (under test)" : "")),
      ...info.models.map((_, model) => cellOf(v, model))))))));
}

// Whether a child is critical by what is in focus: a collision, or a metric's threshold, else its worst tenth.
function criticalBy(run, { focus, thresholds, isCritical }) {
  const collided = new Set(run.info.events.rows.filter(({ metric }) => metric < 0).flatMap(({ children }) => children));
  if (focus < 0) return { test: (c) => collided.has(c), words: "a collision" };
  const { name, side, tenth } = run.info.metrics[focus], limit = thresholds[focus] ?? tenth;
  const words = `${name} ${side === "left" ? "≤" : "≥"} ${short(limit)}${thresholds[focus] === null ? ", the worst tenth" : ""}`;
  return { test: (c) => isCritical(focus, run.columns[focus][c], limit), words };
}
