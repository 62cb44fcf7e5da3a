// The report's plots: each is drawn when it comes near the screen, all before printing; one time axis for all of them.
(() => {
  "use strict";
  const page = JSON.parse(document.getElementById("report-data").textContent);
  const root = document.documentElement;
  const LEFT = 54, RIGHT = 18, BOTTOM = 24; // px
  const coarse = matchMedia("(pointer: coarse)").matches; // fingers scroll, they do not zoom
  const wanted = matchMedia("(prefers-color-scheme: dark)");
  const state = { range: page.span, stamp: 0, cursor: null };

  // --- numbers ---
  const kinds = { f4: Float32Array, f8: Float64Array, u2: Uint16Array, u4: Uint32Array };
  const unpack = (packed) => {
    const [kind, text] = Object.entries(packed)[0];
    return new kinds[kind](Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer);
  };
  const known = new Map();
  const once = (key, make) => known.get(key) ?? (known.set(key, make()), known.get(key));
  const clock = (name) => once(`clock ${name}`, () => unpack(page.clocks[name].t));
  const column = (name) => once(`column ${name}`, () => {
    const { clock: of, v, k } = page.columns[name];
    const all = clock(of), y = Array.from(unpack(v), (value) => (Number.isFinite(value) ? value : null));
    return { x: k ? Array.from(unpack(k), (i) => all[i]) : Array.from(all), y, end: page.clocks[of].end };
  });
  const points = (line) => {
    const { x, y, end } = column(line.c);
    const values = line.factor ? y.map((value) => (value === null ? null : value * line.factor)) : y;
    return line.step ? { x: [...x, end], y: [...values, values.at(-1)] } : { x, y: values };
  };

  // --- looks ---
  const colour = (name) => getComputedStyle(root).getPropertyValue(`--${name}`).trim();
  const faint = (hex, alpha) => {
    const [r, g, b] = [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16));
    return `rgba(${r},${g},${b},${alpha})`;
  };
  const looks = {
    excitation: { width: 1.1, fill: 0.17 }, activation: { width: 1.6 }, emg: { width: 4 },
    desired: { width: 5 }, actual: { width: 1.7 }, error: { width: 1.5 }, net: { width: 2.2 },
    reserve: { width: 1, fill: 0.45 }, load: { width: 1.8, dash: "2px,3px" }, residual: { width: 1.6 }, unmet: { width: 1.3 },
    force: { width: 1.6, fill: 0.12 }, length: { width: 1.6 }, velocity: { width: 1.6 },
    other0: { width: 1.5, dash: "5px,3px" }, other1: { width: 1.5, dash: "2px,2px" },
    other2: { width: 1.5, dash: "7px,2px,2px,2px" }, other3: { width: 1.5, dash: "1px,3px" },
  };
  // Plotly reads a few tags and entities in texts; a muscle's name is no markup
  const plain = (text) => text.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
  const axis = (row) => (row ? `y${row + 1}` : "y");
  const ofOther = (line) => line.role.startsWith("other") && line.role !== "others";

  // scale: what values are multiplied by, so that the axis needs no powers of ten. Labels are ours, see told().
  const trace = (line, scale) => {
    const look = looks[line.role] ?? { width: 1.5 }, own = colour(line.role), { x, y } = points(line);
    const values = scale === 1 ? y : y.map((value) => (value === null ? null : value * scale));
    return {
      type: "scatter", mode: "lines", x, y: values, hoverinfo: "none", yaxis: axis(line.row), connectgaps: false,
      line: { color: own, width: look.width * (line.step && ofOther(line) ? 0.6 : 1), dash: look.dash ?? "solid", shape: line.step ? "hv" : "linear" },
      ...(look.fill ? { fill: "tozeroy", fillcolor: faint(own, look.fill) } : {}),
    };
  };

  // a line that crosses areas of any colour stays visible
  const halo = (line) => (line.role !== "net" ? [] : [{
    type: "scatter", mode: "lines", ...points(line), hoverinfo: "skip", line: { color: colour("seam"), width: 5 },
  }]);

  // Areas above and below zero are stacked apart.
  const stacked = (lines) => {
    const made = [];
    for (const line of lines) {
      const { x, y } = points(line), own = colour(line.role);
      for (const [sign, group] of [[1, "up"], [-1, "down"]]) {
        if (!y.some((value) => sign * value > 0)) continue;
        const fill = line.role === "reserve" ? { fillpattern: { shape: "/", fgcolor: own, bgcolor: "rgba(0,0,0,0)", size: 5 } } : {};
        made.push({
          type: "scatter", mode: "lines", x, y: y.map((value) => (sign * value > 0 ? value : 0)), stackgroup: group,
          hoverinfo: "skip", fillcolor: own, line: { width: 0.6, color: colour("seam") }, ...fill,
        });
      }
    }
    return made;
  };

  const extremes = (lines) => {
    let low = Infinity, high = -Infinity;
    for (const line of lines) {
      for (const value of points(line).y) {
        if (value !== null) { low = Math.min(low, value); high = Math.max(high, value); }
      }
    }
    return [low, high];
  };
  // the ends of an axis; own lines decide, others that go much farther are cut off there
  const limits = (lines, row) => {
    const own = lines.filter((line) => !ofOther(line));
    let [low, high] = extremes(own.length ? own : lines);
    if (!(high >= low)) return [0, 1];
    const [least, most] = extremes(lines), room = 2 * Math.max(high - low, row.least ?? 0);
    [low, high] = [Math.max(least, low - room), Math.min(most, high + room)];
    if (lines.some((line) => looks[line.role]?.fill)) { low = Math.min(low, 0); high = Math.max(high, 0); } // filled from 0
    for (const y of row.limits ?? []) { low = Math.min(low, y); high = Math.max(high, y); }
    const middle = (low + high) / 2, span = Math.max(high - low, row.least ?? 0) || Math.abs(middle) * 0.2 || 1;
    return [middle - 0.56 * span, middle + 0.56 * span];
  };

  // each row: its ends, its scale, and its label with the power of ten and what is cut off
  const power = (n) => `10${[...`${n}`].map((c) => (c === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[c])).join("")}`;
  const axesOf = (panel) => panel.rows.map((row, i) => {
    if (row.top) return { ends: [-0.02 * row.top, 1.05 * row.top], scale: 1, label: row.label };
    if (panel.stack && i === 0) return { ends: null, scale: 1, label: row.label };
    const lines = panel.lines.filter((line) => (line.row ?? 0) === i), ends = limits(lines, row);
    const size = Math.floor(Math.log10(Math.max(Math.abs(ends[0]), Math.abs(ends[1])))), n = size > 3 || size < -2 ? size : 0;
    const [least, most] = extremes(lines), cut = least < ends[0] || most > ends[1];
    const label = n ? row.label.replace("(", `(${power(n)} `) : row.label;
    return { ends: ends.map((y) => y * 10 ** -n), scale: 10 ** -n, label: cut ? `${label}, others are cut off` : label };
  });

  const layoutOf = (panel, width, axes) => {
    const soft = colour("soft"), head = panel.rows.some((row) => row.label) ? 17 : 6;
    const layout = {
      width, height: panel.height, autosize: false, margin: { l: LEFT, r: RIGHT, t: head, b: BOTTOM, autoexpand: false },
      paper_bgcolor: colour("paper"), plot_bgcolor: colour("paper"), showlegend: false,
      hovermode: "x", hoversubplots: "axis", hoverdistance: -1, dragmode: coarse ? false : "zoom",
      font: { family: "system-ui, sans-serif", size: 11, color: soft },
      xaxis: {
        range: [...state.range], fixedrange: coarse, gridcolor: colour("grid"), zeroline: false, nticks: Math.min(12, Math.max(5, Math.round(width / 45))), ticks: "outside",
        ticklen: 3, tickcolor: colour("axis"), ticksuffix: " s", showticksuffix: "last", ticklabeloverflow: "allow", linecolor: colour("axis"),
        anchor: axis(panel.rows.length - 1), showspikes: true, spikemode: "across",
        spikethickness: 1, spikedash: "dot", spikecolor: colour("axis"), spikesnap: "cursor",
      },
      shapes: [], annotations: [],
    };
    const gap = panel.rows.length > 1 ? 26 / panel.height : 0;
    const total = panel.rows.reduce((sum, row) => sum + row.part, 0), free = 1 - gap * (panel.rows.length - 1);
    let top = 1;
    panel.rows.forEach((row, i) => {
      const bottom = Math.max(0, top - (free * row.part) / total);
      layout[i ? `yaxis${i + 1}` : "yaxis"] = {
        domain: [bottom, top], fixedrange: true, gridcolor: colour("grid"), zerolinecolor: colour("axis"), zerolinewidth: 1,
        nticks: row.part >= 2 ? 6 : 4, exponentformat: "power", anchor: "x",
        ...(axes[i].ends ? { range: axes[i].ends } : { autorange: true }), ...(row.top ? { dtick: row.top / 2 } : {}),
      };
      if (row.label) {
        layout.annotations.push({
          text: plain(axes[i].label), xref: "paper", yref: "paper", x: 0, xshift: -LEFT + 4, xanchor: "left", y: top, yanchor: "bottom",
          showarrow: false, font: { size: 11, color: soft },
        });
      }
      top = bottom - gap;
    });
    const shade = (spans, name) => {
      for (const [x0, x1] of spans) {
        layout.shapes.push({ type: "rect", x0, x1, y0: 0, y1: 1, yref: "paper", line: { width: 0 }, fillcolor: colour(name), layer: "below" });
      }
    };
    if (panel.flagged) shade(page.flagged, "flagged");
    for (const [kind, spans] of Object.entries(panel.bands ?? {})) shade(spans, kind);
    panel.rows.forEach((row, i) => {
      for (const y of row.limits ?? []) {
        layout.shapes.push({
          type: "line", x0: 0, x1: 1, xref: "paper", y0: y * axes[i].scale, y1: y * axes[i].scale, yref: axis(i), line: { color: colour("no"), width: 1, dash: "4px,3px" },
        });
      }
    });
    return layout;
  };

  // --- drawing ---
  const figures = [...document.querySelectorAll("figure.panel")];
  const near = new Set();
  const busy = new Set(); // plots whose time axis is being set from here
  const draw = (figure, width) => {
    const plot = figure.querySelector(".plot"), panel = page.panels[figure.dataset.panel];
    if (!plot.firstChild) {
      const canvas = document.createElement("div"), cursor = document.createElement("div");
      cursor.className = "cursor";
      plot.append(canvas, cursor);
    }
    const canvas = plot.firstChild, first = !canvas.data;
    width ??= plot.clientWidth;
    if (!width) return;
    const axes = axesOf(panel);
    const traces = [
      ...(panel.stack ? stacked(panel.stack) : []),
      ...panel.lines.flatMap((line) => [...halo(line), trace(line, axes[line.row ?? 0].scale)]),
    ];
    figure.dataset.stamp = state.stamp;
    figure.dataset.width = width;
    Plotly.react(canvas, traces, layoutOf(panel, width, axes), {
      displaylogo: false, doubleClick: false, scrollZoom: false, displayModeBar: panel.height > 200 && !coarse ? "hover" : false,
      modeBarButtons: [["toImage"]], toImageButtonOptions: { format: "png", scale: 2, filename: panel.title },
    }).catch((error) => console.error(error));
    if (first) {
      canvas.on("plotly_relayout", (change) => relayed(canvas, change));
      canvas.on("plotly_doubleclick", () => setRange(page.span));
      canvas.on("plotly_click", (event) => clicked(plot, event));
      resizes.observe(plot);
      for (const name of ["pointermove", "pointerdown"]) plot.addEventListener(name, (event) => told(panel, plot, event));
      plot.addEventListener("pointerleave", (event) => { if (event.pointerType !== "touch") tip.hidden = true; }); // a tap stays
      figure.dataset.drawn = "";
    }
  };
  const refresh = (figure) => {
    const width = figure.querySelector(".plot").clientWidth;
    if (width && (figure.dataset.stamp !== `${state.stamp}` || figure.dataset.width !== `${width}`)) draw(figure);
  };
  const refreshNear = () => near.forEach(refresh);
  const watcher = new IntersectionObserver((entries) => {
    for (const { target, isIntersecting } of entries) {
      if (isIntersecting) { near.add(target); refresh(target); put(target); } else near.delete(target);
    }
  }, { rootMargin: "300px" });
  let pending = 0;
  const soon = () => { pending ||= requestAnimationFrame(() => { pending = 0; if (!root.classList.contains("printing")) refreshNear(); }); };
  const resizes = new ResizeObserver(soon);
  figures.forEach((figure) => watcher.observe(figure));
  const changed = () => { state.stamp += 1; soon(); };

  // --- one time axis, one time ---
  function setRange(range) { state.range = [...range]; place(); changed(); }
  function relayed(canvas, change) {
    const range = change["xaxis.range"] ?? [change["xaxis.range[0]"], change["xaxis.range[1]"]];
    if (change["xaxis.autorange"]) setRange(page.span);
    else if (range.every(Number.isFinite)) setRange(range);
  }
  function timeAt(plot, event) {
    const box = plot.getBoundingClientRect(), [a, b] = state.range;
    return a + ((event.clientX - box.left - LEFT) / (box.width - LEFT - RIGHT)) * (b - a);
  }
  function clicked(plot, event) {
    const time = Math.min(Math.max(timeAt(plot, event.event), page.span[0]), page.span[1]);
    document.dispatchEvent(new CustomEvent("mjhcmc:time", { detail: { time, from: "plot" } }));
  }
  // --- values at the pointer's time: lines may have clocks of their own, so that no nearest point is of all of them ---
  const tip = document.body.appendChild(document.createElement("div"));
  tip.id = "tip";
  tip.hidden = true;
  for (const name of ["scroll", "pointerdown", "pointercancel"]) addEventListener(name, () => { tip.hidden = true; }, { capture: true, passive: true });
  const valueAt = (line, time) => {
    const { x, y } = points(line), last = x.length - 1;
    if (!(time >= x[0] && time <= x[last])) return null;
    let low = 0, high = last;
    while (high - low > 1) { const middle = (low + high) >> 1; if (x[middle] <= time) low = middle; else high = middle; }
    if (time === x[last]) return y[last];
    if (line.step || y[low] === null || time === x[low]) return y[low]; // of the window that holds it
    return y[high] === null ? null : y[low] + ((time - x[low]) / (x[high] - x[low])) * (y[high] - y[low]);
  };
  const digits = (value) => { // four of them
    const [mantissa, exponent] = value.toExponential(3).split("e").map(Number), tiny = value !== 0 && exponent < -3;
    return (tiny ? `${mantissa}×${power(exponent)}` : `${Number(value.toPrecision(4))}`).replace("-", "−");
  };
  function told(panel, plot, event) {
    const [a, b] = state.range, time = timeAt(plot, event);
    tip.hidden = true;
    if (!(time >= a && time <= b) || !(time >= page.span[0] && time <= page.span[1])) return;
    const rows = [...(panel.stack ?? []).filter((line) => line.role !== "reserve"), ...panel.lines].flatMap((line) => {
      const value = valueAt(line, time);
      if (value === null) return [];
      const row = document.createElement("div"), mark = document.createElement("i");
      mark.style.background = colour(line.role);
      row.append(mark, `${line.name} ${digits(value)}${line.unit ? ` ${line.unit}` : ""}`);
      return [row];
    });
    const head = document.createElement("b");
    head.textContent = `${time.toFixed(3)} s`;
    tip.replaceChildren(head, ...rows);
    tip.hidden = false;
    const { offsetWidth: w, offsetHeight: h } = tip, right = event.clientX + 16;
    tip.style.left = `${Math.max(4, right + w < innerWidth ? right : event.clientX - 16 - w)}px`;
    tip.style.top = `${Math.max(4, Math.min(innerHeight - h - 4, event.clientY - h / 2))}px`;
  }
  // each line by itself: a variable of the whole page would have the browser look at every element, 60 times a second
  function put(figure) {
    const [a, b] = state.range, at = state.cursor === null ? -1 : (state.cursor - a) / (b - a);
    const line = figure.querySelector(".cursor");
    if (!line) return;
    line.style.display = at >= 0 && at <= 1 ? "block" : "none";
    line.style.left = `calc(${LEFT}px + ${at.toFixed(5)} * (100% - ${LEFT + RIGHT}px))`;
  }
  function place() { near.forEach(put); }
  document.addEventListener("mjhcmc:time", (event) => { state.cursor = event.detail.time; place(); });

  // --- light and dark ---
  const remembered = () => { try { return localStorage.getItem("mjhcmc-theme"); } catch { return null; } };
  const remember = (theme) => { try { localStorage.setItem("mjhcmc-theme", theme); } catch { /* a page without storage */ } };
  let chosen = remembered();
  const button = document.getElementById("theme");
  const setTheme = (paper = false) => {
    const theme = paper ? "light" : chosen ?? (wanted.matches ? "dark" : "light");
    button.textContent = theme === "dark" ? "Light" : "Dark"; // also where the page has begun with it
    button.setAttribute("aria-label", `Show the page ${theme === "dark" ? "light" : "dark"}`);
    if (root.dataset.theme === theme) return;
    root.dataset.theme = theme;
    state.stamp += 1;
    document.dispatchEvent(new CustomEvent("mjhcmc:theme", { detail: { theme } }));
  };
  button.hidden = false;
  button.addEventListener("click", () => {
    chosen = root.dataset.theme === "dark" ? "light" : "dark";
    remember(chosen);
    setTheme();
    soon();
  });
  wanted.addEventListener("change", () => { setTheme(); soon(); });
  setTheme();

  // --- paper: all that is not folded away, light, as wide as the page ---
  addEventListener("beforeprint", () => {
    setTheme(true);
    state.range = [...page.span];
    root.classList.add("printing");
    for (const figure of figures) {
      const width = figure.closest("details:not([open]), [hidden]") ? 0 : figure.querySelector(".plot").clientWidth;
      if (width) draw(figure, width);
    }
  });
  addEventListener("afterprint", () => { root.classList.remove("printing"); setTheme(); changed(); });
  const print = document.getElementById("print");
  print.hidden = false;
  print.addEventListener("click", () => window.print());

  // --- finding and ordering muscles, copying the command ---
  const muscles = document.getElementById("muscle-grid");
  const inOrder = muscles ? [...muscles.children] : [];
  document.getElementById("muscle-filter")?.addEventListener("input", (event) => {
    const part = event.target.value.trim().toLowerCase();
    inOrder.forEach((figure) => { figure.hidden = !figure.dataset.name.includes(part); });
    document.getElementById("muscle-none").hidden = inOrder.some((figure) => !figure.hidden);
  });
  const order = document.getElementById("muscle-order");
  order?.addEventListener("click", () => {
    const active = order.getAttribute("aria-pressed") !== "true";
    order.setAttribute("aria-pressed", `${active}`);
    muscles.append(...(active ? [...inOrder].sort((a, b) => b.dataset.peak - a.dataset.peak) : inOrder));
  });
  for (const copy of document.querySelectorAll("[data-copy]")) {
    copy.addEventListener("click", async () => {
      const source = document.getElementById(copy.dataset.copy);
      try {
        await navigator.clipboard.writeText(source.textContent);
        copy.textContent = "Copied";
      } catch { // a browser that does not let pages copy: mark it, to be copied by hand
        getSelection().selectAllChildren(source);
        copy.textContent = "Marked";
      }
    });
  }
  root.dataset.ready = "";
})();
