// Vehicles of the map: a card for the one under the pointer, which a click keeps with its encounters.

function vehicleCard(run, state, map, jump) {
  const { info, id } = run, canvas = byId("map"), card = byId("vehicle");
  let pointed = null, from = null, shown = "";
  const mine = (v) => info.encounters.rows.filter(({ pair }) => pair.includes(v));

  canvas.addEventListener("pointermove", ({ offsetX, offsetY, buttons }) => {
    pointed = buttons ? pointed : map.at(offsetX, offsetY);
    canvas.style.cursor = pointed === null ? "" : "pointer";
    draw();
  });
  canvas.addEventListener("pointerdown", ({ offsetX, offsetY }) => { from = [offsetX, offsetY]; });
  canvas.addEventListener("pointerup", ({ offsetX, offsetY }) => {
    if (from && distance(from, [offsetX, offsetY]) < 4) state.change({ vehicle: map.at(offsetX, offsetY) });
  });
  canvas.addEventListener("pointerleave", () => { pointed = null; draw(); });

  function draw() {
    const v = state.vehicle ?? pointed, isKept = v !== null && v === state.vehicle;
    card.hidden = v === null;
    if (v === null) return;
    const { speed: [speeds], acceleration: [rates] } = motionOf(run, run.poses, [map.rowOf(v)]), t = Math.round(state.step), met = mine(v);
    const by = state.future < 0 ? "as in most of the futures" : info.models[run.model(state.future, v)];
    const words = `${info.types[v]}${info.under_test.includes(id(v)) ? " under test" : ""} · ${short(speeds[t], 1)} m/s · ${short(rates[t], 1)} m/s² · ${by}`;
    const key = `${v} ${isKept}`;
    if (shown !== key) { // a button that is made anew while it is pressed has no click
      const told = (row) => `${row.pair.map(id).join(" → ")}: ${row.human ? "human-like " : ""}collision ${percent(row.share)}, ${seconds(row.step)}`;
      const rows = isKept ? met.slice(0, 6).map((row) => make("button", { textContent: told(row), title: row.words, onclick: () => jump(row) })) : [];
      const close = make("button", { textContent: "×", title: "Close (Esc)", onclick: () => state.change({ vehicle: null }) });
      const count = `${met.length} ${met.length === 1 ? "encounter" : "encounters"}${isKept ? "" : "; a click lists them"}`;
      card.replaceChildren(make("b", `vehicle ${id(v)}`), ...(isKept ? [close] : []), make("p"), make("p.soft", count), ...rows);
      shown = key;
    }
    card.querySelector("p").textContent = words;
  }
  return draw;
}
