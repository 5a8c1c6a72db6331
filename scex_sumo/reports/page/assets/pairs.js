// Pairs of vehicles: the gap between their bodies over time, in all children.

const CORNERS = [[0.5, 0.5], [0.5, -0.5], [-0.5, -0.5], [-0.5, 0.5]];

// Points on the ground of points of a body, given as shares of its length and width.
function onBody([x, y, heading], [long, wide], points) {
  const c = Math.cos(heading), s = Math.sin(heading);
  return points.map(([f, l]) => [x + f * long * c - l * wide * s, y + f * long * s + l * wide * c]);
}

// Gap of two rectangles in m, 0 where they overlap; poses are [x, y, heading], sizes [length, width].
function bodyGap(poseA, sizeA, poseB, sizeB) {
  let gap = Infinity, apart = false;
  for (const [pose, size, at, box] of [[poseA, sizeA, poseB, sizeB], [poseB, sizeB, poseA, sizeA]]) {
    const c = Math.cos(at[2]), s = Math.sin(at[2]);
    const seen = onBody(pose, size, CORNERS).map(([x, y]) => [(x - at[0]) * c + (y - at[1]) * s, (y - at[1]) * c - (x - at[0]) * s]);
    for (const [x, y] of seen) gap = Math.min(gap, Math.hypot(...[Math.abs(x) - box[0] / 2, Math.abs(y) - box[1] / 2].map((d) => Math.max(d, 0))));
    apart ||= [0, 1].some((k) => seen.every((point) => point[k] > box[k] / 2) || seen.every((point) => point[k] < -box[k] / 2));
  }
  return apart ? gap : 0; // the nearest points of two apart have a corner among them
}

// Courses of a pair's gap, one per different pair of tracks: [{course, children, picked}].
function coursesOf(run, [a, b], mask) {
  const found = new Map();
  for (let c = 0; c < run.children; c++) {
    const rows = [run.track(c, a), run.track(c, b)], key = String(rows);
    if (!found.has(key)) found.set(key, { rows, children: [], picked: 0 });
    found.get(key).children.push(c);
    found.get(key).picked += mask[c];
  }
  for (const entry of found.values()) entry.course = courseOf(run, run.poses, run.frames, [a, b], entry.rows);
  return [...found.values()];
}

function courseOf(run, poses, frames, [a, b], [rowA, rowB]) {
  const gap = (t) => bodyGap(poseAt(poses, frames, rowA, t), run.size(a), poseAt(poses, frames, rowB, t), run.size(b));
  return Array.from({ length: frames }, (_, t) => gap(t));
}

const wasThere = (run, v, t) => t === 0 || run.arrays.recorded_valid.values[v * (run.recordedFrames - 1) + t - 1];

class PairChart {
  constructor(run, state, canvas) {
    Object.assign(this, { run, state, canvas, key: null });
    canvas.onpointerdown = canvas.onpointermove = (event) => {
      if (!event.buttons) return;
      canvas.setPointerCapture(event.pointerId);
      state.seek(event.offsetX / canvas.clientWidth * (run.frames - 1));
    };
  }

  // Draws the courses; returns the child's gap now, where there is one.
  draw() {
    const { run, state } = this, { pair, mask, child, step } = state, last = run.frames - 1;
    const { context, width, height } = sharp(this.canvas);
    if (!pair || !width) return null;
    const key = `${pair} ${state.selection}`;
    if (key !== this.key) {
      this.key = key;
      this.lines = coursesOf(run, pair, mask);
      this.recorded = run.recorded ? courseOf(run, run.recorded, run.recordedFrames, pair, pair) : [];
    }
    const top = Math.max(1, ...this.lines.map((line) => Math.min(...line.course) + 6));
    const base = bottomAxis(context, width, height, 0, last / 10);
    const at = (gap, t) => [t / last * width, base - Math.min(gap / top, 1.2) * (base - 4)];
    for (const { course, picked } of this.lines) {
      if (picked) paint(context, course.map(at), { stroke: theme.drawn, alpha: Math.min(0.12 + 2 * picked / state.count, 0.6) });
    }
    const there = this.recorded.map(at).filter((_, t) => pair.every((v) => wasThere(run, v, t)));
    paint(context, there, { stroke: theme.recorded, dash: [5, 3] });
    const own = this.lines.find((line) => line.children.includes(child));
    if (own) paint(context, own.course.map(at), { stroke: theme.picked, width: 2.6 });
    paint(context, [[step / last * width, 0], [step / last * width, base]], { stroke: theme.ink });
    write(context, `${top.toFixed(0)} m`, width - 2, 11, { align: "right" });
    write(context, "s", width - 2, base - 4, { align: "right" });
    return own ? own.course[Math.round(step)] : null;
  }
}
