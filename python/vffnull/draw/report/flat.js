// Draws a scene in space where there is no WebGL: bodies as flat shapes, the farthest first; see `space.js`.
const flatPainter = (() => {
  "use strict";
  const SUN = [0.36, -0.48, 0.8];
  const css = (colour, light = 1, opacity = 1) =>
    `rgba(${colour.map(value => Math.round(255 * Math.min(value * light, 1))).join(",")},${opacity})`;

  // The outline of two discs and all between them, and a side that is darker.
  const rod = (pen, p, q, radius, colour, opacity) => {
    const r = Math.max(radius * p.scale, 0.6), s = Math.max(radius * q.scale, 0.6), far = Math.hypot(q.x - p.x, q.y - p.y);
    pen.beginPath();
    if (far <= Math.abs(r - s)) {
      const [big, wide] = r > s ? [p, r] : [q, s];
      pen.arc(big.x, big.y, wide, 0, 2 * Math.PI);
    } else {
      const along = Math.atan2(q.y - p.y, q.x - p.x), open = Math.acos((r - s) / far);
      pen.arc(p.x, p.y, r, along + open, along - open);
      pen.arc(q.x, q.y, s, along - open, along + open);
      pen.closePath();
    }
    const wide = Math.max(r, s), x = (p.x + q.x) / 2, y = (p.y + q.y) / 2;
    const across = far > 1e-6 ? [-(q.y - p.y) / far, (q.x - p.x) / far] : [0.6, 0.8];
    const sign = across[0] * 0.5 + across[1] * 0.85 > 0 ? 1 : -1; // the light comes from above and the left
    const fill = pen.createLinearGradient(x - sign * across[0] * wide, y - sign * across[1] * wide,
      x + sign * across[0] * wide, y + sign * across[1] * wide);
    fill.addColorStop(0, css(colour, 1.06, opacity));
    fill.addColorStop(1, css(colour, 0.62, opacity));
    pen.fillStyle = fill;
    pen.fill();
    if (opacity === 1) { pen.strokeStyle = css(colour, 0.4); pen.stroke(); }
  };

  return (canvas, scene, vec) => {
    const pen = canvas.getContext("2d");
    if (!pen) return null;

    const polygon = (points, fill, stroke) => {
      pen.beginPath();
      points.forEach(({ x, y }, i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
      pen.closePath();
      pen.fillStyle = fill;
      pen.fill();
      if (stroke) { pen.strokeStyle = stroke; pen.stroke(); }
    };
    const into = (pose, p) => [0, 1, 2].reduce((sum, i) => vec.add(sum, pose.turn[i], p[i]), pose.place);
    const corners = ({ body, pose }) => Array.from({ length: body.count }, (_, k) => into(pose, body.corners.subarray(3 * k, 3 * k + 3)));
    const hull = (item, camera, opacity) => {
      const places = corners(item);
      for (const face of item.body.faces) {
        const [a, b, c] = face.map(k => places[k]), n = vec.unit(vec.cross(vec.add(b, a, -1), vec.add(c, a, -1)));
        if (opacity === 1 && vec.dot(n, vec.add(camera.eye, a, -1)) <= 0) continue;
        const fill = css(item.colour, 0.55 + 0.5 * Math.max(vec.dot(n, SUN), 0), opacity);
        polygon([a, b, c].map(camera.seen), fill, opacity === 1 ? fill : null);
      }
    };
    const solid = (item, camera) => {
      const { seen } = camera;
      if (item.kind === "rod") rod(pen, seen(item.a), seen(item.b), item.radius, item.colour, 1);
      else if (item.kind === "arrow") {
        const tip = vec.add(item.tail, item.vector), neck = vec.add(item.tail, item.vector, 0.7), p = seen(neck), q = seen(tip);
        rod(pen, seen(item.tail), p, 0.007 * scene.reach, item.colour, 1);
        const half = 0.5 * Math.hypot(q.x - p.x, q.y - p.y), x = (q.y - p.y) / (2 * half || 1), y = -(q.x - p.x) / (2 * half || 1);
        polygon([q, { x: p.x + half * x, y: p.y + half * y }, { x: p.x - half * x, y: p.y - half * y }], css(item.colour));
      } else if (item.kind === "ring") {
        pen.beginPath();
        for (let k = 0; k <= 48; k++) {
          const a = (2 * Math.PI * k) / 48, { x, y } = seen(vec.add(item.place, [Math.cos(a), Math.sin(a), 0], item.radius));
          if (k) pen.lineTo(x, y); else pen.moveTo(x, y);
        }
        pen.strokeStyle = css(item.colour);
        pen.lineWidth *= 2;
        pen.stroke();
        pen.lineWidth /= 2;
      } else if (item.kind === "cloud") {
        const { points } = item.body;
        pen.fillStyle = css(item.colour, 1.3);
        for (let k = 0; k < points.length; k += 3) {
          const { x, y, scale } = seen(into(item.pose, points.subarray(k, k + 3))), wide = Math.max(1.8 * item.radius * scale, 1.5);
          pen.fillRect(x - wide / 2, y - wide / 2, wide, wide);
        }
      } else hull(item, camera, 1);
    };
    const middle = item => item.place || (item.pose && (item.body.points ? item.pose.place
      : corners(item).reduce((sum, p) => vec.add(sum, p, 1 / item.body.count), [0, 0, 0])))
      || (item.tail ? vec.add(item.tail, item.vector, 0.5) : vec.add(item.a, vec.add(item.b, item.a, -1), 0.5));

    const grid = ({ seen }) => {
      const cell = 10 ** Math.floor(Math.log10(scene.reach)), many = Math.ceil((1.6 * scene.reach) / cell), [x, y] = scene.middle;
      pen.strokeStyle = "#dfe3e8";
      for (let k = -many; k <= many; k++) for (const across of [true, false]) {
        const end = far => seen(vec.add([x, y, scene.floor], across ? [k * cell, far, 0] : [far, k * cell, 0])), p = end(-many * cell), q = end(many * cell);
        if (p.depth <= 0 || q.depth <= 0) continue;
        pen.beginPath();
        pen.moveTo(p.x, p.y);
        pen.lineTo(q.x, q.y);
        pen.stroke();
      }
    };

    const draw = (_, camera, row) => {
      const { solids, shells, surfaces, ghosts, lines } = scene.at(row), dots = canvas.width / canvas.clientWidth;
      pen.clearRect(0, 0, canvas.width, canvas.height);
      pen.lineWidth = dots;
      pen.lineJoin = pen.lineCap = "round";
      if (scene.floor !== null) grid(camera);
      for (const item of surfaces) hull(item, camera, 0.4);
      for (const { points, end, width, dash, colour } of lines) {
        pen.beginPath();
        for (let k = 0; k < Math.min(end, points.length / 3); k++) {
          const { x, y } = camera.seen([...points.subarray(3 * k, 3 * k + 3)]);
          if (k) pen.lineTo(x, y); else pen.moveTo(x, y);
        }
        pen.setLineDash(dash ? [4 * dots, 4 * dots] : []);
        pen.lineWidth = width * dots;
        pen.strokeStyle = css(colour);
        pen.stroke();
      }
      pen.setLineDash([]);
      pen.lineWidth = dots;
      for (const item of ghosts) { // below the arm, as they are where it ought to be
        if (item.kind === "rod") rod(pen, camera.seen(item.a), camera.seen(item.b), item.radius, item.colour, 0.35);
        else hull(item, camera, 0.35);
      }
      for (const item of solids) item.depth = camera.seen(middle(item)).depth;
      for (const item of solids.sort((a, b) => b.depth - a.depth)) solid(item, camera);
      for (const item of shells)
        if (item.kind === "rod") rod(pen, camera.seen(item.a), camera.seen(item.b), item.radius, item.colour, 0.07);
    };
    return { draw, kind: "flat" };
  };
})();
