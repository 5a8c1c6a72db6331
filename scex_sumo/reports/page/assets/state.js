// State of a page: what is chosen, and who is told when that changes.

function makeState(run) {
  const listeners = [];
  const state = {
    step: 0, child: -1, pair: null, focus: -1, playing: false,
    thresholds: run.info.metrics.map((metric) => metric.threshold),
    filters: new Map(), mask: new Uint8Array(run.children).fill(1), count: run.children,

    // Calls back with the set of names that changed, once per frame.
    listen(callback) { listeners.push(callback); },
    pending: new Set(),
    change(values, ...names) {
      Object.assign(state, values);
      if (!state.pending.size) requestAnimationFrame(() => state.tell());
      for (const name of [...Object.keys(values), ...names]) state.pending.add(name);
    },
    tell() {
      const changed = new Set(state.pending);
      state.pending.clear();
      for (const callback of listeners) callback(changed);
    },

    // Selects the children that a filter keeps, together with all other filters; null takes it away.
    filter(key, words, keeps) {
      if (keeps) state.filters.set(key, { words, keeps });
      else state.filters.delete(key);
      const tests = [...state.filters.values()].map((entry) => entry.keeps);
      let count = 0;
      for (let c = 0; c < run.children; c++) count += state.mask[c] = tests.every((test) => test(c)) ? 1 : 0;
      state.change({ count }, "mask");
    },
    selected(offset) { // the next of the selected children, in a circle
      for (let i = 1; i <= run.children; i++) {
        const start = state.child < 0 && offset < 0 ? 0 : state.child;
        const child = (start + offset * i + 2 * run.children) % run.children;
        if (state.mask[child]) return child;
      }
      return state.child;
    },

    isCritical(metric, value) {
      const limit = state.thresholds[metric];
      if (limit === null || Number.isNaN(value)) return false;
      return run.info.metrics[metric].side === "left" ? value <= Math.fround(limit) : value >= Math.fround(limit);
    },
    share(metric, column, mask) { // critical among those in which the metric is defined
      let count = 0, critical = 0;
      column.forEach((value, c) => {
        if (Number.isNaN(value) || (mask && !mask[c])) return;
        count++;
        if (state.isCritical(metric, value)) critical++;
      });
      return { ...wilson(critical, count), critical, count };
    },
  };
  return state;
}

// An element: tag with class names after dots, properties, children.
function make(tag, properties = {}, ...children) {
  const [name, ...classes] = tag.split(".");
  const element = Object.assign(document.createElement(name), properties);
  if (classes.length) element.className = classes.join(" ");
  element.append(...children);
  return element;
}

const byId = (id) => document.getElementById(id);

// Colours of the present theme, by the names of page.css; read once per theme.
const theme = new Proxy({ known: {} }, {
  get(target, name) {
    if (name === "forget") return () => { target.known = {}; };
    return target.known[name] ??= getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  },
});

// A canvas as sharp as the screen: its context in CSS pixels, cleared, with its size.
function sharp(canvas) {
  const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  const wide = Math.round(width * ratio), high = Math.round(height * ratio);
  if (canvas.width !== wide || canvas.height !== high) Object.assign(canvas, { width: wide, height: high });
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}
