// Charts: density or cumulative curve of a metric, brushed and with a threshold to drag.

const FAR = 6; // kernel widths beyond which a sample adds nothing

// Curve of some of `count` samples: points [x, density, share at or below x] of kernels, folded back at 0, and
// [value, share] of the atoms, values that many samples have.
function curveOf(values, count, xs, width, isFolded, atoms) {
  const sorted = Float64Array.from(values).sort(), rest = sorted.filter((v) => !atoms.includes(v)), scale = 1 / (count * width * Math.sqrt(2 * Math.PI));
  const kernel = (gap) => Math.abs(gap) > FAR ? 0 : Math.exp(-0.5 * gap ** 2);
  const kernels = (x) => rest.reduce((sum, v) => sum + kernel((x - v) / width) + (isFolded ? kernel((x + v) / width) : 0), 0) * scale;
  const places = xs.filter((x) => x >= 0 || !isFolded), shares = stepsOf(sorted, places);
  return {
    points: places.map((x, i) => [x, kernels(x), shares[i]]),
    atoms: atoms.map((value) => [value, sorted.filter((v) => v === value).length / count]),
  };
}

// Axis along the bottom of a chart with its ticks [value, words]; returns where the plot ends.
function bottomAxis({ paint, write, width, height }, ticks, toX) {
  const base = height - 16;
  paint([[0, base + 0.5], [width, base + 0.5]], { stroke: "line", width: 1 });
  for (const [value, words] of ticks) write(words, clamp(toX(value), 10, width - 10), height - 4);
  return base;
}

