// State of a page: what is chosen, and who is told when that changes.

function makeState(run) {
  const pending = new Set(), filters = new Map();
  const state = {
    step: 0, child: -1, pair: null, focus: -1, playing: false, filters,
    thresholds: run.info.metrics.map((metric) => metric.threshold),
    selection: 0, mask: new Uint8Array(run.children).fill(1), count: run.children,

    // Takes values, and tells at most once per frame, with a test for names, what has changed since.
    change(values, ...names) {
      Object.assign(state, values);
      if (!pending.size) requestAnimationFrame(state.tell);
      for (const name of [...Object.keys(values), ...names]) pending.add(name);
    },
    tell() {
      const changed = new Set(pending);
      pending.clear();
      state.onChange((...names) => names.some((name) => changed.has(name)));
    },

    seek(step) { state.change({ step: clamp(step, 0, run.frames - 1), playing: false }); },

    // Selects the children that a filter keeps, together with all other filters; without a test it goes.
    filter(key, words, keeps) {
      if (keeps) filters.set(key, { words, keeps });
      else filters.delete(key);
      state.mask = state.mask.map((_, c) => [...filters.values()].every((entry) => entry.keeps(c)));
      state.change({ selection: state.selection + 1, count: sum(state.mask) });
    },
    nextChild(isBack) { // of the selected ones, in a circle
      const chosen = [...state.mask.keys()].filter((c) => state.mask[c]);
      const next = isBack ? chosen.findLast((c) => c < state.child) : chosen.find((c) => c > state.child);
      state.change({ child: next ?? chosen.at(isBack ? -1 : 0) ?? -1 });
    },

    isCritical(m, value, limit = state.thresholds[m]) {
      if (limit === null || isMissing(value)) return false;
      return run.info.metrics[m].sign === "≤" ? value <= Math.fround(limit) : value >= Math.fround(limit);
    },
    // Critical share of all children; at the run's own threshold as its tables have it, elsewhere with the
    // number of independent children that the design is worth there.
    share(m, column = run.columns[m]) {
      const { p, threshold, numbers } = run.info.metrics[m], critical = column.filter((value) => state.isCritical(m, value)).length;
      const value = critical / column.length, isOwn = p && column === run.columns[m] && state.thresholds[m] === threshold;
      const found = isOwn ? p : interval(value, numbers.find(([share]) => share >= value)[1]);
      return { ...found, words: `${critical} of ${column.length} futures; 95 %: ${range(found)}` };
    },
  };
  return state;
}
