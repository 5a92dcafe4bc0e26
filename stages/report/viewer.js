// The page's 3D view: poses the model by its joints, draws it with WebGL 2, and binds the page's controls to it.
// No library, no network. Inside, lengths are those of the view: the scene lies between -1 and 1 on each axis.
"use strict";

const data = JSON.parse(document.getElementById("data").textContent);
const element = (id) => document.getElementById(id);
const reducedMotion = matchMedia("(prefers-reduced-motion: reduce)").matches;

// ---------------------------------------------------------------- vectors and column-major 4 x 4 matrices

const add = (a, b) => a.map((value, i) => value + b[i]);
const scaled = (a, factor) => a.map((value) => value * factor);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => scaled(a, 1 / (Math.hypot(...a) || 1));
const identity = () => [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];

function multiply(a, b) {
  const product = new Array(16).fill(0);
  for (let column = 0; column < 4; column++)
    for (let row = 0; row < 4; row++)
      for (let k = 0; k < 4; k++) product[4 * column + row] += a[4 * k + row] * b[4 * column + k];
  return product;
}

function apply(T, p, w = 1) {
  return [0, 1, 2, 3].map((row) => T[row] * p[0] + T[4 + row] * p[1] + T[8 + row] * p[2] + T[12 + row] * w);
}

function fromColumns(x, y, z, origin) {
  return [...x, 0, ...y, 0, ...z, 0, ...origin, 1];
}

// The rotation by an angle about a unit axis through a point, by Rodrigues' formula.
function rotation(axis, angle, point) {
  const cosine = Math.cos(angle), sine = Math.sin(angle);
  const columns = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((e) =>
    add(add(scaled(e, cosine), scaled(cross(axis, e), sine)), scaled(axis, dot(axis, e) * (1 - cosine))));
  const turned = columns.reduce((sum, column, i) => add(sum, scaled(column, point[i])), [0, 0, 0]);
  return fromColumns(...columns, add(point, scaled(turned, -1)));
}

const translation = (offset) => fromColumns([1, 0, 0], [0, 1, 0], [0, 0, 1], offset);

// ---------------------------------------------------------------- the scene's arrays

function decoded(text, Type) {
  const bytes = Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
  return new Type(bytes.buffer); // little-endian, as is every machine that runs a browser
}

const positions = (text) => Float32Array.from(decoded(text, Int16Array), (value) => value / 32767);
const toView = (p) => scaled(add(p, scaled(data.centre, -1)), 1 / data.half);
const toInput = (p) => add(scaled(p, data.half), data.centre);
const rgb = (colour) => [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16) / 255);

const points = {
  positions: positions(data.points.positions),
  normals: data.points.normals && Float32Array.from(decoded(data.points.normals, Int8Array), (value) => value / 127),
  trueColours: data.points.trueColours && decoded(data.points.trueColours, Uint8Array),
  ends: data.points.ends,
};
const frames = data.frames.map(positions);
const joints = data.joints.map((joint) => ({
  ...joint,
  axis: unit(joint.axis),
  point: toView(joint.point),
  place: toView(joint.place),
}));
const partColours = data.parts.map((part) => rgb(part.colour));
const rangeOf = (ends, i) => [i ? ends[i - 1] : 0, ends[i]];

// ---------------------------------------------------------------- the model: joint states to part motions

const pose = { values: joints.map(zeroState), T_root: rootMotion(data.canonical), frame: data.canonical };

function zeroState(joint) {
  return joint.type === "spherical" ? [0, 0, 0] : 0;
}

// The root's motion in a frame, from the input's coordinates to the view's.
function rootMotion(frame) {
  const T = data.T_frame_root[frame];
  const columns = [0, 1, 2].map((column) => [T[column], T[4 + column], T[8 + column]]);
  const moved = add([T[3], T[7], T[11]], columns.reduce((sum, c, i) => add(sum, scaled(c, data.centre[i])), [0, 0, 0]));
  return fromColumns(...columns, toView(moved));
}

