// Pairs of vehicles: the gap between their bodies, contacts, and its course over time.

// Gap of two rectangles in m, 0 where they overlap; poses are [x, y, heading], sizes [length, width].
function bodyGap(a, sizeA, b, sizeB) {
  const corners = (pose, [long, wide]) => {
    const c = Math.cos(pose[2]), s = Math.sin(pose[2]);
    return [[1, 1], [1, -1], [-1, -1], [-1, 1]].map(([f, l]) => [pose[0] + (f * long * c - l * wide * s) / 2, pose[1] + (f * long * s + l * wide * c) / 2]);
  };
  const p = corners(a, sizeA), q = corners(b, sizeB);
  if (!apart(p, q) && !apart(q, p)) return 0;
  let best = Infinity;
  for (const [points, box] of [[p, q], [q, p]]) {
    for (const point of points) for (let i = 0; i < 4; i++) best = Math.min(best, toSegment(point, box[i], box[(i + 1) % 4]));
  }
  return best;
}

function apart(p, q) { // along a side of p
  return [0, 1].some((i) => {
    const axis = [p[i + 1][0] - p[i][0], p[i + 1][1] - p[i][1]];
    const along = (points) => points.map((point) => point[0] * axis[0] + point[1] * axis[1]);
    const one = along(p), two = along(q);
    return Math.max(...one) < Math.min(...two) || Math.max(...two) < Math.min(...one);
  });
}

function toSegment(point, a, b) {
  const dx = b[0] - a[0], dy = b[1] - a[1];
  const part = Math.min(Math.max(((point[0] - a[0]) * dx + (point[1] - a[1]) * dy) / (dx * dx + dy * dy || 1), 0), 1);
  return Math.hypot(point[0] - a[0] - part * dx, point[1] - a[1] - part * dy);
}

const NEAR_M = 4; // pairs that never come nearer are no encounters

class Pairs {
  constructor(run) {
    Object.assign(this, { run, memory: new Map(), bounds: new Float64Array(run.frames) });
    this.radius = Array.from({ length: run.vehicles }, (_, v) => Math.hypot(...run.size(v)) / 2);
    this.boxes = this.vehicleBoxes();
    this.touched = new Int16Array(run.children).fill(-1); // step of a child's first contact
    this.contacts = [];
  }

  vehicleBoxes() {
    const { poses, frames, owner, vehicles } = this.run;
    const boxes = Array.from({ length: vehicles }, () => [Infinity, -Infinity, Infinity, -Infinity]);
    for (let i = 0; i < poses.length; i += 3) {
      const box = boxes[owner[Math.floor(i / 3 / frames)]];
      box[0] = Math.min(box[0], poses[i]); box[1] = Math.max(box[1], poses[i]);
      box[2] = Math.min(box[2], poses[i + 1]); box[3] = Math.max(box[3], poses[i + 1]);
    }
    return boxes;
  }

  near(a, b) {
    const [p, q] = [this.boxes[a], this.boxes[b]], reach = NEAR_M + this.radius[a] + this.radius[b];
    return p[0] - reach < q[1] && q[0] - reach < p[1] && p[2] - reach < q[3] && q[2] - reach < p[3];
  }

  gap(poses, frames, a, rowA, b, rowB, step) {
    const one = poseAt(poses, frames, rowA, step, [0, 0, 0]), two = poseAt(poses, frames, rowB, step, [0, 0, 0]);
    return bodyGap(one, this.run.size(a), two, this.run.size(b));
  }

