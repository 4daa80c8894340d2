// Opens a page that is served and looks at it: served_check.mjs VIEWER CHROMIUM pictures|live URL FRAME
// Prints one JSON object of what it saw, which page_test.py judges; `live` prints a line before when the browser is there,
// and one when it shows a picture.
import { launchBrowser, tellShaderFaults } from "../scripts/browser.mjs";

const [viewer, executablePath, what, url, frame] = process.argv.slice(2);
const browser = await launchBrowser(viewer, executablePath);
const page = await browser.newPage({ viewport: { width: 900, height: 640 }, colorScheme: "light" });
await tellShaderFaults(page);
const seen = { errors: [], requests: [] };
const pause = (ms) => new Promise((done) => setTimeout(done, ms));
const watch = () => {
  page.on("console", (m) => ["error", "warning"].includes(m.type()) && seen.errors.push(m.text()));
  page.on("pageerror", (e) => seen.errors.push(e.message));
  page.on("request", (r) => seen.requests.push(r.url()));
};

async function pictures() {
  watch();
  await page.goto(url);
  await page.waitForFunction(() => window.page?.pictures?.tracks > 0);
  await page.locator("#slider").fill(frame);
  await page.waitForFunction((f) => window.page.pictures.frame === Number(f) && !window.page.pictures.busy, frame);
  Object.assign(seen, await page.evaluate(() => {
    const { canvas, tracks, note } = window.page.pictures;
    const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
    let green = 0, blue = 0;
    for (let i = 0; i < data.length; i += 4) {
      green += data[i] < 110 && data[i + 1] > 190 && data[i + 2] < 150;
      blue += data[i] < 130 && data[i + 2] > 200;
    }
    return { size: [canvas.width, canvas.height], drawn: tracks, green, blue, note: note.textContent };
  }));
}

async function live() {
  console.log("here");
  for (;;) {
    try {
      await page.goto(url);
      break;
    } catch {
      await pause(50);
    }
  }
  watch();
  seen.now = [];
  seen.pictures = [];
  for (let over = false; !over; await pause(100)) {
    over = await page.evaluate(() => document.getElementById("live").classList.contains("over"));
    seen.now.push(await page.evaluate(() => document.getElementById("now")?.textContent ?? ""));
    const picture = await page.evaluate(() => {
      const canvas = document.querySelector("#picture canvas");
      if (!canvas || canvas.hidden || !canvas.width) return null;
      const copy = new OffscreenCanvas(canvas.width, canvas.height).getContext("2d", { willReadFrequently: true });
      copy.drawImage(canvas, 0, 0);
      const { data } = copy.getImageData(0, 0, canvas.width, canvas.height);
      let green = 0;
      for (let i = 0; i < data.length; i += 4) green += data[i] < 110 && data[i + 1] > 190 && data[i + 2] < 150;
      return { size: [canvas.width, canvas.height], green, note: document.getElementById("picture-note").textContent };
    });
    if (picture && seen.pictures.push(picture) === 1) console.log("a picture is there");
  }
  Object.assign(seen, await page.evaluate(() => {
    const { view, data } = window.page, gl = view.renderer.getContext(), pixels = new Uint8Array(4 * gl.drawingBufferWidth * gl.drawingBufferHeight);
    view.dirty = true;
    view.draw();
    gl.readPixels(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    let other = 0;
    for (let i = 4; i < pixels.length; i += 4) other += Math.abs(pixels[i] - pixels[0]) > 8;
    return { over: true, state: document.getElementById("live").textContent, pictureLeft: !document.getElementById("picture").hidden, total: data.total, part: (4 * other) / pixels.length };
  }));
}

await { pictures, live }[what]();
await browser.close();
console.log(JSON.stringify(seen));
