// Charts: densities and cumulative curves of a metric, brushed and with a threshold to drag.

const NORMAL = (z) => Math.exp(-0.5 * z * z) / Math.sqrt(2 * Math.PI);
// Normal distribution to 1e-7, with the error function of Abramowitz and Stegun 7.1.26.
function normalBelow(z) {
  const t = 1 / (1 + 0.3275911 * Math.abs(z) / Math.SQRT2);
  const tail = t * (0.254829592 + t * (-0.284496736 + t * (1.421413741 + t * (-1.453152027 + t * 1.061405429)))) * Math.exp(-z * z / 2);
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
      density += NORMAL(z);
      below += normalBelow(z);
    }
    return { density: density / (count * width), below: below / count };
  });
}

const defined = (column, mask) => column.filter((value, c) => !Number.isNaN(value) && (!mask || mask[c])).sort();

// Where most of the samples are, with recorded value and threshold if near.
function viewOf(sorted, marks, width) {
  const finite = sorted.filter(Number.isFinite);
  const [q1, q3] = [quantile(finite, 0.25), quantile(finite, 0.75)], spread = Math.max(q3 - q1, 0.25);
  let low = Math.max(finite[0] - 4 * width, q1 - 5 * spread), high = Math.min(finite[finite.length - 1] + 4 * width, q3 + 5 * spread);
  const near = (high - low) / 2;
  for (const mark of marks) {
    if (mark !== null && mark > low - near && mark < high + near) [low, high] = [Math.min(low, mark - width), Math.max(high, mark + width)];
  }
  return [low, high];
}

