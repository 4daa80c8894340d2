// Ties the view, the plots and the controls together.
import { digits, readData } from "./data.js";
import { Live } from "./live.js";
import { Pictures } from "./pictures.js";
import { Plots } from "./plots.js";
import { World3d } from "./scene.js";

let data = readData();
const $ = (id) => document.getElementById(id);
// `newest`: of a run under way, the newest frame is shown whenever there is one.
const state = { frame: 0, world: 0, playing: false, measuring: false, places: [], theme: "light", live: data.live, newest: data.live };
let view, plots, pictures;

// Text goes in as text: names may hold anything.
function element(tag, properties = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}

const world = () => data.worlds[state.world];
const length = (x) => (world().metric ? `${digits(x)} m` : `${digits(x)} units`);

function facts() {
  const w = world(), p = w.points;
  let path = 0;
  for (let i = 1; i < w.count; ++i) {
    if (w.index[i] - w.index[i - 1] === 1) path += view.position(i).distanceTo(view.position(i - 1));
  }
  const rows = [
    ["command", data.command],
    ["with a pose", `${data.posed} of ${data.total} frames`],
    ["key frames", String(w.keyframes.frame.length)],
    ["points", p.count < p.all ? `${p.all}, ${p.count} of them shown` : String(p.all)],
    ["path", length(path)],
    ["scale", w.metric ? "metric" : "arbitrary"],
  ];
  if (p.far > 0) rows.push(["far points", `${p.far} not shown`]);
  if (w.metric && w.scaleSigma) rows.push(["scale known to", `${digits(100 * w.scaleSigma)} %`]);
  if (data.rms > 0) rows.push(["reprojection", `${digits(data.rms)} px rms`]);
  if (data.cameras.length) rows.push(["cameras", data.cameras.map((c) => c.name || "camera").join(", ")]);
  if (data.lenses.length === 1 && data.lenses[0].focal) rows.push(["focal length", `${digits(data.lenses[0].focal[0])} px`]);
  if (data.lenses.length > 1) rows.push(["lenses", String(data.lenses.length)]);
  return element("dl", {}, ...rows.flatMap(([name, value]) => [element("dt", { textContent: name }), element("dd", { textContent: value })]));
}

const TOGGLES = [
  ...(data.mesh ? [["surface", "S", "surface"]] : []),
  ["points", "P", "points"], ["path", "L", "path"], ["cameras", "C", "key frames"], ["closures", "O", "closures"],
  ["ellipsoids", "E", "90 % ellipsoids"], ["rays", "R", "rays of the camera"], ["grid", "G", "grid"],
];

function toggle(name) {
  view.shown[name] = !view.shown[name];
  view.apply();
  $(`show-${name}`).checked = view.shown[name];
}

function colourByHeight(on) {
  view.byHeight = on;
  view.colourPoints();
  $("heights").checked = on;
}

function togglePictures() {
  if (!pictures) return;
  pictures.shown = !pictures.shown;
  view.inset = pictures.shown ? 0.3 : 0;
  if (state.newest) showNewest();
  else seek(state.frame);
}

// Of a run that has ended.
function endPictures() {
  pictures?.end();
  pictures = undefined;
  if (view) view.inset = 0;
}

// A list whose entries go to a frame.
function frameList(id, title, entries) {
  if (!entries.length) return [];
  const items = entries.slice(0, 200).map(([frame, bold, text]) =>
    element("li", { onclick: () => seek(frame) }, element("b", { textContent: bold }), ` ${text}`));
  return [element("h2", { textContent: title }), element("ul", { id, className: "frames" }, ...items)];
}

const closures = () => data.closures.map((c) => [c.frame, `${c.frame}`,
  `${c.joined ? "joins the world of" : "sees what was seen in"} ${c.with < 0 ? "an earlier run" : c.with}, ${c.inliers} points`]);
const runText = (run) => (run.first === run.last ? `${run.first}` : `${run.first} to ${run.last}`);
const missing = () => data.missing.map((run) => [run.first, runText(run), run.reason]);
const held = () => data.held.map((run) => [run.first, runText(run), "where it is, is not known"]);

