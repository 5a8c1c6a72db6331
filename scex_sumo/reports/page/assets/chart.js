// Charts: densities and cumulative curves of a metric, brushed and with a threshold to drag.

// Normal distribution to 1e-7, with the error function of Abramowitz and Stegun 7.1.26.
function normalBelow(z) {
  const t = 1 / (1 + 0.3275911 * Math.abs(z) / Math.SQRT2);
  const factors = [1.061405429, -1.453152027, 1.421413741, -0.284496736, 0.254829592];
  const tail = factors.reduce((sum, factor) => t * (factor + sum), 0) * Math.exp(-z * z / 2);
  return z < 0 ? tail / 2 : 1 - tail / 2;
}

// Kernel density and cumulative curve at `xs`; infinite samples count, as in statistics/density.py.
function curveOf(sorted, xs, width) {
  const reach = 5 * width, count = sorted.length;
  let first = 0, last = 0;
  return xs.map((x) => {
    while (first < count && sorted[first] < x - reach) first++;
    while (last < count && sorted[last] <= x + reach) last++;
    let density = 0, below = first;
    for (let i = first; i < last; i++) {
      const z = (x - sorted[i]) / width;
      density += Math.exp(-0.5 * z * z) / Math.sqrt(2 * Math.PI);
      below += normalBelow(z);
    }
    return { density: density / (count * width), below: below / count };
  });
}

const defined = (column, mask) => column.filter((value, c) => !Number.isNaN(value) && (!mask || mask[c])).sort();

// Axis along the bottom of a chart, with about as many round numbers as have room; returns where the plot ends.
function bottomAxis(context, width, height, low, high) {
  const base = height - 16, raw = (high - low) / Math.max(2, width / 60), power = 10 ** Math.floor(Math.log10(raw));
  const step = power * [1, 2, 5, 10].find((factor) => factor * power >= raw);
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  paint(context, [[0, base + 0.5], [width, base + 0.5]], { stroke: theme.line, width: 1 });
  for (let tick = Math.ceil(low / step); tick * step <= high; tick++) {
    const x = (tick * step - low) / (high - low) * width;
    write(context, (tick * step).toFixed(digits), clamp(x, 10, width - 10), height - 4);
  }
  return base;
}

class MetricChart {
  constructor(run, state, m) {
    const metric = run.info.metrics[m], column = run.columns[m];
    Object.assign(this, { run, state, m, metric, column, brush: null, drag: null });
    this.sorted = defined(column);
    this.likely = run.likely[m] && defined(run.likely[m]);
    [this.low, this.high] = metric.view || [];
    this.canvas = make("canvas", { ariaLabel: `Distribution of ${metric.name}` });
    this.share = make("b");
    const setLimit = ({ target: { value } }) => this.setLimit(value === "" ? null : Number(value));
    this.limit = make("input", { type: "number", step: "any", title: "Threshold", onchange: setLimit });
    this.note = make("span.soft");
    this.element = make("div.chart", {},
      make("header", {}, make("span", metric.unit ? `${metric.name} [${metric.unit}]` : metric.name),
        make("span", {}, this.share, metric.side === "left" ? " ≤ " : " ≥ ", this.limit)), this.canvas, this.note);
    this.canvas.onpointerdown = (event) => this.down(event);
    this.canvas.onpointermove = (event) => this.move(event);
    this.canvas.onpointerup = this.canvas.onpointercancel = () => { this.drag = null; };
    this.canvas.ondblclick = () => this.select(null);
  }

  get threshold() { return this.state.thresholds[this.m]; }
  toX(value) { return (value - this.low) / (this.high - this.low) * this.canvas.clientWidth; }
  toValue(event) { return this.low + event.offsetX / this.canvas.clientWidth * (this.high - this.low); }
  isOnLimit(event) { return this.threshold !== null && Math.abs(this.toX(this.threshold) - event.offsetX) < 9; }

