// The world in three dimensions: points, path, cameras, ellipsoids.
import {
  AmbientLight, BufferAttribute, BufferGeometry, Color, DirectionalLight, GridHelper, Group, InstancedMesh, Line, LineBasicMaterial,
  LineSegments, Matrix3, Matrix4, Mesh, MeshBasicMaterial, MeshLambertMaterial, PerspectiveCamera, Points, Quaternion, Scene, ShaderMaterial,
  SphereGeometry, SRGBColorSpace, TextureLoader, Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { LineMaterial } from "three/examples/jsm/lines/LineMaterial.js";
import { LineSegments2 } from "three/examples/jsm/lines/LineSegments2.js";
import { LineSegmentsGeometry } from "three/examples/jsm/lines/LineSegmentsGeometry.js";

const NINETY = Math.sqrt(6.251388631); // 90 % of a normal distribution in space lie within so many standard deviations
const MOST_FRUSTA = 400; // of key frames that are drawn
const FLUENT = 1000 / 30, SLOW = 1000 / 22; // milliseconds from picture to picture
const LEAST_POINTS = 8000; // that are drawn while the view moves, however slow the machine
const COARSE_PATH = 600; // pieces of the path then
// Lines of a frustum cost a processor that draws by itself as much as a hundred points.
const PLAIN_FRUSTA = 100; // beyond so many they have fewer lines
const THEMES = {
  light: { background: "#f6f7f9", grid: "#d5d9e0", path: "#1f6feb", key: "#d9480f", now: "#0b7a3b", ellipsoid: "#c026d3", closure: "#c2255c" },
  dark: { background: "#0e1116", grid: "#262d38", path: "#58a6ff", key: "#ff922b", now: "#3fdd78", ellipsoid: "#e879f9", closure: "#ff6b9d" },
};

// Discs, larger where they are nearer. `size` is that in pixels at the distance `reference`.
const POINT_SHADER = {
  uniforms: { size: { value: 3 }, reference: { value: 1 }, ratio: { value: 1 } },
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

// Blue, green, yellow and red from low to high.
const HEIGHTS = [[49, 84, 201], [24, 158, 191], [57, 176, 84], [222, 178, 32], [214, 69, 50]];

function colourOfPart(part) {
  const at = Math.max(0, Math.min(0.9999, part)) * (HEIGHTS.length - 1), k = Math.floor(at);
  return HEIGHTS[k].map((low, c) => low + (at - k) * (HEIGHTS[k + 1][c] - low));
}

function areGrey(colours) {
  const step = 3 * Math.max(1, Math.floor(colours.length / 3000));
  for (let i = 0; i < colours.length; i += step) {
    if (Math.abs(colours[i] - colours[i + 1]) > 6 || Math.abs(colours[i] - colours[i + 2]) > 6) return false;
  }
  return colours.length > 0;
}

// So much of the numbers is smaller.
function part(numbers, share) {
  const sorted = [...numbers].sort((a, b) => a - b);
  return sorted[Math.min(sorted.length - 1, Math.floor(share * sorted.length))];
}

// Colours by height, between the 4th and the 96th of a hundred.
function heightColours(positions, up) {
  const heights = new Float32Array(positions.length / 3), colours = new Uint8Array(positions.length), some = [];
  for (let i = 0; i < heights.length; ++i) heights[i] = positions[3 * i] * up.x + positions[3 * i + 1] * up.y + positions[3 * i + 2] * up.z;
  for (let i = 0; i < heights.length; i += Math.max(1, Math.floor(heights.length / 3000))) some.push(heights[i]);
  const low = part(some, 0.04), high = part(some, 0.96);
  for (let i = 0; i < heights.length; ++i) colours.set(colourOfPart((heights[i] - low) / (high - low || 1)), 3 * i);
  return colours;
}

// Which way is up: cameras are mostly held so that their x is level, and y down. Cameras that hardly turn tell the first badly:
// then it is the mean of their own.
function upOf({ pose, count }) {
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

// Lower triangular root of a covariance: it takes the unit sphere to the ellipsoid of one standard deviation.
function root(c, i) {
  const [xx, xy, xz, yy, yz, zz] = c.subarray(6 * i, 6 * i + 6);
  const a = Math.sqrt(Math.max(xx, 0)), safe = (top, bottom) => (bottom > 0 ? top / bottom : 0);
  const b = safe(xy, a), d = safe(xz, a);
  const e = Math.sqrt(Math.max(yy - b * b, 0));
  const g = safe(yz - b * d, e);
  return { a, b, d, e, g, h: Math.sqrt(Math.max(zz - d * d - g * g, 0)) };
}

function drawsInSoftware() {
  const gl = document.createElement("canvas").getContext("webgl2"), info = gl?.getExtension("WEBGL_debug_renderer_info");
  const name = info ? gl.getParameter(info.UNMASKED_RENDERER_WEBGL) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software/i.test(name);
}

// An order of which any beginning is spread evenly: the bits of numbers from right to left.
function spread(list) {
  const bits = Math.ceil(Math.log2(list.length || 1)), order = [];
  for (let i = 0; i < 2 ** bits; ++i) {
    let at = 0;
    for (let b = 0; b < bits; ++b) at = 2 * at + ((i >> b) & 1);
    if (at < list.length) order.push(list[at]);
  }
  return order;
}

const evenly = (count, most) => {
  const kept = Math.min(count, most);
  return Array.from({ length: kept }, (_, i) => Math.floor((i * count) / kept));
};

export class World3d {
  constructor(canvas, data) {
    this.data = data;
    const software = drawsInSoftware();
    this.renderer = new WebGLRenderer({ canvas, antialias: !software });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(50, 1, 0.01, 1e6);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableDamping = true;
    this.controls.dampingFactor = 0.15;
    this.root = new Group();
    this.scene.add(this.root, new AmbientLight(0xffffff, 1.6));
    const sun = new DirectionalLight(0xffffff, 1.8);
    sun.position.set(1, 3, 2);
    this.scene.add(sun);
    this.shown = { surface: true, points: !data.mesh, path: true, cameras: true, closures: true, ellipsoids: false, rays: false, grid: true };
    this.pointSize = 3;
    this.detail = software ? 0.1 : 1; // part of points and frusta that is drawn while the view moves
    this.moved = -Infinity; // when it last did, milliseconds
    this.exaggeration = 1;
    this.inset = 0;
    this.follow = false;
    this.dirty = true;
    this.touched = false; // by somebody who looks from where he likes
    this.controls.addEventListener("change", () => (this.dirty = true));
    this.controls.addEventListener("start", () => (this.touched = true));
  }

  // `keep`: the view stays where it is.
  show(world, keep = false) {
    this.world = world;
    this.root.traverse((object) => object.geometry?.dispose());
    this.root.clear();
    this.level();
    const size = this.measure();
    this.frustumSize = size.reach * (world.keyframes.frame.length > PLAIN_FRUSTA ? 0.03 : 0.045);
    if (!keep) this.pointSize = Math.max(1.5, Math.min(5, 4.5 * (8000 / (world.points.count || 1)) ** 0.4));
    this.makePoints();
    this.makeSurface();
    this.makePath();
    this.makeClosures();
    this.makeCameras();
    this.makeEllipsoids();
    this.makeGrid(size);
    this.marks = new Group();
    this.root.add(this.marks);
    this.tail = [];
    this.colour();
    this.apply();
    if (!keep) this.home();
  }

  // Turns the world so that up is up.
  level() {
    this.up = upOf(this.world);
    this.root.quaternion.setFromUnitVectors(this.up, new Vector3(0, 1, 0));
    this.root.updateMatrixWorld(true);
  }

  // How far things reach from the middle of the path, and how high the floor is when the world is level.
  measure() {
    const { pose, count } = this.world;
    const low = new Vector3(Infinity, Infinity, Infinity), high = low.clone().negate(), p = new Vector3();
    for (let i = 0; i < count; ++i) low.min(p.fromArray(pose, 7 * i)), high.max(p.fromArray(pose, 7 * i));
    const middle = low.clone().add(high).multiplyScalar(0.5), distances = [], heights = [];
    const { positions } = this.world.points;
    for (let i = 0; i < positions.length; i += 3 * Math.max(1, Math.floor(positions.length / 9000))) {
      distances.push(p.fromArray(positions, i).distanceTo(middle));
      heights.push(p.dot(this.up));
    }
    for (let i = 0; i < count; i += Math.max(1, Math.floor(count / 500))) heights.push(this.position(i, p).dot(this.up));
    const path = low.distanceTo(high), points = part(distances, 0.5) || 0;
    this.middle = middle;
    this.reach = Math.max(path * 0.6, points, 1e-6);
    return { reach: this.reach, floor: part(heights, 0.03) };
  }

  makePoints() {
    const { positions, colours } = this.world.points;
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(positions, 3));
    this.points = new Points(geometry, new ShaderMaterial(POINT_SHADER));
    this.byHeight = this.byHeight ?? areGrey(colours);
    this.colourPoints();
    this.root.add(this.points);
  }

  // Its faces are seen from the side that the cameras saw: into a room one looks through the walls.
  makeSurface() {
    this.surface = null;
    const { mesh } = this.data;
    if (!mesh || this.data.worlds[mesh.world] !== this.world) return;
    const corners = new Float32Array(3 * mesh.faces.length);
    mesh.faces.forEach((vertex, i) => corners.set(mesh.positions.subarray(3 * vertex, 3 * vertex + 3), 3 * i));
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(corners, 3));
    geometry.setAttribute("uv", new BufferAttribute(mesh.places, 2, true));
    this.texture ??= new TextureLoader().load(mesh.texture, () => (this.dirty = true));
    this.texture.colorSpace = SRGBColorSpace;
    this.surface = new Mesh(geometry, new MeshBasicMaterial({ map: this.texture }));
    this.root.add(this.surface);
  }

  colourPoints() {
    const { positions, colours } = this.world.points;
    this.points.geometry.setAttribute("color", new BufferAttribute(this.byHeight ? heightColours(positions, this.up) : colours, 3, true));
    this.dirty = true;
  }

  position(i, to = new Vector3()) {
    return to.fromArray(this.world.pose, 7 * i);
  }
  rotation(i, to = new Quaternion()) {
    return to.fromArray(this.world.pose, 7 * i + 3);
  }

  // Runs of neighbouring frames are joined, gaps are not.
  makePath() {
    const { index, count } = this.world, ends = [];
    for (let i = 1; i < count; ++i) {
      if (index[i] - index[i - 1] === 1) ends.push(...this.position(i - 1).toArray(), ...this.position(i).toArray());
    }
    this.path = this.thickLines(ends, 3);
    this.coarsePath = this.thickLines(this.coarse(), 3);
    // Over the points, which would hide it.
    for (const path of [this.path, this.coarsePath]) path.renderOrder = 1, (path.material.depthTest = false);
    this.root.add(this.path, this.coarsePath);
    this.tailPath = this.thickLines([], 3);
    this.root.add(this.tailPath);
  }

  // The path in few pieces; gaps are not bridged.
  coarse() {
    const { index, count } = this.world, step = Math.max(1, Math.ceil(count / COARSE_PATH)), ends = [];
    for (let i = 0; i + 1 < count; i += step) {
      const j = Math.min(i + step, count - 1);
      if (index[j] - index[i] === j - i) ends.push(...this.position(i).toArray(), ...this.position(j).toArray());
    }
    return ends;
  }

  thickLines(ends, width) {
    const lines = new LineSegments2(new LineSegmentsGeometry(), new LineMaterial({ linewidth: width }));
    lines.material.resolution.set(this.width || 1, this.height || 1);
    lines.frustumCulled = false;
    this.setEnds(lines, ends);
    return lines;
  }

  setEnds(lines, ends) {
    lines.geometry.dispose();
    lines.geometry = new LineSegmentsGeometry();
    lines.empty = ends.length === 0;
    lines.geometry.setPositions(lines.empty ? [0, 0, 0, 0, 0, 0] : ends);
  }

  // From where a place was seen again to where it had been seen.
  makeClosures() {
    const ends = [];
    for (const { frame, with: earlier } of this.data.closures) {
      const a = this.world.at[frame], b = this.world.at[earlier];
      if (a >= 0 && b >= 0) ends.push(...this.position(a).toArray(), ...this.position(b).toArray());
    }
    this.closures = this.thickLines(ends, 4);
    this.closures.renderOrder = 2;
    this.root.add(this.closures);
  }

  // Frames of this world that were posed after it was drawn: [frame, x y z, qx qy qz qw] each.
  extend(frames) {
    this.tail.push(...frames);
    const { index, count } = this.world, ends = [];
    let before = count > 0 ? [index[count - 1], ...this.position(count - 1).toArray()] : null;
    for (const pose of this.tail) {
      if (before && pose[0] - before[0] === 1) ends.push(...before.slice(1, 4), ...pose.slice(1, 4));
      before = pose;
    }
    this.setEnds(this.tailPath, ends);
    this.apply();
  }

  camerasOf(i) {
    const lens = this.world.lens[i], { cameras, lenses } = this.data;
    return lens >= 0 ? [lenses[lens]] : cameras;
  }

  // Lines of all cameras of frame i, in the world.
  frustum(i, size, lines, step) {
    this.frustumAt(this.camerasOf(i), this.position(i), this.rotation(i), size, lines, step);
  }

  // `step`: every which direction of the border is drawn, 1, 2, 3 or 6.
  frustumAt(all, t, q, size, lines, step = 1) {
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

  frustumLines(frames, size) {
    const lines = [];
    const wide = this.data.cameras.concat(this.data.lenses).some(({ directions }) => directions.length !== 24);
    for (const i of frames) this.frustum(i, size, lines, frames.length > PLAIN_FRUSTA && !wide ? 3 : 1);
    return this.thinLines(lines);
  }

  thinLines(lines) {
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(new Float32Array(lines), 3));
    return new LineSegments(geometry, new LineBasicMaterial({ transparent: true, opacity: 0.6 }));
  }

  // Where pixels of a grid look, of the cameras of frame i: their colours tell the place in the image.
  rayLines(i) {
    const q = this.rotation(i), t = this.position(i), ends = [], colours = [], v = new Vector3(), d = new Vector3();
    for (const { rays, grid } of this.camerasOf(i)) {
      for (let k = 0; rays && 6 * k < rays.length; ++k) {
        v.fromArray(rays, 6 * k).applyQuaternion(q).add(t);
        if (Number.isNaN(v.x)) continue;
        d.fromArray(rays, 6 * k + 3).applyQuaternion(q).multiplyScalar(this.frustumSize * 3).add(v);
        ends.push(v.x, v.y, v.z, d.x, d.y, d.z);
        const across = (k % grid[0]) / (grid[0] - 1), down = Math.floor(k / grid[0]) / (grid[1] - 1);
        for (let end = 0; end < 2; ++end) colours.push(across, 0.35, 1 - down);
      }
    }
    const lines = this.thinLines(ends);
    lines.geometry.setAttribute("color", new BufferAttribute(new Float32Array(colours), 3));
    lines.material.vertexColors = true;
    return lines;
  }

  makeCameras() {
    const key = this.world.keyframes.frame;
    this.keyCameras = this.frustumLines(spread(evenly(key.length, MOST_FRUSTA).map((k) => key[k])), this.frustumSize);
    this.nowCamera = this.thickLines([], 2);
    this.nowRays = this.thinLines([]);
    const dot = new SphereGeometry(1, 16, 12);
    this.nowDot = new Mesh(dot, new MeshBasicMaterial());
    this.nowDot.scale.setScalar(this.frustumSize * 0.18);
    this.root.add(this.keyCameras, this.nowCamera, this.nowRays, this.nowDot);
  }

  makeEllipsoids() {
    const key = this.world.keyframes.frame;
    this.ellipsoidFrames = evenly(key.length, MOST_FRUSTA).map((k) => key[k]);
    const material = new MeshLambertMaterial({ transparent: true, opacity: 0.3, depthWrite: false });
    this.ellipsoids = new InstancedMesh(new SphereGeometry(1, 20, 14), material, this.ellipsoidFrames.length);
    this.nowEllipsoid = new InstancedMesh(new SphereGeometry(1, 32, 20), material, 1);
    this.ellipsoids.frustumCulled = this.nowEllipsoid.frustumCulled = false;
    this.root.add(this.ellipsoids, this.nowEllipsoid);
    this.placeEllipsoids();
  }

  ellipsoidMatrix(i) {
    const r = root(this.world.covariance, i), s = NINETY * this.exaggeration, p = this.position(i);
    // prettier-ignore
    return new Matrix4().set(s * r.a, 0, 0, p.x,  s * r.b, s * r.e, 0, p.y,  s * r.d, s * r.g, s * r.h, p.z,  0, 0, 0, 1);
  }

  placeEllipsoids() {
    this.ellipsoidFrames.forEach((i, k) => this.ellipsoids.setMatrixAt(k, this.ellipsoidMatrix(i)));
    this.ellipsoids.instanceMatrix.needsUpdate = true;
    if (this.now >= 0) this.nowEllipsoid.setMatrixAt(0, this.ellipsoidMatrix(this.now));
    this.nowEllipsoid.instanceMatrix.needsUpdate = true;
    this.dirty = true;
  }

  makeGrid({ reach, floor }) {
    this.grid?.dispose();
    this.grid?.removeFromParent();
    const cell = 10 ** Math.floor(Math.log10(reach)), cells = Math.min(60, Math.ceil((6 * reach) / cell));
    this.cell = cell;
    this.grid = new GridHelper(cell * cells, cells);
    this.grid.material.vertexColors = false;
    const middle = this.root.localToWorld(this.middle.clone());
    this.grid.position.set(middle.x, floor, middle.z);
    this.scene.add(this.grid);
  }

  setTheme(name) {
    this.theme = THEMES[name];
    this.scene.background = new Color(this.theme.background);
    if (this.world) this.colour();
    this.dirty = true;
  }

  colour() {
    const t = this.theme;
    this.grid.material.color.set(t.grid);
    for (const path of [this.path, this.coarsePath]) path.material.color.set(t.path);
    this.tailPath.material.color.set(t.path);
    this.closures.material.color.set(t.closure);
    this.keyCameras.material.color.set(t.key);
    this.nowCamera.material.color.set(t.now);
    this.nowDot.material.color.set(t.now);
    this.ellipsoids.material.color.set(t.ellipsoid);
  }

  apply() {
    const s = this.shown, there = this.now >= 0;
    this.points.visible = s.points;
    if (this.surface) this.surface.visible = s.surface;
    Object.assign(this.points.material.uniforms.size, { value: this.pointSize });
    this.points.material.uniforms.ratio.value = this.renderer.getPixelRatio();
    this.points.material.uniforms.reference.value = this.distance || this.reach;
    this.tailPath.visible = s.path && !this.tailPath.empty;
    this.closures.visible = s.closures && !this.closures.empty;
    this.nowRays.visible = s.rays && there;
    this.keyCameras.visible = s.cameras;
    this.nowCamera.visible = this.nowDot.visible = there;
    this.ellipsoids.visible = s.ellipsoids;
    this.nowEllipsoid.visible = s.ellipsoids && there;
    this.grid.visible = s.grid;
    this.dirty = true;
  }

  // Frame `i` of the world, -1 where the frame at hand has no pose in it.
  seek(i) {
    this.now = i;
    if (i >= 0) {
      this.placeNow(this.position(i), this.rotation(i), this.camerasOf(i));
      this.root.remove(this.nowRays);
      this.nowRays.geometry.dispose();
      this.nowRays = this.rayLines(i);
      this.root.add(this.nowRays);
      this.nowEllipsoid.setMatrixAt(0, this.ellipsoidMatrix(i));
      this.nowEllipsoid.instanceMatrix.needsUpdate = true;
    }
    this.apply();
  }

  placeNow(position, rotation, cameras) {
    const lines = [];
    this.frustumAt(cameras, position, rotation, this.frustumSize * 1.8, lines);
    this.setEnds(this.nowCamera, lines);
    this.nowDot.position.copy(position);
    this.nowPose = [position, rotation];
  }

  // The newest frame that extend() was given.
  seekTail() {
    const pose = this.tail[this.tail.length - 1];
    if (!pose) return this.seek(this.world.count - 1);
    this.now = -1;
    this.placeNow(new Vector3().fromArray(pose, 1), new Quaternion().fromArray(pose, 4), this.data.cameras);
    this.apply();
    this.nowCamera.visible = this.nowDot.visible = true;
  }

  // Places that belong into the picture, in the scene: of the path, and of points that are not far off.
  places() {
    const { count, points } = this.world, p = new Vector3(), path = [], near = [];
    for (let i = 0; i < count; i += Math.max(1, Math.floor(count / 300))) path.push(this.root.localToWorld(this.position(i)));
    const away = (i) => p.fromArray(points.positions, 3 * i).distanceTo(this.middle);
    const some = Array.from({ length: Math.min(points.count, 2000) }, (_, i) => i); // any beginning is spread evenly
    const far = 1.5 * part(some.map(away), 0.8);
    for (const i of some) if (away(i) <= far) near.push(this.root.localToWorld(p.clone()));
    return { path, all: path.concat(near) };
  }

  // From which side the whole is seen: from behind the cameras and above where they mostly look one way.
  side() {
    const ahead = new Vector3(), v = new Vector3(), { count } = this.world;
    for (let i = 0; i < count; ++i) ahead.add(v.set(0, 0, 1).applyQuaternion(this.rotation(i)));
    ahead.divideScalar(count || 1).applyQuaternion(this.root.quaternion).setY(0);
    if (ahead.length() < 0.25) return new Vector3(0.55, 0.8, 1).normalize();
    return ahead.normalize().negate().applyAxisAngle(new Vector3(0, 1, 0), 0.55).setY(0.62).normalize();
  }

  // The whole of it, so near that all but the outermost is in the picture, right of what covers the part `inset` at the left.
  home() {
    this.touched = false;
    const { path, all } = this.places(), to = this.side(), right = new Vector3(0, 1, 0).cross(to).normalize(), up = to.clone().cross(right);
    const tall = Math.tan((this.camera.fov * Math.PI) / 360) * 0.9, whole = tall * this.camera.aspect, wide = whole * (1 - this.inset), v = new Vector3();
    const target = new Vector3();
    let distance = 0;
    for (const axis of ["x", "y", "z"]) target[axis] = (part(all.map((p) => p[axis]), 0.05) + part(all.map((p) => p[axis]), 0.95)) / 2;
    for (let round = 0; round < 4; ++round) {
      const parts = (places) => places.map((p) => v.copy(p).sub(target).dot(to) + Math.max(Math.abs(v.dot(right)) / wide, Math.abs(v.dot(up)) / tall));
      distance = Math.max(part(parts(all), 0.95), ...parts(path), this.reach * 0.05);
      // What is nearer is larger: the middle of what is seen is not that of what is there.
      const seen = all.map((p) => (v.copy(p).sub(target), [v.dot(right) / (distance - v.dot(to)), v.dot(up) / (distance - v.dot(to))]));
      const off = (k) => ((part(seen.map((s) => s[k]), 0.04) + part(seen.map((s) => s[k]), 0.96)) / 2) * distance;
      const [dx, dy] = [off(0), off(1)];
      if (round < 3) target.addScaledVector(right, dx).addScaledVector(up, dy);
    }
    target.addScaledVector(right, -this.inset * whole * distance);
    this.controls.target.copy(target);
    this.camera.position.copy(target).addScaledVector(to, distance);
    this.distance = distance;
    this.apply();
    this.camera.near = this.reach / 500;
    this.camera.far = this.reach * 100;
    this.camera.updateProjectionMatrix();
    this.dirty = true;
  }

  // Behind and above the camera of the frame at hand, looking where it looks.
  trail() {
    if (!this.follow || !this.nowPose) return;
    const [p, q] = this.nowPose, far = this.reach * 0.35;
    const eye = new Vector3(0, -0.35, -1).applyQuaternion(q).multiplyScalar(far).add(p);
    const ahead = new Vector3(0, 0, 1).applyQuaternion(q).multiplyScalar(far).add(p);
    const goal = this.root.localToWorld(eye), target = this.root.localToWorld(ahead);
    if (this.camera.position.distanceTo(goal) > far * 1e-3) this.dirty = true;
    this.camera.position.lerp(goal, 0.15);
    this.controls.target.lerp(target, 0.15);
  }

  resize(width, height) {
    this.renderer.setSize(width, height, false);
    this.width = width;
    this.height = height;
    for (const lines of [this.path, this.coarsePath, this.tailPath, this.closures, this.nowCamera]) lines?.material.resolution.set(width, height);
    this.camera.aspect = width / Math.max(height, 1);
    this.camera.updateProjectionMatrix();
    this.dirty = true;
  }

  // What is nearest to a place of the screen, within some pixels: a point of the map or a camera, in the world.
  pick(x, y, width, height) {
    const matrix = new Matrix4().multiplyMatrices(this.camera.projectionMatrix, this.camera.matrixWorldInverse).multiply(this.root.matrixWorld);
    const p = new Vector3();
    let best = null, least = 12;
    const look = (position) => {
      p.copy(position).applyMatrix4(matrix);
      if (p.z < -1 || p.z > 1) return;
      const distance = Math.hypot(((p.x + 1) / 2) * width - x, ((1 - p.y) / 2) * height - y) + 3 * (p.z + 1);
      if (distance < least) (least = distance), (best = position.clone());
    };
    const at = new Vector3(), { positions } = this.world.points;
    if (this.shown.points) for (let i = 0; i < positions.length; i += 3) look(at.fromArray(positions, i));
    for (let i = 0; i < this.world.count; ++i) look(this.position(i, at));
    return best;
  }

  mark(places) {
    this.marks.clear();
    const material = new MeshBasicMaterial({ color: "#e5484d", depthTest: false });
    for (const place of places) {
      const ball = new Mesh(new SphereGeometry(this.frustumSize * 0.12, 12, 8), material);
      ball.position.copy(place);
      ball.renderOrder = 2;
      this.marks.add(ball);
    }
    if (places.length === 2) {
      const line = new Line(new BufferGeometry().setFromPoints(places), new LineBasicMaterial({ color: "#e5484d", depthTest: false }));
      line.renderOrder = 2;
      this.marks.add(line);
    }
    this.dirty = true;
  }

  // Where a place is on the screen.
  onScreen(place, width, height) {
    const p = this.root.localToWorld(place.clone()).project(this.camera);
    return { x: ((p.x + 1) / 2) * width, y: ((1 - p.y) / 2) * height, inFront: p.z < 1 };
  }

  // How much is drawn, at `now` in milliseconds: all when nothing moves, else as much as leaves it fluent.
  thin(now) {
    const moving = now - this.moved < 150, { count } = this.world.points, between = now - (this.drawn ?? now);
    if (moving && between > SLOW) this.detail = Math.max(this.detail * 0.8, Math.min(1, LEAST_POINTS / count));
    else if (moving && between < FLUENT) this.detail = Math.min(1, this.detail * 1.03);
    const part = moving ? this.detail : 1;
    const wanted = Math.ceil(part * count), plain = part < 0.5 && this.shown.path;
    if (this.points.geometry.drawRange.count !== wanted) this.dirty = true;
    this.points.geometry.setDrawRange(0, wanted);
    this.keyCameras.geometry.setDrawRange(0, Math.ceil(part * this.keyCameras.geometry.attributes.position.count));
    this.coarsePath.visible = plain && !this.coarsePath.empty;
    this.path.visible = this.shown.path && !plain && !this.path.empty;
  }

  draw(now = performance.now()) {
    this.trail();
    this.controls.update();
    if (this.dirty) this.moved = now;
    this.thin(now);
    const wanted = this.dirty;
    if (wanted) this.renderer.render(this.scene, this.camera);
    this.dirty = false;
    this.drawn = now;
    return wanted;
  }
}