function makeChart(run, state, element) {
  const m = Number(element.dataset.metric), metric = run.info.metrics[m], column = run.columns[m], [limit, canvas] = all("input, canvas", element);
  const { view: [low, high] } = metric, isFolded = column.every((value) => !(value < 0));
  const key = `m${m}`;
  let drag = null, known = null;

  const samplesOf = (isHuman) => [...column.subarray(...(isHuman ? [run.futures] : [0, run.futures]))].filter((value) => !Number.isNaN(value));
  const someOf = (values, count, xs, atoms) => curveOf(values, count, xs, run.info.bandwidth, isFolded, atoms.map(Math.fround));

  // Curves of both sets on a grid of pixels, and how high they are.
  function curvesAt(width) {
    if (known && known.xs.length === width + 1) return known;
    const xs = Array.from({ length: width + 1 }, (_, i) => low + i / width * (high - low)), sets = [samplesOf(false), samplesOf(true)];
    const [drawn, likely] = sets.map((values, i) => someOf(values, values.length, xs, values.length ? [metric.atoms, metric.likely_atoms][i] : []));
    if (!sets[1].length) likely.points = [];
    const highest = (k, of) => Math.max(1e-9, ...[drawn, likely].flatMap((curve) => curve[of].map((point) => point[k])));
    known = { xs, drawn, likely, peak: highest(1, "points"), most: highest(1, "atoms") };
    return known;
  }

  const toX = (value) => (value - low) / (high - low) * canvas.clientWidth, toValue = (px) => low + px / canvas.clientWidth * (high - low);
  const gripX = (value) => clamp(toX(value), 5, canvas.clientWidth - 5); // within reach, also of a threshold beyond the axis
  const isNear = (px, value) => value !== null && Math.abs(gripX(value) - px) < 9, told = (value) => `${Number(value.toFixed(3))} ${metric.unit}`.trim();

  function draw(isCumulative) {
    const pen = sharp(canvas), { paint, write, width } = pen, threshold = state.thresholds[m], own = toX(column[state.future]);
    if (!width || !metric.ticks.length) return;
    const { xs, drawn, likely, peak, most } = curvesAt(width), base = bottomAxis(pen, metric.ticks, toX), top = isCumulative ? 1 : 1.12 * peak;
    const at = (x, y) => [toX(x), base - clamp(y / top, 0, 1) * (base - 4)], upright = (x, style) => paint([[x, 0], [x, base]], style);
    const curveLine = ({ points }, more = 0) => points.map((point) => at(point[0], point[isCumulative ? 2 : 1] + more));
    const area = (upper, lower, fill, alpha) => paint([...upper, ...lower.reverse()], { fill, alpha });
    const box = (left, right, y, bottom, fill, alpha) => area([[left, y], [right, y]], [[left, bottom], [right, bottom]], fill, alpha);
    const curve = (found, stroke, dash) => {
      paint(curveLine(found), { stroke, dash });
      if (isCumulative) return;
      if (!dash) area(curveLine(found), curveLine(found).map(([x]) => [x, base]), stroke, 0.18);
      for (const [x, share] of found.atoms) paint([at(x, 0), at(x, 0.86 * top * share / most)], { stroke, width: 3, dash });
    };
    if (threshold !== null) {
      box(toX(threshold), metric.sign === "≤" ? 0 : width, 0, base, "critical", 0.1);
      upright(toX(threshold), { stroke: "critical" });
      box(gripX(threshold) - 4, gripX(threshold) + 4, base / 2 - 9, base / 2 + 9, "critical");
      const style = { fill: "critical", halo: "card" };
      if (threshold < low) write(`← ${told(threshold)}`, 12, base / 2 + 4, { ...style, align: "left" });
      if (threshold > high) write(`${told(threshold)} →`, width - 12, base / 2 + 4, { ...style, align: "right" });
    }
    if (isCumulative) area(curveLine(drawn, metric.band), curveLine(drawn, -metric.band), "drawn", 0.2);
    curve(drawn, "drawn");
    curve(likely, "likely", [5, 3]);
    const chosen = [...column.subarray(0, run.futures)].filter((value, c) => state.mask[c] && !Number.isNaN(value));
    if (state.count < run.futures && chosen.length) curve(someOf(chosen, metric.defined, xs, metric.atoms), "picked");
    const [atom] = drawn.atoms.filter(([, share]) => share === most);
    if (atom && !isCumulative) write(percent(most), clamp(toX(atom[0]), 16, width - 16), 9);
    if (metric.recorded !== null) upright(toX(metric.recorded), { stroke: "recorded", dash: [5, 3] });
    if (own >= 0) paint(circle([clamp(own, 4, width - 4), base - 4], 4), { fill: "picked" });
    const brush = state.filters.get(key);
    if (brush) box(...brush.value.map(toX), 0, base, "picked", 0.16);
  }

  function describe() { // P of both sets
    const threshold = state.thresholds[m], isSet = threshold !== null;
    if (document.activeElement !== limit) limit.value = isSet ? Number(threshold.toFixed(3)) : "";
    all("b", element).forEach((said, isHuman) => {
      const share = state.share(m, Boolean(isHuman));
      said.textContent = isSet && !isMissing(share.value) ? percent(share.value) : "";
      said.title = share.words;
    });
  }

  function setLimit(value) {
    const isOther = value !== state.thresholds[m];
    state.thresholds[m] = value;
    state.change({}, "thresholds");
    if (isOther && value !== null) announce(`P(${metric.name} ${metric.sign} ${told(value)}) ${percent(state.share(m).value)} stress test, ${percent(state.share(m, true).value)} human-like`);
  }

  function list() { // the values of the curves as text
    const sets = { "stress test": samplesOf(false), ...(run.info.human ? { "human-like": samplesOf(true) } : {}) };
    if (state.count < run.futures) sets.selected = [...column.subarray(0, run.futures)].filter((value, c) => state.mask[c] && !Number.isNaN(value));
    const rows = Object.entries(sets).map(([name, values]) => {
      const sorted = Float64Array.from(values).sort(), at = (share) => sorted.length ? short(sorted[Math.max(Math.ceil(share * sorted.length) - 1, 0)], 3) : "–";
      return [name, sorted.length, at(0), at(0.05), at(0.25), at(0.5), at(0.75), at(0.95), at(1)];
    });
    const title = `${metric.name}${metric.unit && ` in ${metric.unit}`}, ${metric.mean ? "mean" : "worst"} of a future`;
    tabulate(canvas, title, ["futures driven as", "with a value", "least", "5 %", "25 %", "median", "75 %", "95 %", "largest"], rows);
  }

  function select(values) { // brushes a range of values
    const [least, largest] = values.sort((a, b) => a - b), words = `${metric.name}${metric.mean ? " mean" : ""} ${short(least)} – ${short(largest)} ${metric.unit}`;
    state.filter(key, [least, largest], words, (c) => column[c] >= least && column[c] <= largest);
  }

  limit.onchange = () => setLimit(limit.value === "" ? null : Number(limit.value));
  canvas.onpointerdown = ({ pointerId, offsetX }) => {
    canvas.setPointerCapture(pointerId);
    drag = { from: offsetX, isLimit: isNear(offsetX, state.thresholds[m]) };
  };
  canvas.onpointermove = ({ offsetX }) => {
    const px = clamp(offsetX, 0, canvas.clientWidth);
    const isGrip = isNear(px, state.thresholds[m]);
    canvas.title = isGrip ? `threshold ${told(state.thresholds[m])}` : "";
    if (!drag) canvas.style.cursor = isGrip ? "ew-resize" : "crosshair";
    else if (drag.isLimit) setLimit(isNear(px, metric.threshold) ? metric.threshold : toValue(px)); // the run's own attracts
    else if (Math.abs(px - drag.from) > 3) select([toValue(px), toValue(drag.from)]);
  };
  canvas.onpointerup = canvas.onpointercancel = () => { drag = null; };
  return { element, metric, draw, describe, list, select, setLimit };
}

