// Opens a page in a browser and tells what it saw, as one JSON object that page_browser_test.py judges:
// page_browser_check.mjs VIEWER CHROMIUM large|late|keys|narrow|words|speed PAGE.html
import { once } from "node:events";
import { readFileSync } from "node:fs";
import { createServer } from "node:http";
import { pathToFileURL } from "node:url";
import { launchBrowser, tellShaderFaults } from "../scripts/browser.mjs";

const [viewer, executablePath, what, file] = process.argv.slice(2);
const browser = await launchBrowser(viewer, executablePath);
const narrow = what === "narrow" ? { viewport: { width: 390, height: 844 }, isMobile: true, hasTouch: true } : { viewport: { width: 1100, height: 760 } };
const page = await browser.newPage({ ...narrow, colorScheme: "light" });
if (what !== "speed") await tellShaderFaults(page);
page.setDefaultTimeout(90000); // on a machine that has much else to do
const seen = { errors: [] };
page.on("console", (m) => m.type() === "error" && seen.errors.push(m.text()));
page.on("pageerror", (e) => seen.errors.push(e.message));

const open = async () => {
  await page.goto(pathToFileURL(file).href);
  await isSeen();
};
const isSeen = () => page.waitForFunction(() => window.page?.view && !window.page.view.first);
const settle = () => page.evaluate(() => new Promise((done) => setTimeout(done, 300)));
const plotPixels = () => page.evaluate(() => [...document.querySelectorAll(".plot canvas")].map((c) =>
  c.getContext("2d").getImageData(0, 0, c.width, c.height).data.some((v) => v)));
// Part of the view that is not its background, and a sum that changes with any pixel.
const drawn = () => page.evaluate(() => {
  const { view } = window.page, gl = view.renderer.getContext(), { drawingBufferWidth: w, drawingBufferHeight: h } = gl, pixels = new Uint8Array(4 * w * h);
  view.renderer.render(view.scene, view.camera);
  gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  let sum = 0, other = 0;
  for (let i = 0; i < pixels.length; i += 4) {
    sum = (sum * 31 + (pixels[i] << 16) + (pixels[i + 1] << 8) + pixels[i + 2]) % 1000000007;
    other += Math.abs(pixels[i] - pixels[0]) > 8;
  }
  return { part: other / (w * h), sum };
});

async function large() {
  const session = await page.context().newCDPSession(page);
  await session.send("Performance.enable", { timeDomain: "threadTicks" });
  await page.addInitScript(() => {
    const { drawArrays } = WebGL2RenderingContext.prototype;
    window.draws = [];
    WebGL2RenderingContext.prototype.drawArrays = function (kind, first, count) {
      if (kind === this.POINTS) window.draws.push({ points: count, charts: document.querySelectorAll(".plot canvas").length });
      return drawArrays.call(this, kind, first, count);
    };
  });
  await open();
  await page.waitForFunction(() => document.querySelectorAll(".plot canvas").length === 4 && window.draws.some((d) => d.points === 300000));
  const { metrics } = await session.send("Performance.getMetrics");
  seen.seconds = metrics.find((m) => m.name === "TaskDuration").value;
  await settle();
  seen.draws = await page.evaluate(() => window.draws);
  seen.said = await page.textContent("dt:text-is('points') + dd");
  seen.plotPixels = await plotPixels();
  seen.plain = await page.evaluate(() => [...document.querySelectorAll(".plot canvas")].map((c) => c.getContext("2d").getContextAttributes().willReadFrequently));
  const still = await drawn();
  Object.assign(seen, { partOfAll: still.part, stillSum: still.sum });
  // From here on time goes as it is told to, and nothing else draws.
  await page.evaluate(() => (window.page.view.draw = () => false));
  const turn = (pictures, between, idle = 16) => page.evaluate(([pictures, between, idle]) => {
    const { view } = window.page, counts = [];
    window.clock ??= performance.now() + 1e6;
    view.idle = idle;
    for (let i = 0; i < pictures; ++i) {
      view.moved = window.clock += between;
      view.thin(window.clock);
      view.drawn = window.clock;
      counts.push(view.points.geometry.drawRange.count);
    }
    return counts;
  }, [pictures, between, idle]);
  seen.slow = (await turn(120, 60)).slice(1);
  seen.movingSum = (await drawn()).sum;
  // A hand that rests for a moment does not bring all of it, one that has let go does.
  seen.resting = await page.evaluate(() => {
    const { view } = window.page, counts = [];
    for (const rested of [100, 200]) {
      view.thin(window.clock + rested);
      counts.push(view.points.geometry.drawRange.count);
    }
    return counts;
  });
  await turn(40, 28);
  seen.steady = await turn(20, 28);
  seen.fast = await turn(200, 16);
  seen.screen = (await turn(60, 34, 33)).at(-1);
  seen.still = await page.evaluate(() => {
    const { view } = window.page;
    view.thin(window.clock + 1000);
    return view.points.geometry.drawRange.count;
  });
  seen.againSum = (await drawn()).sum;
  const range = () => page.evaluate(() => { const { min, max } = window.page.plots.plots[0].chart.scales.x; return [min, max]; });
  seen.ranges = [await range()];
  await page.keyboard.press("f");
  await page.focus("#world");
  await page.selectOption("#world", "1");
  seen.ranges.push(await range());
  Object.assign(seen, await page.evaluate(() => ({ followed: document.getElementById("follow").classList.contains("on"), focused: document.activeElement.id })));
}

