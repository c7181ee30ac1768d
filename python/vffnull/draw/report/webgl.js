// Draws a scene in space with light and shadow; see `space.js`. Without WebGL there is none, but `flat.js`.
const webglPainter = (() => {
  "use strict";
  const SUN = [0.36, -0.48, 0.8]; // the direction of the light
  // On a graphics card: how many suns make a soft shadow, and how many sides what is round has. Without one: fewer.
  const CARD = { suns: 8, around: 40 }, NONE = { suns: 1, around: 24 };

  const COMMON = `#version 300 es
    precision highp float;
    vec3 lit(vec3 colour, vec3 n, vec3 toEye) {
      vec3 sun = normalize(vec3(${SUN}));
      float key = max(dot(n, sun), 0.), fill = max(dot(n, vec3(-.7, .6, .39)), 0.), sky = .5 + .5 * n.z;
      float rim = pow(1. - max(dot(n, toEye), 0.), 2.5), gleam = pow(max(dot(n, normalize(sun + toEye)), 0.), 40.);
      vec3 base = pow(colour, vec3(2.2));
      vec3 light = base * (.30 * mix(.45, 1., sky) + .78 * key + .16 * fill) * (1. - .45 * rim) + .10 * gleam;
      return pow(light, vec3(1. / 2.2));
    }`;
  const FLATTEN = `
    uniform vec4 sun; // and the height of the floor on which to cast a shadow
    uniform bool casts;
    vec3 shaded(vec3 p) { return casts ? p - sun.xyz * max(p.z - sun.w, 0.) / sun.z - vec3(0, 0, min(p.z - sun.w, 0.)) : p; }`;
  const BODY = [`${COMMON}
    uniform mat4 view, model; uniform vec3 size; uniform float stretch; ${FLATTEN}
    in vec3 place, normal; in float end; out vec3 world, n;
    void main() {
      world = shaded((model * vec4(place * size + vec3(0, 0, end * stretch), 1)).xyz);
      n = mat3(model) * (normal / size);
      gl_Position = view * vec4(world, 1);
    }`, `${COMMON}
    uniform vec3 eye, colour; uniform float opacity, ground; uniform int look; in vec3 world, n; out vec4 dot_;
    void main() {
      if (world.z < ground) discard;
      vec3 toEye = normalize(eye - world), m = normalize(n);
      if (look == 2) { dot_ = vec4(colour, 1) * opacity; return; }
      if (look == 1) { // a shell, of which the rim is seen best
        float rim = 1. - abs(dot(m, toEye));
        dot_ = vec4(colour, 1) * (.035 + .22 * rim * rim * rim);
        return;
      }
      if (!gl_FrontFacing) m = -m;
      dot_ = vec4(lit(colour, m, toEye), 1) * opacity;
    }`];
  const POINTS = [`${COMMON}
    uniform mat4 view, model; uniform float radius, scale; ${FLATTEN}
    in vec3 place; out float grain;
    void main() {
      gl_Position = view * vec4(shaded((model * vec4(place, 1)).xyz), 1);
      gl_PointSize = max(2. * radius * scale / gl_Position.w, 1.5);
      grain = fract(sin(float(gl_VertexID) * 12.9898) * 43758.5453);
    }`, `${COMMON}
    uniform vec3 colour, right, up, back; uniform bool casts; uniform float opacity; in float grain; out vec4 dot_;
    void main() {
      vec2 p = 2. * gl_PointCoord - 1.;
      float over = 1. - dot(p, p);
      if (over < 0.) discard;
      vec3 n = p.x * right - p.y * up + sqrt(over) * back;
      dot_ = casts ? vec4(colour, 1) * opacity : vec4(lit(colour * (.85 + .3 * grain), n, back), 1);
    }`];
  const LINES = [`${COMMON}
    uniform mat4 view; uniform vec2 half_; uniform float width;
    in vec3 place, other; in vec3 side; // of the line, along it: 1 towards the other end, and metres from the start
    out float along;
    void main() {
      vec4 p = view * vec4(place, 1), q = view * vec4(other, 1);
      vec2 way = side.y * (q.xy / q.w - p.xy / p.w) * half_;
      way = length(way) > 1e-6 ? normalize(way) : vec2(1, 0);
      gl_Position = p + vec4((side.x * vec2(-way.y, way.x) - .4 * side.y * way) * width / half_ * p.w, -2e-4 * p.w, 0);
      along = side.z;
    }`, `${COMMON}
    uniform vec3 colour; uniform float dash; in float along; out vec4 dot_;
    void main() { if (dash > 0. && fract(along / dash) > .55) discard; dot_ = vec4(colour, 1); }`];
  const FLOOR = [`${COMMON}
    uniform mat4 view; uniform vec3 middle; uniform float far; in vec3 place; out vec2 p;
    void main() { p = place.xy * far; gl_Position = view * vec4(middle + vec3(p, 0), 1); p += middle.xy; }`, `${COMMON}
    uniform vec3 middle; uniform float far, cell; in vec2 p; out vec4 dot_;
    float lines(float cell) {
      vec2 at = p / cell, near = abs(fract(at - .5) - .5) / max(fwidth(at), 1e-6), wide = fwidth(at);
      return (1. - min(min(near.x, near.y), 1.)) * clamp(1.6 - 2.2 * max(wide.x, wide.y), 0., 1.);
    }
    void main() {
      float fade = 1. - smoothstep(.35, 1., length(p - middle.xy) / far);
      float line = max(.10 * lines(cell), .20 * lines(5. * cell));
      dot_ = vec4(mix(vec3(.925, .935, .95), vec3(.25, .3, .38), line), 1) * fade;
    }`];

  const compile = (gl, [vertex, fragment]) => {
    const program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    ["place", "normal", "end"].forEach((name, i) => gl.bindAttribLocation(program, i, name));
    ["other", "side"].forEach((name, i) => gl.bindAttribLocation(program, i + 3, name));
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost())
      throw new Error(gl.getProgramInfoLog(program) || "a program cannot be linked");
    const places = {}, count = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS) || 0;
    for (let i = 0; i < count; i++) {
      const { name, type } = gl.getActiveUniform(program, i), place = gl.getUniformLocation(program, name);
      places[name] = {
        [gl.FLOAT]: v => gl.uniform1f(place, v), [gl.BOOL]: v => gl.uniform1i(place, v), [gl.INT]: v => gl.uniform1i(place, v),
        [gl.FLOAT_VEC2]: v => gl.uniform2fv(place, v), [gl.FLOAT_VEC3]: v => gl.uniform3fv(place, v),
        [gl.FLOAT_VEC4]: v => gl.uniform4fv(place, v), [gl.FLOAT_MAT4]: v => gl.uniformMatrix4fv(place, false, v),
      }[type];
    }
    return values => { gl.useProgram(program); for (const name in values) if (places[name]) places[name](values[name]); };
  };

  // Vertices with attributes of so many numbers each.
  const mesh = (gl, vertices, sizes, indices, slots = [0, 1, 2]) => {
    const array = gl.createVertexArray(), stride = 4 * sizes.reduce((a, b) => a + b, 0);
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(vertices), gl.STATIC_DRAW);
    sizes.reduce((from, count, i) => {
      gl.enableVertexAttribArray(slots[i]);
      gl.vertexAttribPointer(slots[i], count, gl.FLOAT, false, stride, from);
      return from + 4 * count;
    }, 0);
    if (indices) {
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, new Uint32Array(indices), gl.STATIC_DRAW);
    }
    return { array, count: indices ? indices.length : (4 * vertices.length) / stride };
  };
  // What a profile of [radius, height, radius and height of its normal, end] makes by a turn about the z axis.
  const turned = (gl, profile, around) => {
    const vertices = [], indices = [];
    profile.forEach(([r, z, nr, nz, end], row) => {
      for (let k = 0; k <= around; k++) {
        const c = Math.cos((2 * Math.PI * k) / around), s = Math.sin((2 * Math.PI * k) / around), i = row * (around + 1) + k;
        vertices.push(r * c, r * s, z, nr * c, nr * s, nz, end || 0);
        if (row && k < around) indices.push(i - around - 1, i - around, i + 1, i - around - 1, i + 1, i);
      }
    });
    return mesh(gl, vertices, [3, 3, 1], indices);
  };
  const steps = (from, to, count) => Array.from({ length: count + 1 }, (_, i) => from + ((to - from) * i) / count);
  const ball = (gl, around) => {
    const row = end => angle => [Math.cos(angle), Math.sin(angle), Math.cos(angle), Math.sin(angle), end];
    const tall = around >> 2;
    return turned(gl, [...steps(-Math.PI / 2, 0, tall).map(row(0)), ...steps(0, Math.PI / 2, tall).map(row(1))], around);
  };
  // Along the z axis, of length 1.
  const arrow = gl => turned(gl, [[0, 0, 0, -1], [0.09, 0, 0, -1], [0.09, 0, 1, 0], [0.09, 0.62, 1, 0], [0.09, 0.62, 0, -1],
    [0.3, 0.62, 0, -1], [0.3, 0.62, 0.8, 0.6], [0, 1, 0.8, 0.6]], 24);
  const ring = gl => turned(gl, steps(0, -2 * Math.PI, 12).map(a => [1 - 0.07 * Math.cos(a), 0.07 * Math.sin(a), -Math.cos(a), Math.sin(a)]), 48);

  const hull = (gl, body, vec) => {
    const corner = k => [...body.corners.subarray(3 * k, 3 * k + 3)];
    if (body.radius > 0) { // by directions: the farthest corner along each, and the radius further
      const vertices = [], indices = [], tall = 36, wide = 72;
      const corners = Array.from({ length: body.count }, (_, k) => corner(k));
      for (let i = 0; i <= tall; i++) for (let k = 0; k <= wide; k++) {
        const e = Math.PI * (i / tall - 0.5), a = (2 * Math.PI * k) / wide;
        const n = [Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e)];
        const far = corners.reduce((best, each) => (vec.dot(each, n) > vec.dot(best, n) ? each : best));
        vertices.push(...vec.add(far, n, body.radius), ...n, 0);
        const j = i * (wide + 1) + k;
        if (i && k < wide) indices.push(j - wide - 1, j - wide, j + 1, j - wide - 1, j + 1, j);
      }
      return mesh(gl, vertices, [3, 3, 1], indices);
    }
    const vertices = [];
    for (const face of body.faces) {
      const [a, b, c] = face.map(corner), n = vec.unit(vec.cross(vec.add(b, a, -1), vec.add(c, a, -1)));
      for (const p of [a, b, c]) vertices.push(...p, ...n, 0);
    }
    return mesh(gl, vertices, [3, 3, 1]);
  };

  // Four corners per piece of a line: on either side, at either end.
  const line = (gl, points, vec) => {
    const vertices = [], indices = [], count = points.length / 3, place = k => points.subarray(3 * k, 3 * k + 3);
    let along = 0;
    for (let k = 0; k + 1 < count; k++) {
      const a = place(k), b = place(k + 1), next = along + vec.size(vec.add(b, a, -1));
      for (const [p, q, way, far] of [[a, b, 1, along], [b, a, -1, next]])
        for (const side of [-1, 1]) vertices.push(...p, ...q, side, way, far);
      const i = 4 * k;
      indices.push(i, i + 1, i + 2, i + 2, i + 1, i + 3);
      along = next;
    }
    return mesh(gl, vertices, [3, 3, 3], indices, [0, 3, 4]);
  };

  // Columns of a matrix from axes and a place.
  const matrix = ([x, y, z], p) => [...x, 0, ...y, 0, ...z, 0, ...p, 1];

  return (canvas, scene, vec, redraw) => {
    const gl = canvas.getContext("webgl2", { antialias: true, alpha: true, stencil: true, preserveDrawingBuffer: true });
    if (!gl) return null;
    const told = gl.getExtension("WEBGL_debug_renderer_info");
    const card = String(gl.getParameter(told ? told.UNMASKED_RENDERER_WEBGL : gl.RENDERER));
    const { suns, around } = /swiftshader|llvmpipe|softpipe|software|basic render/i.test(card) ? NONE : CARD;
    let programs, meshes, made;
    const build = () => {
      programs = Object.fromEntries(Object.entries({ BODY, POINTS, LINES, FLOOR }).map(([name, text]) => [name, compile(gl, text)]));
      meshes = { rod: ball(gl, around), shade: ball(gl, 16), arrow: arrow(gl), ring: ring(gl) };
      meshes.floor = mesh(gl, [-1, -1, 0, 1, -1, 0, -1, 1, 0, 1, 1, 0], [3], [0, 1, 2, 2, 1, 3]);
      made = new Map();
    };
    const once = (key, make) => { if (!made.has(key)) made.set(key, make()); return made.get(key); };
    build();
    canvas.addEventListener("webglcontextlost", event => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => { build(); redraw(); });

    // Axes of which the third is along a vector.
    const toward = vector => {
      const z = vec.size(vector) > 0 ? vec.unit(vector) : [0, 0, 1], x = vec.unit(vec.cross(Math.abs(z[0]) < 0.7 ? [1, 0, 0] : [0, 1, 0], z));
      return [x, vec.cross(z, x), z];
    };
    const paint = ({ array, count }, mode = gl.TRIANGLES, indexed = true) => {
      gl.bindVertexArray(array);
      if (indexed) gl.drawElements(mode, count, gl.UNSIGNED_INT, 0); else gl.drawArrays(mode, 0, count);
    };
    const one = [1, 1, 1];
    const solid = (item, how) => {
      if (item.kind === "cloud") {
        const points = once(item.body, () => mesh(gl, item.body.points, [3]));
        programs.POINTS({ ...how, model: matrix(item.pose.turn, item.pose.place), radius: item.radius, colour: how.colour || item.colour });
        paint(points, gl.POINTS, false);
        return;
      }
      const put = (model, size, stretch) => programs.BODY({ ...how, model, size, stretch, colour: how.colour || item.colour });
      if (item.kind === "rod") {
        const along = vec.add(item.b, item.a, -1);
        put(matrix(toward(along), item.a), one.map(() => item.radius), vec.size(along));
      } else if (item.kind === "arrow") {
        const long = vec.size(item.vector), wide = Math.min(0.09 * scene.reach, 0.6 * long);
        put(matrix(toward(item.vector), item.tail), [wide, wide, long], 0);
      } else if (item.kind === "ring") put(matrix(toward([0, 0, 1]), item.place), one.map(() => item.radius), 0);
      else {
        put(matrix(item.pose.turn, item.pose.place), one, 0);
        const found = once(item.body, () => hull(gl, item.body, vec));
        paint(found, gl.TRIANGLES, item.radius > 0);
        return;
      }
      paint(meshes[how.casts ? "shade" : item.kind]);
    };

    const draw = (_, camera, row) => {
      const { eye, right, up, back, slope, aspect, near, far } = camera, { solids, shells, surfaces, ghosts, lines } = scene.at(row);
      const columns = [0, 1, 2].map(i => [right[i], up[i], back[i]]);
      const shift = [right, up, back].map(axis => -vec.dot(axis, eye));
      const depth = (far + near) / (near - far), offset = (2 * far * near) / (near - far);
      const project = ([x, y, z], w) => [x / (slope * aspect), y / slope, depth * z + w * offset, -z];
      const view = [...columns.flatMap(column => project(column, 0)), ...project(shift, 1)];
      const scale = canvas.height / 2 / slope, common = { view, eye, right, up, back, scale, casts: false, opacity: 1, look: 0, ground: -1e9 };
      gl.viewport(0, 0, canvas.width, canvas.height);
      gl.depthMask(true);
      gl.clearColor(0, 0, 0, 0);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
      gl.enable(gl.BLEND);
      gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
      gl.disable(gl.DEPTH_TEST);
      gl.disable(gl.CULL_FACE);
      if (scene.floor !== null) {
        const cell = 10 ** Math.floor(Math.log10(scene.reach));
        programs.FLOOR({ view, middle: [scene.middle[0], scene.middle[1], scene.floor], far: 2.6 * scene.reach, cell });
        paint(meshes.floor);
        gl.enable(gl.STENCIL_TEST);
        gl.stencilOp(gl.KEEP, gl.KEEP, gl.REPLACE);
        const dark = { ...common, casts: true, look: 2, opacity: 0.28 / suns, colour: [0.09, 0.11, 0.16] };
        for (let k = 0; k < suns; k++) { // every dot gets dark once in the light of each of the suns
          const angle = 2.4 * k, wide = suns > 1 ? 0.075 * Math.sqrt((k + 0.5) / suns) : 0;
          gl.stencilFunc(gl.NOTEQUAL, k + 1, 0xff);
          const sun = [SUN[0] + wide * Math.cos(angle), SUN[1] + wide * Math.sin(angle), SUN[2], scene.floor];
          for (const item of solids) if (item.kind !== "ring" && item.kind !== "arrow") solid(item, { ...dark, sun });
        }
        gl.disable(gl.STENCIL_TEST);
      }
      gl.enable(gl.DEPTH_TEST);
      const ground = scene.floor === null ? -1e9 : scene.floor - 1e-4 * scene.reach; // hides what is below
      for (const item of solids) solid(item, { ...common, ground });
      for (const each of lines) {
        const { array } = once(each.points, () => line(gl, each.points, vec));
        programs.LINES({ view, half_: [canvas.width / 2, canvas.height / 2], width: (each.width / 2) * (canvas.width / canvas.clientWidth), dash: each.dash, colour: each.colour });
        paint({ array, count: 6 * Math.max(Math.min(each.end, each.points.length / 3) - 1, 0) });
      }
      gl.depthMask(false);
      for (const item of surfaces) solid(item, { ...common, opacity: 0.5 });
      gl.enable(gl.CULL_FACE);
      for (const item of shells) solid(item, { ...common, look: 1 });
      if (ghosts.length) { // first how near they are, so that every dot gets the colour of one of them only
        gl.depthMask(true);
        gl.colorMask(false, false, false, false);
        for (const item of ghosts) solid(item, { ...common, ground });
        gl.colorMask(true, true, true, true);
        gl.depthFunc(gl.LEQUAL);
        for (const item of ghosts) solid(item, { ...common, ground, opacity: 0.4 });
        gl.depthFunc(gl.LESS);
      }
      gl.bindVertexArray(null);
    };
    return { draw, kind: "webgl" };
  };
})();
