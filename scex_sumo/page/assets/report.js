// Report of a run: puts map, charts and tables together.

function runReport(run) {
  fillReport(run);
  const { info, id } = run, state = makeState(run), view = {}, map = makeMap(run, state, byId("map"), view), select = makeSelection(run, state);
  const other = makeMap(run, state, byId("map-beside"), view, "beside"), drawOverview = makeOverview(run, state, map, view, byId("overview"));
  const drawPlayer = makePlayer(run, state, map), drawStrips = pairStrips(run, state, byId("strips")), models = modelTable(run, state);
  const charts = all(".chart").map((element) => makeChart(run, state, element)), find = byId("find");

  function show(row) {
    const { future, step } = row.event === undefined ? row : select.typicalOf(row);
    state.show(future, { pair: row.pair, step, playing: false });
  }
  function jump(row) {
    show(row);
    byId("mapbox").scrollIntoView({ behavior: "smooth", block: "nearest" });
  }
  const drawCard = vehicleCard(run, state, map, jump);

  const isOpen = ({ pair, human }) => Boolean(state.pair && pair) && pair.every((v) => state.pair.includes(v)) && (state.future < 0 || run.isHuman(state.future) === human);
  const encounters = makeTable(byId("encounters"), info.encounters, { onRow: jump, isChosen: isOpen, onSort: () => address.later() });
  const worst = makeTable(byId("worst"), info.events, { onRow: jump, isChosen: ({ futures }) => futures.includes(state.future) });

  let isSelected = false;
  function drawSelection() { // chips, P(collision), and what tables have of the selected futures
    const chips = [...state.filters].map(([key, { words }]) => make("button.chip", { textContent: `${words} ×`, title: "Clear", onclick: () => state.filter(key) }));
    byId("chips").replaceChildren(...(chips.length ? [make("b", `${state.count} of ${run.futures} futures`)] : []), ...chips);
    for (const [name, known, isHuman] of [["p-collision", info.collision, false], ["likely-collision", info.likely_collisions, true]]) {
      const said = byId(name), told = byId(`${name}-words`);
      if (!said || !known) continue;
      const { value, count, words } = chips.length ? select.collision(isHuman) : known;
      said.textContent = chips.length ? percent(value) : said.title;
      said.classList.toggle("hot", count > 0);
      told.textContent = chips.length ? words : told.title;
    }
    const shares = ["p-collision", "likely-collision"].map((name) => byId(name)?.textContent).filter(Boolean);
    if (chips.length || isSelected) announce(`${state.count} of ${run.futures} futures; P(collision) ${shares.join(", human-like ")}`);
    isSelected = chips.length > 0;
    encounters.show(select.encounterRows(find.value.trim()));
    drawWorstEncounters();
  }

  // Who hits whom, when, how likely in both sets, with which drivers.
  function drawWorstEncounters() {
    const rows = info.encounters.rows.filter((row) => row.worst && select.isEvent(row)), isWhole = !state.filters.size;
    byId("worst-encounters").replaceChildren(...rows.map((row) => {
      const { question, happens, about, why } = row, shareIn = (isHuman) => select.share({ ...row, human: isHuman }, info.bits[question]);
      const told = isWhole ? row.told : [false, true].map(shareIn).map((share) => [percent(share.value), range(share)]);
      const { step } = isWhole ? row : select.typicalOf(row), place = [about, seconds(step)].filter(Boolean).join(", ");
      const shares = [make("b.drawn", told[0][0]), ` stress test (${told[0][1]})`];
      if (info.human) shares.push(" · ", make("b.likely", told[1][0]), ` human-like (${told[1][1]})`);
      const button = make("button", { title: row.words, onclick: () => jump(row) }, make("b", row.pair.map(id).join(" → ")), ` ${happens} · ${place}`, make("span", {}, ...shares), make("span.soft", why));
      return make("li", {}, button);
    }));
  }

  function drawWorst() {
    const metric = info.metrics[state.focus], [name, unit] = metric ? [metric.name, metric.unit] : ["relative speed", "m/s"];
    worst.columns[1].title = name + (unit && ` [${unit}]`);
    worst.show(select.eventRows());
  }

  function drawPair(isNew) {
    const { pair, future } = state;
    byId("pairbox").hidden = !pair;
    if (!pair) return;
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
    if (any("selection")) for (const each of [map, other]) each.weigh();
    if (any("beside")) byId("map-beside").hidden = state.beside < 0;
    if (any("pair", "future", "beside", "step")) map.follow(any("pair", "future", "beside"));
    map.draw();
    if (state.beside >= 0) other.draw();
    drawOverview();
    drawPlayer(any("future", "beside", "thresholds", "selection"));
    drawCard();
    if (any("selection", "future", "thresholds", "size")) drawCharts();
    if (any("size")) drawTested();
    if (any("size")) responses.draw();
    if (any("pair")) responses.follow();
    if (any("pair", "future", "beside", "step", "selection", "size", "view")) drawPair(any("pair", "future", "beside", "selection", "size"));
    if (any("selection", "find")) drawSelection();
    if (any("thresholds", "selection")) for (const chart of charts) chart.describe();
    if (any("selection")) listed.restart();
    if (any("thresholds", "focus", "selection")) models.draw(select.isShown);
    if (any("focus", "selection")) drawWorst();
    if (any("pair", "future")) for (const table of [encounters, worst]) table.choose();
    byId("only-pair").classList.toggle("on", state.filters.has("pair"));
    byId("only-future").classList.toggle("on", state.filters.has("future"));
    byId("only-future").disabled = state.future < 0;
    address.later();
  };

  const only = (key, act) => state.filters.has(key) ? state.filter(key) : act();
  const vehicleOf = (text) => info.track_ids.indexOf(Number(text)), columnOf = (name) => info.metrics.findIndex(({ column }) => column === name);
  const field = (name, change) => ({
    get: () => ({ "": byId(name).value === byId(name).dataset.first ? "" : byId(name).value }),
    set: ({ "": text }) => { byId(name).value = text ?? byId(name).dataset.first; state.change({}, change); },
  });
  for (const name of ["find", "curve", "means"]) byId(name).dataset.first = byId(name).value;
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
    beside: { get: () => ({ "": run.textOf(state.beside) }), set({ "": text = "" }) { state.show(run.futureOf(text), {}, "beside"); } },
    t: { get: () => ({ "": (state.step / 10).toFixed(1) }), set: ({ "": text = 0 }) => state.seek(10 * (Number(text) || 0)) },
    vehicle: { get: () => ({ "": state.vehicle === null ? "" : id(state.vehicle) }), set: ({ "": text }) => state.change({ vehicle: text && vehicleOf(text) >= 0 ? vehicleOf(text) : null }) },
    focus: {
      get: () => ({ "": state.focus < 0 ? "" : info.metrics[state.focus].column }),
      set({ "": text }) {
        const wanted = [...byId("focus").options].find(({ value }) => value === String(text ? columnOf(text) : -1)) || byId("focus").options[0];
        if (wanted) state.change({ focus: Number(byId("focus").value = wanted.value) });
      },
    },
    sort: { get: () => ({ "": encounters.order() }), set: ({ "": text }) => { if (text !== encounters.order()) encounters.sortBy(parseInt(text, 10), text ? text.endsWith("d") : false); } },
    find: field("find", "find"), curve: field("curve", "size"), means: field("means", "size"),
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
  const responses = byId("response-map") ? responseCard(run, state, info.responses, jump, map.road) : { draw() {}, follow() {} };
  const listed = { restart() { // at rest: it takes longer than a frame
    clearTimeout(listed.timer);
    listed.timer = setTimeout(() => charts.forEach((chart) => chart.list()), REST_MS);
  } };
  const redraw = () => state.change({}, "size");
  find.oninput = () => state.change({}, "find");
  byId("focus").onchange = ({ target }) => state.change({ focus: Number(target.value) });
  byId("curve").onchange = byId("means").onchange = redraw;
  byId("only-pair").onclick = () => only("pair", () => select.onlyPair(state.pair));
  byId("only-future").onclick = () => only("future", () => select.onlyFuture(state.future));
  byId("pair-close").onclick = () => state.change({ pair: null });
  byId("release").onclick = () => {
    [...state.filters.keys()].forEach((key) => state.filter(key));
    state.change({ pair: null, vehicle: null, beside: -1 });
  };
  onTheme(() => { redraw(); state.tell(); });
  new ResizeObserver(() => {
    if (state.pair) map.follow(true);
    else map.fit();
    redraw();
  }).observe(byId("mapbox"));
  onhashchange = ({ newURL }) => address.read(newURL); // a write may be between
  map.fit();
  state.change({}, "selection");
  if (!address.read() && info.encounters.rows.length) show(info.encounters.rows[info.encounters.first]);
}

unpack(byId("data").textContent).then((content) => runReport(runOf(content)));
