// Map: the road, and the vehicles of all children, one child, or the selected ones, at any time.

const OUTLINE = [[0.36, 0.5], [0.5, 0.3], [0.5, -0.3], [0.36, -0.5], [-0.5, -0.5], [-0.5, 0.5]]; // pointed at the front
const SPOTS = [[0, -1], [1, 0], [0, 1], [-1, 0], [1, -1], [-1, 1]]; // of an id around its vehicle
const ROAD_COLORS = ["road", "mark", "border", "road", "mark"]; // surface, marking, border, area, stop line

function makeMap(run, state, canvas) {
  const { info, poses, frames, arrays, owner } = run, vehicles = [...info.track_ids.keys()], road = roadOf(run);
  const ground = make("canvas"), pointers = new Map();
  let x, y, scale, weights, drivers, usual, groundKey;

  // How many of the selected children drive each track, one of them, and each vehicle's track of most of them.
  function weigh() {
    weights = new Float32Array(owner.length);
    drivers = new Int32Array(owner.length);
    arrays.which.values.forEach((row, i) => {
      const child = Math.floor(i / run.vehicles);
      weights[row] += state.mask[child];
      if (state.mask[child]) drivers[row] = child;
    });
    usual = vehicles.map((v) => run.track(0, v));
    owner.forEach((v, row) => { if (weights[row] > weights[usual[v]]) usual[v] = row; });
  }

  const middle = () => [canvas.clientWidth / 2, canvas.clientHeight / 2];
  const toScreen = ([px, py], [w, h] = middle()) => [w + (px - x) * scale, h - (py - y) * scale];
  const rowOf = (v) => state.child < 0 ? usual[v] : run.track(state.child, v);
  const poseOf = (row, step = state.step) => poseAt(poses, frames, row, step);
  const place = (v) => poseOf(rowOf(v)); // in the child, or on the way of most of the selected ones

  function look(centre, wide, high = wide) {
    const [w, h] = middle();
    [x, y] = centre;
    scale = Math.min(2 * (w || 200) / wide, 2 * (h || 125) / high);
    state.change({}, "view");
  }

  function fit() {
    const [low, high] = [Math.min, Math.max].map((least) => [0, 1].map((k) => poses.reduce((so, value, i) => i % 3 === k ? least(so, value) : so, poses[k])));
    look([0, 1].map((k) => (low[k] + high[k]) / 2), high[0] - low[0] + 28, high[1] - low[1] + 28);
  }

  function follow(isNew) { // keeps the pair in the middle
    if (!state.pair || !byId("follow").checked) return;
    const [a, b] = state.pair.map(place), wide = distance(a, b) + 24;
    look([(a[0] + b[0]) / 2, (a[1] + b[1]) / 2], isNew ? wide : 2 * Math.min(...middle()) / scale);
  }

  function zoom(factor, px = middle()[0], py = middle()[1]) { // the place under the pointer stays there
    const before = scale, [w, h] = middle();
    scale = clamp(scale * factor, 0.3, 120);
    x += (px - w) * (1 / before - 1 / scale);
    y -= (py - h) * (1 / before - 1 / scale);
    state.change({}, "view");
  }

  function draw() {
    const pen = sharp(canvas), { context, paint, write, width, height, ratio } = pen, { show, child } = state;
    if (!width) return;
    drawGround(width, height);
    context.drawImage(ground, 0, 0, width, height);
    inMetres(pen);
    if (show.recorded && run.recorded) drawRecorded(pen);
    if (child < 0 || show.ghosts) drawGhosts(pen, child < 0 ? 0.75 : 0.25);
    drawOthers(pen);
    for (const v of child < 0 ? [] : vehicles) body(pen, v, place(v), { fill: color(rowOf(v)), stroke: "ink" });
    if (show.heat) drawHeat(pen);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    for (const v of state.pair || []) {
      paint(circle(toScreen(place(v)), Math.max(13, run.radius(v) * scale * 1.25)), { stroke: "critical", width: 2.5 });
    }
    if (show.ids) drawIds(write);
    const metres = [5, 10, 20, 50, 100, 200].find((m) => m * scale > 50) || 500, left = width - 14 - metres * scale;
    paint([[left, height - 10], [width - 14, height - 10]], { stroke: "soft", width: 2 });
    write(`${metres} m`, (left + width - 14) / 2, height - 15);
  }

  function inMetres({ context, ratio }) { // y upwards
    const k = scale * ratio, [w, h] = middle();
    context.setTransform(k, 0, 0, -k, ratio * w - x * k, ratio * h + y * k);
  }

  // Road and paths do not change while it plays: they are drawn once per view.
  function drawGround(width, height) {
    const key = String([x, y, scale, width, height, state.child, state.show.paths, inked("map"), state.selection]);
    if (key === groundKey) return;
    groundKey = key;
    const pen = sharp(ground, canvas);
    pen.paint([[0, 0], [width, 0], [width, height], [0, height]], { fill: "map" });
    inMetres(pen);
    for (const { path, kind, isLine, width: wide } of road) {
      const ink = ROAD_COLORS[kind];
      pen.paint(path, kind === 3 ? { fill: ink } : { stroke: ink, width: isLine ? Math.max(kind === 4 ? 0.4 : 0.15, 0.7 / scale) : wide });
    }
    for (const row of !state.show.paths ? [] : state.child < 0 ? owner.keys() : vehicles.map(rowOf)) {
      const points = Array.from({ length: frames }, (_, t) => poses.subarray((row * frames + t) * 3));
      pen.paint(points, { stroke: color(row), width: Math.max(0.25, 1 / scale), alpha: state.child < 0 ? 0.22 * Math.sign(weights[row]) : 0.8 });
    }
  }

  function color(row) { // of who drives there
    const v = owner[row], isOwn = state.child >= 0 && rowOf(v) === row;
    return info.colors[run.model(isOwn ? state.child : drivers[row], v)];
  }

  function body({ paint }, v, pose, style) {
    paint(pathOf(onBody(pose, run.size(v), OUTLINE), true), { width: Math.max(0.12, 1.2 / scale), ...style });
  }

  function drawGhosts(pen, ink) { // the more children, the darker; and where they begin
    owner.forEach((v, row) => {
      if (weights[row]) body(pen, v, poseOf(row), { fill: color(row), alpha: Math.min(0.1 + ink * weights[row] / state.count, 0.9) });
    });
    for (const v of state.child < 0 ? vehicles : []) body(pen, v, poseOf(usual[v], 0), { stroke: "ink", alpha: 0.55 });
  }

  function drawRecorded(pen) {
    const count = run.recordedFrames, step = Math.min(state.step, count - 1);
    for (const v of vehicles.filter((one) => wasThere(run, one, Math.ceil(step)))) {
      body(pen, v, poseAt(run.recorded, count, v, step), { stroke: "recorded", dash: [0.7, 0.5] });
    }
  }

  function drawOthers({ paint }) { // pedestrians and cyclists, as recorded
    const { others, others_present: present } = arrays, [count, length] = others ? others.shape : [0, 1];
    for (let i = Math.min(Math.round(state.step), length - 1); i < count * length; i += length) {
      const at = [...others.values.subarray(2 * i, 2 * i + 2)].map((value) => value * info.units.position);
      if (present.values[i]) paint(circle(at, Math.max(0.4, 3 / scale)), { fill: "likely" });
    }
  }

  function drawHeat({ paint }) { // collisions of the selected children
    const { collision_children: hit, collision_places: places } = arrays, radius = Math.max(1.6, 7 / scale);
    (hit ? [...hit.values] : []).forEach((child, i) => {
      const alpha = state.mask[child] * Math.min(0.5, 0.08 + 3 / hit.shape[0]);
      for (const part of [1, 0.6, 0.25]) paint(circle(places.values.subarray(2 * i), part * radius), { fill: "critical", alpha });
    });
  }

  // Ids that do not overprint: the pair's first, the others where there is room.
  function drawIds(write) {
    const taken = [], pair = state.pair || [];
    for (const v of new Set([...pair, ...vehicles])) {
      const [px, py] = toScreen(place(v)), words = String(run.id(v)), wide = 4 * words.length + 2, off = Math.max(12, run.radius(v) * scale * 0.75 + 7);
      const spots = SPOTS.map(([dx, dy]) => [px + off * dx, py + off * dy + 4]);
      const free = spots.find((spot) => taken.every(([tx, ty, tw]) => Math.abs(spot[0] - tx) > wide + tw || Math.abs(spot[1] - ty) > 14));
      if (!free && !pair.includes(v)) continue;
      const isMarked = pair.includes(v) || info.under_test.includes(run.id(v)), at = free || spots[0];
      taken.push([...at, wide]);
      write(words, ...at, { fill: isMarked ? "critical" : "ink", font: "600 12px system-ui", halo: "halo" });
    }
  }

  function wordsAt(point) { // what a vehicle is, who drives it, and how fast
    const v = vehicles.find((one) => distance(toScreen(place(one)), point) < Math.max(12, run.radius(one) * scale));
    if (v === undefined) return "";
    const t = Math.min(Math.floor(state.step), frames - 2), speed = 10 * distance(poseOf(rowOf(v), t), poseOf(rowOf(v), t + 1));
    return `${run.id(v)}: ${info.types[v]}${state.child < 0 ? "" : `, ${info.models[run.model(state.child, v)]}, ${speed.toFixed(1)} m/s`}`;
  }

  canvas.onwheel = (event) => {
    event.preventDefault();
    zoom(Math.exp(-event.deltaY / 400), event.offsetX, event.offsetY);
  };
  canvas.onpointerdown = ({ pointerId, offsetX, offsetY }) => {
    canvas.setPointerCapture(pointerId);
    pointers.set(pointerId, [offsetX, offsetY]);
  };
  canvas.onpointermove = ({ pointerId, offsetX, offsetY }) => {
    const before = pointers.get(pointerId), here = [offsetX, offsetY], [, other] = [...pointers].find(([id]) => id !== pointerId) || [];
    canvas.title = wordsAt(here);
    if (!before) return;
    if (other) zoom(distance(here, other) / Math.max(distance(before, other), 1), ...other); // two fingers
    else [x, y] = [x - (here[0] - before[0]) / scale, y + (here[1] - before[1]) / scale];
    pointers.set(pointerId, here);
    state.change({}, "view");
  };
  canvas.onpointerup = canvas.onpointercancel = ({ pointerId }) => pointers.delete(pointerId);
  weigh();
  return { draw, weigh, fit, zoom, follow };
}

// Lines of the road, surfaces first.
function roadOf({ info, arrays }) {
  const { road_points: points, road_sizes: sizes, road_kinds: kinds, road_widths: widths } = arrays, unit = info.units.road;
  let i = 0;
  const lines = Array.from(sizes.values, (size, line) => {
    const path = new Path2D(), kind = kinds.values[line];
    for (let k = 0, px = 0, py = 0; k < size; k++, i++) path.lineTo(px += unit * points.values[2 * i], py += unit * points.values[2 * i + 1]);
    return { path, kind, isLine: kind % 3 > 0, width: widths.values[line] * unit };
  });
  return lines.sort((a, b) => a.isLine - b.isLine);
}
