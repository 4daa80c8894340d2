// The world in three dimensions: points, path, cameras, ellipsoids.
import {
  AmbientLight, BufferAttribute, BufferGeometry, Color, DirectionalLight, GridHelper, Group, Line, LineBasicMaterial, Matrix4, Mesh,
  MeshBasicMaterial, PerspectiveCamera, Quaternion, Scene, SphereGeometry, Spherical, SRGBColorSpace, TextureLoader, Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { addFrustum, evenly, rayLines, spread } from "./cameras.js";
import { ellipsoidMaterial, ellipsoidMatrix, ellipsoids } from "./ellipsoids.js";
import { extentOf, overview, upOf } from "./framing.js";
import { flatMaterial, pathEnds, setEnds, thickLines, thinLines } from "./lines.js";
import { areGrey, heightColours, heightRange, pointCloud, setPoints } from "./points.js";

const MOST_FRUSTA = 400; // of key frames that are drawn
// Milliseconds from picture to picture while the view moves, on average: above the first less is drawn, below the second more.
const SLOW = 1000 / 32, FLUENT = 1000 / 40;
const LEAST_POINTS = 8000; // that are drawn while the view moves, however slow the machine
const FIRST_POINTS = 30000; // by a processor, before it is known how fast that is
const COARSE_PATH = 300; // pieces of the path then
const STILL = 150; // milliseconds without a movement
// Lines of a frustum cost a processor that draws by itself as much as a hundred points.
const PLAIN_FRUSTA = 100; // beyond so many they have fewer lines
const THEMES = {
  light: { background: "#f6f7f9", grid: "#d5d9e0", path: "#1f6feb", key: "#d9480f", now: "#0b7a3b", ellipsoid: "#c026d3", closure: "#c2255c" },
  dark: { background: "#0e1116", grid: "#262d38", path: "#58a6ff", key: "#ff922b", now: "#3fdd78", ellipsoid: "#e879f9", closure: "#ff6b9d" },
};

// Whether a processor draws by itself only a context tells; where a graphics card does, the canvas gives way to one with smooth edges.
function rendererOn(canvas) {
  const rough = canvas.getContext("webgl2", { antialias: false }), info = rough?.getExtension("WEBGL_debug_renderer_info");
  const software = Boolean(info) && /swiftshader|llvmpipe|software/i.test(rough.getParameter(info.UNMASKED_RENDERER_WEBGL));
  if (!software) {
    rough?.getExtension("WEBGL_lose_context")?.loseContext();
    const before = canvas;
    canvas = before.cloneNode();
    before.replaceWith(canvas);
  }
  const renderer = new WebGLRenderer(software ? { canvas, context: rough } : { canvas, antialias: true });
  renderer.debug.checkShaderErrors = false; // to ask for them is to wait for programs to be ready
  return { renderer, software };
}

const pixelRatio = () => Math.min(devicePixelRatio, 2);

export class World3d {
  constructor(data) {
    this.data = data;
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(50, 1, 0.01, 1e6);
    this.target = new Vector3(); // what is looked at
    this.root = new Group();
    this.scene.add(this.root, new AmbientLight(0xffffff, 1.6));
    const sun = new DirectionalLight(0xffffff, 1.8);
    sun.position.set(1, 3, 2);
    this.scene.add(sun);
    this.shown = { surface: true, points: !data.mesh, path: true, cameras: true, closures: true, ellipsoids: false, rays: false, grid: true };
    this.pointSize = 3;
    this.moved = -Infinity; // when it last did, milliseconds
    this.between = SLOW; // milliseconds from picture to picture while it moves, on average
    this.idle = 0; // the same while nothing is drawn: what the screen does
    this.exaggeration = 1;
    this.inset = 0;
    this.follow = false;
    this.dirty = true;
    this.touched = false; // by somebody who looks from where he likes
  }

  // What draws it, on `canvas` or what takes its place, as large as it has to be. It comes after all else, which need not wait for it.
  connect(canvas) {
    [canvas.width, canvas.height] = [this.width, this.height].map((side) => Math.floor(side * pixelRatio()));
    Object.assign(this, rendererOn(canvas));
    this.renderer.setDrawingBufferSize(this.width, this.height, this.ratio);
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    Object.assign(this.controls, { target: this.target, enableDamping: true, dampingFactor: 0.15 });
    this.controls.addEventListener("change", () => (this.dirty = true));
    this.controls.addEventListener("start", () => (this.touched = true));
    this.begin();
  }

  // The first picture is one of those while the view moves.
  begin() {
    this.detail = this.software ? Math.min(1, FIRST_POINTS / (this.world.points.count || 1)) : 1;
    this.first = true;
  }

  // `keep`: the view stays where it is.
  show(world, keep = false) {
    this.world = world;
    this.root.traverse((object) => object.geometry?.dispose());
    this.root.clear();
    this.level();
    const { middle, reach, floor } = extentOf(world, this.up);
    Object.assign(this, { middle, reach, frustumSize: this.sizeOfFrusta(reach), nowSize: 0.06 * reach });
    if (!keep) this.pointSize = Math.max(1.5, Math.min(5, 4.5 * (8000 / (world.points.count || 1)) ** 0.4));
    this.makePoints();
    this.makeSurface();
    this.makePath();
    this.makeClosures();
    this.makeCameras();
    this.makeEllipsoids();
    this.makeGrid(floor);
    this.marks = new Group();
    this.root.add(this.marks);
    this.tail = [];
    this.begin();
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

  // In proportion to the whole, but where there are many no longer than twice from one to the next: they would hide the map.
  sizeOfFrusta(reach) {
    const { keyframes: { frame }, pose } = this.world, kept = Math.min(frame.length, MOST_FRUSTA), a = new Vector3(), b = new Vector3();
    let path = 0;
    for (let k = 1; k < frame.length; ++k) path += a.fromArray(pose, 7 * frame[k]).distanceTo(b.fromArray(pose, 7 * frame[k - 1]));
    if (kept <= PLAIN_FRUSTA) return 0.045 * reach;
    return Math.max(0.006 * reach, Math.min(0.03 * reach, (2 * path) / kept));
  }

  makePoints() {
    const { positions, colours } = this.world.points;
    this.points = pointCloud();
    this.byHeight = this.byHeight ?? areGrey(colours);
    this.heights = heightRange(positions, this.up);
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
    this.fillPoints();
    this.dirty = true;
  }

  // All that are there. It is no movement: they are drawn at once.
  fillPoints() {
    const { positions, colours } = this.world.points;
    setPoints(this.points, positions, this.byHeight ? heightColours(positions, this.up, this.heights) : colours);
  }

  position(i, to = new Vector3()) {
    return to.fromArray(this.world.pose, 7 * i);
  }
  rotation(i, to = new Quaternion()) {
    return to.fromArray(this.world.pose, 7 * i + 3);
  }

  makePath() {
    this.path = thickLines(pathEnds(this.world), 3);
    this.coarsePath = thickLines(pathEnds(this.world, Math.max(1, Math.ceil(this.world.count / COARSE_PATH))), 3);
    // Over the points, which would hide it.
    for (const path of [this.path, this.coarsePath]) path.renderOrder = 1, (path.material.depthTest = false);
    this.tailPath = thickLines([], 3);
    this.root.add(this.path, this.coarsePath, this.tailPath);
  }

  // From where a place was seen again to where it had been seen.
  makeClosures() {
    const ends = [];
    for (const { frame, with: earlier } of this.data.closures) {
      const a = this.world.at[frame], b = this.world.at[earlier];
      if (a >= 0 && b >= 0) ends.push(...this.position(a).toArray(), ...this.position(b).toArray());
    }
    this.closures = thickLines(ends, 4);
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
    setEnds(this.tailPath, ends);
    this.apply();
  }

  camerasOf(i) {
    const lens = this.world.lens[i], { cameras, lenses } = this.data;
    return lens >= 0 ? [lenses[lens]] : cameras;
  }

  makeCameras() {
    const key = this.world.keyframes.frame, frames = spread(evenly(key.length, MOST_FRUSTA).map((k) => key[k])), lines = [];
    const wide = this.data.cameras.concat(this.data.lenses).some(({ directions }) => directions.length !== 24);
    const step = frames.length > PLAIN_FRUSTA && !wide ? 3 : 1;
    for (const i of frames) addFrustum(this.camerasOf(i), this.position(i), this.rotation(i), this.frustumSize, lines, step);
    this.keyCameras = thinLines(lines);
    this.nowCamera = thickLines([], 2);
    this.nowRays = thinLines([]);
    this.raysAt = -1;
    this.nowDot = new Mesh(new SphereGeometry(1, 16, 12), flatMaterial());
    this.nowDot.scale.setScalar(0.1 * this.nowSize);
    this.root.add(this.keyCameras, this.nowCamera, this.nowRays, this.nowDot);
  }

  makeEllipsoids() {
    const key = this.world.keyframes.frame, material = ellipsoidMaterial();
    this.ellipsoidFrames = evenly(key.length, MOST_FRUSTA).map((k) => key[k]);
    this.ellipsoids = ellipsoids(this.ellipsoidFrames.length, 20, material);
    this.nowEllipsoid = ellipsoids(1, 32, material);
    this.root.add(this.ellipsoids, this.nowEllipsoid);
    this.placeEllipsoids();
  }

  ellipsoidMatrix(i) {
    return ellipsoidMatrix(this.world, i, this.exaggeration);
  }

  placeEllipsoids() {
    this.ellipsoidFrames.forEach((i, k) => this.ellipsoids.setMatrixAt(k, this.ellipsoidMatrix(i)));
    this.ellipsoids.instanceMatrix.needsUpdate = true;
    if (this.now >= 0) this.nowEllipsoid.setMatrixAt(0, this.ellipsoidMatrix(this.now));
    this.nowEllipsoid.instanceMatrix.needsUpdate = true;
    this.dirty = true;
  }

  makeGrid(floor) {
    this.grid?.dispose();
    this.grid?.removeFromParent();
    const { reach } = this, power = 10 ** Math.floor(Math.log10(0.4 * reach));
    const cell = power * [5, 2, 1].find((digit) => digit * power <= 0.4 * reach), cells = Math.ceil((6 * reach) / cell);
    this.cell = cell;
    this.grid = new GridHelper(cell * cells, cells);
    this.grid.material.dispose();
    this.grid.material = flatMaterial();
    const middle = this.root.localToWorld(this.middle.clone());
    this.grid.position.set(middle.x, floor, middle.z);
    this.scene.add(this.grid);
  }

  setTheme(name) {
    this.theme = THEMES[name];
    for (const [what, colour] of Object.entries(this.theme)) document.documentElement.style.setProperty(`--${what}`, colour);
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
    this.points.material.uniforms.size.value = this.pointSize * Math.max(0.6, Math.min(1.4, Math.min(this.width, this.height) / 620 || 1));
    this.points.material.uniforms.ratio.value = pixelRatio();
    this.points.material.uniforms.reference.value = this.distance || this.reach;
    this.tailPath.visible = s.path && !this.tailPath.empty;
    this.closures.visible = s.closures && !this.closures.empty;
    this.placeRays();
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
      this.nowEllipsoid.setMatrixAt(0, this.ellipsoidMatrix(i));
      this.nowEllipsoid.instanceMatrix.needsUpdate = true;
    }
    this.apply();
  }

  // Rays of the frame at hand, which are many lines: only where they are seen.
  placeRays() {
    if (!this.shown.rays || !(this.now >= 0) || this.raysAt === this.now) return;
    this.raysAt = this.now;
    this.root.remove(this.nowRays);
    this.nowRays.geometry.dispose();
    this.nowRays = rayLines(this.camerasOf(this.now), this.position(this.now), this.rotation(this.now), 2.5 * this.nowSize);
    this.root.add(this.nowRays);
  }

  placeNow(position, rotation, cameras) {
    const lines = [];
    addFrustum(cameras, position, rotation, this.nowSize, lines);
    setEnds(this.nowCamera, lines);
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

  // The whole of it.
  home() {
    this.touched = false;
    const { target, to, distance } = overview(this.world, this.middle, 0.3 * this.reach, this.root, this.camera, this.inset);
    this.target.copy(target);
    this.camera.position.copy(target).addScaledVector(to, distance);
    this.distance = distance;
    this.apply();
    this.camera.near = this.reach / 500;
    this.camera.far = this.reach * 100;
    this.camera.updateProjectionMatrix();
    this.dirty = true;
  }

  // Without a mouse: the eye goes around what it looks at, radians to the right and upwards, and `nearer` times as near.
  turn(right, upwards, nearer = 1) {
    this.touched = true;
    const { target, camera: { position } } = this;
    const at = new Spherical().setFromVector3(position.clone().sub(target));
    at.theta += right;
    at.phi -= upwards;
    at.radius /= nearer;
    position.setFromSpherical(at.makeSafe()).add(target);
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
    this.target.lerp(target, 0.15);
  }

  resize(width, height) {
    const ratio = pixelRatio();
    if (width === this.width && height === this.height && ratio === this.ratio) return;
    this.renderer?.setDrawingBufferSize(width, height, ratio);
    Object.assign(this, { width, height, ratio });
    this.camera.aspect = width / Math.max(height, 1);
    this.camera.updateProjectionMatrix();
    if (this.world) this.apply();
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
      const ball = new Mesh(new SphereGeometry(0.07 * this.nowSize, 12, 8), material);
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
    const moving = now - this.moved < STILL, { count, positions } = this.world.points;
    if (moving) this.pace(now - (this.drawn ?? now), count);
    const part = moving ? this.detail : 1, wanted = Math.min(Math.ceil(part * count), positions.length / 3);
    const plain = moving && this.software && this.shown.path && !this.coarsePath.empty;
    if (this.points.geometry.drawRange.count !== wanted) this.dirty = true;
    this.points.geometry.setDrawRange(0, wanted);
    this.keyCameras.geometry.setDrawRange(0, Math.ceil(part * this.keyCameras.geometry.attributes.position.count));
    this.coarsePath.visible = plain;
    this.path.visible = this.shown.path && !plain && !this.path.empty;
    this.whole = !moving;
  }

  // The picture before took `took` milliseconds. That of the whole says nothing of the next.
  pace(took, count) {
    if (this.whole) return;
    this.between += 0.2 * (Math.min(took, 4 * SLOW) - this.between);
    // A screen of 30 pictures a second shows no more of them for fewer points.
    if (this.between > Math.max(SLOW, 1.2 * this.idle)) this.detail = Math.max(this.detail * 0.93, Math.min(1, LEAST_POINTS / count));
    else if (this.between < Math.max(FLUENT, 1.1 * this.idle)) this.detail = Math.min(1, this.detail * 1.04);
  }

  draw(now = performance.now()) {
    this.trail();
    this.controls.update();
    if (this.dirty) this.moved = now;
    this.thin(now);
    const wanted = this.dirty;
    if (wanted) this.renderer.render(this.scene, this.camera);
    else if (now > this.drawn) this.idle += 0.1 * (Math.min(now - this.drawn, 2 * SLOW) - this.idle);
    this.dirty = false;
    this.drawn = now;
    if (wanted && this.first) {
      // So much at once; the rest need not wait.
      this.first = false;
      this.moved = -Infinity;
    }
    return wanted;
  }
}
