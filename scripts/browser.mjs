// A browser without a window or a graphics card, by the playwright of the viewer.
import { createRequire } from "node:module";
import { resolve } from "node:path";

export function launchBrowser(viewer, executablePath) {
  const { chromium } = createRequire(`${resolve(viewer)}/`)("playwright-core");
  return chromium.launch({
    executablePath,
    args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
  });
}
