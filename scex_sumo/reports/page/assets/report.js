// Report of a run: puts map, charts and tables together.

function runReport(run) {
  const { info, id } = run, state = makeState(run);
  const map = new MapView(run, state, byId("map")), pairChart = new PairChart(run, state, byId("pair"));
  const player = makePlayer(run, state, map), charts = info.metrics.map((_, m) => new MetricChart(run, state, m));
  const isOpen = (pair) => state.pair && pair.every((v) => state.pair.includes(v));

  function jump({ pair, child, step }) {
    state.change({ pair, child, step: clamp(step, 0, run.frames - 1), playing: false });
    if (map.canvas.getBoundingClientRect().bottom < 60) byId("stage").scrollIntoView({ behavior: "smooth" });
  }

  const share = (title, key) => ({ title: `P(${title})`, text: (r) => percent(r[key]), sort: (r) => -r[key], hint: "Share of the children" });
  const gap = (title, key, hint) => ({ title, text: (r) => r[key] === null ? "> 10 m" : `${short(r[key], 1)} m`, sort: (r) => r[key], hint });
  const encounterTable = makeTable(byId("encounters"), [
    { title: "pair", text: (r) => `${r.track_id} → ${r.other_id}`, sort: (r) => r.track_id },
    share("collision", "collision"),
    { title: "95 %", text: (r) => range({ low: r.collision_low, high: r.collision_high }), sort: (r) => -r.collision_high },
    share("TTC", "ttc"), share("PET", "pet"), share("DRAC", "drac"),
    gap("gap 5 %", "gap_p05", "Least gap in the nearest 5 % of the children"), gap("median", "gap_p50", "Least gap in half of the children"),
    { title: "after", text: (r) => seconds(r.step), sort: (r) => r.step },
  ], { onRow: jump, isChosen: (r) => isOpen(r.pair), first: 8 });

  const worstTable = makeTable(byId("worst"), [
    { title: "vehicles", text: (r) => r.vehicles.map(id).join(" – "), sort: (r) => r.vehicles[0] },
    { title: "value", text: (r) => r.metric < 0 ? "collision" : short(r.value, 3), sort: (r) => r.value },
    { title: "after", text: (r) => seconds(r.step), sort: (r) => r.step },
    { title: "children", text: (r) => `× ${r.children.length}`, sort: (r) => -r.children.length },
    { title: "which", words: true, text: (r) => r.children.slice(0, 4).join(", ") + (r.children.length > 4 ? ", …" : ""), sort: (r) => r.children[0] },
  ], { onRow: (r) => jump({ ...r, pair: r.vehicles.length > 1 ? r.vehicles : null, child: r.children[0] }), isChosen: (r) => r.children.includes(state.child) });

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
    if (any("thresholds")) drawVerdict(run, state, jump);
    if (any("thresholds", "focus")) drawModels(run, state);
    if (any("focus")) worstTable.show(info.events.filter((event) => event.metric === state.focus));
    if (any("pair", "child")) [encounterTable, worstTable].forEach((table) => table.draw());
  });

  byId("name").textContent = info.name;
  byId("about").textContent = [some(run.vehicles, "vehicle"), some(run.children, "child scenario"), `${seconds(run.frames - 1)} ahead`,
    info.location !== info.name && info.location].filter(Boolean).join(" · ");
  byId("foot").textContent = `scex-sumo ${info.version} · ${info.command}`;
  byId("legend").replaceChildren(...info.models.map((model, m) => make("div", {}, make("i", { style: `background: ${info.colors[m]}` }), model)),
    ...(run.recorded ? [make("div", {}, make("i.outline"), "recorded")] : []));
  byId("recorded-label").hidden = !run.recorded;
  byId("notes").replaceChildren(...info.notes.map((note) => make("li", note)));
  byId("notes-card").hidden = !info.notes.length;
  const choices = [{ name: "collision", m: -1 }, ...info.metrics.map(({ name, mean }, m) => ({ name: name + (mean ? " (mean)" : ""), m }))];
  byId("focus").replaceChildren(...choices.filter(({ m }) => info.events.some((event) => event.metric === m)).map(({ name, m }) => make("option", { value: m }, name)));
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
  encounterTable.show(info.encounters);
  state.change({ focus: Number(byId("focus").value) }, "mask", "thresholds");
}

unpack(byId("data").textContent).then((content) => runReport(runOf(content)));
