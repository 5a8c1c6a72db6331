// Inspection of a recording: its moments, and who is where at one of them, to choose --time and --assign.

const MOMENT_COLORS = ["drawn", "likely", "soft"]; // as in inspection.py
const VEHICLE_COLUMNS = [
  { title: "track" }, { title: "type" }, { title: "speed", as: "speed", down: true }, { title: "before", as: "seconds", down: true, hint: "recorded before" },
  { title: "after", as: "seconds", down: true, hint: "recorded after" }, { title: "assigned", none: "" },
];
FORMATS.speed = (speed) => `${short(speed, 1)} m/s`;

function showMoments({ info, arrays: { ids, poses, sizes, kinds, types, before, after } }) {
  const [slots, frames] = ids.shape, everybody = [...Array(slots).keys()], assigned = new Map();
  const of = (table, v) => table.values[v * frames + state.step];
  Object.assign(info, { track_ids: everybody, colors: MOMENT_COLORS, models: ["", "", ""], under_test: [], metrics: [], packed: [0] });
  const run = {
    info, frames, vehicles: slots, futures: 1, total: 1, owner: Int32Array.from(everybody), arrays: { others: { values: [] } },
    poses: Float64Array.from(poses.values, (value, i) => value * UNITS[i % 4]),
    radius: (v) => Math.hypot(...info.sizes[v]) / 2, id: (v) => of(ids, v) < 0 ? "" : of(ids, v), track: (_, v) => v, isHuman: () => false, model: (_, v) => of(kinds, v),
  };
  const state = makeState(run), map = makeMap(run, state, byId("map"));
  const present = () => everybody.filter((v) => of(ids, v) >= 0);
  const table = makeTable(byId("vehicles"), { columns: VEHICLE_COLUMNS, rows: [] }, { onRow: assign, isChosen: ({ id }) => assigned.has(id) });

  function assign({ id }) {
    if (!assigned.delete(id)) assigned.set(id, byId("model").value);
    state.change({}, "step");
  }

  function drawMoments() { // bars: everybody, and in colour those that are complete
    const { paint, width, height } = sharp(byId("moments")), most = Math.max(...info.moments.map(([, , vehicles]) => vehicles)), wide = width / frames;
    const bar = (m, count, fill) => paint([[m, 0], [m + 1, 0], [m + 1, count], [m, count]].map(([x, y]) => [x * wide, height * (1 - y / most)]), { fill });
    info.moments.forEach(([, , vehicles, complete], m) => {
      bar(m, vehicles, "line");
      bar(m, complete, "drawn");
    });
    const x = (state.step + 0.5) * wide;
    paint([[x, 0], [x, height]], { stroke: "critical", width: 2 });
  }

  function command() {
    const [time, code] = info.moments[state.step], here = present().map((v) => of(ids, v)).filter((id) => assigned.has(id));
    const drivers = here.map((id) => ` --assign ${id}=${assigned.get(id)}`).join("");
    return `${info.command}${code ? ` --case ${code}` : ""} --time ${time}${drivers} -o out/${info.stem}_t${time}`;
  }

  state.onChange = (any) => {
    const [time, code, vehicles, complete] = info.moments[state.step];
    if (any("step")) {
      info.sizes = everybody.map((v) => [0, 1].map((k) => sizes.values[2 * (v * frames + state.step) + k] / 100));
      table.show(present().map((v) => ({
        id: of(ids, v),
        cells: [of(ids, v), info.types[of(types, v)], poseAt(run.poses, frames, v, state.step)[3], of(before, v) / 10, of(after, v) / 10, assigned.get(of(ids, v))],
      })));
      state.pair = everybody.filter((v) => assigned.has(of(ids, v)));
      byId("title").textContent = `${vehicles} vehicles, ${complete} complete`;
      byId("clock").textContent = `${code ? `case ${code}, ` : ""}${time} s`;
      byId("time").value = state.step;
      byId("command").textContent = command();
    }
    drawMoments();
    map.draw();
  };

  const clicks = {
    "zoom-in": () => map.zoom(1.3), "zoom-out": () => map.zoom(1 / 1.3), fit: map.fit,
    copy: () => navigator.clipboard.writeText(command()).then(() => say("copied"), () => say("select it, to copy")),
    nobody: () => { assigned.clear(); state.change({}, "step"); },
  };
  for (const [name, act] of Object.entries(clicks)) byId(name).onclick = () => act();
  byId("show-ids").onchange = () => state.change({}, "view");
  Object.assign(byId("time"), { max: frames - 1, oninput: ({ target }) => state.seek(Number(target.value)) });
  byId("moments").onclick = ({ offsetX, target }) => state.seek(Math.floor(offsetX / target.clientWidth * frames));
  document.onkeydown = ({ key, target }) => {
    const by = { ArrowLeft: -1, ArrowRight: 1 }[key];
    if (by && !target.matches("input, select")) state.seek(state.step + by);
  };
  onTheme(() => state.change({}, "view"));
  new ResizeObserver(() => map.fit()).observe(byId("mapbox"));
  state.change({ future: 0, step: info.first }, "step");
}

unpack(byId("data").textContent).then(showMoments);
