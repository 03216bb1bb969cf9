// Where each muscle is: x = r + s f (X d_1 + Y d_2), as in trunk_ocp/scene/body.py. Model axes
// throughout, +Z down; the scene rotates them.

import { instantAt, mixed } from "./data.js";

const CREASE = Math.cos((40 * Math.PI) / 180); // sharper corners of an outline stay sharp
const COARSE_RINGS = 6; // rings of a coarse tube, at least

/** Arrays for the cross-sections of a trunk at one time. */
export function makeSections(trunk) {
  const n = trunk.taper.length;
  return {
    n,
    position: new Float64Array(3 * n),
    d1: new Float64Array(3 * n),
    d2: new Float64Array(3 * n),
    d3: new Float64Array(3 * n),
    scale: new Float64Array(n),
  };
}

/** Cross-sections at time t: linear between samples, rotations the shorter way. */
export function writeSections(sections, plan, t) {
  const { n, position, scale } = sections;
  const instant = instantAt(plan, t);
  for (let k = 0; k < 3 * n; k++) position[k] = mixed(plan.frames.position, 3 * n, k, instant);
  for (let j = 0; j < n; j++) {
    scale[j] = mixed(plan.frames.scale, n, j, instant);
    writeDirectors(sections, j, quaternionAt(plan.frames.quaternion, n, j, instant));
  }
}

/** Cross-sections of a shape that physics.js found, with the scale that keeps the volume. */
export function writeSolution({ n, position, d1, d2, d3, scale }, solution, { taper }) {
  position.set(solution.position);
  for (let j = 0; j < n; j++) {
    [d1, d2, d3].forEach((d, i) => d.set(solution.directors.subarray(9 * j + 3 * i, 9 * j + 3 * i + 3), 3 * j));
    scale[j] = solution.scale * taper[j];
  }
}

function quaternionAt(all, n, j, { before, after, weight }) {
  const a = 4 * (before * n + j);
  const b = 4 * (after * n + j);
  let dot = 0;
  for (let k = 0; k < 4; k++) dot += all[a + k] * all[b + k];
  const signed = dot < 0 ? -weight : weight; // q and -q are the same rotation
  const q = [0, 0, 0, 0];
  for (let k = 0; k < 4; k++) q[k] = (1 - weight) * all[a + k] + signed * all[b + k];
  const length = Math.hypot(...q);
  return q.map((value) => value / length);
}

function writeDirectors({ d1, d2, d3 }, j, [w, x, y, z]) {
  const [ww, xx, yy, zz] = [w * w, x * x, y * y, z * z];
  d1.set([ww + xx - yy - zz, 2 * (x * y + w * z), 2 * (x * z - w * y)], 3 * j);
  d2.set([2 * (x * y - w * z), ww - xx + yy - zz, 2 * (y * z + w * x)], 3 * j);
  d3.set([2 * (x * z + w * y), 2 * (y * z - w * x), ww - xx - yy + zz], 3 * j);
}

/**
 * The tube that an outline sweeps from cross-section `first` to `last`.
 *
 * `triangles` have corners in every cross-section, `coarse` ones only in some.
 */
export function makeTube(outline, hollow, first, last) {
  const corners = creased(outline);
  const rings = last - first + 1;
  const m = outline.length / 2;
  const every = Math.max(1, Math.floor((rings - 1) / COARSE_RINGS));
  const caps = capTriangles(m, hollow, rings * corners.count);
  const count = rings * corners.count + 2 * m;
  const rim = rimOf(corners, rings, count);
  const triangles = [...sideTriangles(corners, m, rings, 1), ...caps];
  const coarse = [...sideTriangles(corners, m, rings, every), ...caps];
  return { outline, first, last, corners, count, rim, triangles, coarse };
}

/**
 * Corners of an outline with normals; two of them where it bends sharply.
 *
 * `begins[i]` and `ends[i]` are the corners of edge i, which goes from point i to the next.
 */
function creased(outline) {
  const m = outline.length / 2;
  const normals = edgeNormals(outline);
  const corners = { x: [], y: [], nx: [], ny: [], begins: [], ends: [], count: 0 };
  const add = (i, [nx, ny]) => {
    const length = Math.hypot(nx, ny) || 1;
    corners.x.push(outline[2 * i]);
    corners.y.push(outline[2 * i + 1]);
    corners.nx.push(nx / length);
    corners.ny.push(ny / length);
    return corners.count++;
  };
  for (let i = 0; i < m; i++) {
    const previous = (i + m - 1) % m;
    const [a, b] = [normals[previous], normals[i]];
    const smooth = a[0] * b[0] + a[1] * b[1] > CREASE;
    corners.ends[previous] = add(i, smooth ? [a[0] + b[0], a[1] + b[1]] : a);
    corners.begins[i] = smooth ? corners.ends[previous] : add(i, b);
  }
  return corners;
}