function jointMotion(joint, value) {
  if (joint.type === "prismatic") return translation(scaled(joint.axis, value / data.half));
  if (joint.type === "spherical") return rotation(unit(value), Math.hypot(...value), joint.point);
  return rotation(joint.axis, value, joint.point);
}

// Forward kinematics: where each part's canonical points lie.
function partMotions() {
  const motions = data.parts.map(() => null);
  const place = (part, T) => {
    motions[part] = T;
    joints.forEach((joint, j) => {
      if (joint.parent === part) place(joint.child, multiply(T, jointMotion(joint, pose.values[j])));
    });
  };
  place(data.root, pose.T_root);
  return motions.map((T) => T || identity());
}

// The middle of each part's canonical points, in view coordinates; null where it has none.
const centroids = data.parts.map((_, part) => {
  const [start, end] = rangeOf(points.ends, part);
  let sum = [0, 0, 0];
  for (let i = start; i < end; i++) sum = add(sum, [...points.positions.subarray(3 * i, 3 * i + 3)]);
  return end > start ? scaled(sum, 1 / (end - start)) : null;
});

// States and root motion at a time between two frames.
function poseAt(time) {
  const before = Math.floor(time), share = time - before, after = Math.min(before + 1, data.T_frame_root.length - 1);
  const between = (a, b) => (Array.isArray(a) ? a.map((value, i) => between(value, b[i])) : a + share * (b - a));
  pose.values = joints.map((joint) => between(joint.states[before], joint.states[after]));
  const T = between(rootMotion(before), rootMotion(after));
  const x = unit(T.slice(0, 3)), z = unit(cross(x, T.slice(4, 7)));
  pose.T_root = fromColumns(x, cross(z, x), z, T.slice(12, 15));
  pose.frame = Math.round(time);
}

// ---------------------------------------------------------------- the camera

const UP = { z: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], y: [[0, 0, 1], [1, 0, 0], [0, 1, 0]], x: [[0, 1, 0], [0, 0, 1], [1, 0, 0]] };
const FIELD = 0.5; // radians, of the view's height
const DISC = 2.0; // diameter of a drawn point, in spacings of the cloud
const camera = {};

// Axes of the view: right, up and backwards.
function viewAxes() {
  const [right, forward, up] = UP[camera.up];
  const { azimuth, elevation } = camera;
  const level = add(scaled(right, Math.cos(azimuth)), scaled(forward, Math.sin(azimuth)));
  const back = add(scaled(level, Math.cos(elevation)), scaled(up, Math.sin(elevation)));
  const side = cross(up, level);
  return [side, cross(back, side), back];
}

function resetView(up = camera.up || "z") {
  Object.assign(camera, { up, azimuth: broadside(up) + 0.45, elevation: 0.25 });
  frameScene();
}

// Calls back with each point of all frames.
function forEachPoint(see) {
  for (const cloud of [points.positions, ...frames])
    for (let i = 0; i < cloud.length; i += 3) see([cloud[i], cloud[i + 1], cloud[i + 2]]);
}

// The azimuth from which the points of all frames are seen at their broadest: across their principal direction.
function broadside(up) {
  const [right, forward] = UP[up];
  let count = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0;
  forEachPoint((p) => {
    const a = dot(right, p), b = dot(forward, p);
    count += 1, x += a, y += b, xx += a * a, xy += a * b, yy += b * b;
  });
  return Math.atan2(2 * (xy - (x * y) / count), xx - (x * x) / count - (yy - (y * y) / count)) / 2 - Math.PI / 2;
}

// Moves the camera to where the points of all frames just fit in.
function frameScene() {
  const axes = viewAxes(), aspect = canvas.clientWidth / canvas.clientHeight || 1;
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  forEachPoint((p) =>
    axes.forEach((axis, k) => {
      const along = dot(axis, p);
      low[k] = Math.min(low[k], along);
      high[k] = Math.max(high[k], along);
    }));
  const extent = high.map((value, k) => value - low[k]);
  const tangent = Math.tan(FIELD / 2);
  camera.target = axes.reduce((sum, axis, k) => add(sum, scaled(axis, (low[k] + high[k]) / 2)), [0, 0, 0]);
  camera.distance = 1.12 * Math.max(extent[1] / 2 / tangent, extent[0] / 2 / (tangent * aspect)) + extent[2] / 4 || 1;
}

