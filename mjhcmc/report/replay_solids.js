// Solids: ellipsoids, capsules and meshes in an orthographic projection, shaded as if lit from above at the left.
// Vectors are arrays of three, matrices arrays of nine by rows; lengths in m.

const LIGHT = unit([-0.45, 0.62, 0.65]); // right, up, towards the eye
const SHADES = [-0.42, -0.3, -0.19, -0.09, 0, 0.1, 0.22, 0.36]; // from black to white, by steps of light
const MIDDLE = 4;

function unit(v) {
  const l = Math.hypot(...v);
  return v.map((x) => x / l);
}
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const times = (m, v) => [0, 3, 6].map((r) => m[r] * v[0] + m[r + 1] * v[1] + m[r + 2] * v[2]);
const product = (a, b) =>
  [0, 1, 2, 3, 4, 5, 6, 7, 8].map((i) => {
    const r = i - (i % 3), c = i % 3;
    return a[r] * b[c] + a[r + 1] * b[c + 3] + a[r + 2] * b[c + 6];
  });

function matrixOf([w, x, y, z]) {
  const s = 2 / (w * w + x * x + y * y + z * z);
  return [
    1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y),
    s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x),
    s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y),
  ];
}

function rotationBy(v) { // Rodrigues' formula
  const angle = Math.hypot(...v);
  const a = angle > 1e-9 ? Math.sin(angle) / angle : 1;
  const b = angle > 1e-9 ? (1 - Math.cos(angle)) / (angle * angle) : 0.5;
  const [x, y, z] = v;
  return [
    1 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y,
    b * x * y + a * z, 1 - b * (x * x + z * z), b * y * z - a * x,
    b * x * z - a * y, b * y * z + a * x, 1 - b * (x * x + y * y),
  ];
}

function bytesOf(text) {
  const raw = atob(text), bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  return bytes;
}
const unsigned = (text) => new Uint16Array(bytesOf(text).buffer);
function numbersOf(packed) {
  const whole = new Int16Array(bytesOf(packed.of).buffer);
  return Float64Array.from(whole, (x) => x * packed.scale);
}

// darker or lighter: towards black or white
function shaded(rgb, share) {
  const goal = share < 0 ? 0 : 255, part = Math.abs(share);
  return `rgb(${rgb.map((c) => Math.round(c + (goal - c) * part)).join(",")})`;
}

function readShape(told) {
  const shape = { body: told.body, kind: told.kind, skin: told.skin || 0, radius: told.radius || 0, rgb: told.rgb };
  shape.colours = SHADES.map((s) => shaded(told.rgb, s));
  if (told.kind !== "mesh") {
    shape.points = told.points;
    return shape;
  }
  const v = numbersOf(told.vertices), f = unsigned(told.faces), n = v.length / 3;
  for (let i = 0; i < v.length; i++) v[i] += told.middle[i % 3];
  const normals = new Float64Array(f.length), edges = new Map();
  for (let i = 0; i < f.length; i += 3) {
    const [a, b, c] = [0, 1, 2].map((j) => [v[3 * f[i + j]], v[3 * f[i + j] + 1], v[3 * f[i + j] + 2]]);
    const normal = cross(b.map((x, j) => x - a[j]), c.map((x, j) => x - a[j]));
    const l = Math.hypot(...normal) || 1;
    for (let j = 0; j < 3; j++) {
      normals[i + j] = normal[j] / l;
      const p = f[i + j], q = f[i + ((j + 1) % 3)], key = Math.min(p, q) * 65536 + Math.max(p, q);
      if (!edges.has(key)) edges.set(key, [p, q]);
      edges.get(key).push(i / 3);
    }
  }
  const x = new Float64Array(n), y = new Float64Array(n);
  return { ...shape, v, f, n, normals, edges: [...edges.values()], x, y, front: new Int8Array(f.length / 3), middle: told.middle };
}

