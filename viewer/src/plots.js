// Numbers over frames, below the view.
import uPlot from "uplot";
import { digits } from "./data.js";
import { element } from "./dom.js";

const LIGHT = { axis: "#556070", grid: "#e3e6eb", now: "#0b7a3b", series: ["#177ba3", "#d9480f", "#12803f", "#9c36b5", "#8a6300"] };
const DARK = { axis: "#9aa4b2", grid: "#232a35", now: "#3fdd78", series: ["#4fb8e3", "#ff8a4c", "#4cc38a", "#cf7ee6", "#e0b03a"] };
const NINETY = 1.6449; // 90 % of a normal distribution lie within so many standard deviations
const HEIGHT = 110; // pixels of a chart; style.css keeps room for it
const MOST_DOTS = 200; // more key frames are a line only
const STEPS = [0, 1, 2, 3, 4, 5, 6, 7].flatMap((power) => [1, 2, 5].map((digit) => digit * 10 ** power)); // from tick to tick, in frames

// [title, unit, values by frame of the input, joined or only dots, half the width of a band about them]
export function seriesOf(data, world) {
  const blank = () => new Array(data.total).fill(null);
  const position = blank(), turn = blank(), seen = blank(), error = blank(), focal = blank(), focalBand = blank();
  for (let i = 0; i < world.count; ++i) {
    const c = world.covariance, frame = world.index[i];
    const sigma = Math.sqrt(Math.max(0, (c[6 * i] + c[6 * i + 3] + c[6 * i + 5]) / 3));
    if (sigma > 0) position[frame] = sigma;
    if (world.turn[i] > 0) turn[frame] = world.turn[i];
    const lens = data.lenses[world.lens[i]];
    if (data.lenses.length > 1 && lens && lens.focal) {
      focal[frame] = lens.focal[0];
      if (lens.sigma > 0) focalBand[frame] = NINETY * lens.sigma;
    }
  }
  world.keyframes.frame.forEach((i, k) => {
    const frame = world.index[i];
    if (world.keyframes.seen[k] > 0) seen[frame] = world.keyframes.seen[k];
    if (!Number.isNaN(world.keyframes.error[k])) error[frame] = world.keyframes.error[k];
  });
  const unit = world.metric ? "m" : "units";
  const all = [
    ["position σ", unit, position, true],
    ["rotation σ", "deg", turn, true],
    ["points of key frames", "", seen, false],
    ["reprojection", "px", error, false],
    ["focal length", "px", focal, true, focalBand],
  ];
  return all.filter(([, , values]) => values.some((v) => v !== null));
}

// uPlot draws where it is told to, and asks for a canvas of the graphics card. To bring that card's programs for drawing on the way
// takes a browser without one a second; these small pictures are drawn as fast by the processor.
function onPlainCanvas(make) {
  const { prototype } = HTMLCanvasElement, { getContext } = prototype;
  prototype.getContext = function (kind, options) {
    return getContext.call(this, kind, { ...options, willReadFrequently: true });
  };
  try {
    return make();
  } finally {
    prototype.getContext = getContext;
  }
}

