// Map: the road, and the vehicles of all children, one child, or the selected ones, at any time.

const GHOSTS = { all: 0.75, behind: 0.25 }; // how much ink all ghosts of a vehicle share
const OUTLINE = [[0.36, 0.5], [0.5, 0.3], [0.5, -0.3], [0.36, -0.5], [-0.5, -0.5], [-0.5, 0.5]]; // pointed at the front
const WINDSCREEN = [[0.24, 0.4], [0.12, 0.36], [0.12, -0.36], [0.24, -0.4]];
const SPOTS = [[0, -1], [1, 0], [0, 1], [-1, 0], [1, -1], [-1, 1]]; // of an id around its vehicle

class MapView {
  constructor(run, state, canvas) {
    Object.assign(this, { run, state, canvas, ground: make("canvas"), pointers: new Map(), first: null });
    this.road = roadOf(run);
    this.weigh();
    this.fit();
    canvas.onwheel = (event) => { event.preventDefault(); this.zoom(Math.exp(-event.deltaY / 400), event.offsetX, event.offsetY); };
    canvas.onpointerdown = (event) => this.down(event);
    canvas.onpointermove = (event) => this.move(event);
    canvas.onpointerup = canvas.onpointercancel = (event) => this.up(event);
    canvas.onpointerleave = () => { byId("tip").hidden = true; };
  }

  // How many of the selected children drive each track, one of them, and each vehicle's track of most of them.
  weigh() {
    const { run, state } = this;
    this.weights = new Float32Array(run.owner.length);
    this.drivers = new Int32Array(run.owner.length);
    for (let c = 0; c < run.children; c++) {
      for (let v = 0; v < run.vehicles; v++) {
        this.weights[run.track(c, v)] += state.mask[c];
        if (state.mask[c]) this.drivers[run.track(c, v)] = c;
      }
    }
    this.usual = Array.from({ length: run.vehicles }, (_, v) => run.track(0, v));
    run.owner.forEach((v, row) => { if (this.weights[row] > this.weights[this.usual[v]]) this.usual[v] = row; });
  }

  get middle() { return [this.canvas.clientWidth / 2, this.canvas.clientHeight / 2]; }
  toScreen([x, y]) { return [this.middle[0] + (x - this.x) * this.scale, this.middle[1] - (y - this.y) * this.scale]; }

  fit() {
    const { poses } = this.run, [width, height] = this.middle, room = 14;
    const [x, y] = [0, 1].map((k) => poses.filter((_, i) => i % 3 === k)).map((all) => all.reduce(
      ([low, high], value) => [Math.min(low, value), Math.max(high, value)], [Infinity, -Infinity]));
    this.scale = Math.min(2 * (width || 400) / (x[1] - x[0] + 2 * room), 2 * (height || 250) / (y[1] - y[0] + 2 * room));
    [this.x, this.y] = [(x[0] + x[1]) / 2, (y[0] + y[1]) / 2];
    this.state.change({}, "view");
  }

  zoom(factor, px = this.middle[0], py = this.middle[1]) { // the place under the pointer stays there
    const scale = clamp(this.scale * factor, 0.3, 120), moved = 1 / this.scale - 1 / scale;
    this.x += (px - this.middle[0]) * moved;
    this.y -= (py - this.middle[1]) * moved;
    this.scale = scale;
    this.state.change({}, "view");
  }

  // Keeps the pair in view, without haste; whether it is still on its way.
  pursue() {
    const [a, b] = this.state.pair.map((vehicle) => this.place(vehicle)), wide = Math.hypot(a[0] - b[0], a[1] - b[1]) + 24;
    const step = [(a[0] + b[0]) / 2 - this.x, (a[1] + b[1]) / 2 - this.y, Math.log(2 * Math.min(...this.middle) / wide / this.scale)];
    this.x += 0.2 * step[0];
    this.y += 0.2 * step[1];
    this.scale *= Math.exp(0.2 * step[2]);
    return Math.hypot(step[0], step[1]) * this.scale > 1 || Math.abs(step[2]) > 0.01;
  }

