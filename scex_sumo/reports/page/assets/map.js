// Map: the road, and the vehicles of all children, one child, or the selected ones, at any time.

const GHOST = 0.75; // how much ink all ghosts of a vehicle share

class MapView {
  constructor(run, state, pairs, canvas) {
    Object.assign(this, { run, state, pairs, canvas, ground: document.createElement("canvas"), pointers: new Map(), first: null });
    this.road = roadOf(run);
    this.weights = new Float32Array(run.owner.length);
    this.weigh();
    this.fit();
    canvas.onwheel = (event) => { event.preventDefault(); this.zoom(Math.exp(-event.deltaY / 400), event.offsetX, event.offsetY); };
    canvas.onpointerdown = (event) => this.down(event);
    canvas.onpointermove = (event) => this.move(event);
    canvas.onpointerup = canvas.onpointercancel = (event) => this.up(event);
    canvas.onpointerleave = () => { byId("tip").hidden = true; };
  }

  // How many of the selected children drive each track.
  weigh() {
    this.weights.fill(0);
    for (let c = 0; c < this.run.children; c++) {
      if (this.state.mask[c]) for (let v = 0; v < this.run.vehicles; v++) this.weights[this.run.track(c, v)]++;
    }
  }

  fit(points, room = 14) {
    const { poses, frames } = this.run, box = [Infinity, -Infinity, Infinity, -Infinity];
    const all = points || { length: poses.length / 3, at: (i) => [poses[3 * i], poses[3 * i + 1]] };
    for (let i = 0; i < all.length; i += points ? 1 : Math.max(1, Math.floor(frames / 6))) {
      const [x, y] = points ? points[i] : all.at(i);
      box[0] = Math.min(box[0], x); box[1] = Math.max(box[1], x); box[2] = Math.min(box[2], y); box[3] = Math.max(box[3], y);
    }
    const width = this.canvas.clientWidth || 800, height = this.canvas.clientHeight || 500;
    this.scale = Math.min(width / (box[1] - box[0] + 2 * room), height / (box[3] - box[2] + 2 * room));
    this.x = (box[0] + box[1]) / 2;
    this.y = (box[2] + box[3]) / 2;
  }

  zoom(factor, px = this.canvas.clientWidth / 2, py = this.canvas.clientHeight / 2) {
    const [x, y] = this.toWorld(px, py);
    this.scale = Math.min(Math.max(this.scale * factor, 0.3), 120);
    this.x = x - (px - this.canvas.clientWidth / 2) / this.scale;
    this.y = y + (py - this.canvas.clientHeight / 2) / this.scale;
    this.state.change({}, "view");
  }

  toWorld(px, py) { return [this.x + (px - this.canvas.clientWidth / 2) / this.scale, this.y - (py - this.canvas.clientHeight / 2) / this.scale]; }
  toScreen(x, y) { return [this.canvas.clientWidth / 2 + (x - this.x) * this.scale, this.canvas.clientHeight / 2 - (y - this.y) * this.scale]; }

  // Metres instead of pixels, y upwards.
  world(context) {
    const ratio = window.devicePixelRatio || 1, k = this.scale * ratio;
    context.setTransform(k, 0, 0, -k, ratio * this.canvas.clientWidth / 2 - this.x * k, ratio * this.canvas.clientHeight / 2 + this.y * k);
  }

  draw() {
    const { context, width, height } = sharp(this.canvas), { state, run } = this, { show, child } = state;
    if (!width) return;
    this.drawGround(context, width, height);
    this.world(context);
    if (show.recorded && run.recorded) this.drawRecorded(context);
    if (child < 0 || show.ghosts) this.drawGhosts(context, child < 0 ? GHOST : 0.25);
    this.drawOthers(context);
    if (child >= 0) for (let v = 0; v < run.vehicles; v++) this.drawVehicle(context, v, run.track(child, v));
    if (show.heat) this.drawHeat(context);
    context.setTransform(window.devicePixelRatio || 1, 0, 0, window.devicePixelRatio || 1, 0, 0);
    this.drawRings(context);
    if (show.ids) this.drawIds(context);
    this.drawScale(context, height);
  }

  // Road and paths do not change while it plays: they are drawn once per view.
  drawGround(context, width, height) {
    const { show, child, filters } = this.state, { ground } = this;
    const key = [this.x, this.y, this.scale, this.canvas.width, this.canvas.height, child, show.paths, theme.map, ...[...filters.values()].map((f) => f.words)].join();
    if (key !== this.groundKey) {
      Object.assign(ground, { width: this.canvas.width, height: this.canvas.height });
      const below = ground.getContext("2d");
      below.fillStyle = theme.map;
      below.fillRect(0, 0, ground.width, ground.height);
      this.world(below);
      this.drawRoad(below);
      if (show.paths) this.drawPaths(below);
      this.groundKey = key;
    }
    context.drawImage(ground, 0, 0, width, height);
  }

