// Report of a run: puts map, charts and tables together.

function runReport(run) {
  fillReport(run);
  const { info, id } = run, state = makeState(run), map = makeMap(run, state, byId("map")), select = makeSelection(run, state);
  const drawPlayer = makePlayer(run, state, map), drawStrips = pairStrips(run, state, byId("strips")), models = modelTable(run, state);
  const charts = all(".chart").map((element) => makeChart(run, state, element)), find = byId("find");

  function show(row) { // plays
    const { future, step } = row.event === undefined ? row : select.typicalOf(row);
    state.show(future, { pair: row.pair, step, rest: step, playing: !wantsRest() });
  }
  function jump(row) {
    show(row);
    byId("mapbox").scrollIntoView({ behavior: "smooth", block: "nearest" });
  }
  nameVehicles(run, state, map, byId("map"));

  const isOpen = ({ pair, human }) => Boolean(state.pair && pair) && pair.every((v) => state.pair.includes(v)) && (state.future < 0 || run.isHuman(state.future) === human);
  const encounters = makeTable(byId("encounters"), info.encounters, { onRow: jump, isChosen: isOpen });
  const pairs = makeTable(byId("pairs"), info.pairs, { onRow: jump, isChosen: isOpen });
  const worst = makeTable(byId("worst"), info.events, { onRow: jump, isChosen: ({ futures }) => futures.includes(state.future) });

  function drawCaption() { // what is shown, and of a pair of the answer what happens and how often
    const row = info.pairs.rows.find((one) => isOpen(one) && one.future === state.future), names = (state.pair || []).map(id).join(" and ");
    byId("caption").replaceChildren(make("b", row ? row.caption : names), make("span.soft", ` ${run.setOf(state.future)}`));
  }

  let isSelected = false;
  function drawSelection() { // chips, P(collision), and what tables have of the selected futures
    const chips = [...state.filters].map(([key, { words }]) => make("button.chip", { textContent: `${words} ×`, title: "Clear", onclick: () => state.filter(key) }));
    byId("chips").replaceChildren(...(chips.length ? [make("b", `${state.count} of ${run.futures} futures`)] : []), ...chips);
    const hits = info.human ? [false, true] : [false], told = hits.map((isHuman) => `${percent(select.collision(isHuman).value)} ${isHuman ? "human-like" : "stress test"}`).join(", ");
    if (chips.length) byId("chips").firstChild.textContent += `, P(collision) ${told}`;
    if (chips.length || isSelected) announce(`${state.count} of ${run.futures} futures; P(collision) ${told}`);
    isSelected = chips.length > 0;
    encounters.show(select.encounterRows(find.value.trim()));
  }

  function drawWorst() {
    const metric = info.metrics[state.focus], [name, unit] = metric ? [metric.name, metric.unit] : ["relative speed", "m/s"];
    worst.columns[1].title = name + (unit && ` [${unit}]`);
    worst.show(select.eventRows());
  }

  function drawPair(isNew) {
    const { pair, future } = state;
    byId("pairbox").hidden = !pair || pair.length < 2;
    if (byId("pairbox").hidden) return;
    if (isNew) {
      const of = pair.map((v) => id(v) + (future < 0 ? "" : ` ${info.models[run.model(future, v)]}`));
      byId("pair-title").replaceChildren(make("span.solid", of[0]), " and ", make("span.dashed", of[1]), future < 0 ? ", all futures" : `, ${run.nameOf(future)}`);
    }
    drawStrips(isNew);
  }

  function drawCharts() {
    for (const chart of charts) {
      chart.element.hidden = chart.metric.mean !== (byId("means").value === "mean");
      if (!chart.element.hidden) chart.draw(byId("curve").value === "cumulative");
    }
  }

  state.onChange = (any) => {
    if (any("selection")) map.weigh();
    if (any("pair", "future", "rest")) map.follow();
    map.draw();
    drawPlayer(any("future", "thresholds", "selection"));
    if (any("pair", "future")) drawCaption();
    if (any("selection", "future", "thresholds", "size")) drawCharts();
    if (any("size")) drawTested();
    if (any("pair", "future", "step", "selection", "size", "view")) drawPair(any("pair", "future", "selection", "size"));
    if (any("selection", "find")) drawSelection();
    if (any("thresholds", "selection")) for (const chart of charts) chart.describe();
    if (any("selection")) listed.restart();
    if (any("thresholds", "focus", "selection")) models.draw(select.isShown);
    if (any("focus", "selection")) drawWorst();
    if (any("pair", "future")) for (const table of [pairs, encounters, worst]) table.choose();
    byId("only-pair").classList.toggle("on", state.filters.has("pair"));
    byId("only-future").classList.toggle("on", state.filters.has("future"));
    byId("only-future").disabled = state.future < 0;
    address.later();
  };

  const only = (key, act) => state.filters.has(key) ? state.filter(key) : act();
  const vehicleOf = (text) => info.track_ids.map(String).indexOf(text);
  const address = keepInAddress(state, {
    pair: {
      get: () => ({ "": state.pair && state.pair.map(id).join() }),
      set({ "": text }) {
        const pair = (text || "").split(",").map(vehicleOf);
        state.change({ pair: pair.length === 2 && !pair.includes(-1) ? pair : null });
      },
    },
    future: {
      get: () => ({ "": run.textOf(state.future) }), set({ "": text = "" }) { state.show(run.futureOf(text)); },
    },
    t: { get: () => ({ "": ((state.playing ? state.rest : state.step) / 10).toFixed(1) }), set: ({ "": text = 0 }) => state.seek(10 * (Number(text) || 0)) },
    "limit.": {
      get: () => Object.fromEntries(info.metrics.flatMap(({ column, threshold }, m) => state.thresholds[m] === threshold ? [] : [[column, state.thresholds[m] ?? "none"]])),
      set(texts) {
        info.metrics.forEach(({ column, threshold }, m) => {
          const text = texts[column], limit = text === "none" ? null : Number(text);
          charts[m].setLimit(Number.isNaN(limit) ? threshold : limit);
        });
      },
    },
    "only.": {
      get: () => Object.fromEntries([...state.filters].map(([key, { value }]) => [key, key === "pair" ? value.map(id).join() : value.map((part) => Number(part.toFixed(4))).join()])),
      set(texts) {
        for (const key of [...state.filters.keys()]) state.filter(key);
        for (const [key, text] of Object.entries(texts)) {
          const values = text.split(",").map(Number), kind = key[0], index = Number(key.slice(1));
          if (values.some(Number.isNaN)) continue;
          if (key === "pair" && values.length === 2) select.onlyPair(values.map(vehicleOf));
          else if (key === "future") select.onlyFuture(values[0]);
          else if (kind === "m" && charts[index] && values.length === 2) charts[index].select(values);
          else if (kind === "v" && info.track_ids[index] !== undefined && info.models[values[0]]) models.select(index, values[0]);
        }
      },
    },
  });

  showTables(info.tables);
  const drawTested = info.tested_curves ? testedCurves(byId("tested-curves"), info.tested_curves) : () => {};
  const listed = { restart() { // at rest: it takes longer than a frame
    clearTimeout(listed.timer);
    listed.timer = setTimeout(() => charts.forEach((chart) => chart.list()), REST_MS);
  } };
  const redraw = () => state.change({}, "size");
  for (const fold of all("details")) fold.ontoggle = redraw;
  find.oninput = () => state.change({}, "find");
  byId("focus").onchange = ({ target }) => state.change({ focus: Number(target.value) });
  byId("curve").onchange = byId("means").onchange = redraw;
  byId("only-pair").onclick = () => only("pair", () => select.onlyPair(state.pair));
  byId("only-future").onclick = () => only("future", () => select.onlyFuture(state.future));
  byId("pair-close").onclick = () => state.change({ pair: null });
  byId("release").onclick = () => {
    [...state.filters.keys()].forEach((key) => state.filter(key));
    state.change({ pair: null });
  };
  onTheme(() => { redraw(); state.tell(); });
  new ResizeObserver(() => {
    if (state.pair) map.follow();
    else map.fit();
    redraw();
  }).observe(byId("mapbox"));
  onhashchange = ({ newURL }) => address.read(newURL); // a write may be between
  map.fit();
  state.change({ focus: Number(byId("focus").value || -1) }, "selection");
  if (!address.read() && info.pairs.rows.length) show(info.pairs.rows[info.pairs.first]);
}

unpack(byId("data").textContent).then((content) => runReport(runOf(content)));
