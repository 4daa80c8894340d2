// Cameras as they are drawn: the border of what they see, and rays of their pixels.
import { BufferAttribute, Vector3 } from "three";
import { thinLines } from "./lines.js";

// Lines of the cameras `all` of a rig at `t`, turned by `q`, for `lines`. `step`: every which direction of the border is drawn, 1, 2, 3 or 6.
export function addFrustum(all, t, q, size, lines, step = 1) {
  const corner = new Vector3(), before = new Vector3(), apex = new Vector3();
  for (const { position, directions } of all) {
    if (!directions.length) continue;
    apex.fromArray(position).applyQuaternion(q).add(t);
    const at = (k, to) => to.fromArray(directions[k % directions.length]).multiplyScalar(size).applyQuaternion(q).add(apex);
    for (let k = 0; k < directions.length; k += step) {
      at(k, before);
      at(k + step, corner);
      lines.push(before.x, before.y, before.z, corner.x, corner.y, corner.z);
      if (k % 6 === 0) lines.push(apex.x, apex.y, apex.z, before.x, before.y, before.z);
    }
  }
}

// Where pixels of a grid look: their colours tell the place in the image.
export function rayLines(cameras, t, q, length) {
  const ends = [], colours = [], v = new Vector3(), d = new Vector3();
  for (const { rays, grid } of cameras) {
    for (let k = 0; rays && 6 * k < rays.length; ++k) {
      v.fromArray(rays, 6 * k).applyQuaternion(q).add(t);
      if (Number.isNaN(v.x)) continue;
      d.fromArray(rays, 6 * k + 3).applyQuaternion(q).multiplyScalar(length).add(v);
      ends.push(v.x, v.y, v.z, d.x, d.y, d.z);
      const across = (k % grid[0]) / (grid[0] - 1), down = Math.floor(k / grid[0]) / (grid[1] - 1);
      for (let end = 0; end < 2; ++end) colours.push(across, 0.35, 1 - down);
    }
  }
  const lines = thinLines(ends);
  lines.geometry.setAttribute("color", new BufferAttribute(new Float32Array(colours), 3));
  lines.material.vertexColors = true;
  return lines;
}

// An order of which any beginning is spread evenly: the bits of numbers from right to left.
export function spread(list) {
  const bits = Math.ceil(Math.log2(list.length || 1)), order = [];
  for (let i = 0; i < 2 ** bits; ++i) {
    let at = 0;
    for (let b = 0; b < bits; ++b) at = 2 * at + ((i >> b) & 1);
    if (at < list.length) order.push(list[at]);
  }
  return order;
}

export const evenly = (count, most) => {
  const kept = Math.min(count, most);
  return Array.from({ length: kept }, (_, i) => Math.floor((i * count) / kept));
};
