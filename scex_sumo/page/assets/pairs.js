// Pairs of vehicles: speed, acceleration, body gap and TTC over time, in all futures.

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

// Time in s until two rectangles overlap if both keep speed and heading; Infinity if they never do.
function timeToCollision(poseA, sizeA, poseB, sizeB) {
  const velocity = ([, , heading, speed]) => [speed * Math.cos(heading), speed * Math.sin(heading)], [ownA, ownB] = [poseA, poseB].map(velocity);
  let enter = 0, leave = Infinity;
  for (const turn of [poseA[2], poseA[2] + Math.PI / 2, poseB[2], poseB[2] + Math.PI / 2]) { // axes that may separate them
    const along = ([x, y]) => x * Math.cos(turn) + y * Math.sin(turn), ahead = along(poseB) - along(poseA), closing = along(ownA) - along(ownB);
    const half = ([, , heading], [long, wide]) => (long * Math.abs(Math.cos(heading - turn)) + wide * Math.abs(Math.sin(heading - turn))) / 2;
    const reach = half(poseA, sizeA) + half(poseB, sizeB);
    if (Math.abs(closing) < 1e-9 && Math.abs(ahead) >= reach) return Infinity;
    if (Math.abs(closing) < 1e-9) continue;
    const times = [(ahead - reach) / closing, (ahead + reach) / closing];
    enter = Math.max(enter, Math.min(...times));
    leave = Math.min(leave, Math.max(...times));
  }
  return enter < leave ? enter : Infinity;
}

// Speed and acceleration of rows at each step, and their poses; NaN where nothing was recorded.
function motionOf({ frames }, poses, rows) {
  const paths = rows.map((row) => Array.from({ length: frames }, (_, t) => poseAt(poses, frames, row, t)).map((pose) => pose[0] > 1e5 ? pose.map(() => NaN) : pose));
  const speed = paths.map((path) => path.map((pose) => pose[3])), last = frames - 1;
  const slope = (values) => values.map((_, t) => {
    const [before, after] = [Math.max(t - 1, 0), Math.min(t + 1, last)];
    return 10 * (values[after] - values[before]) / (after - before);
  });
  return { paths, speed, acceleration: speed.map(slope) };
}

// Curves of a pair given the rows of both: one or two lines by strip.
function courseOf(run, poses, pair, rows) {
  const { paths: [a, b], speed, acceleration } = motionOf(run, poses, rows), [sizeA, sizeB] = pair.map((v) => run.info.sizes[v]);
  const both = (how) => [a.map((pose, t) => Number.isNaN(pose[0] + b[t][0]) ? NaN : how(pose, sizeA, b[t], sizeB))];
  return { speed, acceleration, gap: both(bodyGap), ttc: both(timeToCollision) };
}

// Courses of a pair, one per different pair of tracks: [{course, futures, picked}].
function coursesOf(run, pair, mask) {
  const found = new Map();
  for (const future of run.info.packed) {
    const rows = pair.map((v) => run.track(future, v)), key = String(rows);
    if (!found.has(key)) found.set(key, { course: courseOf(run, run.poses, pair, rows), futures: [], picked: 0, isHuman: run.isHuman(future) });
    found.get(key).futures.push(future);
    found.get(key).picked += mask[future];
  }
  return [...found.values()];
}

const STRIPS = { // what the strips show; the top of an axis is at most `most`
  speed: { title: "speed", unit: "m/s" }, acceleration: { title: "acceleration", unit: "m/s²" }, gap: { title: "body gap", unit: "m", most: 20 },
  ttc: { title: "TTC, speed and heading kept", unit: "s", most: 6 },
};

