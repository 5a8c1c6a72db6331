// Vehicles of the map: the one under the pointer says what it is.

function nameVehicles(run, state, map, canvas) {
  const { info, id } = run;
  canvas.addEventListener("pointermove", ({ offsetX, offsetY, buttons }) => {
    const v = buttons ? null : map.at(offsetX, offsetY);
    canvas.title = "";
    if (v === null) return;
    const { speed: [speeds], acceleration: [rates] } = motionOf(run, run.poses, [map.rowOf(v)]), t = Math.round(state.step);
    const by = state.future < 0 ? "as in most of the futures" : info.models[run.model(state.future, v)], tested = info.under_test.includes(id(v)) ? " under test" : "";
    canvas.title = `vehicle ${id(v)}: ${info.types[v]}${tested}, ${short(speeds[t], 1)} m/s, ${short(rates[t], 1)} m/s², ${by}`;
  });
}
