// Draws the map and path of a result's page into a file: picture.mjs VIEWER PAGE.html PICTURE.jpg [light|dark [SHARE]]
// Of a page with a surface: that, as the frame sees it that comes after SHARE of the frames.
import { writeFileSync } from "node:fs";
import { resolve } from "node:path";
import { pathToFileURL } from "node:url";
import { launchBrowser } from "./browser.mjs";

const [viewer, file, picture, theme = "dark", share = 0.5] = process.argv.slice(2);
const browser = await launchBrowser(viewer, process.env.CHROMIUM ?? "/usr/bin/chromium");
const [width, height] = [1200, 640];
const page = await browser.newPage({ viewport: { width, height }, colorScheme: theme });
await page.goto(pathToFileURL(resolve(file)).href);
await page.waitForFunction(() => window.page?.view);
await page.waitForFunction(() => !window.page.data.mesh || window.page.view.texture?.image);
// Drawn twice as large and made smaller: smooth edges without a graphics card.
const text = await page.evaluate(async ([width, height, share]) => {
  const { view, data, seek } = window.page;
  seek(Math.floor(0.62 * data.total));
  document.body.style.display = "block";
  for (const id of ["side", "plots", "bar"]) document.getElementById(id).style.display = "none";
  document.getElementById("view").style.cssText = `width:${width}px;height:${height}px`;
  await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
  view.renderer.setPixelRatio(2);
  view.resize(width, height);
  view.apply();
  view.home();
  // A surface is looked at from beside and behind where it was filmed.
  if (data.mesh) {
    Object.assign(view.shown, { path: false, cameras: false, grid: false, points: false });
    view.now = -1;
    view.apply();
    const to = (v) => view.root.localToWorld(v);
    const i = Math.floor(share * (view.world.count - 1)), eye = view.position(i), q = view.rotation(i);
    const ahead = eye.clone().set(0, 0, view.reach).applyQuaternion(q);
    const aside = eye.clone().set(0.3 * view.reach, -0.1 * view.reach, -0.3 * view.reach).applyQuaternion(q);
    view.camera.position.copy(to(eye.clone().add(aside)));
    view.controls.target.copy(to(eye.clone().add(ahead)));
  }
  view.moved = -Infinity;
  view.controls.update();
  view.thin(performance.now() + 1e6);
  view.renderer.render(view.scene, view.camera);
  const small = document.createElement("canvas");
  [small.width, small.height] = [width, height];
  const context = small.getContext("2d");
  context.imageSmoothingQuality = "high";
  context.drawImage(view.renderer.domElement, 0, 0, width, height);
  return small.toDataURL("image/jpeg", 0.88);
}, [width, height, Number(share)]);
writeFileSync(picture, Buffer.from(text.slice(text.indexOf(",") + 1), "base64"));
await browser.close();
console.log(`picture: ${picture}`);