  drawRoad(context) {
    Object.assign(context, { lineCap: "butt", lineJoin: "round", fillStyle: theme.road, strokeStyle: theme.road });
    for (const { kind, width, path } of this.road) {
      if (kind === 0) { context.lineWidth = width; context.stroke(path); }
      if (kind === 3) context.fill(path);
    }
    for (const { kind, path } of this.road) {
      if (kind === 0 || kind === 3) continue;
      context.strokeStyle = kind === 2 ? theme.border : theme.mark;
      context.lineWidth = Math.max(kind === 4 ? 0.4 : 0.15, 0.7 / this.scale);
      context.stroke(path);
    }
  }

  color(track, vehicle) {
    const child = this.state.child >= 0 && this.run.track(this.state.child, vehicle) === track ? this.state.child : this.driver[track];
    return this.run.info.colors[this.run.model(child, vehicle)];
  }

  get driver() { // a child of each track
    if (!this.drivers) {
      this.drivers = new Int32Array(this.run.owner.length);
      for (let c = this.run.children - 1; c >= 0; c--) for (let v = 0; v < this.run.vehicles; v++) this.drivers[this.run.track(c, v)] = c;
    }
    return this.drivers;
  }

  drawPaths(context) {
    const { run, state } = this, { poses, frames, owner } = run;
    context.lineWidth = Math.max(0.25, 1 / this.scale);
    for (let row = 0; row < owner.length; row++) {
      const own = state.child >= 0 && run.track(state.child, owner[row]) === row;
      if (state.child >= 0 ? !own : !this.weights[row]) continue;
      context.strokeStyle = this.color(row, owner[row]);
      context.globalAlpha = own ? 0.8 : 0.22;
      context.beginPath();
      for (let t = 0; t < frames; t++) context.lineTo(poses[(row * frames + t) * 3], poses[(row * frames + t) * 3 + 1]);
      context.stroke();
    }
    context.globalAlpha = 1;
  }

  drawGhosts(context, ink) {
    const { run, state } = this, pose = [0, 0, 0];
    for (let row = 0; row < run.owner.length; row++) {
      if (!this.weights[row]) continue;
      const vehicle = run.owner[row], share = this.weights[row] / Math.max(state.count, 1);
      poseAt(run.poses, run.frames, row, state.step, pose);
      context.fillStyle = this.color(row, vehicle);
      context.globalAlpha = Math.min(0.1 + ink * share, 0.9);
      this.body(context, pose, run.size(vehicle));
      context.fill();
    }
    context.globalAlpha = 1;
    for (let v = 0; state.child < 0 && v < run.vehicles; v++) { // where they begin
      context.strokeStyle = theme.ink;
      context.lineWidth = Math.max(0.1, 1 / this.scale);
      this.body(context, poseAt(run.poses, run.frames, run.track(0, v), 0, pose), run.size(v));
      context.globalAlpha = 0.55;
      context.stroke();
      context.globalAlpha = 1;
    }
  }

  // Outline of a body, pointed at the front.
  body(context, [x, y, heading], [long, wide], swell = 0) {
    const c = Math.cos(heading), s = Math.sin(heading), l = long / 2 + swell, w = wide / 2 + swell;
    context.beginPath();
    for (const [f, side] of [[0.72 * l, w], [l, 0.6 * w], [l, -0.6 * w], [0.72 * l, -w], [-l, -w], [-l, w]]) context.lineTo(x + f * c - side * s, y + f * s + side * c);
    context.closePath();
  }

  drawVehicle(context, vehicle, track) {
    const { run, state } = this, [long, wide] = run.size(vehicle), pose = poseAt(run.poses, run.frames, track, state.step, [0, 0, 0]);
    context.fillStyle = this.color(track, vehicle);
    context.strokeStyle = theme.ink;
    context.lineWidth = Math.max(0.12, 1.2 / this.scale);
    this.body(context, pose, [long, wide]);
    context.fill();
    context.stroke();
    const c = Math.cos(pose[2]), s = Math.sin(pose[2]), at = (f, side) => [pose[0] + f * c - side * s, pose[1] + f * s + side * c];
    context.fillStyle = "#0007"; // windscreen
    context.beginPath();
    for (const [f, side] of [[0.24, 0.4], [0.12, 0.36], [0.12, -0.36], [0.24, -0.4]]) context.lineTo(...at(f * long, side * wide));
    context.fill();
  }

