// The drawing of points, meshes and joints with WebGL 2.

const DISC = 2.0; // diameter of a drawn point, in spacings of the cloud

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
    this.scanCloud = points.scanColours && this.shape({ position: points.positions, normal: points.normals, colour: points.scanColours });
    this.trueCloud = points.trueColours && this.shape({ position: points.positions, normal: points.normals, colour: points.trueColours });
    this.frames = frames.map((position) => this.shape({ position }));
    this.meshes = data.meshes && this.meshShapes(data.meshes);
    const painted = data.meshes?.scanColours && decoded(data.meshes.scanColours, Uint8Array);
    this.scanMeshes = painted && this.meshShapes(data.meshes, painted);
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

  // The mesh of each part, with colours of all vertices where they are given.
  meshShapes(meshes, colours = null) {
    const all = positions(meshes.positions);
    const corners = decoded(meshes.triangles, meshes.wide ? Uint32Array : Uint16Array);
    return data.parts.map((_, part) => {
      const range = rangeOf(meshes.vertexEnds, part).map((i) => 3 * i);
      const position = all.subarray(...range), colour = colours?.subarray(...range);
      const triangles = corners.subarray(...rangeOf(meshes.triangleEnds, part).map((i) => 3 * i));
      return this.shape({ position, normal: vertexNormals(position, triangles), colour }, triangles);
    });
  }

  symbol(joint) {
    const { position, triangles } = surfaceOfRevolution(glyphProfile(joint), 20);
    const axis = unit(joint.axis), other = Math.abs(axis[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0];
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
    const style = { T, colour: partColours[part], shading: 1, glow }, byScan = shown.colouring === "scan";
    if (shown.mode === "meshes" && this.meshes)
      return this.triangles(((byScan && this.scanMeshes) || this.meshes)[part], style);
    const byPartOrScan = (byScan && this.scanCloud) || this.cloud;
    const cloud = (shown.mode === "true" && this.trueCloud) || byPartOrScan;
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