function viewMatrix() {
  const axes = viewAxes();
  const eye = add(camera.target, scaled(axes[2], camera.distance));
  const rows = [0, 1, 2].map((row) => axes.map((axis) => axis[row]));
  return fromColumns(...rows, axes.map((axis) => -dot(axis, eye)));
}

function projectionMatrix(aspect) {
  const focal = 1 / Math.tan(FIELD / 2), near = camera.distance / 100, far = camera.distance * 10 + 10;
  return [focal / aspect, 0, 0, 0, 0, focal, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0];
}

// ---------------------------------------------------------------- drawing

const canvas = element("canvas");
const shown = { mode: "points", axes: true, badges: true, input: false, active: null };

const VERTEX_SHADER = `#version 300 es
in vec3 position, normal, colour;
uniform mat4 motion, view, projection;
uniform float size, shading, glow, lift;
out vec3 tint;
void main() {
  vec4 seen = view * motion * vec4(position, 1.0);
  gl_Position = projection * vec4(seen.xyz * (1.0 - lift), 1.0);
  gl_PointSize = max(size / gl_Position.w, 1.5);
  vec3 n = mat3(view * motion) * normal;
  float facing = abs(dot(normalize(n + 1e-6), normalize(seen.xyz)));
  tint = mix(colour * mix(1.0, 0.5 + 0.55 * facing, shading), vec3(1.0), glow * (1.0 - facing * 0.5));
}`;
const FRAGMENT_SHADER = `#version 300 es
precision mediump float;
in vec3 tint;
uniform float disc, alpha;
out vec4 pixel;
void main() {
  if (disc > 0.5 && length(gl_PointCoord - 0.5) > 0.5) discard;
  pixel = vec4(tint, 1.0) * alpha;
}`;
const ATTRIBUTES = ["position", "normal", "colour"];

class Renderer {
  constructor(gl) {
    this.gl = gl;
    this.program = this.compiled();
    gl.useProgram(this.program);
    this.uniforms = {};
    for (const name of ["motion", "view", "projection", "size", "shading", "glow", "lift", "disc", "alpha"])
      this.uniforms[name] = gl.getUniformLocation(this.program, name);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    this.cloud = this.shape({ position: points.positions, normal: points.normals });
    this.trueCloud = points.trueColours && this.shape({ position: points.positions, normal: points.normals, colour: points.trueColours });
    this.frames = frames.map((position) => this.shape({ position }));
    this.meshes = data.meshes && this.meshShapes(data.meshes);
    this.symbols = joints.map((joint) => this.symbol(joint));
  }

  compiled() {
    const gl = this.gl, program = gl.createProgram();
    for (const [type, source] of [[gl.VERTEX_SHADER, VERTEX_SHADER], [gl.FRAGMENT_SHADER, FRAGMENT_SHADER]]) {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(program, shader);
    }
    ATTRIBUTES.forEach((name, location) => gl.bindAttribLocation(program, location, name));
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    return program;
  }

