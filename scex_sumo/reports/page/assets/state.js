// State of a page: what is chosen, and who is told when that changes.

function makeState(run) {
  const listeners = [], pending = new Set();
  const state = {
    step: 0, child: -1, pair: null, focus: -1, playing: false, curve: "density",
    show: { ids: true, ghosts: true, paths: true, recorded: true, heat: false },
    thresholds: run.info.metrics.map((metric) => metric.threshold),
    filters: new Map(), selection: 0, mask: new Uint8Array(run.children).fill(1), count: run.children,

    // Calls back with the set of names that changed, once per frame.
    listen(callback) { listeners.push(callback); },
    change(values, ...names) {
      Object.assign(state, values);
      if (!pending.size) requestAnimationFrame(state.tell);
      for (const name of [...Object.keys(values), ...names]) pending.add(name);
    },
    tell() {
      const changed = new Set(pending);
      pending.clear();
      for (const callback of listeners) callback(changed);
    },

    seek(step) { state.change({ step: clamp(step, 0, run.frames - 1), playing: false }); },

    // Selects the children that a filter keeps, together with all other filters; null takes it away.
    filter(key, words, keeps) {
      if (keeps) state.filters.set(key, { words, keeps });
      else state.filters.delete(key);
      const tests = [...state.filters.values()].map((entry) => entry.keeps);
      state.mask = state.mask.map((_, c) => tests.every((test) => test(c)));
      state.selection++;
      state.change({ count: state.mask.reduce((sum, kept) => sum + kept, 0) }, "mask");
    },
    selected(offset) { // the next of the selected children, in a circle
      const start = state.child < 0 && offset < 0 ? 0 : state.child;
      for (let i = 1; i <= run.children; i++) {
        const child = (start + offset * i + 2 * run.children) % run.children;
        if (state.mask[child]) return child;
      }
      return state.child;
    },

    isCritical(m, value, limit = state.thresholds[m]) {
      if (limit === null || isMissing(value)) return false;
      return run.info.metrics[m].side === "left" ? value <= Math.fround(limit) : value >= Math.fround(limit);
    },
    share(m, column) { // critical among all; where a metric is undefined, nothing is critical
      const critical = column.filter((value) => state.isCritical(m, value)).length, { p, threshold } = run.info.metrics[m];
      const isOwn = p && column === run.columns[m] && state.thresholds[m] === threshold; // the library's interval
      return { ...(isOwn ? p : wilson(critical, column.length)), critical, count: column.length };
    },
  };
  return state;
}
