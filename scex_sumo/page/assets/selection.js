// Selection: what happens to pairs in the selected futures, and the tables of these.

const pairKey = (pair) => [...pair].sort((a, b) => a - b).join();
const MAX_TYPICAL = 15; // futures of which the typical one is looked for
const NEAR_M = 10;

function makeSelection(run, state) {
  const { events, encounters, bits, track_ids: ids, types, packed } = run.info, worst = new Map(), collided = new Set(run.info.collided);
  const any = sum(Object.values(bits));
  const places = new Map(encounters.pairs.map((pair, place) => [pairKey(pair), place]));
  for (const { pair, futures } of events.rows) if (pair) worst.set(pairKey(pair), new Set([...worst.get(pairKey(pair)) || [], ...futures]));
  const isOfPair = ({ pair }) => !state.filters.has("pair") || Boolean(pair) && pairKey(pair) === pairKey(state.filters.get("pair").value);
  const share = ({ event, human }, some) => state.shareOf((c) => run.events(event, c) & some, human);
  const isEvent = (row) => share(row, any).count > 0;

  // Selects the futures in which a pair is critical, or if it never is, those in which it is the worst of a metric.
  function onlyPair(pair) {
    const place = places.get(pairKey(pair)), futures = worst.get(pairKey(pair)) || new Set(), critical = (c) => place !== undefined && run.events(place, c) > 0;
    const isCritical = [...state.mask.keys()].some(critical);
    state.filter("pair", pair, `${pair.map(run.id).join(" and ")} are ${isCritical ? "critical" : "the worst pair"}`, isCritical ? critical : (c) => futures.has(c));
  }
  const onlyFuture = (future) => state.filter("future", [future], run.nameOf(future), (c) => c === future);

  // Whether an encounter has all words of a search: numbers are vehicles.
  function isFound({ pair, words }, search) {
    const text = `${words} ${pair.map((v) => types[v]).join(" ")}`.toLowerCase(), names = pair.map((v) => String(ids[v]));
    return search.toLowerCase().split(/[\s,]+/).every((word) => /^\d+$/.test(word) ? names.includes(word) : text.includes(word));
  }

  // The typical one of the selected futures with tracks: of those that collide, else are critical, the middle
  // one by least gap. The run's own typical future stays where it is selected.
  function typicalOf(row) {
    const { future, step, pair, human, event, cells } = row;
    if (state.mask[future] && run.isPacked(future)) return { future, step, gap: cells.at(-2) };
    const chosen = packed.filter((c) => state.mask[c] && run.isHuman(c) === human);
    const hits = [bits.collision, any, 0].map((some) => chosen.filter((c) => !some || run.events(event, c) & some)).find(({ length }) => length) || [];
    const met = hits.slice(0, MAX_TYPICAL).map((c) => {
      const [paths, sizes] = [pair.map((v) => pathAt(run, c, v)), pair.map((v) => run.info.sizes[v])];
      const gaps = paths[0].map((pose, t) => bodyGap(pose, sizes[0], paths[1][t], sizes[1])), gap = Math.min(...gaps);
      return { future: c, step: gaps.indexOf(gap), gap };
    });
    return met.sort((a, b) => a.gap - b.gap)[Math.floor((met.length - 1) / 2)] || { future: -1 };
  }

  function encounterRows(search) {
    const rows = encounters.rows.filter((row) => isOfPair(row) && isFound(row, search));
    if (!state.filters.size) return rows;
    return rows.filter((row) => state.filters.has("pair") || isEvent(row)).map((row) => {
      const hit = share(row, bits.collision), { future, step, gap } = typicalOf(row);
      const shown = { range: range(hit), gap: gap < NEAR_M ? gap : null, after: future < 0 ? null : step / 10 };
      for (const [name, bit] of Object.entries(bits)) shown[name] = share(row, bit).value;
      return { ...row, future, step, said: null, cells: row.cells.map((cell, i) => encounters.columns[i].selected ? shown[encounters.columns[i].selected] : cell) };
    });
  }

  function eventRows() {
    const chosen = events.rows.filter((row) => row.metric === state.focus && isOfPair(row)).map((row) => ({ ...row, futures: row.futures.filter((c) => state.mask[c]) }));
    return chosen.filter(({ futures }) => futures.length).map((row) => {
      const named = row.futures.slice(0, 4).join(", ") + (row.futures.length > 4 ? ", …" : "");
      return { ...row, future: row.futures.find(run.isPacked) ?? row.futures[0], cells: [...row.cells.slice(0, 3), row.futures.length, named] };
    });
  }

  const collision = (isHuman) => state.shareOf((c) => collided.has(c), isHuman);
  const isShown = (v) => !state.filters.has("pair") || state.filters.get("pair").value.includes(v);
  return { onlyPair, onlyFuture, encounterRows, eventRows, collision, typicalOf, isShown };
}

const pathAt = (run, future, v) => Array.from({ length: run.frames }, (_, t) => poseAt(run.poses, run.frames, run.track(future, v), t));
