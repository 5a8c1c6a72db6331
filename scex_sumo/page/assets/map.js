// Map: the road, and the vehicles of all futures, one future, or the selected ones, at any time.

const OUTLINE = [[0.36, 0.5], [0.5, 0.3], [0.5, -0.3], [0.36, -0.5], [-0.5, -0.5], [-0.5, 0.5]]; // pointed at the front
const ROAD_UNIT = 0.05; // m, as in road_lines.py
const POINTED_PX = 8; // reach of the pointer beyond a body
const MAX_GHOSTS = 500; // drawn in a frame; more are thinned out
const DASHED = 6; // px of a metre from which outlines are dashed: dashes take long to draw
const SPARE = 1.5; // the ground is drawn as much larger than the map, so that it can be moved
const AROUND_M = 22; // shown around the ways of a pair
const NAMED = 8; // px of a metre from which a vehicle has the initials of its model
const ROAD_COLORS = ["road", "road", "mark", "border", "mark"]; // surface, area, marking, border, stop line
const LIGHT_INKS = { G: "go", g: "go", y: "slow", Y: "slow", u: "slow", r: "stop", R: "stop" }; // SUMO's letters

function makeMap(run, state, canvas) {
  const { info, poses, frames, arrays, owner } = run, vehicles = [...info.track_ids.keys()], road = roadOf(info);
  const ground = make("canvas"), view = {}, pointers = new Map();
  const tracks = vehicles.map(() => []);
  owner.forEach((v, row) => tracks[v].push(row));
  let weights, drivers, usual, ghosts, groundKey, groundAt, half = [0, 0];

  // How many of the selected futures of the stress test drive each track, one of them, and each vehicle's most frequent track.
  function weigh() {
    weights = new Float32Array(owner.length);
    drivers = new Int32Array(owner.length);
    const packed = info.packed.filter((future) => !run.isHuman(future)), chosen = packed.filter((future) => state.mask[future]);
    for (const future of chosen) for (const v of vehicles) {
      weights[run.track(future, v)] += state.count / chosen.length;
      drivers[run.track(future, v)] = future;
    }
    usual = vehicles.map((v) => run.track(packed[0], v));
    owner.forEach((v, row) => { if (weights[row] > weights[usual[v]]) usual[v] = row; });
    ghosts = tracks.flatMap((rows) => thinned(rows.filter((row) => weights[row]), Math.ceil(MAX_GHOSTS / vehicles.length)));
  }

  // Tracks with their weights; of too many, a systematic sample with as much weight in total.
  function thinned(rows, most) {
    if (rows.length <= most) return rows.map((row) => [row, weights[row]]);
    const step = sum(rows.map((row) => weights[row])) / most;
    let passed = 0;
    return rows.flatMap((row) => {
      const before = Math.round(passed / step);
      passed += weights[row];
      const picks = Math.round(passed / step) - before;
      return picks ? [[row, picks * step]] : [];
    });
  }

  const isShown = (name) => byId(`show-${name}`).checked, middle = () => half;
  const measure = () => { half = [canvas.clientWidth / 2, canvas.clientHeight / 2]; }; // once a frame: it may cost a layout
  const toScreen = ([px, py], [w, h] = middle()) => [w + (px - view.x) * view.scale, h - (py - view.y) * view.scale];
  // Where a vehicle is: in the future, or on the way of most of the selected ones.
  const rowOf = (v, future = state.future) => future < 0 ? usual[v] : run.track(future, v);
  const poseOf = (row) => poseAt(poses, frames, row, state.step), place = (v, future) => poseOf(rowOf(v, future));

  function look(centre, wide, high = wide) {
    measure();
    const [w, h] = middle();
    [view.x, view.y] = centre;
    view.scale = Math.min(2 * (w || 200) / wide, 2 * (h || 125) / high);
    state.change({}, "view");
  }

  function fit() {
    const [left, right, low, high] = info.box;
    look([(left + right) / 2, (low + high) / 2], right - left + 28, high - low + 28);
  }

  function follow() { // shows the ways of the pair in the film
    if (!state.pair || !isShown("follow")) return;
    const times = Array.from({ length: 7 }, (_, k) => state.end() * k / 6);
    const at = state.pair.flatMap((v) => times.map((t) => poseAt(poses, frames, rowOf(v), t)));
    const [[left, right], [low, high]] = [0, 1].map((k) => at.map((pose) => pose[k])).map((values) => [Math.min(...values), Math.max(...values)]);
    look([(left + right) / 2, (low + high) / 2], right - left + AROUND_M, high - low + AROUND_M);
  }

  function zoom(factor, px = middle()[0], py = middle()[1]) { // the place under the pointer stays there
    const [w, h] = middle(), moved = (1 - 1 / factor) / view.scale;
    view.x += (px - w) * moved;
    view.y -= (py - h) * moved;
    view.scale *= factor;
    state.change({}, "view");
  }

  function pan(across, down) { // by pixels
    view.x -= across / view.scale;
    view.y += down / view.scale;
    state.change({}, "view");
  }

  function draw() {
    measure();
    const pen = sharp(canvas), { context, paint, write, width, height, ratio } = pen, { future } = state, { x, y, scale } = view;
    if (!width) return;
    drawGround(width, height);
    const spare = (SPARE - 1) / 2, [left, top] = [(groundAt[0] - x) * scale - spare * width, (y - groundAt[1]) * scale - spare * height];
    context.drawImage(ground, left, top, SPARE * width, SPARE * height);
    inMetres(pen);
    drawLights(pen);
    if (future < 0 || isShown("ghosts")) drawGhosts(pen, future < 0 ? 0.75 : 0.25);
    drawOthers(pen);
    for (const v of vehicles) {
      if (isShown("recorded") && run.recorded) body(pen, v, poseAt(run.recorded, frames, v, state.step), { stroke: "recorded", dash: scale > DASHED ? [0.7, 0.5] : [] });
      if (future >= 0) body(pen, v, place(v), { fill: color(rowOf(v), future), stroke: "ink" });
    }
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    const ring = (v, stroke, more) => paint(circle(toScreen(place(v)), Math.max(13, run.radius(v) * scale * 1.25) + more), { stroke, width: 2.5 });
    for (const v of state.pair || []) ring(v, "critical", 0);
    if (isShown("ids")) drawIds(pen);
    for (const v of future >= 0 && scale > NAMED ? vehicles : []) {
      const [px, py] = toScreen(place(v));
      stamp(initials(info.models[run.model(future, v)]), { fill: "ink", font: "600 10px system-ui" })(pen, px, py + 4);
    }
    const metres = [5, 10, 20, 50, 100, 200].find((m) => m * scale > 50) || 500, end = width - 14, begin = end - metres * scale;
    paint([[begin, height - 10], [end, height - 10]], { stroke: "soft", width: 2 });
    write(`${metres} m`, (begin + end) / 2, height - 15);
  }

  function inMetres({ context, ratio }, [w, h] = middle()) { // y upwards
    const k = view.scale * ratio;
    context.setTransform(k, 0, 0, -k, ratio * w - view.x * k, ratio * h + view.y * k);
  }

  // Road and paths do not change while it plays: they are drawn once, and again when the view leaves them.
  function drawGround(width, height) {
    const { x, y, scale } = view, { future } = state, key = String([scale, width, height, future, isShown("paths"), inked("map"), state.selection]), spare = (SPARE - 1) / 2 / scale;
    if (key === groundKey && Math.abs(x - groundAt[0]) < spare * width && Math.abs(y - groundAt[1]) < spare * height) return;
    groundKey = key;
    groundAt = [x, y];
    const size = [SPARE * width, SPARE * height], pen = sharp(ground, { clientWidth: size[0], clientHeight: size[1] });
    pen.paint([[0, 0], [size[0], 0], size, [0, size[1]]], { fill: "map" });
    inMetres(pen, size.map((part) => part / 2));
    drawRoad(pen, road, scale);
    const isOne = future >= 0;
    for (const row of !isShown("paths") ? [] : isOne ? vehicles.map(rowOf) : ghosts.map(([ghost]) => ghost)) {
      const points = Array.from({ length: frames }, (_, t) => poses.subarray((row * frames + t) * 4)).filter(([x]) => x < 1e5); // without those that have left
      const style = isOne ? { stroke: color(row, future), alpha: 0.8 } : { stroke: color(row), alpha: 0.22 };
      pen.paint(points, { width: Math.max(0.25, 1 / scale), ...style });
    }
  }

  const color = (row, future = drivers[row]) => info.colors[run.model(future, owner[row])]; // of who drives there

  function body({ context, paint, width, height }, v, [px, py, heading], style) { // unless out of sight
    const { x, y, scale } = view, reach = run.radius(v), [long, wide] = info.sizes[v], c = Math.cos(heading), s = Math.sin(heading);
    if (Math.abs(px - x) > width / 2 / scale + reach || Math.abs(py - y) > height / 2 / scale + reach) return;
    context.beginPath();
    for (const [f, l] of OUTLINE) context.lineTo(px + f * long * c - l * wide * s, py + f * long * s + l * wide * c);
    context.closePath();
    paint(null, { width: Math.max(0.12, 1.2 / scale), ...style });
  }

  function drawGhosts(pen, ink) { // the more futures, the darker
    for (const [row, weight] of ghosts) body(pen, owner[row], poseOf(row), { fill: color(row), alpha: Math.min(0.1 + ink * weight / state.count, 0.9) });
  }

  function drawOthers({ paint }) { // pedestrians and cyclists, as recorded
    const { values } = arrays.others;
    for (let i = 2 * Math.round(state.step); i < values.length; i += 2 * frames) {
      paint(circle([values[i] * UNITS[0], values[i + 1] * UNITS[0]], Math.max(0.4, 3 / view.scale)), { fill: "likely" });
    }
  }

  function drawLights({ paint }) { // bars at the ends of lanes, as they show at the time
    for (const [ends, letters] of info.lights ?? []) {
      const ink = LIGHT_INKS[letters[Math.round(state.step)]];
      if (ink) paint(ends, { stroke: ink, width: Math.max(0.5, 3 / view.scale) });
    }
  }

  // Ids that do not overprint: the pair's first, the others where there is room.
  function drawIds(pen) {
    const taken = [], pair = state.pair || [];
    for (const v of new Set([...pair, ...vehicles])) {
      const [px, py] = toScreen(place(v)), words = String(run.id(v)), wide = 4 * words.length + 2, off = Math.max(12, run.radius(v) * view.scale * 0.75 + 7);
      const spots = [-off, off].map((away) => [px, py + away + 4]);
      const free = spots.find((spot) => taken.every(([tx, ty, tw]) => Math.abs(spot[0] - tx) > wide + tw || Math.abs(spot[1] - ty) > 14));
      if (!free && !pair.includes(v)) continue;
      const isMarked = pair.includes(v) || info.under_test.includes(run.id(v)), at = free || spots[0];
      taken.push([...at, wide]);
      stamp(words, { fill: isMarked ? "critical" : "ink" })(pen, ...at);
    }
  }

  // The vehicle at a place of the screen, or null.
  function at(px, py) {
    const [w, h] = middle(), gaps = vehicles.map((v) => {
      const [cx, cy, heading] = place(v), [dx, dy] = [view.x + (px - w) / view.scale - cx, view.y - (py - h) / view.scale - cy], c = Math.cos(heading), s = Math.sin(heading);
      return Math.hypot(...[dx * c + dy * s, dy * c - dx * s].map((part, k) => Math.max(Math.abs(part) - info.sizes[v][k] / 2, 0))) * view.scale;
    });
    const least = Math.min(...gaps);
    return least < POINTED_PX ? gaps.indexOf(least) : null;
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
    if (!before) return;
    if (other) zoom(distance(here, other) / Math.max(distance(before, other), 1), ...other); // two fingers
    else pan(here[0] - before[0], here[1] - before[1]);
    pointers.set(pointerId, here);
  };
  canvas.onpointerup = canvas.onpointercancel = ({ pointerId }) => pointers.delete(pointerId);
  weigh();
  return { draw, weigh, fit, zoom, pan, follow, at, rowOf };
}

// Initials of a model, e.g. CV.
const initials = (name) => name.split(":")[0].split(/[^a-z]+/i).map(([letter = ""]) => letter.toUpperCase()).join("").slice(0, 2);

// Lanes and areas are drawn a little larger: that hides the seams between them.
function drawRoad({ paint }, road, scale) {
  for (const { path, kind, width: wide } of road) {
    const ink = ROAD_COLORS[kind];
    paint(path, kind === 1 ? { fill: ink, stroke: ink, width: 0.2 } : { stroke: ink, width: wide ? wide + 0.05 : Math.max(kind === 4 ? 0.4 : 0.15, 0.7 / scale) });
  }
}

// Lines of the road, surfaces first, in m.
function roadOf({ road }) {
  return road.map(({ path: lines, ...style }) => {
    const path = new Path2D();
    path.addPath(new Path2D(lines), new DOMMatrix().scale(ROAD_UNIT));
    return { path, ...style };
  });
}
