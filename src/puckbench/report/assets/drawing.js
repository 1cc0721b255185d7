// Drawing a cloud's points into a canvas: with WebGL, and without where there is none.
"use strict";

const BACKGROUND = [12, 13, 16];
const FARTHEST_SHADE = 0.65;

/** What draws into a canvas: an object with `load(cloud)` and `draw(view)`.
 *
 * cloud: {xyz: Float32Array (3 n), colours: Uint8Array (3 n)}. view: {axes, target, away, radius,
 * size (pixels of a point), top (nothing above is drawn), front (nothing nearer is)}.
 */
function drawerOf(canvas) {
  const gl = canvas.getContext("webgl", { antialias: true, preserveDrawingBuffer: true });
  return gl ? new WebGLDrawer(canvas, gl) : new PlainDrawer(canvas);
}

const VERTEX = `
  attribute vec3 place;
  attribute vec3 colour;
  uniform mat3 axes;
  uniform vec3 target;
  uniform vec2 focal;
  uniform float away, radius, size, top, front;
  varying vec3 shown;
  void main() {
    vec3 seen = (place - target) * axes;  // the rows of the rotation are the columns of axes
    float depth = away - seen.z;
    float far = away + 3.0 * radius, near = 0.001 * radius;
    float z = (depth * (far + near) - 2.0 * far * near) / (far - near);
    gl_Position = vec4(focal * seen.xy, z, depth);
    if (place.z > top || depth < front) gl_Position = vec4(0.0, 0.0, 2.0, 1.0);
    gl_PointSize = size;
    float behind = clamp((depth - away + radius) / (2.0 * radius), 0.0, 1.0);
    shown = colour * mix(1.0, ${FARTHEST_SHADE.toFixed(2)}, behind);
  }`;
const FRAGMENT = `
  precision mediump float;
  varying vec3 shown;
  void main() {
    vec2 from = gl_PointCoord - 0.5;
    if (dot(from, from) > 0.25) discard;
    gl_FragColor = vec4(shown, 1.0);
  }`;

class WebGLDrawer {
  constructor(canvas, gl) {
    [this.canvas, this.gl, this.count] = [canvas, gl, 0];
    this.buffers = { place: gl.createBuffer(), colour: gl.createBuffer() };
    this.program = programOf(gl);
    gl.useProgram(this.program);
    gl.enable(gl.DEPTH_TEST);
    gl.clearColor(...BACKGROUND.map((v) => v / 255), 1);
  }

  load({ xyz, colours }) {
    this.count = xyz.length / 3;
    this.fill("place", xyz, this.gl.FLOAT, false);
    this.fill("colour", colours, this.gl.UNSIGNED_BYTE, true);
  }

  fill(name, values, type, normalised) {
    const { gl } = this;
    const location = gl.getAttribLocation(this.program, name);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffers[name]);
    gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(location);
    gl.vertexAttribPointer(location, 3, type, normalised, 0, 0);
  }

  draw(view) {
    const { gl, canvas } = this;
    const at = (name) => gl.getUniformLocation(this.program, name);
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.uniformMatrix3fv(at("axes"), false, view.axes.flat());
    gl.uniform3fv(at("target"), view.target);
    gl.uniform2f(at("focal"), (FOCAL * canvas.height) / canvas.width, FOCAL);
    for (const name of ["away", "radius", "size", "top", "front"]) gl.uniform1f(at(name), view[name]);
    gl.drawArrays(gl.POINTS, 0, this.count);
  }
}

function programOf(gl) {
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  return program;
}

/** The same picture pixel by pixel, with a depth for each: squares instead of discs. */
class PlainDrawer {
  constructor(canvas) {
    [this.canvas, this.context] = [canvas, canvas.getContext("2d")];
    this.cloud = { xyz: [], colours: [] };
  }

  load(cloud) {
    this.cloud = cloud;
  }

  draw(view) {
    const { width, height } = this.canvas;
    const picture = this.context.createImageData(width, height);
    const pixels = new Uint32Array(picture.data.buffer).fill(packed(...BACKGROUND));
    const depths = new Float32Array(width * height).fill(Infinity);
    const { xyz, colours } = this.cloud;
    const focal = (FOCAL * height) / 2;
    for (let at = 0; at < xyz.length; at += 3) {
      if (xyz[at + 2] > view.top) continue;
      const seen = view.axes.map((axis) => axis.reduce((sum, v, n) => sum + v * (xyz[at + n] - view.target[n]), 0));
      const depth = view.away - seen[2];
      if (depth < Math.max(view.front, 0.001 * view.radius)) continue;
      const behind = Math.max(0, Math.min(1, (depth - view.away + view.radius) / (2 * view.radius)));
      const shade = 1 - (1 - FARTHEST_SHADE) * behind;
      const colour = packed(...[0, 1, 2].map((n) => colours[at + n] * shade));
      const left = Math.round(width / 2 + (focal * seen[0]) / depth - view.size / 2);
      const top = Math.round(height / 2 - (focal * seen[1]) / depth - view.size / 2);
      square(pixels, depths, width, height, left, top, Math.max(1, Math.round(view.size)), depth, colour);
    }
    this.context.putImageData(picture, 0, 0);
  }
}

/** A colour as the four bytes of a pixel, on the little-endian machines that there are. */
function packed(red, green, blue) {
  return ((255 << 24) | (blue << 16) | (green << 8) | red) >>> 0;
}

function square(pixels, depths, width, height, left, top, size, depth, colour) {
  for (let y = Math.max(0, top); y < Math.min(height, top + size); y += 1) {
    for (let x = Math.max(0, left); x < Math.min(width, left + size); x += 1) {
      const at = y * width + x;
      if (depth < depths[at]) [depths[at], pixels[at]] = [depth, colour];
    }
  }
}
