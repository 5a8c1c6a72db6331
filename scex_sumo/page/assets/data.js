// Packed data: reads what packing.py wrote, and makes poses of second differences.

async function unpack(text) {
  const packed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  let start = 4 + new DataView(bytes.buffer).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(bytes.subarray(4, start)));
  const types = { i1: Int8Array, i2: Int16Array, i4: Int32Array, f4: Float32Array }, arrays = {};
  for (const { name, type, shape } of head.arrays) {
    const size = Number(type[1]), count = shape.reduce((product, length) => product * length, 1);
    const joined = new Uint8Array(count * size);
    for (let i = 0; i < joined.length; i++) joined[i] = bytes[start + (i % size) * count + Math.floor(i / size)];
    arrays[name] = { shape, values: new types[type](joined.buffer) };
    if (/i[24]/.test(type)) arrays[name].values.forEach((value, i, values) => { values[i] = value - 128; }); // as packing.py shifts them
    start += joined.length;
  }
  return { info: head.info, arrays };
}

const UNITS = [0.02, 0.02, 0.002, 0.02]; // of poses: m, m, rad, m/s, as in packing.py

// Poses (rows, 1 + steps, 4) of coded tracks after the start of each row's vehicle: places off those that the
// mean velocity of a step leads to, and second differences of heading and speed.
function posesOf({ shape: [, rows, steps], values }, start, ownerOf) {
  const poses = new Float64Array(rows * (steps + 1) * 4);
  for (let row = 0; row < rows; row++) {
    const now = [...start.values.subarray(ownerOf(row) * 4, ownerOf(row) * 4 + 4)], change = [0, 0], place = [0, 1].map((k) => now[k] * UNITS[k]);
    let velocity;
    for (let t = 0, at = row * (steps + 1) * 4; t <= steps; t++, at += 4) {
      const code = (k) => values[(k * rows + row) * steps + t - 1], before = velocity;
      for (const k of [2, 3]) if (t) now[k] += change[k - 2] += code(k);
      const heading = now[2] * UNITS[2], speed = now[3] * UNITS[3];
      velocity = [speed * Math.cos(heading), speed * Math.sin(heading)];
      for (const k of [0, 1]) if (t) place[k] += (before[k] + velocity[k]) / 20 + code(k) * UNITS[k];
      poses.set([...place, heading, speed], at);
    }
  }
  return poses;
}

// The run as the other parts ask for it: futures of the stress test, then human-like ones. Of those in
// `packed` the page has tracks, rows of `poses`.
function runOf({ info, arrays }) {
  const { start, motion, owner, which, levels, values, recorded, events } = arrays, vehicles = levels.shape[1];
  const total = info.futures + info.human, place = new Map(info.packed.map((future, i) => [future, i]));
  const first = Array.from({ length: vehicles }, (_, v) => owner.values.indexOf(v));
  const nameOf = (future) => future < info.futures ? `future ${future}` : `human-like future ${future - info.futures}`;
  return {
    info, arrays, vehicles, total, futures: info.futures, owner: owner.values,
    frames: motion.shape[2] + 1,
    poses: posesOf(motion, start, (row) => owner.values[row]),
    recorded: recorded && posesOf(recorded, start, (row) => row),
    columns: info.metrics.map((_, m) => values.values.subarray(m * total, (m + 1) * total)),
    radius: (vehicle) => Math.hypot(...info.sizes[vehicle]) / 2,
    id: (vehicle) => info.track_ids[vehicle],
    isPacked: (future) => place.has(future),
    track: (future, vehicle) => first[vehicle] + which.values[place.get(future) * vehicles + vehicle],
    model: (future, vehicle) => levels.values[future * vehicles + vehicle],
    events: (pair, future) => events.values[pair * total + future], // of info.bits
    isHuman: (future) => future >= info.futures,
    number: (future) => future < info.futures ? future : future - info.futures,
    textOf: (future) => future < 0 ? "" : future < info.futures ? `${future}` : `h${future - info.futures}`,
    futureOf(text) { // of 12, or h12 of the human-like ones; -1 without one
      const [, isHuman, number] = /^(h?)(\d+)$/.exec(text.trim()) || [];
      return number === undefined ? -1 : isHuman ? Math.min(info.futures + Number(number), total - 1) : Math.min(number, info.futures - 1);
    },
    nameOf, setOf: (future) => future < 0 ? "all futures of the stress test" : (future < info.futures ? "stress test, " : "") + nameOf(future),
  };
}

// Pose of a row at a step that may lie between two.
function poseAt(poses, frames, row, step) {
  const low = Math.min(Math.floor(step), frames - 1), high = Math.min(low + 1, frames - 1), part = step - low;
  const a = (row * frames + low) * 4, b = (row * frames + high) * 4;
  return [0, 1, 2, 3].map((k) => poses[a + k] + part * (poses[b + k] - poses[a + k]));
}

// Share with the 95 % score interval (Wilson 1927) of as many independent futures.
function interval(value, number) {
  const z2 = 1.959964 ** 2, middle = (value * number + z2 / 2) / (number + z2);
  const half = Math.sqrt(z2 * (value * (1 - value) * number + z2 / 4)) / (number + z2);
  return { value, low: value > 0 ? middle - half : 0, high: value < 1 ? middle + half : 1 };
}

const clamp = (value, low, high) => Math.min(Math.max(value, low), high);
const distance = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]);
const sum = (values) => values.reduce((total, value) => total + value, 0);
const isMissing = (value) => value === null || value === undefined || Number.isNaN(value);
const percent = (share) => isMissing(share) ? "–" : `${(100 * share).toFixed(share > 0 && share < 0.0995 ? 1 : 0)} %`;
const range = ({ low, high }) => { // as Interval.range of density.py
  const digits = high - low < 0.02 || high < 0.1 ? 1 : 0;
  return `${(100 * low).toFixed(digits)}–${(100 * high).toFixed(digits)} %`;
};
const short = (value, digits = 2) => isMissing(value) ? "–" : Number.isFinite(value) ? value.toFixed(digits) : "∞";
function oneDigit(number) {
  const size = 10 ** Math.floor(Math.log10(Math.max(number, 1)));
  return String(Math.round(number / size) * size).replace(/\B(?=(\d{3})+$)/g, " ");
}
const onceIn = (share) => share > 0 ? share < 0.5 ? `once in ${oneDigit(1 / share)}` : `in ${(100 * share).toFixed(0)} %` : "never";
const seconds = (step) => `${(step / 10).toFixed(1)} s`;
