// Bundles the page into one file: node build.mjs PAGE.html
import { readFileSync, writeFileSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

const here = dirname(fileURLToPath(import.meta.url));
const bundled = async (entry) => {
  const result = await build({
    entryPoints: [join(here, "src", entry)],
    bundle: true,
    minify: true,
    format: "iife",
    target: "es2020",
    legalComments: "inline",
    write: false,
    logLevel: "warning",
  });
  return result.outputFiles[0].text;
};

// Functions, since a text to replace with would have its dollars interpreted.
const page = readFileSync(join(here, "src", "page.html"), "utf8")
  .replace("/*STYLE*/", await bundled("style.css").then((text) => () => text))
  .replace("/*SCRIPT*/", await bundled("main.js").then((text) => () => text.replaceAll("</script", "<\\/script")));
writeFileSync(process.argv[2], page);