// Round numbers between two limits, about as many as asked for.
function ticksOf(low, high, about) {
  const raw = (high - low) / about, power = 10 ** Math.floor(Math.log10(raw));
  const step = power * [1, 2, 5, 10].find((factor) => factor * power >= raw);
  const ticks = [];
  for (let k = Math.ceil(low / step); k * step <= high; k++) ticks.push(k * step);
  return { ticks, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
}

// Axis along the bottom of a chart; returns where the plot ends.
function bottomAxis(context, width, height, low, high, toX) {
  const base = height - 16, { ticks, digits } = ticksOf(low, high, Math.max(2, width / 60));
  Object.assign(context, { fillStyle: theme.soft, strokeStyle: theme.line, font: "11px system-ui", textAlign: "center", lineWidth: 1 });
  context.beginPath();
  context.moveTo(0, base + 0.5);
  context.lineTo(width, base + 0.5);
  context.stroke();
  for (const tick of ticks) context.fillText(tick.toFixed(digits), Math.min(Math.max(toX(tick), 10), width - 10), height - 4);
  return base;
}

class MetricChart {
  constructor(run, state, metric) {
    Object.assign(this, { run, state, metric, brush: null, drag: null });
    const { name, unit } = run.info.metrics[metric];
    this.sorted = defined(run.columns[metric]);
    this.likely = run.likely[metric] && defined(run.likely[metric]);
    this.canvas = make("canvas", { ariaLabel: `Distribution of ${name}` });
    this.share = make("b");
    this.limit = make("input", { type: "number", step: "any", title: "Threshold", onchange: () => this.setLimit(this.limit.value === "" ? null : Number(this.limit.value)) });
    this.note = make("span.soft");
    const side = run.info.metrics[metric].side === "left" ? "≤" : "≥";
    const head = make("header", {}, make("span", { textContent: unit ? `${name} [${unit}]` : name }), make("span", {}, this.share, ` ${side} `, this.limit));
    this.element = make("div.chart", {}, head, this.canvas, this.note);
    this.rescale();
    this.canvas.onpointerdown = (event) => this.down(event);
    this.canvas.onpointermove = (event) => this.move(event);
    this.canvas.onpointerup = this.canvas.onpointercancel = () => this.up();
    this.canvas.ondblclick = () => this.select(null);
  }

  rescale() {
    const { recorded } = this.run.info.metrics[this.metric];
    if (this.sorted.some(Number.isFinite)) [this.low, this.high] = viewOf(this.sorted, [recorded, this.state.thresholds[this.metric]], this.run.info.bandwidth);
  }

  toX(value) { return (value - this.low) / (this.high - this.low) * this.canvas.clientWidth; }
  toValue(event) { return this.low + event.offsetX / this.canvas.clientWidth * (this.high - this.low); }

  draw() {
    const { context, width, height } = sharp(this.canvas);
    if (!width) return;
    if (this.low === undefined) {
      this.note.textContent = "defined in no child";
      return;
    }
    const cumulative = this.state.curve === "cumulative", key = cumulative ? "below" : "density";
    const base = bottomAxis(context, width, height, this.low, this.high, (value) => this.toX(value));
    const xs = Array.from({ length: Math.ceil(width / 2) + 1 }, (_, i) => this.low + 2 * i / width * (this.high - this.low));
    const main = curveOf(this.sorted, xs, this.run.info.bandwidth);
    const part = this.state.count < this.run.children && defined(this.run.columns[this.metric], this.state.mask);
    const curves = { main, likely: this.likely && this.likely.length && curveOf(this.likely, xs, this.run.info.bandwidth),
      picked: part && part.length && curveOf(part, xs, this.run.info.bandwidth) };
    const share = part && !cumulative ? part.length / this.sorted.length : 1;
    const top = cumulative ? 1 : Math.max(...main.map((p) => p.density), ...(curves.likely || []).map((p) => p.density)) * 1.08;
    const toY = (value) => base - value / top * (base - 4);
    this.shadeCritical(context, base);
    if (cumulative) this.band(context, main, toY);
    this.line(context, curves.main, key, toY, theme.drawn, 1, cumulative ? 0 : 0.16, base);
    if (curves.likely) this.line(context, curves.likely, key, toY, theme.likely, 1, 0, base, [5, 3]);
    if (curves.picked) this.line(context, curves.picked, key, toY, theme.picked, share, cumulative ? 0 : 0.4, base);
    this.marks(context, base, width);
    this.say();
  }

  line(context, points, key, toY, color, share, fill, base, dash = []) {
    Object.assign(context, { strokeStyle: color, fillStyle: color, lineWidth: 1.6 });
    context.setLineDash(dash);
    context.beginPath();
    points.forEach((point, i) => context.lineTo(2 * i, toY(point[key] * share)));
    context.stroke();
    context.setLineDash([]);
    if (!fill) return;
    context.lineTo(2 * (points.length - 1), base);
    context.lineTo(0, base);
    context.globalAlpha = fill;
    context.fill();
    context.globalAlpha = 1;
  }

  // 95 % band around the cumulative curve (Dvoretzky, Kiefer, Wolfowitz).
  band(context, points, toY) {
    const half = Math.sqrt(Math.log(40) / (2 * this.sorted.length));
    context.beginPath();
    points.forEach((point, i) => context.lineTo(2 * i, toY(Math.min(point.below + half, 1))));
    for (let i = points.length - 1; i >= 0; i--) context.lineTo(2 * i, toY(Math.max(points[i].below - half, 0)));
    Object.assign(context, { fillStyle: theme.drawn, globalAlpha: 0.18 });
    context.fill();
    context.globalAlpha = 1;
  }

  shadeCritical(context, base) {
    const limit = this.state.thresholds[this.metric];
    if (limit === null) return;
    const x = this.toX(limit), left = this.run.info.metrics[this.metric].side === "left";
    Object.assign(context, { fillStyle: theme.critical, globalAlpha: 0.1 });
    context.fillRect(left ? 0 : x, 0, left ? x : this.canvas.clientWidth - x, base);
    context.globalAlpha = 1;
  }

  marks(context, base, width) {
    const upright = (value, color, dash, wide) => {
      Object.assign(context, { strokeStyle: color, lineWidth: wide });
      context.setLineDash(dash);
      context.beginPath();
      context.moveTo(this.toX(value), 0);
      context.lineTo(this.toX(value), base);
      context.stroke();
      context.setLineDash([]);
    };
    const { recorded } = this.run.info.metrics[this.metric], limit = this.state.thresholds[this.metric];
    if (recorded !== null && recorded !== undefined) upright(recorded, theme.recorded, [5, 3], 1.3);
    if (limit !== null) {
      upright(limit, theme.critical, [], 1.6);
      context.fillStyle = theme.critical;
      context.fillRect(this.toX(limit) - 4, base / 2 - 9, 8, 18);
    }
    if (this.state.child >= 0) {
      const x = this.toX(this.run.columns[this.metric][this.state.child]);
      context.fillStyle = theme.picked;
      context.beginPath();
      if (!Number.isNaN(x)) context.arc(Math.min(Math.max(x, 4), width - 4), base - 4, 4, 0, 7);
      context.fill();
    }
    if (this.brush) {
      const [a, b] = this.brush.map((value) => this.toX(value));
      Object.assign(context, { fillStyle: theme.picked, globalAlpha: 0.16 });
      context.fillRect(a, 0, b - a, base);
      context.globalAlpha = 1;
    }
  }

  say() {
    const { info, columns, children } = this.run, limit = this.state.thresholds[this.metric];
    const share = this.state.share(this.metric, columns[this.metric]);
    this.share.textContent = limit === null ? "" : percent(share.value);
    this.share.title = limit === null ? "" : `${share.critical} of ${share.count}; 95 %: ${percent(share.low)} – ${percent(share.high)}`;
    if (document.activeElement !== this.limit) this.limit.value = limit === null ? "" : Number(limit.toFixed(3));
    const recorded = info.metrics[this.metric].recorded, words = [];
    if (recorded !== null && recorded !== undefined) words.push(`recorded ${short(recorded)}`);
    if (share.count < children) words.push(`defined in ${share.count}/${children}`);
    this.note.textContent = words.join(", ");
  }

  down(event) {
    if (this.low === undefined) return;
    this.canvas.setPointerCapture(event.pointerId);
    const limit = this.state.thresholds[this.metric];
    const near = limit !== null && Math.abs(this.toX(limit) - event.offsetX) < 9;
    this.drag = near ? { limit: true } : { from: this.toValue(event) };
  }

  move(event) {
    if (!this.drag) {
      const limit = this.state.thresholds[this.metric];
      this.canvas.style.cursor = limit !== null && Math.abs(this.toX(limit) - event.offsetX) < 9 ? "ew-resize" : "crosshair";
      return;
    }
    const value = Math.min(Math.max(this.toValue(event), this.low), this.high);
    if (this.drag.limit) this.setLimit(value);
    else if (Math.abs(this.toX(value) - this.toX(this.drag.from)) > 3) this.select([Math.min(value, this.drag.from), Math.max(value, this.drag.from)]);
  }

  up() { this.drag = null; }

  setLimit(value) {
    this.state.thresholds[this.metric] = value;
    this.state.change({}, "thresholds");
  }

  // Brushes a range of values; null lets go.
  select(range) {
    this.brush = range;
    const { name, mean } = this.run.info.metrics[this.metric], column = this.run.columns[this.metric];
    const [low, high] = range || [];
    this.state.filter(`metric ${this.metric}`, range && `${name}${mean ? " mean" : ""} ${short(low)} – ${short(high)}`,
      range && ((c) => column[c] >= low && column[c] <= high));
  }
}