// The file as a slow network brings it: what lies behind the script comes when it is told to.
async function late() {
  const text = readFileSync(file, "utf8"), cut = text.indexOf('<script type="application/json" id="rest">');
  let arrive;
  const server = createServer((_, response) => {
    response.writeHead(200, { "Content-Type": "text/html; charset=utf-8" });
    response.write(text.slice(0, cut));
    arrive = () => response.end(text.slice(cut));
  }).listen(0, "127.0.0.1");
  await once(server, "listening");
  await page.goto(`http://127.0.0.1:${server.address().port}/`, { waitUntil: "commit" });
  await isSeen();
  const state = async () => {
    await settle();
    await page.waitForFunction(() => window.page.view.whole);  // a slow machine draws a part while anything moves
    return { ...(await drawn()), ...(await page.evaluate(() => {
      const { view, state: { frame } } = window.page, { geometry } = view.points;
      return { points: geometry.drawRange.count, coloured: geometry.attributes.color.count, frame, byHeight: view.byHeight,
        heights: view.heights, legend: document.getElementById("legend").textContent, eye: view.camera.position.toArray() };
    })) };
  };
  await page.keyboard.press("End");
  await page.selectOption("#world", "1");
  seen.other = await state();
  await page.selectOption("#world", "0");
  await page.focus("#canvas");
  await page.keyboard.press("End");
  await page.keyboard.press("k");
  seen.before = await state();
  arrive();
  await page.waitForFunction(() => document.readyState === "complete");
  seen.after = await state();
  Object.assign(seen, await page.evaluate(() => {
    const { view, data } = window.page, { points } = data.worlds[0], last = view.controls.target.clone().fromArray(points.positions, 3 * points.count - 3);
    view.camera.position.copy(view.root.localToWorld(last.clone())).addScalar(0.1);
    view.camera.lookAt(view.root.localToWorld(last.clone()));
    view.camera.near = 1e-3;
    view.camera.updateProjectionMatrix();
    view.camera.updateMatrixWorld();
    return { last: last.toArray(), picked: view.pick(50, 50, 100, 100)?.toArray() };
  }));
  await page.selectOption("#world", "1");
  seen.otherAfter = await state();
  server.close();
}

async function keys() {
  await open();
  const focused = () => page.evaluate(() => document.activeElement.id);
  seen.tabbed = [];
  seen.outlined = {};
  for (let i = 0; i < 40; ++i) {
    await page.keyboard.press("Tab");
    const id = await focused();
    if (!id) continue;
    if (seen.tabbed.includes(id)) break;
    seen.tabbed.push(id);
    seen.outlined[id] = await page.evaluate(() => {
      const style = getComputedStyle(document.activeElement);
      return style.outlineStyle === "solid" || style.boxShadow !== "none";
    });
  }
  const state = () => page.evaluate(() => ({ playing: window.page.state.playing, follow: window.page.view.follow }));
  await page.focus("#follow");
  await page.keyboard.press(" ");
  seen.follow = (await state()).follow;
  seen.played = (await state()).playing;
  await page.keyboard.press(" ");
  await page.focus("#canvas");
  await page.keyboard.press(" ");
  seen.playedElsewhere = (await state()).playing;
  await page.keyboard.press(" ");
  await page.focus("#missing button");
  await page.keyboard.press("Enter");
  seen.missing = (await page.textContent("#now")).split(" · ")[0];
  await page.keyboard.press("h");
  await settle();
  const eye = () => page.evaluate(() => {
    const { camera, controls } = window.page.view, v = camera.position.clone().sub(controls.target);
    return { around: Math.atan2(v.x, v.z), up: Math.asin(v.y / v.length()), distance: v.length() };
  });
  const press = async (key) => {
    const before = await eye();
    await page.keyboard.press(key);
    await settle();
    return [before, await eye()];
  };
  let [a, b] = await press("6");
  seen.turned = { angle: b.around - a.around, distance: b.distance / a.distance };
  [a, b] = await press("8");
  seen.raised = b.up - a.up;
  [a, b] = await press("9");
  seen.nearer = b.distance / a.distance;
}