  draw() {
    const { context, width, height, ratio } = sharp(this.canvas), { state, run } = this, { show, child } = state;
    if (!width) return;
    this.drawGround(context, width, height, ratio);
    this.inMetres(context, ratio);
    if (show.recorded && run.recorded) this.drawRecorded(context);
    if (child < 0 || show.ghosts) this.drawGhosts(context, child < 0 ? GHOSTS.all : GHOSTS.behind);
    this.drawOthers(context);
    for (let v = 0; child >= 0 && v < run.vehicles; v++) this.drawVehicle(context, v, run.track(child, v));
    if (show.heat) this.drawHeat(context);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    for (const vehicle of [...(state.pair || []), this.first].filter((v) => !isMissing(v))) {
      const ring = circle(this.toScreen(this.place(vehicle)), Math.max(13, run.radius[vehicle] * this.scale * 1.25));
      paint(context, ring, { stroke: theme.critical, width: 2.5 });
    }
    if (show.ids) this.drawIds(context);
    const metres = [5, 10, 20, 50, 100, 200].find((m) => m * this.scale > 50) || 500, x = width - 14 - metres * this.scale;
    paint(context, [[x, height - 10], [width - 14, height - 10]], { stroke: theme.soft, width: 2 });
    write(context, `${metres} m`, (x + width - 14) / 2, height - 15);
  }

  inMetres(context, ratio) { // y upwards
    const k = this.scale * ratio, [x, y] = this.middle;
    context.setTransform(k, 0, 0, -k, ratio * x - this.x * k, ratio * y + this.y * k);
  }

  // Road and paths do not change while it plays: they are drawn once per view.
  drawGround(context, width, height, ratio) {
    const { state: { show, child, selection }, ground } = this;
    const key = String([this.x, this.y, this.scale, width, height, ratio, child, show.paths, theme.map, selection]);
    if (key !== this.groundKey) {
      this.groundKey = key;
      Object.assign(ground, { width: width * ratio, height: height * ratio });
      const below = ground.getContext("2d");
      below.fillStyle = theme.map;
      below.fillRect(0, 0, ground.width, ground.height);
      this.inMetres(below, ratio);
      for (const { path, ...style } of this.road.map((line) => line(this.scale))) paint(below, path, style);
      if (show.paths) this.drawPaths(below);
    }
    context.drawImage(ground, 0, 0, width, height);
  }

  // Rows of tracks that are shown, with the colour of who drives there.
  *tracks(child) {
    const { run } = this;
    for (let row = 0; row < run.owner.length; row++) {
      const isOwn = child >= 0 && run.track(child, run.owner[row]) === row;
      if (isOwn || this.weights[row]) yield { row, isOwn, color: this.color(row) };
    }
  }

  color(row) {
    const { run, state: { child } } = this, vehicle = run.owner[row];
    const driver = child >= 0 && run.track(child, vehicle) === row ? child : this.drivers[row];
    return run.info.colors[run.model(driver, vehicle)];
  }

  drawPaths(context) {
    const { run, state: { child } } = this, { poses, frames } = run, width = Math.max(0.25, 1 / this.scale);
    for (const { row, isOwn, color } of this.tracks(child)) {
      if (child >= 0 && !isOwn) continue;
      const points = Array.from({ length: frames }, (_, t) => poses.subarray((row * frames + t) * 3, (row * frames + t) * 3 + 2));
      paint(context, points, { stroke: color, width, alpha: isOwn ? 0.8 : 0.22 });
    }
  }

  // Outline of a vehicle in the colours of a style.
  body(context, vehicle, pose, style, shape = OUTLINE) {
    paint(context, pathOf(onBody(pose, this.run.size(vehicle), shape), true), { width: Math.max(0.12, 1.2 / this.scale), ...style });
  }