// Cumulative curves of the driver under test and of the baseline, with their bands.
function testedCurves(host, charts) {
  const canvases = charts.map(({ title }) => make("canvas", { ariaLabel: title }));
  host.append(...charts.map(({ title }, i) => make("div.chart", {}, make("header", {}, make("span", title)), canvases[i])));
  return () => charts.forEach(({ sets, view: [low, high], threshold, side, ticks }, i) => {
    const pen = sharp(canvases[i]), { paint, write, width } = pen, toX = (value) => (value - low) / (high - low) * width;
    if (!sets.length) return write("defined in no future", width / 2, 60);
    const shares = sets.map(({ values }) => stepsOf(values.map((value) => value ?? Infinity), ticks.map(([value]) => value)));
    tabulate(canvases[i], `${charts[i].title}: share at or below`, ["value", ...sets.map(({ kind }) => kind)], ticks.map(([, words], k) => [words, ...shares.map((share) => percent(share[k]))]));
    const base = bottomAxis(pen, ticks, toX), xs = Array.from({ length: width + 1 }, (_, px) => low + px / width * (high - low));
    const at = (x, share) => [toX(x), base - clamp(share, 0, 1) * (base - 4)];
    if (threshold !== null) {
      const far = side === "left" ? low : high;
      paint([at(threshold, 0), at(threshold, 1), at(far, 1), at(far, 0)], { fill: "critical", alpha: 0.1 });
      paint([at(threshold, 0), at(threshold, 1)], { stroke: "critical" });
    }
    for (const { kind, values, band } of sets) {
      const share = stepsOf(values.map((value) => value ?? Infinity), xs), line = (more) => share.map((y, k) => at(xs[k], y + more));
      paint([...line(band), ...line(-band).reverse()], { fill: kind, alpha: 0.2 });
      paint(line(0), { stroke: kind });
    }
  });
}

// Share of values at or below each of ascending places.
function stepsOf(values, xs) {
  const sorted = Float64Array.from(values).sort();
  let below = 0;
  return xs.map((x) => {
    while (below < sorted.length && sorted[below] <= x) below++;
    return below / sorted.length;
  });
}
