// Scenes in space: what is where at an instant, cameras that are turned by hand, and when to draw. The painters are
// in `webgl.js` and, for browsers without it, in `flat.js`. Vectors are arrays [x, y, z], the z axis points upwards.
const vffnullSpace = (() => {
  "use strict";
  const FIELD_OF_VIEW = 0.6; // vertical [rad]
  const VIEWS = { Corner: [0.62, -0.68, 0.38], Front: [1, 0, 0.16], Side: [0, -1, 0.16], Top: [0, -0.02, 1] };
  const DARK = [0.235, 0.25, 0.282], BASE = [0.47, 0.486, 0.518], HALO = [0.835, 0.369, 0], TABLE = [0.87, 0.84, 0.79],
    UNSEEN = [0.549, 0.573, 0.675];
  const TARGET = [0, 0.62, 0.451], TRAIL = [0, 0.62, 0.451], MUTED = [0.53, 0.55, 0.58];
  const PLAN = [0.1, 0.68, 0.52];
  const AXES = [[0.84, 0.15, 0.16], [0.17, 0.63, 0.17], [0.12, 0.47, 0.71]];

  const add = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const size = a => Math.hypot(a[0], a[1], a[2]);
  const unit = a => { const length = size(a) || 1; return [a[0] / length, a[1] / length, a[2] / length]; };
  const vec = { add, dot, cross, size, unit };

  // The k-th of the rows of three numbers, of an instant where there is more than one.
  const at = (flat, row, count = 1, k = 0) => {
    const from = 3 * ((flat.length > 3 * count ? row * count : 0) + k);
    return [flat[from], flat[from + 1], flat[from + 2]];
  };
  // The columns of the rotation that a quaternion [w, x, y, z] is.
  const columns = (flat, row) => {
    const from = flat.length > 4 ? 4 * row : 0, [w, x, y, z] = flat.subarray(from, from + 4);
    return [
      [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
      [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
      [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
    ];
  };
  const WORLD = { place: [0, 0, 0], turn: [[1, 0, 0], [0, 1, 0], [0, 0, 1]] };
  const into = (pose, p) => [0, 1, 2].reduce((sum, i) => add(sum, pose.turn[i], p[i]), pose.place);

  // A scene as the painters see it.
  const sceneOf = (given, colours, unpack) => {
    for (const name of ["clearance", "tip", "target", "tool", "wanted", "points", "forces"])
      if (given[name]) given[name] = unpack(given[name]);
    given.paths = given.paths.map(unpack);
    for (const frame of given.frames) { frame.place = unpack(frame.place); frame.turn = unpack(frame.turn); }
    for (const body of given.bodies) for (const name of ["corners", "points"])
      if (body[name]) body[name] = unpack(body[name]);
    const rows = given.tip.length / 3, links = given.clearance.length / rows, reach = given.reach;
    const scene = { ...given, rows, byLink: false };
    const middle = [0, 1, 2].map(i => (given.box[0][i] + given.box[1][i]) / 2);

    // From contact over half of the way into the influence distance to beyond it; every second link a little darker.
    const tint = (index, row) => {
      const dim = index % 2 ? 0.9 : 1;
      if (scene.byLink) {
        const hex = parseInt(colours[index].slice(1), 16);
        return [hex >> 16, (hex >> 8) & 255, hex & 255].map(value => value / 255);
      }
      const far = given.clearance[row * links + index] / given.near;
      const share = Number.isFinite(far) ? Math.min(Math.max(far, 0), 1) : 1;
      const [low, high, part] = share < 0.5 ? [0, 1, 2 * share] : [1, 2, 2 * share - 1];
      return given.shades[low].map((value, i) => dim * (value + part * (given.shades[high][i] - value)));
    };
    const pose = (body, row) => {
      if (body.frame === null) return WORLD;
      const frame = given.frames[body.frame];
      return { place: at(frame.place, row), turn: columns(frame.turn, row) };
    };
    const colourOf = { base: () => BASE, obstacle: () => DARK, unseen: () => UNSEEN, halo: () => HALO, surface: () => TABLE, plan: () => PLAN,
                       link: (body, row) => tint(body.index, row) };

    // Everything at an instant: rods { a, b, radius }, hulls { body, pose }, clouds { body, pose }, arrows { tail,
    // vector } and rings { place, radius }, each with its colour; and lines { points, end, width, dash }.
    scene.at = row => {
      const solids = [], shells = [], surfaces = [], ghosts = [];
      for (const body of given.bodies) {
        const where = pose(body, row), colour = colourOf[body.role](body, row);
        const into_list = { halo: shells, surface: surfaces, plan: ghosts }[body.role] || solids;
        if (body.points) into_list.push({ kind: "cloud", body, pose: where, radius: body.radius, colour });
        else if (body.count <= 2) {
          const [a, b] = [0, body.count - 1].map(k => into(where, at(body.corners, row, body.count, k)));
          into_list.push({ kind: "rod", a, b, radius: body.radius, colour });
        } else into_list.push({ kind: "hull", body, pose: where, radius: body.radius, colour });
      }
      given.arrows.forEach((colour, i) => {
        const vector = at(given.forces, row, given.arrows.length, i);
        if (size(vector) > given.least)
          solids.push({ kind: "arrow", tail: at(given.points, row, given.arrows.length, i), vector, colour });
      });
      const tip = at(given.tip, row), target = at(given.target, row), thin = 0.005 * reach;
      const frame = (place, turn, long, thick) => turn.forEach((axis, i) =>
        solids.push({ kind: "rod", a: place, b: add(place, axis, long), radius: thick, colour: AXES[i] }));
      if (given.wanted) frame(target, columns(given.wanted, row), 0.16 * reach, 0.5 * thin);
      if (given.tool) frame(tip, columns(given.tool, row), 0.11 * reach, 1.3 * thin);
      solids.push({ kind: "ring", place: target, radius: 0.07 * reach, colour: TARGET });
      const lines = given.paths.map(points => ({ points, end: rows, width: 1.5, dash: 0.03 * reach, colour: MUTED }));
      if (given.moves) lines.push({ points: given.target, end: rows, width: 1.5, dash: 0.05 * reach, colour: DARK });
      lines.push({ points: given.tip, end: row + 1, width: 2.6, dash: 0, colour: TRAIL });
      return { solids, shells, surfaces, ghosts, lines };
    };

    // How far away the box around everything is just seen from a direction.
    scene.fit = (direction, aspect) => {
      const right = unit(cross([0, 0, 1], direction)), up = cross(direction, right), slope = Math.tan(FIELD_OF_VIEW / 2);
      let away = 0;
      for (let k = 0; k < 8; k++) {
        const corner = add([0, 1, 2].map(i => given.box[(k >> i) & 1][i]), middle, -1);
        const tall = Math.abs(dot(corner, up)), wide = Math.abs(dot(corner, right)) / aspect;
        away = Math.max(away, dot(corner, direction) + Math.max(tall, wide) / slope);
      }
      return away;
    };
    scene.middle = middle;
    return scene;
  };

  // One way to look for all scenes of a page, in angles and in multiples of what each of them needs.
  const look = { azimuth: 0, elevation: 0, zoom: 1, pan: [0, 0, 0], home: "Corner" };
  const views = [];
  const headed = direction => [Math.atan2(direction[1], direction[0]), Math.asin(unit(direction)[2])];
  const directionOf = ({ azimuth: a, elevation: e }) => [Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e)];

  const camera = view => {
    const { scene, canvas } = view, aspect = canvas.width / Math.max(canvas.height, 1);
    const away = scene.fit(unit(VIEWS[look.home]), aspect) / look.zoom, back = directionOf(look);
    const target = add(scene.middle, look.pan, scene.reach), right = unit(cross([0, 0, 1], back)), up = cross(back, right);
    const eye = add(target, back, away), slope = Math.tan(FIELD_OF_VIEW / 2);
    const near = Math.max(0.02 * away, away - 4 * scene.reach), far = away + 8 * scene.reach;
    // A place in shares of the picture, −1 to 1, with its depth and the pixels of a metre there.
    const seen = p => {
      const rest = add(p, eye, -1), depth = -dot(rest, back), scale = canvas.height / 2 / (slope * depth);
      return { x: canvas.width / 2 + scale * dot(rest, right), y: canvas.height / 2 - scale * dot(rest, up), depth, scale };
    };
    return { eye, right, up, back, slope, aspect, near, far, seen };
  };

  let frame = null, gliding = null;
  const paint = view => { if (view.sized) view.painter.draw(view.scene, camera(view), view.row); };
  const draw = () => { frame = null; views.forEach(paint); };
  const redraw = () => { if (frame === null) frame = requestAnimationFrame(draw); };

  const tilt = angle => {
    const lowest = views.some(view => view.scene.floor !== null) ? 0.02 : -1.55;
    look.elevation = Math.min(Math.max(angle, lowest), 1.55);
  };
  const zoom = factor => { look.zoom = Math.min(Math.max(look.zoom * factor, 0.3), 12); redraw(); };
  // By pixels: as far as what is in the middle of the picture follows the pointer.
  const pan = (view, dx, dy) => {
    const { right, up, seen } = camera(view), { scene, canvas } = view;
    const metre = seen(add(scene.middle, look.pan, scene.reach)).scale * canvas.clientHeight / canvas.height * scene.reach;
    look.pan = add(add(look.pan, right, -dx / metre), up, dy / metre);
  };

  // Goes to a view of the list, in a moment.
  const go = name => {
    const from = { ...look }, [azimuth, elevation] = headed(VIEWS[name]), begin = performance.now();
    const turn = ((azimuth - from.azimuth + 3 * Math.PI) % (2 * Math.PI) + 2 * Math.PI) % (2 * Math.PI) - Math.PI;
    const calm = matchMedia("(prefers-reduced-motion: reduce)").matches;
    look.home = name;
    const step = now => {
      if (gliding !== step) return;
      const raw = calm ? 1 : Math.min(Math.max((now - begin) / 350, 0), 1), share = raw * raw * (3 - 2 * raw);
      look.azimuth = from.azimuth + share * turn;
      tilt(from.elevation + share * (elevation - from.elevation));
      look.zoom = from.zoom * (1 / from.zoom) ** share;
      look.pan = from.pan.map(value => (1 - share) * value);
      redraw();
      if (raw < 1) requestAnimationFrame(step); else gliding = null;
    };
    gliding = step;
    requestAnimationFrame(step);
  };

  // One finger or the left button turns, two fingers or the right button move, wheel and fingers zoom. A finger that
  // sets out upwards or downwards scrolls the page instead (`touch-action`).
  const listen = view => {
    const { canvas } = view, fingers = new Map();
    const spread = () => { const [a, b] = [...fingers.values()]; return Math.hypot(a[0] - b[0], a[1] - b[1]); };
    canvas.addEventListener("pointerdown", event => {
      canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
      gliding = null;
    });
    canvas.addEventListener("pointermove", event => {
      const before = fingers.get(event.pointerId);
      if (!before) return;
      const dx = event.clientX - before[0], dy = event.clientY - before[1], apart = fingers.size === 2 ? spread() : 0;
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
      if (fingers.size === 2) {
        zoom(spread() / (apart || 1));
        pan(view, dx / 2, dy / 2);
      } else if (event.buttons & 2 || event.shiftKey) pan(view, dx, dy);
      else { look.azimuth -= 0.008 * dx; tilt(look.elevation + 0.008 * dy); }
      redraw();
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, event => fingers.delete(event.pointerId));
    canvas.addEventListener("wheel", event => {
      event.preventDefault();
      zoom(Math.exp(-event.deltaY * (event.deltaMode === 1 ? 0.05 : 0.0015)));
    }, { passive: false });
    canvas.addEventListener("contextmenu", event => event.preventDefault());
    canvas.addEventListener("dblclick", () => go(look.home));
    canvas.addEventListener("keydown", event => {
      const factor = { "+": 1.2, "=": 1.2, "-": 1 / 1.2 }[event.key];
      if (factor) { zoom(factor); event.preventDefault(); }
    });
    const resized = () => {
      const dots = Math.min(devicePixelRatio || 1, 2);
      canvas.width = Math.round(canvas.clientWidth * dots);
      canvas.height = Math.round(canvas.clientHeight * dots);
      view.sized = canvas.width > 1 && canvas.height > 1;
      paint(view);
    };
    new ResizeObserver(resized).observe(canvas);
  };

  // Draws a run into a canvas; `show(row)` draws another instant, at once.
  const open = (canvas, run, unpack, painters = [webglPainter, flatPainter]) => {
    const scene = sceneOf(run.space, run.colours, unpack), view = { canvas, scene, row: 0, sized: false };
    view.painter = painters.reduce((found, make) => found || make(canvas, scene, vec, redraw), null);
    if (!views.length) { // the first run of a page says from which corner
      const { turn } = scene, [x, y, z] = VIEWS.Corner;
      if (turn === 90) VIEWS.Corner = [-y, x, z];
      [look.azimuth, look.elevation] = headed(VIEWS.Corner);
    }
    views.push(view);
    listen(view);
    return { show(row) { view.row = row; paint(view); } };
  };
  const colour = byLink => { for (const view of views) view.scene.byLink = byLink; redraw(); };
  // Where on its canvas a run shows a place [m], in the canvas's dots.
  const where = (index, place) => { const { x, y } = camera(views[index]).seen(place); return [x, y]; };
  const kinds = () => views.map(view => view.painter.kind);
  return { open, go, colour, look, where, kinds };
})();
