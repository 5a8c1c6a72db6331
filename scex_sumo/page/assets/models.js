// Table of vehicles and models: how often a future is critical, given who drives a vehicle.

function modelTable(run, state) {
  const { track_ids: ids, under_test: tested } = run.info, drawn = new Set(run.arrays.levels.values.subarray(0, run.futures * run.vehicles));
  const models = run.info.models.filter((_, model) => drawn.has(model)); // human-like models come after those of the stress test
  const titles = models.map((name) => ({ title: name.replaceAll("_", " "), as: "percent", none: "", down: true }));
  let mean;
  const table = makeTable(byId("models"), { columns: [{ title: "vehicle" }, ...titles], rows: [] }, { mark(cell, { given, v }, i) {
    if (!i || !given[i - 1].count) return;
    const { count, hits, share } = given[i - 1], color = share > mean ? "critical" : "drawn";
    cell.title = `${hits} of ${count}; 95 %: ${range(interval(share, count))}`;
    cell.style.background = `color-mix(in srgb, var(--${color}) ${Math.min(75, Math.round(150 * Math.abs(share - mean)))}%, transparent)`;
    onPress(cell, () => select(v, i - 1));
  } });

  const select = (v, model) => state.filter(`v${v}`, [model], `${ids[v]} as ${models[model]}`, (c) => run.model(c, v) === model);

  function draw(isShown) { // anew, of the vehicles shown
    const { test, words } = criticalBy(run, state), chosen = [...Array(run.futures).keys()].filter((c) => state.mask[c]);
    const hits = chosen.map((c) => Number(test(c)));
    mean = sum(hits) / chosen.length;
    byId("models-about").textContent = `Share of futures with ${words}, by the model of a vehicle; overall ${percent(mean)}. A click selects those futures.`;
    const rows = [...ids.keys()].filter(isShown).map((v) => {
      const id = ids[v], given = models.map((_, model) => hits.filter((_hit, i) => run.model(chosen[i], v) === model)).map((of) => ({ count: of.length, hits: sum(of), share: sum(of) / of.length }));
      const shares = given.map(({ share }) => share), known = shares.filter(Number.isFinite);
      return { cells: [id + (tested.includes(id) ? " (under test)" : ""), ...shares], given, v, spread: Math.max(...known) - Math.min(...known) };
    });
    table.show(rows.sort((a, b) => b.spread - a.spread));
  }
  return { draw, select };
}

// Whether a future is critical by what is in focus: a collision, or a metric's threshold, else its worst tenth.
function criticalBy(run, { focus, thresholds, isCritical }) {
  const collided = new Set(run.info.collided);
  if (focus < 0) return { test: (c) => collided.has(c), words: "a collision" };
  const { name, sign, tenth } = run.info.metrics[focus], limit = thresholds[focus] ?? tenth;
  const words = `${name} ${sign} ${short(limit)}${thresholds[focus] === null ? ", the worst tenth" : ""}`;
  return { test: (c) => isCritical(focus, run.columns[focus][c], limit), words };
}