  drawGhosts(context, ink) {
    const { run, state } = this;
    for (const { row, color } of this.tracks(state.child)) {
      const share = this.weights[row] / Math.max(state.count, 1), pose = poseAt(run.poses, run.frames, row, state.step);
      this.body(context, run.owner[row], pose, { fill: color, alpha: Math.min(0.1 + ink * share, 0.9) });
    }
    for (let v = 0; state.child < 0 && v < run.vehicles; v++) { // where they begin
      this.body(context, v, poseAt(run.poses, run.frames, run.track(0, v), 0), { stroke: theme.ink, alpha: 0.55 });
    }
  }

  drawVehicle(context, vehicle, row) {
    const pose = poseAt(this.run.poses, this.run.frames, row, this.state.step);
    this.body(context, vehicle, pose, { fill: this.color(row), stroke: theme.ink });
    this.body(context, vehicle, pose, { fill: "#0007" }, WINDSCREEN);
  }

  drawRecorded(context) {
    const { run } = this, frames = run.recordedFrames, step = Math.min(this.state.step, frames - 1);
    for (let v = 0; v < run.vehicles; v++) {
      if (!wasThere(run, v, Math.ceil(step))) continue;
      this.body(context, v, poseAt(run.recorded, frames, v, step), { stroke: theme.recorded, dash: [0.7, 0.5] });
    }
  }

  drawOthers(context) { // pedestrians and cyclists, as recorded
    const { arrays: { others, others_present: present }, info } = this.run;
    if (!others) return;
    const [count, frames] = others.shape, t = Math.min(Math.round(this.state.step), frames - 1);
    for (let i = t; i < count * frames; i += frames) {
      const place = [2 * i, 2 * i + 1].map((k) => others.values[k] * info.units.position);
      if (present.values[i]) paint(context, circle(place, Math.max(0.4, 3 / this.scale)), { fill: theme.likely });
    }
  }

  drawHeat(context) {
    const { collision_children: hit, collision_places: places } = this.run.arrays, radius = Math.max(2.2, 9 / this.scale);
    for (let i = 0; hit && i < hit.shape[0]; i++) {
      if (!this.state.mask[hit.values[i]]) continue;
      const place = places.values.subarray(2 * i, 2 * i + 2), glow = context.createRadialGradient(...place, 0, ...place, radius);
      glow.addColorStop(0, theme.critical);
      glow.addColorStop(1, "transparent");
      paint(context, circle(place, radius), { fill: glow, alpha: Math.min(0.85, 0.12 + 4 / hit.shape[0]) });
    }
  }

  // Where a vehicle is now: in the child, or on the way of most of the selected ones.
  place(vehicle) {
    const { run, state: { child, step } } = this;
    return poseAt(run.poses, run.frames, child >= 0 ? run.track(child, vehicle) : this.usual[vehicle], step);
  }

  // Ids that do not overprint: the pair's first, the others where there is room.
  drawIds(context) {
    const { run, state } = this, taken = [], pair = state.pair || [];
    context.textBaseline = "middle";
    for (const vehicle of new Set([...pair, ...run.info.track_ids.keys()])) {
      const [px, py] = this.toScreen(this.place(vehicle)), words = String(run.id(vehicle));
      const wide = 4 * words.length + 2, off = Math.max(12, run.radius[vehicle] * this.scale * 0.75 + 7);
      const spots = SPOTS.map(([dx, dy]) => [px + off * dx, py + off * dy]);
      const free = spots.find(([x, y]) => taken.every(([tx, ty, tw]) => Math.abs(x - tx) > wide + tw || Math.abs(y - ty) > 14));
      if (!free && !pair.includes(vehicle)) continue;
      const [x, y] = free || spots[0], isMarked = pair.includes(vehicle) || run.info.under_test.includes(run.id(vehicle));
      taken.push([x, y, wide]);
      write(context, words, x, y, { fill: isMarked ? theme.critical : theme.ink, font: "600 12px system-ui", halo: theme.halo });
    }
    context.textBaseline = "alphabetic";
  }