  // Least gap of two tracks, its step, and the step of the first contact or -1; the same tracks are asked once.
  least(a, rowA, b, rowB) {
    const key = rowA * this.run.owner.length + rowB;
    if (this.memory.has(key)) return this.memory.get(key);
    const { poses, frames } = this.run, reach = this.radius[a] + this.radius[b], bounds = this.bounds;
    let nearest = 0;
    for (let t = 0, i = rowA * frames * 3, j = rowB * frames * 3; t < frames; t++, i += 3, j += 3) {
      bounds[t] = Math.hypot(poses[i] - poses[j], poses[i + 1] - poses[j + 1]) - reach;
      if (bounds[t] < bounds[nearest]) nearest = t;
    }
    // The step at which the middles are nearest first: few others can then still be nearer.
    const found = { gap: this.gap(poses, frames, a, rowA, b, rowB, nearest), step: nearest, contact: -1 };
    for (let t = 0; t < frames; t++) {
      if (bounds[t] > found.gap || (bounds[t] === found.gap && t > found.step)) continue;
      const gap = this.gap(poses, frames, a, rowA, b, rowB, t);
      if (gap < found.gap || (gap === found.gap && t < found.step)) Object.assign(found, { gap, step: t });
      if (gap === 0) break;
    }
    if (found.gap === 0) found.contact = found.step;
    this.memory.set(key, found);
    return found;
  }

  // All encounters, the gravest first; numbers of the run's own tables take the place of those seen here.
  find() {
    const { vehicles } = this.run, rows = [];
    if (this.run.arrays.collision_rows) this.readContacts();
    for (let a = 0; a < vehicles; a++) {
      for (let b = a + 1; b < vehicles; b++) if (this.near(a, b)) rows.push(this.encounter(a, b));
    }
    const index = new Map(this.run.info.track_ids.map((id, v) => [id, v]));
    const key = (a, b) => Math.min(a, b) * vehicles + Math.max(a, b);
    const known = new Map(); // the gravest row of each pair
    for (const row of this.run.info.encounters || []) {
      const at = key(index.get(row.track_id), index.get(row.other_id)), there = known.get(at);
      if (!there || row.p_collision > there.p_collision) known.set(at, row);
    }
    const kept = rows.filter((row) => row.least < NEAR_M || known.has(key(row.a, row.b)));
    for (const row of kept) {
      const said = known.get(key(row.a, row.b));
      if (said) Object.assign(row, { said, p: { value: said.p_collision, low: said.low, high: said.high } });
    }
    return kept.sort((x, y) => y.p.value - x.p.value || x.least - y.least);
  }

  encounter(a, b) {
    const { run } = this, gaps = [], children = [], soonest = { child: 0, step: 0, gap: Infinity };
    const standing = this.least(a, run.track(0, a), b, run.track(0, b)).contact === 0; // touch at the moment itself
    for (let c = 0; c < run.children; c++) {
      const found = this.least(a, run.track(c, a), b, run.track(c, b));
      gaps.push(found.gap);
      const worse = found.gap < soonest.gap || (found.gap === 0 && soonest.gap === 0 && found.step < soonest.step);
      if (worse) Object.assign(soonest, { child: c, step: found.step, gap: found.gap });
      if (found.contact < 0 || standing || run.arrays.collision_rows) continue;
      children.push(c);
      this.contact(c, found.contact, a, b);
    }
    if (run.arrays.collision_rows) {
      const own = this.contacts.filter((one) => one.a === a && one.b === b);
      children.push(...new Set(own.map((one) => one.child)));
    }
    const sorted = Float32Array.from(gaps).sort();
    return { a, b, gaps, children, standing, p: wilson(children.length, run.children), least: sorted[0], median: quantile(sorted, 0.5),
      recorded: this.recordedGap(a, b), child: soonest.child, step: soonest.step };
  }

  contact(child, step, a, b, place) {
    if (this.touched[child] < 0 || step < this.touched[child]) this.touched[child] = step;
    if (!place) {
      const { poses, frames } = this.run, i = (this.run.track(child, a) * frames + step) * 3, j = (this.run.track(child, b) * frames + step) * 3;
      place = [(poses[i] + poses[j]) / 2, (poses[i + 1] + poses[j + 1]) / 2];
    }
    this.contacts.push({ child, step, a, b, place });
  }