  draw() {
    const { context, width, height } = sharp(this.canvas), { bandwidth } = this.run.info, { state, column } = this;
    this.describe();
    if (!width || !this.metric.view) return;
    const cumulative = state.curve === "cumulative", key = cumulative ? "below" : "density";
    const base = bottomAxis(context, width, height, this.low, this.high);
    const xs = Array.from({ length: Math.ceil(width / 2) + 1 }, (_, i) => this.low + 2 * i / width * (this.high - this.low));
    const curve = (samples) => samples && samples.length ? curveOf(samples, xs, bandwidth).map((point) => point[key]) : [];
    const chosen = state.count < this.run.children && defined(column, state.mask);
    const drawn = curve(this.sorted), likely = curve(this.likely), picked = curve(chosen);
    const top = cumulative ? 1 : 1.08 * Math.max(...drawn, ...likely);
    const points = (ys, scale = 1) => ys.map((y, i) => [2 * i, base - clamp(y * scale / top, 0, 1) * (base - 4)]);
    const area = (ys, below, fill, alpha) => paint(context, [...ys, ...below.reverse()], { fill, alpha });
    const ground = () => [[0, base], [width, base]];

    if (this.threshold !== null) {
      const x = this.toX(this.threshold), end = this.metric.side === "left" ? 0 : width;
      area([[x, 0], [end, 0]], [[x, base], [end, base]], theme.critical, 0.1);
    }
    if (cumulative) { // 95 % band (Dvoretzky, Kiefer, Wolfowitz)
      const half = Math.sqrt(Math.log(40) / (2 * this.sorted.length));
      area(points(drawn.map((y) => y + half)), points(drawn.map((y) => y - half)), theme.drawn, 0.18);
    } else area(points(drawn), ground(), theme.drawn, 0.16);
    paint(context, points(drawn), { stroke: theme.drawn });
    paint(context, points(likely), { stroke: theme.likely, dash: [5, 3] });
    const share = cumulative ? 1 : chosen.length / this.sorted.length;
    if (!cumulative && picked.length) area(points(picked, share), ground(), theme.picked, 0.4);
    paint(context, points(picked, share), { stroke: theme.picked });
    this.drawMarks(context, base, width);
  }

  drawMarks(context, base, width) {
    const upright = (value, style) => paint(context, [[this.toX(value), 0], [this.toX(value), base]], style);
    const box = (from, to, y, high, fill, alpha) => paint(context, [[from, y], [to, y], [to, y + high], [from, y + high]], { fill, alpha });
    if (this.metric.recorded !== null) upright(this.metric.recorded, { stroke: theme.recorded, dash: [5, 3] });
    if (this.threshold !== null) {
      upright(this.threshold, { stroke: theme.critical });
      box(this.toX(this.threshold) - 4, this.toX(this.threshold) + 4, base / 2 - 9, 18, theme.critical);
    }
    const own = this.toX(this.column[this.state.child]);
    if (this.state.child >= 0 && !Number.isNaN(own)) paint(context, circle([clamp(own, 4, width - 4), base - 4], 4), { fill: theme.picked });
    if (this.brush) box(...this.brush.map((value) => this.toX(value)), 0, base, theme.picked, 0.16);
  }

  describe() {
    const share = this.state.share(this.m, this.column), { recorded } = this.metric;
    const isSet = this.threshold !== null;
    this.share.textContent = isSet ? percent(share.value) : "";
    this.share.title = isSet ? `${share.critical} of ${share.count}; 95 %: ${range(share)}` : "";
    if (document.activeElement !== this.limit) this.limit.value = isSet ? Number(this.threshold.toFixed(3)) : "";
    this.note.textContent = [recorded !== null && `recorded ${short(recorded)}`,
      this.sorted.length < share.count && `defined in ${this.sorted.length}/${share.count}`].filter(Boolean).join(", ");
  }

  down(event) {
    if (!this.metric.view) return;
    this.canvas.setPointerCapture(event.pointerId);
    this.drag = this.isOnLimit(event) ? { limit: true } : { from: this.toValue(event) };
  }

  move(event) {
    const { drag } = this, value = clamp(this.toValue(event), this.low, this.high);
    if (!drag) this.canvas.style.cursor = this.isOnLimit(event) ? "ew-resize" : "crosshair";
    else if (drag.limit) this.setLimit(value);
    else if (Math.abs(this.toX(value) - this.toX(drag.from)) > 3) this.select([Math.min(value, drag.from), Math.max(value, drag.from)]);
  }

  setLimit(value) {
    this.state.thresholds[this.m] = value;
    this.state.change({}, "thresholds");
  }

  // Brushes a range of values; null lets go.
  select(brush) {
    this.brush = brush;
    const [low, high] = brush || [], words = `${this.metric.name}${this.metric.mean ? " mean" : ""} ${short(low)} – ${short(high)}`;
    this.state.filter(`metric ${this.m}`, words, brush && ((c) => this.column[c] >= low && this.column[c] <= high));
  }
}
