// What stands beside the view: what was reconstructed, what is shown of it, and where frames are without a pose.
import { counted, digits } from "./data.js";
import { button, element } from "./dom.js";
import { HEIGHTS } from "./points.js";

// [name, key, label, colour of the theme]
export const TOGGLES = [
  ["surface", "S", "surface"], ["points", "P", "points"], ["path", "L", "path", "path"], ["cameras", "C", "key frames", "key"],
  ["closures", "O", "closures", "closure"], ["ellipsoids", "E", "90 % ellipsoids", "ellipsoid"], ["rays", "R", "rays of the camera"], ["grid", "G", "grid"],
];

export const lengthOf = (world, x) => `${digits(x)} ${world.metric ? "m" : digits(x) === "1" ? "unit" : "units"}`;

// Of all pieces between neighbouring frames.
function pathLength({ pose, index, count }) {
  let path = 0;
  for (let i = 1; i < count; ++i) {
    const at = 7 * i, before = at - 7;
    if (index[i] - index[i - 1] === 1) path += Math.hypot(pose[at] - pose[before], pose[at + 1] - pose[before + 1], pose[at + 2] - pose[before + 2]);
  }
  return path;
}

function facts(data, world) {
  const { points: p } = world;
  const rows = [
    ["command", data.command],
    ["with a pose", `${counted(data.posed)} of ${counted(data.total)}`],
    ["key frames", counted(world.keyframes.frame.length)],
    ["points", p.count < p.all ? `${counted(p.all)}, ${counted(p.count)} of them shown` : counted(p.all)],
    ["path", lengthOf(world, pathLength(world))],
    ["scale", world.metric ? "metric" : "arbitrary"],
  ];
  if (p.far > 0) rows.push(["far points", `${counted(p.far)} not shown`]);
  if (world.metric && world.scaleSigma) rows.push(["scale known to", `${digits(100 * world.scaleSigma)} %`]);
  if (data.rms > 0) rows.push(["reprojection", `${digits(data.rms)} px rms`]);
  if (data.cameras.length) rows.push(["cameras", data.cameras.map((c) => c.name || "camera").join(", ")]);
  if (data.lenses.length === 1 && data.lenses[0].focal) rows.push(["focal length", `${digits(data.lenses[0].focal[0])} px`]);
  if (data.lenses.length > 1) rows.push(["lenses", counted(data.lenses.length)]);
  return element("dl", {}, ...rows.flatMap(([name, value]) => [element("dt", { textContent: name }), element("dd", { textContent: value })]));
}

// What the run as a whole says against its path, before anything that looks well.
const warnings = (data) => (data.warnings.length ? [element("ul", { id: "warnings", ariaLabel: "warnings" }, ...data.warnings.map((text) => element("li", { textContent: text })))] : []);

// Those of which there is something to show.
const isThere = ({ data, world, view }) => ({ surface: Boolean(view.surface), closures: !view.closures.empty, ellipsoids: world.covariance.some((c) => c > 0),
  rays: data.cameras.concat(data.lenses).some((c) => c.rays) });

function switches(page) {
  const { world, view, acts } = page, there = isThere(page);
  const rows = TOGGLES.filter(([name]) => there[name] ?? true).map(([name, key, label, colour]) => {
    const text = element("span", { textContent: name === "grid" ? `grid of ${lengthOf(world, view.cell)}` : label });
    if (colour) text.prepend(element("i", { className: "swatch", style: `background: var(--${colour})` }));
    return element("label", {}, element("input", { type: "checkbox", id: `show-${name}`, checked: view.shown[name], onchange: () => acts.toggle(name) }),
      text, element("kbd", { textContent: key }));
  });
  rows.push(element("label", {}, element("input", { type: "checkbox", id: "heights", checked: view.byHeight, onchange: (e) => acts.colourByHeight(e.target.checked) }),
    element("span", { textContent: "colour by height" }), element("kbd", { textContent: "K" })));
  if (there.ellipsoids) {
    const factor = element("select", { id: "exaggeration", onchange: () => acts.exaggerate(Number(factor.value)) },
      ...[1, 10, 100, 1000].map((x) => element("option", { value: x, textContent: x === 1 ? "true size" : `${x} times` })));
    factor.value = view.exaggeration;
    rows.push(element("label", {}, element("span", { textContent: "ellipsoids" }), factor));
  }
  return element("div", { className: "switches" }, ...rows);
}

