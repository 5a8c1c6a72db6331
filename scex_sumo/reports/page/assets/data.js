// Packed data: reads what packing.py wrote, and makes poses of second differences.

async function unpack(text) {
  const packed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  let start = 4 + new DataView(bytes.buffer).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(bytes.subarray(4, start)));
  const types = { i1: Int8Array, i2: Int16Array, i4: Int32Array, f4: Float32Array };
  const arrays = {};
  for (const { name, type, shape } of head.arrays) {
    const size = Number(type[1]);
    const count = shape.reduce((product, length) => product * length, 1);
    const joined = new Uint8Array(count * size);
    for (let plane = 0; plane < size; plane++) {
      for (let i = 0; i < count; i++) joined[i * size + plane] = bytes[start + plane * count + i];
    }
    arrays[name] = { shape, values: new types[type](joined.buffer) };
    start += count * size;
  }
  return { info: head.info, arrays };
}

// Poses (rows, 1 + steps, 3) in m and rad of second differences after the start of each row's vehicle.
function posesOf(motion, start, ownerOf, units) {
  const [rows, steps] = motion.shape;
  const scale = [units.position, units.position, units.heading];
  const poses = new Float64Array(rows * (steps + 1) * 3);
  for (let row = 0; row < rows; row++) {
    for (let k = 0; k < 3; k++) {
      const first = start.values[ownerOf(row) * 3 + k];
      let change = 0, sum = 0;
      poses[row * (steps + 1) * 3 + k] = first * scale[k];
      for (let t = 0; t < steps; t++) {
        change += motion.values[(row * steps + t) * 3 + k];
        sum += change;
        poses[(row * (steps + 1) + t + 1) * 3 + k] = (first + sum) * scale[k];
      }
    }
  }
  return poses;
}

// The run as the other parts ask for it; tracks are rows of `poses`, see `track`.
function runOf({ info, arrays }) {
  const { start, motion, which, levels, sizes, values } = arrays;
  const children = which.shape[0], vehicles = which.shape[1], frames = motion.shape[1] + 1;
  const owner = new Int32Array(motion.shape[0]);
  which.values.forEach((row, i) => { owner[row] = i % vehicles; });
  const metrics = info.metrics.length;
  const column = (table, m) => table && Float32Array.from({ length: table.shape[0] }, (_, c) => table.values[c * metrics + m]);
  return {
    info, arrays, children, vehicles, frames, owner,
    poses: posesOf(motion, start, (row) => owner[row], info.units),
    recorded: arrays.recorded && posesOf(arrays.recorded, start, (row) => row, info.units),
    recordedFrames: arrays.recorded ? arrays.recorded.shape[1] + 1 : 0,
    columns: info.metrics.map((_, m) => column(values, m)),
    likely: info.metrics.map((_, m) => column(arrays.likely, m)),
    track: (child, vehicle) => which.values[child * vehicles + vehicle],
    model: (child, vehicle) => levels.values[child * vehicles + vehicle],
    size: (vehicle) => [sizes.values[2 * vehicle] * info.units.position, sizes.values[2 * vehicle + 1] * info.units.position],
  };
}

// Pose at a step that may lie between two, written into `out`.
function poseAt(poses, frames, row, step, out) {
  const low = Math.min(Math.floor(step), frames - 1), high = Math.min(low + 1, frames - 1), part = step - low;
  const a = (row * frames + low) * 3, b = (row * frames + high) * 3;
  for (let k = 0; k < 3; k++) out[k] = poses[a + k] + part * (poses[b + k] - poses[a + k]);
  return out;
}

// Share with its 95 % score interval (Wilson 1927).
function wilson(successes, count) {
  if (!count) return { value: NaN, low: 0, high: 1 };
  const z2 = 1.959964 ** 2, share = successes / count;
  const centre = (successes + z2 / 2) / (count + z2);
  const half = Math.sqrt(z2 * (share * (1 - share) * count + z2 / 4)) / (count + z2);
  return { value: share, low: successes ? Math.max(centre - half, 0) : 0, high: successes < count ? Math.min(centre + half, 1) : 1 };
}

const percent = (share) => Number.isNaN(share) ? "–" : `${(100 * share).toFixed(share > 0 && share < 0.0995 ? 1 : 0)} %`;
const short = (value, digits = 2) => value === null || value === undefined || Number.isNaN(value) ? "–" : Number.isFinite(value) ? value.toFixed(digits) : "∞";
const quantile = (sorted, share) => sorted.length ? sorted[Math.min(sorted.length - 1, Math.floor(share * sorted.length))] : NaN;
