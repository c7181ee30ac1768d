// Moves the arms, the time marks and the numbers. Arrays come packed as base64 of little-endian float32.
(() => {
  "use strict";
  const unpack = text => new Float32Array(Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer);
  const $ = id => document.getElementById(id);

  const runs = JSON.parse($("motion").textContent).map(run => {
    run.t = unpack(run.t);
    if (!run.space) {
      for (const name of ["joints", "tip", "target", "obstacles", "points", "forces"]) run[name] = unpack(run[name]);
      // Of an obstacle that turns there is one at every instant.
      const outline = one => Array.isArray(one) ? one.map(unpack) : unpack(one);
      run.outlines = run.outlines.map(outline);
      run.halos = run.halos.map(outline);
      if (run.plan) run.plan = unpack(run.plan);
    }
    for (const name in run.now) run.now[name] = unpack(run.now[name]);
    return run;
  });
  const begin = Math.min(...runs.map(run => run.t[0]));
  const end = Math.max(...runs.map(run => run.t[run.t.length - 1]));
  const views = runs.map((run, i) => run.space && vffnullSpace.open($(`space-${i}`), run, unpack));
  let doc, sources, marks, time = begin, playing = null, frame = null;

  // The last instant that is not later than t.
  const rowAt = (run, t) => {
    let low = 0, high = run.t.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (run.t[middle] <= t + 1e-6) low = middle; else high = middle - 1;
    }
    return low;
  };

  const evens = (flat, from, to) => Array.from({ length: (to - from) / 2 }, (_, i) => flat[from + 2 * i]);
  const split = (flat, from, to) => ({ x: evens(flat, from, to), y: evens(flat, from + 1, to + 1) });
  const moved = (outlines, places, row, count) => {
    const xs = [], ys = [], from = row * count * 2;
    outlines.forEach((outline, k) => {
      const points = Array.isArray(outline) ? outline[row] : outline;
      const { x, y } = split(points, 0, points.length);
      xs.push(x.map(v => v + places[from + 2 * k]));
      ys.push(y.map(v => v + places[from + 2 * k + 1]));
    });
    return { xs, ys };
  };

  // Outline of all points nearer than r to the segment ab.
  const capsule = (ax, ay, bx, by, r) => {
    const heading = Math.atan2(by - ay, bx - ax), xs = [], ys = [];
    for (let i = 0; i <= 36; i++) {
      const angle = heading - Math.PI / 2 + (i * Math.PI) / 18, [x, y] = i <= 18 ? [bx, by] : [ax, ay];
      xs.push(x + r * Math.cos(angle));
      ys.push(y + r * Math.sin(angle));
    }
    return [xs, ys];
  };

  const draw = (run, index) => {
    const row = rowAt(run, time);
    if (views[index]) { views[index].show(row); return row; }
    const n = run.radii.length, k = run.outlines.length;
    const set = (what, data) => { sources[`${what}-${index}`].data = data; };
    const { x, y } = split(run.joints, row * (n + 1) * 2, (row + 1) * (n + 1) * 2);
    set("joints", { x, y });
    const pair = (values, i) => [values[i], values[i + 1]], each = [...run.radii.keys()];
    set("links", { xs: each.map(i => pair(x, i)), ys: each.map(i => pair(y, i)), colour: run.colours });
    set("solids", moved(run.outlines, run.obstacles, row, k));
    set("halos", moved(run.halos, run.obstacles, row, k));
    set("target", split(run.target, row * 2, row * 2 + 2));
    set("trail", split(run.tip, 0, row * 2 + 2));
    const bodies = { xs: [], ys: [], colour: [] };
    run.radii.forEach((r, i) => {
      if (r <= 0) return;
      const [xs, ys] = capsule(x[i], y[i], x[i + 1], y[i + 1], r);
      bodies.colour.push(run.colours[i]);
      bodies.xs.push(xs);
      bodies.ys.push(ys);
    });
    set("bodies", bodies);
    if (run.plan) {
      const plan = { xs: [], ys: [] };
      run.radii.forEach((r, i) => {
        const [ax, ay, bx, by] = run.plan.subarray((row * n + i) * 4);
        const [xs, ys] = r > 0 ? capsule(ax, ay, bx, by, r) : [[ax, bx], [ay, by]];
        plan.xs.push(xs);
        plan.ys.push(ys);
      });
      set("plan", plan);
    }
    const arrows = { xs: [], ys: [], colour: [] }, heads = { xs: [], ys: [], colour: [] };
    for (let i = 0; i < run.arrows.length; i++) {
      const at = (row * run.arrows.length + i) * 2, fx = run.forces[at], fy = run.forces[at + 1];
      const length = Math.hypot(fx, fy), px = run.points[at], py = run.points[at + 1];
      if (!(length > run.longest * 0.03)) continue;
      for (const each of [arrows, heads]) each.colour.push(run.arrows[i]);
      arrows.xs.push([px, px + fx]);
      arrows.ys.push([py, py + fy]);
      const head = Math.min(0.5 * length, 0.14 * run.longest), ux = (fx / length) * head, uy = (fy / length) * head;
      const qx = px + fx, qy = py + fy;
      heads.xs.push([qx + 0.4 * ux, qx - ux - 0.5 * uy, qx - ux + 0.5 * uy]);
      heads.ys.push([qy + 0.4 * uy, qy - uy + 0.5 * ux, qy - uy - 0.5 * ux]);
    }
    set("arrows", arrows);
    set("heads", heads);
    return row;
  };

  const prefixes = [["", 1], ["m", 1e-3], ["µ", 1e-6], ["n", 1e-9], ["p", 1e-12]];
  const readable = (value, unit) => {
    if (!Number.isFinite(value)) return "–";
    if (Math.abs(value) < 1e-12) return `0 ${unit}`; // rounding
    const [prefix, factor] = prefixes.find(([, f]) => Math.abs(value) >= f) || ["", 1];
    return `${(value / factor).toPrecision(3).replace("-", "−")} ${prefix}${unit}`;
  };

  const show = () => {
    frame = null;
    runs.forEach((run, index) => {
      const row = draw(run, index);
      if (runs.length > 1) return;
      $("now-error").textContent = readable(run.now.error[row], "m");
      $("now-clearance").textContent = readable(run.now.clearance[row], "m");
      $("now-repulsion").textContent = readable(run.now.repulsion[row], "N");
      $("now-torque").textContent = readable(run.now.torque[row], "N·m");
    });
    for (const mark of marks) mark.location = time;
    $("slider").value = time;
    $("clock").textContent = `${time.toFixed(2)} / ${end.toFixed(end < 10 ? 2 : 1)} s`;
  };
  const seek = t => {
    time = Math.min(Math.max(t, begin), end);
    if (frame === null) frame = requestAnimationFrame(show);
  };

  const pause = () => { playing = null; $("icon").setAttribute("d", "M6 3l15 9-15 9z"); $("play").ariaLabel = "play"; };
  const play = () => {
    if (time >= end) time = begin;
    $("icon").setAttribute("d", "M5 3h5v18H5zM14 3h5v18h-5z");
    $("play").ariaLabel = "pause";
    let last = performance.now();
    const step = now => {
      if (playing !== step) return;
      time += ((now - last) / 1000) * Number($("speed").value);
      last = now;
      if (time >= end) { time = end; pause(); }
      show();
      if (playing === step) requestAnimationFrame(step);
    };
    playing = step;
    requestAnimationFrame(step);
  };
  const toggle = () => (playing ? pause() : play());

  // The panel in which the reader chooses a quantity.
  const choose = () => {
    const run = runs[0], quantity = run.quantities[$("choice").value], figure = doc.get_model_by_name("chosen-figure");
    const values = unpack(quantity.values), size = run.t.length, palette = figure.tags;
    const xs = [], ys = [], colour = [];
    for (let i = 0; i < quantity.count; i++) {
      xs.push(run.t);
      ys.push(values.subarray(i * size, (i + 1) * size));
      colour.push(palette[i % palette.length]);
    }
    sources.chosen.data = { xs, ys, colour, name: quantity.columns };
    figure.left[0].axis_label = quantity.label;
  };

  const start = () => {
    doc = Bokeh.documents[0];
    const all = [...doc._all_models.values()];
    sources = Object.fromEntries(all.filter(m => m.type === "ColumnDataSource" && m.name).map(m => [m.name, m]));
    marks = all.filter(m => m.type === "Span" && m.name === "now");
    window.vffnullSeek = t => { pause(); seek(t); };
    const slider = $("slider");
    slider.min = begin;
    slider.max = end;
    if ($("marks")) for (const t of runs.flatMap(run => run.taken)) {
      const mark = document.createElement("i"), share = (t - begin) / (end - begin || 1);
      mark.style.left = `calc(8px + ${share} * (100% - 16px))`; // the middle of the knob goes so far
      mark.title = `new plan at ${t.toFixed(2)} s`;
      $("marks").append(mark);
    }
    slider.addEventListener("input", () => window.vffnullSeek(Number(slider.value)));
    $("play").addEventListener("click", toggle);
    document.addEventListener("keydown", event => {
      if (["SELECT", "SUMMARY"].includes(event.target.tagName) || event.target.closest(".views")) return;
      const jump = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
      if (event.key === " ") toggle();
      else if (jump) window.vffnullSeek(time + (jump * (end - begin)) / (event.shiftKey ? 20 : 200));
      else return;
      event.preventDefault();
    });
    for (const button of document.querySelectorAll(".views button"))
      button.addEventListener("click", () => vffnullSpace.go(button.textContent));
    if ($("colours")) $("colours").addEventListener("change", () => {
      const byLink = $("colours").value === "link";
      vffnullSpace.colour(byLink);
      $("scale").hidden = byLink;
    });
    if ($("choice")) {
      runs[0].quantities.forEach((quantity, i) => {
        if (quantity.count) $("choice").append(new Option(`${quantity.name}: ${quantity.label}`, i));
      });
      $("choice").addEventListener("change", choose);
      choose();
    }
    show();
    document.documentElement.dataset.ready = "yes";
  };
  const wait = () => {
    if (window.Bokeh && Bokeh.documents.length && Bokeh.documents[0].is_idle !== false) start();
    else setTimeout(wait, 20);
  };
  wait();
})();