// Mean time of each stage of the run, as bars.
function stageTimes() {
  const stages = data.stages.filter((s) => s.mean > 0);
  if (!stages.length) return [];
  const total = (s) => s.mean * s.count, most = Math.max(...stages.filter((s) => s.name !== "frame").map(total), 1e-9);
  const rows = stages.map((s) => {
    const bar = element("i");
    bar.style.width = `${Math.min(100, (100 * total(s)) / most)}%`;
    const title = `${s.count} times, ${digits(s.mean)} ms on average, ${digits(s.max)} ms at most`;
    return element("div", { title }, element("span", { textContent: s.name }), element("b", {}, bar), element("output", { textContent: `${digits(s.mean)} ms` }));
  });
  return [element("h2", { textContent: "time per stage" }), element("div", { id: "stages" }, ...rows)];
}

function side() {
  const box = $("side");
  box.replaceChildren(element("h1", { textContent: data.title, title: data.title }));
  if (data.worlds.length > 1) {
    const options = data.worlds.map((w, i) => element("option", { value: i, textContent: `${i === 0 ? "main world" : `world ${i}`}, ${w.count} frames` }));
    const select = element("select", { id: "world", onchange: () => showWorld(Number(select.value)) }, ...options);
    select.value = state.world;
    box.append(select);
  }
  box.append(facts());
  const switches = TOGGLES.map(([name, key, label]) =>
    element("label", {}, element("input", { type: "checkbox", id: `show-${name}`, checked: view.shown[name], onchange: () => toggle(name) }),
      element("span", { textContent: label }), element("kbd", { textContent: key })));
  const factor = element("select", { id: "exaggeration", onchange: () => exaggerate(Number(factor.value)) },
    ...[1, 10, 100, 1000].map((x) => element("option", { value: x, textContent: x === 1 ? "true size" : `${x} times as large` })));
  factor.value = view.exaggeration;
  box.append(element("div", { className: "switches" }, ...switches, element("label", {}, element("span", { textContent: "ellipsoids" }), factor),
    element("label", {}, element("input", { type: "checkbox", id: "heights", checked: view.byHeight, onchange: (e) => colourByHeight(e.target.checked) }),
      element("span", { textContent: "colour by height" }), element("kbd", { textContent: "K" }))));
  const button = (id, text, key, act) => element("button", { id, onclick: act }, text, element("kbd", { textContent: key }));
  box.append(element("div", { className: "buttons" }, button("follow", "follow", "F", toggleFollow), button("home", "overview", "H", home),
    button("measure", "measure", "M", toggleMeasure), button("theme", "theme", "T", toggleTheme), button("keys", "keys", "?", () => $("help").showModal())));
  box.append(...frameList("missing", "without a pose", missing()), ...frameList("held", "only seen to turn", held()), ...frameList("closures", "places seen again", closures()), ...stageTimes());
}

function bar() {
  const slider = element("input", { id: "slider", type: "range", min: 0, max: Math.max(0, data.total - 1), step: 1, value: 0,
    oninput: () => scrub(Number(slider.value)) });
  slider.setAttribute("aria-label", "frame");
  const play = element("button", { id: "play", textContent: "▶", title: "play (space)", onclick: togglePlay });
  const track = element("div", { className: "track" }, element("canvas", { id: "strip" }), slider);
  $("bar").replaceChildren(play, track, element("output", { id: "now" }));
}

// Which frames have a pose, and which are key frames.
function strip() {
  const canvas = $("strip"), width = (canvas.width = canvas.clientWidth * devicePixelRatio), height = (canvas.height = 6 * devicePixelRatio);
  const context = canvas.getContext("2d"), w = world();
  for (let x = 0; x < width; ++x) {
    const frame = Math.min(data.total - 1, Math.floor((x / width) * data.total));
    context.fillStyle = w.at[frame] >= 0 ? (data.isHeld[frame] ? "#d99a1f" : "#1f6feb") : data.reasons[frame] ? "#d64545" : "#8884";
    context.fillRect(x, 0, 1, height);
  }
}

// By hand: of a run under way, away from its newest frame or back to it.
function scrub(frame) {
  state.newest = state.live && frame >= data.total - 1;
  if (state.newest) showNewest();
  else seek(frame);
}

function seek(frame) {
  state.frame = Math.max(0, Math.min(data.total - 1, Math.round(frame)));
  const w = world(), i = w.at[state.frame];
  view.seek(i);
  plots.seek(state.frame);
  if (state.live) pictures?.say("pictures of a run are of its newest frame");
  else pictures?.want(state.frame);
  $("slider").value = state.frame;
  const parts = [`frame ${state.frame}`];
  if (i >= 0) {
    if (data.command !== "adjust") parts.push(`${w.time[i].toFixed(3)} s`);
    if (w.keyframeAt[state.frame] >= 0) parts.push("key frame");
    if (data.isHeld[state.frame]) parts.push("only seen to turn: its place is not known");
  } else {
    const other = data.worlds.findIndex((o) => o.at[state.frame] >= 0);
    parts.push(other >= 0 ? `in ${other === 0 ? "the main world" : `world ${other}`}` : `no pose: ${data.reasons[state.frame]}`);
  }
  $("now").textContent = parts.join(" · ");
  $("now").className = i >= 0 ? "" : "missing";
}

