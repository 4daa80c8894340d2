// Covariances of positions as ellipsoids.
import { InstancedMesh, Matrix4, MeshLambertMaterial, SphereGeometry } from "three";

const NINETY = Math.sqrt(6.251388631); // 90 % of a normal distribution in space lie within so many standard deviations

// Lower triangular root of a covariance: it takes the unit sphere to the ellipsoid of one standard deviation.
function root(c, i) {
  const [xx, xy, xz, yy, yz, zz] = c.subarray(6 * i, 6 * i + 6);
  const a = Math.sqrt(Math.max(xx, 0)), safe = (top, bottom) => (bottom > 0 ? top / bottom : 0);
  const b = safe(xy, a), d = safe(xz, a);
  const e = Math.sqrt(Math.max(yy - b * b, 0));
  const g = safe(yz - b * d, e);
  return { a, b, d, e, g, h: Math.sqrt(Math.max(zz - d * d - g * g, 0)) };
}

// 90 % ellipsoid of frame i of a world, so many times as large.
export function ellipsoidMatrix({ covariance, pose }, i, exaggeration) {
  const r = root(covariance, i), s = NINETY * exaggeration, [x, y, z] = pose.subarray(7 * i, 7 * i + 3);
  // prettier-ignore
  return new Matrix4().set(s * r.a, 0, 0, x,  s * r.b, s * r.e, 0, y,  s * r.d, s * r.g, s * r.h, z,  0, 0, 0, 1);
}

export const ellipsoidMaterial = () => new MeshLambertMaterial({ transparent: true, opacity: 0.3, depthWrite: false });

export function ellipsoids(count, detail, material) {
  const mesh = new InstancedMesh(new SphereGeometry(1, detail, Math.round(0.7 * detail)), material, count);
  mesh.frustumCulled = false;
  return mesh;
}
