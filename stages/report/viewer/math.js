// Vectors, and rigid transforms as column-major 4 x 4 matrices. Pure: it knows neither the page nor the scene.

const add = (a, b) => a.map((value, i) => value + b[i]);
const scaled = (a, factor) => a.map((value) => value * factor);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => scaled(a, 1 / (Math.hypot(...a) || 1));
const between = (a, b, share) => add(a, scaled(add(b, scaled(a, -1)), share));
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

// The rotation by an angle about a unit axis through the origin, as three columns, by Rodrigues' formula.
function rotation(axis, angle) {
  const cosine = Math.cos(angle), sine = Math.sin(angle);
  return [[1, 0, 0], [0, 1, 0], [0, 0, 1]].map((e) =>
    add(add(scaled(e, cosine), scaled(cross(axis, e), sine)), scaled(axis, dot(axis, e) * (1 - cosine))));
}

// A point that three columns turn about the origin.
function turned(columns, point) {
  return columns.reduce((sum, column, i) => add(sum, scaled(column, point[i])), [0, 0, 0]);
}
