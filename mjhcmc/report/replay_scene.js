// The scene: reads the data, puts bodies where they are at a time, draws them, their muscles and the desired pose.

class Scene {
  constructor(data) {
    this.data = data;
    this.time = data.time;
    this.count = data.time.length;
    this.position = numbersOf(data.position);
    this.turn = numbersOf(data.turn);
    this.shift = numbersOf(data.shift);
    this.shiftTurn = numbersOf(data.shift_turn);
    this.hasGhost = data.moving.length > 0;
    this.shapes = data.shapes.map(readShape);
    const looks = new Map(); // what is translucent is one area for each look
    for (const s of this.shapes.filter((s) => s.skin)) {
      const look = `${s.rgb} ${s.skin}`;
      looks.set(look, [...(looks.get(look) || []), s]);
    }
    this.skins = [...looks.values()];
    this.bones = this.shapes.filter((s) => !s.skin);
    const moves = new Set(data.moving);
    this.ghosts = this.bones.filter((s) => moves.has(s.body));
    this.activation = unsigned(data.activation);
    this.excitation = unsigned(data.excitation);
    this.wrapped = bytesOf(data.wrapped);
    this.wrapPoints = numbersOf(data.wrap_points);
    this.wrapAt = new Int32Array(this.wrapped.length + 1); // where each slot's two points are
    for (let i = 0; i < this.wrapped.length; i++) this.wrapAt[i + 1] = this.wrapAt[i] + 6 * this.wrapped[i];
    this.still = data.groups.map((g) => ({ at: g.at, turn: matrixOf(g.turn) }));
    this.many = data.tendons.length;
  }