function edgeNormals(outline) {
  const m = outline.length / 2;
  return Array.from({ length: m }, (_, i) => {
    const j = (i + 1) % m;
    const [x, y] = [outline[2 * j] - outline[2 * i], outline[2 * j + 1] - outline[2 * i + 1]];
    const length = Math.hypot(x, y) || 1;
    return [y / length, -x / length];
  });
}

/** 1 on the edges of a tube's broad faces, 0 inside: where the material draws a line. */
function rimOf({ begins, ends, count: width }, rings, count) {
  const rim = new Float32Array(count);
  rim.fill(1, 0, width);
  rim.fill(1, (rings - 1) * width, rings * width);
  begins.forEach((begin, i) => {
    const before = (i + begins.length - 1) % begins.length;
    const after = (i + 1) % begins.length;
    const sharpBegin = begin !== ends[before];
    const sharpEnd = ends[i] !== begins[after];
    if (sharpBegin === sharpEnd) return; // within a face, or a narrow one
    for (let ring = 0; ring < rings; ring++) rim[ring * width + (sharpBegin ? begin : ends[i])] = 1;
  });
  return rim;
}

/** Triangles between every few rings, the first and the last among them. */
function sideTriangles({ begins, ends, count }, m, rings, every) {
  const triangles = [];
  for (let ring = 0; ring < rings - 1; ring += every) {
    const up = count * Math.min(every, rings - 1 - ring);
    for (let i = 0; i < m; i++) {
      const [a, b] = [ring * count + begins[i], ring * count + ends[i]];
      triangles.push(a, b, b + up, a, b + up, a + up);
    }
  }
  return triangles;
}

/** Triangles of both ends, whose points begin at index `start`. */
function capTriangles(m, hollow, start) {
  const triangles = [];
  for (const [a, b, c] of hollow ? bandTriangles(m) : fanTriangles(m)) {
    triangles.push(start + c, start + b, start + a); // seen from the base
    triangles.push(start + m + a, start + m + b, start + m + c);
  }
  return triangles;
}

function fanTriangles(m) {
  return Array.from({ length: m - 2 }, (_, i) => [i, i + 1, m - 1]);
}

/** Triangles between an outer arc and the inner arc that returns. */
function bandTriangles(m) {
  const triangles = [];
  for (let i = 0; i < m / 2 - 1; i++) {
    triangles.push([i, i + 1, m - 1 - i], [i + 1, m - 2 - i, m - 1 - i]);
  }
  return triangles;
}

/** Write vertices and normals of a tube on cross-sections into arrays of 3 `count` numbers. */
export function writeTube(tube, sections, vertices, normals) {
  const { corners, first, last } = tube;
  let k = 0;
  for (let j = first; j <= last; j++) {
    for (let i = 0; i < corners.count; i++, k += 3) {
      writePoint(vertices, k, sections, j, corners.x[i], corners.y[i]);
      writeDirection(normals, k, sections, j, corners.nx[i], corners.ny[i]);
    }
  }
  k = writeCap(tube, sections, first, -1, k, vertices, normals);
  writeCap(tube, sections, last, 1, k, vertices, normals);
}

function writeCap({ outline }, sections, j, sign, start, vertices, normals) {
  let k = start;
  for (let i = 0; i < outline.length; i += 2, k += 3) {
    writePoint(vertices, k, sections, j, outline[i], outline[i + 1]);
    for (let c = 0; c < 3; c++) normals[k + c] = sign * sections.d3[3 * j + c];
  }
  return k;
}

function writePoint(out, k, { position, d1, d2, scale }, j, x, y) {
  const [X, Y] = [x * scale[j], y * scale[j]];
  for (let c = 0, a = 3 * j; c < 3; c++, a++) out[k + c] = position[a] + X * d1[a] + Y * d2[a];
}

function writeDirection(out, k, { d1, d2 }, j, x, y) {
  for (let c = 0, a = 3 * j; c < 3; c++, a++) out[k + c] = x * d1[a] + y * d2[a];
}

/** Outline of a round cross-section, as a flat array for `makeTube`. */
export function circle(radius, points = 36) {
  const angle = (2 * Math.PI) / points;
  const point = (i) => [radius * Math.cos(i * angle), radius * Math.sin(i * angle)];
  return Float32Array.from(Array.from({ length: points }, (_, i) => point(i)).flat());
}
