// Opens a page in a browser and does what a user does: page_check.mjs VIEWER CHROMIUM PAGE.html FRAME_WITHOUT_POSE FRAME_A FRAME_B
// Prints one JSON object of what it saw, which page_test.py judges.
import { pathToFileURL } from "node:url";
import { launchBrowser, tellShaderFaults } from "../scripts/browser.mjs";

const [viewer, executablePath, file, missing, from, to] = process.argv.slice(2);
const browser = await launchBrowser(viewer, executablePath);
const page = await browser.newPage({ viewport: { width: 1100, height: 760 }, colorScheme: "light" });
await tellShaderFaults(page);
const seen = { errors: [], requests: [] };
page.on("console", (m) => ["error", "warning"].includes(m.type()) && seen.errors.push(m.text()));
page.on("pageerror", (e) => seen.errors.push(e.message));
page.on("request", (r) => seen.requests.push(r.url()));

const settle = () => page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => requestAnimationFrame(done)))));
const text = (selector) => page.textContent(selector);
// Pixels of the view that are not its background, and a sum that changes with any of them.
const drawn = async () => {
  await settle();
  return page.evaluate(() => {
    const { renderer } = window.page.view, gl = renderer.getContext();
    const { drawingBufferWidth: w, drawingBufferHeight: h } = gl, pixels = new Uint8Array(4 * w * h);
    window.page.view.dirty = true;
    window.page.view.draw();
    gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    const key = (i) => (pixels[i] << 16) | (pixels[i + 1] << 8) | pixels[i + 2];
    const counts = new Map();
    let sum = 0;
    for (let i = 0; i < pixels.length; i += 4) {
      counts.set(key(i), (counts.get(key(i)) || 0) + 1);
      sum = (sum * 31 + key(i)) % 1000000007;
    }
    const [background, most] = [...counts].reduce((a, b) => (a[1] > b[1] ? a : b));
    return { part: 1 - most / (w * h), colours: counts.size, sum, background };
  });
};

await page.goto(pathToFileURL(file).href);
await page.waitForFunction(() => window.page);
seen.title = await page.title();
seen.heading = await text("#side h1");
seen.bold = await page.locator("#side h1 *").count();
seen.start = await drawn();
await page.waitForFunction(() => [...document.querySelectorAll(".plot")].every((p) => p.querySelector("canvas")));
seen.plots = await page.locator(".plot").count();
seen.plotPixels = await page.evaluate(() => [...document.querySelectorAll(".plot canvas")].map((c) =>
  c.getContext("2d").getImageData(0, 0, c.width, c.height).data.some((v) => v)));

await page.locator("#slider").fill(from);
seen.scrubbed = { now: await text("#now"), ...(await drawn()) };
await page.locator("#slider").fill(to);
seen.further = { now: await text("#now"), ...(await drawn()) };
// What charts say of a frame between key frames.
seen.between = await page.evaluate((last) => {
  const { data, seek } = window.page, [world] = data.worlds, { keyframes } = world;
  let frame = last;
  while (world.at[frame] < 0 || world.keyframeAt[frame] >= 0) --frame;
  seek(frame);
  const before = [...keyframes.frame].filter((i) => world.index[i] < frame).length - 1;
  return { points: keyframes.seen[before], texts: [...document.querySelectorAll(".plot output")].map((e) => e.textContent) };
}, Number(to));
await page.locator("#slider").fill(missing);
seen.missing = { now: await text("#now"), list: await text("#missing") };
await page.locator("#canvas").focus().catch(() => {});
await page.keyboard.press("ArrowRight");
seen.stepped = await text("#now");
await page.keyboard.press("Home");
seen.first = await text("#now");

await page.keyboard.press("p");
seen.noPoints = await drawn();
await page.keyboard.press("e");
await page.selectOption("#exaggeration", "1000");
seen.ellipsoids = await drawn();
await page.keyboard.press("e");
await page.keyboard.press("t");
seen.dark = await drawn();

// In the light, points off: what each of these adds to the picture.
await page.keyboard.press("t");
for (const key of ["r", "o"]) {
  const before = await drawn();
  await page.keyboard.press(key);
  seen[key] = (await drawn()).sum !== before.sum;
}
await page.keyboard.press("p");
const coloured = await drawn();
await page.keyboard.press("k");
seen.heights = (await drawn()).sum !== coloured.sum;

await page.keyboard.press("m");
for (const frame of [from, to]) {
  const at = await page.evaluate((f) => {
    const { view, data } = window.page, box = document.getElementById("view");
    return view.onScreen(view.position(data.worlds[0].at[f]), box.clientWidth, box.clientHeight);
  }, Number(frame));
  await page.mouse.click(at.x, at.y);
}
seen.distance = await text("#distance");

await page.keyboard.press("End");
await page.keyboard.press("Home");
await page.keyboard.press(" ");
await page.waitForFunction(() => window.page.state.frame > 2);
await page.keyboard.press("f");
seen.follow = await drawn();
seen.stages = await page.locator("#stages div").count();
await browser.close();
console.log(JSON.stringify(seen));
