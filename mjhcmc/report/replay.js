// The player: canvas, buttons, pointer and keys around a Scene. The page's plots follow through "mjhcmc:time" events.

const TIME = "mjhcmc:time";
const STILLS = 5; // in print
const PRINTED = { ink: "#1d2733", paper: "#ffffff", ghost: "#8fd6ae", edge: "#6b5f4c", rim: "#4a5a69", ground: "#c3cad1" };

class Player {
  constructor(root, data) {
    this.root = root;
    this.scene = new Scene(data);
    this.data = data;
    this.parts = Object.fromEntries([...root.querySelectorAll("[data-part]")].map((e) => [e.dataset.part, e]));
    this.canvas = root.querySelector("canvas");
    this.tip = root.querySelector(".replay-tip");
    this.first = data.time[0];
    this.last = data.time[data.time.length - 1];
    this.time = this.first;
    this.playing = false;
    this.chosen = -1;
    this.pointers = new Map();
    this.follows = data.view.centre.length > 1;
    this.parts["follow-label"].hidden = !this.follows;
    const slider = this.parts.slider;
    slider.min = this.first;
    slider.max = this.last;
    if (this.scene.count < 2) for (const name of ["slider", "play", "speed"]) this.parts[name].disabled = true;
    if (!this.scene.hasGhost) for (const name of ["factor-label", "ghost-words"]) this.parts[name].hidden = true;
    if (!data.muscles.length) this.parts.scale.hidden = true;
    this.parts["skin-words"].hidden = !this.scene.skins.length;
    this.resetView();
    this.listen();
    this.show(this.first, false);
  }

  listen() {
    const { play, slider, speed, ghost, factor, follow, reset } = this.parts, canvas = this.canvas;
    play.addEventListener("click", () => this.play(!this.playing));
    slider.addEventListener("input", () => {
      this.play(false);
      this.show(Number(slider.value));
    });
    speed.addEventListener("change", () => (this.since = null));
    for (const control of [ghost, factor, follow]) control.addEventListener("change", () => this.redraw());
    reset.addEventListener("click", () => this.resetView(true));
    canvas.addEventListener("dblclick", () => this.resetView(true));
    canvas.addEventListener("pointerdown", (event) => this.press(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => this.release(event));
    canvas.addEventListener("pointerleave", (event) => event.pointerType !== "touch" && this.point(null)); // a tap stays
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    this.root.addEventListener("keydown", (event) => this.key(event));
    document.addEventListener(TIME, (event) => {
      if (!event.detail || event.detail.from === "replay" || !Number.isFinite(event.detail.time)) return;
      this.play(false);
      this.show(event.detail.time, false);
    });
    new ResizeObserver(() => this.redraw()).observe(canvas);
    new MutationObserver(() => this.redraw()).observe(document.documentElement, { attributes: true });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.redraw());
    addEventListener("beforeprint", () => this.print());
    addEventListener("afterprint", () => {
      this.printing = false;
      canvas.style.height = "";
      this.redraw();
    });
  }

  // time

  show(time, tell = true) {
    this.time = Math.min(this.last, Math.max(this.first, time));
    const { slider, time: words } = this.parts;
    slider.value = this.time;
    words.textContent = `${this.time.toFixed(3)} s`;
    slider.setAttribute("aria-valuetext", words.textContent);
    if (tell) document.dispatchEvent(new CustomEvent(TIME, { detail: { time: this.time, from: "replay" } }));
    this.redraw();
  }

  play(on) {
    if (on === this.playing || (on && this.scene.count < 2)) return;
    this.playing = on;
    this.since = null;
    this.parts.play.textContent = on ? "Pause" : "Play";
    if (!on) return;
    if (this.time >= this.last) this.show(this.first);
    requestAnimationFrame((now) => this.advance(now));
  }

  advance(now) {
    if (!this.playing) return;
    if (this.since === null) this.since = { now, time: this.time };
    const time = this.since.time + ((now - this.since.now) / 1000) * Number(this.parts.speed.value);
    if (time < this.last) this.show(time);
    else {
      const again = this.parts.loop.checked;
      this.show(again ? this.first : this.last);
      this.since = null;
      if (!again) return this.play(false);
    }
    requestAnimationFrame((next) => this.advance(next));
  }

  step(frames) {
    const t = this.data.time, near = t.reduce((best, x, i) => (Math.abs(x - this.time) < Math.abs(t[best] - this.time) ? i : best), 0);
    this.play(false);
    this.show(t[Math.min(t.length - 1, Math.max(0, near + frames))]);
  }

