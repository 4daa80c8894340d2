// The points of a map: how they are drawn, and in which colours.
import { BufferAttribute, BufferGeometry, Points, ShaderMaterial, Sphere } from "three";
import { quantile } from "./data.js";

// Discs, larger where they are nearer. `size` is that in pixels at the distance `reference`.
const SHADER = {
  vertexColors: true,
  vertexShader: `uniform float size, reference, ratio; varying vec3 shade;
    void main() {
      vec4 at = modelViewMatrix * vec4(position, 1.0);
      gl_Position = projectionMatrix * at;
      gl_PointSize = ratio * clamp(size * reference / -at.z, min(size, 1.5), 2.0 * size);
      shade = color;
    }`,
  fragmentShader: `varying vec3 shade;
    void main() {
      vec2 off = gl_PointCoord - 0.5;
      if (dot(off, off) > 0.25) discard;
      gl_FragColor = vec4(shade, 1.0);
    }`,
};

export function pointCloud() {
  const uniforms = { size: { value: 3 }, reference: { value: 1 }, ratio: { value: 1 } };
  const points = new Points(new BufferGeometry(), new ShaderMaterial({ ...SHADER, uniforms }));
  points.frustumCulled = false;
  return points;
}

export function setPoints(points, positions, colours) {
  points.geometry.dispose();
  const geometry = (points.geometry = new BufferGeometry());
  geometry.setAttribute("position", new BufferAttribute(positions, 3));
  geometry.setAttribute("color", new BufferAttribute(colours, 3, true));
  geometry.boundingSphere = new Sphere(); // to find theirs takes long, and it tells only in which order things are drawn
}

// Blue, green, yellow and red from low to high.
export const HEIGHTS = [[49, 84, 201], [24, 158, 191], [57, 176, 84], [222, 178, 32], [214, 69, 50]];
const STEPS = 256;

const LADDER = (() => {
  const ladder = new Uint8Array(3 * STEPS);
  for (let i = 0; i < STEPS; ++i) {
    const at = (i / STEPS) * (HEIGHTS.length - 1), k = Math.floor(at);
    HEIGHTS[k].forEach((low, c) => (ladder[3 * i + c] = Math.round(low + (at - k) * (HEIGHTS[k + 1][c] - low))));
  }
  return ladder;
})();

export function areGrey(colours) {
  const step = 3 * Math.max(1, Math.floor(colours.length / 3000));
  for (let i = 0; i < colours.length; i += step) {
    if (Math.abs(colours[i] - colours[i + 1]) > 6 || Math.abs(colours[i] - colours[i + 2]) > 6) return false;
  }
  return colours.length > 0;
}

// The 4th and the 96th of a hundred heights, along `up`.
export function heightRange(positions, up) {
  const some = [], step = 3 * Math.max(1, Math.floor(positions.length / 9000));
  for (let i = 0; i < positions.length; i += step) some.push(positions[i] * up.x + positions[i + 1] * up.y + positions[i + 2] * up.z);
  return some.length ? [quantile(some, 0.04), quantile(some, 0.96)] : [0, 0];
}

export function heightColours(positions, up, [low, high]) {
  const colours = new Uint8Array(positions.length), { x, y, z } = up, scale = STEPS / (high - low || 1);
  for (let i = 0; i < positions.length; i += 3) {
    const height = positions[i] * x + positions[i + 1] * y + positions[i + 2] * z;
    const at = 3 * Math.max(0, Math.min(STEPS - 1, Math.floor((height - low) * scale)));
    colours[i] = LADDER[at];
    colours[i + 1] = LADDER[at + 1];
    colours[i + 2] = LADDER[at + 2];
  }
  return colours;
}