  // Arrays by attribute, in a vertex array; an attribute that is missing is set when it is drawn.
  shape(arrays, triangles) {
    const gl = this.gl, vertexArray = gl.createVertexArray();
    gl.bindVertexArray(vertexArray);
    ATTRIBUTES.forEach((name, location) => {
      const values = arrays[name];
      if (!values) return;
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(location);
      const bytes = values instanceof Uint8Array;
      gl.vertexAttribPointer(location, 3, bytes ? gl.UNSIGNED_BYTE : gl.FLOAT, bytes, 0, 0);
    });
    if (triangles) {
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, triangles, gl.STATIC_DRAW);
    }
    gl.bindVertexArray(null);
    return { vertexArray, count: arrays.position.length / 3, triangles };
  }

  meshShapes(meshes) {
    const all = positions(meshes.positions);
    const corners = decoded(meshes.triangles, meshes.wide ? Uint32Array : Uint16Array);
    return data.parts.map((_, part) => {
      const position = all.subarray(...rangeOf(meshes.vertexEnds, part).map((i) => 3 * i));
      const triangles = corners.subarray(...rangeOf(meshes.triangleEnds, part).map((i) => 3 * i));
      return this.shape({ position, normal: vertexNormals(position, triangles) }, triangles);
    });
  }

  // A rod along the joint's axis with an arrow at its positive end, and around it a disc where the joint turns, a sleeve
  // where it slides; a ball where the joint is one.
  symbol(joint) {
    const middle = {
      revolute: [[0.008, -0.01], [0.055, -0.01], [0.055, 0.01], [0.008, 0.01]],
      prismatic: [[0.008, -0.09], [0.022, -0.09], [0.022, 0.09], [0.008, 0.09]],
      spherical: [0, 1, 2, 3, 4, 5, 6].map((i) => [0.05 * Math.sin((i * Math.PI) / 6), -0.05 * Math.cos((i * Math.PI) / 6)]),
    }[joint.type];
    const rod = [[0, -0.24], [0.008, -0.24], ...middle, [0.008, 0.22], [0.026, 0.22], [0, 0.3]];
    const profile = joint.type === "spherical" ? middle : rod;
    const { position, triangles } = surfaceOfRevolution(profile, 20);
    const axis = joint.axis, other = Math.abs(axis[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0];
    const x = unit(cross(other, axis)), size = data.diagonal / data.half / 2.6;
    const T = fromColumns(scaled(x, size), scaled(cross(axis, x), size), scaled(axis, size), joint.place);
    return { ...this.shape({ position, normal: vertexNormals(position, triangles) }, triangles), T };
  }

  draw(motions) {
    const gl = this.gl, ratio = Math.min(devicePixelRatio || 1, 2);
    const width = Math.round(canvas.clientWidth * ratio), height = Math.round(canvas.clientHeight * ratio);
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.depthMask(true);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.uniformMatrix4fv(this.uniforms.view, false, viewMatrix());
    gl.uniformMatrix4fv(this.uniforms.projection, false, projectionMatrix(width / height));
    this.pointSize = (DISC * data.spacing * height) / 2 / Math.tan(FIELD / 2);
    motions.forEach((T, part) => this.part(part, T));
    if (shown.input) this.input();
    if (shown.axes) this.axes(motions);
  }

  part(part, T) {
    const glow = shown.active !== null && joints[shown.active].child === part ? 0.45 : 0;
    const style = { T, colour: partColours[part], shading: 1, glow };
    if (shown.mode === "meshes" && this.meshes) return this.triangles(this.meshes[part], style);
    const cloud = shown.mode === "true" && this.trueCloud ? this.trueCloud : this.cloud;
    this.points(cloud, rangeOf(points.ends, part), { ...style, size: this.pointSize, shading: points.normals ? 1 : 0 });
  }

  input() {
    const colour = rgb(getComputedStyle(canvas).getPropertyValue("--input-points").trim());
    const cloud = this.frames[pose.frame];
    const lift = data.spacing / camera.distance; // before the surface that they lie on
    this.points(cloud, [0, cloud.count], { T: identity(), colour, size: 0.4 * this.pointSize, shading: 0, lift });
  }

  // Axes shine faintly through what hides them.
  axes(motions) {
    const gl = this.gl, style = getComputedStyle(canvas);
    const [plain, active] = ["--axis", "--active"].map((name) => rgb(style.getPropertyValue(name).trim()));
    for (const [test, alpha] of [[gl.GREATER, 0.35], [gl.LEQUAL, 1]]) {
      gl.depthFunc(test);
      gl.depthMask(test === gl.LEQUAL);
      joints.forEach((joint, j) => {
        const T = multiply(motions[joint.parent], this.symbols[j].T);
        this.triangles(this.symbols[j], { T, colour: j === shown.active ? active : plain, shading: 1, alpha });
      });
    }
    gl.depthFunc(gl.LESS);
    gl.depthMask(true);
  }

  points(shape, [start, end], style) {
    this.prepare(shape, { ...style, disc: 1 });
    if (end > start) this.gl.drawArrays(this.gl.POINTS, start, end - start);
  }

  triangles(shape, style) {
    const gl = this.gl, type = shape.triangles instanceof Uint32Array ? gl.UNSIGNED_INT : gl.UNSIGNED_SHORT;
    this.prepare(shape, { ...style, disc: 0 });
    if (shape.triangles.length) gl.drawElements(gl.TRIANGLES, shape.triangles.length, type, 0);
  }

  prepare(shape, { T, colour, size = 1, shading, glow = 0, lift = 0, alpha = 1, disc }) {
    const gl = this.gl;
    gl.bindVertexArray(shape.vertexArray);
    gl.vertexAttrib3f(1, 0, 0, 1);
    gl.vertexAttrib3f(2, ...colour);
    gl.uniformMatrix4fv(this.uniforms.motion, false, T);
    for (const [name, value] of Object.entries({ size, shading, glow, lift, alpha, disc })) gl.uniform1f(this.uniforms[name], value);
  }
}