  key(event) {
    const own = event.target === this.canvas;
    this.canvas.classList.remove("replay-touched");
    const does = { " ": () => this.play(!this.playing), Home: () => this.show(this.first), End: () => this.show(this.last),
      ArrowRight: () => this.step(event.shiftKey ? 10 : 1), ArrowLeft: () => this.step(event.shiftKey ? -10 : -1) }[event.key];
    if (!does || event.ctrlKey || event.altKey || event.metaKey) return;
    if (!own && event.target !== this.parts.slider) return; // buttons and lists keep their own keys
    event.preventDefault();
    does();
  }

  // view

  resetView(redraw = false) {
    const { right, up } = this.data.view;
    Object.assign(this, { right: right.slice(), up: up.slice(), zoom: 1, pan: [0, 0] });
    if (redraw) this.redraw();
  }

  camera(width, height, time, k, part) {
    const { half, centre } = this.data.view;
    let at = centre[0], across = half[0];
    if (this.follows && this.parts.follow.checked)
      at = centre[k].map((x, j) => (part > 0 ? x + part * (centre[k + 1][j] - x) : x));
    else if (this.follows) {
      const end = centre[centre.length - 1];
      at = centre[0].map((x, j) => (x + end[j]) / 2);
      across += Math.hypot(...centre[0].map((x, j) => x - end[j])) / 2;
    }
    const fit = Math.min((0.47 * width) / across, (0.46 * height) / half[1]);
    return {
      right: this.right, up: this.up, toward: cross(this.right, this.up), target: at, scale: fit * this.zoom,
      x: width / 2 + this.pan[0], y: height / 2 + this.pan[1], reach: Math.max(half[0], half[1]), thick: (Math.min(width, height) / 430) * Math.sqrt(this.zoom),
    };
  }

  rotate(dx, dy) {
    const about = this.data.view.axis, turn = (by, v) => times(rotationBy(by), v);
    const azimuth = about.map((x) => -x * dx * 0.009);
    this.right = unit(turn(azimuth, this.right));
    this.up = unit(turn(azimuth, this.up));
    const lift = this.right.map((x) => -x * dy * 0.009), up = turn(lift, this.up);
    if (dot(up, about) > -0.02) this.up = unit(up); // not over the head
    this.redraw();
  }

  zoomBy(factor, x, y) {
    const before = this.zoom;
    this.zoom = Math.min(40, Math.max(0.3, this.zoom * factor));
    const box = this.canvas.getBoundingClientRect(), share = this.zoom / before;
    this.pan = [x - box.left - box.width / 2, y - box.top - box.height / 2].map((p, i) => p - share * (p - this.pan[i]));
    this.redraw();
  }