async function onATelephone() {
  await open();
  await settle();
  seen.width = await page.evaluate(() => document.documentElement.scrollWidth);
  seen.canvas = await page.locator("#canvas").boundingBox();
  seen.part = (await drawn()).part;
  // Words that are wider than where they stand.
  seen.cut = await page.evaluate(() => [...document.querySelectorAll("#side span, #side dd, #side dt, #side button, #now, .plot h3 span")]
    .filter((e) => e.scrollWidth > e.clientWidth + 1 && e.clientWidth > 0).map((e) => e.textContent));
  seen.chartsBefore = await page.locator(".plot canvas").count();
  await page.evaluate(() => scrollTo(0, document.documentElement.scrollHeight));
  await page.waitForFunction(() => [...document.querySelectorAll(".plot")].every((p) => p.querySelector("canvas")));
  seen.charts = await page.locator(".plot canvas").count();
  await settle();
  seen.plotPixels = await plotPixels();
  const bar = await page.locator("#bar").boundingBox();
  seen.barInView = bar.y >= -1 && bar.y + bar.height <= 845;
}

// WCAG's contrast of the words in some places to what is behind them.
const contrasts = () => page.evaluate(() => {
  const numbers = (colour) => colour.match(/[\d.]+/g).map(Number);
  const light = (c) => c.slice(0, 3).map((v) => v / 255).map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
    .reduce((sum, v, k) => sum + [0.2126, 0.7152, 0.0722][k] * v, 0);
  const behind = (e) => {
    for (; e; e = e.parentElement) {
      const c = numbers(getComputedStyle(e).backgroundColor);
      if (c.length < 4 || c[3] > 0) return c;
    }
    return [255, 255, 255];
  };
  const places = ["#side h1", "#warnings li", "#side h2", "dt", "dd", ".switches span", "kbd", ".buttons button", ".frames b", ".frames button", ".plot h3 span", "#stages output", "#now", "#play", "button.on", "button.on kbd"];
  return Object.fromEntries(places.map((place) => {
    const e = document.querySelector(place), [a, b] = [light(numbers(getComputedStyle(e).color)), light(behind(e))];
    return [place, (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05)];
  }));
});

async function words() {
  await open();
  await settle();
  await page.keyboard.press("f");
  seen.light = await contrasts();
  await page.keyboard.press("t");
  seen.dark = await contrasts();
  await page.keyboard.press("f");
  seen.warnings = await page.locator("#warnings li").allTextContents();
  seen.warningsAbove = await page.evaluate(() => document.querySelector("#warnings").getBoundingClientRect().top < document.querySelector("dl").getBoundingClientRect().top);
  seen.switches = await page.locator(".switches input + span").allTextContents();
  seen.grid = await page.textContent("#show-grid + span");
  if (!(await page.evaluate(() => window.page.view.byHeight))) await page.keyboard.press("k");
  seen.heights = await page.evaluate(() => window.page.view.heights);
  seen.legend = await page.textContent("#legend");
  await page.keyboard.press("k");
  seen.legendHidden = await page.locator("#legend").isHidden();
  const detect = (await page.textContent("#stages div:has(span:text-is('detect')) output")).split(" ");
  seen.detect = Number(detect[0]) * (detect[1] === "s" ? 1000 : 1);
}

// Seconds from when the page was asked for, in a browser that has done with its own start, until the map is seen, and pictures a second while a hand turns it, once what is drawn has found its size.
async function speed() {
  await page.addInitScript(() => {
    const { drawArrays } = WebGL2RenderingContext.prototype;
    WebGL2RenderingContext.prototype.drawArrays = function (kind, ...rest) {
      drawArrays.call(this, kind, ...rest);
      if (kind !== this.POINTS || window.seconds) return;
      this.readPixels(0, 0, 1, 1, this.RGBA, this.UNSIGNED_BYTE, new Uint8Array(4)); // waits until it is drawn, which finish() does not
      window.seconds = performance.now() / 1000;
    };
  });
  await new Promise((done) => setTimeout(done, 1500));
  await open();
  seen.seconds = await page.evaluate(() => window.seconds);
  await page.waitForFunction(() => document.querySelectorAll(".plot canvas").length === 4);
  await page.evaluate(() => {
    const { view } = window.page, draw = view.draw.bind(view);
    window.pictures = [];
    view.draw = (now) => {
      const drawn = draw(now);
      if (drawn) view.renderer.getContext().finish(), window.pictures.push(performance.now());
      return drawn;
    };
  });
  const { x, y, width, height } = await page.locator("#canvas").boundingBox();
  await page.mouse.move(x + width / 2, y + height / 2);
  await page.mouse.down();
  const start = Date.now();
  for (let k = 0; Date.now() - start < 6000; ++k) {
    await page.mouse.move(x + width / 2 + 200 * Math.sin(k / 40), y + height / 2 + 20 * Math.cos(k / 40));
    await new Promise((done) => setTimeout(done, 12));
  }
  await page.mouse.up();
  seen.rate = await page.evaluate(() => {
    const last = window.pictures.at(-1), kept = window.pictures.filter((time) => time > last - 4000);
    return (1000 * (kept.length - 1)) / (last - kept[0]);
  });
}

await { large, late, keys, narrow: onATelephone, words, speed }[what]();
await browser.close();
console.log(JSON.stringify(seen));