  vehicleAt(px, py) {
    let best = null, least = Infinity;
    for (let v = 0; v < this.run.vehicles; v++) {
      const [x, y] = this.toScreen(this.place(v)), away = Math.hypot(x - px, y - py);
      if (away < least && away < Math.max(14, this.run.radius[v] * this.scale)) [best, least] = [v, away];
    }
    return best;
  }

  down(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
    this.moved = 0;
  }

  move(event) {
    const before = this.pointers.get(event.pointerId), here = [event.offsetX, event.offsetY];
    if (!before) return this.hover(event);
    const [, other] = [...this.pointers].find(([id]) => id !== event.pointerId) || [];
    const far = (point) => Math.hypot(point[0] - other[0], point[1] - other[1]);
    if (other) this.zoom(far(here) / Math.max(far(before), 1), ...other); // two fingers
    else {
      this.x -= (here[0] - before[0]) / this.scale;
      this.y += (here[1] - before[1]) / this.scale;
    }
    this.moved += Math.hypot(here[0] - before[0], here[1] - before[1]);
    this.pointers.set(event.pointerId, here);
    this.state.change({}, "view");
  }

  up(event) {
    if (!this.pointers.delete(event.pointerId) || this.moved >= 4) return;
    const vehicle = this.vehicleAt(event.offsetX, event.offsetY), { first } = this; // two one after the other make a pair
    const isPair = vehicle !== null && first !== null && vehicle !== first;
    this.first = isPair ? null : vehicle;
    this.state.change({ pair: isPair ? [first, vehicle].sort((a, b) => a - b) : vehicle === null ? null : this.state.pair });
  }

  hover({ offsetX, offsetY }) {
    const vehicle = this.vehicleAt(offsetX, offsetY), tip = byId("tip"), { run, state: { child, step } } = this;
    tip.hidden = vehicle === null;
    if (vehicle === null) return;
    const words = [`${run.id(vehicle)} ${run.info.types[vehicle]}`];
    if (child >= 0) {
      const t = Math.min(Math.floor(step), run.frames - 2), [a, b] = [t, t + 1].map((k) => poseAt(run.poses, run.frames, run.track(child, vehicle), k));
      words.push(run.info.models[run.model(child, vehicle)], `${(10 * Math.hypot(b[0] - a[0], b[1] - a[1])).toFixed(1)} m/s`);
    }
    tip.textContent = words.join(", ");
    tip.style = `left: ${Math.min(offsetX + 12, this.canvas.clientWidth - 160)}px; top: ${offsetY + 14}px`;
  }
}

// Lines of the road, surfaces first: functions of the scale that give path and style.
function roadOf({ info, arrays }) {
  const { road_points: points, road_sizes: sizes, road_kinds: kinds, road_widths: widths } = arrays, unit = info.units.road;
  let i = 0;
  const lines = Array.from(sizes.values, (size, line) => {
    const path = new Path2D(), kind = kinds.values[line];
    for (let k = 0, x = 0, y = 0; k < size; k++, i++) path.lineTo(unit * (x += points.values[2 * i]), unit * (y += points.values[2 * i + 1]));
    return { kind, path, width: widths.values[line] * unit };
  });
  const isSurface = ({ kind }) => kind === 0 || kind === 3;
  return [...lines.filter(isSurface), ...lines.filter((line) => !isSurface(line))].map(({ kind, path, width }) => (scale) => {
    if (kind === 0) return { path, stroke: theme.road, width };
    if (kind === 3) return { path, fill: theme.road };
    return { path, stroke: kind === 2 ? theme.border : theme.mark, width: Math.max(kind === 4 ? 0.4 : 0.15, 0.7 / scale) };
  });
}