// an ellipsoid seen from far away: an ellipse whose half axes are the roots of the eigenvalues of M M^T
function ellipseOf(shape, { turn, at }, camera) {
  const c = times(turn, shape.points[0]), axes = shape.points.slice(1).map((p) => times(turn, p));
  let xx = 0, xy = 0, yy = 0;
  for (const a of axes) {
    xx += a[0] * a[0];
    xy -= a[0] * a[1];
    yy += a[1] * a[1];
  }
  const mean = (xx + yy) / 2, off = Math.hypot((xx - yy) / 2, xy);
  return {
    x: camera.x + camera.scale * (c[0] + at[0]), y: camera.y - camera.scale * (c[1] + at[1]),
    a: camera.scale * Math.sqrt(mean + off), b: camera.scale * Math.sqrt(Math.max(0, mean - off)),
    angle: 0.5 * Math.atan2(2 * xy, xx - yy),
  };
}

// both ends of a capsule on the screen, and its radius
function endsOf(shape, { turn, at }, camera) {
  const ends = shape.points.map((p) => {
    const v = times(turn, p);
    return [camera.x + camera.scale * (v[0] + at[0]), camera.y - camera.scale * (v[1] + at[1])];
  });
  if (Math.hypot(ends[0][0] - ends[1][0], ends[0][1] - ends[1][1]) < 0.05) ends[1][0] += 0.05; // a line of no length is not drawn
  return [ends, camera.scale * shape.radius];
}

// vertices on the screen, and which faces are seen
function project(shape, { turn, at }, camera) {
  const { v, x, y, normals, front } = shape, t = turn, s = camera.scale;
  for (let i = 0, j = 0; i < shape.n; i++, j += 3) {
    x[i] = camera.x + s * (t[0] * v[j] + t[1] * v[j + 1] + t[2] * v[j + 2] + at[0]);
    y[i] = camera.y - s * (t[3] * v[j] + t[4] * v[j + 1] + t[5] * v[j + 2] + at[1]);
  }
  for (let i = 0, j = 0; i < front.length; i++, j += 3)
    front[i] = t[6] * normals[j] + t[7] * normals[j + 1] + t[8] * normals[j + 2] > 0 ? 1 : 0;
}

function addFace(ctx, { f, x, y }, i) {
  ctx.moveTo(x[f[3 * i]], y[f[3 * i]]);
  ctx.lineTo(x[f[3 * i + 1]], y[f[3 * i + 1]]);
  ctx.lineTo(x[f[3 * i + 2]], y[f[3 * i + 2]]);
}

function addSilhouette(ctx, shape) {
  for (const edge of shape.edges) {
    let seen = 0;
    for (let i = 2; i < edge.length; i++) seen += shape.front[edge[i]];
    if (seen === 0 || (seen === edge.length - 2 && edge.length > 3)) continue;
    ctx.moveTo(shape.x[edge[0]], shape.y[edge[0]]);
    ctx.lineTo(shape.x[edge[1]], shape.y[edge[1]]);
  }
}

// add what a solid covers to the path, all of it turning the same way, so that what overlaps is one area
function addOutline(ctx, shape, pose, camera) {
  if (shape.kind === "ellipsoid") {
    const e = ellipseOf(shape, pose, camera);
    ctx.moveTo(e.x + e.a * Math.cos(e.angle), e.y + e.a * Math.sin(e.angle));
    ctx.ellipse(e.x, e.y, e.a, e.b, e.angle, 0, 2 * Math.PI, true);
  } else if (shape.kind === "capsule") {
    const [[p, q], r] = endsOf(shape, pose, camera), way = Math.atan2(q[1] - p[1], q[0] - p[0]), quarter = Math.PI / 2;
    ctx.moveTo(q[0] + r * Math.cos(way + quarter), q[1] + r * Math.sin(way + quarter));
    ctx.arc(...q, r, way + quarter, way - quarter, true);
    ctx.arc(...p, r, way - quarter, way - 3 * quarter, true);
    ctx.closePath();
  } else {
    project(shape, pose, camera);
    for (let i = 0; i < shape.front.length; i++) if (shape.front[i]) addFace(ctx, shape, i);
  }
}

