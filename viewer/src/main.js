// Ties the view, the plots and the controls together.
import { addRest, readData } from "./data.js";
import { $, element } from "./dom.js";
import { Live } from "./live.js";
import { heightLegend, lengthOf, panel, TOGGLES } from "./panel.js";
import { Pictures } from "./pictures.js";
import { Plots } from "./plots.js";
import { World3d } from "./scene.js";

let data = readData($("data").textContent);
// `newest`: of a run under way, the newest frame is shown whenever there is one.
const state = { frame: 0, world: 0, playing: false, measuring: false, places: [], theme: "light", live: data.live, newest: data.live };
let view, plots, pictures;

const world = () => data.worlds[state.world];

function toggle(name) {
  const box = $(`show-${name}`);
  if (!box) return; // there is none
  view.shown[name] = box.checked = !view.shown[name];
  view.apply();
  legend();
}

function colourByHeight(on) {
  view.byHeight = on;
  view.colourPoints();
  $("heights").checked = on;
  legend();
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

function side() {
  const acts = { toggle, colourByHeight, exaggerate, toggleFollow, home, toggleMeasure, toggleTheme, seek, showWorld, help: () => $("help").showModal() };
  const focused = document.activeElement.id;
  $("side").replaceChildren(...panel({ data, world: world(), number: state.world, view, acts }));
  press("follow", view.follow);
  press("measure", state.measuring);
  if (focused) $(focused)?.focus();
  legend();
}

// Of the colours of points.
function legend() {
  $("legend").hidden = !view.byHeight || !view.shown.points;
  $("legend").replaceChildren(...heightLegend(world(), view.heights));
}

function bar() {
  const slider = element("input", { id: "slider", type: "range", min: 0, max: Math.max(0, data.total - 1), step: 1, value: 0,
    oninput: () => scrub(Number(slider.value)) });
  slider.setAttribute("aria-label", "frame");
  const play = element("button", { id: "play", type: "button", textContent: "▶", title: "play (space)", ariaLabel: "play", onclick: togglePlay });
  const track = element("div", { className: "track" }, element("canvas", { id: "strip", title: STRIP.map(([, name, meaning]) => `${name}: ${meaning}`).join("\n") }), slider);
  $("bar").replaceChildren(play, track, element("output", { id: "now" }));
}

// Colours of frames above the slider, by what is known of them.
const STRIP = [["#1f6feb", "blue", "with a pose"], ["#d99a1f", "amber", "only seen to turn"], ["#d64545", "red", "without a pose"], ["#8884", "grey", "of another world"]];

function strip() {
  const canvas = $("strip"), width = (canvas.width = canvas.clientWidth * devicePixelRatio), height = (canvas.height = 6 * devicePixelRatio);
  const context = canvas.getContext("2d", { willReadFrequently: true }), w = world(); // as in plots.js
  for (let x = 0; x < width; ++x) {
    const frame = Math.min(data.total - 1, Math.floor((x / width) * data.total));
    [context.fillStyle] = STRIP[w.at[frame] >= 0 ? data.isHeld[frame] : data.reasons[frame] ? 2 : 3];
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
  Object.assign($("play"), { textContent: state.playing ? "❚❚" : "▶", ariaLabel: state.playing ? "stop" : "play" });
  $("now").ariaLive = state.playing ? "off" : "polite";
}

function press(id, on) {
  $(id).classList.toggle("on", on);
  $(id).ariaPressed = on;
}

function toggleFollow() {
  view.follow = !view.follow;
  view.dirty = true;
  press("follow", view.follow);
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
  press("measure", state.measuring);
  $("hint").textContent = state.measuring ? "click two points or cameras" : "";
}

function place(places) {
  state.places = places;
  view.mark(places);
  $("labels").replaceChildren();
  if (places.length === 2) {
    $("labels").append(element("div", { id: "distance", textContent: lengthOf(world(), places[0].distanceTo(places[1])) }));
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
  plots.show(data, world(), state.theme === "dark");
  view.resize($("view").clientWidth, $("view").clientHeight);
  view.show(world(), keep);
  side();
  strip();
  if (state.newest) return showNewest();
  const own = keep || world().at[state.frame] >= 0 ? state.frame : world().index[0] ?? 0;
  seek(own);
}

// A map that is newer: the world that was looked at, or the one where the run goes on.
function renew(begin, rest) {
  const before = data.worlds.length > 0 ? world().index[0] : -1;
  data = readData(begin);
  addRest(data, rest);
  if (data.worlds.length === 0) return;
  const first = !view;
  if (first) build();
  view.data = data;
  if (state.measuring) toggleMeasure();
  bar();
  const on = state.newest ? data.worlds.findIndex((w) => w.at[data.last] >= 0) : data.worlds.findIndex((w) => w.index[0] === before);
  showWorld(Math.max(0, on), !first && view.touched && before === data.worlds[Math.max(0, on)].index[0]);
  if (first) open();
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

function turn(right, upwards, nearer) {
  if (view.follow) toggleFollow();
  view.turn(0.12 * right, 0.12 * upwards, nearer);
}

// By what the browser calls them: what the list calls them, what they do; keys of one row of the list come after each other.
const KEYS = new Map([
  [" ", ["space", "play and stop", togglePlay]],
  ["ArrowRight", ["← →", "frame before and next; ten with shift", (e) => scrub(state.frame + (e.shiftKey ? 10 : 1))]],
  ["ArrowLeft", ["", "", (e) => scrub(state.frame - (e.shiftKey ? 10 : 1))]],
  ["Home", ["home end", "first and last frame", () => scrub(0)]],
  ["End", ["", "", () => scrub(data.total - 1)]],
  ["4", ["4 6 8 2", "turn the view", () => turn(-1, 0)]],
  ["6", ["", "", () => turn(1, 0)]],
  ["8", ["", "", () => turn(0, 1)]],
  ["2", ["", "", () => turn(0, -1)]],
  ["9", ["9 3", "nearer and farther", () => turn(0, 0, 1.15)]],
  ["3", ["", "", () => turn(0, 0, 1 / 1.15)]],
  ["f", ["F", "follow the camera, or orbit freely", toggleFollow]],
  ["h", ["H", "the whole path", home]],
  ["m", ["M", "measure between two points", toggleMeasure]],
  ["v", ["V", "picture of the frame on and off", togglePictures]],
  ["k", ["K", "points by height, or as in the images", () => colourByHeight(!view.byHeight)]],
  ...TOGGLES.map(([name, key, label]) => [key.toLowerCase(), [key, `${label} on and off`, () => toggle(name)]]),
  ["+", ["+ −", "larger and smaller points", () => ((view.pointSize = Math.min(12, view.pointSize + 1)), view.apply())]],
  ["-", ["", "", () => ((view.pointSize = Math.max(1, view.pointSize - 1)), view.apply())]],
  ["t", ["T", "light and dark", toggleTheme]],
  ["?", ["?", "this list", () => $("help").showModal()]],
]);

function keyboard() {
  const rows = [...KEYS.values()].filter(([, label]) => label).map(([key, label]) => element("div", {}, element("kbd", { textContent: key }), element("span", { textContent: label })));
  $("help").replaceChildren(element("h2", { textContent: "Keys" }), ...rows,
    element("p", { textContent: "Drag to turn, right button or two fingers to shift, wheel to come nearer." }));
  $("help").addEventListener("click", () => $("help").close());
  addEventListener("keydown", (event) => {
    if (!view || event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
    if (event.key === " " && event.target.matches("button, input[type=checkbox]")) return; // presses it
    const known = KEYS.get(event.key.length === 1 ? event.key.toLowerCase() : event.key);
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

// What there is once a frame has a pose.
function build() {
  document.body.className = "";
  $("empty").textContent = "";
  view = new World3d(data);
  plots = new Plots($("plots"), (frame) => scrub(frame));
  if (data.pictures > 0) {
    pictures = new Pictures($("picture"), data);
    view.inset = 0.3;
  }
  bar();
  setTheme(matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
}

// What has been built is drawn from now on, if the browser can.
function open() {
  try {
    view.connect($("canvas"));
  } catch {
    document.body.className = "empty";
    $("empty").textContent = "This browser draws no WebGL, which the page needs: its settings may call it hardware acceleration.";
    view = undefined;
    return;
  }
  keyboard();
  pointer();
  new ResizeObserver(resize).observe(document.body);
  loop();
  window.page = { ...window.page, state, view, plots, pictures, seek, get data() { return data; } };
}

// What lies behind this script in the file.
function complete() {
  addRest(data, $("rest").textContent);
  view?.fillPoints();
}

function start() {
  if (data.worlds.length === 0) {
    document.body.className = "empty";
    $("empty").textContent = data.live ? `${data.title}: no frame has a pose yet` : `${data.title}: no frame has a pose. ${data.missing[0]?.reason ?? ""}`;
  } else {
    build();
    showWorld(0);
    open();
  }
  if (data.live) listen();
  else addEventListener("DOMContentLoaded", complete);
}
start();
