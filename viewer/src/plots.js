// Numbers over frames, below the view.
import uPlot from "uplot";
import { digits } from "./data.js";

const DARK = { axis: "#9aa4b2", grid: "#232a35" }, LIGHT = { axis: "#556070", grid: "#e3e6eb" };
const NINETY = 1.6449; // 90 % of a normal distribution lie within so many standard deviations
const COLOURS = ["#1f9bcf", "#d9480f", "#12915a", "#9c36b5", "#c28a00"];

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
    ["position, 1σ", unit, position, true],
    ["rotation, 1σ", "deg", turn, true],
    ["points of key frames", "", seen, false],
    ["reprojection", "px", error, false],
    ["focal length, 90 %", "px", focal, true, focalBand],
  ];
  return all.filter(([, , values]) => values.some((v) => v !== null));
}

export class Plots {
  constructor(element, onSeek) {
    this.element = element;
    this.onSeek = onSeek;
    this.plots = [];
  }

  show(data, world, dark) {
    this.source = [data, world, dark];
    for (const plot of this.plots) plot.destroy();
    this.element.replaceChildren();
    const series = seriesOf(data, world), style = dark ? DARK : LIGHT;
    this.x = Array.from({ length: data.total }, (_, i) => i);
    this.plots = series.map(([title, unit, values, joined, band], k) => {
      const box = document.createElement("div");
      box.className = "plot";
      const label = document.createElement("h3");
      label.textContent = unit ? `${title} [${unit}]` : title;
      const value = document.createElement("output");
      label.append(value);
      box.append(label);
      this.element.append(box);
      const axis = { values: (u, ticks) => ticks.map((t) => digits(t, 1)), stroke: style.axis, grid: { stroke: style.grid, width: 1 }, ticks: { stroke: style.grid }, font: "11px system-ui" };
      const edge = { stroke: `${COLOURS[k % COLOURS.length]}88`, width: 1, points: { show: false } };
      const plot = new uPlot(
        {
          width: 300, height: 110, legend: { show: false }, padding: [8, 8, 0, 0],
          cursor: { y: false, drag: { x: false, y: false }, points: { show: false } },
          scales: { x: { time: false } },
          axes: [{ ...axis, size: 24 }, { ...axis, size: 52 }],
          series: [{}, {
            stroke: COLOURS[k % COLOURS.length], width: 1.5, spanGaps: !joined,
            points: { show: !joined, size: 4, fill: COLOURS[k % COLOURS.length] },
          }, ...(band ? [edge, edge] : [])],
          bands: band ? [{ series: [2, 3], fill: `${COLOURS[k % COLOURS.length]}55` }] : [],
          hooks: { draw: [(u) => this.drawNow(u)] },
        },
        [this.x, values, ...(band ? [1, -1].map((side) => values.map((v, i) => (v === null ? null : v + side * (band[i] ?? 0)))) : [])], box);
      plot.band = band;
      plot.over.addEventListener("pointerdown", (event) => this.drag(plot, event));
      plot.over.addEventListener("pointermove", (event) => event.buttons && this.drag(plot, event));
      plot.value = value;
      plot.values = values;
      return plot;
    });
    this.element.hidden = this.plots.length === 0;
    this.resize();
  }

  drag(plot, event) {
    this.onSeek(Math.round(plot.posToVal(event.clientX - plot.over.getBoundingClientRect().left, "x")));
  }

  drawNow(u) {
    const x = u.valToPos(this.now ?? 0, "x", true), { top, height } = u.bbox;
    u.ctx.fillStyle = "#12b357";
    u.ctx.fillRect(x - 1, top, 2, height);
  }

  seek(frame) {
    this.now = frame;
    for (const plot of this.plots) {
      const v = plot.values[frame];
      const band = plot.band?.[frame];
      plot.value.textContent = v === null || v === undefined ? "" : digits(v) + (band ? ` ± ${digits(band)}` : "");
      plot.redraw(false, false);
    }
  }

  resize() {
    const width = this.element.clientWidth, gap = 12, least = 215;
    const columns = Math.max(1, Math.min(this.plots.length, Math.floor((width - gap) / least)));
    const each = Math.floor((width - gap * (columns + 1)) / columns);
    for (const plot of this.plots) plot.setSize({ width: Math.max(each, 120), height: 110 });
  }
}