function fillOutlines(ctx, shapes, poses, camera, rim) {
  ctx.beginPath();
  for (const shape of shapes) addOutline(ctx, shape, poses[shape.body], camera);
  ctx.fill();
  if (!rim) return;
  ctx.beginPath();
  for (const shape of shapes)
    if (shape.kind === "mesh") {
      project(shape, poses[shape.body], camera);
      addSilhouette(ctx, shape);
    } else addOutline(ctx, shape, poses[shape.body], camera);
  ctx.stroke();
}

function drawSolid(ctx, shape, pose, camera, colours) {
  const hue = shape.colours;
  ctx.strokeStyle = colours.edge;
  ctx.lineWidth = 1;
  if (shape.kind === "ellipsoid") {
    const e = ellipseOf(shape, pose, camera), fill = ctx.createRadialGradient(-0.35, -0.4, 0.05, 0, 0, 1);
    hue.slice(1).reverse().forEach((c, i, all) => fill.addColorStop(i / (all.length - 1), c));
    ctx.beginPath();
    ctx.ellipse(e.x, e.y, e.a, e.b, e.angle, 0, 2 * Math.PI);
    ctx.stroke();
    ctx.save();
    ctx.translate(e.x, e.y); // the light stays above, at the left, however the ellipse lies
    ctx.rotate(e.angle);
    ctx.scale(e.a, Math.max(e.b, 1e-3));
    ctx.rotate(-e.angle);
    ctx.fillStyle = fill;
    ctx.beginPath();
    ctx.arc(0, 0, 1, 0, 2 * Math.PI);
    ctx.fill();
    ctx.restore();
  } else if (shape.kind === "capsule") {
    const [[p, q], r] = endsOf(shape, pose, camera);
    const line = (width, colour, off) => {
      ctx.strokeStyle = colour;
      ctx.lineWidth = width;
      ctx.beginPath();
      ctx.moveTo(p[0] - 0.7 * off, p[1] - off);
      ctx.lineTo(q[0] - 0.7 * off, q[1] - off);
      ctx.stroke();
    };
    line(2 * r + 1, colours.edge, 0);
    [[2, 2, 0], [1.7, 3, 0.1], [1.35, 4, 0.17], [0.9, 5, 0.24], [0.45, 6, 0.3]].forEach(([w, c, off]) => line(w * r, hue[c], off * r));
  } else {
    project(shape, pose, camera);
    ctx.beginPath();
    addSilhouette(ctx, shape);
    ctx.lineWidth = 1.6;
    ctx.stroke();
    const t = pose.turn, n = shape.normals; // the light in the frame of the solid
    const light = [0, 1, 2].map((c) => LIGHT[0] * t[c] + LIGHT[1] * t[c + 3] + LIGHT[2] * t[c + 6]);
    const level = (i) => light[0] * n[3 * i] + light[1] * n[3 * i + 1] + light[2] * n[3 * i + 2];
    const by = SHADES.map(() => []), top = SHADES.length - 1;
    for (let i = 0; i < shape.front.length; i++)
      if (shape.front[i]) by[Math.max(0, Math.min(top, Math.round(((level(i) + 0.45) / 1.4) * top)))].push(i);
    ctx.beginPath();
    for (let i = 0; i < shape.front.length; i++) if (shape.front[i]) addFace(ctx, shape, i);
    ctx.fillStyle = hue[MIDDLE];
    ctx.fill();
    by.forEach((faces, s) => {
      if (s === MIDDLE || !faces.length) return;
      ctx.beginPath();
      for (const i of faces) addFace(ctx, shape, i);
      ctx.fillStyle = hue[s];
      ctx.fill();
    });
  }
}