  drawRecorded(context) {
    const { run, state } = this, frames = run.recordedFrames, step = Math.min(state.step, frames - 1);
    Object.assign(context, { strokeStyle: theme.recorded, lineWidth: Math.max(0.16, 1.3 / this.scale) });
    context.setLineDash([0.7, 0.5]);
    for (let v = 0; v < run.vehicles; v++) {
      const t = Math.ceil(step);
      if (t > 0 && !run.arrays.recorded_valid.values[v * (frames - 1) + t - 1]) continue;
      this.body(context, poseAt(run.recorded, frames, v, step, [0, 0, 0]), run.size(v));
      context.stroke();
    }
    context.setLineDash([]);
  }

  drawOthers(context) { // pedestrians and cyclists, as recorded
    const { others, others_present: present } = this.run.arrays;
    if (!others) return;
    const frames = others.shape[1], t = Math.min(Math.round(this.state.step), frames - 1);
    context.fillStyle = theme.likely;
    for (let o = 0; o < others.shape[0]; o++) {
      const i = o * frames + t;
      context.beginPath();
      if (present.values[i]) context.arc(others.values[2 * i] / 100, others.values[2 * i + 1] / 100, Math.max(0.4, 3 / this.scale), 0, 7);
      context.fill();
    }
  }

  drawHeat(context) {
    const radius = Math.max(2.2, 9 / this.scale), chosen = this.pairs.contacts.filter((contact) => this.state.mask[contact.child]);
    for (const { place: [x, y] } of chosen) {
      const glow = context.createRadialGradient(x, y, 0, x, y, radius);
      glow.addColorStop(0, theme.critical);
      glow.addColorStop(1, "transparent");
      Object.assign(context, { fillStyle: glow, globalAlpha: Math.min(0.85, 0.12 + 4 / chosen.length) });
      context.fillRect(x - radius, y - radius, 2 * radius, 2 * radius);
    }
    context.globalAlpha = 1;
  }

  // Where a vehicle is now: in the child, or in the middle of the selected ghosts.
  place(vehicle) {
    const { run, state } = this, pose = [0, 0, 0];
    if (state.child >= 0) return poseAt(run.poses, run.frames, run.track(state.child, vehicle), state.step, pose);
    const sum = [0, 0];
    let count = 0;
    for (let row = run.owner.indexOf(vehicle); run.owner[row] === vehicle; row++) { // tracks are ordered by vehicle
      if (!this.weights[row]) continue;
      poseAt(run.poses, run.frames, row, state.step, pose);
      sum[0] += this.weights[row] * pose[0];
      sum[1] += this.weights[row] * pose[1];
      count += this.weights[row];
    }
    return count ? [sum[0] / count, sum[1] / count, 0] : poseAt(run.poses, run.frames, run.track(0, vehicle), 0, pose);
  }

  drawRings(context) {
    const ringed = [...(this.state.pair || []), ...(this.first !== null ? [this.first] : [])];
    for (const vehicle of ringed) {
      const [x, y] = this.place(vehicle);
      Object.assign(context, { strokeStyle: theme.critical, lineWidth: 2.5 });
      context.beginPath();
      context.arc(...this.toScreen(x, y), Math.max(13, this.pairs.radius[vehicle] * this.scale * 1.25), 0, 7);
      context.stroke();
    }
  }

  // Ids that do not overprint: the pair's first, the others where there is room.
  drawIds(context) {
    const { run, state } = this, taken = [], pair = state.pair || [];
    Object.assign(context, { font: "600 12px system-ui", textAlign: "center", textBaseline: "middle", lineWidth: 3.5, strokeStyle: theme.halo, lineJoin: "round" });
    const order = [...pair, ...Array.from({ length: run.vehicles }, (_, v) => v).filter((v) => !pair.includes(v))];
    for (const vehicle of order) {
      const [x, y] = this.place(vehicle), [px, py] = this.toScreen(x, y), words = String(run.info.track_ids[vehicle]);
      const wide = context.measureText(words).width / 2 + 2, off = Math.max(12, this.pairs.radius[vehicle] * this.scale * 0.75 + 7);
      const spots = [[0, -off], [off, 0], [0, off], [-off, 0], [off, -off], [-off, off]].map(([dx, dy]) => [px + dx, py + dy]);
      const free = spots.find(([sx, sy]) => taken.every(([tx, ty, tw]) => Math.abs(sx - tx) > wide + tw || Math.abs(sy - ty) > 14));
      if (!free && !pair.includes(vehicle)) continue;
      const [sx, sy] = free || spots[0];
      taken.push([sx, sy, wide]);
      context.fillStyle = pair.includes(vehicle) || run.info.under_test.includes(run.info.track_ids[vehicle]) ? theme.critical : theme.ink;
      context.strokeText(words, sx, sy);
      context.fillText(words, sx, sy);
    }
    context.textBaseline = "alphabetic";
  }