function togglePlay() {
  state.playing = !state.playing;
  if (state.playing && state.frame >= data.total - 1) seek(0);
  $("play").textContent = state.playing ? "❚❚" : "▶";
}

function toggleFollow() {
  view.follow = !view.follow;
  view.dirty = true;
  $("follow").classList.toggle("on", view.follow);
}

function home() {
  if (view.follow) toggleFollow();
  view.home();
}

function exaggerate(factor) {
  view.exaggeration = factor;
  view.placeEllipsoids();
  if (!view.shown.ellipsoids) toggle("ellipsoids");
}

function toggleMeasure() {
  state.measuring = !state.measuring;
  place([]);
  $("measure").classList.toggle("on", state.measuring);
  $("hint").textContent = state.measuring ? "click two points or cameras" : "";
}

function place(places) {
  state.places = places;
  view.mark(places);
  $("labels").replaceChildren();
  if (places.length === 2) {
    $("labels").append(element("div", { id: "distance", textContent: length(places[0].distanceTo(places[1])) }));
    $("hint").textContent = "";
  }
  placeLabel();
}

function placeLabel() {
  const label = $("distance"), box = $("view");
  if (!label) return;
  const middle = state.places[0].clone().add(state.places[1]).multiplyScalar(0.5);
  const at = view.onScreen(middle, box.clientWidth, box.clientHeight);
  label.hidden = !at.inFront;
  label.style.transform = `translate(${at.x}px, ${at.y}px) translate(-50%, -140%)`;
}

function setTheme(name) {
  state.theme = name;
  document.documentElement.dataset.theme = name;
  view.setTheme(name);
  if (plots.source) plots.show(data, world(), name === "dark"), plots.seek(state.frame);
}
const toggleTheme = () => setTheme(state.theme === "dark" ? "light" : "dark");

function resize() {
  plots.resize();
  view.resize($("view").clientWidth, $("view").clientHeight);
  strip();
}

function showWorld(number, keep = false) {
  state.world = number;
  view.now = -1;
  view.resize($("view").clientWidth, $("view").clientHeight);
  view.show(world(), keep);
  plots.show(data, world(), state.theme === "dark");
  side();
  resize();
  if (state.newest) return showNewest();
  const own = keep || world().at[state.frame] >= 0 ? state.frame : world().index[0] ?? 0;
  seek(own);
}

// A map that is newer: the world that was looked at, or the one where the run goes on.
function renew(text) {
  const before = data.worlds.length > 0 ? world().index[0] : -1;
  data = readData(text);
  if (data.worlds.length === 0) return;
  const first = !view;
  if (first && !build()) return;
  view.data = data;
  if (state.measuring) toggleMeasure();
  bar();
  const on = state.newest ? data.worlds.findIndex((w) => w.at[data.last] >= 0) : data.worlds.findIndex((w) => w.index[0] === before);
  showWorld(Math.max(0, on), !first && view.touched && before === data.worlds[Math.max(0, on)].index[0]);
}

function showNewest() {
  view.seekTail();
  const newest = view.tail.length ? view.tail[view.tail.length - 1][0] : data.last;
  state.frame = data.total - 1;
  pictures?.want(newest);
  $("slider").value = state.frame;
  plots.seek(state.frame);
  $("now").textContent = state.live ? `frame ${newest} · live` : `frame ${newest}`;
  $("now").className = "";
}

// Frames that were posed after the map was made, of the world in which they were.
function hearFrames(news) {
  if (!view || !data.worlds.length || news.world !== data.liveWorld || !(world().at[data.last] >= 0)) return;
  const known = view.tail.length ? view.tail[view.tail.length - 1][0] : data.last;
  view.extend(news.frames.filter((pose) => pose[0] > known));
  if (state.newest) showNewest();
}

function listen() {
  const label = $("live");
  label.hidden = false;
  const live = new Live({
    map: renew,
    frames: hearFrames,
    state(text, over) {
      label.textContent = text;
      label.classList.toggle("over", over);
      if (!over) return;
      state.live = state.newest = false;
      endPictures();
      if (view) seek(data.total - 1);
    },
  });
  window.page = { ...window.page, live };
}