// A list whose entries go to a frame.
function frameList(id, title, entries, seek) {
  if (!entries.length) return [];
  const items = entries.slice(0, 200).map(([frame, bold, text]) =>
    element("li", {}, element("button", { type: "button", onclick: () => seek(frame) }, element("b", { textContent: bold }), ` ${text}`)));
  if (entries.length > items.length) items.push(element("li", { className: "more", textContent: `and ${counted(entries.length - items.length)} more` }));
  return [element("h2", { textContent: title }), element("ul", { id, className: "frames" }, ...items)];
}

const closures = (data) => data.closures.map((c) => [c.frame, `${c.frame}`,
  `${c.joined ? "joins the world of" : "sees what was seen in"} ${c.with < 0 ? "an earlier run" : c.with}, ${c.inliers} points`]);
const runText = (run) => (run.first === run.last ? `${run.first}` : `${run.first} to ${run.last}`);
const missing = (data) => data.missing.map((run) => [run.first, runText(run), run.reason]);
const held = (data) => data.held.map((run) => [run.first, runText(run), "where it is, is not known"]);

const duration = (ms) => (ms < 1000 ? `${digits(Number(ms.toPrecision(3)))} ms` : `${digits(Number((ms / 1000).toPrecision(3)))} s`);

// Time of each stage in the whole run, as bars; what one time of it takes is in the titles. `frame` holds the others.
function stageTimes(data) {
  const total = (s) => s.mean * s.count, stages = data.stages.filter((s) => s.mean > 0), most = Math.max(...stages.map(total), 1e-9);
  if (!stages.length) return [];
  const rows = stages.map((s) => {
    const bar = element("i");
    bar.style.width = `${(100 * total(s)) / most}%`;
    const title = `${counted(s.count)} times, ${digits(s.mean)} ms on average, ${digits(s.max)} ms at most`;
    return element("div", { title }, element("span", { textContent: s.name }), element("b", {}, bar), element("output", { textContent: duration(total(s)) }));
  });
  return [element("h2", { textContent: "time per stage, in all" }), element("div", { id: "stages" }, ...rows)];
}

function worldChooser(data, number, showWorld) {
  const options = data.worlds.map((w, i) => element("option", { value: i, textContent: `${i === 0 ? "main world" : `world ${i}`}, ${counted(w.count)} frames` }));
  const select = element("select", { id: "world", ariaLabel: "world", onchange: () => showWorld(Number(select.value)) }, ...options);
  select.value = number;
  return select;
}

// Contents of the panel for `page`: data, world, its number, view, and what can be done, `acts`.
export function panel(page) {
  const { data, world, number, acts } = page;
  return [
    element("h1", { textContent: data.title, title: data.title }),
    ...warnings(data),
    ...(data.worlds.length > 1 ? [worldChooser(data, number, acts.showWorld)] : []),
    facts(data, world),
    switches(page),
    element("div", { className: "buttons" }, button("follow", "follow", "F", acts.toggleFollow), button("home", "overview", "H", acts.home),
      button("measure", "measure", "M", acts.toggleMeasure), button("theme", "theme", "T", acts.toggleTheme), button("keys", "keys", "?", acts.help)),
    ...frameList("missing", "without a pose", missing(data), acts.seek),
    ...frameList("held", "only seen to turn", held(data), acts.seek),
    ...frameList("closures", "places seen again", closures(data), acts.seek),
    ...stageTimes(data),
  ];
}

// What the colours of heights mean.
export function heightLegend(world, [low, high]) {
  const ladder = element("i", { style: `background: linear-gradient(to right, ${HEIGHTS.map((c) => `rgb(${c})`).join(", ")})` });
  return [element("span", { textContent: "height 0" }), ladder, element("span", { textContent: lengthOf(world, Number((high - low).toPrecision(2))) })];
}
