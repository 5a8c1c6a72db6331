// State of a page: what is chosen, and who is told when that changes.

function makeState(run) {
  const pending = new Set(), filters = new Map();
  const state = {
    step: 0, child: -1, pair: null, vehicle: null, focus: -1, playing: false, filters,
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
    // `value` is what the address of the page keeps of it.
    filter(key, value, words, keeps) {
      if (keeps) filters.set(key, { value, words, keeps });
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
    // Share of the selected children in which something happens.
    shareOf(happens) {
      const count = state.mask.filter((isSelected, c) => isSelected && happens(c)).length, found = interval(count / state.count, state.count);
      return { ...found, count, words: `${count} of ${state.count} futures${filters.size ? " selected" : ""}; 95 %: ${range(found)}` };
    },
    // Critical share of the selected children, or of a human-like column. Of all children it is the run's own
    // at its threshold; elsewhere the number of independent children that the design is worth there counts.
    share(m, column = run.columns[m]) {
      const isDrawn = column === run.columns[m], { p, threshold, numbers } = run.info.metrics[m];
      if (isDrawn && filters.size) return state.shareOf((c) => state.isCritical(m, column[c]));
      const critical = column.filter((value) => state.isCritical(m, value)).length, value = critical / column.length;
      const found = isDrawn && p && state.thresholds[m] === threshold ? p : interval(value, numbers.find(([share]) => share >= value)[1]);
      return { ...found, words: `${critical} of ${column.length} futures; 95 %: ${range(found)}` };
    },
  };
  return state;
}
