// What page_data.cpp wrote, with its arrays unpacked.

function bytesOf(text) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < bytes.length; ++i) bytes[i] = binary.charCodeAt(i);
  return bytes;
}

const unpack = (text, Kind) => new Kind(bytesOf(text).buffer);

function joined(a, b) {
  const both = new a.constructor(a.length + b.length);
  both.set(a);
  both.set(b, a.length);
  return both;
}

// Adds those that come after the ones that are there. Any beginning of them is spread evenly: that much is drawn while the view moves.
function addPoints(points, { xyz, rgb }) {
  const quantised = unpack(xyz, Uint16Array), positions = new Float32Array(quantised.length);
  const [x0, y0, z0] = points.low, [dx, dy, dz] = points.high.map((high, axis) => (high - points.low[axis]) / 65535);
  for (let i = 0; i < positions.length; i += 3) {
    positions[i] = x0 + quantised[i] * dx;
    positions[i + 1] = y0 + quantised[i + 1] * dy;
    positions[i + 2] = z0 + quantised[i + 2] * dz;
  }
  points.positions = joined(points.positions, positions);
  points.colours = joined(points.colours, bytesOf(rgb));
}

// `count` is of all, the arrays grow to it.
function readPoints({ count, all, far, low, high, ...first }) {
  const points = { count, all, far, low, high, positions: new Float32Array(0), colours: new Uint8Array(0) };
  addPoints(points, first);
  return points;
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

// `text`: what comes first.
export function readData(text) {
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

// The rest of the same.
export function addRest(data, text) {
  JSON.parse(text).forEach((rest, number) => addPoints(data.worlds[number].points, rest));
}
