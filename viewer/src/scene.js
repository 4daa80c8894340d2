// The world in three dimensions: points, path, cameras, ellipsoids.
import {
  AmbientLight, BufferAttribute, BufferGeometry, Color, DirectionalLight, GridHelper, Group, InstancedMesh, Line, LineBasicMaterial,
  LineSegments, Matrix4, Mesh, MeshBasicMaterial, MeshLambertMaterial, PerspectiveCamera, Points, PointsMaterial, Quaternion, Scene,
  SphereGeometry, Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";

const NINETY = Math.sqrt(6.251388631); // 90 % of a normal distribution in space lie within so many standard deviations
const MOST_FRUSTA = 400; // of key frames that are drawn
const THEMES = {
  light: { background: "#f6f7f9", grid: "#d5d9e0", path: "#1f6feb", frustum: "#8a94a6", key: "#d9480f", now: "#0b7a3b", ellipsoid: "#c026d3" },
  dark: { background: "#0e1116", grid: "#262d38", path: "#58a6ff", frustum: "#5a6578", key: "#ff922b", now: "#3fdd78", ellipsoid: "#e879f9" },
};

// Lower triangular root of a covariance: it takes the unit sphere to the ellipsoid of one standard deviation.
function root(c, i) {
  const [xx, xy, xz, yy, yz, zz] = c.subarray(6 * i, 6 * i + 6);
  const a = Math.sqrt(Math.max(xx, 0)), safe = (top, bottom) => (bottom > 0 ? top / bottom : 0);
  const b = safe(xy, a), d = safe(xz, a);
  const e = Math.sqrt(Math.max(yy - b * b, 0));
  const g = safe(yz - b * d, e);
  return { a, b, d, e, g, h: Math.sqrt(Math.max(zz - d * d - g * g, 0)) };
}

const evenly = (count, most) => {
  const kept = Math.min(count, most);
  return Array.from({ length: kept }, (_, i) => Math.floor((i * count) / kept));
};

export class World3d {
  constructor(canvas, data) {
    this.data = data;
    this.renderer = new WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(50, 1, 0.01, 1e6);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableDamping = true;
    this.controls.dampingFactor = 0.15;
    this.root = new Group();
    this.root.rotation.x = Math.PI; // y down and z forward become y up and z towards us
    this.scene.add(this.root, new AmbientLight(0xffffff, 1.6));
    const sun = new DirectionalLight(0xffffff, 1.8);
    sun.position.set(1, 3, 2);
    this.scene.add(sun);
    this.shown = { points: true, path: true, cameras: true, ellipsoids: false, grid: true };
    this.pointSize = 3;
    this.exaggeration = 1;
    this.follow = false;
    this.dirty = true;
    this.controls.addEventListener("change", () => (this.dirty = true));
  }

  show(world) {
    this.world = world;
    this.root.clear();
    const size = this.measure();
    this.frustumSize = size.reach * 0.03;
    this.makePoints();
    this.makePath();
    this.makeCameras();
    this.makeEllipsoids();
    this.makeGrid(size);
    this.marks = new Group();
    this.root.add(this.marks);
    this.colour();
    this.apply();
    this.home();
  }

  // The middle of the path and how far things reach.
  measure() {
    const { pose, count } = this.world;
    const low = new Vector3(Infinity, Infinity, Infinity), high = low.clone().negate(), p = new Vector3();
    for (let i = 0; i < count; ++i) low.min(p.fromArray(pose, 7 * i)), high.max(p.fromArray(pose, 7 * i));
    const middle = low.clone().add(high).multiplyScalar(0.5);
    const distances = [];
    const { positions } = this.world.points;
    const step = 3 * Math.max(1, Math.floor(positions.length / 9000));
    for (let i = 0; i < positions.length; i += step) distances.push(p.fromArray(positions, i).distanceTo(middle));
    distances.sort((a, b) => a - b);
    const path = low.distanceTo(high), points = distances[Math.floor(distances.length / 2)] || 0;
    const floor = [];
    for (let i = 1; i < positions.length; i += step) floor.push(positions[i]);
    floor.sort((a, b) => a - b);
    this.middle = middle;
    this.reach = Math.max(path * 0.6, points, 1e-6);
    return { reach: this.reach, floor: floor.length ? floor[Math.floor(floor.length * 0.97)] : high.y };
  }

  makePoints() {
    const { positions, colours } = this.world.points;
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(positions, 3));
    const linear = new Float32Array(colours.length), colour = new Color();
    for (let i = 0; i < colours.length; i += 3) {
      colour.setRGB(colours[i] / 255, colours[i + 1] / 255, colours[i + 2] / 255, "srgb").toArray(linear, i);
    }
    geometry.setAttribute("color", new BufferAttribute(linear, 3));
    this.points = new Points(geometry, new PointsMaterial({ vertexColors: true, sizeAttenuation: false }));
    this.root.add(this.points);
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
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(new Float32Array(ends), 3));
    this.path = new LineSegments(geometry, new LineBasicMaterial());
    this.root.add(this.path);
  }

  // Lines of all cameras of frame i, in the world.
  frustum(i, size, lines) {
    const { lens } = this.world, q = this.rotation(i), t = this.position(i), { cameras, lenses } = this.data;
    const all = lens[i] >= 0 ? [lenses[lens[i]]] : cameras;
    const corner = new Vector3(), before = new Vector3(), apex = new Vector3();
    for (const { position, directions } of all) {
      if (!directions.length) continue;
      apex.fromArray(position).applyQuaternion(q).add(t);
      const at = (k, to) => to.fromArray(directions[k % directions.length]).multiplyScalar(size).applyQuaternion(q).add(apex);
      for (let k = 0; k < directions.length; ++k) {
        at(k, before);
        at(k + 1, corner);
        lines.push(before.x, before.y, before.z, corner.x, corner.y, corner.z);
        if (k % 6 === 0) lines.push(apex.x, apex.y, apex.z, before.x, before.y, before.z);
      }
    }
  }

  frustumLines(frames, size) {
    const lines = [];
    for (const i of frames) this.frustum(i, size, lines);
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(new Float32Array(lines), 3));
    return new LineSegments(geometry, new LineBasicMaterial({ transparent: true, opacity: 0.6 }));
  }

  makeCameras() {
    const key = this.world.keyframes.frame;
    this.keyCameras = this.frustumLines(evenly(key.length, MOST_FRUSTA).map((k) => key[k]), this.frustumSize);
    this.nowCamera = this.frustumLines([], 1);
    const dot = new SphereGeometry(1, 16, 12);
    this.nowDot = new Mesh(dot, new MeshBasicMaterial());
    this.nowDot.scale.setScalar(this.frustumSize * 0.18);
    this.root.add(this.keyCameras, this.nowCamera, this.nowDot);
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
    const cell = 10 ** Math.floor(Math.log10(reach)), cells = Math.min(60, Math.ceil((6 * reach) / cell));
    this.cell = cell;
    this.grid = new GridHelper(cell * cells, cells);
    this.grid.material.vertexColors = false;
    this.grid.position.set(this.middle.x, floor, this.middle.z);
    this.root.add(this.grid);
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
    this.path.material.color.set(t.path);
    this.keyCameras.material.color.set(t.key);
    this.nowCamera.material.color.set(t.now);
    this.nowDot.material.color.set(t.now);
    this.ellipsoids.material.color.set(t.ellipsoid);
  }

  apply() {
    const s = this.shown, there = this.now >= 0;
    this.points.visible = s.points;
    this.points.material.size = this.pointSize * this.renderer.getPixelRatio();
    this.path.visible = s.path;
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
      this.root.remove(this.nowCamera);
      this.nowCamera.geometry.dispose();
      this.nowCamera = this.frustumLines([i], this.frustumSize * 1.8);
      this.nowCamera.material.color.set(this.theme.now);
      this.nowCamera.material.opacity = 1;
      this.root.add(this.nowCamera);
      this.position(i, this.nowDot.position);
      this.nowEllipsoid.setMatrixAt(0, this.ellipsoidMatrix(i));
      this.nowEllipsoid.instanceMatrix.needsUpdate = true;
    }
    this.apply();
  }

  // The whole path from above and behind.
  home() {
    const middle = this.root.localToWorld(this.middle.clone());
    this.controls.target.copy(middle);
    const away = new Vector3(0.55, 0.8, 1).normalize().multiplyScalar(this.reach * 1.7);
    this.camera.position.copy(middle).add(away);
    this.camera.near = this.reach / 500;
    this.camera.far = this.reach * 100;
    this.camera.updateProjectionMatrix();
    this.dirty = true;
  }

  // Behind and above the camera of the frame at hand, looking where it looks.
  trail() {
    if (!this.follow || !(this.now >= 0)) return;
    const q = this.rotation(this.now), p = this.position(this.now), far = this.reach * 0.35;
    const eye = new Vector3(0, -0.35, -1).applyQuaternion(q).multiplyScalar(far).add(p);
    const ahead = new Vector3(0, 0, 1).applyQuaternion(q).multiplyScalar(far).add(p);
    const goal = this.root.localToWorld(eye), target = this.root.localToWorld(ahead);
    if (this.camera.position.distanceTo(goal) > far * 1e-3) this.dirty = true;
    this.camera.position.lerp(goal, 0.15);
    this.controls.target.lerp(target, 0.15);
  }

  resize(width, height) {
    this.renderer.setSize(width, height, false);
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

  draw() {
    this.trail();
    this.controls.update();
    if (!this.dirty) return false;
    this.dirty = false;
    this.renderer.render(this.scene, this.camera);
    return true;
  }
}