// Sums of the adjoining triangles' normals, each as long as its triangle is large.
function vertexNormals(position, triangles) {
  const normals = new Float32Array(position.length);
  const corner = (i) => [position[3 * i], position[3 * i + 1], position[3 * i + 2]];
  for (let t = 0; t < triangles.length; t += 3) {
    const abc = triangles.subarray(t, t + 3), [a, b, c] = [...abc].map(corner);
    const normal = cross(add(b, scaled(a, -1)), add(c, scaled(a, -1)));
    for (const i of abc) for (let k = 0; k < 3; k++) normals[3 * i + k] += normal[k];
  }
  return normals;
}

// A profile of (radius, height), turned about the z axis; its rings have corners of their own, so that edges are sharp.
function surfaceOfRevolution(profile, sides) {
  const position = [], triangles = [];
  for (let ring = 0; ring + 1 < profile.length; ring++)
    for (let side = 0; side <= sides; side++) {
      const angle = (2 * Math.PI * side) / sides, first = position.length / 3;
      for (const [radius, z] of [profile[ring], profile[ring + 1]])
        position.push(radius * Math.cos(angle), radius * Math.sin(angle), z);
      if (side < sides) triangles.push(first, first + 2, first + 1, first + 1, first + 2, first + 3);
    }
  return { position: new Float32Array(position), triangles: new Uint16Array(triangles) };
}

// Part numbers over the view.
const badges = data.parts.map((part, i) => {
  const badge = document.createElement("span");
  badge.className = "badge";
  badge.textContent = part.id;
  badge.style.setProperty("--part", part.colour);
  if (!centroids[i]) badge.hidden = true;
  element("badges").append(badge);
  return badge;
});

function placeBadges(motions) {
  element("badges").hidden = !shown.badges;
  if (!shown.badges) return;
  const width = canvas.clientWidth, height = canvas.clientHeight;
  const T = multiply(projectionMatrix(width / height), viewMatrix());
  badges.forEach((badge, part) => {
    if (!centroids[part]) return;
    const [x, y, z, w] = apply(T, apply(motions[part], centroids[part]));
    badge.style.transform = `translate(${((x / w + 1) / 2) * width}px, ${((1 - y / w) / 2) * height}px) translate(-50%, -50%)`;
    badge.style.zIndex = Math.round(1000 * (1 - z / w));
  });
}

let renderer = null, draws = 0, requested = false;

function redraw() {
  if (requested) return;
  requested = true;
  requestAnimationFrame((now) => {
    requested = false;
    if (player.playing) advance(now);
    const motions = partMotions();
    if (renderer) {
      renderer.draw(motions);
      placeBadges(motions);
    }
    draws += 1;
    if (player.playing) redraw();
  });
}

