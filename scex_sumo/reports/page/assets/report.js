// Report of a run: puts map, charts and tables together.

function runReport(run) {
  const { info, id } = run, state = makeState(run), map = makeMap(run, state, byId("map"));
  const drawPlayer = makePlayer(run, state, map), drawGaps = pairChart(run, state, byId("pair")), drawModels = modelTable(run, state);
  const charts = all(".chart").map((element) => makeChart(run, state, element));

  function jump({ pair, child, step }) {
    state.change({ pair, child, step, playing: false });
    byId("mapbox").scrollIntoView({ behavior: "smooth", block: "nearest" });
  }

  const isOpen = ({ pair }) => Boolean(state.pair && pair) && pair.every((v) => state.pair.includes(v));
  const encounters = makeTable(byId("encounters"), info.encounters, { onRow: jump, isChosen: isOpen });
  const worst = makeTable(byId("worst"), info.events, { onRow: jump, isChosen: ({ children }) => children.includes(state.child) });

  const letGo = (key) => key instanceof Function ? key() : state.filter(key); // a chart has its brush as well

  function drawChips() {
    const chips = [...state.filters].map(([key, { words }]) => make("button.chip", { textContent: `${words} ×`, title: "Clear", onclick: () => letGo(key) }));
    byId("chips").replaceChildren(...(chips.length ? [make("b", `${state.count} of ${run.children} futures`)] : []), ...chips);
  }

  function drawPair() {
    const { pair, child } = state;
    byId("pairbox").hidden = !pair;
    if (!pair) return;
    const now = drawGaps(), of = child < 0 ? "all futures" : `future ${child} (${pair.map((v) => info.models[run.model(child, v)]).join(", ")})`;
    byId("pair-title").textContent = `Gap of ${pair.map(id).join(" and ")}, ${of}${now === null ? "" : `: ${now.toFixed(1)} m at ${seconds(state.step)}`}`;
  }

  function drawCharts() {
    for (const chart of charts) {
      chart.element.hidden = chart.metric.mean !== (byId("means").value === "mean");
      if (!chart.element.hidden) chart.draw(byId("curve").value === "cumulative");
    }
  }

  state.onChange = (any) => {
    if (any("selection")) map.weigh();
    if (any("pair", "child", "step")) map.follow(any("pair", "child"));
    map.draw();
    drawPlayer();
    if (any("selection", "child", "thresholds", "size")) drawCharts();
    if (any("pair", "child", "step", "selection", "size")) drawPair();
    if (any("selection")) drawChips();
    if (any("thresholds")) for (const chart of charts) chart.describe();
    if (any("thresholds", "focus")) drawModels();
    if (any("focus")) worst.show(info.events.rows.filter((row) => row.metric === state.focus));
    if (any("pair", "child")) for (const table of [encounters, worst]) table.choose();
  };

  showTables(info.tables);
  if (byId("exact")) exactCard(info.exact);
  const redraw = () => state.change({}, "size");
  for (const button of all("[data-encounter]")) button.onclick = () => jump(info.encounters.rows[button.dataset.encounter]);
  byId("focus").onchange = ({ target }) => state.change({ focus: Number(target.value) });
  byId("curve").onchange = byId("means").onchange = redraw;
  byId("release").onclick = () => {
    [...state.filters.keys()].forEach(letGo);
    state.change({ pair: null });
  };
  onTheme(() => { redraw(); state.tell(); });
  new ResizeObserver(() => {
    if (!state.pair) map.fit();
    redraw();
  }).observe(byId("mapbox"));
  state.change({ focus: Number(byId("focus").value) }, "selection", "thresholds");
}

unpack(byId("data").textContent).then((content) => runReport(runOf(content)));
