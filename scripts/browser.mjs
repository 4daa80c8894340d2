// A browser without a window or a graphics card, by the playwright of the viewer.
import { createRequire } from "node:module";
import { resolve } from "node:path";

// Tells a fault of a program of the graphics card as an error of the page, which itself does not wait to ask for it.
export const tellShaderFaults = (page) => page.addInitScript(() => {
  const { linkProgram } = WebGL2RenderingContext.prototype;
  WebGL2RenderingContext.prototype.linkProgram = function (program) {
    linkProgram.call(this, program);
    if (this.getProgramParameter(program, this.LINK_STATUS)) return;
    const shaders = this.getAttachedShaders(program).map((shader) => this.getShaderInfoLog(shader));
    console.error("program of the graphics card:", this.getProgramInfoLog(program), ...shaders);
  };
});

export function launchBrowser(viewer, executablePath) {
  const { chromium } = createRequire(`${resolve(viewer)}/`)("playwright-core");
  return chromium.launch({
    executablePath,
    args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
  });
}
