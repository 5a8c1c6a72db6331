// State of a page: what is chosen, and who is told when that changes.

function makeState(run) {
  const pending = new Set(), filters = new Map();
  const state = {
    step: 0, rest: -1, future: -1, pair: null, focus: -1, playing: false, filters,
    thresholds: run.info.metrics.map((metric) => metric.threshold),
    selection: 0, mask: new Uint8Array(run.total).fill(1), count: run.futures, human: run.total - run.futures,

    // Last step of a film: a second after its event, and not before the second one.
    end: () => state.rest < 0 ? run.frames - 1 : Math.min(Math.max(state.rest + 10, 20), run.frames - 1),

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

    // Selects the futures that a filter keeps, together with all other filters; without a test it goes.
    // `value` is what the address of the page keeps of it.
    filter(key, value, words, keeps) {
      if (keeps) filters.set(key, { value, words, keeps });
      else filters.delete(key);
      state.mask = state.mask.map((_, c) => [...filters.values()].every((entry) => entry.keeps(c)));
      state.change({ selection: state.selection + 1, count: sum(state.mask.subarray(0, run.futures)), human: sum(state.mask.subarray(run.futures)) });
    },
    show(future, values = {}) { // a future, if the page has its tracks
      if (future < 0 || run.isPacked(future)) return state.change({ future, ...values });
      say(`the page holds no tracks of ${run.nameOf(future)}: scex-sumo view ${run.info.folder} --future ${future}`);
    },
    nextFuture(isBack) { // of the selected ones with tracks, in a circle
      const chosen = run.info.packed.filter((c) => state.mask[c]);
      const next = isBack ? chosen.findLast((c) => c < state.future) : chosen.find((c) => c > state.future);
      state.change({ future: next ?? chosen.at(isBack ? -1 : 0) ?? -1 });
    },

    isCritical(m, value, limit = state.thresholds[m]) {
      if (limit === null || isMissing(value)) return false;
      return run.info.metrics[m].sign === "≤" ? value <= Math.fround(limit) : value >= Math.fround(limit);
    },
    // Share of the selected futures of a set in which something happens.
    shareOf(happens, isHuman = false) {
      const [first, stop, all] = isHuman ? [run.futures, run.total, state.human] : [0, run.futures, state.count];
      let count = 0;
      for (let c = first; c < stop; c++) if (state.mask[c] && happens(c)) count++;
      const found = interval(count / all, all);
      return { ...found, count, words: `${count} of ${all} futures${filters.size ? " selected" : ""}; 95 %: ${range(found)}` };
    },
    // Critical share of the selected futures of a set. Of all of the stress test it is the run's own at its
    // threshold.
    share(m, isHuman = false) {
      const found = state.shareOf((c) => state.isCritical(m, run.columns[m][c]), isHuman), { p, threshold } = run.info.metrics[m];
      if (isHuman || filters.size || !p || state.thresholds[m] !== threshold) return found;
      return { ...found, ...p, words: `${found.count} of ${run.futures} futures; 95 %: ${range(p)}` };
    },
  };
  return state;
}
