// What page_data.cpp wrote, with its arrays unpacked.

function bytesOf(text) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < bytes.length; ++i) bytes[i] = binary.charCodeAt(i);
  return bytes;
}

const unpack = (text, Kind) => new Kind(bytesOf(text).buffer);

const common = (a, b) => (b ? common(b, a % b) : a);

// In an order of which any beginning is spread evenly: that much is drawn while the view moves.
function readPoints(json) {
  const quantised = unpack(json.xyz, Uint16Array), rgb = unpack(json.rgb, Uint8Array), count = json.count;
  const positions = new Float32Array(3 * count), colours = new Uint8Array(3 * count);
  let step = Math.max(1, Math.round(0.618 * count));
  while (common(step, count) > 1) ++step;
  const [x0, y0, z0] = json.low, [dx, dy, dz] = json.high.map((high, axis) => (high - json.low[axis]) / 65535);
  for (let to = 0, from = 0; to < 3 * count; to += 3, from = (from + 3 * step) % (3 * count)) {
    positions[to] = x0 + quantised[from] * dx;
    positions[to + 1] = y0 + quantised[from + 1] * dy;
    positions[to + 2] = z0 + quantised[from + 2] * dz;
    colours[to] = rgb[from];
    colours[to + 1] = rgb[from + 1];
    colours[to + 2] = rgb[from + 2];
  }
  return { count, all: json.all, far: json.far, positions, colours };
}

function readWorld(json, total) {
  const f = json.frames, k = json.keyframes;
  const world = {
    metric: json.metric,
    scaleSigma: json.scale_sigma,
    count: f.count,
    index: unpack(f.index, Uint32Array),
    time: unpack(f.time, Float64Array),
    pose: unpack(f.pose, Float32Array),
    covariance: unpack(f.covariance, Float32Array),
    turn: unpack(f.turn, Float32Array),
    lens: unpack(f.lens, Int32Array),
    keyframes: { frame: unpack(k.frame, Uint32Array), seen: unpack(k.seen, Uint32Array), error: unpack(k.error, Float32Array) },
    points: readPoints(json.points),
    at: new Int32Array(total).fill(-1), // frame of the input to frame of this world
  };
  world.index.forEach((frame, i) => (world.at[frame] = i));
  world.keyframeAt = new Int32Array(total).fill(-1);
  world.keyframes.frame.forEach((i, number) => (world.keyframeAt[world.index[i]] = number));
  return world;
}

// Four digits, or so many behind the point of a number that needs an exponent.
export function digits(x, places = 2) {
  const plain = x === 0 || (Math.abs(x) < 1e6 && Math.abs(x) >= 1e-3);
  return plain ? String(Number(x.toPrecision(4))) : x.toExponential(places);
}

// With a comma at each thousand.
export const counted = (n) => n.toLocaleString("en");

// So much of the numbers is smaller.
export function quantile(numbers, share) {
  const sorted = Float64Array.from(numbers).sort();
  return sorted[Math.min(sorted.length - 1, Math.floor(share * sorted.length))];
}

export function readData(text = document.getElementById("data").textContent) {
  const json = JSON.parse(text);
  const reasons = new Array(json.total).fill("");
  for (const run of json.missing) reasons.fill(run.reason, run.first, run.last + 1);
  const held = new Uint8Array(json.total);
  for (const run of json.held) held.fill(1, run.first, run.last + 1);
  for (const camera of json.cameras.concat(json.lenses)) if (camera.rays) camera.rays = unpack(camera.rays, Float32Array);
  const { mesh } = json;
  if (mesh) {
    Object.assign(mesh, { positions: unpack(mesh.positions, Float32Array), faces: unpack(mesh.faces, Uint32Array),
      places: unpack(mesh.places, Uint16Array), texture: `data:image/jpeg;base64,${mesh.texture}` });
  }
  return { ...json, reasons, isHeld: held, worlds: json.worlds.map((world) => readWorld(world, json.total)) };
}
