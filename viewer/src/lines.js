// Lines, thick and thin.
import { BufferAttribute, BufferGeometry, LineBasicMaterial, LineSegments } from "three";
import { LineMaterial } from "three/examples/jsm/lines/LineMaterial.js";
import { LineSegments2 } from "three/examples/jsm/lines/LineSegments2.js";
import { LineSegmentsGeometry } from "three/examples/jsm/lines/LineSegmentsGeometry.js";

// `ends`: x y z of both ends of each piece.
export function thickLines(ends, width) {
  const lines = new LineSegments2(new LineSegmentsGeometry(), new LineMaterial({ linewidth: width }));
  lines.frustumCulled = false;
  setEnds(lines, ends);
  return lines;
}

export function setEnds(lines, ends) {
  lines.geometry.dispose();
  lines.geometry = new LineSegmentsGeometry();
  lines.empty = ends.length === 0;
  lines.geometry.setPositions(lines.empty ? [0, 0, 0, 0, 0, 0] : ends);
}

export function thinLines(ends) {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(ends), 3));
  const lines = new LineSegments(geometry, new LineBasicMaterial({ transparent: true, opacity: 0.6 }));
  lines.frustumCulled = false;
  return lines;
}

// Pieces between neighbouring frames of a world, or with `step` between every so many; gaps are not bridged.
export function pathEnds({ pose, index, count }, step = 1) {
  const ends = [];
  for (let i = 0; i + 1 < count; i += step) {
    const j = Math.min(i + step, count - 1);
    if (index[j] - index[i] !== j - i) continue;
    for (const k of [7 * i, 7 * j]) ends.push(pose[k], pose[k + 1], pose[k + 2]);
  }
  return ends;
}