const KEYS = {
  " ": ["space", "play and stop", togglePlay],
  ArrowRight: ["→", "next frame; ten with shift", (e) => scrub(state.frame + (e.shiftKey ? 10 : 1))],
  ArrowLeft: ["←", "frame before", (e) => scrub(state.frame - (e.shiftKey ? 10 : 1))],
  Home: ["home", "first frame", () => scrub(0)],
  End: ["end", "last frame", () => scrub(data.total - 1)],
  k: ["K", "points by height, or as in the images", () => colourByHeight(!view.byHeight)],
  v: ["V", "picture of the frame on and off", togglePictures],
  f: ["F", "follow the camera, or orbit freely", toggleFollow],
  h: ["H", "the whole path", home],
  m: ["M", "measure between two points", toggleMeasure],
  t: ["T", "light and dark", toggleTheme],
  "+": ["+", "larger points", () => ((view.pointSize = Math.min(12, view.pointSize + 1)), view.apply())],
  "-": ["−", "smaller points", () => ((view.pointSize = Math.max(1, view.pointSize - 1)), view.apply())],
  "?": ["?", "this list", () => $("help").showModal()],
};
for (const [name, key, label] of TOGGLES) KEYS[key.toLowerCase()] = [key, `${label} on and off`, () => toggle(name)];

function keyboard() {
  const rows = Object.values(KEYS).map(([key, label]) => element("div", {}, element("kbd", { textContent: key }), element("span", { textContent: label })));
  $("help").replaceChildren(element("h2", { textContent: "Keys" }), ...rows,
    element("p", { textContent: "Drag to turn, right button or two fingers to shift, wheel to come nearer." }));
  $("help").addEventListener("click", () => $("help").close());
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
    if (!view) return;
    const known = KEYS[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!known || $("help").open) return;
    event.preventDefault();
    known[2](event);
  });
}

function pointer() {
  const canvas = $("canvas");
  let down = null;
  canvas.addEventListener("pointerdown", (e) => {
    down = [e.clientX, e.clientY];
    if (view.follow) toggleFollow(); // who drags wants to look around
  });
  canvas.addEventListener("pointerup", (e) => {
    if (!state.measuring || !down || Math.hypot(e.clientX - down[0], e.clientY - down[1]) > 4) return;
    const box = canvas.getBoundingClientRect();
    const found = view.pick(e.clientX - box.left, e.clientY - box.top, box.width, box.height);
    if (found) place(state.places.length === 1 ? [state.places[0], found] : [found]);
  });
}

function loop() {
  let last = performance.now(), due = 0;
  const tick = (now) => {
    if (state.playing) {
      due += ((now - last) / 1000) * rate();
      const steps = Math.floor(due);
      due -= steps;
      if (steps > 0) seek(state.frame + steps);
      if (state.frame >= data.total - 1) togglePlay();
    }
    last = now;
    if (view.draw(now)) placeLabel();
    requestAnimationFrame(tick);
  };
  requestAnimationFrame(tick);
}

// Frames a second: as fast as they were taken, but no video in less than three seconds.
function rate() {
  const w = world(), span = w.time[w.count - 1] - w.time[0], frames = w.index[w.count - 1] - w.index[0];
  const taken = span > 0 && data.command !== "adjust" ? frames / span : 10;
  return Math.max(1, Math.min(taken, 120, Math.max(10, data.total / 3)));
}

// What there is once a frame has a pose; false where the browser cannot draw.
function build() {
  document.body.className = "";
  $("empty").textContent = "";
  try {
    view = new World3d($("canvas"), data);
  } catch {
    document.body.className = "empty";
    $("empty").textContent = "This browser draws no WebGL, which the page needs.";
    return false;
  }
  plots = new Plots($("plots"), (frame) => scrub(frame));
  if (data.pictures > 0) {
    pictures = new Pictures($("picture"), data);
    view.inset = 0.3;
  }
  bar();
  keyboard();
  pointer();
  setTheme(matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
  new ResizeObserver(resize).observe(document.body);
  loop();
  window.page = { ...window.page, state, view, plots, pictures, seek, get data() { return data; } };
  return true;
}

function start() {
  if (data.worlds.length === 0) {
    document.body.className = "empty";
    $("empty").textContent = data.live ? `${data.title}: no frame has a pose yet` : `${data.title}: no frame has a pose. ${data.missing[0]?.reason ?? ""}`;
  } else if (build()) {
    showWorld(0);
  }
  if (data.live) listen();
}
start();