  // the frame at or before a time, and the part of the way to the next
  place(time) {
    const t = this.time;
    let low = 0, high = this.count - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (t[middle] <= time) low = middle;
      else high = middle;
    }
    if (this.count < 2) return [0, 0];
    return [low, Math.min(1, Math.max(0, (time - t[low]) / (t[low + 1] - t[low])))];
  }

  // a share of a muscle at a time; null where it is unknown. Activation goes evenly, excitation is constant between frames
  activationAt(muscle, k, part) {
    const m = this.data.muscles.length, a = this.activation[k * m + muscle];
    const b = part > 0 ? this.activation[(k + 1) * m + muscle] : a;
    return a === 65535 || b === 65535 ? null : (a + part * (b - a)) / 65534;
  }
  excitationAt(muscle, k, part) {
    const e = this.excitation[(part >= 1 ? k + 1 : k) * this.data.muscles.length + muscle];
    return e === 65535 ? null : e / 65534;
  }

  // the largest activation of muscles; null where one is unknown
  largest(muscles, k, part) {
    let found = -1;
    for (const muscle of muscles) {
      const a = this.activationAt(muscle, k, part);
      if (a === null) return null;
      found = Math.max(found, a);
    }
    return found < 0 ? null : found;
  }
  colourOf(a) {
    return a === null ? this.data.unknown : this.data.colours[Math.round(a * (this.data.colours.length - 1))];
  }

  // poses of all groups at frame k and part of the way to the next, and of the desired ones with the error times factor
  poses(k, part, factor) {
    const { moving, centre } = this.data, n = moving.length;
    const actual = this.still.slice(), ghost = this.still.slice();
    const mixed = (of, width, i, j) => {
      const at = (k * n + i) * width + j;
      return part > 0 ? of[at] + part * (of[at + n * width] - of[at]) : of[at];
    };
    for (let i = 0; i < n; i++) {
      const at = [0, 1, 2].map((j) => mixed(this.position, 3, i, j) + centre[j]);
      const turn = matrixOf([0, 1, 2, 3].map((j) => mixed(this.turn, 4, i, j)));
      actual[moving[i]] = { at, turn };
      // points go along straight lines: actual + factor (desired - actual)
      const away = rotationBy([0, 1, 2].map((j) => mixed(this.shiftTurn, 3, i, j)));
      const scaled = away.map((x, j) => (j % 4 ? 0 : 1) + factor * (x - (j % 4 ? 0 : 1)));
      ghost[moving[i]] = { at: at.map((x, j) => x + factor * mixed(this.shift, 3, i, j)), turn: product(turn, scaled) };
    }
    return [actual, ghost];
  }

  // the strands of a tendon: points in the world
  strands(tendon, poses, k, part) {
    const slots = this.data.slots, near = part > 0.5 ? k + 1 : k, centre = this.data.centre;
    const found = [[]];
    for (const stop of tendon.stops) {
      const strand = found[found.length - 1];
      if (Array.isArray(stop)) {
        const { at, turn } = poses[stop[0]], v = times(turn, stop.slice(1));
        strand.push([v[0] + at[0], v[1] + at[1], v[2] + at[2]]);
      } else if (stop < 0) found.push([]);
      else if (this.wrapped[near * slots + stop]) {
        const here = this.wrapAt[near * slots + stop], other = part > 0 ? (near === k ? k + 1 : k) : near;
        const both = this.wrapped[other * slots + stop], there = both ? this.wrapAt[other * slots + stop] : here;
        const share = near === k ? part : 1 - part;
        for (let j = 0; j < 6; j += 3)
          strand.push([0, 1, 2].map((c) => {
            const p = this.wrapPoints[here + j + c];
            return p + share * (this.wrapPoints[there + j + c] - p) + centre[c];
          }));
      }
    }
    return found.filter((strand) => strand.length > 1);
  }

  // Draw at a time. camera: right, up, toward (unit vectors), target, scale (pixels a metre), x, y (pixels of the target).
  // colours: ink, paper, ghost, edge (of bones), rim (of muscles), ground. Gives what the pointer can hit.
  draw(ctx, camera, time, { ghost = true, factor = 1, chosen = -1, colours }) {
    const [k, part] = this.place(time);
    const [actual, wanted] = this.poses(k, part, factor);
    const view = [...camera.right, ...camera.up, ...camera.toward];
    const seen = (poses) =>
      poses.map(({ at, turn }) => ({
        turn: product(view, turn),
        at: times(view, at.map((x, j) => x - camera.target[j])),
      }));
    const screen = (v) => [camera.x + camera.scale * v[0], camera.y - camera.scale * v[1], v[2]];
    const world = (p) => screen(times(view, p.map((x, j) => x - camera.target[j])));
    ctx.lineJoin = ctx.lineCap = "round";
    this.drawGround(ctx, world, camera, colours);
    const own = seen(actual);
    if (ghost && this.hasGhost) {
      const there = seen(wanted);
      ctx.strokeStyle = ctx.fillStyle = colours.ghost;
      ctx.lineWidth = 5;
      fillOutlines(ctx, this.ghosts, there, camera, true);
    }
    for (const skins of this.skins) {
      ctx.globalAlpha = skins[0].skin;
      ctx.fillStyle = shaded(skins[0].rgb, 0);
      fillOutlines(ctx, skins, own, camera, false);
    }
    ctx.globalAlpha = 1;
    const items = this.bones.map((shape) => {
      const { turn, at } = own[shape.body];
      const middle = shape.kind === "capsule" ? shape.points[0].map((x, j) => (x + shape.points[1][j]) / 2)
        : shape.kind === "mesh" ? shape.middle : shape.points[0];
      return { depth: times(turn, middle)[2] + at[2], shape };
    });
    const width = Math.min(3, Math.max(0.6, camera.thick)) * (this.many > 200 ? 0.45 : this.many > 40 ? 0.75 : 1);
    const hits = [];
    this.data.tendons.forEach((tendon, i) => {
      const a = this.largest(tendon.muscles, k, part), muscle = tendon.muscles.length > 0;
      const strands = this.strands(tendon, actual, k, part).map((strand) => strand.map(world));
      if (!strands.length) return;
      const points = strands.flat(), depth = points.reduce((sum, p) => sum + p[2], 0) / points.length;
      const item = {
        depth, strands, muscles: tendon.muscles, index: i, colour: muscle ? this.colourOf(a) : tendon.rgb,
        width: muscle ? width * (2.2 + 5.5 * (a || 0)) : width * 1.4,
      };
      items.push(item);
      if (muscle) hits.push(item);
    });
    items.sort((a, b) => a.depth - b.depth);
    for (const item of items)
      if (item.shape) drawSolid(ctx, item.shape, own[item.shape.body], camera, colours);
      else strokeStrands(ctx, item, item.index === chosen, colours);
    ctx.globalAlpha = 0.3; // what is behind bones shines through
    for (const item of items)
      if (!item.shape) strokeLines(ctx, item.strands, item.colour, item.width);
    ctx.globalAlpha = 1;
    this.data.rings.forEach((ring, i) => {
      const { turn, at } = actual[ring.body], p = world(times(turn, ring.at).map((x, j) => x + at[j]));
      const a = this.largest(ring.muscles, k, part), index = this.many + i;
      ctx.beginPath();
      ctx.arc(p[0], p[1], 11 * width, 0, 2 * Math.PI);
      ctx.lineWidth = width * (5 + 4 * (a || 0));
      ctx.strokeStyle = index === chosen ? colours.ink : colours.paper;
      ctx.stroke();
      ctx.lineWidth = width * (3 + 4 * (a || 0));
      ctx.strokeStyle = this.colourOf(a);
      ctx.stroke();
      hits.push({ strands: [[p, [p[0] + 0.01, p[1], p[2]]]], muscles: ring.muscles, index, width: 30 * width });
    });
    return hits;
  }

  drawGround(ctx, world, camera, colours) {
    ctx.strokeStyle = colours.ground;
    ctx.lineWidth = 1;
    for (const plane of this.data.ground) {
      const from = camera.target.map((x, j) => x - plane.at[j]), across = camera.reach;
      const step = 10 ** Math.floor(Math.log10(across / 1.5)) * (across / 10 ** Math.floor(Math.log10(across)) > 4 ? 2.5 : 1);
      const limits = plane.axes.map((axis, i) => {
        const middle = dot(from, axis), half = plane.half[i] || Infinity;
        return [Math.max(middle - 1.6 * across, -half), Math.min(middle + 1.6 * across, half)];
      });
      ctx.beginPath();
      for (const i of [0, 1]) {
        const [first, last] = limits[i], other = limits[1 - i];
        for (let s = Math.ceil(first / step) * step; s <= last; s += step)
          other.forEach((o, end) => {
            const p = world(plane.at.map((x, j) => x + s * plane.axes[i][j] + o * plane.axes[1 - i][j]));
            if (end) ctx.lineTo(p[0], p[1]);
            else ctx.moveTo(p[0], p[1]);
          });
      }
      ctx.stroke();
    }
  }
}

function strokeLines(ctx, strands, colour, width) {
  ctx.beginPath();
  for (const strand of strands) strand.forEach((p, i) => (i ? ctx.lineTo(p[0], p[1]) : ctx.moveTo(p[0], p[1])));
  ctx.strokeStyle = colour;
  ctx.lineWidth = width;
  ctx.stroke();
}

function strokeStrands(ctx, item, chosen, colours) {
  const width = item.width + (chosen ? 2 : 0);
  strokeLines(ctx, item.strands, chosen ? colours.ink : colours.rim, width + (chosen ? 3 : Math.min(1.2, 0.4 * width)));
  strokeLines(ctx, item.strands, item.colour, width);
}