  drawScale(context, height) {
    const metres = [5, 10, 20, 50, 100, 200].find((m) => m * this.scale > 50) || 500, x = this.canvas.clientWidth - 14 - metres * this.scale;
    Object.assign(context, { strokeStyle: theme.soft, fillStyle: theme.soft, lineWidth: 2, font: "11px system-ui", textAlign: "center" });
    context.beginPath();
    context.moveTo(x, height - 10);
    context.lineTo(x + metres * this.scale, height - 10);
    context.stroke();
    context.fillText(`${metres} m`, x + metres * this.scale / 2, height - 15);
  }

  vehicleAt(px, py) {
    let best = null, least = Infinity;
    for (let v = 0; v < this.run.vehicles; v++) {
      const [x, y] = this.place(v), [sx, sy] = this.toScreen(x, y), away = Math.hypot(sx - px, sy - py);
      if (away < least && away < Math.max(14, this.pairs.radius[v] * this.scale)) [best, least] = [v, away];
    }
    return best;
  }

  down(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
    this.moved = 0;
    this.canvas.classList.add("moving");
  }

  move(event) {
    const before = this.pointers.get(event.pointerId), here = [event.offsetX, event.offsetY];
    if (!before) return this.hover(event);
    const other = [...this.pointers].find(([id]) => id !== event.pointerId);
    if (other) { // two fingers
      const [, [x, y]] = other, far = (p) => Math.hypot(p[0] - x, p[1] - y);
      this.zoom(far(here) / Math.max(far(before), 1), x, y);
    } else {
      this.x -= (here[0] - before[0]) / this.scale;
      this.y += (here[1] - before[1]) / this.scale;
    }
    this.moved += Math.hypot(here[0] - before[0], here[1] - before[1]);
    this.pointers.set(event.pointerId, here);
    this.state.change({}, "view");
  }

  up(event) {
    if (this.pointers.delete(event.pointerId) && this.moved < 4) this.click(this.vehicleAt(event.offsetX, event.offsetY));
    this.canvas.classList.remove("moving");
  }

  click(vehicle) { // two vehicles one after the other make a pair
    const both = vehicle !== null && this.first !== null && vehicle !== this.first;
    const pair = both ? [this.first, vehicle].sort((a, b) => a - b) : vehicle === null ? null : this.state.pair;
    this.first = both ? null : vehicle;
    this.state.change({ pair });
  }

  hover(event) {
    const vehicle = this.vehicleAt(event.offsetX, event.offsetY), tip = byId("tip"), { run, state } = this;
    tip.hidden = vehicle === null;
    if (vehicle === null) return;
    const words = [`${run.info.track_ids[vehicle]} ${run.info.types[vehicle]}`];
    if (state.child >= 0) {
      const row = run.track(state.child, vehicle), t = Math.min(Math.floor(state.step), run.frames - 2), i = (row * run.frames + t) * 3;
      words.push(run.info.models[run.model(state.child, vehicle)], `${(10 * Math.hypot(run.poses[i + 3] - run.poses[i], run.poses[i + 4] - run.poses[i + 1])).toFixed(1)} m/s`);
    }
    tip.textContent = words.join(", ");
    tip.style.left = `${Math.min(event.offsetX + 12, this.canvas.clientWidth - 160)}px`;
    tip.style.top = `${event.offsetY + 14}px`;
  }

  // Keeps the pair in view, without haste.
  pursue() {
    const [a, b] = this.state.pair.map((vehicle) => this.place(vehicle)), wide = Math.hypot(a[0] - b[0], a[1] - b[1]) + 24;
    const scale = Math.min(this.canvas.clientWidth, this.canvas.clientHeight) / wide;
    const step = [(a[0] + b[0]) / 2 - this.x, (a[1] + b[1]) / 2 - this.y, Math.log(scale / this.scale)];
    this.x += 0.2 * step[0];
    this.y += 0.2 * step[1];
    this.scale *= Math.exp(0.2 * step[2]);
    return Math.hypot(step[0], step[1]) * this.scale > 1 || Math.abs(step[2]) > 0.01;
  }
}

// Lines of the road as paths in m.
function roadOf(run) {
  const { road_points: points, road_sizes: sizes, road_kinds: kinds, road_widths: widths } = run.arrays, unit = run.info.units.road;
  let i = 0;
  return Array.from(sizes.values, (size, line) => {
    const path = new Path2D();
    let x = 0, y = 0;
    for (let k = 0; k < size; k++, i++) {
      x += points.values[2 * i];
      y += points.values[2 * i + 1];
      path.lineTo(x * unit, y * unit);
    }
    return { kind: kinds.values[line], width: widths.values[line] * unit, path };
  });
}