function pairStrips(run, state, host) {
  const last = run.frames - 1, dashes = [[], [5, 3]];
  let key, lines, recorded;
  const strips = Object.entries(STRIPS).map(([name, words]) => {
    const canvas = make("canvas", { ariaLabel: `${words.title} over time` }), said = make("span"), cursor = make("i"), box = make("div.box", {}, canvas, cursor);
    const seek = ({ offsetX, buttons }) => { if (buttons) state.seek(Math.round(offsetX / canvas.clientWidth * last)); };
    Object.assign(canvas, { onpointerdown: seek, onpointermove: seek });
    host.append(make("div.strip", {}, make("header", {}, make("span", `${words.title} [${words.unit}]`), said), box));
    return { name, canvas, said, cursor, limit: run.info.limits[name], ...words };
  });

  function draw({ name, canvas, most = Infinity, limit }, own) {
    const pen = sharp(canvas), { paint, write, width } = pen, here = (course) => course[name].flat().filter((value) => Number.isFinite(value));
    if (!width) return;
    const chosen = lines.filter(({ picked }) => picked), courses = [...chosen, ...(own ? [own] : [])].map(({ course }) => course);
    const values = [0, limit ?? 1, ...[...courses, ...(recorded ? [recorded] : [])].flatMap(here)];
    const top = Math.min(1.1 * Math.max(...values), most), low = Math.min(...values), low10 = low < 0 ? 1.1 * low : 0;
    const base = bottomAxis(pen, run.info.ticks, (s) => s * 10 / last * width);
    const at = (value, t) => [t / last * width, value <= 1.3 * top ? base - (value - low10) / (top - low10) * (base - 4) : NaN];
    const curve = (course, style) => course[name].forEach((line, i) => paint(line.map(at), { dash: dashes[i], ...style }));
    for (const { course, picked, isHuman } of chosen) curve(course, { stroke: isHuman ? "likely" : "drawn", width: 1, alpha: Math.min(0.1 + 2 * picked / state.count, 0.5) });
    if (low < 0) paint([at(0, 0), at(0, last)], { stroke: "line", width: 1 });
    if (limit) paint([at(limit, 0), at(limit, last)], { stroke: "critical", width: 1 });
    if (recorded) curve(recorded, { stroke: "recorded", width: 1 });
    if (own) curve(own.course, { stroke: "picked", width: 2.4 });
    write(short(top, top < 5 ? 1 : 0), width - 2, 11, { align: "right", halo: "card" });
    if (low < 0) write(short(low10, 1), width - 2, base - 3, { align: "right", halo: "card" });
  }

  // All curves each half second: of the shown future, else from the least to the largest of all.
  function list(own) {
    const courses = own ? [own.course] : lines.filter(({ picked }) => picked).map(({ course }) => course), names = state.pair.map(run.id);
    const heads = strips.flatMap(({ name, title, unit }) => (dashes.length === courses[0]?.[name].length ? names : [""]).map((who) => `${title} ${who} [${unit}]`));
    const rows = Array.from({ length: Math.floor(last / 5) + 1 }, (_, k) => [seconds(5 * k), ...strips.flatMap(({ name }) => (courses[0]?.[name] ?? []).map((_line, i) => {
      const values = courses.map((course) => course[name][i][5 * k]), ends = [Math.min(...values), Math.max(...values)].map((value) => short(value, 1));
      return ends[0] === ends[1] ? ends[0] : `${ends[0]} to ${ends[1]}`;
    }))]);
    tabulate(host.lastElementChild.querySelector("canvas"), `${names.join(" and ")} over time`, ["after", ...heads], rows);
  }

  // Draws the curves if they changed, and moves the cursor.
  return (isNew) => {
    const { pair, future, step } = state, isRecorded = run.recorded && byId("show-recorded").checked, wanted = `${pair} ${state.selection} ${isRecorded}`, t = Math.round(step);
    const isOther = key !== wanted;
    if (isOther) {
      key = wanted;
      lines = coursesOf(run, pair, state.mask);
      recorded = isRecorded ? courseOf(run, run.recorded, pair, pair) : null;
    }
    const own = lines.find((line) => line.futures.includes(future));
    if (isNew || isOther) list(own);
    for (const strip of strips) {
      if (isNew || isOther) draw(strip, own);
      strip.cursor.style.left = `${100 * step / last}%`;
      tell(strip.said, own ? own.course[strip.name].map((line) => short(line[t], 1)).join(" / ") : "");
    }
  };
}
