// Charts: density or cumulative curve of a metric from the run's tables, brushed and with a threshold to drag.

// Points [x, density, share at or below x] of a curve of the tables, and its atoms [value, share]; units as in curves.py.
function curveOf({ arrays }, name) {
  const { [name]: found, [`${name}_atoms`]: atoms } = arrays, rows = ({ shape, values }) => Array.from({ length: shape[0] }, (_, i) => [...values.subarray(i * shape[1], (i + 1) * shape[1])]);
  return found ? { points: rows(found).map(([x, density, below]) => [x / 1e3, density / 1e4, below / 1e4]), atoms: rows(atoms) } : { points: [], atoms: [] };
}

// The same of some of `count` samples: kernels, those below 0 folded back, and how many have the atoms' values.
function curveOfSome(values, count, xs, width, isFolded, atoms) {
  const rest = values.filter((v) => atoms.every(([value]) => v !== value)), scale = 1 / (count * width * Math.sqrt(2 * Math.PI));
  const kernels = (x, sign) => rest.reduce((sum, v) => sum + Math.exp(-0.5 * ((x - sign * v) / width) ** 2), 0) * scale;
  return {
    points: xs.filter((x) => x >= 0 || !isFolded).map((x) => [x, kernels(x, 1) + (isFolded && kernels(x, -1)), values.filter((v) => v <= x).length / values.length]),
    atoms: atoms.map(([value]) => [value, values.filter((v) => v === value).length / count]),
  };
}

// Axis along the bottom of a chart, with about as many round numbers as have room; returns where the plot ends.
function bottomAxis({ paint, write, width, height }, low, high) {
  const base = height - 16, raw = (high - low) / Math.max(2, width / 60), power = 10 ** Math.floor(Math.log10(raw));
  const step = power * [1, 2, 5, 10].find((factor) => factor * power >= raw), digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  paint([[0, base + 0.5], [width, base + 0.5]], { stroke: "line", width: 1 });
  for (let tick = Math.ceil(low / step); tick * step <= high; tick++) {
    write((tick * step).toFixed(digits), clamp((tick * step - low) / (high - low) * width, 10, width - 10), height - 4);
  }
  return base;
}

function makeChart(run, state, element) {
  const m = Number(element.dataset.metric), metric = run.info.metrics[m], column = run.columns[m], [limit, canvas] = all("input, canvas", element);
  const drawn = curveOf(run, `curve${m}`), likely = curveOf(run, `likely${m}`), [low, high] = metric.view || [0, 1];
  const peak = Math.max(1e-9, ...[...drawn.points, ...likely.points].map((point) => point[1])), [atom, most] = drawn.atoms.reduce((a, b) => b[1] > a[1] ? b : a, [0, 0]);
  let brush = null, drag = null;

  const toX = (value) => (value - low) / (high - low) * canvas.clientWidth, toValue = (px) => low + px / canvas.clientWidth * (high - low);
  const isNear = (px, value) => value !== null && Math.abs(toX(value) - px) < 9;

  function draw(isCumulative) {
    const pen = sharp(canvas), { paint, write, width } = pen, threshold = state.thresholds[m], own = toX(column[state.child]);
    describe(threshold);
    if (!width || !metric.view) return;
    const base = bottomAxis(pen, low, high), top = isCumulative ? 1 : 1.12 * peak;
    const at = (x, y) => [toX(x), base - clamp(y / top, 0, 1) * (base - 4)], upright = (x, style) => paint([[x, 0], [x, base]], style);
    const line = ({ points }, more = 0) => points.map((point) => at(point[0], point[isCumulative ? 2 : 1] + more));
    const area = (upper, lower, fill, alpha) => paint([...upper, ...lower.reverse()], { fill, alpha });
    const box = (left, right, y, bottom, fill, alpha) => area([[left, y], [right, y]], [[left, bottom], [right, bottom]], fill, alpha);
    const curve = (found, stroke, dash) => {
      paint(line(found), { stroke, dash });
      if (isCumulative || dash) return;
      area(line(found), line(found).map(([x]) => [x, base]), stroke, 0.18);
      for (const [x, share] of found.atoms) paint([at(x, 0), at(x, 0.94 * top * share / most)], { stroke, width: 3 });
    };
    if (threshold !== null) {
      box(toX(threshold), metric.side === "left" ? 0 : width, 0, base, "critical", 0.1);
      upright(toX(threshold), { stroke: "critical" });
      box(toX(threshold) - 4, toX(threshold) + 4, base / 2 - 9, base / 2 + 9, "critical");
    }
    if (isCumulative) area(line(drawn, metric.band), line(drawn, -metric.band), "drawn", 0.2);
    curve(drawn, "drawn");
    curve(likely, "likely", [5, 3]);
    const chosen = column.filter((value, c) => state.mask[c] && !Number.isNaN(value)), xs = Array.from({ length: width / 2 }, (_, i) => toValue(2 * i));
    if (state.count < run.children && chosen.length) curve(curveOfSome(chosen, metric.defined, xs, run.info.bandwidth, metric.folded, drawn.atoms), "picked");
    if (!isCumulative && most) write(`${percent(most)} alike`, clamp(toX(atom), 26, width - 26), 9);
    if (metric.recorded !== null) upright(toX(metric.recorded), { stroke: "recorded", dash: [5, 3] });
    if (own >= 0) paint(circle([clamp(own, 4, width - 4), base - 4], 4), { fill: "picked" });
    if (brush) box(...brush.map(toX), 0, base, "picked", 0.16);
  }

  function describe(threshold) {
    const share = state.share(m), said = element.querySelector("b"), isSet = threshold !== null;
    said.textContent = isSet ? percent(share.value) : "";
    said.title = share.words;
    if (document.activeElement !== limit) limit.value = isSet ? Number(threshold.toFixed(3)) : "";
  }

  function setLimit(value) {
    state.thresholds[m] = value;
    state.change({}, "thresholds");
  }

  // Brushes a range of values; without one it lets go.
  function select(values) {
    brush = values && values.sort((a, b) => a - b);
    const words = values && `${metric.name}${metric.mean ? " mean" : ""} ${values.map((value) => short(value)).join(" – ")}`;
    state.filter(select, words, values && ((c) => column[c] >= values[0] && column[c] <= values[1]));
  }

  limit.onchange = () => setLimit(limit.value === "" ? null : Number(limit.value));
  canvas.onpointerdown = ({ pointerId, offsetX }) => {
    canvas.setPointerCapture(pointerId);
    drag = { from: offsetX, isLimit: isNear(offsetX, state.thresholds[m]) };
  };
  canvas.onpointermove = ({ offsetX }) => {
    const px = clamp(offsetX, 0, canvas.clientWidth);
    if (!drag) canvas.style.cursor = isNear(px, state.thresholds[m]) ? "ew-resize" : "crosshair";
    else if (drag.isLimit) setLimit(isNear(px, metric.threshold) ? metric.threshold : toValue(px)); // the run's own attracts
    else if (Math.abs(px - drag.from) > 3) select([toValue(px), toValue(drag.from)]);
  };
  canvas.onpointerup = canvas.onpointercancel = () => { drag = null; };
  canvas.ondblclick = () => select();
  return { element, metric, draw };
}
