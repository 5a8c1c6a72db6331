// Report of a run: puts map, charts and tables together.

const EVENT_ROWS = 10;

function bar(share, likely, recorded) {
  const box = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  box.setAttribute("viewBox", "0 0 100 16");
  box.setAttribute("preserveAspectRatio", "none");
  const add = (tag, kind, attributes) => {
    const shape = document.createElementNS(box.namespaceURI, tag);
    shape.setAttribute("class", kind);
    for (const [name, value] of Object.entries(attributes)) shape.setAttribute(name, value);
    box.append(shape);
  };
  add("rect", "bar-back", { x: 0, y: 4, width: 100, height: 8 });
  if (!Number.isNaN(share.value)) {
    add("rect", "bar", { x: 0, y: 4, width: 100 * share.value, height: 8 });
    add("path", "bar-range", { d: `M${100 * share.low} 8H${100 * share.high}`, "vector-effect": "non-scaling-stroke" });
  }
  if (likely) add("rect", "bar-likely", { x: 100 * likely.value - 0.6, y: 0, width: 1.2, height: 16 });
  if (recorded) add("rect", "bar-recorded", { x: 98.4, y: 0, width: 1.6, height: 16 });
  return box;
}

function runReport(run) {
  const { info } = run, state = makeState(run), pairs = new Pairs(run);
  state.show = { ids: true, ghosts: true, paths: true, recorded: true, heat: false };
  state.curve = "density";
  const map = new MapView(run, state, pairs, byId("map")), pairChart = new PairChart(run, state, pairs, byId("pair"));
  const charts = info.metrics.map((_, m) => new MetricChart(run, state, m));
  const id = (vehicle) => info.track_ids[vehicle], seconds = (step) => `${(step / 10).toFixed(1)} s`;
  const some = (count, noun) => `${count} ${noun}${count === 1 ? "" : "s"}`;
  let encounters = [], seen = false;

  // Whether a child is critical by what is in focus: a collision, or a metric's threshold, else its worst tenth.
  function criticalBy(focus) {
    if (focus < 0) return { test: (c) => pairs.touched[c] >= 0, words: "a collision" };
    const { name, side } = info.metrics[focus], column = run.columns[focus], sign = side === "left" ? "≤" : "≥";
    if (state.thresholds[focus] !== null) return { test: (c) => state.isCritical(focus, column[c]), words: `${name} ${sign} ${short(state.thresholds[focus])}` };
    const sorted = defined(column), limit = quantile(sorted, side === "left" ? 0.1 : 0.9);
    return { test: (c) => side === "left" ? column[c] <= limit : column[c] >= limit, words: `${name} ${sign} ${short(limit)}, the worst tenth` };
  }

  function jump(pair, child, step) {
    state.change({ pair, child, step: Math.min(Math.max(step, 0), run.frames - 1), playing: false });
    if (byId("map").getBoundingClientRect().bottom < 60) byId("stage").scrollIntoView({ behavior: "smooth" });
  }

  // The models that an encounter's contacts come with, where that is more than chance.
  function blame(row) {
    if (row.said && (row.said.models || row.said.words)) return row.said.models || row.said.words;
    let best = null;
    for (const vehicle of [row.a, row.b]) {
      info.models.forEach((model, m) => {
        const with_ = row.children.filter((c) => run.model(c, vehicle) === m).length;
        let all = 0;
        for (let c = 0; c < run.children; c++) all += run.model(c, vehicle) === m ? 1 : 0;
        const lift = with_ / row.children.length - all / run.children;
        if (lift > 0.15 && all < run.children && (!best || lift > best.lift)) best = { lift, share: with_ / row.children.length, words: `${id(vehicle)} as ${model}` };
      });
    }
    return best ? `${best.share > 0.995 ? "always" : `in ${percent(best.share)} of them`} with ${best.words}` : "";
  }

  function inWords(row) {
    if (row.standing) return "touch already at the moment itself";
    if (row.p.value > 0) {
      const why = row.children.length ? blame(row) : "";
      return `touch in ${percent(row.p.value)} of the children, soonest after ${seconds(row.step)}${why && `; ${why}`}`;
    }
    return `come within ${short(row.least, 1)} m (median ${short(row.median, 1)} m${row.recorded === null ? "" : `, recorded ${short(row.recorded, 1)} m`})`;
  }

  function drawVerdict() {
    const collided = pairs.touched.reduce((sum, step) => sum + (step >= 0 ? 1 : 0), 0), share = wilson(collided, run.children);
    const first = make("div.card", {}, make("h2", { textContent: "P(collision)" }), make("div.big", { textContent: seen ? percent(share.value) : "…" }),
      make("p.soft", { textContent: `${collided} of ${some(run.children, "child scenario")}; 95 %: ${percent(share.low)} – ${percent(share.high)}` }));
    if (collided) first.children[1].classList.add("hot");
    if (info.likely_collisions) first.append(make("p", { textContent: `likely: ${percent(info.likely_collisions[0] / info.likely_collisions[1])}` }));
    const shares = make("div.card", {}, make("h2", { textContent: "P(critical)" }));
    info.metrics.forEach((metric, m) => {
      if (metric.mean || state.thresholds[m] === null) return;
      const now = state.share(m, run.columns[m]), likely = run.likely[m] && state.share(m, run.likely[m]);
      const recorded = metric.recorded !== null && state.isCritical(m, metric.recorded);
      const line = make("div.share", { title: `${now.critical} of ${now.count}; 95 %: ${percent(now.low)} – ${percent(now.high)}` },
        make("span", { textContent: `${metric.name} ${metric.side === "left" ? "≤" : "≥"} ${short(state.thresholds[m])}` }), bar(now, likely, recorded), make("b", { textContent: percent(now.value) }));
      if (likely) line.title += `; likely ${percent(likely.value)}`;
      shares.append(line);
    });
    const hits = info.metrics.filter((metric, m) => !metric.mean && metric.recorded !== null && state.isCritical(m, metric.recorded)).map((metric) => metric.name);
    const said = !run.recorded ? "nothing was recorded" : hits.length ? `critical by ${hits.join(", ")}` : "not critical";
    shares.append(make("p.soft", { textContent: `blue: possible, line: 95 %${run.likely[0] ? ", violet: likely" : ""}; recorded future: ${said}` }));
    const list = make("ol", {}, ...encounters.slice(0, 3).map((row) => make("li", {}, make("button", { onclick: () => jump([row.a, row.b], row.child, row.step) },
      make("b", { textContent: `${id(row.a)} and ${id(row.b)} ` }), inWords(row)))));
    const worst = make("div.card", {}, make("h2", { textContent: "Worst encounters" }), list);
    if (seen && !encounters.length) worst.append(make("p", { textContent: `No two vehicles come within ${NEAR_M} m.` }));
    byId("verdict").replaceChildren(first, shares, worst);
  }

  const encounterTable = makeTable(byId("encounters"), [
    { title: "pair", text: (r) => `${id(r.a)} – ${id(r.b)}`, sort: (r) => id(r.a) },
    { title: "P(collision)", text: (r) => r.standing ? "at start" : percent(r.p.value), sort: (r) => -r.p.value, hint: "Share of the children in which the bodies touch" },
    { title: "95 %", text: (r) => `${percent(r.p.low)} – ${percent(r.p.high)}`, sort: (r) => -r.p.high },
    { title: "least gap", text: (r) => `${short(r.least, 1)} m`, sort: (r) => r.least, hint: "Least gap between the bodies in any child" },
    { title: "median", text: (r) => `${short(r.median, 1)} m`, sort: (r) => r.median },
    { title: "recorded", text: (r) => r.recorded === null ? "–" : `${short(r.recorded, 1)} m`, sort: (r) => r.recorded },
    { title: "after", text: (r) => seconds(r.step), sort: (r) => r.step },
    ...(info.encounters && info.encounters.some((row) => row.p_ttc !== undefined) ? [["TTC", "p_ttc"], ["PET", "p_pet"], ["DRAC", "p_drac"]].map(([title, key]) => (
      { title: `P(${title})`, text: (r) => r.said ? percent(r.said[key] ?? NaN) : "–", sort: (r) => r.said ? -(r.said[key] ?? 0) : 1 })) : []),
  ], { onRow: (r) => jump([r.a, r.b], r.child, r.step), isChosen: (r) => state.pair && state.pair[0] === r.a && state.pair[1] === r.b, first: 8 });

  // Children with the same event are one row: same pair, step and value.
  function worstEvents() {
    const groups = new Map(), { event_rows: rows } = run.arrays, focus = state.focus;
    const add = (child, step, a, b, value) => {
      const key = `${a} ${b} ${step} ${value.toPrecision(3)}`;
      if (!groups.has(key)) groups.set(key, { a, b, step, value, children: [] });
      if (!groups.get(key).children.includes(child)) groups.get(key).children.push(child);
    };
    if (focus < 0) for (const { child, step, a, b } of pairs.contacts) add(child, step, a, b, 0);
    for (let i = 0; i < rows.shape[0]; i++) {
      const [child, m, step, a, b] = rows.values.subarray(5 * i, 5 * i + 5);
      if (m === focus) add(child, step, a, b, run.columns[focus][child]);
    }
    const sign = focus < 0 || info.metrics[focus].side === "left" ? 1 : -1;
    return [...groups.values()].sort((p, q) => sign * (p.value - q.value) || p.step - q.step || q.children.length - p.children.length);
  }

  const pairOf = (row) => row.b < 0 ? null : [row.a, row.b].sort((p, q) => p - q);
  const worstTable = makeTable(byId("worst"), [
    { title: "vehicles", text: (r) => r.b < 0 ? `${id(r.a)}` : `${id(r.a)} – ${id(r.b)}`, sort: (r) => r.a },
    { title: "value", text: (r) => state.focus < 0 ? "contact" : short(r.value, 3), sort: (r) => r.value },
    { title: "after", text: (r) => seconds(r.step), sort: (r) => r.step },
    { title: "children", text: (r) => `× ${r.children.length}`, sort: (r) => -r.children.length },
    { title: "which", words: true, text: (r) => r.children.slice(0, 4).join(", ") + (r.children.length > 4 ? ", …" : ""), sort: (r) => r.children[0] },
  ], { onRow: (r) => jump(pairOf(r), r.children[0], r.step), isChosen: (r) => r.children.includes(state.child), first: EVENT_ROWS });

  function drawModels() {
    const { test, words } = criticalBy(state.focus), models = info.models.length;
    const hits = new Float64Array(run.vehicles * models), counts = new Float64Array(run.vehicles * models);
    let total = 0;
    for (let c = 0; c < run.children; c++) {
      const hit = test(c) ? 1 : 0;
      total += hit;
      for (let v = 0; v < run.vehicles; v++) {
        counts[v * models + run.model(c, v)]++;
        hits[v * models + run.model(c, v)] += hit;
      }
    }
    const mean = total / run.children, rows = Array.from({ length: run.vehicles }, (_, v) => {
      const shares = info.models.map((_, m) => hits[v * models + m] / counts[v * models + m]);
      const known = shares.filter((share, m) => counts[v * models + m] >= 5);
      return { v, shares, spread: known.length > 1 ? Math.max(...known) - Math.min(...known) : 0 };
    }).sort((p, q) => q.spread - p.spread);
    byId("models-about").textContent = `Share of children with ${words}, given who drives a vehicle; overall ${percent(mean)}. A click selects those children.`;
    const head = make("tr", {}, make("th", { textContent: "vehicle" }), ...info.models.map((model) => make("th", { textContent: model.replaceAll("_", " ") })));
    const body = rows.map(({ v, shares }) => make("tr", {}, make("td", { textContent: id(v) + (info.under_test.includes(id(v)) ? " (under test)" : "") }), ...shares.map((share, m) => {
      const count = counts[v * models + m], cell = make(count < 5 ? "td.cell.few" : "td.cell", { textContent: count ? percent(share) : "", tabIndex: count ? 0 : -1 });
      if (!count) return cell;
      const range = wilson(hits[v * models + m], count), away = share - mean;
      cell.title = `${hits[v * models + m]} of ${count}; 95 %: ${percent(range.low)} – ${percent(range.high)}`;
      cell.style.background = `color-mix(in srgb, var(--${away > 0 ? "critical" : "drawn"}) ${Math.min(75, Math.round(150 * Math.abs(away)))}%, transparent)`;
      cell.onclick = () => state.filter(`vehicle ${v}`, `${id(v)} as ${info.models[m]}`, (c) => run.model(c, v) === m);
      cell.onkeydown = (event) => { if (event.key === "Enter") cell.onclick(); };
      return cell;
    })));
    byId("models").replaceChildren(make("div.scroll", {}, make("table", {}, make("thead", {}, head), make("tbody", {}, ...body))));
  }

  function drawChips() {
    const chips = [...state.filters].map(([key, { words }]) => make("button.chip", { textContent: `${words} ×`, title: "Let go", onclick: () => letGo(key) }));
    if (chips.length) chips.unshift(make("b", { textContent: `${state.count} of ${some(run.children, "child")}`.replace("childs", "children") }));
    byId("chips").replaceChildren(...chips);
  }

  function letGo(key) {
    for (const chart of charts) if (`metric ${chart.metric}` === key) chart.brush = null;
    state.filter(key, "", null);
  }

  function drawPlayer() {
    byId("time").value = state.step;
    byId("clock").textContent = seconds(state.step);
    byId("play").textContent = state.playing ? "❚❚" : "▶";
    if (document.activeElement !== byId("child")) byId("child").value = state.child < 0 ? "" : state.child;
    byId("all").classList.toggle("on", state.child < 0);
  }

  function drawPair() {
    byId("pairbox").hidden = !state.pair;
    const gap = pairChart.draw(), at = typeof gap === "number" ? `: ${gap.toFixed(1)} m at ${seconds(state.step)}` : "";
    const of = state.child < 0 ? "all children" : `child ${state.child}${run.info.models.length ? ` (${(state.pair || []).map((v) => info.models[run.model(state.child, v)]).join(", ")})` : ""}`;
    if (state.pair) byId("pair-title").textContent = `Gap of ${id(state.pair[0])} and ${id(state.pair[1])}, ${of}${at}`;
  }

  function drawCharts() {
    const means = byId("means").value === "mean";
    const shown = charts.filter((chart) => info.metrics[chart.metric].mean === means);
    if (byId("charts").firstChild !== (shown[0] && shown[0].element)) byId("charts").replaceChildren(...shown.map((chart) => chart.element));
    for (const chart of shown) chart.draw();
  }

  const any = (changed, ...names) => names.some((name) => changed.has(name));
  state.listen((changed) => {
    if (any(changed, "mask")) map.weigh();
    if (any(changed, "pair", "child", "found") && state.pair && byId("follow").checked) chase();
    map.draw();
    drawPlayer();
    if (any(changed, "mask", "child", "thresholds", "curve", "theme", "size")) drawCharts();
    if (any(changed, "pair", "child", "step", "mask", "theme", "size")) drawPair();
    if (any(changed, "mask")) drawChips();
    if (any(changed, "thresholds", "found")) drawVerdict();
    if (any(changed, "thresholds", "focus", "found")) drawModels();
    if (any(changed, "focus", "found")) worstTable.show(worstEvents());
    if (any(changed, "found")) {
      encounterTable.show(encounters);
      byId("encounters").hidden = !encounters.length;
    }
    else if (any(changed, "pair", "child")) { encounterTable.draw(); worstTable.draw(); }
  });

  let chasing = false;
  function chase() {
    if (chasing) return;
    chasing = true;
    const on = () => {
      chasing = Boolean(state.pair) && byId("follow").checked && (map.pursue() || state.playing);
      state.change({}, "view");
      if (chasing) requestAnimationFrame(on);
    };
    on();
  }

  let before = 0;
  function play() {
    const last = run.frames - 1;
    state.change({ playing: !state.playing, step: !state.playing && state.step >= last ? 0 : state.step });
    before = performance.now();
    if (!state.playing) return;
    if (state.pair) chase();
    const on = (now) => {
      if (!state.playing) return;
      const step = Math.min(state.step + Math.max(now - before, 0) / 100 * Number(byId("speed").value), last);
      before = now;
      state.change({ step, playing: step < last });
      if (step < last) requestAnimationFrame(on);
    };
    requestAnimationFrame(on);
  }

  const stepTo = (step) => state.change({ step: Math.min(Math.max(Math.round(step), 0), run.frames - 1), playing: false });
  const nextChild = (offset) => state.change({ child: state.selected(offset) });
  const toggle = (name) => { byId(`show-${name}`).click(); };
  const keys = { " ": play, ArrowLeft: () => stepTo(state.step - 1), ArrowRight: () => stepTo(state.step + 1), Home: () => stepTo(0), End: () => stepTo(run.frames),
    ArrowUp: () => nextChild(-1), ArrowDown: () => nextChild(1), a: () => state.change({ child: -1 }), f: fit, "+": () => map.zoom(1.3), "-": () => map.zoom(1 / 1.3),
    i: () => toggle("ids"), g: () => toggle("ghosts"), p: () => toggle("paths"), r: () => toggle("recorded"), h: () => toggle("heat"), "?": () => byId("help").showModal(), Escape: release };
  document.addEventListener("keydown", (event) => {
    const act = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    const busy = /INPUT|SELECT|TEXTAREA/.test(event.target.tagName) && event.target.type !== "checkbox" && event.key !== "Escape";
    if (!act || busy || event.ctrlKey || event.metaKey || event.altKey || byId("help").open || (event.key === " " && event.target.tagName === "BUTTON")) return;
    event.preventDefault();
    act();
  });

  function fit() {
    map.fit();
    state.change({}, "view");
  }

  function release() {
    map.first = null;
    for (const key of [...state.filters.keys()]) letGo(key);
    state.change({ pair: null });
  }

  function tell(words) {
    byId("said").textContent = words;
    setTimeout(() => { byId("said").textContent = ""; }, 3000);
  }

  const commands = { view: () => `scex-sumo view ${info.quoted} --child ${Math.max(state.child, 0)}`, run: () => info.command,
    export: () => `scex-sumo export ${info.quoted} --child ${Math.max(state.child, 0)} --to fcd` };
  async function copy(what) {
    const words = commands[what]();
    try {
      await navigator.clipboard.writeText(words);
    } catch { // a page from disk may not write there
      const box = make("textarea", { value: words });
      document.body.append(box);
      box.select();
      document.execCommand("copy");
      box.remove();
    }
    tell(`copied: ${words}`);
  }

  function save(blob, ending) {
    const link = make("a", { href: URL.createObjectURL(blob), download: `${info.name}${state.child < 0 ? "" : `_child${state.child}`}.${ending}` });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
    tell(`saved ${link.download}`);
  }

  function film() {
    const parts = [], recorder = new MediaRecorder(byId("map").captureStream(30), { mimeType: "video/webm", videoBitsPerSecond: 6e6 });
    recorder.ondataavailable = (event) => parts.push(event.data);
    recorder.onstop = () => save(new Blob(parts, { type: "video/webm" }), "webm");
    state.change({ step: 0, playing: false });
    recorder.start();
    play();
    const watch = () => { if (state.playing) requestAnimationFrame(watch); else setTimeout(() => recorder.stop(), 300); };
    requestAnimationFrame(watch);
    tell("recording …");
  }

  byId("name").textContent = info.name;
  byId("about").textContent = [some(run.vehicles, "vehicle"), some(run.children, "child scenario"), `${seconds(run.frames - 1)} ahead`, info.location !== info.name && info.location].filter(Boolean).join(" · ");
  byId("foot").textContent = `scex-sumo ${info.version} · ${info.command}`;
  byId("legend").replaceChildren(...info.models.map((model, m) => {
    const swatch = make("i");
    swatch.style.background = info.colors[m];
    return make("div", {}, swatch, model);
  }), ...(run.recorded ? [make("div", {}, make("i.outline"), "recorded")] : []));
  byId("recorded-label").hidden = !run.recorded;
  byId("notes").replaceChildren(...info.notes.map((note) => make("li", { textContent: note })));
  byId("notes-card").hidden = !info.notes.length;
  byId("encounters-about").textContent = info.encounters ? "A click shows the worst child at its worst step." : "Bodies as drawn; a click shows the child and step in which the two come nearest.";
  byId("focus").replaceChildren(make("option", { value: -1, textContent: "collision" }), ...info.metrics.map((metric, m) => make("option", { value: m, textContent: metric.name + (metric.mean ? " (mean)" : "") })));
  Object.assign(byId("time"), { max: run.frames - 1, oninput: (event) => state.change({ step: Number(event.target.value), playing: false }) });
  Object.assign(byId("child"), { max: run.children - 1, onchange: (event) => state.change({ child: event.target.value === "" ? -1 : Math.min(Math.max(Math.round(event.target.value), 0), run.children - 1) }) });
  for (const name of Object.keys(state.show)) byId(`show-${name}`).onchange = (event) => { state.show[name] = event.target.checked; state.change({}, "view"); };
  const clicks = { play, all: () => state.change({ child: -1 }), previous: () => nextChild(-1), next: () => nextChild(1), fit, "zoom-in": () => map.zoom(1.3), "zoom-out": () => map.zoom(1 / 1.3),
    "help-open": () => byId("help").showModal(), "pair-close": () => state.change({ pair: null }), "save-png": () => byId("map").toBlob((blob) => save(blob, "png")), "save-webm": film };
  for (const [name, act] of Object.entries(clicks)) byId(name).onclick = act;
  byId("follow").onchange = () => state.pair && chase();
  byId("curve").onchange = (event) => state.change({ curve: event.target.value });
  byId("means").onchange = () => state.change({}, "curve");
  byId("focus").onchange = (event) => state.change({ focus: Number(event.target.value) });
  for (const button of document.querySelectorAll("[data-copy]")) button.onclick = () => copy(button.dataset.copy);
  const recolor = () => { theme.forget(); state.change({}, "theme"); };
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", recolor);
  addEventListener("beforeprint", () => { document.documentElement.dataset.print = ""; recolor(); state.tell(); });
  addEventListener("afterprint", () => { delete document.documentElement.dataset.print; recolor(); });
  let width = 0;
  new ResizeObserver(() => {
    if (Math.abs(byId("map").clientWidth - width) > 40 && !state.pair) map.fit();
    width = byId("map").clientWidth;
    state.change({}, "size");
  }).observe(document.body);
  drawVerdict();
  state.change({}, "mask", "thresholds");
  setTimeout(() => { // after the first paint
    encounters = pairs.find();
    seen = true;
    if (!pairs.contacts.length && state.focus < 0) byId("focus").value = state.focus = Math.max(-1, info.metrics.findIndex((metric) => metric.column === "ttc" || metric.threshold !== null));
    state.change({}, "found");
  }, 30);
}

unpack(byId("data").textContent).then((content) => runReport(runOf(content)));