// ---------------------------------------------------------------- the page's controls

const sliders = joints.map((_, j) => [...document.querySelectorAll(`input[data-joint="${j}"]`)]);
const frameSlider = element("frame"), frameText = element("frame-text"), playButton = element("play");
const lastFrame = data.T_frame_root.length - 1;
const player = { playing: false, time: data.canonical, direction: 1, now: 0, speed: 4 }; // frames a second

// What a slider says of its value: degrees of an angle, the input's units of a length.
function told(slider) {
  const value = Number(slider.value), angle = slider.dataset.unit === "rad";
  if (angle) {
    const degrees = (Math.round((value * 1800) / Math.PI) / 10 + 0).toFixed(1); // + 0: no "-0.0"
    return [`${degrees}°`, `${degrees} degrees`];
  }
  const text = `${Number(value.toPrecision(3))} ${slider.dataset.unit}`.trim();
  return [text, text];
}

function showValues() {
  sliders.forEach((ofJoint, j) =>
    ofJoint.forEach((slider, k) => {
      slider.value = Array.isArray(pose.values[j]) ? pose.values[j][k] : pose.values[j];
      tell(slider);
    }));
}

function tell(slider) {
  const [text, words] = told(slider);
  slider.parentElement.querySelector("output").textContent = text;
  slider.setAttribute("aria-valuetext", words);
}

function showFrame(posed = false) {
  frameSlider.value = player.time;
  const words = `frame ${pose.frame}${pose.frame === data.canonical ? ", canonical" : ""}`;
  frameText.textContent = posed ? "posed by hand" : `${words}, of 0 to ${lastFrame}`;
  frameSlider.setAttribute("aria-valuetext", posed ? `posed by hand, after ${words}` : words);
}

function setFrame(time) {
  player.time = time;
  poseAt(time);
  showValues();
  showFrame();
  redraw();
}

function setState(j, value) {
  play(false);
  pose.values[j] = value;
  showValues();
  showFrame(true);
  redraw();
}

function resetJoints() {
  play(false);
  player.direction = 1;
  setFrame(data.canonical);
}

function play(on) {
  if (player.playing === on) return;
  player.playing = on;
  player.now = 0;
  playButton.textContent = on ? "❚❚" : "▶";
  playButton.setAttribute("aria-label", on ? "Pause" : "Play the fitted sequence");
  if (!on) setFrame(Math.round(player.time));
  redraw();
}

// To and fro. Beside the input's points the model goes from frame to frame; alone, it glides.
function advance(now) {
  const elapsed = player.now ? Math.min((now - player.now) / 1000, 0.25) : 0;
  player.now = now;
  player.phase = Math.min(Math.max((player.phase ?? player.time) + player.direction * player.speed * elapsed, 0), lastFrame);
  if (player.phase === lastFrame) player.direction = -1;
  if (player.phase === 0) player.direction = 1;
  const time = shown.input || reducedMotion ? Math.round(player.phase) : player.phase;
  if (time !== player.time) setFrame(time);
}

sliders.forEach((ofJoint, j) =>
  ofJoint.forEach((slider) => {
    slider.addEventListener("input", () => setState(j, ofJoint.length > 1 ? ofJoint.map((s) => Number(s.value)) : Number(slider.value)));
    const row = slider.closest("li");
    const activate = (on) => () => {
      shown.active = on ? j : null;
      redraw();
    };
    row.addEventListener("pointerenter", activate(true));
    row.addEventListener("pointerleave", activate(false));
    slider.addEventListener("focus", activate(true));
    slider.addEventListener("blur", activate(false));
  }));
