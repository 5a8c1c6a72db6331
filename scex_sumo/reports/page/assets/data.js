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
    start += joined.length;
  }
  return { info: head.info, arrays };
}

const UNITS = [0.01, 0.01, 0.001, 0.02]; // of poses: m, m, rad, m/s, as in scene.py

// Poses (rows, 1 + steps, 4) of second differences after the start of each row's vehicle.
function posesOf({ shape: [rows, steps], values }, start, ownerOf) {
  const poses = new Float64Array(rows * (steps + 1) * 4);
  for (let row = 0; row < rows; row++) {
    for (let k = 0; k < 4; k++) {
      let change = 0, sum = start.values[ownerOf(row) * 4 + k];
      for (let t = 0; t <= steps; t++) {
        poses[(row * (steps + 1) + t) * 4 + k] = sum * UNITS[k];
        sum += change += values[(row * steps + t) * 4 + k];
      }
    }
  }
  return poses;
}

// The run as the other parts ask for it; tracks are rows of `poses`.
function runOf({ info, arrays }) {
  const { start, motion, which, levels, values, likely, recorded } = arrays;
  const [children, vehicles] = which.shape, owner = new Int32Array(motion.shape[0]);
  which.values.forEach((row, i) => { owner[row] = i % vehicles; });
  const columns = (table) => info.metrics.map((_, m) => table && table.values.subarray(m * table.shape[1], (m + 1) * table.shape[1]));
  return {
    info, arrays, children, vehicles, owner,
    frames: motion.shape[1] + 1,
    poses: posesOf(motion, start, (row) => owner[row]),
    recorded: recorded && posesOf(recorded, start, (row) => row),
    columns: columns(values),
    likely: columns(likely),
    radius: (vehicle) => Math.hypot(...info.sizes[vehicle]) / 2,
    id: (vehicle) => info.track_ids[vehicle],
    track: (child, vehicle) => which.values[child * vehicles + vehicle],
    model: (child, vehicle) => levels.values[child * vehicles + vehicle],
  };
}

// Pose of a row at a step that may lie between two.
function poseAt(poses, frames, row, step) {
  const low = Math.min(Math.floor(step), frames - 1), high = Math.min(low + 1, frames - 1), part = step - low;
  const a = (row * frames + low) * 4, b = (row * frames + high) * 4;
  return [0, 1, 2, 3].map((k) => poses[a + k] + part * (poses[b + k] - poses[a + k]));
}

// Share with the 95 % score interval (Wilson 1927) of as many independent children.
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
const range = ({ low, high }) => `${percent(low)} – ${percent(high)}`;
const short = (value, digits = 2) => isMissing(value) ? "–" : Number.isFinite(value) ? value.toFixed(digits) : "∞";
const seconds = (step) => `${(step / 10).toFixed(1)} s`;
