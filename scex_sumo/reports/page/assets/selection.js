// Selection: collisions and events of pairs by future, and the tables of the selected futures.

const pairKey = (pair) => [...pair].sort((a, b) => a - b).join();

function makeSelection(run, state) {
  const { collisions, events, encounters, track_ids: ids, types } = run.info, hits = new Map(), worst = new Map(), collided = new Set(collisions.children);
  const add = (found, pair, children) => found.set(pairKey(pair), new Set([...found.get(pairKey(pair)) || [], ...children]));
  collisions.children.forEach((child, i) => add(hits, collisions.pairs[i], [child]));
  for (const { pair, children } of events.rows) if (pair) add(worst, pair, children);
  const isOfPair = ({ pair }) => !state.filters.has("pair") || Boolean(pair) && pairKey(pair) === pairKey(state.filters.get("pair").value);
  const isEvent = (pair) => [...worst.get(pairKey(pair)) || []].some((c) => state.mask[c]);

  // Selects the futures in which a pair collides or is the worst of a metric; again, it lets go.
  function onlyPair(pair) {
    const futures = worst.get(pairKey(pair)) || new Set();
    state.filter("pair", pair, `${pair.map(run.id).join(" and ")} collide or are the worst pair`, (c) => futures.has(c));
  }
  const onlyFuture = (child) => state.filter("future", [child], `future ${child}`, (c) => c === child);

  // Whether an encounter has all words of a search: numbers are vehicles.
  function isFound({ pair, words }, search) {
    const text = `${words} ${pair.map((v) => types[v]).join(" ")}`.toLowerCase(), names = pair.map((v) => String(ids[v]));
    return search.toLowerCase().split(/[\s,]+/).every((word) => /^\d+$/.test(word) ? names.includes(word) : text.includes(word));
  }

  // Encounters of the selection, which has no human-like futures; of its futures only collisions are known.
  function encounterRows(search) {
    const rows = encounters.rows.filter((row) => isOfPair(row) && isFound(row, search));
    return !state.filters.size ? rows : rows.filter(({ pair, child }) => child >= 0 && (state.filters.has("pair") || isEvent(pair))).map((row) => {
      const share = state.shareOf((c) => (hits.get(pairKey(row.pair)) || new Set()).has(c));
      const shown = { share: share.value, range: range(share), unknown: null };
      return { ...row, cells: row.cells.map((cell, i) => encounters.columns[i].selected ? shown[encounters.columns[i].selected] : cell) };
    });
  }

  function eventRows() {
    const chosen = events.rows.filter((row) => row.metric === state.focus && isOfPair(row)).map((row) => ({ ...row, children: row.children.filter((c) => state.mask[c]) }));
    return chosen.filter(({ children }) => children.length).map((row) => {
      const named = row.children.slice(0, 4).join(", ") + (row.children.length > 4 ? ", …" : "");
      return { ...row, child: row.children[0], cells: [...row.cells.slice(0, 3), row.children.length, named] };
    });
  }

  const collision = () => state.shareOf((c) => collided.has(c));
  const isShown = (v) => !state.filters.has("pair") || state.filters.get("pair").value.includes(v);
  return { onlyPair, onlyFuture, encounterRows, eventRows, collision, isShown, isEvent: (row) => !state.filters.size || isOfPair(row) && isEvent(row.pair) };
}