frameSlider.addEventListener("input", () => {
  play(false);
  setFrame(Number(frameSlider.value));
});
playButton.addEventListener("click", () => {
  player.phase = player.time;
  play(!player.playing);
});
element("reset").addEventListener("click", resetJoints);
element("reset-view").addEventListener("click", () => {
  resetView();
  redraw();
});
element("up").addEventListener("change", (event) => {
  resetView(event.target.value);
  redraw();
});
for (const radio of document.querySelectorAll("input[name=mode]"))
  radio.addEventListener("change", () => {
    shown.mode = radio.value;
    redraw();
  });
for (const name of ["axes", "badges", "input"]) {
  const box = element(`show-${name}`);
  shown[name] = box.checked;
  box.addEventListener("change", () => {
    shown[name] = box.checked;
    if (name === "input") setFrame(Math.round(player.time));
    redraw();
  });
}

// ---------------------------------------------------------------- mouse, touch and keys on the view

const pointers = new Map();

function orbit(right, down) {
  camera.azimuth -= right;
  camera.elevation = Math.min(Math.max(camera.elevation + down, -1.55), 1.55);
}

function pan(right, down) {
  const [side, up] = viewAxes(), step = (2 * camera.distance * Math.tan(FIELD / 2)) / canvas.clientHeight;
  camera.target = add(camera.target, add(scaled(side, -right * step), scaled(up, down * step)));
}

function zoom(factor) {
  camera.distance = Math.min(Math.max(camera.distance * factor, 0.1), 50);
}

canvas.addEventListener("pointerdown", (event) => {
  canvas.setPointerCapture(event.pointerId);
  pointers.set(event.pointerId, [event.clientX, event.clientY]);
});
for (const end of ["pointerup", "pointercancel"])
  canvas.addEventListener(end, (event) => pointers.delete(event.pointerId));
canvas.addEventListener("pointermove", (event) => {
  const before = pointers.get(event.pointerId);
  if (!before) return;
  const here = [event.clientX, event.clientY], moved = [here[0] - before[0], here[1] - before[1]];
  if (pointers.size === 2) {
    const other = [...pointers].find(([id]) => id !== event.pointerId)[1];
    const apart = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]) || 1;
    zoom(apart(before) / apart(here));
    pan(moved[0] / 2, moved[1] / 2);
  } else if (event.shiftKey || event.buttons & 6) pan(...moved);
  else orbit(moved[0] * 0.008, moved[1] * 0.008);
  pointers.set(event.pointerId, here);
  redraw();
});
canvas.addEventListener("contextmenu", (event) => event.preventDefault());
canvas.addEventListener("wheel", (event) => {
  event.preventDefault();
  zoom(Math.exp(Math.sign(event.deltaY) * Math.min(Math.abs(event.deltaY), 60) * 0.003));
  redraw();
}, { passive: false });
canvas.addEventListener("keydown", (event) => {
  const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
  if (event.ctrlKey || event.altKey || event.metaKey) return;
  if (arrows && event.shiftKey) pan(...scaled(arrows, 30));
  else if (arrows) orbit(...scaled(arrows, 0.12));
  else if (event.key === "+" || event.key === "=") zoom(0.88);
  else if (event.key === "-") zoom(1 / 0.88);
  else if (event.key === "0" || event.key === "Home") resetView();
  else if (event.key === " ") playButton.click();
  else return;
  event.preventDefault();
  redraw();
});
new ResizeObserver(redraw).observe(canvas);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);

// ---------------------------------------------------------------- start

const gl = canvas.getContext("webgl2", { antialias: true });
if (gl) {
  renderer = new Renderer(gl);
  canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
  canvas.addEventListener("webglcontextrestored", () => {
    renderer = new Renderer(gl);
    redraw();
  });
} else {
  element("no-webgl").hidden = false;
  canvas.hidden = true;
}
resetView();
setFrame(data.canonical);

// For tests, and for whoever opens the console: parts' middles are in the input's coordinates.
window.reart = {
  get frame() { return pose.frame; },
  get playing() { return player.playing; },
  get draws() { return draws; },
  get values() { return pose.values; },
  get centroids() { return partMotions().map((T, part) => centroids[part] && toInput(apply(T, centroids[part]).slice(0, 3))); },
  setFrame,
  setState,
};
