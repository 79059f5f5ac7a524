// The cloud of a page, drawn with WebGL 1: turned, moved and zoomed with mouse, fingers and keys.
"use strict";
(() => {
  const get = (name) => document.getElementById("cloud-" + name);
  const canvas = get("canvas");
  const gl = canvas.getContext("webgl", { antialias: true });
  if (!gl) return;
  get("failed").hidden = true;
  canvas.hidden = false;

  const POINT_BYTES = 14;
  const LINES = 4;
  const data = JSON.parse(get("data").textContent);
  const form = document.querySelector("#cloud form").elements;

  // Vectors and matrices of three rows.
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const scaled = (a, s) => a.map((v) => v * s);
  const sum = (a, b) => a.map((v, i) => v + b[i]);
  const times = (m, a) => m.map((row) => dot(row, a));
  const transposed = (m) => [0, 1, 2].map((i) => m.map((row) => row[i]));
  const product = (a, b) => a.map((row) => transposed(b).map((column) => dot(row, column)));
  function rotation(axis, angle) {
    const [x, y, z] = axis, s = Math.sin(angle), c = Math.cos(angle), t = 1 - c;
    return [
      [t * x * x + c, t * x * y - s * z, t * x * z + s * y],
      [t * x * y + s * z, t * y * y + c, t * y * z - s * x],
      [t * x * z - s * y, t * y * z + s * x, t * z * z + c],
    ];
  }

  // The eye: `turn` is the rotation of cam_from_world; `focus` lies `span` in front of the eye.
  let eye;
  const fallback = { centre: [0, 0, -2], rotation: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], tangents: [0.4, 0.3], depth: 2 };
  function lookFrom(camera) {
    const ahead = scaled(camera.rotation[2], camera.depth);
    eye = { turn: camera.rotation, focus: sum(camera.centre, ahead), span: camera.depth, tangents: camera.tangents };
    draw();
  }
  function lookAtAll() {
    const around = 0.5 * Math.hypot(...data.extent);
    eye = { ...eye, focus: [0, 0, 0], span: around / Math.min(...halves()) };
    draw();
  }
  // Turns the cloud so that its near side moves right and down; stops at the poles.
  function turnBy(right, down) {
    const height = Math.asin(Math.max(-1, Math.min(1, -dot(eye.turn[2], data.up))));
    const wanted = Math.max(-1.5, Math.min(1.5, height + down));
    const about = product(eye.turn, rotation(data.up, right));
    eye.turn = product(rotation([1, 0, 0], wanted - height), about);
    draw();
  }
  function moveBy(x, y) {
    const [width, height] = halves();
    const offset = [-2 * x * width * eye.span, -2 * y * height * eye.span, 0];
    eye.focus = sum(eye.focus, times(transposed(eye.turn), offset));
    draw();
  }
  function zoomBy(factor) {
    eye.span = Math.max(1e-3, Math.min(50, eye.span * factor));
    draw();
  }
  // Half the picture's width and height at distance 1, so that it shows all that the camera saw.
  function halves() {
    const aspect = canvas.clientWidth / Math.max(1, canvas.clientHeight);
    const height = Math.max(eye.tangents[1], eye.tangents[0] / aspect);
    return [height * aspect, height];
  }

  // The program and what it draws.
  function shader(kind, name) {
    const made = gl.createShader(kind);
    gl.shaderSource(made, get(name).textContent);
    gl.compileShader(made);
    if (!gl.getShaderParameter(made, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(made));
    return made;
  }
  let program, uniform, attribute, points, pyramids, pyramidCount, mesh;
  function prepare() {
    program = gl.createProgram();
    gl.attachShader(program, shader(gl.VERTEX_SHADER, "vertex"));
    gl.attachShader(program, shader(gl.FRAGMENT_SHADER, "fragment"));
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    gl.useProgram(program);
    uniform = (name) => gl.getUniformLocation(program, name);
    attribute = (name) => gl.getAttribLocation(program, name);
    points = filled(decoded(data.points));
    if (data.mesh && gl.getExtension("OES_element_index_uint")) {
      const numbers = decoded(data.mesh.triangles);
      mesh = { vertices: filled(decoded(data.mesh.vertices)), triangles: gl.createBuffer(), count: numbers.length / 4 };
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, mesh.triangles);
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, numbers, gl.STATIC_DRAW);
    }
    const lines = data.cameras.flatMap(pyramid);
    pyramids = filled(new Float32Array(lines));
    pyramidCount = lines.length / 3;
    gl.uniform3fv(uniform("ramp"), data.ramp.flat());
    gl.uniform1f(uniform("most_views"), data.most_views);
    gl.enable(gl.DEPTH_TEST);
  }
  function decoded(text) {
    return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  }
  function filled(values) {
    const buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
    return buffer;
  }
  // The edges of a camera's pyramid, two ends each.
  function pyramid(camera) {
    const to_world = transposed(camera.rotation);
    const [width, height] = camera.tangents;
    const corner = ([x, y]) => {
      const ray = scaled([x * width, y * height, 1], data.pyramid);
      return sum(camera.centre, times(to_world, ray));
    };
    const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(corner);
    return corners.flatMap((at, i) => [...camera.centre, ...at, ...at, ...corners[(i + 1) % 4]]);
  }

  // Drawing, at most once a frame.
  let asked = false;
  function draw() {
    if (!asked) requestAnimationFrame(drawNow);
    asked = true;
  }
  function drawNow() {
    asked = false;
    const ratio = window.devicePixelRatio || 1;
    canvas.width = Math.round(canvas.clientWidth * ratio);
    canvas.height = Math.round(canvas.clientHeight * ratio);
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    drawFrom(halves());
    // A mesh has neither confidence nor numbers of views.
    if (mesh && form.mesh.checked && Number(form.look.value) < 2) drawMesh();
    else drawPoints();
    if (form.pyramids.checked) drawPyramids();
  }
  function drawFrom([width, height]) {
    gl.uniformMatrix3fv(uniform("turn"), false, transposed(eye.turn).flat());
    gl.uniform3fv(uniform("focus"), eye.focus);
    gl.uniform1f(uniform("span"), eye.span);
    gl.uniform2f(uniform("lens"), 1 / width, 1 / height);
    gl.uniform2f(uniform("clip"), 0.01 * eye.span, eye.span + 20);
    const size = 1.4 * data.radius * 2 ** Number(form.size.value);
    gl.uniform1f(uniform("reach"), (size * 0.5 * canvas.height) / height);
  }
  function drawPoints() {
    bindPoints(points);
    gl.uniform1i(uniform("round"), 1);
    gl.drawArrays(gl.POINTS, 0, data.count);
  }
  function drawMesh() {
    bindPoints(mesh.vertices);
    gl.uniform1i(uniform("round"), 0);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, mesh.triangles);
    gl.drawElements(gl.TRIANGLES, mesh.count, gl.UNSIGNED_INT, 0);
  }
  function bindPoints(buffer) {
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    const bind = (name, size, type, normalised, offset) => {
      gl.enableVertexAttribArray(attribute(name));
      gl.vertexAttribPointer(attribute(name), size, type, normalised, POINT_BYTES, offset);
    };
    bind("position", 3, gl.UNSIGNED_SHORT, true, 0);
    bind("colour", 3, gl.UNSIGNED_BYTE, true, 6);
    bind("normal", 3, gl.BYTE, true, 9);
    bind("quality", 2, gl.UNSIGNED_BYTE, false, 12);
    gl.uniform3fv(uniform("scale"), data.extent);
    gl.uniform3fv(uniform("shift"), scaled(data.extent, -0.5));
    gl.uniform1i(uniform("look"), Number(form.look.value));
  }
  function drawPyramids() {
    gl.bindBuffer(gl.ARRAY_BUFFER, pyramids);
    for (const name of ["colour", "normal", "quality"]) gl.disableVertexAttribArray(attribute(name));
    gl.vertexAttribPointer(attribute("position"), 3, gl.FLOAT, false, 0, 0);
    gl.uniform3f(uniform("scale"), 1, 1, 1);
    gl.uniform3f(uniform("shift"), 0, 0, 0);
    gl.uniform1i(uniform("look"), LINES);
    gl.uniform1i(uniform("round"), 0);
    const hex = getComputedStyle(canvas).getPropertyValue("--accent").trim();
    gl.uniform3fv(uniform("line"), [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16) / 255));
    gl.drawArrays(gl.LINES, 0, pyramidCount);
  }

  // Mouse and fingers: one turns, two move and zoom.
  const held = new Map();
  const middle = (axis) => [...held.values()].reduce((all, at) => all + at[axis], 0) / held.size;
  const apart = () => Math.hypot(...[...held.values()].reduce((a, b) => [a[0] - b[0], a[1] - b[1]]));
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    held.set(event.pointerId, [event.clientX, event.clientY]);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!held.has(event.pointerId)) return;
    const two = held.size === 2;
    const before = [middle(0), middle(1), two ? apart() : 1];
    held.set(event.pointerId, [event.clientX, event.clientY]);
    const x = (middle(0) - before[0]) / canvas.clientWidth;
    const y = (middle(1) - before[1]) / canvas.clientHeight;
    if (two) zoomBy(before[2] / Math.max(1, apart()));
    if (two || event.shiftKey || event.buttons & 6) moveBy(x, y);
    else turnBy(Math.PI * x, Math.PI * y);
  });
  for (const end of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(end, (event) => held.delete(event.pointerId));
  }
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoomBy(Math.exp(event.deltaY * (event.deltaMode ? 0.05 : 0.0015)));
  }, { passive: false });

  // Keys.
  const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  canvas.addEventListener("keydown", (event) => {
    const arrow = arrows[event.key];
    if (arrow && event.shiftKey) moveBy(0.05 * arrow[0], 0.05 * arrow[1]);
    else if (arrow) turnBy(0.1 * arrow[0], 0.1 * arrow[1]);
    else if (event.key === "+" || event.key === "=") zoomBy(0.9);
    else if (event.key === "-") zoomBy(1 / 0.9);
    else return;
    event.preventDefault();
  });

  // The form.
  function showRamp() {
    const look = form.look.value, end = get("ramp-end");
    get("ramp").hidden = look !== "2" && look !== "3";
    end.textContent = look === "2" ? "1" : end.dataset.views;
  }
  form.camera.addEventListener("change", () => lookFrom(data.cameras[form.camera.value]));
  form.whole.addEventListener("click", lookAtAll);
  for (const name of ["look", "mesh", "pyramids", "size"]) {
    const inputs = form[name].length ? [...form[name]] : [form[name]];
    inputs.forEach((input) => input.addEventListener("input", () => { showRamp(); draw(); }));
  }
  new ResizeObserver(draw).observe(canvas);
  window.addEventListener("resize", draw);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
  canvas.addEventListener("webglcontextrestored", () => { prepare(); draw(); });

  prepare();
  showRamp();
  lookFrom(data.cameras[data.start] || fallback);
})();
