// Lines, thick and thin, and what else has one colour.
import {
  BufferAttribute, BufferGeometry, Color, InstancedBufferGeometry, InstancedInterleavedBuffer, InterleavedBufferAttribute, LineSegments, Mesh,
  ShaderMaterial, Sphere, Vector2,
} from "three";

// Short programs: where no graphics card is, three.js's own for lines take a browser longer to make than the map to draw.
const FLAT = {
  vertexShader: `uniform vec3 colour; varying vec3 shade;
    void main() {
      gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
      shade = colour;
      #ifdef USE_COLOR
        shade *= color;
      #endif
    }`,
  fragmentShader: `uniform float alpha; varying vec3 shade;
    void main() {
      gl_FragColor = linearToOutputTexel(vec4(shade, alpha));
    }`,
};

// `position` is a place about a piece of line in half its width: across, and along from end to end, a cap beyond each. The caps are round.
const THICK = {
  vertexShader: `attribute vec3 from, to; uniform vec2 resolution; uniform float width; varying vec2 place;
    vec4 before(float cut, vec4 a, vec4 b) {
      return a.z > cut && b.z < cut ? mix(b, a, (cut - b.z) / (a.z - b.z)) : a;
    }
    void main() {
      // In front of the eye, so far as the nearest that is drawn.
      float cut = -0.5 * projectionMatrix[3][2] / projectionMatrix[2][2];
      vec4 a = modelViewMatrix * vec4(from, 1.0), b = modelViewMatrix * vec4(to, 1.0);
      vec4 first = projectionMatrix * before(cut, a, b), last = projectionMatrix * before(cut, b, a);
      vec2 along = normalize((last.xy / last.w - first.xy / first.w) * resolution);
      float cap = position.y < 0.0 ? -1.0 : position.y > 1.0 ? 1.0 : 0.0;
      vec2 off = position.x * vec2(along.y, -along.x) + cap * along;
      gl_Position = position.y < 0.5 ? first : last;
      gl_Position.xy += off * width / resolution * gl_Position.w;
      place = vec2(position.x, cap);
    }`,
  fragmentShader: `uniform vec3 colour; varying vec2 place;
    void main() {
      if (dot(place, place) > 1.0 && place.y != 0.0) discard;
      gl_FragColor = linearToOutputTexel(vec4(colour, 1.0));
    }`,
};
const CORNERS = [-1, 2, 0, 1, 2, 0, -1, 1, 0, 1, 1, 0, -1, 0, 0, 1, 0, 0, -1, -1, 0, 1, -1, 0];
const FACES = [0, 2, 1, 2, 3, 1, 2, 4, 3, 4, 5, 3, 4, 6, 5, 6, 7, 5];

// `color`: as materials of three.js have it.
function withColour(shader, uniforms, settings) {
  const color = new Color();
  return Object.assign(new ShaderMaterial({ ...shader, ...settings, uniforms: { colour: { value: color }, ...uniforms } }), { color });
}

export const flatMaterial = (opacity = 1) => withColour(FLAT, { alpha: { value: opacity } }, { transparent: true }); // always, for one program

// `ends`: x y z of both ends of each piece.
export function thickLines(ends, width) {
  const resolution = new Vector2(), lines = new Mesh(new BufferGeometry(), withColour(THICK, { width: { value: width }, resolution: { value: resolution } }));
  lines.onBeforeRender = (renderer) => renderer.getSize(resolution);
  lines.frustumCulled = false;
  setEnds(lines, ends);
  return lines;
}

export function setEnds(lines, ends) {
  lines.geometry.dispose();
  lines.empty = ends.length === 0;
  const geometry = (lines.geometry = new InstancedBufferGeometry()), pieces = new InstancedInterleavedBuffer(new Float32Array(ends), 6);
  geometry.setIndex(FACES);
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(CORNERS), 3));
  geometry.setAttribute("from", new InterleavedBufferAttribute(pieces, 3, 0));
  geometry.setAttribute("to", new InterleavedBufferAttribute(pieces, 3, 3));
  geometry.instanceCount = ends.length / 6;
  geometry.boundingSphere = new Sphere(); // as of points
}

export function thinLines(ends) {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(ends), 3));
  const lines = new LineSegments(geometry, flatMaterial(0.6));
  lines.frustumCulled = false;
  return lines;
}

// Pieces between neighbouring frames of a world, or with `step` between every so many; gaps are not bridged.
export function pathEnds({ pose, index, count }, step = 1) {
  const ends = [];
  for (let i = 0; i + 1 < count; i += step) {
    const j = Math.min(i + step, count - 1);
    if (index[j] - index[i] !== j - i) continue;
    for (const k of [7 * i, 7 * j]) ends.push(pose[k], pose[k + 1], pose[k + 2]);
  }
  return ends;
}
