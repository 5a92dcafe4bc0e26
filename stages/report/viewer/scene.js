// What the page shows: its data as arrays, and the pose of the model.
// Lengths are those of the view: the scene lies between -1 and 1 on each axis.

const element = (id) => document.getElementById(id);
const data = JSON.parse(element("data").textContent);
const canvas = element("canvas");
const shown = { mode: "points", colouring: "part", axes: true, badges: true, input: false, active: null };

function decoded(text, Type) {
  const bytes = Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
  return new Type(bytes.buffer); // little-endian, as is every machine that runs a browser
}

const positions = (text) => Float32Array.from(decoded(text, Int16Array), (value) => value / 32767);
const toInput = (p) => add(scaled(p, data.half), data.centre);
const rgb = (colour) => [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16) / 255);

const points = {
  positions: positions(data.points.positions),
  normals: data.points.normals && Float32Array.from(decoded(data.points.normals, Int8Array), (value) => value / 127),
  scanColours: data.points.scanColours && decoded(data.points.scanColours, Uint8Array),
  trueColours: data.points.trueColours && decoded(data.points.trueColours, Uint8Array),
  ends: data.points.ends,
};
const frames = data.frames.map(positions);
const tree = treeInView(data);
const joints = tree.joints;
const partColours = data.parts.map((part) => rgb(part.colour));
const rangeOf = (ends, i) => [i ? ends[i - 1] : 0, ends[i]];

// The middle of each part's canonical points, in view coordinates; null where it has none.
const centroids = data.parts.map((_, part) => {
  const [start, end] = rangeOf(points.ends, part);
  let sum = [0, 0, 0];
  for (let i = start; i < end; i++) sum = add(sum, [...points.positions.subarray(3 * i, 3 * i + 3)]);
  return end > start ? scaled(sum, 1 / (end - start)) : null;
});

// The states of the joints, the root's transform, and the frame that is shown.
const pose = {
  states: joints.map((joint) => joint.basis.map(() => 0)),
  T_root: tree.Ts_root[data.canonical],
  frame: data.canonical,
};

// Poses the model as at a time between two frames.
function poseAt(time) {
  const before = Math.floor(time), share = time - before, after = Math.min(before + 1, tree.Ts_root.length - 1);
  pose.states = joints.map((joint) => between(joint.states[before], joint.states[after], share));
  pose.T_root = transformBetween(tree.Ts_root[before], tree.Ts_root[after], share);
  pose.frame = Math.round(time);
}

// Where the canonical points of each part lie in the pose.
const partMotions = () => partTransforms(tree, pose.states, pose.T_root);