  wheel(event) {
    if (document.activeElement !== this.canvas && !event.ctrlKey) return; // else the page could not be scrolled past it
    event.preventDefault();
    this.zoomBy(Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0015) * (event.ctrlKey ? 4 : 1)), event.clientX, event.clientY);
  }

  press(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.canvas.classList.add("replay-touched"); // no ring around what the pointer chose
    this.canvas.focus({ preventScroll: true });
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    this.point(event);
  }

  move(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return this.point(event);
    const now = [event.clientX, event.clientY], d = [now[0] - before[0], now[1] - before[1]];
    const other = [...this.pointers].find(([id]) => id !== event.pointerId);
    this.pointers.set(event.pointerId, now);
    if (Math.hypot(...d) > 0) this.point(null);
    if (other) {
      const apart = (p) => Math.max(10, Math.hypot(p[0] - other[1][0], p[1] - other[1][1]));
      this.pan = this.pan.map((p, i) => p + d[i] / 2);
      this.zoomBy(apart(now) / apart(before), (now[0] + other[1][0]) / 2, (now[1] + other[1][1]) / 2);
    } else if (event.shiftKey || event.buttons & 6) {
      this.pan = this.pan.map((p, i) => p + d[i]);
      this.redraw();
    } else this.rotate(...d);
  }

  release(event) {
    this.pointers.delete(event.pointerId);
  }

  // pointer on muscles

  point(event) {
    const box = this.canvas.getBoundingClientRect();
    this.pointer = event ? [event.clientX - box.left, event.clientY - box.top, event.pointerType === "touch" ? 18 : 7] : null;
    this.redraw();
  }

  hit() {
    if (!this.pointer) return null;
    const [x, y, slack] = this.pointer;
    let found = null, least = slack;
    for (const item of this.hits || [])
      for (const strand of item.strands)
        for (let i = 1; i < strand.length; i++) {
          const [p, q] = [strand[i - 1], strand[i]], d = [q[0] - p[0], q[1] - p[1]], l = d[0] * d[0] + d[1] * d[1];
          const s = l > 0 ? Math.min(1, Math.max(0, ((x - p[0]) * d[0] + (y - p[1]) * d[1]) / l)) : 0;
          const far = Math.hypot(x - p[0] - s * d[0], y - p[1] - s * d[1]) - item.width / 2;
          if (far < least) [found, least] = [item, far];
        }
    return found;
  }

  tell(item, width) {
    this.tip.hidden = !item;
    if (!item) return;
    const [k, part] = this.scene.place(this.time), words = (x) => (x === null ? "unknown" : x.toFixed(3));
    this.tip.replaceChildren();
    for (const muscle of item.muscles) {
      const name = document.createElement("b"), line = document.createElement("div");
      name.textContent = this.data.muscles[muscle];
      const excitation = words(this.scene.excitationAt(muscle, k, part)), at = this.data.time[part >= 1 ? k + 1 : k];
      line.textContent = `activation ${words(this.scene.activationAt(muscle, k, part))}, excitation ${excitation}`;
      if (this.data.thinned) line.textContent += ` (of ${at.toFixed(3)} s)`; // windows between frames are not known here
      this.tip.append(name, line);
    }
    const left = Math.min(this.pointer[0] + 14, width - this.tip.offsetWidth - 4);
    this.tip.style.left = `${Math.max(2, left)}px`;
    this.tip.style.top = `${Math.max(2, this.pointer[1] - this.tip.offsetHeight - 10)}px`;
  }

  // drawing

  colours() {
    const style = getComputedStyle(this.root);
    return Object.fromEntries(Object.entries(PRINTED).map(([name, plain]) => [name, style.getPropertyValue(`--r-${name}`).trim() || plain]));
  }

  redraw() {
    if (this.waiting || this.printing) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      if (!this.printing) this.paint();
    });
  }

  look() {
    const factor = Number(this.parts.factor.value), ghost = this.parts.ghost.checked;
    const how = factor > 1 ? `its distance drawn ${factor} times as large` : "behind";
    this.parts["ghost-text"].textContent = `desired pose, ${how}; ${this.data.off}`;
    this.parts["ghost-words"].hidden = !ghost || !this.scene.hasGhost;
    return { ghost, factor };
  }

  paint() {
    const width = this.canvas.clientWidth, height = this.canvas.clientHeight, fine = devicePixelRatio || 1;
    if (!width || !height) return;
    const size = [Math.round(width * fine), Math.round(height * fine)];
    if (this.canvas.width !== size[0] || this.canvas.height !== size[1]) [this.canvas.width, this.canvas.height] = size;
    const ctx = this.canvas.getContext("2d");
    ctx.setTransform(fine, 0, 0, fine, 0, 0);
    ctx.clearRect(0, 0, width, height);
    const camera = this.camera(width, height, this.time, ...this.scene.place(this.time));
    const draw = () => (this.hits = this.scene.draw(ctx, camera, this.time, { ...this.look(), chosen: this.chosen, colours: this.colours() }));
    draw();
    const item = this.hit(), chosen = item ? item.index : -1;
    if (chosen !== this.chosen) {
      this.chosen = chosen;
      ctx.clearRect(0, 0, width, height);
      draw();
    }
    this.tell(item, width);
  }

  // on paper: stills in a row
  print() {
    this.printing = true;
    this.tip.hidden = true;
    this.play(false);
    const each = this.scene.count < 2 ? 1 : STILLS, w = 1000 / each, h = each > 1 ? 330 : 420, fine = 2;
    [this.canvas.width, this.canvas.height] = [1000 * fine, h * fine];
    this.canvas.style.height = "auto";
    const ctx = this.canvas.getContext("2d");
    for (let i = 0; i < each; i++) {
      const time = this.first + ((this.last - this.first) * i) / Math.max(1, each - 1);
      ctx.setTransform(fine, 0, 0, fine, i * w * fine, 0);
      ctx.save();
      ctx.beginPath();
      ctx.rect(0, 0, w, h);
      ctx.clip();
      const camera = this.camera(w, h - 24, time, ...this.scene.place(time));
      this.scene.draw(ctx, camera, time, { ...this.look(), colours: PRINTED });
      ctx.fillStyle = PRINTED.ink;
      ctx.font = "15px sans-serif";
      ctx.textAlign = "center";
      ctx.fillText(`${time.toFixed(3)} s`, w / 2, h - 6);
      ctx.restore();
    }
  }
}

for (const root of document.querySelectorAll(".replay")) {
  const source = document.getElementById("mjhcmc-replay-data");
  if (source) root.replayPlayer = new Player(root, JSON.parse(source.textContent));
}
