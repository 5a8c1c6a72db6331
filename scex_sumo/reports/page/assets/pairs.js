// Pairs of vehicles: the gap between their bodies over time, in all children.

const CORNERS = [[0.5, 0.5], [0.5, -0.5], [-0.5, -0.5], [-0.5, 0.5]];

// Points on the ground of points of a body, given as shares of its length and width.
function onBody([x, y, heading], [long, wide], points) {
  const c = Math.cos(heading), s = Math.sin(heading);
  return points.map(([f, l]) => [x + f * long * c - l * wide * s, y + f * long * s + l * wide * c]);
}

// Gap of two rectangles in m, 0 where they overlap; poses are [x, y, heading], sizes [length, width].
function bodyGap(poseA, sizeA, poseB, sizeB) {
  let gap = Infinity, isApart = false;
  for (const [pose, size, at, box] of [[poseA, sizeA, poseB, sizeB], [poseB, sizeB, poseA, sizeA]]) {
    const c = Math.cos(at[2]), s = Math.sin(at[2]);
    const seen = onBody(pose, size, CORNERS).map(([x, y]) => [(x - at[0]) * c + (y - at[1]) * s, (y - at[1]) * c - (x - at[0]) * s]);
    for (const point of seen) gap = Math.min(gap, Math.hypot(...point.map((d, k) => Math.max(Math.abs(d) - box[k] / 2, 0))));
    isApart ||= [0, 1].some((k) => [1, -1].some((side) => seen.every((point) => side * point[k] > box[k] / 2)));
  }
  return isApart ? gap : 0; // the nearest points of two apart have a corner among them
}

// Gap of a pair at each step, given the rows of both.
function courseOf({ frames, info }, poses, pair, rows) {
  const gap = (t) => bodyGap(...pair.flatMap((v, i) => [poseAt(poses, frames, rows[i], t), info.sizes[v]]));
  return Array.from({ length: frames }, (_, t) => gap(t));
}

// Courses of a pair's gap, one per different pair of tracks: [{course, children, picked}].
function coursesOf(run, pair, mask) {
  const found = new Map();
  mask.forEach((isPicked, c) => {
    const rows = pair.map((v) => run.track(c, v)), key = String(rows);
    if (!found.has(key)) found.set(key, { course: courseOf(run, run.poses, pair, rows), children: [], picked: 0 });
    found.get(key).children.push(c);
    found.get(key).picked += isPicked;
  });
  return [...found.values()];
}

function pairChart(run, state, canvas) {
  const last = run.frames - 1;
  let key, lines, recorded;

  // Draws the courses; returns the child's gap now, where there is one.
  return () => {
    const { pair, child, step } = state, pen = sharp(canvas), { paint, write, width } = pen;
    const wanted = `${pair} ${state.selection}`;
    if (key !== wanted) {
      key = wanted;
      lines = coursesOf(run, pair, state.mask);
      recorded = run.recorded ? courseOf(run, run.recorded, pair, pair) : [];
    }
    const top = Math.max(1, ...lines.map((line) => Math.min(...line.course) + 6)), base = bottomAxis(pen, run.info.ticks, (s) => s * 10 / last * width);
    const at = (gap, t) => [t / last * width, base - Math.min(gap / top, 1.2) * (base - 4)];
    for (const { course, picked } of lines) {
      if (picked) paint(course.map(at), { stroke: "drawn", alpha: Math.min(0.12 + 2 * picked / state.count, 0.6) });
    }
    paint(recorded.map(at).filter((_, t) => recorded[t] < 1e4), { stroke: "recorded", dash: [5, 3] });
    const own = lines.find((line) => line.children.includes(child));
    if (own) paint(own.course.map(at), { stroke: "picked", width: 2.6 });
    paint([[step / last * width, 0], [step / last * width, base]], { stroke: "ink" });
    write(`${top.toFixed(0)} m`, width - 2, 11, { align: "right" });
    return own ? own.course[Math.round(step)] : null;
  };
}
