// Acting pair: the motion that a point of the map of critical responses leads to, playing beside the map.

const FINER = 5; // parts of a step in which a braking vehicle is moved
const SEEN = 25; // steps before the contact that are in the picture, or first ones without any
const AROUND_M = 8;

// Value of equal steps at a share of them; of rows, each column.
function between(values, share) {
  const at = clamp(share, 0, 1) * (values.length - 1), low = Math.min(Math.floor(at), values.length - 2), [a, b] = [values[low], values[low + 1]];
  const mix = (x, y) => x + (at - low) * (y - x);
  return Array.isArray(a) ? a.map((x, k) => mix(x, b[k])) : mix(a, b);
}

// Way of the responder at each step, m: as expected until it brakes, as `responded` of critical.py.
function respondedWay({ way }, begin, { step_s: step, last_s: last, jerk_mps3: jerk, decelerations: [, hardest] }) {
  const expected = (time) => between(way, time / last), fine = step / FINER, found = [];
  const speedOf = (time) => (expected(Math.max(time, step / 2) + step / 2) - expected(Math.max(time, step / 2) - step / 2)) / step;
  let s, v, slowing;
  for (let k = 0; k <= Math.round(last / fine); k++) {
    const time = k * fine, usual = expected(time);
    if (time <= begin) [s, v, slowing] = [usual, speedOf(time), clamp((speedOf(time - step) - speedOf(time)) / step, 0, hardest)];
    else {
      slowing = Math.min(slowing + jerk * fine, hardest);
      v = Math.max(v - slowing * fine, 0);
      s = Math.min(s + v * fine, usual);
    }
    if (k % FINER === 0) found.push(s);
  }
  return found;
}

// Poses [x, y, heading] of initiator and responder at each step until they touch; `speed` is that of the impact, null without.
function actedBy(pair, level, response, people, [one, other]) {
  const begin = pair.onset[level] === null ? Infinity : pair.onset[level] + response, ways = respondedWay(pair, begin, people);
  const narrow = [other[0], other[1] - people.graze_m], ends = ways.length - 1;
  const poseOf = (way, k) => [between(pair.acts[level], k / ends), between(pair.line, way / pair.reach)], poses = ways.map((way, k) => poseOf(way, k).map((pose) => pose.map((value) => value / 100)));
  const contact = poses.findIndex(([a, b]) => bodyGap(a, one, b, narrow) === 0), [before, at] = [poses[Math.max(contact - 1, 0)], poses[Math.max(contact, 0)]];
  const [dx, dy] = [0, 1].map((k) => at[0][k] - before[0][k] - at[1][k] + before[1][k]);
  return { poses: contact < 0 ? poses : poses.slice(0, contact + 1), first: contact < 0 ? 0 : Math.max(contact - SEEN, 0), speed: contact < 0 ? null : Math.hypot(dx, dy) / people.step_s };
}

// The pair on its road, and the others as recorded. Returns how another motion is taken.
function actingStage(run, road, canvas) {
  const { track_ids: ids, sizes } = run.info, ground = make("canvas");
  let both, acted, key, view;

  function look({ width, height, ratio }) { // the ways in the middle; the road is drawn once
    const now = String([both, width, height, inked("map"), acted.poses.length, acted.poses.at(-1)]);
    if (now === key) return;
    key = now;
    const seen = acted.poses.slice(acted.first, acted.first + SEEN + 1).flat(), ends = [0, 1].map((k) => seen.map((pose) => pose[k]));
    const [[left, right], [low, high]] = ends.map((values) => [Math.min(...values) - AROUND_M, Math.max(...values) + AROUND_M]);
    const scale = Math.min(width / (right - left), height / (high - low)), k = scale * ratio;
    view = [k, 0, 0, -k, ratio * width / 2 - (left + right) / 2 * k, ratio * height / 2 + (low + high) / 2 * k];
    const pen = sharp(ground, { clientWidth: width, clientHeight: height });
    pen.paint([[0, 0], [width, 0], [width, height], [0, height]], { fill: "map" });
    pen.context.setTransform(...view);
    drawRoad(pen, road, scale);
  }

  function show(step) {
    const pen = sharp(canvas), { context, paint, write, width, height, ratio } = pen, { poses, speed } = acted, last = poses.length - 1, isHit = speed !== null && step >= last;
    if (!width) return;
    look(pen);
    context.drawImage(ground, 0, 0, width, height);
    context.setTransform(...view);
    for (const v of run.recorded ? ids.keys() : []) {
      if (!both.includes(v)) paint(onBody(poseAt(run.recorded, run.frames, v, Math.min(step, run.frames - 1)), sizes[v], OUTLINE), { fill: "soft", alpha: 0.45 });
    }
    const at = Math.min(Math.floor(step), last);
    ["likely", "drawn"].forEach((ink, k) => {
      paint(poses.map((pose) => pose[k].slice(0, 2)), { stroke: ink, width: 0.25, alpha: 0.6 });
      paint(onBody(poses[at][k], sizes[both[k]], OUTLINE), { fill: isHit ? "critical" : ink });
    });
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    both.forEach((v, k) => {
      const [x, y] = poses[at][k];
      write(String(run.id(v)), (view[0] * x + view[4]) / ratio, (view[3] * y + view[5]) / ratio - 12, { fill: "ink", font: "600 12px system-ui", halo: "halo" });
    });
    write(seconds(at), width - 8, height - 8, { align: "right", fill: "ink", halo: "halo" });
  }

  const rest = () => Math.min(acted.first + SEEN, acted.poses.length - 1);
  const restart = makeLoop(canvas, canvas, { first: () => acted.first, rest, last: () => rest() + HOLD, show });
  return (vehicles, motion) => {
    [both, acted] = [vehicles, motion];
    restart();
  };
}
