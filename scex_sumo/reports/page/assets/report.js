// Report of a run: puts map, charts and tables together.

function runReport(run) {
  const { info, id } = run, state = makeState(run);
  const map = new MapView(run, state, byId("map")), pairChart = new PairChart(run, state, byId("pair"));
  const player = makePlayer(run, state, map), charts = info.metrics.map((_, m) => new MetricChart(run, state, m));
  const isOpen = (pair) => state.pair && pair && pair.every((v) => state.pair.includes(v));

  function jump({ pair, child, step }) {
    state.change({ pair, child, step: clamp(step, 0, run.frames - 1), playing: false });
    if (map.canvas.getBoundingClientRect().bottom < 60) byId("stage").scrollIntoView({ behavior: "smooth" });
  }

  const encounterTable = makeTable(byId("encounters"), info.encounters, { onRow: jump, isChosen: (row) => isOpen(row.pair), first: 8 });
  const worstTable = makeTable(byId("worst"), info.events, { onRow: jump, isChosen: (row) => row.children.includes(state.child) });

  function letGo(key) {
    for (const chart of charts) if (`metric ${chart.m}` === key) chart.brush = null;
    state.filter(key, "", null);
  }

  function drawChips() {
    const chips = [...state.filters].map(([key, { words }]) => make("button.chip", { title: "Let go", onclick: () => letGo(key) }, `${words} ×`));
    if (chips.length) chips.unshift(make("b", `${state.count} of ${some(run.children, "child", "children")}`));
    byId("chips").replaceChildren(...chips);
  }

  function drawPair() {
    byId("pairbox").hidden = !state.pair;
    if (!state.pair) return;
    const now = pairChart.draw(), [a, b] = state.pair, { child } = state;
    const of = child < 0 ? "all children" : `child ${child} (${[a, b].map((v) => info.models[run.model(child, v)]).join(", ")})`;
    byId("pair-title").textContent = `Gap of ${id(a)} and ${id(b)}, ${of}${now === null ? "" : `: ${now.toFixed(1)} m at ${seconds(state.step)}`}`;
  }

  function drawCharts() {
    const isMean = byId("means").value === "mean", shown = charts.filter((chart) => chart.metric.mean === isMean);
    if (!shown.every((chart) => chart.element.isConnected)) byId("charts").replaceChildren(...shown.map((chart) => chart.element));
    for (const chart of shown) chart.draw();
  }

  state.listen((changed) => {
    const any = (...names) => names.some((name) => changed.has(name));
    if (any("mask")) map.weigh();
    if (any("pair", "child")) player.chase();
    map.draw();
    player.draw();
    if (any("mask", "child", "thresholds", "curve", "theme", "size")) drawCharts();
    if (any("pair", "child", "step", "mask", "theme", "size")) drawPair();
    if (any("mask")) drawChips();
    if (any("thresholds")) drawShares(run, state);
    if (any("thresholds", "focus")) drawModels(run, state);
    if (any("focus")) worstTable.show(info.events.rows.filter((row) => row.metric === state.focus));
    if (any("pair", "child")) [encounterTable, worstTable].forEach((table) => table.draw());
  });

  info.models.forEach((_, m) => { document.querySelector(`#legend i[data-model="${m}"]`).style.background = info.colors[m]; });
  for (const button of document.querySelectorAll("[data-encounter]")) button.onclick = () => jump(info.encounters.rows[button.dataset.encounter]);
  byId("focus").onchange = (event) => state.change({ focus: Number(event.target.value) });
  byId("curve").onchange = (event) => state.change({ curve: event.target.value });
  byId("means").onchange = () => state.change({}, "curve");
  byId("release").onclick = () => {
    map.first = null;
    [...state.filters.keys()].forEach(letGo);
    state.change({ pair: null });
  };
  onTheme(() => { state.change({}, "theme"); state.tell(); });
  let width = 0;
  new ResizeObserver(() => {
    if (Math.abs(map.canvas.clientWidth - width) > 40 && !state.pair) map.fit();
    width = map.canvas.clientWidth;
    state.change({}, "size");
  }).observe(document.body);
  encounterTable.draw();
  state.change({ focus: Number(byId("focus").value) }, "mask", "thresholds");
}

unpack(byId("data").textContent).then((content) => runReport(runOf(content)));