function chart(plots, { values, joined, band, colour }, box, width) {
  const { style } = plots, axis = { stroke: style.axis, grid: { stroke: style.grid, width: 1 }, ticks: { stroke: style.grid, size: 5 }, gap: 3, font: "11px system-ui" };
  const frames = { ...axis, size: 22, incrs: STEPS, values: (u, ticks) => ticks.map((t, i) => (i === 0 ? `frame ${t}` : t)) };
  const numbers = { ...axis, space: 24, values: (u, ticks) => ticks.map((t) => digits(t, 1)),
    size: (u, texts) => 12 + 6.5 * Math.max(4, ...(texts ?? []).map((text) => text.length)) };
  const edge = { stroke: `${colour}88`, width: 1, points: { show: false } };
  const few = plots.keyframes < MOST_DOTS;
  const options = {
    width, height: HEIGHT, legend: { show: false }, padding: [8, 16, 0, 0],
    cursor: { y: false, drag: { x: false, y: false }, points: { show: false } },
    scales: { x: { time: false, range: plots.range } },
    axes: [frames, numbers],
    series: [{}, { stroke: colour, width: 1.5, spanGaps: !joined, points: { show: !joined && few, size: 4, fill: colour } }, ...(band ? [edge, edge] : [])],
    bands: band ? [{ series: [2, 3], fill: `${colour}55` }] : [],
    hooks: { draw: [(u) => plots.drawNow(u)] },
  };
  const edges = band ? [1, -1].map((side) => values.map((v, i) => (v === null ? null : v + side * (band[i] ?? 0)))) : [];
  const made = onPlainCanvas(() => new uPlot(options, [plots.x, values, ...edges], box));
  made.over.addEventListener("pointerdown", (event) => plots.drag(made, event));
  made.over.addEventListener("pointermove", (event) => event.buttons && plots.drag(made, event));
  return made;
}

// Boxes at once, and in each a chart when it has come into view: the map is drawn before.
export class Plots {
  constructor(element, onSeek) {
    this.element = element;
    this.onSeek = onSeek;
    this.plots = [];
    this.watch = new IntersectionObserver((entries) => {
      for (const { target, isIntersecting } of entries) if (isIntersecting) this.fill(this.plots.find((plot) => plot.box === target));
    });
  }

  show(data, world, dark) {
    this.source = [data, world, dark];
    this.watch.disconnect();
    const again = this.plots.some((plot) => plot.chart); // others would be blank for a moment
    for (const plot of this.plots) plot.chart?.destroy();
    this.style = dark ? DARK : LIGHT;
    this.x = Array.from({ length: data.total }, (_, i) => i);
    // Of other worlds there is nothing to see.
    const [first, last] = [world.index[0] ?? 0, world.index[world.count - 1] ?? 0];
    this.range = [first, Math.max(last, first + 1)];
    this.keyframes = world.keyframes.frame.length;
    this.plots = seriesOf(data, world).map(([title, unit, values, joined, band], k) => {
      const value = element("output"), name = element("span", { textContent: unit ? `${title} [${unit}]` : title, title: band ? "the band holds it with 90 %" : /σ/.test(title) ? "one standard deviation" : "" });
      const box = element("div", { className: "plot" }, element("h3", {}, name, value));
      return { box, value, values, joined, band, colour: this.style.series[k % this.style.series.length] };
    });
    this.element.replaceChildren(...this.plots.map(({ box }) => box));
    this.element.hidden = this.plots.length === 0;
    for (const plot of this.plots) again ? this.fill(plot) : this.watch.observe(plot.box);
  }

  fill(plot) {
    if (!plot || plot.chart) return;
    this.watch.unobserve(plot.box);
    plot.chart = chart(this, plot, plot.box, plot.box.clientWidth);
  }

  drag(u, event) {
    this.onSeek(Math.round(u.posToVal(event.clientX - u.over.getBoundingClientRect().left, "x")));
  }

  drawNow(u) {
    if (!(this.now >= this.range[0] && this.now <= this.range[1])) return;
    const x = u.valToPos(this.now, "x", true), { top, height } = u.bbox;
    u.ctx.fillStyle = this.style.now;
    u.ctx.fillRect(x - 1, top, 2, height);
  }

  seek(frame) {
    this.now = frame;
    for (const { value, values, joined, band, chart: drawn } of this.plots) {
      // Between key frames: what the one before has.
      let at = frame;
      if (!joined) while (at > this.range[0] && values[at] === null) --at;
      const v = values[at], half = band?.[at];
      value.textContent = v === null || v === undefined ? "" : digits(v) + (half ? ` ± ${digits(Number(half.toPrecision(2)))}` : "");
      drawn?.redraw(false, false);
    }
  }

  resize() {
    for (const { box, chart: drawn } of this.plots) {
      if (drawn && drawn.width !== box.clientWidth) drawn.setSize({ width: box.clientWidth, height: HEIGHT });
    }
  }
}