  readContacts() {
    const { collision_rows: rows, collision_places: places } = this.run.arrays;
    for (let i = 0; i < rows.shape[0]; i++) {
      const [child, step, a, b] = rows.values.subarray(4 * i, 4 * i + 4);
      if (a >= 0 && b >= 0) this.contact(child, step, Math.min(a, b), Math.max(a, b), places && [places.values[2 * i], places.values[2 * i + 1]]);
    }
  }

  recordedGap(a, b) {
    const gaps = this.recordedCourse(a, b).filter((gap) => gap !== null);
    return gaps.length ? Math.min(...gaps) : null;
  }

  recordedCourse(a, b) {
    const { recorded, recordedFrames: frames, arrays } = this.run;
    if (!recorded) return [];
    const there = (v, t) => t === 0 || arrays.recorded_valid.values[v * (frames - 1) + t - 1];
    return Array.from({ length: frames }, (_, t) => there(a, t) && there(b, t) ? this.gap(recorded, frames, a, a, b, b, t) : null);
  }

  // Courses of the gap, one per different pair of tracks of the selected children: [{course, children}].
  courses(a, b, mask) {
    const { run } = this, found = new Map();
    for (let c = 0; c < run.children; c++) {
      const key = `${run.track(c, a)},${run.track(c, b)}`;
      if (!found.has(key)) found.set(key, { children: [], picked: 0, rows: [run.track(c, a), run.track(c, b)] });
      found.get(key).children.push(c);
      found.get(key).picked += mask[c];
    }
    return [...found.values()].map((entry) => ({ ...entry,
      course: Array.from({ length: run.frames }, (_, t) => this.gap(run.poses, run.frames, a, entry.rows[0], b, entry.rows[1], t)) }));
  }
}

class PairChart {
  constructor(run, state, pairs, canvas) {
    Object.assign(this, { run, state, pairs, canvas, key: null });
    const seek = (event) => { if (event.buttons) state.change({ step: Math.min(Math.max(event.offsetX / canvas.clientWidth, 0), 1) * (run.frames - 1), playing: false }); };
    canvas.onpointerdown = (event) => { canvas.setPointerCapture(event.pointerId); seek(event); };
    canvas.onpointermove = seek;
  }

  draw() {
    const { pair, mask, child, step } = this.state, { context, width, height } = sharp(this.canvas);
    if (!pair || !width) return;
    const key = `${pair} ${[...this.state.filters.keys()]} ${this.state.count}`;
    if (key !== this.key) Object.assign(this, { key, lines: this.pairs.courses(...pair, mask), recorded: this.pairs.recordedCourse(...pair) });
    const last = this.run.frames - 1, seconds = last / 10;
    const top = Math.max(1, ...this.lines.map((line) => Math.min(...line.course) + 6));
    const base = bottomAxis(context, width, height, 0, seconds, (s) => s / seconds * width);
    const trace = (course, color, alpha, wide, dash = []) => {
      Object.assign(context, { strokeStyle: color, globalAlpha: alpha, lineWidth: wide });
      context.setLineDash(dash);
      context.beginPath();
      course.forEach((gap, t) => { if (gap !== null) context.lineTo(t / last * width, base - Math.min(gap / top, 1.2) * (base - 4)); });
      context.stroke();
      Object.assign(context, { globalAlpha: 1 });
      context.setLineDash([]);
    };
    for (const line of this.lines) if (line.picked) trace(line.course, theme.drawn, Math.min(0.12 + 2 * line.picked / this.state.count, 0.6), 1.2);
    if (this.recorded.length) trace(this.recorded, theme.recorded, 1, 1.4, [5, 3]);
    const own = child >= 0 && this.lines.find((line) => line.children.includes(child));
    if (own) trace(own.course, theme.picked, 1, 2.6);
    context.fillStyle = theme.ink;
    context.fillRect(step / last * width - 0.75, 0, 1.5, base);
    Object.assign(context, { fillStyle: theme.soft, textAlign: "right" });
    context.fillText(`${top.toFixed(0)} m`, width - 2, 11);
    context.fillText("s", width - 2, base - 4);
    return own && own.course[Math.round(step)];
  }
}
