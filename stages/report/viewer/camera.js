// The camera: how the view is turned, moved and scaled.

const UP = { z: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], y: [[0, 0, 1], [1, 0, 0], [0, 1, 0]], x: [[0, 1, 0], [0, 0, 1], [1, 0, 0]] };
const FIELD = 0.5; // radians, of the view's height
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
