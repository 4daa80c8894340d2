// From where a world is looked at: which way is up, how far it reaches, and where the whole of it is seen from.
import { Matrix3, Quaternion, Vector3 } from "three";
import { quantile } from "./data.js";

// Which way is up: cameras are mostly held so that their x is level, and y down. Cameras that hardly turn tell the first badly:
// then it is the mean of their own.
export function upOf({ pose, count }) {
  const m = new Matrix3().set(0, 0, 0, 0, 0, 0, 0, 0, 0), mean = new Vector3(), across = new Vector3(), q = new Quaternion(), v = new Vector3();
  const e = m.elements, step = Math.max(1, Math.floor(count / 1000));
  let used = 0;
  for (let i = 0; i < count; i += step, ++used) {
    q.fromArray(pose, 7 * i + 3);
    mean.add(v.set(0, -1, 0).applyQuaternion(q));
    across.add(v.set(1, 0, 0).applyQuaternion(q));
    v.toArray().forEach((a, row) => v.toArray().forEach((b, column) => (e[3 * column + row] += a * b)));
  }
  mean.normalize();
  if (across.length() > 0.93 * used) return mean;
  // The direction in which m is least is that in which its trace less itself is greatest.
  const up = mean.clone();
  for (let k = 0; k < 200; ++k) {
    v.copy(up).applyMatrix3(m);
    up.multiplyScalar(used).sub(v).normalize();
  }
  if (up.dot(mean) < 0) up.negate();
  return up.dot(mean) > 0.5 ? up : mean;
}

// How far things reach from the middle of the path, and how high the floor is when the world is level.
export function extentOf({ pose, count, points: { positions } }, up) {
  const low = new Vector3(Infinity, Infinity, Infinity), high = low.clone().negate(), p = new Vector3();
  for (let i = 0; i < count; ++i) low.min(p.fromArray(pose, 7 * i)), high.max(p.fromArray(pose, 7 * i));
  const middle = low.clone().add(high).multiplyScalar(0.5), distances = [], heights = [];
  for (let i = 0; i < positions.length; i += 3 * Math.max(1, Math.floor(positions.length / 9000))) {
    distances.push(p.fromArray(positions, i).distanceTo(middle));
    heights.push(p.dot(up));
  }
  for (let i = 0; i < count; i += Math.max(1, Math.floor(count / 500))) heights.push(p.fromArray(pose, 7 * i).dot(up));
  const points = distances.length ? quantile(distances, 0.5) : 0;
  return { middle, reach: Math.max(low.distanceTo(high) * 0.6, points, 1e-6), floor: quantile(heights, 0.03) };
}

// Places that belong into the picture, in the scene: of the path, and of points that are not far off.
function placesOf({ pose, count, points }, middle, root) {
  const p = new Vector3(), path = [], near = [];
  for (let i = 0; i < count; i += Math.max(1, Math.floor(count / 300))) path.push(root.localToWorld(new Vector3().fromArray(pose, 7 * i)));
  const away = (i) => p.fromArray(points.positions, 3 * i).distanceTo(middle);
  const some = Array.from({ length: Math.min(points.count, 2000) }, (_, i) => i); // any beginning is spread evenly
  const far = some.length ? 2 * quantile(some.map(away), 0.8) : 0;
  for (const i of some) if (away(i) <= far) near.push(root.localToWorld(p.clone()));
  return { path, all: path.concat(near) };
}

// From which side the whole is seen: from behind the cameras and above where they mostly look one way.
function sideOf({ pose, count }, root) {
  const ahead = new Vector3(), v = new Vector3(), q = new Quaternion();
  for (let i = 0; i < count; ++i) ahead.add(v.set(0, 0, 1).applyQuaternion(q.fromArray(pose, 7 * i + 3)));
  ahead.divideScalar(count || 1).applyQuaternion(root.quaternion).setY(0);
  if (ahead.length() < 0.25) return new Vector3(0.55, 0.8, 1).normalize();
  return ahead.normalize().negate().applyAxisAngle(new Vector3(0, 1, 0), 0.55).setY(0.62).normalize();
}

// The whole of it, so near that all but the outermost is in the picture of `camera`, right of what covers the part `inset` at the left.
// Returns what is looked at, the direction from there to the eye, and how far that is.
export function overview(world, middle, least, root, camera, inset) {
  const { path, all } = placesOf(world, middle, root), to = sideOf(world, root);
  const right = new Vector3(0, 1, 0).cross(to).normalize(), up = to.clone().cross(right);
  const tall = Math.tan((camera.fov * Math.PI) / 360) * 0.92, whole = tall * camera.aspect, wide = whole * (1 - inset), v = new Vector3();
  const target = new Vector3();
  let distance = 0;
  for (const axis of ["x", "y", "z"]) {
    const along = all.map((p) => p[axis]);
    target[axis] = (quantile(along, 0.05) + quantile(along, 0.95)) / 2;
  }
  for (let round = 0; round < 4; ++round) {
    const needed = (places) => places.map((p) => v.copy(p).sub(target).dot(to) + Math.max(Math.abs(v.dot(right)) / wide, Math.abs(v.dot(up)) / tall));
    distance = Math.max(quantile(needed(all), 0.99), ...needed(path), least);
    // What is nearer is larger: the middle of what is seen is not that of what is there.
    const seen = all.map((p) => (v.copy(p).sub(target), [v.dot(right) / (distance - v.dot(to)), v.dot(up) / (distance - v.dot(to))]));
    const off = (k) => {
      const places = seen.map((s) => s[k]);
      return ((quantile(places, 0.01) + quantile(places, 0.99)) / 2) * distance;
    };
    const [dx, dy] = [off(0), off(1)];
    if (round < 3) target.addScaledVector(right, dx).addScaledVector(up, dy);
  }
  target.addScaledVector(right, -inset * whole * distance);
  return { target, to, distance };
}
